"""Logs without positions: MINITAUR, and real robots that write the same container.

They hold one record a step and no time step. Without ``dt`` the frames are numbered (pseudo
time, from which memory tasks keep away) rather than put on a clock that nobody named.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.errors import NotATrajectory
from openprc.schema import TrajectoryWriter
from openprc.schema.units import conversion_factor
from openprc_pybullet.clock import step_of_stamps
from openprc_pybullet.settings import Settings
from openprc_pybullet.state_log import StateLog

#: MINITAUR columns: what they are, by channel. ``mo`` is a constant 6 in simulation.
_MINITAUR: Mapping[str, tuple[tuple[str, ...], str, str]] = {
    "attitude": (("r", "p", "y"), "rad", "roll, pitch and yaw of the base"),
    "motor_angle": (tuple(f"q{i}" for i in range(8)), "rad", "motor angle"),
    "motor_torque": (tuple(f"u{i}" for i in range(8)), "N*m", "motor torque"),
    "forward_velocity": (("dx",), "m/s", "x velocity of the base"),
    "mode": (("mo",), "1", "mode of the controller"),
}


def import_sensor_log(
    log: StateLog, writer: TrajectoryWriter, *, path: Path, settings: Settings
) -> None:
    """Write the columns of a log that holds no positions as channels.

    Raises
    ------
    NotATrajectory
        When there is no column that counts or times the records, or several records share one
        instant, as in logs of virtual-reality controllers.
    """
    minitaur = log.header.family == "minitaur"
    time, clock = _time(log, path, settings)
    names = [name for name in log.header.names if name not in clock]
    layout = _layout(names, minitaur=minitaur)
    if time is None:
        writer.declare_time(unit="1", kind="pseudo")
        writer.note(
            "the log does not tell its time step: frames are numbered by step; dt=... puts "
            "them on a clock"
        )
        time = log.records[clock[0]].astype(np.float64)
    for name, (members, unit, quantity) in layout.items():
        writer.declare_channel(name, members, unit=unit, quantity=quantity)
    if log.cut_bytes:
        writer.note(f"the last record is cut off after {log.cut_bytes} bytes and was left out")
    if log.bare_after.size:
        writer.note(
            f"{log.bare_after.size} records are empty: PyBullet had fewer values than columns"
        )
    channels = {
        name: np.stack([log.records[member] for member in members], axis=1).astype(np.float64)
        for name, (members, _, _) in layout.items()
    }
    writer.append(time, channels=channels)


def _layout(names: list[str], *, minitaur: bool) -> dict[str, tuple[tuple[str, ...], str, str]]:
    known = dict(_MINITAUR) if minitaur else {}
    found = {key: entry for key, entry in known.items() if set(entry[0]) <= set(names)}
    named = {member for members, _, _ in found.values() for member in members}
    rest = tuple(name for name in names if name not in named)
    if rest:
        found["columns"] = (rest, "arb", "")
    return found


def _time(
    log: StateLog, path: Path, settings: Settings
) -> tuple[NDArray[np.float64] | None, tuple[str, ...]]:
    """Return the time, or None for a bare count, and the columns it came from."""
    header, records = log.header, log.records
    if not records.size:
        raise NotATrajectory(
            f"all {log.bare_after.size} records are empty",
            expected="records with values",
            fix="the robot that was logged lacks the motors that this kind of log expects",
            file=path,
        )
    counter: str | None = next((name for name in ("stepCount", "t") if name in header.names), None)
    stamp: str | None = next((name for name in ("timeStamp", "time") if name in header.names), None)
    if settings.time_key is not None:
        counter, stamp = None, settings.time_key
    key = counter or stamp
    if key is None or key not in header.names:
        raise NotATrajectory(
            f"no column tells the time; the columns are {', '.join(header.names)}",
            expected="stepCount, timeStamp, t or time",
            fix="name the column with time_key",
            file=path,
            key=settings.time_key,
        )
    values = records[key].astype(np.float64)
    stuck = np.flatnonzero(np.diff(values) <= 0)
    if stuck.size:
        row = int(stuck[0]) + 1
        raise NotATrajectory(
            f"{key} does not increase at record {row} ({values[row]:.9g} after "
            f"{values[row - 1]:.9g}): several records share one instant",
            expected="one record an instant",
            fix="this kind of log is not imported; GENERIC_ROBOT, CONTACT_POINTS and MINITAUR "
            "logs are",
            file=path,
            key=key,
        )
    # Hardware counts time, not steps: whoever names its unit says so.
    timed = counter == "t" and settings.time_unit != "s"
    if counter is not None and not timed and header.letters[header.names.index(counter)] in "Ii":
        return _counted_time(log, path, settings, counter, stamp)
    factor = conversion_factor(settings.time_unit, "s")
    return settings.t0 + values * factor, (key,)


def _counted_time(
    log: StateLog, path: Path, settings: Settings, counter: str, stamp: str | None
) -> tuple[NDArray[np.float64] | None, tuple[str, ...]]:
    count = log.records[counter].astype(np.int64)
    dt = settings.dt
    clock: tuple[str, ...] = (counter,)
    if stamp == "timeStamp" and log.records[stamp].dtype == np.float32:
        dt = step_of_stamps(count, log.records[stamp], given=dt, file=str(path))
        clock = (counter, stamp)
    if dt is None:
        return None, clock
    # As in every logger of PyBullet, record k is the state after step k + 1.
    return settings.t0 + (count.astype(np.float64) + 1.0) * dt, clock
