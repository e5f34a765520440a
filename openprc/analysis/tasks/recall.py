"""Tasks of pure memory, and of memory with a decision: delay recall and parity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.tasks.scoring import Metric
from openprc.analysis.tasks.series import TargetSeries
from openprc.analysis.tasks.task import ImitationTask, input_symbols, positive_count
from openprc.errors import TaskError


@dataclass(frozen=True)
class DelayRecallTask(ImitationTask):
    """Give back what the input was some symbols ago.

    ``y_d(k) = u(k - d)``; one output for every delay and column of the input. The sum over
    all delays of its squared correlation is the memory capacity.

    Parameters
    ----------
    delays : int or sequence of int
        0 is the present symbol.

    Examples
    --------
    >>> DelayRecallTask(2).target([1.0, 2.0, 3.0, 4.0]).values[:, 0]
    array([nan, nan,  1.,  2.])
    """

    delays: int | Sequence[int] = 1
    metric: ClassVar[Metric] = "corr2"
    source: ClassVar[str] = "Jaeger 2002, Short term memory in echo state networks, GMD Report 152"

    def __post_init__(self) -> None:
        given = list(self.delays) if np.ndim(self.delays) else [self.delays]  # type: ignore[arg-type]
        delays = tuple(positive_count(delay, "delays", least=0) for delay in given)
        if not delays or len(set(delays)) != len(delays):
            raise TaskError(
                f"the delays are {self.delays!r}",
                expected="at least one, each once",
                fix="name other delays",
                key="delays",
            )
        object.__setattr__(self, "delays", delays)

    @property
    def name(self) -> str:
        """``delay3``, or ``delay1-20`` for many."""
        delays = self._delays
        return f"delay{delays[0]}" if len(delays) == 1 else f"delay{min(delays)}-{max(delays)}"

    @property
    def formula(self) -> str:
        """The delays written out."""
        return "; ".join(f"y(k) = u(k-{d})" if d else "y(k) = u(k)" for d in self._delays)

    @property
    def n_warmup(self) -> int:
        """The longest delay."""
        return max(self._delays)

    @property
    def _delays(self) -> tuple[int, ...]:
        return tuple(self.delays)  # type: ignore[arg-type]

    def target(self, u: ArrayLike) -> TargetSeries:
        """Return one column per delay, and within a delay one per column of the input.

        Raises
        ------
        TaskError
            When the input is no longer than the longest delay.
        """
        values = input_symbols(u)
        n_columns = values.shape[1]
        columns, names = [], []
        for delay in self._delays:
            shifted = np.full_like(values, np.nan)
            shifted[delay:] = values[: len(values) - delay]
            columns.append(shifted)
            names += [
                f"u(k-{delay})" if n_columns == 1 else f"u{c}(k-{delay})" for c in range(n_columns)
            ]
        return TargetSeries(np.hstack(columns), n_warmup=self.n_warmup, names=tuple(names))


@dataclass(frozen=True)
class ParityTask(ImitationTask):
    """Parity of some consecutive symbols of a two-valued input.

    With s = +1 for the higher and -1 for the lower of the two values,
    ``y(k) = s(k-d) s(k-d-1) ... s(k-d-n+1)``. For n = 2 this is -1 where two neighbours differ:
    XOR. No linear readout of past inputs has any correlation with it when the symbols are
    independent and n is above 1.

    Parameters
    ----------
    n : int
        Symbols in the product.
    delay : int
        Symbols between the youngest of them and the present one.
    """

    n: int = 2
    delay: int = 0
    metric: ClassVar[Metric] = "corr2"
    levels: ClassVar[tuple[float, ...]] = (-1.0, 1.0)
    source: ClassVar[str] = (
        "Bertschinger and Natschlaeger 2004, doi:10.1162/089976604323057443 (parity of the last "
        "n bits)"
    )

    def __post_init__(self) -> None:
        positive_count(self.n, "n")
        positive_count(self.delay, "delay", least=0)

    @property
    def name(self) -> str:
        """``xor`` for two symbols, else ``parity<n>``, with the delay if there is one."""
        base = "xor" if self.n == 2 else f"parity{self.n}"
        return base + (f"-delay{self.delay}" if self.delay else "")

    @property
    def formula(self) -> str:
        """The product written out."""
        last = self.delay + self.n - 1
        return (
            f"y(k) = prod_(i={self.delay}..{last}) s(k-i), s = +1 for the higher and -1 for the "
            "lower input value"
        )

    @property
    def n_warmup(self) -> int:
        """Rows before all symbols of the product are known."""
        return self.delay + self.n - 1

    def target(self, u: ArrayLike) -> TargetSeries:
        """Return the product, (K, 1).

        Raises
        ------
        TaskError
            When the input takes other than two values.
        """
        signs = two_valued(input_symbols(u, n_columns=1)[:, 0])
        product = np.full(len(signs), np.nan)
        start = self.n_warmup
        if len(signs) > start:
            product[start:] = np.prod(
                [
                    signs[start - shift : len(signs) - shift]
                    for shift in range(self.delay, self.delay + self.n)
                ],
                axis=0,
            )
        return TargetSeries(product, n_warmup=start)


def two_valued(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return -1 for the lower and +1 for the higher value of a two-valued sequence, (K,).

    Raises
    ------
    TaskError
        When there are more or fewer than two values.
    """
    low, high = float(u.min()), float(u.max())
    # Symbols that went through a scaling and a file differ in their last digits.
    slack = 1e-6 * (high - low)
    is_high = u >= high - slack
    if not high > low or not (is_high | (u <= low + slack)).all():
        count = len(np.unique(u))
        raise TaskError(
            f"the input takes {count} values",
            expected="two, such as -1 and 1 or 0 and 1",
            fix="drive the body with binary symbols",
            key="u",
        )
    return np.where(is_high, 1.0, -1.0)
