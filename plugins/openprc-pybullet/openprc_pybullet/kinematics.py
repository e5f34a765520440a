"""Positions of links from logged joint angles: forward kinematics by PyBullet itself.

The log holds the pose of the base (of its inertial frame) and the joint coordinates. The model
file supplies the rest: link tree, centres of mass, masses, names, joint types.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, UnreadableFile
from openprc_pybullet.client import direct_client, quiet

#: Joint types as PyBullet numbers them.
REVOLUTE, PRISMATIC, FIXED = 0, 1, 4
_MOVING = (REVOLUTE, PRISMATIC)
#: Flags of loadURDF that turn the frame of the base, or number the links in another order.
_TELLING_FLAGS = ("URDF_USE_INERTIA_FROM_FILE", "URDF_MAINTAIN_LINK_ORDER")


def match_models(
    entries: Sequence[str], bodies: Sequence[int], *, log: Path, if_absent: str = "correct the id"
) -> dict[int, Path]:
    """Read ``ID=PATH`` entries, or one bare ``PATH`` when one body is imported.

    A relative path is looked for from the working directory, then beside the log, then among
    the models that come with PyBullet. `if_absent` says what to do about a body that the log
    lacks.

    Raises
    ------
    ConfigError
        When an id is not imported, named twice, or left open with several bodies.
    UnreadableFile
        When there is no such file.
    """
    found: dict[int, Path] = {}
    listed = ", ".join(map(str, bodies))
    for entry in entries:
        labelled = re.fullmatch(r"(\d+)=(.+)", entry)
        if labelled:
            body, name = int(labelled[1]), labelled[2]
        elif len(bodies) == 1:
            body, name = bodies[0], entry
        else:
            raise ConfigError(
                f"{entry!r} does not say which body it is",
                expected=f"ID={entry}, with ID among {listed}",
                fix="name the body, or import one only (bodies)",
                file=log,
                key="urdf",
            )
        if body not in bodies or body in found:
            what = "is named twice" if body in found else "is not imported"
            raise ConfigError(
                f"body {body} {what}",
                expected=f"each of {listed} at most once",
                fix="correct the id" if body in found else if_absent,
                file=log,
                key="urdf",
            )
        found[body] = _locate(name, log)
    return found


def _locate(name: str, log: Path) -> Path:
    path = Path(name).expanduser()
    tried = [path, log.parent / path]
    if not any(candidate.is_file() for candidate in tried) and not path.is_absolute():
        tried += [folder / path for folder in _shipped_models()]
    for candidate in tried:
        if candidate.is_file():
            return candidate
    raise UnreadableFile(
        f"there is no model {name!r}",
        expected="a .urdf, .sdf or MJCF .xml file, found from here, from the folder of the log, "
        "or in pybullet_data",
        fix="check the path",
        file=log,
        key="urdf",
    )


def _shipped_models() -> list[Path]:
    try:
        import pybullet_data  # noqa: PLC0415 - comes with the optional PyBullet
    except ImportError:
        return []
    return [Path(pybullet_data.getDataPath())]


@dataclass(frozen=True, slots=True)
class Link:
    """A link: its name, mass in kg, the index of its parent (-1 the base), its joint's type."""

    name: str
    mass: float
    parent: int
    joint: str
    joint_type: int


