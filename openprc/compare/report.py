"""Everything that a comparison found: the record that tables, pages and JSON are made from."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.compare.runs.producers import COST_TEXT
from openprc.schema.atomic import atomic_file

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.compare.chaos.judgement import Divergence
    from openprc.compare.chaos.twins import TwinStudy
    from openprc.compare.comparison import Comparison, PairComparison
    from openprc.compare.runs.producers import ProducerRun
    from openprc.compare.task_scores import TaskScores
    from openprc.scenes.physics import Physics

    Reals = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ProbeResult:
    """What a run gives for a number that is known.

    Parameters
    ----------
    name, unit : str
    expected : float
    measured : float or None
        None where it could not be measured; `reason` says why.
    deviation : float or None
        Relative to `expected`; absolute where that is 0.
    tolerance : float
        What the deviation of a run with the settings of the scene stays within.
    reason : str
    """

    name: str
    unit: str
    expected: float
    measured: float | None
    deviation: float | None
    tolerance: float
    reason: str = ""

    @property
    def within(self) -> bool | None:
        """Whether the deviation is within the tolerance; None where there is none."""
        return None if self.deviation is None else abs(self.deviation) <= self.tolerance

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        return {
            "name": self.name,
            "unit": self.unit,
            "expected": self.expected,
            "measured": self.measured,
            "deviation": self.deviation,
            "tolerance": self.tolerance,
            "within": self.within,
            "reason": self.reason,
        }


@dataclass(frozen=True, kw_only=True)
class Report:
    """A comparison of runs.

    Parameters
    ----------
    title : str
        The scene, the experiment, or the files.
    what : str
        A sentence about the reference.
    scale : float or None [`unit`]
        Of the motion; what 1 % is meant of.
    reference : str
        Name of the run that the others are compared with.
    files : mapping of str to Path
        Names of runs, the reference first, to files; in the order of the table.
    runs : tuple of ProducerRun
        Empty where files were given.
    physics : tuple of Physics
        What the experiment uses; empty where files were given.
    comparison : Comparison or None
        None where there is nothing to compare the only run with.
    divergences : mapping of str to Divergence
        Of every run that is compared.
    probes : mapping of str to tuple of ProbeResult
    scores : mapping of str to TaskScores
    energies : mapping of str to (K,) [s] and (K,) [J]
        Times, and the total energy less that of the first frame, of runs that recorded it.
    twins : TwinStudy or None
    notes : tuple of str
    """

    title: str
    what: str
    scale: float | None
    reference: str
    files: Mapping[str, Path]
    runs: tuple[ProducerRun, ...] = ()
    physics: tuple[Physics, ...] = ()
    comparison: Comparison | None = None
    divergences: Mapping[str, Divergence] = field(default_factory=dict)
    probes: Mapping[str, tuple[ProbeResult, ...]] = field(default_factory=dict)
    scores: Mapping[str, TaskScores] = field(default_factory=dict)
    energies: Mapping[str, tuple[Reals, Reals]] = field(default_factory=dict)
    twins: TwinStudy | None = None
    notes: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """All runs, also those that there are none of, in the order of the table."""
        asked = [run.name for run in self.runs]
        return (*(name for name in self.files if name not in asked), *asked)

    @property
    def unit(self) -> str:
        """Of all lengths that the comparison found: "m", or what the files agree on."""
        pairs = () if self.comparison is None else self.comparison.pairs
        return pairs[0].unit if pairs else "m"

    def run(self, name: str) -> ProducerRun | None:
        """Return what became of a request."""
        return next((run for run in self.runs if run.name == name), None)

    def pair(self, name: str) -> PairComparison | None:
        """Return how a run compares with the reference."""
        if self.comparison is None:
            return None
        compared = [other for other in self.files if other != self.reference]
        found = dict(zip(compared, self.comparison.pairs, strict=True))
        return found.get(name)

    def remarks(self, name: str) -> tuple[str, ...]:
        """Return what a reader of a run's figures should know: nodes, clocks, drives."""
        pair = self.pair(name)
        if pair is None:
            return ()
        # Runs of one experiment had one drive, whether or not their files can say so.
        one_drive = bool(self.runs) and pair.drive.verdict == "missing"
        said = [note for note in pair.notes if not (one_drive and pair.drive.text in note)]
        if pair.unmatched:
            said.insert(0, f"{len(pair.unmatched)} nodes of the reference are not in it")
        if pair.interpolant != "none":
            said.append(f"the {pair.interpolated} was read between its frames ({pair.interpolant})")
        return tuple(said)

    @property
    def score_differences(self) -> dict[str, dict[str, float]]:
        """Figures of the tasks of every run less those of the first run that has them."""
        first = next((name for name, scores in self.scores.items() if scores.figures), None)
        if first is None:
            return {}
        against = self.scores[first].figures
        return {
            name: {
                key: value - against[key] for key, value in scores.figures.items() if key in against
            }
            for name, scores in self.scores.items()
            if name != first and scores.figures
        }

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON; numbers that are not finite are None."""
        told: dict[str, Any] = {
            "title": self.title,
            "what": self.what,
            "scale": self.scale,
            "unit": self.unit,
            "reference": self.reference,
            "files": {name: path.name for name, path in self.files.items()},
            "cost": COST_TEXT if self.runs else None,
            "producers": [run.as_dict() for run in self.runs],
            "physics": [item.as_dict() for item in self.physics],
            "comparison": None if self.comparison is None else self.comparison.as_dict(),
            "remarks": {name: self.remarks(name) for name in self.files},
            "divergences": {name: one.as_dict() for name, one in self.divergences.items()},
            "probes": {name: [one.as_dict() for one in row] for name, row in self.probes.items()},
            "scores": {name: one.as_dict() for name, one in self.scores.items()},
            "score_differences": self.score_differences,
            "energies": {
                name: {"times_s": times, "energy_J": energy}
                for name, (times, energy) in self.energies.items()
            },
            "twins": None if self.twins is None else self.twins.as_dict(),
            "notes": list(self.notes),
        }
        plain: dict[str, Any] = _plain(told)
        return plain

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write the record as JSON, whole or not at all.

        Raises
        ------
        ResultExists
            When there is such a file and `overwrite` is false.
        """
        target = Path(path)
        with atomic_file(target, overwrite=overwrite) as draft:
            draft.write_text(
                json.dumps(self.as_dict(), indent=2, allow_nan=False) + "\n", encoding="utf-8"
            )
        return target


def _plain(value: Any) -> Any:
    """Return what JSON has: lists, and None for numbers that are not finite."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


__all__ = ["ProbeResult", "Report"]
