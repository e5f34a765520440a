"""Rows of a GENERIC_ROBOT log sorted by body, on one clock.

Row k of a body is the state *after* step k + 1 although its ``stepCount`` reads k and its
``timeStamp`` k dt: the logger runs at the end of ``stepSimulation``. The state before the
first step is in no log, and none is made up for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, NotATrajectory, UnreadableFile
from openprc_pybullet.settings import Settings
from openprc_pybullet.state_log import StateLog

MANY_DOF = (
    "record with startStateLogging(..., maxLogDof=N), N at least the number of revolute and "
    "prismatic joints (the default is 12); bodies with spherical or planar joints cannot be "
    "logged at all"
)


@dataclass(frozen=True, slots=True)
class Body:
    """One body of a log.

    Parameters
    ----------
    body : int
        Unique id.
    rows : (t,) int
        Records of this body in the log, by frame.
    frames : (t,) int
        Frames at which they stand.
    n_joints : int
        Revolute and prismatic joints (``qNum``).
    moves : bool
        Whether the base changed its pose or had a velocity.
    """

    body: int
    rows: NDArray[np.int64]
    frames: NDArray[np.int64]
    n_joints: int
    moves: bool


@dataclass(frozen=True, slots=True)
class Scene:
    """The bodies to import, the step counts of the frames, and remarks for the reader."""

    bodies: tuple[Body, ...]
    counts: NDArray[np.int64]
    notes: tuple[str, ...]


def columns(log: StateLog, names: Sequence[str], *, rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return float64 columns (t, len(names)) of the records at `rows`."""
    picked = log.records[rows]
    return np.stack([picked[name] for name in names], axis=1).astype(np.float64)


def joint_columns(log: StateLog, letter: str, n_joints: int) -> list[str]:
    """Return ``q0 ...``, ``u0 ...`` or ``t0 ...`` of the first `n_joints` joints, if logged."""
    names = [f"{letter}{joint}" for joint in range(n_joints)]
    return names if set(names) <= set(log.header.names) else []


def sort_bodies(log: StateLog, settings: Settings, *, file: str) -> Scene:
    """Sort the records by body and choose which bodies to import.

    Raises
    ------
    UnreadableFile
        When a body appears twice in one step or changes its number of joints.
    ConfigError
        When a body was asked for that the log does not hold.
    NotATrajectory
        When nothing that moves is in the log.
    """
    notes = _overflow_notes(log)
    records = log.records
    step = records["stepCount"].astype(np.int64)
    ids = records["objectId"].astype(np.int64)
    counts = np.unique(step)
    counts, tail = _complete_frames(counts, step, ids, log)
    notes += tail
    bodies = []
    kept = np.isin(step, counts)
    for body in np.unique(ids[kept]):
        rows = np.flatnonzero(kept & (ids == body))
        bodies.append(_body(log, int(body), rows, counts, file=file))
    chosen, remarks = _choose(bodies, settings, log, file=file)
    return Scene(tuple(chosen), counts, tuple(notes + remarks))


def _body(
    log: StateLog, body: int, rows: NDArray[np.int64], counts: NDArray[np.int64], *, file: str
) -> Body:
    step = log.records["stepCount"][rows].astype(np.int64)
    twice = np.flatnonzero(np.diff(step) == 0)
    if twice.size:
        raise UnreadableFile(
            f"body {body} appears twice in step {step[twice[0]]}",
            expected="one record a body and step",
            fix="the file is damaged or holds two logs; record again",
            file=file,
            key="objectId",
        )
    joints = np.unique(log.records["qNum"][rows])
    if joints.size > 1:
        raise UnreadableFile(
            f"body {body} changes its number of joints ({', '.join(map(str, joints))})",
            expected="one qNum a body",
            fix="ids are reused after resetSimulation: start a new log there",
            file=file,
            key="qNum",
        )
    pose = columns(log, _POSE, rows=rows)
    rates = columns(log, _RATES, rows=rows)
    moves = bool(np.any(pose != pose[:1]) or np.any(rates != 0.0))
    n_joints = int(joints[0])
    if n_joints and not joint_columns(log, "q", n_joints):
        raise UnreadableFile(
            f"body {body} says it has {n_joints} joints, more than the log has columns",
            expected="a column q and u for each joint",
            fix=MANY_DOF,
            file=file,
            key="qNum",
        )
    return Body(body, rows, np.searchsorted(counts, step), n_joints, moves)


