"""Infinitesimal motions of nodes in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Reals = NDArray[np.float64]
    Places = NDArray[np.int64]

#: Deviation, relative to the largest rate, up to which rates count as equal.
SAME = 1e-6
#: Nodes that are named.
NAMED = 6


def say_nodes(nodes: Places) -> str:
    """Return "node 5", "nodes 3, 4 and 7", or "12 nodes (3, 4, 7, ...)"."""
    numbers = [str(node) for node in nodes.tolist()]
    if len(numbers) == 1:
        return f"node {numbers[0]}"
    if len(numbers) <= NAMED:
        return f"nodes {', '.join(numbers[:-1])} and {numbers[-1]}"
    return f"{len(numbers):,} nodes ({', '.join(numbers[:NAMED])}, ...)"


def say_direction(vector: Reals) -> str:
    """Return "x", "y" or "z", or the unit vector."""
    unit = vector / np.linalg.norm(vector)
    axis = int(np.abs(unit).argmax())
    if np.linalg.norm(np.delete(unit, axis)) < SAME:
        return "xyz"[axis]
    unit = unit * np.sign(unit[np.flatnonzero(np.abs(unit) > SAME)[0]])
    return "(" + ", ".join(f"{part + 0.0:.3g}" for part in np.round(unit, 6)) + ")"


def say_node(node: int, rates: Reals) -> str:
    """Describe how a node by itself can move: (r, 3) independent rates."""
    ways = [say_direction(rate) for rate in rates]
    some = " and ".join([", ".join(ways[:-1]), ways[-1]] if len(ways) > 1 else ways)
    return f"node {node} moves along {some}"


def say_motion(nodes: Places, x: Reals, rates: Reals) -> str:
    """Describe a motion.

    Parameters
    ----------
    nodes : (P,)
        That move.
    x : (P, 3) [m]
    rates : (P, 3)
        In any one unit.
    """
    who, largest = say_nodes(nodes), float(np.abs(rates).max())
    if len(nodes) == 1:
        return f"{who} moves along {say_direction(rates[0])}"
    if np.abs(rates - rates[0]).max() < SAME * largest:
        return f"{who} shift together along {say_direction(rates[0])}"
    turn = _turn(x, rates)
    if turn is not None:
        return f"{who} turn together about {turn}"
    most = int(np.linalg.norm(rates, axis=1).argmax())
    return f"{who} move, node {nodes[most]} the most, along {say_direction(rates[most])}"


def _turn(x: Reals, rates: Reals) -> str | None:
    """Return the axis of a rigid turn without a shift along it; None if it is none."""
    centre = x.mean(axis=0)
    arms = x - centre
    size = float(np.abs(arms).max())
    # rate = shift + spin x arm, by least squares.
    rows = np.zeros((len(x), 3, 6))
    for axis in range(3):
        rows[:, axis, axis] = 1.0
        rows[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arms / size)
    found = np.linalg.lstsq(rows.reshape(-1, 6), rates.ravel(), rcond=1e-9)[0]
    misfit = np.abs(rows.reshape(-1, 6) @ found - rates.ravel()).max()
    shift, spin = found[:3], found[3:] / size
    square = float(spin @ spin)
    if misfit > SAME * np.abs(rates).max() or square == 0.0:
        return None
    if abs(shift @ spin) > SAME * np.linalg.norm(shift) * np.sqrt(square):
        return None
    through = centre + np.cross(spin, shift) / square
    through[np.abs(through) < 1e-9 * (size + np.abs(through).max())] = 0.0
    at = ", ".join(f"{part:.4g}" for part in through)
    return f"an axis along {say_direction(spin)} through ({at}) m"


def say_whole(nodes: Places, screws: Reals, count: int) -> str:
    """Describe how nodes can move as one rigid piece.

    Parameters
    ----------
    nodes : (P,)
    screws : (6, r)
        Shifts and turns that are possible.
    count : int
        How many of them move some node; a turn of a bar about itself does not.
    """
    n_shifts = screws.shape[1] - int(np.linalg.matrix_rank(screws[3:], tol=1e-6))
    n_turns = count - n_shifts
    parts = []
    if n_shifts == 1:
        _, _, right = np.linalg.svd(screws[3:])
        parts.append(f"a shift along {say_direction(screws[:3] @ right[-1])}")
    elif n_shifts:
        parts.append(f"{n_shifts} shifts")
    if n_turns:
        parts.append("a turn" if n_turns == 1 else f"{n_turns} turns")
    return f"{say_nodes(nodes)} move as a whole: {' and '.join(parts)}"
