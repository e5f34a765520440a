"""`StaticProblem`: the potential energy of a body under dead loads, and its derivatives."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import sparse  # noqa: TID253 - sparse matrices are what this module makes

from openprc.demlat.signal_table import sample_signal
from openprc.demlat.statics.bending import (
    BendLaws,
    bend_gradients,
    bend_stiffness,
    bend_turns,
)
from openprc.demlat.statics.degrees import element_dofs, scatter
from openprc.demlat.statics.element_laws import BarLaws, HingeLaws
from openprc.demlat.statics.element_shapes import (
    bar_directions,
    bar_gradients,
    bar_stiffness,
    hinge_bends,
    hinge_gradients,
    hinge_hessians,
)
from openprc.errors import ConfigError, NotConverged, UnsupportedScene

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.experiment import Experiment, Signal
    from openprc.schema.geometry import Geometry

    Reals = NDArray[np.float64]

_UNSET: Any = None


@dataclass(frozen=True, kw_only=True, eq=False)
class StaticProblem:
    """A body, the dead loads on it and what is held.

    The energy is that of bars, hinges, bends, weight and loads. Positions are (N, 3) [m]
    throughout; matrices are over the free degrees of freedom, in the order of `free`. Rigid
    elements have no energy; they are the rows of `constraints`.

    Parameters
    ----------
    geometry : Geometry
    gravity : (3,) [m/s2], default 0
    loads : (N, 3) [N], default 0
        Forces that keep their direction.
    held : (N, 3) bool, default none
        Axes that stay where `positions` has them; all axes of fixed nodes are held anyway.
    positions : (N, 3) [m], default those of the geometry
        Where held axes are, and where searches begin.

    Raises
    ------
    ConfigError
        When an array has a wrong shape or is not finite.
    UnsupportedScene
        When a hinge has hard stops.

    Examples
    --------
    >>> from openprc.demlat.geometry_builder import GeometryBuilder
    >>> from openprc.demlat.statics import StaticProblem
    >>> build = GeometryBuilder()
    >>> ends = build.add_nodes([[0.0, 0.0], [1.0, 0.0]])
    >>> bar = build.add_bar(*ends, stiffness=100.0, rest_length=0.8)
    >>> problem = StaticProblem(geometry=build.geometry())
    >>> x = problem.positions
    >>> print(f"{problem.energy(x):.3f} J, {problem.bar_forces(x)[bar]:.3f} N")
    2.000 J, 20.000 N
    """

    geometry: Geometry
    gravity: Reals = _UNSET
    loads: Reals = _UNSET
    held: NDArray[np.bool_] = _UNSET
    positions: Reals = _UNSET
    _bar_laws: BarLaws = field(init=False, repr=False)
    _hinge_laws: HingeLaws = field(init=False, repr=False)
    _bend_laws: BendLaws = field(init=False, repr=False)

    def __post_init__(self) -> None:
        geometry = self.geometry
        shape = (geometry.n_nodes, 3)
        for name, dtype, wanted, default in (
            ("gravity", "f8", (3,), np.zeros(3)),
            ("loads", "f8", shape, np.zeros(shape)),
            ("held", "?", shape, np.zeros(shape, dtype=bool)),
            ("positions", "f8", shape, geometry.positions),
        ):
            given = getattr(self, name)
            array = np.array(default if given is None else given, dtype=dtype)
            if array.shape != wanted:
                raise ConfigError(f"shape {array.shape}", expected=f"{wanted}", key=name)
            if not np.isfinite(array).all():
                raise ConfigError("NaN or infinity", expected="finite numbers", key=name)
            if name == "held":
                array |= geometry.fixed[:, np.newaxis]
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        stops = np.flatnonzero(geometry.hinges.limited & (geometry.hinges.law == "linear"))
        if len(stops):
            raise UnsupportedScene(
                f"hinge {int(stops[0])} has hard stops",
                expected="hinges without limits, or of the law 'enhanced-linear'",
                fix="use 'enhanced-linear', whose moment grows beyond the limits",
                key="elements/hinges/limit_low",
            )
        object.__setattr__(self, "_bar_laws", BarLaws(geometry.bars))
        object.__setattr__(self, "_hinge_laws", HingeLaws(geometry.hinges))
        object.__setattr__(self, "_bend_laws", BendLaws(geometry.bends))

    @classmethod
    def from_experiment(cls, experiment: Experiment, *, time: float = 0.0) -> StaticProblem:
        """Freeze an experiment at a time.

        Driven axes are held where their signals are at `time`, force actuators are dead loads
        of that time, velocity-driven axes are held at their start, and a planar scene stays
        in its plane.

        Parameters
        ----------
        experiment : Experiment
        time : float [s]

        Raises
        ------
        UnsupportedScene
            When nodes can collide, or velocities are prescribed and `time` is not 0.
        """
        geometry = experiment.geometry
        if experiment.collision.enabled and geometry.collidable.sum() > 1:
            raise UnsupportedScene(
                f"contact between {int(geometry.collidable.sum())} collidable nodes",
                expected="a scene without contact",
                fix="switch collision off; statics knows bars, hinges, bends, weight and loads",
                key="physics.enable_collision",
            )
        positions = geometry.positions.copy()
        loads = np.zeros_like(positions)
        held = experiment.driven_axes("position") | experiment.driven_axes("velocity")
        if time != 0.0 and experiment.driven_axes("velocity").any():
            raise UnsupportedScene(
                f"prescribed velocities at t = {time:g} s",
                expected="t = 0, or positions instead",
                fix="integrate the signal and drive the position",
                key="actuators",
            )
        for actuator in experiment.actuators:
            axes = np.array(actuator.axes)
            value = _signal_value(experiment.signals[actuator.signal], time)[axes]
            if actuator.type == "position":
                positions[actuator.node, axes] = value
            elif actuator.type == "force":
                loads[actuator.node, axes] += value
        if experiment.planar:
            held[:, 2] = True
        gravity = np.array(experiment.gravity)
        return cls(geometry=geometry, gravity=gravity, loads=loads, held=held, positions=positions)

    # --- bookkeeping ------------------------------------------------------------------------

    @cached_property
    def free(self) -> NDArray[np.int64]:
        """Free degrees of freedom, ``3 * node + axis``: (n_free,)."""
        return np.flatnonzero(~self.held.ravel())

    @cached_property
    def applied(self) -> Reals:
        """Loads and weight together: (N, 3) [N]."""
        weight = self.geometry.masses[:, np.newaxis] * self.gravity
        total: Reals = self.loads + weight
        return total

    @cached_property
    def length_scale(self) -> float:
        """Median length of the bars [m], or the size of the body when it has none."""
        lengths = self.geometry.bars.relaxed_length
        lengths = lengths[lengths > 0]
        if len(lengths):
            return float(np.median(lengths))
        return float(np.ptp(self.geometry.positions, axis=0).max()) or 1.0

    @cached_property
    def rigid_bars(self) -> NDArray[np.int64]:
        """Indices of rigid bars, the first rows of the constraints."""
        return np.flatnonzero(self.geometry.bars.rigid)

    @cached_property
    def rigid_hinges(self) -> NDArray[np.int64]:
        """Indices of rigid hinges, the last rows of the constraints."""
        return np.flatnonzero(self.geometry.hinges.rigid)

    @property
    def n_constraints(self) -> int:
        """Number of rigid elements."""
        return len(self.rigid_bars) + len(self.rigid_hinges)

    def place(self, positions: Reals) -> Reals:
        """Return a copy of `positions` (N, 3) [m] with held axes where they belong."""
        placed = np.array(positions, dtype="f8")
        if placed.shape != self.positions.shape:
            raise ConfigError(
                f"shape {placed.shape}", expected=f"{self.positions.shape}", key="positions"
            )
        placed[self.held] = self.positions[self.held]
        return placed

    # --- energy and its derivatives -----------------------------------------------------------

    def energy(self, positions: Reals) -> float:
        """Return the potential energy [J]; weight and loads count from the origin."""
        return float(sum(part.sum() for part in self.energies(positions)))

    def energies(self, positions: Reals) -> tuple[Reals, Reals, Reals, Reals]:
        """Return energies of bars (M,), hinges (K,), bends (B,) and applied forces (N,) [J]."""
        lengths, _ = bar_directions(positions, self.geometry.bars.indices)
        bends = hinge_bends(positions, self.geometry.hinges.indices)
        applied = -np.sum(self.applied * positions, axis=1)
        turns = bend_turns(positions, self.geometry.bends.indices)
        bars, hinges = self._bar_laws.energy(lengths), self._hinge_laws.energy(bends)
        return bars, hinges, self._bend_laws.energy(turns), applied

    def bar_forces(self, positions: Reals) -> Reals:
        """Return tensions of the springs: (M,) [N]; 0 for rigid bars."""
        return self._bar_laws.force(bar_directions(positions, self.geometry.bars.indices)[0])

    def hinge_moments(self, positions: Reals) -> Reals:
        """Return moments of the springs: (K,) [N m]; 0 for rigid hinges."""
        return self._hinge_laws.force(hinge_bends(positions, self.geometry.hinges.indices))

    def bend_torques(self, positions: Reals) -> Reals:
        """Return ``stiffness * (angle - rest)`` of bends: (B,) [N m]."""
        return -self._bend_laws.force(bend_turns(positions, self.geometry.bends.indices))

    def bends(self, positions: Reals) -> Reals:
        """Return the angles of the hinges minus pi: (K,) [rad]."""
        return hinge_bends(positions, self.geometry.hinges.indices)

    def gradient(self, positions: Reals) -> Reals:
        """Return d(energy)/dx: (N, 3) [N]; at held axes it is the force of the support.

        Raises
        ------
        NotConverged
            When the direction of a loaded bar or the angle of a hinge has no meaning.
        """
        bars, hinges = self.geometry.bars.indices, self.geometry.hinges.indices
        lengths, unit = bar_directions(positions, bars)
        tensions = self._bar_laws.force(lengths)
        self._refuse_points(lengths, tensions)
        gradient = -self.applied
        scatter(gradient, bars, tensions[:, None, None] * bar_gradients(unit))
        if len(hinges):
            moments = self._hinge_laws.force(hinge_bends(positions, hinges))
            pushes = moments[:, None, None] * hinge_gradients(positions, hinges)
            scatter(gradient, hinges, pushes)
        if len(bends := self.geometry.bends.indices):
            moments = self._bend_laws.force(bend_turns(positions, bends))
            scatter(gradient, bends, moments[:, None, None] * bend_gradients(positions, bends))
        return gradient

    def hessian(self, positions: Reals, multipliers: Reals | None = None) -> sparse.csr_array:
        """Return second derivatives over free degrees of freedom: (n_free, n_free) [N/m].

        Parameters
        ----------
        positions : (N, 3) [m]
        multipliers : (C,), optional
            Of the constraints; with them it is the Hessian of the Lagrangian
            ``energy + multipliers . constraints``.
        """
        bars, hinges = self.geometry.bars.indices, self.geometry.hinges.indices
        lengths, unit = bar_directions(positions, bars)
        force, tangent = self._bar_laws.force(lengths), self._bar_laws.tangent(lengths)
        n_bars = len(self.rigid_bars)
        if multipliers is not None:
            force[self.rigid_bars] = multipliers[:n_bars]
        self._refuse_points(lengths, force)
        blocks = [bar_stiffness(lengths, unit, force, tangent).ravel()]
        if len(hinges):
            bends = hinge_bends(positions, hinges)
            moment, rate = self._hinge_laws.force(bends), self._hinge_laws.tangent(bends)
            if multipliers is not None:
                scaled = multipliers[n_bars:] * self._hinge_arms
                moment[self.rigid_hinges] = scaled
            gradient = hinge_gradients(positions, hinges)
            second = hinge_hessians(positions, hinges)
            second *= moment[:, None, None, None, None]
            second += (rate[:, None, None] * gradient)[..., None, None] * gradient[:, None, None]
            blocks.append(second.ravel())
        if len(arms := self.geometry.bends.indices):
            turns = bend_turns(positions, arms)
            moment, rate = self._bend_laws.force(turns), self._bend_laws.tangent(turns)
            blocks.append(bend_stiffness(positions, arms, moment, rate).ravel())
        slots, indices, indptr = self._pattern
        values = np.concatenate(blocks)
        # The last slot collects what belongs to held axes.
        data = np.bincount(slots, weights=values, minlength=len(indices) + 1)[:-1]
        n = len(self.free)
        return sparse.csr_array((data, indices, indptr), shape=(n, n))

    # --- rigid elements -----------------------------------------------------------------------

    @cached_property
    def _hinge_arms(self) -> Reals:
        """Lengths that turn the angles of rigid hinges into the size of bars [m]."""
        gradients = hinge_gradients(self.positions, self._rigid_hinge_nodes)
        arms: Reals = 1.0 / np.sqrt(np.sum(gradients**2, axis=(1, 2)))
        return arms

    @property
    def _rigid_hinge_nodes(self) -> NDArray[np.int32]:
        return self.geometry.hinges.indices[self.rigid_hinges]

    def constraints(self, positions: Reals) -> Reals:
        """Return by how much rigid elements are off: (C,) [m]; angles times an arm."""
        rigid = self.rigid_bars
        lengths, _ = bar_directions(positions, self.geometry.bars.indices[rigid])
        gaps = [lengths - self.geometry.bars.relaxed_length[rigid]]
        if len(self.rigid_hinges):
            bends = hinge_bends(positions, self._rigid_hinge_nodes)
            off = bends - (self.geometry.hinges.rest_angle[self.rigid_hinges] - np.pi)
            off -= 2.0 * np.pi * np.floor(off / (2.0 * np.pi) + 0.5)
            gaps.append(off * self._hinge_arms)
        return np.concatenate(gaps)

    def constraint_jacobian(self, positions: Reals, *, whole: bool = False) -> sparse.csr_array:
        """Return d(constraints)/dx: (C, n_free) [1], or (C, 3 N) with held axes."""
        bars = self.geometry.bars.indices[self.rigid_bars]
        _, unit = bar_directions(positions, bars)
        values = [bar_gradients(unit).ravel()]
        columns = [element_dofs(bars).ravel()]
        counts = np.full(self.n_constraints, 6)
        if len(self.rigid_hinges):
            gradients = hinge_gradients(positions, self._rigid_hinge_nodes)
            values.append((gradients * self._hinge_arms[:, None, None]).ravel())
            columns.append(element_dofs(self._rigid_hinge_nodes).ravel())
            counts[len(bars) :] = 12
        rows = np.repeat(np.arange(self.n_constraints), counts)
        shape = (self.n_constraints, self.geometry.n_nodes * 3)
        entries = (np.concatenate(values), (rows, np.concatenate(columns)))
        jacobian = sparse.csr_array(sparse.coo_array(entries, shape=shape))
        return jacobian if whole else jacobian[:, self.free]

    def rigid_forces(self, multipliers: Reals) -> tuple[Reals, Reals]:
        """Return tensions [N] and moments [N m] of rigid bars and hinges from multipliers."""
        count = len(self.rigid_bars)
        return multipliers[:count], multipliers[count:] * self._hinge_arms

    # --- sparsity -----------------------------------------------------------------------------

    @cached_property
    def _pattern(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Where each entry of the element matrices goes: slots, and CSR indices and indptr."""
        n = len(self.free)
        number = np.full(self.geometry.n_nodes * 3, -1, dtype=np.int64)
        number[self.free] = np.arange(n)
        keys = []
        for elements in (self.geometry.bars, self.geometry.hinges, self.geometry.bends):
            nodes = elements.indices
            dofs = number[element_dofs(nodes)]
            row, column = dofs[:, :, None], dofs[:, None, :]
            keys.append(np.where((row < 0) | (column < 0), -1, row * n + column).ravel())
        # The diagonal is always there, so that shifts keep the pattern.
        flat = np.concatenate([*keys, np.arange(n) * (n + 1)])
        unique, inverse = np.unique(flat, return_inverse=True)
        inverse = inverse.ravel()
        if len(unique) and unique[0] < 0:
            unique, inverse = unique[1:], inverse - 1
        slots = inverse[: len(flat) - n]
        slots = np.where(slots < 0, len(unique), slots)
        indptr = np.searchsorted(unique, np.arange(n + 1) * n)
        return slots, unique % max(n, 1), indptr.astype(np.int64)

    def _refuse_points(self, lengths: Reals, force: Reals) -> None:
        bad = np.flatnonzero((lengths == 0) & (force != 0))
        if len(bad):
            nodes = self.geometry.bars.indices[bad[0]].tolist()
            raise NotConverged(
                f"the nodes {nodes} of bar {int(bad[0])} are at one point, and it pushes",
                expected="a distance between them, else its force has no direction",
                fix="start from another state",
            )


def _signal_value(signal: Signal, time: float) -> Reals:
    return np.broadcast_to(sample_signal(signal, np.array([time]))[0], 3)
