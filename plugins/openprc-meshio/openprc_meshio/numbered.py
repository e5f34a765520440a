"""Which files make up a series: those that a PVD file lists, or those that are numbered."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, NotATrajectory, UnreadableFile
from openprc.schema import safety
from openprc_meshio import safe_xml

_NUMBER = re.compile(r"(\d+)(?!.*\d)")


@dataclass(frozen=True)
class Listing:
    """Files in order, and what their list or their names say about time.

    Attributes
    ----------
    files : tuple of Path
    times : (T,) or None
        From a list.
    numbers : (T,) or None
        From the names.
    """

    files: tuple[Path, ...]
    times: NDArray[np.float64] | None = None
    numbers: NDArray[np.int64] | None = None


def family(path: Path, suffixes: tuple[str, ...]) -> list[tuple[int, Path]]:
    """Return the numbered files that `path` belongs to, or the only family of a folder.

    A family shares its ending and the text around the last number of the name.

    Raises
    ------
    ConfigError
        When a folder holds several, or two files of one have the same number.
    """
    folder = path if path.is_dir() else path.parent
    groups: dict[tuple[str, str, str], list[tuple[int, Path]]] = {}
    for file in sorted(folder.iterdir()):
        found = _NUMBER.search(file.stem)
        if file.suffix.lower() in suffixes and found and file.is_file():
            around = (file.stem[: found.start()], file.stem[found.end() :], file.suffix)
            groups.setdefault(around, []).append((int(found[1]), file))
    if path.is_dir():
        several = [group for group in groups.values() if len(group) > 1]
        if len(several) > 1:
            raise ConfigError(
                f"{len(several)} series: " + ", ".join(min(group)[1].name for group in several),
                expected="one series in a folder",
                fix="name the first file of the series instead of the folder",
                file=path,
            )
        members = several[0] if several else []
    else:
        members = next((g for g in groups.values() if path in [file for _, file in g]), [])
    members = sorted(members)
    for (number, file), (other, twin) in pairwise(members):
        if number == other:
            raise ConfigError(
                f"{file.name} and {twin.name} have the same number",
                expected="one file a number",
                fix="rename or remove one of them",
                file=path,
            )
    return members


def numbered(path: Path, suffixes: tuple[str, ...]) -> Listing:
    """Return the series of numbered files that `path` belongs to.

    Raises
    ------
    NotATrajectory
        When there is one file only.
    """
    members = family(path, suffixes)
    if len(members) < 2:
        what = "no series of numbered mesh files" if path.is_dir() else "a single mesh"
        raise NotATrajectory(
            f"{what}: one instant, and no motion",
            expected="a time series: XDMF, PVD, or files that differ in a number, such as "
            "body_0000.vtu and body_0001.vtu",
            fix="write one file a step, and name the first of them or their folder",
            file=path,
        )
    return Listing(
        tuple(file for _, file in members),
        numbers=np.array([number for number, _ in members], dtype=np.int64),
    )


def listed(path: Path) -> Listing:
    """Return the series that a PVD file lists.

    Raises
    ------
    UnreadableFile, UnsafeFile
        When it is damaged, or names files elsewhere.
    NotATrajectory
        When it lists one instant only.
    """
    root = safe_xml.parse(path)
    collection = root.find("Collection")
    if root.tag != "VTKFile" or collection is None:
        raise _wrong(path, f"the root element is {root.tag!r}", "a VTKFile with a Collection")
    items = collection.findall("DataSet")
    return _ordered(path, [(item.get("timestep", ""), item.get("file", "")) for item in items])


def listed_in_json(path: Path) -> Listing:
    """Return the series that a ``.series`` file of ParaView lists.

    Raises
    ------
    UnreadableFile, UnsafeFile, NotATrajectory
        As `listed`.
    """
    safety.check_readable(path)
    try:
        files = json.loads(path.read_bytes())["files"]
        rows = [(str(item["time"]), str(item["name"])) for item in files]
    except (ValueError, LookupError, TypeError, RecursionError) as error:
        raise _wrong(
            path, f"no list of files: {type(error).__name__} {error}", "files with name and time"
        ) from None
    return _ordered(path, rows)


def _ordered(path: Path, found: list[tuple[str, str]]) -> Listing:
    """Return files in order of time; `found` are times and names."""
    rows: list[tuple[float, Path]] = []
    for number, (text, name) in enumerate(found):
        try:
            time = float(text)
        except ValueError:
            time = math.nan
        if not math.isfinite(time):
            raise _wrong(path, f"data set {number} is at time {text!r}", "a number")
        rows.append((time, safe_xml.inside(name, of=path)))
    rows.sort(key=lambda row: row[0])
    for (time, file), (later, other) in pairwise(rows):
        if not later > time:
            raise _wrong(
                path,
                f"{file.name} and {other.name} are both at time {time:g}",
                "one file an instant; the parts of a partitioned mesh cannot be joined",
            )
    if len(rows) < 2:
        raise NotATrajectory(
            f"it lists {len(rows)} files: no motion",
            expected="a file for every step",
            fix="write more than one step",
            file=path,
        )
    return Listing(tuple(file for _, file in rows), np.array([time for time, _ in rows]))


def _wrong(path: Path, found: str, expected: str) -> UnreadableFile:
    return UnreadableFile(
        found, expected=expected, fix="export the series again", file=path, key="DataSet"
    )
