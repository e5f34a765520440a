"""GENERIC_ROBOT logs: bodies become nodes, joint coordinates become channels."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.errors import Diverged
from openprc.schema import TrajectoryWriter
from openprc_pybullet.bodies import MANY_DOF, Body, columns, joint_columns, sort_bodies
from openprc_pybullet.clock import step_of_stamps
from openprc_pybullet.kinematics import FIXED, Model, match_models
from openprc_pybullet.settings import Settings
from openprc_pybullet.state_log import StateLog

DISTRIBUTION = "openprc-pybullet"
#: Frames handed to the writer at a time.
BLOCK = 2048

_POSITION = ("posX", "posY", "posZ")
_VELOCITY = ("velX", "velY", "velZ")
_ORIENTATION = ("oriX", "oriY", "oriZ", "oriW")
_OMEGA = ("omegaX", "omegaY", "omegaZ")
#: Letter of the columns; unit for revolute and for prismatic joints; what it is.
_JOINT = {
    "q": ("rad", "m", "joint position"),
    "u": ("rad/s", "m/s", "joint velocity"),
    "t": ("N*m", "N", "joint motor and user torque"),
}


@dataclass(frozen=True, slots=True)
class Channel:
    """A channel of one body: its name, unit, and the log columns it takes."""

    name: str
    columns: tuple[str, ...]
    unit: str
    quantity: str


def import_robot_log(
    log: StateLog, writer: TrajectoryWriter, *, path: Path, settings: Settings
) -> None:
    """Write the bodies of a GENERIC_ROBOT log.

    Nodes are the centre of mass of each base, followed by those of its links when a model is
    named. Time is ``t0 + (stepCount + 1) dt``.

    Raises
    ------
    OpenPRCError
        See `sort_bodies`, `step_of_stamps`, `match_models`; `Diverged` when a state is not a
        finite number.
    """
    file = str(path)
    scene = sort_bodies(log, settings, file=file)
    dt = step_of_stamps(
        log.records["stepCount"].astype(np.int64),
        log.records["timeStamp"],
        given=settings.dt,
        file=file,
    )
    time = settings.t0 + (scene.counts + 1) * dt
    ids = [body.body for body in scene.bodies]
    with ExitStack() as stack:
        models = {
            body: stack.enter_context(
                Model(
                    model,
                    body=body,
                    n_joints=scene.bodies[ids.index(body)].n_joints,
                    flags=settings.urdf_flags,
                    scale=settings.urdf_scale,
                )
            )
            for body, model in match_models(
                settings.urdf, ids, log=path, if_absent=_if_absent(log)
            ).items()
        }
        parts = [_Part(log, body, models.get(body.body), file=file) for body in scene.bodies]
        _declare(writer, parts, n_frames=time.size)
        for body in models.values():
            writer.add_source(body.path, role="urdf")
        for note in (*scene.notes, *_remarks(parts)):
            writer.note(note)
        gaps = any(part.body.frames.size < time.size for part in parts)
        for start in range(0, time.size, BLOCK):
            stop = min(start + BLOCK, time.size)
            blocks = [part.block(start, stop) for part in parts]
            positions = np.concatenate([block[0] for block in blocks], axis=1)
            velocities = np.concatenate([block[1] for block in blocks], axis=1)
            channels = {name: values for block in blocks for name, values in block[2].items()}
            seen = {"observed": np.isfinite(positions[..., 0]).astype("u1")} if gaps else {}
            writer.append(
                time[start:stop],
                positions=positions,
                velocities=velocities,
                channels=channels,
                **seen,
            )


def _if_absent(log: StateLog) -> str:
    empty = f"correct the id; if its records are the empty ones, {MANY_DOF}"
    return empty if log.bare_after.size else "correct the id"


class _Part:
    """One body's share of the nodes and channels."""

    def __init__(self, log: StateLog, body: Body, model: Model | None, *, file: str) -> None:
        self.log = log
        self.body = body
        self.model = model
        self.n_nodes = 1 + (len(model.links) if model else 0)
        self.channels = _channels(log, body, model)
        _refuse_divergence(log, body, file=file)

    def labels(self) -> list[str]:
        """Return ``body1`` or, with a model, ``body1.<link>`` of every node."""
        prefix = f"body{self.body.body}"
        if self.model is None:
            return [prefix]
        names = [self.model.base_name, *(link.name for link in self.model.links)]
        unique = [f"{name}#{i - 1}" if name in names[:i] else name for i, name in enumerate(names)]
        return [f"{prefix}.{name}" for name in unique]

    def fixed(self) -> list[bool]:
        """Tell which nodes cannot move: a base that never does, and what is welded to it."""
        flags = [not self.body.moves]
        for link in self.model.links if self.model else ():
            flags.append(flags[link.parent + 1] and link.joint_type == FIXED)
        return flags

    def block(
        self, start: int, stop: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], dict[str, NDArray[np.float64]]]:
        """Return positions, velocities and channels of frames `start` to `stop`.

        Frames in which the body was not logged hold NaN.
        """
        first, last = np.searchsorted(self.body.frames, (start, stop))
        rows = self.body.rows[first:last]
        at = self.body.frames[first:last] - start
        shape = (stop - start, self.n_nodes, 3)
        positions, velocities = np.full(shape, np.nan), np.full(shape, np.nan)
        base = columns(self.log, _POSITION, rows=rows)
        speed = columns(self.log, _VELOCITY, rows=rows)
        positions[at, 0], velocities[at, 0] = base, speed
        if self.model is not None:
            n = self.body.n_joints
            positions[at, 1:], velocities[at, 1:] = self.model.poses(
                base,
                columns(self.log, _ORIENTATION, rows=rows),
                base_velocity=speed,
                base_omega=columns(self.log, _OMEGA, rows=rows),
                q=_joints(self.log, "q", n, rows),
                u=_joints(self.log, "u", n, rows),
            )
        values = {}
        for channel in self.channels:
            values[channel.name] = np.full((stop - start, len(channel.columns)), np.nan)
            values[channel.name][at] = columns(self.log, channel.columns, rows=rows)
        return positions, velocities, values


