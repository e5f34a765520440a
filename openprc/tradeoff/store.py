"""`PointStore`: finished points in a file that survives being interrupted.

One JSON object a line: first what the points are of, then a point each. A line is written and
synchronised as a whole; a line that a crash cut off is dropped when the file is opened again.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from openprc import __version__
from openprc.errors import ConfigError, UnreadableFile
from openprc.schema.atomic import atomic_file
from openprc.tradeoff.point import Point
from openprc.tradeoff.settings import key_of

#: Of the layout of the file.
FORMAT = "1"


@dataclass(frozen=True)
class StoredPoint:
    """A point and the CPU times that its median is of; none where nothing was timed."""

    point: Point
    seconds: tuple[float, ...] = field(default=())

    @property
    def key(self) -> str:
        """What identifies the setting."""
        return key_of(self.point.group, self.point.setting)


class PointStore:
    """Points of one study.

    Parameters
    ----------
    path : path-like or None
        A file of JSON lines, made when the first point is put; None keeps points in memory.
    scene : str
        Digest of the scene, of its reference and of what else has to be the same.

    Raises
    ------
    ConfigError
        When the file holds points of another scene, or of another version of OpenPRC.
    UnreadableFile
        When it is no such file, or damaged before its last line.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from openprc.tradeoff.point import Point
    >>> from openprc.tradeoff.store import PointStore
    >>> folder = tempfile.TemporaryDirectory()
    >>> path = Path(folder.name) / "points.jsonl"
    >>> point = Point(group="integrator", label="rk4", setting={"dt": 0.1}, trajectory_error=0.5)
    >>> PointStore(path, scene="a").put(point, seconds=[0.1])
    >>> PointStore(path, scene="a").get("integrator", {"dt": 0.1}).point.trajectory_error
    0.5
    >>> folder.cleanup()
    """

    def __init__(self, path: str | Path | None, *, scene: str) -> None:
        self.path = None if path is None else Path(path)
        self.scene = scene
        self._points: dict[str, StoredPoint] = {}
        if self.path is not None and self.path.exists():
            self._read(self.path)

    def __len__(self) -> int:
        return len(self._points)

    @property
    def points(self) -> tuple[Point, ...]:
        """Every point, in the order in which settings were first put."""
        return tuple(stored.point for stored in self._points.values())

    def get(self, group: str, setting: Mapping[str, Any]) -> StoredPoint | None:
        """Return what is known of a setting, or None."""
        return self._points.get(key_of(group, setting))

    def put(self, point: Point, *, seconds: Sequence[float] = ()) -> None:
        """Keep a point, in place of an earlier one of the same setting."""
        stored = StoredPoint(point, tuple(seconds))
        self._points[stored.key] = stored
        if self.path is None:
            return
        self.path.parent.mkdir(parents=True, exist_ok=True)
        lines = [_line(stored)]
        if not self.path.exists():
            lines.insert(0, self._head())
        # One write of whole lines: what a reader, or a crash, sees are lines.
        descriptor = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
        try:
            os.write(descriptor, "".join(lines).encode())
            os.fsync(descriptor)
        finally:
            os.close(descriptor)

    def compact(self) -> None:
        """Write the file anew with one line a point."""
        if self.path is None or not self._points:
            return
        with atomic_file(self.path, overwrite=True) as temporary:
            lines = [self._head(), *(_line(stored) for stored in self._points.values())]
            temporary.write_text("".join(lines), encoding="utf-8")

    # --- inside ---------------------------------------------------------------------------------

    def _head(self) -> str:
        head = {"openprc_tradeoff": FORMAT, "openprc": __version__, "scene": self.scene}
        return json.dumps(head) + "\n"

    def _read(self, path: Path) -> None:
        content = path.read_bytes()
        whole, _, cut = content.rpartition(b"\n")
        lines = whole.split(b"\n") if whole else []
        if not lines:
            if content.startswith(b'{"openprc_tradeoff"') or not content:
                path.unlink()  # a crash while the first line was written
                return
            raise self._foreign(1)
        self._check_head(self._parsed(lines[0], 1))
        for number, line in enumerate(lines[1:], 2):
            data = self._parsed(line, number)
            try:
                stored = StoredPoint(Point.from_dict(data["point"]), tuple(data["seconds"]))
            except (KeyError, TypeError, ValueError):
                raise self._foreign(number) from None
            self._points[stored.key] = stored
        if cut or len(lines) - 1 > len(self._points):
            self.compact()
            if not self._points:
                path.unlink()

    def _parsed(self, line: bytes, number: int) -> dict[str, Any]:
        try:
            data = json.loads(line)
        except ValueError:
            raise self._foreign(number) from None
        if not isinstance(data, dict):
            raise self._foreign(number)
        return data

    def _foreign(self, number: int) -> UnreadableFile:
        return UnreadableFile(
            f"line {number} is no point of a trade-off study",
            expected="the file that `openprc tradeoff --out` writes",
            fix="choose another folder with --out, or remove the file and measure again",
            file=self.path,
        )

    def _check_head(self, head: dict[str, Any]) -> None:
        if "openprc_tradeoff" not in head:
            raise self._foreign(1)
        for key, mine, what in (
            ("openprc_tradeoff", FORMAT, "the layout"),
            ("openprc", __version__, "openprc"),
        ):
            if head.get(key) != mine:
                raise ConfigError(
                    f"the points were measured by another version: {what} {head.get(key)!r}",
                    expected=f"{what} {mine!r}, so that points can be compared",
                    fix="choose another folder with --out, or remove the file and measure again",
                    file=self.path,
                )
        if head.get("scene") != self.scene:
            raise ConfigError(
                "the points are of another scene, or of other options of it",
                expected=f"a scene with the digest {self.scene[:12]}, found"
                f" {str(head.get('scene'))[:12]}",
                fix="choose another folder with --out, or remove the file and measure again",
                file=self.path,
            )


def _line(stored: StoredPoint) -> str:
    data = {"point": stored.point.as_dict(), "seconds": list(stored.seconds)}
    return json.dumps(data, allow_nan=False) + "\n"
