"""`compare_files`: two or more trajectories of one body, beside the first of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from openprc.compare.alignment.settings import AlignmentSettings
from openprc.compare.pair_comparison import PairComparison
from openprc.compare.pairing import compare_pair
from openprc.errors import ConfigError
from openprc.hooks.running import silent
from openprc.schema.trajectory import Trajectory

if TYPE_CHECKING:
    from openprc.hooks.protocols import Progress

#: Columns of `Comparison.rows`.
COLUMNS = (
    "file", "nodes", "instants", "rms", "largest", "node", "time", "relative rms",
    "frequency", "energy drift", "drive",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Reference:
    """What the others are compared with.

    Parameters
    ----------
    name : str
    path : Path
    producer : str
    n_nodes, n_frames : int
    """

    name: str
    path: Path
    producer: str
    n_nodes: int
    n_frames: int


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Two or more files of one body.

    Parameters
    ----------
    reference : Reference
    pairs : tuple of PairComparison
        One for each other file, in the order given.
    settings : AlignmentSettings
    """

    reference: Reference
    pairs: tuple[PairComparison, ...]
    settings: AlignmentSettings

    def rows(self) -> list[tuple[Any, ...]]:
        """Return one row a pair, under `COLUMNS`; None where there is nothing to say."""
        return [
            (
                pair.name,
                pair.n_nodes,
                pair.n_samples,
                pair.rms,
                pair.largest,
                pair.largest_at[0],
                pair.largest_at[1],
                pair.relative_rms,
                None if pair.spectra is None else pair.spectra.dominant_difference,
                None
                if pair.energy is None or pair.energy.other is None
                else pair.energy.other.relative,
                pair.drive.verdict,
            )
            for pair in self.pairs
        ]

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON output."""
        reference = self.reference
        return {
            "reference": {
                "name": reference.name,
                "path": str(reference.path),
                "producer": reference.producer,
                "n_nodes": reference.n_nodes,
                "n_frames": reference.n_frames,
            },
            "settings": self.settings.as_dict(),
            "pairs": [pair.as_dict() for pair in self.pairs],
        }


def compare_files(
    reference: str | Path,
    others: Sequence[str | Path],
    *,
    settings: AlignmentSettings | None = None,
    names: Sequence[str] | None = None,
    progress: Progress = silent,
) -> Comparison:
    """Compare trajectories with a reference: nodes matched, clocks aligned, deviations summed.

    Files are read in blocks, at most twice (the second time for a rigid motion over all
    instants), so memory does not grow with the frames.

    Parameters
    ----------
    reference : path-like
    others : one or more path-like
    settings : AlignmentSettings, optional
    names : str for the reference and each other file, optional
        By default what tells their paths apart.
    progress : callable

    Raises
    ------
    ConfigError
        When nothing is given to compare, or a setting names what is not there.
    SchemaError, MissingData
        When clocks do not overlap, one counts load steps and the other time, axes or nodes do
        not match, or nothing is seen in both files.
    UnitError
        When one file is in pixels and the other in metres, and no scale was given.
    UnreadableFile, UnsafeFile, IncompleteFile
        See `Trajectory`.

    Examples
    --------
    >>> from openprc.compare.comparison import compare_files
    >>> comparison = compare_files("run.h5", ["run.h5"])
    >>> comparison.pairs[0].rms
    0.0
    """
    settings = settings or AlignmentSettings()
    paths = [Path(reference), *(Path(other) for other in others)]
    if len(paths) < 2:
        raise ConfigError(
            "there is one file",
            expected="two or more",
            fix="name the files to compare with it",
            file=paths[0],
            key="others",
        )
    called = tuple(names) if names is not None else short_names(paths)
    if len(called) != len(paths):
        raise ConfigError(
            f"{len(called)} names for {len(paths)} files",
            expected="a name for each",
            fix="correct the names",
            key="names",
        )
    pairs: list[PairComparison] = []
    with Trajectory(paths[0]) as first:
        told = Reference(
            name=called[0],
            path=paths[0],
            producer=str(first.provenance.get("producer", "")),
            n_nodes=first.n_nodes,
            n_frames=first.n_frames,
        )
        for number, path in enumerate(paths[1:]):

            def share(fraction: float, message: str, done: int = number) -> None:
                progress((done + fraction) / (len(paths) - 1), message)

            with Trajectory(path) as second:
                pairs.append(
                    compare_pair(
                        first, second, name=called[number + 1], settings=settings, progress=share
                    )
                )
    return Comparison(reference=told, pairs=tuple(pairs), settings=settings)


def short_names(paths: Sequence[Path]) -> tuple[str, ...]:
    """Return what tells paths apart: the names of files, or of the folders where they differ.

    Equal paths are numbered.
    """
    parts = [path.resolve().with_suffix("").parts for path in paths]
    depth = 1
    while depth < max(map(len, parts)):
        if len({part[-depth:] for part in parts}) == len({*parts}):
            break
        depth += 1
    # Below the folders that differ all names are the same and say nothing.
    common = 0
    while common + 1 < depth and len({part[-common - 1 :] for part in parts}) == 1:
        common += 1
    names = ["/".join(part[-depth : len(part) - common]) for part in parts]
    seen: dict[str, int] = {}
    found = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        found.append(name if names.count(name) == 1 else f"{name} ({seen[name]})")
    return tuple(found)


__all__ = ["COLUMNS", "Comparison", "Reference", "compare_files", "short_names"]
