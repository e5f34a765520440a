"""Checking a block of frames before any of it is written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import SchemaError
from openprc.schema.streams import Stream

TIME = "/time_series/time"
POSITIONS = "/time_series/nodes/positions"
OBSERVED = "/time_series/nodes/observed"
VELOCITIES = "/time_series/nodes/velocities"
#: A sensor may have gaps, and NaN is how a column without a mask shows them.
_WITH_GAPS = ("/time_series/channels/", "/time_series/elements/", "/extensions/")


@dataclass(frozen=True)
class Block:
    """Checked arrays of one block, each with time along axis 0."""

    rows: int
    arrays: dict[str, NDArray[Any]]


class BlockChecker:
    """Holds what one block has to know of the next: the last instant."""

    def __init__(self, path: Path, streams: Mapping[str, Stream]) -> None:
        self._path = path
        self._streams = streams
        self._last = -np.inf
        self._frame = 0

    def check(self, given: Mapping[str, Any]) -> Block:
        """Return the block as arrays of the declared types.

        Raises
        ------
        SchemaError
            See `TrajectoryWriter.append`.
        """
        self._check_names(given)
        time = self._time(given[TIME])
        single = np.ndim(given[TIME]) == 0
        arrays: dict[str, NDArray[Any]] = {TIME: time}
        for name, stream in self._streams.items():
            if name != TIME:
                arrays[name] = self._array(stream, given[name], len(time), single=single)
        self._check_values(arrays)
        self._last = float(time[-1])
        self._frame += len(time)
        return Block(len(time), arrays)

    def _check_names(self, given: Mapping[str, Any]) -> None:
        missing = sorted(set(self._streams) - set(given))
        if missing:
            raise SchemaError(
                f"declared, but not given at frame {self._frame}: {', '.join(missing)}",
                expected="every declared quantity in every append()",
                fix="pass it, or do not declare it",
                file=self._path,
                key=missing[0],
            )
        stray = sorted(set(given) - set(self._streams))
        if stray:
            raise SchemaError(
                f"given, but not declared: {', '.join(stray)}",
                expected="only what was declared before the first append()",
                fix="declare it first",
                file=self._path,
                key=stray[0],
            )

    def _time(self, value: Any) -> NDArray[np.float64]:
        time = np.atleast_1d(self._number(TIME, value, np.dtype("f8")))
        if time.ndim != 1 or time.size == 0:
            raise self._wrong(TIME, f"time has shape {np.shape(value)}", "a number or (B,)")
        if not np.isfinite(time).all():
            bad = int(np.flatnonzero(~np.isfinite(time))[0])
            raise self._wrong(
                TIME, f"time is {time[bad]} at frame {self._frame + bad}", "finite numbers"
            )
        steps = np.diff(time, prepend=self._last)
        if not (steps > 0).all():
            bad = int(np.flatnonzero(~(steps > 0))[0])
            before = self._last if bad == 0 else time[bad - 1]
            raise self._wrong(
                TIME,
                f"time does not increase at frame {self._frame + bad}: "
                f"{before:.17g} is followed by {time[bad]:.17g}",
                "strictly increasing time",
            )
        return time

    def _array(self, stream: Stream, value: Any, rows: int, *, single: bool) -> NDArray[Any]:
        array = self._number(stream.path, value, stream.dtype)
        if single and array.shape == stream.row:
            array = array[np.newaxis]
        if array.shape != (rows, *stream.row):
            wanted = f"{(rows, *stream.row)}" + (f" or {stream.row}" if single else "")
            raise self._wrong(stream.path, f"the shape is {array.shape}", wanted)
        return array

    def _number(self, key: str, value: Any, dtype: np.dtype[Any]) -> NDArray[Any]:
        try:
            array = np.asarray(value)
            if array.dtype.kind not in "fiub":
                raise TypeError(f"type {array.dtype}")
            # Too large for f4 becomes infinite, and is refused as that.
            with np.errstate(over="ignore", invalid="ignore"):
                stored: NDArray[Any] = array.astype(dtype, copy=False)
            if dtype.kind in "iu" and not np.array_equal(stored, array):
                raise ValueError("codes that are no small whole numbers")
            return stored
        except (TypeError, ValueError) as error:
            raise self._wrong(key, f"not a real number array: {error}", "real numbers") from error

    def _check_values(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        observed = arrays.get(OBSERVED)
        if observed is not None and observed.size and observed.max() > 2:
            raise self._wrong(OBSERVED, f"a code of {observed.max()}", "0, 1 or 2")
        for name, array in arrays.items():
            if name in (TIME, OBSERVED) or np.isfinite(array).all():
                if name == POSITIONS and observed is not None and (observed == 0).any():
                    raise self._wrong(
                        name, "points marked missing have positions", "NaN where observed is 0"
                    )
                continue
            self._explain(name, array, observed)

    def _explain(self, name: str, array: NDArray[Any], observed: NDArray[Any] | None) -> None:
        """Raise unless every value that is not finite is a NaN that was declared missing."""
        if np.isinf(array).any():
            index = np.argwhere(np.isinf(array))[0]
            raise self._wrong(name, f"infinite {self._place(index)}", "finite numbers")
        nan = np.isnan(array)
        if name.startswith(_WITH_GAPS):
            return
        if name not in (POSITIONS, VELOCITIES):
            index = np.argwhere(nan)[0]
            raise self._wrong(name, f"NaN {self._place(index)}", "numbers")
        if observed is None:
            index = np.argwhere(nan)[0]
            raise self._wrong(
                name,
                f"NaN {self._place(index)}",
                "numbers, or declare_nodes(observed=True) and a mask that marks it missing",
            )
        if name == POSITIONS:
            missing = observed == 0
            differs = (nan.all(axis=2) != missing) | (nan.any(axis=2) != missing)
            if differs.any():
                index = np.argwhere(differs)[0]
                raise self._wrong(
                    name,
                    f"NaN and the mask disagree {self._place(index)}",
                    "NaN in all axes exactly where observed is 0",
                )

    def _place(self, index: NDArray[np.intp]) -> str:
        words = [f"at frame {self._frame + int(index[0])}"]
        words += [f"column {int(i)}" if n else f"node {int(i)}" for n, i in enumerate(index[1:2])]
        return ", ".join(words)

    def _wrong(self, key: str, found: str, expected: str) -> SchemaError:
        return SchemaError(
            found,
            expected=expected,
            fix="correct the producer; the frames before this one are kept",
            file=self._path,
            key=key,
        )