class Model:
    """A body loaded into a server of its own, to be posed frame by frame.

    Attributes (once entered)
    -------------------------
    base_name : str
    base_mass : float
        In kg.
    links : tuple of Link
    moving : tuple of int
        Link indices of the revolute and prismatic joints, in the order of ``q0, q1, ...``.
    undecided : tuple of str
        Flags that would move the links, and that the log does not show.
    """

    def __init__(
        self,
        path: Path,
        *,
        body: int,
        n_joints: int,
        flags: Sequence[str] = (),
        scale: float = 1.0,
    ) -> None:
        """Keep what to load, and how; entering the context loads it."""
        self.path = path
        self.body = body
        self.n_joints = n_joints
        self.flags = tuple(flags)
        self.scale = scale
        self.base_name = ""
        self.base_mass = 0.0
        self.links: tuple[Link, ...] = ()
        self.moving: tuple[int, ...] = ()
        self.undecided: tuple[str, ...] = ()

    def __enter__(self) -> Self:
        """Start the server and load the model."""
        self._context = direct_client("computing link positions")
        self._bullet, self._client = self._context.__enter__()
        try:
            self._load()
        except BaseException:
            self._context.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop the server."""
        self._context.__exit__(None, None, None)

    @property
    def rotates(self) -> NDArray[np.bool_]:
        """For each logged joint, whether it is revolute (rad) rather than prismatic (m)."""
        return np.array([self.links[i].joint_type == REVOLUTE for i in self.moving], dtype=bool)

    def poses(
        self,
        base: NDArray[np.float64],
        orientation: NDArray[np.float64],
        *,
        base_velocity: NDArray[np.float64],
        base_omega: NDArray[np.float64],
        q: NDArray[np.float64],
        u: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return centres of mass of all links, and their velocities, in world coordinates.

        Parameters
        ----------
        base : (T, 3) [m]
            Centre of mass of the base.
        orientation : (T, 4)
            Quaternion x, y, z, w of its inertial frame.
        base_velocity : (T, 3) [m/s]
        base_omega : (T, 3) [rad/s]
        q, u : (T, J) [rad or m, rad/s or m/s]

        Returns
        -------
        positions : (T, L, 3) [m]
        velocities : (T, L, 3) [m/s]
        """
        p, c, body = self._bullet, self._client, self._id
        n_links = len(self.links)
        positions = np.empty((len(base), n_links, 3))
        velocities = np.empty_like(positions)
        every = list(range(n_links))
        for t in range(len(base)):
            p.resetBasePositionAndOrientation(body, base[t], orientation[t], physicsClientId=c)
            p.resetBaseVelocity(body, base_velocity[t], base_omega[t], physicsClientId=c)
            for joint, angle, rate in zip(self.moving, q[t], u[t], strict=True):
                p.resetJointState(body, joint, angle, rate, physicsClientId=c)
            if not every:
                continue
            # Without computeForwardKinematics the poses of the call before come back.
            states = p.getLinkStates(
                body, every, computeLinkVelocity=1, computeForwardKinematics=1, physicsClientId=c
            )
            for link, state in enumerate(states):
                positions[t, link] = state[0]
                velocities[t, link] = state[6]
        return positions, velocities

    def _load(self) -> None:
        with quiet():
            loaded = self._load_bodies(self._bullet, self._client)
        fitting = [item for item in loaded if self._count(item) == self.n_joints]
        if len(fitting) != 1:
            counts = ", ".join(str(self._count(item)) for item in loaded) or "no body"
            raise UnreadableFile(
                f"the model has {counts} revolute and prismatic joints, body {self.body} of the "
                f"log has {self.n_joints}",
                expected="the model that was logged",
                fix="name the file that the script loaded, or correct the id in urdf",
                file=self.path,
                key=f"body {self.body}",
            )
        self._id = fitting[0]
        p, c = self._bullet, self._client
        self.base_name = p.getBodyInfo(self._id, physicsClientId=c)[0].decode() or "base"
        self.base_mass = float(p.getDynamicsInfo(self._id, -1, physicsClientId=c)[0])
        links = []
        for joint in range(p.getNumJoints(self._id, physicsClientId=c)):
            info = p.getJointInfo(self._id, joint, physicsClientId=c)
            mass = float(p.getDynamicsInfo(self._id, joint, physicsClientId=c)[0])
            links.append(Link(info[12].decode(), mass, info[16], info[1].decode(), info[2]))
        self.links = tuple(links)
        self.moving = tuple(i for i, link in enumerate(links) if link.joint_type in _MOVING)
        self.undecided = self._telling_flags()

    def _load_bodies(self, p: ModuleType, client: int) -> list[int]:
        name = str(self.path)
        try:
            if self.path.suffix.lower() == ".sdf":
                return list(p.loadSDF(name, physicsClientId=client))
            if self.path.suffix.lower() in (".xml", ".mjcf"):
                return list(p.loadMJCF(name, physicsClientId=client))
            # Meshes are often not where the model says, and kinematics does without them.
            return [self._load_urdf(p, client, self.flags)]
        except p.error as error:
            raise UnreadableFile(
                f"PyBullet cannot load the model: {error}",
                expected="a .urdf, .sdf or MJCF .xml file that PyBullet loads",
                fix="load it in PyBullet and see what it prints",
                file=self.path,
                key=f"body {self.body}",
            ) from error

    def _load_urdf(self, p: ModuleType, client: int, flags: Sequence[str]) -> int:
        bits = p.URDF_IGNORE_VISUAL_SHAPES | p.URDF_IGNORE_COLLISION_SHAPES
        for flag in flags:
            bits |= getattr(p, flag)
        body: int = p.loadURDF(
            str(self.path), flags=bits, globalScaling=self.scale, physicsClientId=client
        )
        return body

    def _telling_flags(self) -> tuple[str, ...]:
        """Return the flags with which base frame or order of links would be different."""
        if self.path.suffix.lower() != ".urdf":
            return ()
        p, c = self._bullet, self._client
        found = []
        for flag in _TELLING_FLAGS:
            if flag in self.flags:
                continue
            try:
                with quiet():
                    other = self._load_urdf(p, c, (*self.flags, flag))
            except p.error:  # then no script loaded it so either
                continue
            if self._shape_of(other) != self._shape_of(self._id):
                found.append(flag)
            p.removeBody(other, physicsClientId=c)
        return tuple(found)

    def _shape_of(self, item: int) -> tuple[Any, ...]:
        p, c = self._bullet, self._client
        joints = range(p.getNumJoints(item, physicsClientId=c))
        names = tuple(p.getJointInfo(item, joint, physicsClientId=c)[1] for joint in joints)
        frame = p.getDynamicsInfo(item, -1, physicsClientId=c)[4]
        return names, tuple(round(value, 9) for value in frame)

    def _count(self, item: Any) -> int:
        p, c = self._bullet, self._client
        types = (
            p.getJointInfo(item, joint, physicsClientId=c)[2]
            for joint in range(p.getNumJoints(item, physicsClientId=c))
        )
        return sum(kind in _MOVING for kind in types)
