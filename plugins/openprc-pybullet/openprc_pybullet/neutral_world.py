"""Point masses in a Bullet world whose own physics is switched off, every setting by name."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from types import ModuleType

    from numpy.typing import NDArray

    Reals = NDArray[np.float64]

#: Bullet cuts velocities off at 100 m/s unless told otherwise.
NO_CLAMP = 1e300
NO_SHAPE = -1
BASE = -1
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


class NeutralWorld:
    """N point masses that only external forces move.

    Nothing is left to defaults, which falsify physics: Bullet's own damping (0.04 on linear and
    angular velocity), sleeping, the limit on velocities, gravity, and sub-steps, over which a
    force from outside would be held.

    Parameters
    ----------
    pybullet : module
    client : int
        Of a fresh server.
    step : float [s]
    positions, velocities : (N, 3) [m], [m/s]
    masses : (N,) [kg]
        0 for nodes that Bullet does not move: fixed ones, and those whose motion is prescribed.
    """

    def __init__(
        self,
        pybullet: ModuleType,
        client: int,
        *,
        step: float,
        positions: Reals,
        velocities: Reals,
        masses: Reals,
    ) -> None:
        self._bullet: Any = pybullet
        self._client = client
        neutralise(pybullet, client, step=step)
        self.bodies = [
            self._add(*node)
            for node in zip(masses.tolist(), positions.tolist(), velocities.tolist(), strict=True)
        ]
        #: Numbers of the nodes that Bullet moves.
        self.rows: NDArray[np.int64] = np.flatnonzero(masses > 0.0)
        self._moving = [self.bodies[row] for row in self.rows]

    def _add(self, mass: float, position: list[float], velocity: list[float]) -> int:
        bullet, client = self._bullet, self._client
        body: int = bullet.createMultiBody(
            baseMass=mass,
            baseCollisionShapeIndex=NO_SHAPE,
            baseVisualShapeIndex=NO_SHAPE,
            basePosition=position,
            baseOrientation=UPRIGHT,
            physicsClientId=client,
        )
        bullet.changeDynamics(
            body,
            BASE,
            linearDamping=0.0,
            angularDamping=0.0,
            maxJointVelocity=NO_CLAMP,
            activationState=bullet.ACTIVATION_STATE_DISABLE_SLEEPING,
            physicsClientId=client,
        )
        if mass > 0.0 and any(velocity):
            bullet.resetBaseVelocity(body, velocity, (0.0, 0.0, 0.0), physicsClientId=client)
        return body

    def step(self, positions: Reals, forces: Reals) -> None:
        """Advance by one step under forces (N, 3) [N] on the nodes at `positions` (N, 3) [m]."""
        push, frame, client = (
            self._bullet.applyExternalForce,
            self._bullet.WORLD_FRAME,
            self._client,
        )
        at, by = positions[self.rows].tolist(), forces[self.rows].tolist()
        for body, point, force in zip(self._moving, at, by, strict=True):
            push(body, BASE, force, point, frame, client)
        self._bullet.stepSimulation(client)

    def read_positions(self, out: Reals) -> None:
        """Write the positions of moving nodes to `out` (N, 3) [m]."""
        read, client = self._bullet.getBasePositionAndOrientation, self._client
        if self._moving:
            out[self.rows] = [read(body, client)[0] for body in self._moving]

    def read_velocities(self, out: Reals) -> None:
        """Write the velocities of moving nodes to `out` (N, 3) [m/s]."""
        read, client = self._bullet.getBaseVelocity, self._client
        if self._moving:
            out[self.rows] = [read(body, client)[0] for body in self._moving]

    def put(self, row: int, position: Reals, velocity: Reals) -> None:
        """Put a node somewhere (3,) [m] with a velocity (3,) [m/s]."""
        bullet, client, body = self._bullet, self._client, self.bodies[row]
        # Placing a body takes its velocity away, so that comes second.
        bullet.resetBasePositionAndOrientation(body, position.tolist(), UPRIGHT, client)
        bullet.resetBaseVelocity(body, velocity.tolist(), (0.0, 0.0, 0.0), physicsClientId=client)


def neutralise(pybullet: ModuleType, client: int, *, step: float) -> None:
    """Set every parameter of the engine that could act on a point mass, or on repeatability."""
    bullet: Any = pybullet
    bullet.setGravity(0.0, 0.0, 0.0, physicsClientId=client)
    bullet.setRealTimeSimulation(0, physicsClientId=client)
    bullet.setPhysicsEngineParameter(
        fixedTimeStep=step,
        numSubSteps=0,
        numSolverIterations=1,
        deterministicOverlappingPairs=1,
        solverResidualThreshold=0.0,
        erp=0.0,
        contactERP=0.0,
        frictionERP=0.0,
        globalCFM=0.0,
        physicsClientId=client,
    )
