"""`PairComparison`: all that was found about one file beside the reference."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from openprc.compare.alignment.interpolation_error import InterpolationError
    from openprc.compare.alignment.node_matching import NodeMatch
    from openprc.compare.alignment.rigid_motion import RigidMotion
    from openprc.compare.alignment.time_shift import TimeShift
    from openprc.compare.deviations.drives import DriveComparison
    from openprc.compare.deviations.element_errors import ElementError
    from openprc.compare.deviations.energies import PairEnergies
    from openprc.compare.deviations.error_norms import ErrorNorms
    from openprc.compare.deviations.example_traces import Trace
    from openprc.compare.deviations.spectra import Spectra

    Reals = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class PairComparison:
    """One file beside the reference.

    Parameters
    ----------
    name : str
    path : Path
    producer : str
        Who made the file.
    unit : str
        Of all lengths: "m" where both files are in lengths.
    time_unit : str
    clock : str
        What frames were matched by.
    match : NodeMatch
    n_samples : int
        Instants that were compared.
    first_time, last_time : float [time_unit]
    interpolation : InterpolationError or None
        None where no frame had to be interpolated.
    interpolated : str
        "" , "reference" or "other": which file was interpolated.
    transform : RigidMotion or None
    shift : TimeShift or None
    errors : ErrorNorms
    largest_time : float [time_unit]
    times : (K,) [time_unit]
        Middles of the bins over time.
    velocity_errors : ErrorNorms or None [unit per time_unit]
    elements : tuple of ElementError
    spectra : Spectra or None
    energy : PairEnergies or None
    drive : DriveComparison
    traces : tuple of Trace
        The node of the largest deviation.
    notes : tuple of str
        What a reader of the figures should know.
    """

    name: str
    path: Path
    producer: str
    unit: str
    time_unit: str
    clock: str
    match: NodeMatch
    n_samples: int
    first_time: float
    last_time: float
    interpolation: InterpolationError | None
    interpolated: str
    transform: RigidMotion | None
    shift: TimeShift | None
    errors: ErrorNorms
    largest_time: float
    times: Reals
    velocity_errors: ErrorNorms | None
    elements: tuple[ElementError, ...]
    spectra: Spectra | None
    energy: PairEnergies | None
    drive: DriveComparison
    traces: tuple[Trace, ...]
    notes: tuple[str, ...]

    @property
    def n_nodes(self) -> int:
        """Number of matched nodes."""
        return len(self.match.labels)

    @property
    def unmatched(self) -> tuple[str, ...]:
        """Nodes of the reference that the other file does not have."""
        return self.match.unmatched_reference

    @property
    def matched_by(self) -> str:
        """How nodes found each other: label, index, assignment or pairs."""
        return self.match.by

    @property
    def interpolant(self) -> str:
        """How one file was interpolated; "none" where frames agree."""
        return "none" if self.interpolation is None else self.interpolation.interpolant

    @property
    def rms(self) -> float:
        """Root of the mean squared distance between counterparts [unit]."""
        return self.errors.rms

    @property
    def largest(self) -> float:
        """Largest distance between counterparts [unit]."""
        return self.errors.largest

    @property
    def largest_at(self) -> tuple[str, float]:
        """Node and time of the largest distance."""
        return self.match.labels[self.errors.largest_node], self.largest_time

    @property
    def relative_rms(self) -> float | None:
        """`rms` over the rms displacement of the reference; None where it does not move."""
        moved = self.errors.displacement
        return self.errors.rms / moved if moved > 0 else None

    @property
    def relative_largest_frame(self) -> float | None:
        """Largest rms of an instant over the rms displacement of the reference."""
        moved = self.errors.displacement
        return self.errors.largest_frame_rms / moved if moved > 0 else None

    @property
    def node_labels(self) -> tuple[str, ...]:
        """Matched nodes, as the reference calls them."""
        return self.match.labels

    @property
    def node_rms(self) -> Reals:
        """Root of the mean squared distance by node: (n,) [unit]."""
        return self.errors.node_rms

    @property
    def node_max(self) -> Reals:
        """Largest distance by node: (n,) [unit]."""
        return self.errors.node_max

    @property
    def rms_over_time(self) -> Reals:
        """By bin: (K,) [unit]."""
        return self.errors.rms_over_time

    @property
    def max_over_time(self) -> Reals:
        """By bin: (K,) [unit]."""
        return self.errors.max_over_time

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON output."""
        errors = self.errors
        return {
            "name": self.name,
            "path": str(self.path),
            "producer": self.producer,
            "unit": self.unit,
            "time_unit": self.time_unit,
            "clock": self.clock,
            "n_nodes": self.n_nodes,
            "matching": self.match.as_dict(),
            "n_samples": self.n_samples,
            "first_time": self.first_time,
            "last_time": self.last_time,
            "interpolant": self.interpolant,
            "interpolated": self.interpolated,
            "interpolation": _plain(self.interpolation),
            "transform": _plain(self.transform),
            "shift": _plain(self.shift),
            "rms": self.rms,
            "largest": self.largest,
            "largest_at": {"node": self.largest_at[0], "time": self.largest_at[1]},
            "relative_rms": self.relative_rms,
            "largest_frame_rms": errors.largest_frame_rms,
            "relative_largest_frame": self.relative_largest_frame,
            "displacement": errors.displacement,
            "n_compared": errors.n_compared,
            "n_missing": errors.n_missing,
            "node_labels": list(self.node_labels),
            "node_rms": self.node_rms.tolist(),
            "node_max": self.node_max.tolist(),
            "times": self.times.tolist(),
            "rms_over_time": self.rms_over_time.tolist(),
            "max_over_time": self.max_over_time.tolist(),
            "displacement_over_time": errors.displacement_over_time.tolist(),
            "velocity_rms": None if self.velocity_errors is None else self.velocity_errors.rms,
            "velocity_largest": (
                None if self.velocity_errors is None else self.velocity_errors.largest
            ),
            "elements": [item.as_dict() for item in self.elements],
            "spectra": _plain(self.spectra),
            "energy": _plain(self.energy),
            "drive": self.drive.as_dict(),
            "traces": [trace.as_dict() for trace in self.traces],
            "notes": list(self.notes),
        }


def _plain(record: Any) -> dict[str, Any] | None:
    return None if record is None else record.as_dict()


__all__ = ["PairComparison"]
