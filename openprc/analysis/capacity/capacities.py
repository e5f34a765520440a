"""`Capacities`: what was measured, what counts, and what it adds up to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from openprc.analysis.capacity.terms import Terms
from openprc.analysis.capacity.thresholds import chance_mean

Estimator = Literal["insample", "heldout"]


@dataclass(frozen=True)
class Profile:
    """Capacity above threshold by degree and delay.

    ``values`` (n_degrees, n_delays); a product counts at the largest delay among its factors.
    ``degrees`` (n_degrees,) are total degrees, ``delays`` (n_delays,) [rows].
    """

    degrees: NDArray[np.int64]
    delays: NDArray[np.int64]
    values: NDArray[np.float64]


@dataclass(frozen=True)
class Capacities:
    """The outcome for K targets.

    Parameters
    ----------
    terms : Terms
        The targets.
    raw : (K,)
        Capacities as measured. In-sample ones lie in [0, 1], and chance gives
        ``rank / (T - 1)`` on average; held-out ones may be negative.
    thresholds : (K,)
        What each has to exceed to count.
    rank : int
        Independent states: the upper bound of the sum over orthonormal targets.
    n_rows : int
        Rows that the capacities were measured on (test rows, if held out).
    estimator : {"insample", "heldout"}
    orthonormal : bool
        Whether the targets were made exactly orthonormal, in their order.
    chance : (K,), optional
        Mean of each capacity over surrogates, where thresholds come from such.
    metadata : mapping
        How it was done, as plain values.
    warnings : tuple of str
    """

    terms: Terms
    raw: NDArray[np.float64]
    thresholds: NDArray[np.float64]
    rank: int
    n_rows: int
    estimator: Estimator = "insample"
    orthonormal: bool = False
    chance: NDArray[np.float64] | None = None
    metadata: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    @cached_property
    def values(self) -> NDArray[np.float64]:
        """Capacities above threshold, and 0 for the others, (K,)."""
        return np.where(self.raw > self.thresholds, self.raw, 0.0)

    @cached_property
    def corrected(self) -> NDArray[np.float64]:
        """Capacities without what chance adds on average, (K,).

        In-sample ``(C - b) / (1 - b)`` with ``b = rank / (T - 1)``, which is without bias, or
        the mean over surrogates for b; held-out ones as they are, whose bias is negative and
        small.
        """
        if self.estimator == "heldout":
            return self.raw
        bias = chance_mean(self.rank, self.n_rows) if self.chance is None else self.chance
        return (self.raw - bias) / (1.0 - bias)

    @property
    def degrees(self) -> NDArray[np.int64]:
        """Total degree of each target, (K,)."""
        return self.terms.total_degree

    @property
    def delays(self) -> NDArray[np.int64]:
        """Largest delay of each target, (K,) [rows]."""
        return self.terms.max_delay

    @property
    def n_significant(self) -> int:
        """Targets above threshold."""
        return int(np.count_nonzero(self.values))

    @property
    def total(self) -> float:
        """Information processing capacity: the sum above threshold."""
        return float(self.values.sum())

    @property
    def raw_total(self) -> float:
        """Sum of all capacities as measured, chance included."""
        return float(self.raw.sum())

    @property
    def corrected_total(self) -> float:
        """Sum of all capacities without what chance adds on average."""
        return float(self.corrected.sum())

    @property
    def linear(self) -> float:
        """Sum above threshold over degree 1, delay 0 included."""
        return self._sum(self.degrees == 1)

    @property
    def nonlinear(self) -> float:
        """Sum above threshold over degrees from 2 on."""
        return self._sum(self.degrees > 1)

    @property
    def memory_capacity(self) -> float:
        """Jaeger's memory capacity: sum above threshold over degree 1 and delays from 1 on.

        The present input, delay 0, is not memory (Jaeger 2002, GMD report 152).
        """
        return self._sum((self.degrees == 1) & (self.delays >= 1))

    def by_degree(self) -> dict[int, float]:
        """Return the sum above threshold for each total degree."""
        return {int(d): self._sum(self.degrees == d) for d in np.unique(self.degrees)}

    def profile(self) -> Profile:
        """Return the sum above threshold by total degree and largest delay."""
        degrees, row = np.unique(self.degrees, return_inverse=True)
        delays, column = np.unique(self.delays, return_inverse=True)
        values = np.zeros((len(degrees), len(delays)))
        np.add.at(values, (row, column), self.values)
        return Profile(degrees, delays, values)

    def sums(self) -> dict[str, float]:
        """Return every sum by name, as the benchmark stores them."""
        linear = self.degrees == 1
        past = linear & (self.delays >= 1)
        return {
            "ipc_total": self.total,
            "ipc_total_raw": self.raw_total,
            "ipc_total_corrected": self.corrected_total,
            "mc_linear": self.linear,
            "mc_linear_raw": float(self.raw[linear].sum()),
            "mc_linear_corrected": float(self.corrected[linear].sum()),
            "mc_jaeger": self.memory_capacity,
            "mc_jaeger_raw": float(self.raw[past].sum()),
            "mc_jaeger_corrected": float(self.corrected[past].sum()),
            "mc_nonlinear": self.nonlinear,
            "mc_nonlinear_raw": float(self.raw[self.degrees > 1].sum()),
            "mc_nonlinear_corrected": float(self.corrected[self.degrees > 1].sum()),
        }

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain values, ready for JSON."""
        profile = self.profile()
        return {
            **self.sums(),
            "by_degree": {str(degree): value for degree, value in self.by_degree().items()},
            "rank": self.rank,
            "n_rows": self.n_rows,
            "n_targets": len(self.terms),
            "n_significant": self.n_significant,
            "estimator": self.estimator,
            "orthonormal": self.orthonormal,
            "terms": [
                {
                    "label": label,
                    "factors": [list(factor) for factor in self.terms.factors(k)],
                    "capacity": float(self.raw[k]),
                    "threshold": float(self.thresholds[k]),
                    "significant": bool(self.raw[k] > self.thresholds[k]),
                }
                for k, label in enumerate(self.terms.labels())
            ],
            "profile": {
                "degrees": profile.degrees.tolist(),
                "delays": profile.delays.tolist(),
                "values": profile.values.tolist(),
            },
            "metadata": dict(self.metadata),
            "warnings": list(self.warnings),
        }

    def _sum(self, chosen: NDArray[np.bool_]) -> float:
        return float(self.values[chosen].sum())
