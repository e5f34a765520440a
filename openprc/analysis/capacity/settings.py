"""Every choice in the measurement of capacities, and which rows it runs on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import DTypeLike, NDArray

from openprc.analysis.capacity.capacities import Estimator
from openprc.analysis.capacity.drive import Coloured, Correlated
from openprc.analysis.capacity.polynomials import Basis
from openprc.analysis.capacity.targets import RowSpan
from openprc.analysis.capacity.thresholds import Correction, check_alpha
from openprc.errors import TaskError
from openprc.reservoir.training.row_split import RowSplit

Null = Literal["beta", "circular", "shuffle"]
Orthonormalize = Literal["average", "exact"]
Excess = Literal["raise", "report"]


@dataclass(frozen=True)
class Settings:
    """The choices; `information_processing_capacity` explains each."""

    basis: Basis = "empirical"
    estimator: Estimator = "insample"
    ridge: float = 1e-6
    eps: float | None = None
    alpha: float = 0.01
    correction: Correction = "bonferroni"
    null: Null = "beta"
    n_surrogates: int = 99
    orthonormalize: Orthonormalize = "average"
    coloured: Coloured = "adapt"
    correlated: Correlated = "refuse"
    excess: Excess = "raise"
    rank_tolerance: float | None = None
    dtype: DTypeLike = np.float64
    seed: int = 0
    blas_threads: int | None = None

    def __post_init__(self) -> None:
        check_alpha(self.alpha)
        choices: dict[str, Any] = {
            "estimator": Estimator,
            "null": Null,
            "orthonormalize": Orthonormalize,
            "coloured": Coloured,
            "excess": Excess,
        }
        for name, kind in choices.items():
            value = getattr(self, name)
            if value not in get_args(kind):
                raise TaskError(
                    f"{name} is {value!r}",
                    expected=" or ".join(get_args(kind)),
                    fix="choose one of these",
                    key=name,
                )
        if np.dtype(self.dtype) not in (np.dtype(np.float64), np.dtype(np.float32)):
            raise TaskError(
                f"dtype is {np.dtype(self.dtype).name}",
                expected="float64 or float32",
                fix="choose one of these",
                key="dtype",
            )
        if self.eps is not None and not np.isfinite(self.eps):
            raise TaskError(
                f"eps is {self.eps!r}",
                expected="a number that capacities have to exceed",
                fix="leave it out for a threshold from the distribution of chance",
                key="eps",
            )
        if self.estimator == "heldout" and self.correction == "benjamini-hochberg":
            raise TaskError(
                "held-out capacities and a false discovery rate were asked for together",
                expected="bonferroni or none for held-out capacities",
                fix='use estimator="insample"',
                key="correction",
            )
        if self.estimator == "heldout" and self.orthonormalize == "exact":
            raise TaskError(
                "exactly orthonormal targets and held-out scores were asked for together",
                expected="either: targets are orthonormal on the rows that they were made on",
                fix='use estimator="insample"',
                key="orthonormalize",
            )


@dataclass(frozen=True)
class Rows:
    """The rows of a measurement.

    ``fit`` are the rows that capacities are measured on in-sample, or fitted on; ``test`` are
    those of held-out scores, or None. ``n_without_past`` rows were left out, because targets
    reach back to before the first input.
    """

    fit: NDArray[np.intp]
    test: NDArray[np.intp] | None
    n_without_past: int

    @classmethod
    def choose(
        cls,
        n_rows: int,
        *,
        max_delay: int,
        washout: int = 0,
        split: RowSplit | None = None,
        usable: NDArray[np.bool_] | None = None,
        held_out: bool = False,
    ) -> Rows:
        """Choose the rows that all targets have.

        Raises
        ------
        TaskError
            When the split does not fit, there is none for a held-out score, or no row is left.
        """
        flags = np.ones(n_rows, dtype=bool) if usable is None else np.asarray(usable, dtype=bool)
        if flags.shape != (n_rows,):
            raise TaskError(
                f"usable has shape {flags.shape}",
                expected=f"({n_rows},), one flag per row of the states",
                fix="correct it",
                key="usable",
            )
        if split is None:
            if held_out:
                raise TaskError(
                    "a held-out capacity was asked for without a split",
                    expected="rows to fit on and rows to score on",
                    fix="pass split=RowSplit(washout=100, train=3500, test=1500)",
                    key="split",
                )
            if not 0 <= washout < n_rows:
                raise TaskError(
                    f"the washout is {washout} of {n_rows} rows",
                    expected=f"0 to {n_rows - 1}",
                    fix="correct it",
                    key="washout",
                )
            fit, test = washout + np.flatnonzero(flags[washout:]), None
        else:
            if split.n_rows > n_rows:
                raise TaskError(
                    f"the split needs {split.n_rows} rows and there are {n_rows}",
                    expected=f"at most {n_rows} rows",
                    fix="shorten the spans",
                    key="split",
                )
            fit, test = split.masks(flags)
            if not held_out:
                fit, test = np.concatenate([fit, test]), None
        kept = fit[fit >= max_delay]
        n_test = None if test is None else test[test >= max_delay]
        if len(kept) < 3 or (n_test is not None and len(n_test) < 3):
            raise TaskError(
                f"the targets reach back {max_delay} rows, and {len(kept)} rows are left",
                expected="many more rows than the largest delay",
                fix="lower the largest delay, or record for longer",
                key="delays",
            )
        return cls(kept, n_test, len(fit) - len(kept))

    @property
    def first(self) -> int:
        """The first row that counts."""
        return int(self.fit[0])

    @property
    def last(self) -> int:
        """The last row that counts."""
        return int(self.fit[-1] if self.test is None else self.test[-1])

    def spans(self, offset: int) -> tuple[RowSpan, RowSpan | None]:
        """Return fit and test rows as spans, counted from row `offset`."""
        fit = RowSpan.of(self.fit - offset)
        return fit, None if self.test is None else RowSpan.of(self.test - offset)
