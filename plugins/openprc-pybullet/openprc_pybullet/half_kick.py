"""The loop over steps: what turns Bullet's semi-implicit Euler scheme into leapfrog.

Bullet takes ``v += h a(x, v)``, ``x += h v``. Started with the velocity of half a step earlier,
``v0 - a0 h / 2``, the same steps are those of the leapfrog scheme (Verlet 1967,
doi:10.1103/PhysRev.159.98), of second order: Bullet's velocities are those in the middle of
steps, and the velocity at a step's end is that plus ``a h / 2``. Forces that depend on velocity
are given the one predicted for the same instant with the last acceleration, as velocity Verlet
does (Swope et al. 1982, doi:10.1063/1.442716), which keeps the order.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from openprc_pybullet.neutral_world import NeutralWorld

if TYPE_CHECKING:
    from types import ModuleType

    from numpy.typing import NDArray

    from openprc.demlat.forces import ForceField
    from openprc.schema import Experiment

    Reals = NDArray[np.float64]


class HalfKickLoop:
    """Steps a body of point masses in Bullet under the forces of a field.

    Parameters
    ----------
    pybullet, client : module, int
        A fresh server.
    experiment : Experiment
    field : ForceField
        Of that experiment.
    half_kick : bool
        False: start with the velocities as they are, which leaves semi-implicit Euler.

    Attributes
    ----------
    positions, velocities : (N, 3) [m], [m/s]
        At `time`; without a half kick, velocities are Bullet's own.
    ledger : (5,) or (6,) [J]
        Integrals of `ForceField.power`.
    """

    def __init__(
        self,
        pybullet: ModuleType,
        client: int,
        *,
        experiment: Experiment,
        field: ForceField,
        half_kick: bool,
    ) -> None:
        geometry = experiment.geometry
        self.field = field
        self.half_kick = half_kick
        self.step = experiment.save_interval / experiment.steps_per_frame
        self.number = 0
        self._kick = 0.5 * self.step if half_kick else 0.0
        held = experiment.held_axes
        self._free = (~held).astype(np.float64)
        masses = np.where(held.all(axis=1), 0.0, geometry.masses)
        self._inverse_mass = self._free / np.where(masses > 0.0, masses, 1.0)[:, np.newaxis]
        driven = held & ~geometry.fixed[:, np.newaxis]
        self._driven = driven
        self._is_driven = bool(driven.any())
        # Where a wholly driven node is matters to the forces only, and placing a body takes
        # Bullet a time that grows with the number of bodies.
        self._placed_rows = np.flatnonzero(driven.any(axis=1) & ~held.all(axis=1))
        self._driven_mass = np.where(driven, geometry.masses[:, np.newaxis], 0.0)
        self.positions = geometry.positions.copy()
        self.velocities = geometry.velocities.copy()
        self.ledger = np.zeros_like(field.power)
        self._force = np.zeros_like(self.positions)
        self._push = np.zeros_like(self.positions)
        self._drift = np.zeros_like(self.positions)
        field.place(self.positions, self.velocities)
        self._evaluate("after")
        self._acceleration = self._force * self._inverse_mass
        np.multiply(self._force, self._free, out=self._push)
        self._drift[...] = self.velocities - self._kick * self._acceleration
        self._power = self._powers()
        self._driven_energy = self._energy_of_driven()
        self.world = NeutralWorld(
            pybullet,
            client,
            step=self.step,
            positions=self.positions,
            velocities=self._drift,
            masses=masses,
        )

    @property
    def time(self) -> float:
        """Where the body is [s]."""
        return self.number * self.step

    def advance(self, count: int) -> None:
        """Take `count` steps; after the last one velocities are up to date."""
        coasting = 0 if self.field.needs_velocities else count - 1
        for _ in range(coasting):
            self._coast()
        for _ in range(count - coasting):
            self._advance()

    def _coast(self) -> None:
        """Take a step in which nothing depends on velocities, and nothing is driven."""
        self.world.step(self.positions, self._push)
        self.number += 1
        self.world.read_positions(self.positions)
        self.field(self.positions, self.velocities, out=self._push)

    def _advance(self) -> None:
        world, field = self.world, self.field
        world.step(self.positions, self._push)
        self.number += 1
        world.read_positions(self.positions)
        world.read_velocities(self._drift)
        self._synchronise()  # with the acceleration of the last step: a prediction
        self._evaluate("before")
        np.multiply(self._force, self._inverse_mass, out=self._acceleration)
        np.multiply(self._force, self._free, out=self._push)
        power = self._powers()
        self.ledger += 0.5 * self.step * (self._power + power)
        self._power = power
        self._synchronise()
        if field.may_jump(self.time):
            self._cross_jump()
        self._drift[self._driven] = self.velocities[self._driven]
        for row in self._placed_rows:
            world.put(row, self.positions[row], self._drift[row])

    def _synchronise(self) -> None:
        """Bring velocities from the middle of the last step to its end."""
        np.multiply(self._acceleration, self._kick, out=self.velocities)
        self.velocities += self._drift
        self.field.place(self.positions, self.velocities, time=self.time, side="before")

    def _cross_jump(self) -> None:
        """Go on with the force after a jump; half of a full kick is that of before it."""
        field, before = self.field, self.positions.copy()
        field.place(self.positions, self.velocities, time=self.time)
        if not np.array_equal(before, self.positions):
            gained = field.energies(self.positions, self.velocities)[1:].sum()
            self.ledger[0] += gained - field.energies(before, self.velocities)[1:].sum()
        self._evaluate("after")
        np.multiply(self._force, self._inverse_mass, out=self._acceleration)
        share = 0.5 if self.half_kick else 0.0
        self._push *= share
        self._push += (1.0 - share) * self._force * self._free
        self._power = self._powers()

    def _evaluate(self, side: str) -> None:
        self.field(self.positions, self.velocities, time=self.time, side=side, out=self._force)

    def _powers(self) -> Reals:
        """Return the powers of the ledger [W], with what moving driven nodes takes."""
        power = self.field.power.copy()
        if self._is_driven:
            power[0] -= float((self._force * self.velocities)[self._driven].sum())
        return power

    def _energy_of_driven(self) -> float:
        return 0.5 * float((self._driven_mass * self.velocities**2).sum())

    @property
    def balance(self) -> Reals:
        """The ledger as it is stored: work includes what moves the driven masses [J]."""
        ledger = self.ledger.copy()
        ledger[0] += self._energy_of_driven() - self._driven_energy
        return ledger
