"""What is odd about a body before it is run; nothing of it stops a run."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from openprc.demlat.planning.tangent_operators import (
    DEGENERATE,
    free_axes,
    hinge_flatness,
    starting_positions,
)
from openprc.demlat.statics.bending import bend_turns, have_arms
from openprc.demlat.statics.element_shapes import bar_directions, hinge_gradients
from openprc.schema.findings import Finding
from openprc.schema.mistakes import list_some

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.experiment import Experiment
    from openprc.schema.geometry import Bends

    Reals = NDArray[np.float64]

#: Altitude of a hinge's triangle per longest edge below which its forces grow out of hand.
THIN = 1e-3
#: Length of a bar per median length below which it is probably a mistake.
SHORT = 1e-3
#: Distance of nodes per size of the body below which they are at one point.
COINCIDENT = 1e-9
#: Sine of a turn below which the arms of a bend lie on one line.
COLLINEAR = 1e-6
#: Bodies with more free coordinates are not searched for mechanisms, which takes dense algebra.
MOST_COORDINATES = 3000
#: Singular values below this share of the largest count as zero.
NULL = 1e-6


def scene_findings(experiment: Experiment) -> Iterator[Finding]:
    """Yield what is degenerate, loose or without effect, as warnings and hints."""
    yield from thin_hinges(experiment)
    yield from short_bars(experiment)
    yield from coincident_nodes(experiment)
    yield from idle_elements(experiment)
    yield from floating_pieces(experiment)


def thin_hinges(experiment: Experiment) -> Iterator[Finding]:
    """Yield hinges with a wing close to its crease line: forces go as one over the altitude."""
    hinges = experiment.geometry.hinges
    flatness = hinge_flatness(starting_positions(experiment), hinges.indices)
    thin = np.flatnonzero(flatness < THIN)
    if len(thin):
        yield Finding(
            code="PLAN-THIN-HINGE",
            level="warning",
            path="elements/hinges/indices",
            found=f"hinge {list_some(thin)} has a wing {flatness[thin].min():.2g} of its longest"
            " edge away from the crease line",
            expected=f"at least {THIN:g}: forces grow as one over that distance",
            fix="move the wing off the line, or leave the hinge out",
        )


def short_bars(experiment: Experiment) -> Iterator[Finding]:
    """Yield bars that are much shorter than the others."""
    bars = experiment.geometry.bars
    lengths, _ = bar_directions(starting_positions(experiment), bars.indices)
    typical = float(np.median(lengths)) if len(lengths) else 0.0
    short = np.flatnonzero(lengths < SHORT * typical)
    if len(short):
        yield Finding(
            code="PLAN-SHORT-BAR",
            level="warning",
            path="elements/bars/indices",
            found=f"bar {list_some(short)} is {lengths[short].min():.2g} m long, the median bar"
            f" {typical:.2g} m",
            expected="bars of comparable length: a short one turns about at the least motion",
            fix="merge its nodes, or check their positions",
        )


def coincident_nodes(experiment: Experiment) -> Iterator[Finding]:
    """Yield nodes at one point."""
    positions = starting_positions(experiment)
    size = float(np.ptp(positions, axis=0).max())
    if len(positions) < 2:
        return
    # Only a plan needs neighbours; a run does not load scipy for it.
    from scipy.spatial import cKDTree

    distance, nearest = (np.asarray(part) for part in cKDTree(positions).query(positions, k=2))
    at = np.flatnonzero(distance[:, 1] <= COINCIDENT * size)
    if len(at):
        other = int(nearest[at[0]][nearest[at[0]] != at[0]][0])
        yield Finding(
            code="PLAN-COINCIDENT-NODES",
            level="warning",
            path="nodes/positions",
            found=f"{len(at)} nodes share their points with others, such as node {at[0]}"
            f" and node {other}",
            expected="a point for each node",
            fix="merge them if they are one node; nodes at one point are not joined",
        )


def idle_elements(experiment: Experiment) -> Iterator[Finding]:
    """Yield elements between nodes of which none can move: they only cost time."""
    geometry = experiment.geometry
    for name, elements in (
        ("bars", geometry.bars),
        ("hinges", geometry.hinges),
        ("bends", geometry.bends),
    ):
        idle = np.flatnonzero(geometry.fixed[elements.indices].all(axis=1))
        if len(idle):
            yield Finding(
                code=f"PLAN-IDLE-{name.upper()}",
                level="hint",
                path=f"elements/{name}/indices",
                found=f"{len(idle)} {name} between fixed nodes ({list_some(idle)})",
                fix="leave them out: they move nothing",
            )


# --- pieces --------------------------------------------------------------------------------------


def pieces(experiment: Experiment) -> NDArray[np.int32]:
    """Return the number of the connected piece of each node: (N,)."""
    from scipy import sparse

    geometry, n = experiment.geometry, experiment.geometry.n_nodes
    hinges, bends = geometry.hinges.indices, geometry.bends.indices
    pairs = np.concatenate(
        [
            geometry.bars.indices,
            *(hinges[:, [0, column]] for column in range(1, 4)),
            *(bends[:, [1, column]] for column in (0, 2)),
        ]
    )
    graph = sparse.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    labels: NDArray[np.int32] = sparse.csgraph.connected_components(graph, directed=False)[1]
    return labels


def floating_pieces(experiment: Experiment) -> Iterator[Finding]:
    """Yield pieces that nothing holds, and nodes without any element."""
    geometry, labels = experiment.geometry, pieces(experiment)
    n_pieces = int(labels.max()) + 1
    held = np.zeros(n_pieces, dtype=bool)
    held[labels[experiment.held_axes.any(axis=1)]] = True
    size = np.bincount(labels)
    touched = np.zeros(geometry.n_nodes, dtype=bool)
    for elements in (geometry.bars, geometry.hinges, geometry.bends):
        touched[elements.indices] = True
    falls = any(experiment.gravity)
    loose = np.flatnonzero(~held[labels] & ~touched)
    if len(loose):
        yield Finding(
            code="PLAN-LOOSE-NODE",
            level="warning",
            path="nodes/positions",
            found=f"no bar or hinge holds node {list_some(loose)}"
            + (", which falls freely" if falls else ""),
            expected="an element at every node that moves",
            fix="connect, fix or remove it",
        )
    floating = np.flatnonzero(~held & (size > 1))
    if len(floating):
        example = np.flatnonzero(labels == floating[0])
        every = len(floating) == n_pieces
        yield Finding(
            code="PLAN-FLOATING",
            level="warning" if falls or not every else "hint",
            path="nodes/fixed",
            found=f"{len(floating)} of {n_pieces} pieces have no fixed or driven node, such as the"
            f" {len(example)} nodes {list_some(example)}"
            + (": gravity carries them away" if falls else ""),
            fix="fix or drive some of their nodes, unless they are meant to float",
        )


# --- mechanisms ----------------------------------------------------------------------------------


def mechanisms(experiment: Experiment) -> tuple[int, int] | None:
    """Count motions that strain no element, to first order.

    The null space of the rigidity matrix over free coordinates, whose rows are the gradients of
    lengths and angles of elements with stiffness (Pellegrino & Calladine 1986,
    doi:10.1016/0020-7683(86)90014-4).

    Returns
    -------
    (inner, rigid) or None
        Independent mechanisms, and motions of pieces as a whole; None for bodies with more than
        `MOST_COORDINATES` free coordinates.
    """
    free = free_axes(experiment)
    n_free = int(free.sum())
    if n_free > MOST_COORDINATES:
        return None
    place = np.full(free.shape, -1)
    place[free] = np.arange(n_free)
    gram = np.zeros((n_free, n_free))
    for indices, rows in _gradients(experiment):
        shape = (len(indices), 3 * indices.shape[1])
        at = place[indices].reshape(shape)
        values = np.where(at >= 0, rows.reshape(shape), 0.0)
        np.add.at(gram, (at[:, :, None], at[:, None, :]), values[:, :, None] * values[:, None, :])
    rigid = _rigid_motions(experiment, free)
    null = n_free
    if gram.any():
        values = np.linalg.eigvalsh(gram)
        null = int((values < NULL**2 * values[-1]).sum())
    return null - rigid, rigid


def _gradients(experiment: Experiment) -> Iterator[tuple[NDArray[np.int32], Reals]]:
    """Yield indices (E, k) and gradients (E, k, 3) of norm 1 of elements with stiffness."""
    geometry, x = experiment.geometry, starting_positions(experiment)
    bars, hinges = geometry.bars, geometry.hinges
    stiff = bars.rigid | (bars.stiffness > 0) | (bars.stiffness_cubic > 0)
    unit = bar_directions(x, bars.indices[stiff])[1] / np.sqrt(2.0)
    yield bars.indices[stiff], np.stack([-unit, unit], axis=1)
    stiff = hinges.rigid | (hinges.stiffness > 0)
    stiff &= hinge_flatness(x, hinges.indices) > DEGENERATE
    gradients = hinge_gradients(x, hinges.indices[stiff])
    norms = np.sqrt(np.sum(gradients**2, axis=(1, 2), keepdims=True))
    yield hinges.indices[stiff], gradients / norms
    yield from _bend_gradients(geometry.bends, x)


def _bend_gradients(bends: Bends, x: Reals) -> Iterator[tuple[NDArray[np.int32], Reals]]:
    """Yield those of stiff bends; a straight one resists both sideways motions of its ends."""
    indices = bends.indices[(bends.stiffness > 0) & have_arms(x, bends.indices)]
    turns = bend_turns(x, indices)
    u, v = x[indices[:, 0]] - x[indices[:, 1]], x[indices[:, 2]] - x[indices[:, 1]]
    uu, vv = np.sum(u * u, axis=1, keepdims=True), np.sum(v * v, axis=1, keepdims=True)
    # Any axis across the first arm will do where the arms lie on one line.
    axis = np.cross(u, v)
    sharp = np.sin(turns) > COLLINEAR
    least = np.eye(3)[np.abs(u).argmin(axis=1)]
    axis = np.where(sharp[:, np.newaxis], axis, np.cross(u, least))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    for chosen in (np.ones(len(indices), dtype=bool), ~sharp):
        first, last = np.cross(axis, u) / uu, np.cross(v, axis) / vv
        rows = np.stack([first, -first - last, last], axis=1)[chosen]
        yield indices[chosen], rows / np.sqrt(np.sum(rows**2, axis=(1, 2), keepdims=True))
        axis = np.cross(u, axis) / np.sqrt(uu)


def _rigid_motions(experiment: Experiment, free: NDArray[np.bool_]) -> int:
    x, labels = starting_positions(experiment), pieces(experiment)
    axes = 2 if experiment.planar else 3
    size = float(np.ptp(x, axis=0).max()) or 1.0
    count = 0
    for piece in range(int(labels.max()) + 1):
        nodes = labels == piece
        arms = (x[nodes] - x[nodes].mean(axis=0)) / size
        turns = np.cross(np.eye(3)[:, None, :], arms[None, :, :])
        shifts = np.broadcast_to(np.eye(3)[:, None, :], turns.shape)
        motions = np.concatenate([shifts[:axes], turns[2:] if axes == 2 else turns])[..., :axes]
        held = ~free[nodes][:, :axes]
        all_axes = motions.reshape(len(motions), -1)
        count += _rank(all_axes) - _rank(all_axes[:, held.ravel()])
    return count


def _rank(matrix: Reals) -> int:
    return int(np.linalg.matrix_rank(matrix, tol=NULL)) if matrix.size else 0
