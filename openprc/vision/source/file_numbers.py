"""The order of numbered image files, and which numbers are missing."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from openprc.errors import VideoError

_DIGITS = re.compile(r"(\d+)")


def natural_key(name: str) -> tuple[tuple[str, int, str], ...]:
    """Return a sort key that puts img_2 before img_10."""
    parts = _DIGITS.split(name)
    return tuple(
        (parts[i], int(parts[i + 1]) if i + 1 < len(parts) else -1, "".join(parts[i + 1 : i + 2]))
        for i in range(0, len(parts), 2)
    )


@dataclass(frozen=True)
class NumberedFiles:
    """Files in the order of their numbers.

    Attributes
    ----------
    paths : tuple of Path
    places : tuple of int
        Each file's place from 0, in units of the usual step of the numbers; a hole is a jump.
    missing : tuple of str
        The numbers that are not there.
    notes : tuple of str
    """

    paths: tuple[Path, ...]
    places: tuple[int, ...]
    missing: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def order_files(paths: Sequence[Path], *, folder: Path) -> NumberedFiles:
    """Sort numbered files of one recording.

    Raises
    ------
    VideoError
        The names belong to several sequences, or two files have the same number.
    """
    ordered = sorted(paths, key=lambda path: natural_key(path.name))
    count = len(ordered)
    if count == 1:
        return NumberedFiles(tuple(ordered), (0,))
    kinds: dict[tuple[str, ...], list[Path]] = {}
    for path in ordered:
        kinds.setdefault(tuple(_DIGITS.split(path.name)[::2]), []).append(path)
    if len(kinds) > 1:
        listed = [
            f"{'#'.join(texts)} ({len(members)})" for texts, members in list(kinds.items())[:4]
        ]
        raise VideoError(
            f"the images belong to {len(kinds)} sequences: " + ", ".join(listed),
            expected="one sequence: names that differ by a number only",
            fix="name one of them with a pattern, such as img_%04d.png, or pass a list of paths",
            file=folder,
        )
    columns = list(zip(*(_DIGITS.split(path.name)[1::2] for path in ordered), strict=True))
    varying = [column for column in columns if len(set(map(int, column))) > 1]
    if len(varying) != 1:
        why = "several numbers" if varying else "no number"
        return NumberedFiles(
            tuple(ordered),
            tuple(range(count)),
            notes=(f"{why} in the names vary: missing frames cannot be told",),
        )
    numbers = [int(digits) for digits in varying[0]]
    if len(set(numbers)) < count:
        twin = next(i for i in range(1, count) if numbers[i] == numbers[i - 1])
        raise VideoError(
            f"{ordered[twin - 1].name} and {ordered[twin].name} have the same number",
            expected="each number once",
            fix="remove or rename one of them",
            file=folder,
        )
    return _with_holes(ordered, numbers, width=len(varying[0][0]))


def _with_holes(paths: list[Path], numbers: list[int], *, width: int) -> NumberedFiles:
    steps = [b - a for a, b in pairwise(numbers)]
    step = math.gcd(*steps)
    # Numbers such as time stamps have no usual step; neither have two files.
    if steps.count(step) < 0.5 * len(steps):
        return NumberedFiles(
            tuple(paths),
            tuple(range(len(paths))),
            notes=("the numbers in the names have no regular step: missing frames cannot be told",),
        )
    places = tuple((number - numbers[0]) // step for number in numbers)
    missing: list[str] = []
    for before, after in pairwise(numbers):
        # The first ones are enough for a message: a number can be as long as a name.
        for number in range(before + step, min(after, before + 1000 * step), step):
            missing.append(f"{number:0{width}d}")
    return NumberedFiles(tuple(paths), places, tuple(missing))
