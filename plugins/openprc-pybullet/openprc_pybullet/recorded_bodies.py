"""Rigid and articulated bodies of a running scene: nodes, joints, and how a frame is read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from openprc_pybullet.kinematics import FIXED, PRISMATIC, REVOLUTE, Link
from openprc_pybullet.recorded_client import Connection
from openprc_pybullet.recorded_parts import Channel, Nodes, Values

NodeChoice = Literal["com", "frame"]
NODE_CHOICES: tuple[NodeChoice, ...] = ("com", "frame")

#: How PyBullet numbers kinds of bodies in ``getDynamicsInfo(...)[10]``.
MAXIMAL, MULTIBODY, SOFT = 1, 2, 3
SPHERICAL, PLANAR = 2, 3
#: Position of the base, its quaternion, velocity, and angular velocity.
_BASE = 13
_JOINT = (
    ("q", "rad", "m", "joint position"),
    ("u", "rad/s", "m/s", "joint velocity"),
    ("t", "N*m", "N", "torque of the joint motor in the step before"),
)


@dataclass(frozen=True, slots=True)
class BodyTree:
    """What PyBullet tells of a body once and for all.

    Parameters
    ----------
    body : int
        Unique id.
    kind : int
        `MAXIMAL`, `MULTIBODY` or `SOFT`.
    name : str
        Of the base link.
    mass : float
        Of the base [kg]; 0 means that it is held.
    links : tuple of Link
    centres : (1 + L, 3) [m]
        Centres of mass of base and links in their URDF link frames.
    axes : (1 + L, 4)
        Quaternions x, y, z, w of their inertial frames in these.
    """

    body: int
    kind: int
    name: str
    mass: float
    links: tuple[Link, ...]
    centres: NDArray[np.float64]
    axes: NDArray[np.float64]

    @property
    def moves(self) -> bool:
        """Whether there is anything to record: a free base, a joint that is not welded."""
        return self.mass > 0 or any(link.joint_type != FIXED for link in self.links)


def describe_body(connection: Connection, body: int) -> BodyTree:
    """Ask for names, masses and joints of a body."""
    p, c = connection.bullet, connection.client
    base = p.getDynamicsInfo(body, -1, c)
    frames, links = [base[3:5]], []
    for joint in range(p.getNumJoints(body, c)):
        info = p.getJointInfo(body, joint, c)
        dynamics = p.getDynamicsInfo(body, joint, c)
        frames.append(dynamics[3:5])
        name, joint_name = _text(info[12]), _text(info[1])
        links.append(Link(name, float(dynamics[0]), info[16], joint_name, info[2]))
    name = _text(p.getBodyInfo(body, c)[0]) or "base"
    centres, axes = (np.array(values) for values in zip(*frames, strict=True))
    return BodyTree(body, base[10], name, float(base[0]), tuple(links), centres, axes)


def _text(name: bytes) -> str:
    return name.decode("utf-8", "replace")


class RigidPart:
    """A body whose base and links become nodes.

    Parameters
    ----------
    connection : Connection
    tree : BodyTree
    nodes : {"com", "frame"}
        Centres of mass, or the URDF link frames, whose origins are the joints.
    joints : bool
        Whether joint positions, velocities and motor torques become channels.
    """

    def __init__(
        self, connection: Connection, tree: BodyTree, *, nodes: NodeChoice, joints: bool
    ) -> None:
        self.tree = tree
        self._connection = connection
        self._choice = nodes
        self._links = list(range(len(tree.links)))
        self._moving = [
            i for i in self._links if joints and tree.links[i].joint_type in (REVOLUTE, PRISMATIC)
        ]
        self._per_link = 6 if nodes == "com" else 13
        self.nodes = _nodes_of(tree)
        self.channels = _channels_of(tree, self._moving)
        self.width = _BASE + self._per_link * len(self._links) + 3 * len(self._moving)
        #: Appends base, links and joints to a row.
        self.read = self._reader()

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints ``q0, q1, ...``."""
        return tuple(self.tree.links[i].joint for i in self._moving)

    def _reader(self) -> Callable[[list[float]], None]:
        """Make what runs in every step, with every name at hand that it needs.

        A row is extended by whole tuples, which is quicker than anything that looks at single
        numbers. Without forward kinematics PyBullet returns the link poses of the step before.
        """
        p, c, body = self._connection.bullet, self._connection.client, self.tree.body
        pose_of, speed_of = p.getBasePositionAndOrientation, p.getBaseVelocity
        links_of, joints_of = p.getLinkStates, p.getJointStates
        links, moving, frames = self._links, self._moving, self._choice == "frame"

        def read(row: list[float]) -> None:
            position, orientation = pose_of(body, c)
            velocity, omega = speed_of(body, c)
            row += position
            row += orientation
            row += velocity
            row += omega
            if frames and links:
                for state in links_of(body, links, 1, 1, c):
                    row += state[0]
                    row += state[6]
                    row += state[1]
                    row += state[7]
            elif links:
                for state in links_of(body, links, 1, 1, c):
                    row += state[0]
                    row += state[6]
            if moving:
                q, u, _, t = zip(*joints_of(body, moving, c), strict=True)
                row += q
                row += u
                row += t

        return read

    def values(self, block: NDArray[np.float64]) -> Values:
        """Sort a block into nodes and channels."""
        rows, n_links = len(block), len(self._links)
        orientation, omega = block[:, 3:7], block[:, 10:13]
        stop = _BASE + self._per_link * n_links
        links = block[:, _BASE:stop].reshape(rows, n_links, self._per_link)
        position, velocity = block[:, 0:3], block[:, 7:10]
        at, speed = links[..., 0:3], links[..., 3:6]
        if self._choice == "frame":
            # PyBullet rounds its own link frames to single precision, and has no velocities of
            # theirs: both follow from the pose of the centre of mass.
            centres, axes = self.tree.centres, self.tree.axes
            back = -_to_centre(orientation, centres[0], axes[0])
            position, velocity = position + back, velocity + np.cross(omega, back)
            back = -_to_centre(links[..., 6:10], centres[1:], axes[1:])
            at, speed = at + back, speed + np.cross(links[..., 10:13], back)
        prefix = f"body{self.tree.body}"
        channels = {f"{prefix}.orientation": orientation, f"{prefix}.omega": omega}
        joints = block[:, stop:].reshape(rows, 3, len(self._moving))
        turns = _turns(self.tree, self._moving)
        for k, (letter, *_) in enumerate(_JOINT):
            for flag, name in _joint_channels(prefix, letter, turns):
                channels[name] = joints[:, k, turns == flag]
        return Values(
            np.concatenate([position[:, np.newaxis], at], axis=1),
            np.concatenate([velocity[:, np.newaxis], speed], axis=1),
            channels,
        )


