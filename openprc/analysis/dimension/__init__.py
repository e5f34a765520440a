"""Dimension of the states: spectra and ranks, kernel quality, separation of inputs."""

from openprc.analysis.dimension.rank_tests import (
    KernelQuality,
    MatrixRank,
    final_states,
    kernel_quality,
    kernel_rank,
)
from openprc.analysis.dimension.recorded_kernel_quality import (
    RecordedRank,
    recorded_generalisation_rank,
    recorded_kernel_rank,
)
from openprc.analysis.dimension.separation import (
    SeparationRatio,
    class_separation,
    separation_profile,
    separation_ratio,
)
from openprc.analysis.dimension.spectra import (
    ExplainedVariance,
    StateSpectrum,
    condition_number,
    constant_columns,
    effective_rank,
    explained_variance,
    numerical_rank,
    participation_ratio,
    state_spectrum,
)

__all__ = [
    "ExplainedVariance",
    "KernelQuality",
    "MatrixRank",
    "RecordedRank",
    "SeparationRatio",
    "StateSpectrum",
    "class_separation",
    "condition_number",
    "constant_columns",
    "effective_rank",
    "explained_variance",
    "final_states",
    "kernel_quality",
    "kernel_rank",
    "numerical_rank",
    "participation_ratio",
    "recorded_generalisation_rank",
    "recorded_kernel_rank",
    "separation_profile",
    "separation_ratio",
    "state_spectrum",
]
