"""Benchmarks without a task: how many directions the states have, and how they follow the input."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.analysis.benchmarks.base import Benchmark, Evaluated
from openprc.analysis.dimension.spectra import state_spectrum
from openprc.reservoir.training.trainer import Trainer

_LISTED = 5
_FEW_VALUES = 4
#: Above this absolute correlation two channels are called redundant.
REDUNDANT = 0.95
#: Rows that distance correlation is measured and tested on at most, evenly thinned: every
#: surrogate costs as much as the measurement itself.
MOST_ROWS = 4000
#: A relative cut for recordings: directions below one part in a hundred are mostly noise.
NOISE_CUT = 0.01


class DimensionBenchmark(Benchmark):
    """Rank, effective ranks, condition number and principal components of the states.

    All of the standardised states on the rows of training and test. It needs no input, and no
    physical time.
    """

    needs_dynamics = False
    needs_input = False

    def __init__(self, group_name: str = "dimension") -> None:
        super().__init__(group_name)

    def _evaluate(self, trainer: Trainer, u: NDArray[Any], **parameters: Any) -> Evaluated:
        x, names = measured_states(trainer)
        spectrum = state_spectrum(x)
        explained = spectrum.explained_variance
        metrics = {
            "n_states": len(names),
            "n_changing": spectrum.n_changing,
            "numerical_rank": spectrum.numerical_rank(),
            "rank_above_noise_cut": spectrum.numerical_rank(relative=NOISE_CUT),
            "effective_rank": spectrum.effective_rank(),
            "effective_rank_singular": spectrum.effective_rank(spectrum="singular"),
            "participation_ratio": spectrum.participation_ratio,
            "condition_number": spectrum.condition_number,
            "n_components_95": int(np.searchsorted(explained.cumulative, 0.95 - 1e-12)) + 1,
            "n_components_99": int(np.searchsorted(explained.cumulative, 0.99 - 1e-12)) + 1,
            "explained_variance_ratio": explained.ratio,
            "singular_values": spectrum.singular_values,
        }
        metadata: dict[str, Any] = {
            "n_rows": len(x),
            "states": "standardised, on the rows of training and test",
            "effective_rank_definition": "exp of the entropy of the eigenvalues of the correlation "
            "matrix; effective_rank_singular takes the singular values, Roy and Vetterli 2007",
            "noise_cut": NOISE_CUT,
        }
        warnings = []
        if spectrum.constant:
            still = [names[i] for i in spectrum.constant]
            warnings.append(f"{len(still)} states never change and were left out: {_some(still)}")
        if len(x) <= spectrum.n_changing:
            warnings.append(
                f"{len(x)} rows show no more than {len(x) - 1} directions of "
                f"{spectrum.n_changing} states: record for longer"
            )
        elif not np.isfinite(spectrum.condition_number):
            warnings.append(
                "the condition number is infinite: some states are combinations of others, "
                f"{metrics['numerical_rank']} of {spectrum.n_changing} directions are independent"
            )
        if warnings:
            metadata["warnings"] = warnings
        return Evaluated(metrics, metadata)


class InputCorrelation(Benchmark):
    """Which states follow the input, at which lag, and how far in ways a line does not show.

    Pearson's r at lag 0 and at the lag of the largest cross-correlation, distance correlation,
    and the multiple correlation of all states with the input. p-values allow for
    autocorrelation and for the number of channels.
    """

    def __init__(self, group_name: str = "input_correlation", *, n_surrogates: int = 99) -> None:
        super().__init__(group_name)
        self.n_surrogates = n_surrogates

    def _evaluate(self, trainer: Trainer, u: NDArray[Any], **parameters: Any) -> Evaluated:
        from openprc.analysis.correlation import (  # noqa: PLC0415 - compiles kernels
            Linear,
            Nonparametric,
        )

        rows = measured_rows(trainer)
        x, names = measured_states(trainer)
        linear = Linear(u[rows], x, names=names)
        thin = slice(None, None, -(-len(rows) // MOST_ROWS))
        nonlinear = Nonparametric(
            u[rows][thin], x[thin], names=names, n_surrogates=self.n_surrogates
        )
        r, peak, dcor = linear.pearson, linear.peak, nonlinear.dcor
        multiple = linear.cca(n_surrogates=self.n_surrogates)
        follows = r.significant(correction="fdr")
        hidden = dcor.significant(correction="fdr") & ~peak.significant(correction="fdr")
        metrics = {
            "n_correlated": int(np.count_nonzero(follows)),
            "n_nonlinear_only": int(np.count_nonzero(hidden)),
            "largest_r": float(np.nanmax(np.abs(r.values))),
            "multiple_r": float(np.ravel(multiple.values)[0]),
            "pearson": r.values,
            "peak_r": peak.values,
            "peak_lag": peak.lags,
            "dcor": dcor.values,
        }
        metadata: dict[str, Any] = {
            "n_rows": len(rows),
            "n_rows_dcor": len(rows[thin]),
            "states": list(names),
            "lag_unit": "rows; positive when the state comes after the input",
            "p_values": "effective sample size (Pearson), circular shifts (distance correlation); "
            "significant at 5 % after Benjamini and Hochberg",
        }
        return Evaluated(metrics, metadata)


class KernelQualityBenchmark(Benchmark):
    """How far back the states echo the input, and how many input streams they tell apart.

    The memory profile gives the echo; rows that far apart stand for independent streams, whose
    rank is the kernel rank (Legenstein and Maass 2007). The generalisation rank needs words that
    recur, and so an input of few values.
    """

    def __init__(self, group_name: str = "kernel_quality") -> None:
        super().__init__(group_name)

    def _evaluate(
        self, trainer: Trainer, u: NDArray[Any], *, max_delay: int = 60, **parameters: Any
    ) -> Evaluated:
        from openprc.analysis.capacity import memory_capacity  # noqa: PLC0415 - needs scipy
        from openprc.analysis.dimension import (  # noqa: PLC0415 - belongs to the same call
            recorded_generalisation_rank,
            recorded_kernel_rank,
        )
        from openprc.analysis.dynamics import memory_time  # noqa: PLC0415

        rows = measured_rows(trainer)
        x, _ = measured_states(trainer)
        found = memory_capacity(
            trainer.states.values,
            u,
            max_delay=min(max_delay, len(rows) // 10),
            split=trainer.split,
            usable=trainer.states.usable,
            coloured="refuse",
        )
        order = np.argsort(found.delays)
        echo = memory_time(found.values[order])
        memory = int(max(echo.last_delay, 0)) + 1
        kernel = recorded_kernel_rank(x, memory=memory)
        metrics: dict[str, Any] = {
            "echo_decay": echo.decay,
            "echo_last_delay": echo.last_delay,
            "kernel_rank": kernel.rank.numerical,
            "kernel_rank_relative": kernel.rank.relative,
            "n_streams": kernel.n_streams,
        }
        warnings = [text for text in (echo.remark, kernel.remark) if text]
        if len(np.unique(u)) <= _FEW_VALUES:
            common = parameters.get("common", 3)
            general = recorded_generalisation_rank(x, u[rows], common=common)
            metrics["generalisation_rank"] = general.rank.numerical
            metrics["generalisation_rank_relative"] = general.rank.relative
            warnings += [general.remark] if general.remark else []
        metadata: dict[str, Any] = {
            "echo_unit": "rows: delay from which on the capacity stays below 1/e of the largest, "
            "and largest delay above chance",
            "kernel_rank_definition": "rank of states a memory apart; relative: above the cut of "
            "kernel_rank. An estimate from one recording",
        }
        if warnings:
            metadata["warnings"] = warnings
        return Evaluated(metrics, metadata)


def measured_rows(trainer: Trainer) -> NDArray[np.intp]:
    """Return the rows of training and test that were measured completely, (n,)."""
    train, test = trainer.split.masks(trainer.states.usable)
    return np.concatenate([train, test])


def measured_states(trainer: Trainer) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """Return the states on `measured_rows`, (n, F), and their names."""
    return trainer.states.values[measured_rows(trainer)], trainer.states.names


def _some(names: list[str]) -> str:
    return ", ".join(names[:_LISTED]) + (", ..." if len(names) > _LISTED else "")
