"""A small run in PyBullet's own format: a driven pendulum, logged by its state logger.

A short crank hangs from the fixed base and carries two double pendulums, whose lower links turn
about axes 16 degrees off the others, so that the motion is spatial. A torque on the crank holds
one symbol after the other; gravity and joint damping make the body a nonlinear filter with a
memory of a few symbols. Lengths, dampings and torque come from a random search for a body whose
link positions, read at the end of each symbol, carry the NARMA2 task better than any linear
combination of the symbols does; they were then rounded, and halving the time step changes the
score by less than 0.01.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from openprc.hooks import Sample
from openprc_pybullet.client import direct_client, quiet


@dataclass(frozen=True, slots=True)
class Pendulum:
    """The body, its drive and its clock.

    Parameters
    ----------
    parents : tuple of int
        Index of the link that each one hangs from, -1 for the base; a link hangs from the
        lower end of its parent.
    lengths : tuple of float
        Of the links, in m.
    axes : tuple of (x, y, z)
        Unit vectors that the joints turn about, in the frame of the parent.
    dampings : tuple of float
        Of the joints, in N*m*s/rad.
    mass : float
        Of every link, in kg.
    torque : float
        Range of the torque on the first joint, in N*m, for symbols from 0 to 0.5.
    rest : float
        Fraction of the symbol range at which the torque is zero.
    dt : float
        Time step in s.
    hold_steps : int
        Steps a symbol is held.
    gravity : float
        In m/s2.
    """

    parents: tuple[int, ...]
    lengths: tuple[float, ...]
    axes: tuple[tuple[float, float, float], ...]
    dampings: tuple[float, ...]
    mass: float
    torque: float
    rest: float
    dt: float = 1 / 240
    hold_steps: int = 24
    gravity: float = 9.81


#: What `write_sample` records.
PENDULUM = Pendulum(
    parents=(-1, 0, 1, 0, 3),
    lengths=(0.04, 0.4, 0.04, 0.2, 0.1),
    axes=((0, 1, 0), (0, 1, 0), (0.28, 0.96, 0), (0, 1, 0), (-0.28, 0.96, 0)),
    dampings=(0.0012, 0.003, 0.0001, 0.004, 0.003),
    mass=0.1,
    torque=0.19,
    rest=0.4,
)
N_SYMBOLS = 600
SEED = 7


def write_sample(folder: Path) -> Sample:
    """Simulate the pendulum, log it, and say how to import it.

    The symbols are independent and uniform in [0, 0.5]. Symbol k acts on steps ``24 k`` to
    ``24 k + 23``, that is from ``0.1 k`` to ``0.1 (k + 1)`` s.

    Raises
    ------
    MissingDependency
        When PyBullet is not installed.
    """
    folder = Path(folder)
    symbols = np.random.default_rng(SEED).uniform(0.0, 0.5, N_SYMBOLS)
    with direct_client("recording the PyBullet sample") as (bullet, client):
        urdf = folder / "pendulum.urdf"
        urdf.write_text(pendulum_urdf(PENDULUM), encoding="utf-8")
        log = folder / "driven_pendulum.log"
        with quiet():
            _record(bullet, client, PENDULUM, symbols, urdf, log)
    return Sample(
        path=log,
        options={"urdf": (str(urdf),)},
        inputs={
            "u": {
                "sequence": symbols[:, np.newaxis],
                "hold": PENDULUM.hold_steps * PENDULUM.dt,
                "start": 0.0,
                "unit": "1",
                "quantity": "torque on the first joint, scaled",
            }
        },
    )


def pendulum_urdf(body: Pendulum) -> str:
    """Return the model as URDF: thin rods that hang along -z, massless joints."""
    parts = [
        '<?xml version="1.0"?>\n<robot name="pendulum">\n'
        '  <link name="base"><inertial><mass value="0"/>'
        '<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>\n'
    ]
    links = zip(body.parents, body.lengths, body.axes, body.dampings, strict=True)
    for i, (above, length, axis, damping) in enumerate(links, 1):
        across = body.mass * length**2 / 12
        parent, drop = ("base", 0.0) if above < 0 else (f"link{above + 1}", body.lengths[above])
        parts.append(
            f'  <link name="link{i}"><inertial><origin xyz="0 0 {-length / 2:.17g}"/>'
            f'<mass value="{body.mass:.17g}"/><inertia ixx="{across:.17g}" iyy="{across:.17g}" '
            f'izz="{across / 10:.17g}" ixy="0" ixz="0" iyz="0"/></inertial></link>\n'
            f'  <joint name="joint{i}" type="continuous"><parent link="{parent}"/>'
            f'<child link="link{i}"/><origin xyz="0 0 {-drop:.17g}"/>'
            f'<axis xyz="{axis[0]:.17g} {axis[1]:.17g} {axis[2]:.17g}"/>'
            f'<dynamics damping="{damping:.17g}" friction="0"/></joint>\n'
        )
    return "".join(parts) + "</robot>\n"


def _record(
    bullet: ModuleType,
    client: int,
    body: Pendulum,
    symbols: NDArray[np.float64],
    urdf: Path,
    log: Path,
) -> None:
    where = {"physicsClientId": client}
    bullet.setGravity(0, 0, -body.gravity, **where)
    bullet.setPhysicsEngineParameter(fixedTimeStep=body.dt, numSubSteps=0, **where)
    robot = bullet.loadURDF(str(urdf), useFixedBase=True, **where)
    n = len(body.lengths)
    for link in range(-1, n):
        # Bullet damps everything by 0.04 unless told otherwise.
        bullet.changeDynamics(robot, link, linearDamping=0, angularDamping=0, **where)
    # Every joint has a motor that holds it still until its force is set to zero.
    bullet.setJointMotorControlArray(
        robot, range(n), bullet.VELOCITY_CONTROL, forces=[0.0] * n, **where
    )
    logger = bullet.startStateLogging(
        bullet.STATE_LOGGING_GENERIC_ROBOT,
        str(log),
        objectUniqueIds=[robot],
        maxLogDof=n,
        **where,
    )
    for symbol in symbols:
        torque = body.torque * (symbol / 0.5 - body.rest)
        for _ in range(body.hold_steps):
            # A torque acts for one step only.
            bullet.setJointMotorControl2(robot, 0, bullet.TORQUE_CONTROL, force=torque, **where)
            bullet.stepSimulation(**where)
    bullet.stopStateLogging(logger, **where)
