# ruff: noqa: TID253 - this file is the simulator's side of a run; it is loaded when one begins
"""The rods of an experiment in PyElastica: built, held, driven, damped, and stepped."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import elastica as ea
import numpy as np

from openprc_pyelastica.chains import Chain, sort_chains
from openprc_pyelastica.held_parts import Held, held_parts
from openprc_pyelastica.node_drives import Drives, drives_of
from openprc_pyelastica.rod_material import RodMaterial, material_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema import Experiment

#: Steps of which forces and motions are looked up at once.
TABLE_STEPS = 4096


class _Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing):
    """The features of PyElastica that are used."""


class _NodeForces(ea.NoForces):  # type: ignore[misc]
    """Adds forces that the scene writes into an array before every step."""

    def __init__(self, forces: NDArray[np.float64]) -> None:
        super().__init__()
        self.forces = forces

    def apply_forces(self, system: Any, time: float = 0.0) -> None:
        system.external_forces += self.forces


class _ConstantSection(ea.NoForces):  # type: ignore[misc]
    """Makes up for the section that thins: from the tension ``EA (e - 1) / e`` to ``EA (e - 1)``.

    A spring beside every element, whose force depends on the stretch e alone.
    """

    def __init__(self, stretch: NDArray[np.float64]) -> None:
        super().__init__()
        self.stretch = stretch

    def apply_forces(self, system: Any, time: float = 0.0) -> None:
        # Both are of this instant: internal forces are computed just before.
        e = system.dilatation
        more = self.stretch * (e - 1.0) ** 2 / e * system.tangents
        system.external_forces[:, :-1] += more
        system.external_forces[:, 1:] -= more


class _Motion:
    """Where driven coordinates of one rod are in the middle and at the end of a step."""

    def __init__(self, at: NDArray[np.int64]) -> None:
        self.nodes, self.axes = at[:, 0], at[:, 1]
        self.middle = self.end = self.rate = np.zeros(len(at))
        self.switch = -np.inf


class _AfterKick(ea.ConstraintBase):  # type: ignore[misc]
    """Damps the rates, keeps nodes and elements where they are, moves driven coordinates.

    Damping multiplies by ``exp(-rate dt)``, which is exact for uniform damping, as PyElastica's
    analytical damper does. Dampers are not used for it: 0.3.3 registers them and never calls them.
    """

    def __init__(self, held: Held, motion: _Motion, factor: float, **own: Any) -> None:
        super().__init__(**own)
        self.nodes, self.elements = np.flatnonzero(held.nodes), np.flatnonzero(held.elements)
        self.motion, self.factor = motion, factor
        self.places = self._system.position_collection[:, self.nodes].copy()
        self.turned = self._system.director_collection[..., self.elements].copy()

    def constrain_values(self, system: Any, time: float) -> None:
        motion = self.motion
        if len(self.nodes):
            system.position_collection[:, self.nodes] = self.places
        if len(self.elements):
            system.director_collection[..., self.elements] = self.turned
        if len(motion.nodes):
            where = motion.middle if time < motion.switch else motion.end
            system.position_collection[motion.axes, motion.nodes] = where

    def constrain_rates(self, system: Any, time: float) -> None:
        motion = self.motion
        if self.factor != 1.0:
            system.velocity_collection *= self.factor
            system.omega_collection *= self.factor
        if len(self.nodes):
            system.velocity_collection[:, self.nodes] = 0.0
        if len(self.elements):
            system.omega_collection[:, self.elements] = 0.0
        if len(motion.nodes):
            system.velocity_collection[motion.axes, motion.nodes] = motion.rate


class RodScene:
    """All rods of an experiment.

    Parameters
    ----------
    experiment : Experiment
    options : mapping
        As `openprc_pyelastica.rod_material.checked_options` returns them.
    dt : float [s]
    """

    def __init__(self, experiment: Experiment, *, options: Mapping[str, Any], dt: float) -> None:
        geometry = experiment.geometry
        self.dt = dt
        self.steps = 0
        self._simulator = _Simulator()
        self._stepper = ea.PositionVerlet()
        self._forces = drives_of(experiment, forces=True)
        self._motions = drives_of(experiment, forces=False)
        self._table: _Table | None = None
        self._weight = np.array(experiment.gravity)[:, np.newaxis] * geometry.masses
        self._driving = np.zeros((3, geometry.n_nodes))
        self.parts: list[_Part] = []
        positions = geometry.positions.copy()
        velocities = geometry.velocities.copy()
        velocities[geometry.fixed] = 0.0
        at = self._motions.at
        if len(at):
            start = np.zeros(1)
            positions[at[:, 0], at[:, 1]] = self._motions.values(start)[0]
            velocities[at[:, 0], at[:, 1]] = self._motions.rates(start)[0]
        massive = geometry.masses > 0.0
        rate = experiment.damping / geometry.masses[massive].mean() if massive.any() else 0.0
        for chain in sort_chains(geometry).chains:
            material = material_of(chain, experiment, options=options)
            held = held_parts(chain, experiment, clamp=options["clamp"])
            rod = _rod(positions[chain.nodes], velocities[chain.nodes], material)
            self._simulator.append(rod)
            part = _Part(chain, held, material, rod, self._motions)
            if held.nodes.any() or held.elements.any() or len(part.motion.nodes) or rate:
                factor = float(np.exp(-rate * dt))
                self._simulator.constrain(rod).using(_AfterKick, held, part.motion, factor)
            if self._weight.any() or len(self._forces):
                self._simulator.add_forcing_to(rod).using(_NodeForces, part.forces)
            if options["section"] == "constant":
                self._simulator.add_forcing_to(rod).using(_ConstantSection, material.stretch)
            part.forces[:] = self._weight[:, chain.nodes]
            self.parts.append(part)
        self._simulator.finalize()

    def advance(self, steps: int) -> None:
        """Take so many steps."""
        for _ in range(steps):
            if len(self._forces) or len(self._motions):
                self._drive()
            # Not the time that the last step returned, which is a sum with its rounding.
            self._stepper.step(self._simulator, np.float64(self.steps * self.dt), self.dt)
            self.steps += 1

    def _drive(self) -> None:
        table = self._table
        if table is None or not table.first <= self.steps < table.first + TABLE_STEPS:
            table = self._table = _Table(self.steps, self.dt, self._forces, self._motions)
        row = self.steps - table.first
        if len(self._forces):
            self._driving[:] = self._weight
            at = self._forces.at
            # add.at, since several actuators may push one node.
            np.add.at(self._driving, (at[:, 1], at[:, 0]), table.forces[row])
        for part in self.parts:
            if len(self._forces):
                part.forces[:] = self._driving[:, part.chain.nodes]
            motion = part.motion
            if len(motion.nodes):
                motion.switch = (self.steps + 0.75) * self.dt
                motion.middle = table.middle[row, part.columns]
                motion.end = table.end[row, part.columns]
                motion.rate = table.rate[row, part.columns]

    def state(self, positions: NDArray[np.float64], velocities: NDArray[np.float64]) -> None:
        """Write the state of all nodes into two arrays: (N, 3) [m], (N, 3) [m/s]."""
        for part in self.parts:
            positions[part.chain.nodes] = part.rod.position_collection.T
            velocities[part.chain.nodes] = part.rod.velocity_collection.T


class _Part:
    """One rod of a scene."""

    def __init__(
        self, chain: Chain, held: Held, material: RodMaterial, rod: Any, motions: Drives
    ) -> None:
        self.chain, self.held, self.material, self.rod = chain, held, material, rod
        self.forces = np.zeros((3, len(chain.nodes)))
        place = {int(node): index for index, node in enumerate(chain.nodes)}
        self.columns = np.array(
            [number for number, (node, _) in enumerate(motions.at) if int(node) in place],
            dtype=np.int64,
        )
        mine = motions.at[self.columns].copy()
        mine[:, 0] = [place[int(node)] for node in mine[:, 0]]
        self.motion = _Motion(mine)
        if len(mine):
            start = np.zeros(1)
            self.motion.end = motions.values(start)[0, self.columns]
            self.motion.rate = motions.rates(start)[0, self.columns]


class _Table:
    """Forces in the middle of steps, motions in the middle and at the end of them."""

    def __init__(self, first: int, dt: float, forces: Drives, motions: Drives) -> None:
        self.first = first
        begin = (first + np.arange(TABLE_STEPS)) * dt
        self.forces = forces.values(begin + 0.5 * dt)
        self.middle = motions.values(begin + 0.5 * dt)
        self.end = motions.values(begin + dt)
        self.rate = motions.rates(begin + dt)


def _rod(
    positions: NDArray[np.float64], velocities: NDArray[np.float64], material: RodMaterial
) -> Any:
    """Return a rod with the given state and material, element by element."""
    n = len(material.rest_lengths)
    arms = np.diff(positions, axis=0)
    directors = _directors(arms / np.linalg.norm(arms, axis=1)[:, np.newaxis])
    rod = ea.CosseratRod.straight_rod(
        n,
        positions[0].copy(),
        directors[2, :, 0].copy(),
        directors[0, :, 0].copy(),
        float(np.linalg.norm(arms, axis=1).sum()),
        # Placeholders, which pass its checks of size; everything made of them is set below.
        1.0,
        1.0,
        youngs_modulus=1.0,
        shear_modulus=1.0,
        position=positions.T.copy(),
        directors=directors,
    )
    rest, area = material.rest_lengths, np.pi * material.radius**2
    rod.rest_lengths[:] = rest
    rod.rest_voronoi_lengths[:] = material.vertex_lengths
    rod.radius[:] = material.radius
    rod.volume[:] = area * rest
    rod.density[:] = material.inertia / (0.25 * material.radius**2) / rod.volume
    rod.mass[:] = material.mass
    for axis in range(3):
        stiffness = material.stretch if axis == 2 else material.shear
        rod.shear_matrix[axis, axis] = stiffness
        rod.bend_matrix[axis, axis] = material.twist if axis == 2 else material.bend
        inertia = material.inertia * (2.0 if axis == 2 else 1.0)
        rod.mass_second_moment_of_inertia[axis, axis] = inertia
        rod.inv_mass_second_moment_of_inertia[axis, axis] = 1.0 / inertia
    rod.velocity_collection[:] = velocities.T
    # The elements turn as their ends move: w = t x dv / l, in the frame of the element.
    lengths = np.linalg.norm(arms, axis=1)[:, np.newaxis]
    turning = np.cross(arms / lengths, np.diff(velocities, axis=0) / lengths)
    rod.omega_collection[:] = np.einsum("ijn,nj->in", directors, turning)
    return rod


def _directors(tangents: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return frames (3, 3, n) along a chain, turned from one to the next without twist."""
    n = len(tangents)
    directors = np.empty((3, 3, n))
    axis = np.zeros(3)
    axis[np.argmin(np.abs(tangents[0]))] = 1.0
    normal = np.cross(axis, tangents[0])
    normal /= np.linalg.norm(normal)
    for i in range(n):
        if i:
            # The turn that takes one tangent to the next by the shortest way (Rodrigues).
            turn = np.cross(tangents[i - 1], tangents[i])
            cosine = tangents[i - 1] @ tangents[i]
            normal = (
                cosine * normal + np.cross(turn, normal) + turn * (turn @ normal) / (1.0 + cosine)
            )
            normal -= (normal @ tangents[i]) * tangents[i]
            normal /= np.linalg.norm(normal)
        directors[0, :, i] = normal
        directors[1, :, i] = np.cross(tangents[i], normal)
        directors[2, :, i] = tangents[i]
    return directors
