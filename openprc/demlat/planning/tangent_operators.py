"""Stiffness and damping of a body about its start, as products with a vector.

No matrix is assembled, so that a million elements need little more than their own columns.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from openprc.demlat.signal_table import sample_signal
from openprc.demlat.statics.bending import (
    BendLaws,
    bend_stiffness,
    bend_turns,
    have_arms,
)
from openprc.demlat.statics.element_laws import BarLaws, HingeLaws
from openprc.demlat.statics.element_shapes import bar_directions, hinge_bends, hinge_gradients

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.experiment import Experiment

    Reals = NDArray[np.float64]

#: Twice a hinge's smaller triangle below this share of its longest edge squared: no angle.
DEGENERATE = 1e-9
#: Of the size of a body: the step of the central difference that gives the part of a hinge's
#: stiffness that comes from its moment; the error is its square.
DIFFERENCE = 1e-5


class Culprit(NamedTuple):
    """The element or node that a mode strains most.

    Attributes
    ----------
    kind : {"bar", "hinge", "bend", "node"}
    number : int
    text : str
    """

    kind: Literal["bar", "hinge", "bend", "node"]
    number: int
    text: str


def starting_positions(experiment: Experiment) -> Reals:
    """Return positions at t = 0, driven coordinates where their signals begin: (N, 3) [m]."""
    positions = experiment.geometry.positions.copy()
    for actuator in experiment.actuators:
        if actuator.type == "position":
            axes = np.array(actuator.axes)
            start = sample_signal(experiment.signals[actuator.signal], np.zeros(1))[0]
            positions[actuator.node, axes] = np.broadcast_to(start, 3)[axes]
    return positions


def free_axes(experiment: Experiment) -> NDArray[np.bool_]:
    """Return which coordinates the integrator moves: (N, 3); a planar scene has no z."""
    free: NDArray[np.bool_] = ~experiment.held_axes
    if experiment.planar:
        free[:, 2] = False
    return free


def hinge_flatness(positions: Reals, indices: NDArray[np.int32]) -> Reals:
    """Return the smaller altitude of each hinge over its crease per longest edge: (K,) [1].

    0 where the crease has no length.
    """
    j, k, i, l = (positions[indices[:, column]] for column in range(4))  # noqa: E741
    crease = np.linalg.norm(k - j, axis=1)
    areas = [np.linalg.norm(np.cross(wing - j, k - j), axis=1) for wing in (i, l)]
    longest = np.max([np.linalg.norm(wing - j, axis=1) for wing in (i, k, l)], axis=0)
    size = crease * longest
    flatness: Reals = np.zeros_like(size)
    np.divide(np.minimum(*areas), size, out=flatness, where=size > 0)
    return flatness


class TangentOperators:
    """Force and damping linearised at t = 0, per unit of mass.

    With ``y = M^1/2 u`` the equation of motion is ``y'' + C y' + K y = 0``. Bars give
    ``k n n^T + (N / l) (I - n n^T)`` with their tangent stiffness k and tension N, hinges
    ``k g g^T`` and the moment times the second derivative of the angle. Cables and struts count
    as engaged, whatever they are at the start. Rigid elements have no stiffness: constraints
    only lower frequencies (Cauchy's interlacing theorem). Hinges without a triangle are left
    out.

    Parameters
    ----------
    experiment : Experiment
        One that has been checked.

    Attributes
    ----------
    free : (N, 3) bool
    n_free : int
    drag : float [1/s]
        What the global damping adds to C, the same for every node.
    damped : bool
        Whether some bar, hinge or bend has a dashpot.
    """

    def __init__(self, experiment: Experiment) -> None:
        geometry = experiment.geometry
        self.free = free_axes(experiment)
        self.n_free = int(self.free.sum())
        self._n_nodes = geometry.n_nodes
        self._positions = starting_positions(experiment)
        masses = np.where(geometry.masses > 0, geometry.masses, 1.0)[:, np.newaxis]
        self._root = np.where(self.free, 1.0 / np.sqrt(masses), 0.0)
        massive = geometry.masses[geometry.masses > 0]
        self.drag = experiment.damping / float(massive.mean()) if len(massive) else 0.0
        self._take_bars(experiment)
        self._take_hinges(experiment)
        self._take_bends(experiment)
        self.damped = bool(
            self._dashpots.any() or self._hinge_dashpots.any() or self._bend_dashpots.any()
        )

    def _take_bars(self, experiment: Experiment) -> None:
        bars = experiment.geometry.bars
        self._ends = bars.indices
        laws = BarLaws(bars)
        lengths, self._unit = bar_directions(self._positions, bars.indices)
        one_sided = (bars.law == "cable") | (bars.law == "strut")
        self._tangent = np.where(one_sided, laws.stiffness, laws.tangent(lengths))
        self._ratio = self._tangent.copy()
        np.divide(laws.force(lengths), lengths, out=self._ratio, where=lengths != 0)
        rate = self._across(experiment.geometry.velocities)
        rate = np.einsum("ea,ea->e", self._unit, rate)
        soft = ~bars.rigid
        self._dashpots = soft * (bars.damping + 3.0 * bars.damping_cubic * rate**2)
        self._printed: Reals | None = None
        if experiment.bar_damping == "printed":
            # Forces -2 zeta sqrt(m k) (v_i - v_j) on node i, sqrt(m) being the node's own.
            self._printed = 2.0 * self._dashpots * np.sqrt(np.where(soft, bars.stiffness, 0.0))

    def _take_hinges(self, experiment: Experiment) -> None:
        hinges = experiment.geometry.hinges
        x = self._positions
        sound = hinge_flatness(x, hinges.indices) > DEGENERATE
        self._sound = np.flatnonzero(sound)
        self._corners = hinges.indices[sound]
        self._gradients = hinge_gradients(x, self._corners)
        laws, bends = HingeLaws(hinges), np.zeros(len(hinges))
        bends[sound] = hinge_bends(x, self._corners)
        self._hinge_tangent = laws.tangent(bends)[sound]
        self._hinge_dashpots = (~hinges.rigid * hinges.damping)[sound]
        moments = laws.force(bends)[sound]
        # Rounding gives a flat sheet moments of no consequence.
        loaded = np.abs(moments) > 1e-12 * self._hinge_tangent
        self._moments = moments[loaded][:, np.newaxis, np.newaxis]
        self._loaded = self._corners[loaded]
        size = float(np.ptp(x, axis=0).max(initial=0.0))
        self._difference = DIFFERENCE * (size or 1.0)

    def _take_bends(self, experiment: Experiment) -> None:
        bends, x = experiment.geometry.bends, self._positions
        sound = have_arms(x, bends.indices)
        laws, turns = BendLaws(bends), bend_turns(x, bends.indices)
        self._sound_bends = np.flatnonzero(sound)
        self._vertices = bends.indices[sound]
        moments, tangents = laws.force(turns)[sound], laws.tangent(turns)[sound]
        self._bend_blocks = bend_stiffness(x, self._vertices, moments, tangents)
        # A dashpot acts on rates as a spring without a moment does on turns.
        dashpots, none = bends.damping[sound], np.zeros(int(sound.sum()))
        self._bend_dashpots = bend_stiffness(x, self._vertices, none, dashpots)

    # --- products ---------------------------------------------------------------------------

    def displacement(self, y: Reals) -> Reals:
        """Return ``u = M^-1/2 y``: (N, 3), real or complex, from (n_free,)."""
        u = np.zeros((self._n_nodes, 3), dtype=np.result_type(y, np.float64))
        u[self.free] = y
        u *= self._root
        return u

    def stiffness(self, y: Reals) -> Reals:
        """Return ``K y``: (n_free,) [1/s2]."""
        u = self.displacement(y)
        along = self._across(u)
        axial = (self._tangent - self._ratio) * np.einsum("ea,ea->e", self._unit, along)
        along *= self._ratio[:, np.newaxis]
        along += axial[:, np.newaxis] * self._unit
        force = self._pulled(along)
        if len(self._corners):
            self._add_hinges(force, self._hinge_tangent, u)
        if len(self._loaded):
            largest = float(np.abs(u).max()) or 1.0
            step = self._difference / largest * u
            ahead = hinge_gradients(self._positions + step, self._loaded)
            ahead -= hinge_gradients(self._positions - step, self._loaded)
            ahead *= self._moments * (largest / (2.0 * self._difference))
            self._scatter(force, self._loaded, ahead)
        self._add_bends(force, self._bend_blocks, u)
        return self._per_mass(force)

    def damping(self, y: Reals) -> Reals:
        """Return ``C y`` without the global drag: (n_free,) [1/s]."""
        u = self.displacement(y)
        along = self._across(u)
        if self._printed is None:
            rate = self._dashpots * np.einsum("ea,ea->e", self._unit, along)
            force = self._pulled(rate[:, np.newaxis] * self._unit)
        else:
            force = self._pulled(self._printed[:, np.newaxis] * along)
            # The weight of a node is sqrt(m) more than that of a force between the nodes.
            force /= np.where(self._root > 0, self._root, np.inf)
        if len(self._corners):
            self._add_hinges(force, self._hinge_dashpots, u)
        self._add_bends(force, self._bend_dashpots, u)
        return self._per_mass(force)

    def _across(self, u: Reals) -> Reals:
        across: Reals = u[self._ends[:, 1]] - u[self._ends[:, 0]]
        return across

    def _pulled(self, forces: Reals) -> Reals:
        """Return nodal forces of bars that resist being stretched by `forces` (M, 3)."""
        total = np.empty((self._n_nodes, 3))
        for axis in range(3):
            column = forces[:, axis]
            total[:, axis] = np.bincount(self._ends[:, 1], column, self._n_nodes)
            total[:, axis] -= np.bincount(self._ends[:, 0], column, self._n_nodes)
        return total

    def _add_hinges(self, force: Reals, factor: Reals, u: Reals) -> None:
        amount = factor * np.einsum("kna,kna->k", self._gradients, u[self._corners])
        self._scatter(force, self._corners, amount[:, np.newaxis, np.newaxis] * self._gradients)

    def _add_bends(self, force: Reals, blocks: Reals, u: Reals) -> None:
        if len(blocks):
            pushes = np.einsum("epaqb,eqb->epa", blocks, u[self._vertices])
            self._scatter(force, self._vertices, pushes)

    def _scatter(self, force: Reals, corners: NDArray[np.int32], pushes: Reals) -> None:
        nodes = corners.ravel()
        for axis in range(3):
            force[:, axis] += np.bincount(nodes, pushes[:, :, axis].ravel(), self._n_nodes)

    def _per_mass(self, force: Reals) -> Reals:
        return (self._root * force)[self.free]

    # --- bounds and names -------------------------------------------------------------------

    def stiffness_bound(self) -> float:
        """Return a number that no eigenvalue of K exceeds [1/s2].

        Gershgorin's rows of ``M^-1 K``, an element being ``k_e g g^T``: the largest over nodes
        of ``sum_e k_e |g_a| sum_b |g_b| / m_a``; of bends, the norms of their blocks. Infinite
        where hinges carry moments, whose part has no such form.
        """
        if len(self._loaded):
            return float("inf")
        stiffest = np.maximum(np.maximum(self._tangent, self._ratio), 0.0)
        weights = self._root.max(axis=1) ** 2
        return self._row_bound(stiffest, self._hinge_tangent, self._bend_blocks, weights)

    def damping_bound(self) -> float:
        """Return a number that no eigenvalue of C exceeds [1/s]; see `stiffness_bound`."""
        if not self.damped:
            return self.drag
        root = self._root.max(axis=1)
        turning = self._hinge_dashpots, self._bend_dashpots
        if self._printed is None:
            return self.drag + self._row_bound(self._dashpots, *turning, root**2)
        still = np.zeros(len(self._corners)), np.zeros_like(self._bend_dashpots)
        bars = self._row_bound(self._printed, *still, root)
        none = np.zeros(len(self._ends))
        return self.drag + bars + self._row_bound(none, *turning, root**2)

    def _row_bound(self, bars: Reals, hinges: Reals, bends: Reals, weights: Reals) -> float:
        moves = (weights > 0).astype(float)
        neighbours = moves[self._ends].sum(axis=1) * bars
        rows = np.zeros(self._n_nodes)
        rows += np.bincount(self._ends.ravel(), np.repeat(neighbours, 2), self._n_nodes)
        if len(self._corners):
            arms = np.linalg.norm(self._gradients, axis=2) * moves[self._corners]
            pushes = (hinges * arms.sum(axis=1))[:, np.newaxis] * arms
            rows += np.bincount(self._corners.ravel(), pushes.ravel(), self._n_nodes)
        if len(self._vertices):
            sizes = np.sqrt(np.einsum("epaqb,epaqb->epq", bends, bends))
            pushes = np.einsum("epq,eq->ep", sizes, moves[self._vertices])
            rows += np.bincount(self._vertices.ravel(), pushes.ravel(), self._n_nodes)
        return float(np.max(rows * weights, initial=0.0))

    def culprit(self, y: Reals, rate: float) -> Culprit:
        """Return what holds most of a mode: the largest stiffness or dashpot times strain^2.

        Parameters
        ----------
        y : (n_free,), complex allowed
        rate : float [1/s]
            Magnitude of the mode's eigenvalue, which weighs dashpots against springs.
        """
        u = self.displacement(y)
        along = self._across(u)
        square = np.sum(np.abs(along) ** 2, axis=1)
        axial = np.abs(np.einsum("ea,ea->e", self._unit, along)) ** 2
        springs = self._tangent * axial + np.maximum(self._ratio, 0.0) * (square - axial)
        if self._printed is None:
            springs += rate * self._dashpots * axial
        else:
            root_mass = (1.0 / np.where(self._root > 0, self._root, np.inf)).max(axis=1)
            springs += rate * self._printed * square * root_mass[self._ends].max(axis=1)
        turned = np.abs(np.einsum("kna,kna->k", self._gradients, u[self._corners])) ** 2
        folds = (self._hinge_tangent + rate * self._hinge_dashpots) * turned
        norm = np.zeros(self._n_nodes)
        np.add.at(norm, np.nonzero(self.free)[0], np.abs(y) ** 2)
        drags = rate * self.drag * norm
        shares = [("bar", springs), ("hinge", folds), ("node", drags)]
        if len(self._vertices):
            at, blocks = u[self._vertices], self._bend_blocks + rate * self._bend_dashpots
            bent = np.einsum("epa,epaqb,eqb->e", at.conj(), blocks, at).real
            shares.append(("bend", bent))
        kind, values = max(shares, key=lambda item: float(np.max(item[1], initial=-1.0)))
        index = int(np.argmax(values))
        if kind == "hinge":
            corners = self._corners[index]
            index = int(self._sound[index])
            return Culprit("hinge", index, f"hinge {index} on the crease {corners[0]}-{corners[1]}")
        if kind == "bend":
            vertex, index = self._vertices[index, 1], int(self._sound_bends[index])
            return Culprit("bend", index, f"bend {index} at node {vertex}")
        if kind == "bar":
            i, j = self._ends[index]
            return Culprit("bar", index, f"bar {index} between nodes {i} and {j}")
        return Culprit("node", index, f"the drag on node {index}")
