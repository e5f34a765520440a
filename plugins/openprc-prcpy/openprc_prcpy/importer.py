"""PRCpy experiment folders to a trajectory."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, NonUniformTime
from openprc.schema import UNITS
from openprc_prcpy import sniffing
from openprc_prcpy.experiment import PRCpyData, read_prcpy
from openprc_prcpy.extension import DISTRIBUTION
from openprc_prcpy.parameters import ProcessParameters
from openprc_prcpy.table import column_unit

if TYPE_CHECKING:
    from openprc.schema import TrajectoryWriter

_TIME_NAMES = ("t", "time", "times")
_UNUSABLE = re.compile(r"[^A-Za-z0-9_.\- ]")
_INPUT = "u"


class Importer:
    """Reads folders with one text file for each scan or device (capability ``"import"``)."""

    def sniff(self, path: Path) -> float:
        """Return the confidence that `path` is such a folder."""
        return sniffing.score(Path(path))

    def import_run(
        self, path: Path, writer: TrajectoryWriter, *, options: Mapping[str, Any]
    ) -> None:
        """Write the experiment in the folder `path` into `writer`.

        Raises
        ------
        OpenPRCError
            As `openprc_prcpy.experiment.read_prcpy`, and when the times do not increase.
        """
        path = Path(path)
        known = {field.name for field in fields(ProcessParameters)}
        data = read_prcpy(
            path,
            options.get("prefix"),
            {name: value for name, value in options.items() if name in known},
            gaps=options.get("gaps") or "error",
            input_from=options.get("input") or "auto",
        )
        if data.background is not None and data.background.parent.resolve() != path.resolve():
            writer.add_source(data.background, role="background")
        for remark in data.remarks:
            writer.note(remark)
        time = _clock(data, writer, options, path)
        channel = _UNUSABLE.sub("_", data.readouts_name).lstrip(".- ") or "readouts"
        unit = options.get("unit") or column_unit(data.readouts_name) or "arb"
        writer.declare_channel(channel, data.names, unit=unit)
        inputs = _declare_input(data, time, writer, hold=float(options.get("interval") or 1.0))
        _declare_extension(data, writer)
        writer.append(time, channels={channel: data.states}, inputs=inputs)


def _clock(
    data: PRCpyData, writer: TrajectoryWriter, options: Mapping[str, Any], path: Path
) -> NDArray[np.float64]:
    """Declare the kind of time and return the times, (T,)."""
    interval = options.get("interval")
    if interval is not None and not interval > 0:
        raise ConfigError(
            f"interval is {interval}",
            expected="seconds, above 0",
            fix="correct it",
            file=path,
            key="interval",
        )
    if data.transpose and interval is None:
        return _measured_times(data, writer, options, path)
    if interval is not None:
        writer.declare_time(unit="s", kind="physical")
        return data.scans * float(interval)
    writer.declare_time(unit="1", kind="pseudo")
    writer.note(
        "the files say in which order the scans were made and not when; import again with "
        "interval=SECONDS to measure memory"
    )
    return data.scans.astype(np.float64)


def _measured_times(
    data: PRCpyData, writer: TrajectoryWriter, options: Mapping[str, Any], path: Path
) -> NDArray[np.float64]:
    written = column_unit(data.xs_name)
    is_time = written is not None and UNITS[written].dimension == "time"
    if not is_time and data.xs_name.lower() not in _TIME_NAMES and not options.get("time_unit"):
        writer.declare_time(unit="1", kind="pseudo")
        writer.note(
            f"{data.xs_name!r} is no name of time, so the rows are counted; say time_unit=UNIT if "
            "it is one"
        )
        return data.scans.astype(np.float64)
    unit = options.get("time_unit") or (written if is_time else None)
    if unit is None:
        unit = "s"
        writer.note(f"the header {data.xs_name!r} has no unit; seconds were assumed")
    back = np.flatnonzero(np.diff(data.xs) <= 0)
    if len(back):
        row = int(back[0])
        raise NonUniformTime(
            f"{data.xs_name} goes from {data.xs[row]:g} to {data.xs[row + 1]:g} after row "
            f"{row + 1}",
            expected="times that increase from row to row",
            fix="name the column of time with Xs; times that were rounded when they were printed "
            "are replaced by interval=SECONDS",
            file=path,
            key=data.files[0],
        )
    writer.declare_time(unit=unit, kind="physical")
    return data.xs


def _declare_input(
    data: PRCpyData, time: NDArray[np.float64], writer: TrajectoryWriter, *, hold: float
) -> dict[str, NDArray[np.float64]] | None:
    if data.input is None:
        return None
    unit = data.input_unit or "arb"
    quantity = UNITS[unit].dimension if unit in UNITS else "input"
    if unit not in UNITS:
        writer.note(f"the input is in {unit!r}, which is no unit of the contract: stored as arb")
        unit = "arb"
    writer.declare_input(
        _INPUT,
        [_INPUT],
        quantity=quantity if quantity != "arbitrary" else "input",
        unit=unit,
        sequence=data.input,
        hold=hold,
        # A scan is made while its input is held. In the middle of its symbol it is the state of
        # this symbol for every reader; on the border it would be the end of the one before.
        start=float(time[0]) - 0.5 * hold,
    )
    return {_INPUT: data.input[:, np.newaxis]}


def _declare_extension(data: PRCpyData, writer: TrajectoryWriter) -> None:
    writer.declare_extension(DISTRIBUTION, "1.0")
    writer.put_extension(DISTRIBUTION, "files", list(data.files))
    if not data.transpose:
        writer.put_extension(
            DISTRIBUTION,
            "xs",
            data.xs,
            unit=column_unit(data.xs_name) or "arb",
            comment=f"{data.xs_name} of each column",
        )
