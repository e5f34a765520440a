"""The server whose loop a user's script runs: which one it is, and what must hold of it."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import Any

from openprc.errors import ConfigError, UnsupportedScene
from openprc_pybullet.client import load_pybullet


@dataclass(frozen=True, slots=True)
class Clock:
    """What the server says of its time: step in s, sub-steps, gravity in m/s2."""

    dt: float
    sub_steps: int
    gravity: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Connection:
    """The module and the id that every call has to name; a script may have several servers."""

    bullet: ModuleType
    client: int

    @property
    def is_open(self) -> bool:
        """Whether the server still answers."""
        return bool(self.bullet.getConnectionInfo(self.client)["isConnected"])

    def clock(self) -> Clock:
        """Ask for the time step.

        Raises
        ------
        UnsupportedScene
            When the server steps by itself (``setRealTimeSimulation``).
        """
        values = self.bullet.getPhysicsEngineParameters(self.client)
        if values["useRealTimeSimulation"]:
            raise UnsupportedScene(
                "the server runs in real time: it steps when it likes, and does not tell when",
                expected="a script that steps",
                fix="call setRealTimeSimulation(0) and step with session.step()",
                key="useRealTimeSimulation",
            )
        x, y, z = (float(values[f"gravityAcceleration{axis}"]) for axis in "XYZ")
        return Clock(float(values["fixedTimeStep"]), int(values["numSubSteps"]), (x, y, z))

    def body_ids(self) -> list[int]:
        """Return the ids of all bodies; after removals they have gaps and are out of order."""
        count = self.bullet.getNumBodies(self.client)
        return [self.bullet.getBodyUniqueId(i, self.client) for i in range(count)]

    def mark(self, body: int, name: str) -> int:
        """Put a mark on a body, so that one which takes its id later is told from it.

        It goes with the body and with ``resetSimulation``; the motion does not feel it.
        """
        return int(self.bullet.addUserData(body, name, name, physicsClientId=self.client))

    def unmark(self, mark: int, name: bytes) -> None:
        """Take a mark away, if the server and the body are still there."""
        if self.is_open and self.bullet.getUserData(mark, self.client) == name:
            self.bullet.removeUserData(mark, physicsClientId=self.client)


def connect_to(simulator: Any) -> Connection:
    """Return the connection behind the module, a ``BulletClient``, or the id of a client.

    Raises
    ------
    ConfigError
        When `simulator` is none of these, or is not connected.
    """
    bullet = load_pybullet("recording a simulation")
    client: Any = getattr(simulator, "_client", None)
    if simulator is bullet:
        client = 0
    elif isinstance(simulator, int) and not isinstance(simulator, bool):
        client = simulator
    elif not isinstance(client, int):
        raise ConfigError(
            f"the simulator is a {type(simulator).__name__}",
            expected="the module pybullet, a BulletClient, or the id that connect() returned",
            fix="pass one of them to record_run",
            key="simulator",
        )
    connection = Connection(bullet, client)
    if client < 0 or not connection.is_open:
        raise ConfigError(
            f"client {client} is not connected",
            expected="a connected client",
            fix="call connect(pybullet.DIRECT) and load the scene before recording; with several "
            "clients pass the id of the one to record",
            key="simulator",
        )
    return connection
