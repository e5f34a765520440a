"""NARMA as a task, and inputs that do not make it diverge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.tasks.imitation import NARMA_task, narma_system
from openprc.analysis.tasks.scoring import Metric
from openprc.analysis.tasks.series import TargetSeries, TaskData
from openprc.analysis.tasks.task import (
    ImitationTask,
    Randomness,
    generator_of,
    input_symbols,
    positive_count,
)
from openprc.errors import Diverged, TaskError


@dataclass(frozen=True)
class NarmaTask(ImitationTask):
    """The response of a NARMA system to the input; see `narma_system` for the recursions.

    Row k is y(k+1), the value that the recursion computes from u(k).

    Parameters
    ----------
    order : int
        2 to 10, 20 or 30.
    any_range : bool
        Do not check that the input is within the range that the system is defined for.
    """

    order: int = 2
    any_range: bool = False
    metric: ClassVar[Metric] = "nrmse"

    def __post_init__(self) -> None:
        narma_system(self.order)

    @property
    def name(self) -> str:
        """``narma<order>``."""
        return f"narma{self.order}"

    @property
    def formula(self) -> str:
        """The recursion."""
        return narma_system(self.order).formula

    @property
    def source(self) -> str:
        """Where the coefficients come from."""
        return narma_system(self.order).source

    @property
    def n_warmup(self) -> int:
        """Rows that would need values from before the first symbol."""
        return self.order - 1

    def target(self, u: ArrayLike) -> TargetSeries:
        """Return y(k+1) for every symbol u(k), (K, 1), from rest.

        Raises
        ------
        TaskError
            When the input is out of range or makes the system diverge.
        """
        values = input_symbols(u, n_columns=1)[:, 0]
        response = NARMA_task(values, self.order, horizon=1, any_range=self.any_range)
        return TargetSeries(response, n_warmup=self.n_warmup)

    def generate(self, n: int, *, rng: Randomness) -> TaskData:
        """Return `n` symbols drawn from U[0, 0.5] that leave the system bounded, and its target.

        Raises
        ------
        Diverged
            When no such sequence is found; see `bounded_input`.
        """
        drawn = bounded_input(n, self.order, rng=rng)
        return TaskData(
            input=drawn.input,
            target=self.target(drawn.input),
            metadata={**self.metadata(), "n_rejected": drawn.n_rejected},
            seed=drawn.seed,
        )


@dataclass(frozen=True, eq=False)
class BoundedInput:
    """A uniform input, (K,), and how many sequences were drawn in vain before it."""

    input: NDArray[np.float64]
    n_rejected: int
    seed: int | None = None


def bounded_input(n: int, order: int, *, rng: Randomness, max_rejected: int = 100) -> BoundedInput:
    """Draw sequences from U[0, 0.5] until one leaves the NARMA system bounded.

    About 1 in 20 sequences of 10,000 symbols makes order 10 diverge. To reject those is a
    choice with a consequence that is small but there: the input is no longer quite
    independent, so say how many were rejected.

    Parameters
    ----------
    n : int
    order : int
    rng : int or numpy.random.Generator
    max_rejected : int
        Give up after that many.

    Raises
    ------
    Diverged
        When `max_rejected` sequences in a row diverged: `n` is too long for this order.
    """
    generator, seed = generator_of(rng)
    positive_count(n, "n")
    narma_system(order)
    for n_rejected in range(positive_count(max_rejected, "max_rejected", least=0) + 1):
        u = generator.uniform(0.0, 0.5, n)
        try:
            NARMA_task(u, order)
        except TaskError:
            # The input is in range and finite, so divergence is all that is left.
            continue
        return BoundedInput(u, n_rejected, seed)
    raise Diverged(
        f"NARMA{order} diverged on {max_rejected + 1} sequences of {n} symbols",
        expected="one bounded response",
        fix="draw fewer symbols, or use order 20, which is bounded",
        key="n",
    )
