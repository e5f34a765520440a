"""Recordings that are spread over several files, as PyElastica's `ExportCallBack` leaves them.

The parts are called ``NAME_00.npz``, ``NAME_01.npz``, ... and follow each other in time. Two
files of that pattern may also be two runs; their clocks tell.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.errors import IncompleteFile, SchemaError, UnreadableFile
from openprc_pyelastica.containers import Entries
from openprc_pyelastica.grouping import split_key

_CHUNK = re.compile(r"(?P<stem>.+)_(?P<number>\d{2,})\.(?P<suffix>npz|pkl|pickle|dat)\Z", re.I)

#: A pause at a seam longer than this many sample intervals is a hole in the record.
MAX_PAUSE = 1.5


@dataclass(frozen=True)
class ChunkSet:
    """The numbered parts of one record, in order."""

    stem: str
    numbers: tuple[int, ...]
    paths: tuple[Path, ...]
    empty: tuple[int, ...] = ()

    @property
    def missing(self) -> tuple[int, ...]:
        """Numbers that are skipped between the first and the last part."""
        present = {*self.numbers, *self.empty}
        return tuple(n for n in range(self.numbers[0], self.numbers[-1]) if n not in present)


def in_folder(folder: Path) -> list[ChunkSet]:
    """Return the chunk sets of a folder, sorted by name.

    Raises
    ------
    UnreadableFile
        Two files claim the same number of one record.
    """
    found: dict[tuple[str, str], dict[int, Path]] = {}
    for path in sorted(folder.iterdir()):
        match = _CHUNK.match(path.name)
        if match is None or not path.is_file():
            continue
        parts = found.setdefault((match["stem"], match["suffix"].lower()), {})
        number = int(match["number"])
        if number in parts:
            raise UnreadableFile(
                f"{parts[number].name} and {path.name} are the same part twice",
                expected="one file for each number",
                fix="move one of them away",
                file=folder,
            )
        parts[number] = path
    return [
        ChunkSet(stem, tuple(sorted(parts)), tuple(parts[n] for n in sorted(parts)))
        for (stem, _), parts in sorted(found.items())
    ]


def of_file(path: Path) -> ChunkSet | None:
    """Return the chunk set that `path` is a part of, None when its name is not numbered."""
    if not _CHUNK.match(path.name):
        return None
    return next((chunks for chunks in in_folder(path.parent) if path in chunks.paths), None)


def without_empty(
    parts: ChunkSet, contents: Sequence[Entries]
) -> tuple[ChunkSet, list[Entries], list[str]]:
    """Leave out the parts into which no sample fell, and say so; one part always remains.

    `ExportCallBack` writes such files when its interval is shorter than the pause between
    two samples.
    """
    kept = [place for place, entries in enumerate(contents) if entries] or [0]
    left_out = len(contents) - len(kept)
    if not left_out:
        return parts, list(contents), []
    whole = ChunkSet(
        parts.stem,
        tuple(parts.numbers[place] for place in kept),
        tuple(parts.paths[place] for place in kept),
        tuple(number for place, number in enumerate(parts.numbers) if place not in kept),
    )
    note = f"{left_out} of {len(contents)} parts of {parts.stem} hold no sample"
    return whole, [contents[place] for place in kept], [note]


def clock(entries: Mapping[str, NDArray[np.generic]]) -> NDArray[np.float64] | None:
    """Return the first time axis among `entries`, None when there is none."""
    for key, array in entries.items():
        if split_key(key)[1] == "time" and array.ndim == 1 and array.size:
            return array.astype(np.float64)
    return None


def are_separate_runs(first: Entries, second: Entries) -> bool:
    """Tell whether two numbered files start at the same time or hold different things."""
    one, two = clock(first), clock(second)
    return one is None or two is None or set(first) != set(second) or bool(one[0] == two[0])


def join(parts: Sequence[Entries], chunks: ChunkSet, *, gaps: str) -> tuple[Entries, list[str]]:
    """Concatenate the parts of one record.

    Parameters
    ----------
    parts : sequence of entries
        What each file of `chunks` holds.
    chunks : ChunkSet
    gaps : {"error", "keep"}
        Whether a missing part or a pause at a seam is refused or only noted.

    Returns
    -------
    entries, notes

    Raises
    ------
    IncompleteFile
        A part is missing, unless `gaps` is ``"keep"``.
    SchemaError
        Parts that overlap in time and disagree, or that hold different keys.
    """
    notes: list[str] = []
    folder = chunks.paths[0].parent
    if chunks.missing:
        lost = ", ".join(f"{chunks.stem}_{number:02d}" for number in chunks.missing)
        _gap(f"the parts {lost} are missing", folder, gaps, notes)
    if chunks.numbers[0] != 0:
        notes.append(f"the numbering of {chunks.stem} starts at {chunks.numbers[0]}, not at 0")
    whole = parts[0]
    for path, part in zip(chunks.paths[1:], parts[1:], strict=True):
        if set(part) != set(whole):
            raise SchemaError(
                f"it holds {sorted(part)}, the parts before it {sorted(whole)}",
                expected="the same keys in every part",
                fix="import the parts one by one from folders of their own",
                file=path,
            )
        part = _without_overlap(whole, part, path, notes)
        _check_pause(whole, part, path, gaps, notes)
        whole = _append(whole, part, path)
    if len(parts) > 1:
        notes.append(f"joined {len(parts)} parts of {chunks.stem}")
    return whole, notes


def _without_overlap(whole: Entries, part: Entries, path: Path, notes: list[str]) -> Entries:
    before, after = clock(whole), clock(part)
    if before is None or after is None:
        return part
    common = int(np.count_nonzero(after <= before[-1]))
    if not common:
        return part
    where = np.searchsorted(before, after[:common])
    agrees = bool(np.all(after[:common] <= before[-1])) and bool(
        np.array_equal(before[np.minimum(where, len(before) - 1)], after[:common])
    )
    for key, array in part.items():
        if agrees and len(array) == len(after) and len(whole[key]) == len(before):
            agrees = np.array_equal(whole[key][where], array[:common], equal_nan=True)
    if not agrees:
        raise SchemaError(
            f"it begins at t = {after[0]:.6g} s, before the end of the part before it at "
            f"t = {before[-1]:.6g} s, and the two disagree there",
            expected="parts that follow each other, or repeat the same samples",
            fix="these are parts of different runs: keep each run in a folder of its own",
            file=path,
        )
    notes.append(f"{path.name} repeats the last {common} samples of the part before it: dropped")
    return {
        key: array[common:] if array.ndim and len(array) == len(after) else array
        for key, array in part.items()
    }


def _check_pause(whole: Entries, part: Entries, path: Path, gaps: str, notes: list[str]) -> None:
    before, after = clock(whole), clock(part)
    if before is None or after is None or len(before) < 3:
        return
    interval = float(np.median(np.diff(before)))
    pause = float(after[0] - before[-1])
    if pause > MAX_PAUSE * interval:
        _gap(
            f"{path.name} begins {pause:.4g} s after the end of the part before it, "
            f"with samples {interval:.4g} s apart",
            path.parent,
            gaps,
            notes,
        )


def _gap(found: str, folder: Path, gaps: str, notes: list[str]) -> None:
    if gaps != "keep":
        raise IncompleteFile(
            found,
            expected="parts without holes between them",
            fix="find the missing part, or say gaps=keep to import with a hole in time",
            file=folder,
            key="gaps",
        )
    notes.append(found)


def _append(whole: Entries, part: Entries, path: Path) -> Entries:
    joined: Entries = {}
    after = clock(part)
    for key, array in whole.items():
        other = part[key]
        same = array.shape[1:] == other.shape[1:] and array.ndim == other.ndim > 0
        if same and (after is None or len(other) == len(after)):
            joined[key] = np.concatenate([array, other])
        elif np.array_equal(array, other):
            joined[key] = array
        else:
            raise SchemaError(
                f"shape {other.shape} does not continue shape {array.shape} of the parts before",
                expected="the same rod in every part",
                fix="keep each run in a folder of its own",
                file=path,
                key=key,
            )
    return joined
