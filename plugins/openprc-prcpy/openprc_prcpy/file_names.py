"""Which files of a folder belong to the experiment, in which order, and with which input."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, MissingData, UnreadableFile

_DIGITS = re.compile(r"([0-9]+)")
#: A suffix begins with a letter, so that the decimals of ``scan_1_62.923mT`` are none.
_SUFFIX = re.compile(r"\.[A-Za-z][A-Za-z0-9]{0,4}\Z")
_BACKGROUND = re.compile(r"(?:\A|[^a-z])(?:bg|bkg|background)(?![a-z])", re.IGNORECASE)
_INDEX = re.compile(r"[_\-. ]*([0-9]+)")
_VALUE = re.compile(
    r"[_ ](?P<value>[-+]?[0-9]+(?:[._][0-9]+)?)(?P<unit>[A-Za-zµμΩ%°]+)?(?=\Z|[_ .\-])"
)
_STEM = re.compile(r"(?P<stem>[A-Za-z][A-Za-z_\- ]*?)[_\-. ]*[0-9]")
_SPELLINGS = {"Ohm": "ohm", "Ω": "ohm", "µs": "us", "μs": "us", "sec": "s"}


@dataclass(frozen=True)
class ScanName:
    """What a file name says: number of the scan, input value and its unit, and the remainder."""

    name: str
    index: int | None = None
    value: float | None = None
    unit: str | None = None
    rest: str = ""


@dataclass(frozen=True)
class Selection:
    """The files of an experiment in their order, and those that were left out with the reason."""

    files: tuple[ScanName, ...]
    left_out: tuple[tuple[str, str], ...]

    def remark(self) -> str | None:
        """Return which files were left out, in one sentence."""
        if not self.left_out:
            return None
        shown = "; ".join(f"{name} ({why})" for name, why in self.left_out[:8])
        more = f"; and {len(self.left_out) - 8} more" if len(self.left_out) > 8 else ""
        return f"left out: {shown}{more}"


def natural_key(name: str) -> list[str | int]:
    """Return a key that sorts ``scan_10`` after ``scan_9``."""
    # Text and numbers alternate, so that like is compared with like.
    return [int(p) if i % 2 else p.lower() for i, p in enumerate(_DIGITS.split(name))]


def stem_of(name: str) -> str:
    """Return a file name without its suffix."""
    return _SUFFIX.sub("", name)


def parse_name(name: str, prefix: str) -> ScanName:
    """Read ``<prefix>_<scan>_<value><unit>``, in which ``_`` may stand for the decimal point.

    ``scan_1_62_923mT.txt`` is scan 1 at 62.923 mT and ``scan_100_-12_53mA_0_to_-140mT.txt`` scan
    100 at -12.53 mA. Numbers without a unit are a value only when nothing follows them; a date
    would pass for one otherwise.
    """
    tail = stem_of(name)[len(prefix) :]
    index = _INDEX.match(tail)
    if index is None:
        return ScanName(name, rest=tail)
    rest = tail[index.end() :]
    found = _VALUE.match(rest)
    if found is None or (found["unit"] is None and found.end() < len(rest)):
        return ScanName(name, index=int(index[1]), rest=rest)
    unit = found["unit"]
    return ScanName(
        name,
        index=int(index[1]),
        value=float(found["value"].replace("_", ".")),
        unit=_SPELLINGS.get(unit, unit) if unit else None,
        rest=rest[found.end() :],
    )


def visible_files(folder: Path) -> list[str]:
    """Return the names of the files in a folder, naturally sorted, hidden ones left out.

    Raises
    ------
    UnreadableFile
        There is no such folder, or it is a file.
    """
    if not folder.is_dir():
        raise UnreadableFile(
            "this is a file" if folder.exists() else "the folder does not exist",
            expected="the folder of an experiment, with one text file for each scan or device",
            fix="name the folder that holds the files",
            file=folder,
        )
    names = [item.name for item in folder.iterdir() if item.is_file()]
    return sorted((n for n in names if not n.startswith(".")), key=lambda n: (natural_key(n), n))


def numbered_groups(names: Iterable[str]) -> dict[str, list[str]]:
    """Return the names that go on with a number, by what comes before it."""
    groups: dict[str, list[str]] = {}
    for name in names:
        found = _STEM.match(name)
        if found and not _BACKGROUND.search(found["stem"]):
            groups.setdefault(found["stem"], []).append(name)
    return groups


def find_prefix(names: Sequence[str], *, folder: Path) -> str:
    """Return the beginning that the scans have in common.

    Raises
    ------
    ConfigError
        There is no such beginning, or there are several.
    """
    groups = {k: v for k, v in numbered_groups(names).items() if len(v) > 1}
    if len(groups) == 1:
        return next(iter(groups))
    told = ", ".join(f"{k} ({len(v)} files)" for k, v in sorted(groups.items())) or "none"
    raise ConfigError(
        f"beginnings of numbered file names: {told}",
        expected="one",
        fix="say which with the option prefix",
        file=folder,
        key="prefix",
    )


def select(folder: Path, prefix: str, *, background: str | None, transpose: bool) -> Selection:
    """Choose and order the files of an experiment.

    A name has to begin with `prefix`: to contain it, as in ``old_scan_3.txt``, is not enough.
    Scans need a number after the prefix; devices (`transpose`) need none.

    Raises
    ------
    MissingData
        No file begins with `prefix`.
    UnreadableFile
        Two files have the same number.
    """
    if not prefix:
        raise ConfigError(
            "the prefix is empty",
            expected="what the names of the scans begin with",
            fix="give it, for example 'scan'",
            file=folder,
            key="prefix",
        )
    chosen: list[ScanName] = []
    left_out: list[tuple[str, str]] = []
    for name in visible_files(folder):
        parsed = parse_name(name, prefix) if name.startswith(prefix) else None
        if background is not None and name == Path(background).name:
            left_out.append((name, "the background"))
        elif parsed is None:
            why = (
                "contains the prefix, does not begin with it" if prefix in name else "another name"
            )
            left_out.append((name, why))
        elif _BACKGROUND.search(stem_of(name)[len(prefix) :]):
            left_out.append((name, "a background by its name"))
        elif parsed.index is None and not transpose:
            left_out.append((name, "no number after the prefix"))
        else:
            chosen.append(parsed)
    if not chosen:
        shown = ", ".join(f"{name} ({why})" for name, why in left_out[:5]) or "no file"
        raise MissingData(
            f"no scan begins with {prefix!r}; the folder holds {shown}",
            expected=f"names such as {prefix}_1.txt",
            fix="correct the prefix, or name another folder",
            file=folder,
            key="prefix",
        )
    if not transpose:
        _refuse_doubles(chosen, folder)
        chosen.sort(key=lambda item: item.index or 0)
    return Selection(tuple(chosen), tuple(left_out))


def _refuse_doubles(chosen: Sequence[ScanName], folder: Path) -> None:
    seen: dict[int | None, str] = {}
    for item in chosen:
        if item.index in seen:
            raise UnreadableFile(
                f"{seen[item.index]} and {item.name} are both scan {item.index}",
                expected="one file for each scan",
                fix="remove or rename one of them; a number that is no scan number (a field, a "
                "date) must not come first",
                file=folder,
                key=item.name,
            )
        seen[item.index] = item.name


def scan_numbers(files: Sequence[ScanName], *, gaps: str, folder: Path) -> NDArray[np.int64]:
    """Return the scan numbers (T,), increasing by one; from 1 on when gaps were closed.

    Raises
    ------
    UnreadableFile
        Some are missing and `gaps` is not ``"close"``.
    """
    numbers = [item.index or 0 for item in files]
    first, last = numbers[0], numbers[-1]
    if last - first == len(numbers) - 1:
        return np.arange(first, last + 1, dtype=np.int64)
    if gaps == "close":
        return np.arange(1, len(numbers) + 1, dtype=np.int64)
    n_absent = last - first + 1 - len(numbers)
    before = next(a for a, b in pairwise(numbers) if b - a > 1)
    raise UnreadableFile(
        f"{n_absent} of the scans {first} to {last} are missing; the first is {before + 1}",
        expected="consecutive numbers: a body that skipped an input remembers another past",
        fix="add the files; if only the numbering has holes, gaps=close counts the files instead",
        file=folder,
        key="gaps",
    )


__all__ = [
    "ScanName",
    "Selection",
    "find_prefix",
    "natural_key",
    "numbered_groups",
    "parse_name",
    "scan_numbers",
    "select",
    "stem_of",
    "visible_files",
]
