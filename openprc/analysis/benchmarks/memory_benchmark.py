"""The memory benchmark: which functions of its past input the body holds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.benchmarks.base import Benchmark, Evaluated, Score
from openprc.analysis.capacity.capacities import Capacities, Estimator
from openprc.analysis.capacity.measurement import measure
from openprc.analysis.capacity.settings import Settings
from openprc.analysis.capacity.terms import Terms
from openprc.analysis.dimension.spectra import state_spectrum
from openprc.errors import TaskError
from openprc.reservoir.training.trainer import Trainer


class MemoryBenchmark(Benchmark):
    """Measure memory capacity and information processing capacity.

    Parameters
    ----------
    group_name : str
        Group of metrics.h5 that the score is written to.

    Notes
    -----
    Metrics, each sum above threshold, with ``_raw`` as measured and with ``_corrected`` without
    what chance adds on average: ``ipc_total``; ``mc_linear`` (degree 1, the present input
    included, as in the paper); ``mc_jaeger`` (degree 1, delays from 1 on); ``mc_nonlinear``.
    ``rank`` is the upper bound of the total; ``effective_rank`` is that of the eigenvalues of
    the correlation matrix and ``effective_rank_singular`` that of the singular values.

    One entry per target: ``capacities`` as measured, ``threshold``, ``degrees`` and ``delays``
    (total degree, largest delay), ``factor_degrees``, ``factor_delays`` and ``factor_inputs``
    (0 degree: no factor), ``labels``. ``profile`` is the sum above threshold by
    ``profile_degrees`` and ``profile_delays``.
    """

    multi_input = True

    def __init__(self, group_name: str = "memory_benchmark") -> None:
        super().__init__(group_name)

    def run(
        self,
        trainer: Trainer,
        u_input: ArrayLike | None = None,
        *,
        tau_s: int = 30,
        n_s: int = 2,
        k_delay: int = 1,
        eps: float | None = None,
        ridge: float = 1e-6,
        delays: Mapping[int, int] | None = None,
        estimator: Estimator | None = None,
        **choices: Any,
    ) -> Score:
        """Measure on the training and test rows of the trainer.

        Parameters
        ----------
        u_input : (n,) or (n, C)
            See `Benchmark.run` for its clock.
        tau_s : int
            Largest delay, in steps, of every degree.
        n_s : int
            Largest total degree.
        k_delay : int [rows]
            Step between delays. On a clock of symbols it is a number of symbols, and 1.
        eps : float, optional
            Threshold that is used as it is. It belongs to held-out capacities, so that giving
            it chooses them.
        ridge : float
            Penalty of held-out readouts, relative to the variance of a state.
        delays : mapping, optional
            Largest delay for each total degree, ``{1: 60, 2: 20}``, in place of `tau_s` and
            `n_s`.
        estimator : {"insample", "heldout"}, optional
            By default ``insample``, unless `eps` is given.
        **choices
            ``basis``, ``alpha``, ``correction``, ``null``, ``n_surrogates``,
            ``orthonormalize``, ``coloured``, ``correlated``, ``excess``, ``rank_tolerance``,
            ``dtype``, ``seed`` and ``blas_threads`` of `information_processing_capacity`.

        Raises
        ------
        TaskError
            When the input fits no clock, the file holds load steps, or as
            `information_processing_capacity`.
        """
        return super().run(
            trainer,
            u_input,
            tau_s=tau_s,
            n_s=n_s,
            k_delay=k_delay,
            eps=eps,
            ridge=ridge,
            delays=delays,
            estimator=estimator,
            **choices,
        )

    def _evaluate(
        self,
        trainer: Trainer,
        u: NDArray[np.float64],
        *,
        tau_s: int = 30,
        n_s: int = 2,
        k_delay: int = 1,
        eps: float | None = None,
        ridge: float = 1e-6,
        delays: Mapping[int, int] | None = None,
        estimator: Estimator | None = None,
        **choices: Any,
    ) -> Evaluated:
        if estimator is None:
            estimator = "insample" if eps is None else "heldout"
        if delays is None:
            _check_order(n_s)
            delays = dict.fromkeys(range(1, n_s + 1), tau_s)
        _check_choices(choices)
        settings = Settings(estimator=estimator, eps=eps, ridge=ridge, **choices)
        n_inputs = 1 if u.ndim == 1 else u.shape[1]
        terms = Terms.within(delays, n_inputs=n_inputs, delay_step=k_delay)
        states = trainer.states
        where = {"split": trainer.split, "usable": states.usable}
        found = measure(states.values, u, terms, settings=settings, **where)
        metrics = {**capacity_metrics(found), **_ranks(trainer)}
        metadata: dict[str, Any] = {
            "k_delay": k_delay,
            "delays": [f"degree {degree}: {most}" for degree, most in sorted(delays.items())],
            "threshold_used": "as given" if eps is not None else "chance",
            "row_step": trainer.rows.step,
            **found.metadata,
        }
        warnings = list(found.warnings)
        if estimator == "heldout":
            # What the same rows hold by the estimator whose chance is known exactly.
            other = Settings(**{**choices, "estimator": "insample"})
            beside = measure(states.values, u, terms, settings=other, **where)
            metrics |= {f"insample_{name}": value for name, value in beside.sums().items()}
            warnings += [text for text in beside.warnings if text not in warnings]
        if warnings:
            metadata["warnings"] = warnings
        return Evaluated(metrics, metadata)


def capacity_metrics(found: Capacities) -> dict[str, Any]:
    """Return the sums and the table of all targets, as they are stored."""
    profile = found.profile()
    return {
        **found.sums(),
        "rank": found.rank,
        "n_rows": found.n_rows,
        "n_targets": len(found.terms),
        "n_significant": found.n_significant,
        "fraction_of_rank": found.total / found.rank,
        "capacities": found.raw,
        "threshold": found.thresholds,
        "degrees": found.degrees,
        "delays": found.delays,
        "factor_degrees": found.terms.degrees,
        "factor_delays": found.terms.delays,
        "factor_inputs": found.terms.inputs,
        "labels": np.array(found.terms.labels()),
        "profile": profile.values,
        "profile_degrees": profile.degrees,
        "profile_delays": profile.delays,
    }


def _ranks(trainer: Trainer) -> dict[str, float]:
    """Return both effective ranks of the states on the rows that count."""
    train, test = trainer.split.masks(trainer.states.usable)
    spectrum = state_spectrum(trainer.states.values[np.concatenate([train, test])])
    return {
        "effective_rank": spectrum.effective_rank(spectrum="eigenvalues"),
        "effective_rank_singular": spectrum.effective_rank(spectrum="singular"),
    }


def _check_order(n_s: int) -> None:
    if n_s < 1:
        raise TaskError(
            f"n_s is {n_s}",
            expected="a largest total degree of at least 1",
            fix="correct it",
            key="n_s",
        )


def _check_choices(choices: Mapping[str, Any]) -> None:
    own = {"estimator", "eps", "ridge"}
    known = [name for name in Settings.__dataclass_fields__ if name not in own]
    wrong = sorted(set(choices) - set(known))
    if wrong:
        raise TaskError(
            f"the memory benchmark has no parameter {', '.join(map(repr, wrong))}",
            expected="tau_s, n_s, k_delay, eps, ridge, delays, estimator, " + ", ".join(known),
            fix="correct the name",
            key=wrong[0],
        )