def _joints(
    log: StateLog, letter: str, n_joints: int, rows: NDArray[np.int64]
) -> NDArray[np.float64]:
    if n_joints == 0:
        return np.empty((rows.size, 0))
    return columns(log, joint_columns(log, letter, n_joints), rows=rows)


def _channels(log: StateLog, body: Body, model: Model | None) -> list[Channel]:
    prefix = f"body{body.body}"
    found = [
        Channel(f"{prefix}.orientation", _ORIENTATION, "1", "quaternion x, y, z, w"),
        Channel(f"{prefix}.omega", _OMEGA, "rad/s", "angular velocity of the base"),
    ]
    for letter, (revolute, prismatic, quantity) in _JOINT.items():
        names = joint_columns(log, letter, body.n_joints)
        if not names:
            continue
        if model is None:
            found.append(Channel(f"{prefix}.{letter}", tuple(names), "arb", quantity))
            continue
        turning = tuple(n for n, turns in zip(names, model.rotates, strict=True) if turns)
        sliding = tuple(n for n, turns in zip(names, model.rotates, strict=True) if not turns)
        if turning:
            found.append(Channel(f"{prefix}.{letter}", turning, revolute, quantity))
        if sliding:
            name = f"{prefix}.{letter}" + ("_prismatic" if turning else "")
            found.append(Channel(name, sliding, prismatic, quantity))
    return found


def _refuse_divergence(log: StateLog, body: Body, *, file: str) -> None:
    names = [*_POSITION, *_ORIENTATION, *_VELOCITY, *_OMEGA]
    for letter in _JOINT:
        names += joint_columns(log, letter, body.n_joints)
    values = columns(log, names, rows=body.rows)
    bad = np.argwhere(~np.isfinite(values))
    if bad.size:
        row, column = bad[0]
        count = int(log.records["stepCount"][body.rows[row]])
        raise Diverged(
            f"{names[column]} of body {body.body} is {values[row, column]} from step {count} on",
            expected="finite numbers: the simulation blew up",
            fix="record again with a smaller time step, or cut the log before that step",
            file=file,
            key=names[column],
        )


def _declare(writer: TrajectoryWriter, parts: list[_Part], *, n_frames: int) -> None:
    labels = [label for part in parts for label in part.labels()]
    owners = [(part.body.body, link - 1) for part in parts for link in range(part.n_nodes)]
    fixed = [flag for part in parts for flag in part.fixed()]
    mass = None
    if all(part.model for part in parts):
        mass = [
            value
            for part in parts
            if part.model
            for value in (part.model.base_mass, *(link.mass for link in part.model.links))
        ]
    writer.declare_nodes(
        len(labels),
        3,
        unit="m",
        velocities=True,
        observed=any(part.body.frames.size < n_frames for part in parts),
        mass=mass,
        fixed=fixed,
        labels=labels,
    )
    bars, first = [], 0
    for part in parts:
        links = part.model.links if part.model else ()
        bars += [(first + 1 + link.parent, first + 1 + i) for i, link in enumerate(links)]
        first += part.n_nodes
    if bars:
        writer.declare_elements("bars", np.array(bars))
    for part in parts:
        for channel in part.channels:
            names = [f"body{part.body.body}.{column}" for column in channel.columns]
            writer.declare_channel(
                channel.name, names, unit=channel.unit, quantity=channel.quantity
            )
    writer.declare_extension(DISTRIBUTION, "1")
    writer.put_extension(
        DISTRIBUTION,
        "node_body_link",
        np.array(owners, dtype="i4"),
        comment="unique id of the body and index of the link (-1 the base) of every node",
    )
    for part in parts:
        if part.model and part.model.moving:
            writer.put_extension(
                DISTRIBUTION,
                f"body{part.body.body}.joints",
                [part.model.links[i].joint for i in part.model.moving],
                comment="names of the joints q0, q1, ...",
            )


def _remarks(parts: list[_Part]) -> list[str]:
    found = [
        "the first frame is the state after the first step: the log does not hold the state "
        "before it"
    ]
    bare = [str(part.body.body) for part in parts if part.body.n_joints and part.model is None]
    if bare:
        found.append(
            f"no model of bodies {', '.join(bare)}: the nodes are bases only, and the joint "
            "channels have the unit arb because the log does not tell revolute (rad) from "
            "prismatic (m); name it with urdf"
        )
    for part in parts:
        if part.model and part.model.undecided:
            found.append(
                f"the links of body {part.body.body} would stand elsewhere if the script loaded it "
                f"with {' or '.join(part.model.undecided)}, which the log does not show; say so "
                "with urdf_flags"
            )
    partial = [str(p.body.body) for p in parts if p.body.frames.size < _longest(parts)]
    if partial:
        found.append(f"bodies {', '.join(partial)} were not logged in every step")
    return found


def _longest(parts: list[_Part]) -> int:
    return max(part.body.frames.size for part in parts)