def _nodes_of(tree: BodyTree) -> Nodes:
    names = [tree.name, *(link.name for link in tree.links)]
    unique = [f"{name}#{i - 1}" if name in names[:i] else name for i, name in enumerate(names)]
    fixed = [tree.mass == 0]
    for link in tree.links:
        fixed.append(fixed[link.parent + 1] and link.joint_type == FIXED)
    return Nodes(
        labels=tuple(f"body{tree.body}.{name}" for name in unique),
        owners=tuple((tree.body, i - 1) for i in range(len(names))),
        masses=(tree.mass, *(link.mass for link in tree.links)),
        fixed=tuple(fixed),
        bars=tuple((link.parent + 1, i + 1) for i, link in enumerate(tree.links)),
    )


def _channels_of(tree: BodyTree, moving: Sequence[int]) -> tuple[Channel, ...]:
    prefix = f"body{tree.body}"
    quaternion = tuple(f"{prefix}.ori{axis}" for axis in "XYZW")
    omega = tuple(f"{prefix}.omega{axis}" for axis in "XYZ")
    found = [
        Channel(f"{prefix}.orientation", quaternion, "1", "quaternion x, y, z, w"),
        Channel(f"{prefix}.omega", omega, "rad/s", "angular velocity of the base"),
    ]
    turns = _turns(tree, moving)
    for letter, turning, sliding, quantity in _JOINT:
        for flag, name in _joint_channels(prefix, letter, turns):
            columns = tuple(f"{prefix}.{letter}{k}" for k in np.flatnonzero(turns == flag))
            found.append(Channel(name, columns, turning if flag else sliding, quantity))
    return tuple(found)


def _turns(tree: BodyTree, moving: Sequence[int]) -> NDArray[np.bool_]:
    return np.array([tree.links[i].joint_type == REVOLUTE for i in moving], dtype=bool)


def _joint_channels(prefix: str, letter: str, turns: NDArray[np.bool_]) -> list[tuple[bool, str]]:
    """Name the channel of the revolute joints and that of the sliding ones, where there are."""
    found = [(True, f"{prefix}.{letter}")] if turns.any() else []
    if not turns.all():
        found.append((False, f"{prefix}.{letter}" + ("_prismatic" if turns.any() else "")))
    return found


def _to_centre(
    orientation: NDArray[np.float64], centre: NDArray[np.float64], axes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return, in world axes, the way (..., 3) [m] from a URDF link frame to the centre of mass.

    `orientation` (..., 4) is that of the inertial frame, which is turned by `axes` against the
    link frame, in which `centre` is given.
    """
    local = _rotate(axes * np.array([-1.0, -1.0, -1.0, 1.0]), centre)
    return _rotate(orientation, local)


def _rotate(quaternion: NDArray[np.float64], vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn a vector by unit quaternions x, y, z, w: ``v + 2 w (r x v) + 2 r x (r x v)``."""
    axis, w = quaternion[..., :3], quaternion[..., 3:]
    across = np.cross(axis, vector)
    turned: NDArray[np.float64] = vector + 2.0 * (w * across + np.cross(axis, across))
    return turned