_POSE = ("posX", "posY", "posZ", "oriX", "oriY", "oriZ", "oriW")
_RATES = ("velX", "velY", "velZ", "omegaX", "omegaY", "omegaZ")


def _overflow_notes(log: StateLog) -> list[str]:
    if not log.bare_after.size:
        return []
    return [
        f"{log.bare_after.size} records are empty ({_who_is_empty(log)}): such a body has more "
        f"joints than the log has columns, and its state is not in the file; {MANY_DOF}"
    ]


def _who_is_empty(log: StateLog) -> str:
    """Name the bodies behind empty records as far as the file tells: by their neighbours."""
    ids = log.records["objectId"].astype(np.int64) if log.records.size else np.empty(0, np.int64)
    after = np.unique([ids[k - 1] if k else -1 for k in log.bare_after])
    known = [f"after body {i}" for i in after if i >= 0]
    if (after < 0).any():
        known.insert(0, "before the first body")
    return "written " + " and ".join(known)


def _complete_frames(
    counts: NDArray[np.int64], step: NDArray[np.int64], ids: NDArray[np.int64], log: StateLog
) -> tuple[NDArray[np.int64], list[str]]:
    notes = []
    if log.cut_bytes:
        notes.append(f"the last record is cut off after {log.cut_bytes} bytes and was left out")
    if counts.size > 1:
        before, last = (set(ids[step == count]) for count in counts[-2:])
        if last < before:
            notes.append(
                f"the last step (stepCount {counts[-1]}) lacks bodies "
                f"{', '.join(map(str, sorted(before - last)))} and was left out"
            )
            counts = counts[:-1]
    return counts, notes


def _choose(
    bodies: list[Body], settings: Settings, log: StateLog, *, file: str
) -> tuple[list[Body], list[str]]:
    known = {body.body for body in bodies}
    missing = sorted(set(settings.bodies) - known)
    if missing:
        empty = (
            "; some records are empty, see maxLogDof: " + MANY_DOF if log.bare_after.size else ""
        )
        raise ConfigError(
            f"bodies {', '.join(map(str, missing))} are not in the log",
            expected=f"some of {', '.join(map(str, sorted(known))) or 'none'}{empty}",
            fix="choose among these, or log them with objectUniqueIds=[...]",
            file=file,
            key="bodies",
        )
    if settings.bodies:
        return [body for body in bodies if body.body in settings.bodies], []
    chosen = [body for body in bodies if settings.include_static or body.moves or body.n_joints]
    dropped = sorted(known - {body.body for body in chosen})
    if not chosen:
        raise _nothing_moves(dropped, log, file=file)
    if not dropped:
        return chosen, []
    return chosen, [
        f"left out bodies {', '.join(map(str, dropped))}, which have no joints and never move "
        "(include_static keeps them)"
    ]


def _nothing_moves(dropped: list[int], log: StateLog, *, file: str) -> NotATrajectory:
    still = f"bodies {', '.join(map(str, dropped))} never move" if dropped else "no body"
    if log.bare_after.size:
        return NotATrajectory(
            f"the log holds {still} and {log.bare_after.size} empty records "
            f"({_who_is_empty(log)}): the joints of the robot overflowed the columns, and its "
            "state was not written",
            expected="records with the state of the robot",
            fix=MANY_DOF,
            file=file,
            key="qNum",
        )
    return NotATrajectory(
        f"nothing moves in this log: {still}",
        expected="a body that moves or has joints",
        fix="soft bodies and bodies made with useMaximalCoordinates never appear in state logs, "
        "save their getMeshData or poses yourself; include_static imports what is there",
        file=file,
        key="objectId",
    )
