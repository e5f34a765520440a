"""The balance of forces of every saved state, recomputed from the imported geometry.

Nothing of MERLIN's own results enters but the displacements and the load, so a small residual
proves that coordinates, element order, angle convention and units were read as they were meant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from openprc_merlin import geometry
from openprc_merlin.material import AUTOMATIC_LIMITS, Material
from openprc_merlin.topology import BEND
from openprc_merlin.workspace import Workspace

Floats = NDArray[np.float64]
#: Limits tried when the file does not tell them [deg]; both occur in MERLIN's examples.
CANDIDATES = (AUTOMATIC_LIMITS, (0.1, 359.9))
_BLOCK = 64


@dataclass(frozen=True)
class Balance:
    """The result of the check.

    Attributes
    ----------
    residual : largest force out of balance at a free degree of freedom
    increment : where it occurs, from 1
    scale : largest force of a single bar or hinge at a node, to compare it with
    text : the result in words
    """

    residual: float
    increment: int
    scale: float
    text: str


def check(workspace: Workspace, material: Material) -> Balance | str:
    """Recompute the balance of every increment, or say what is missing for it."""
    missing = _missing(workspace, material)
    if missing:
        return f"the balance of forces was not checked: the file does not tell {missing}"
    candidates = CANDIDATES if material.limits is None else (material.limits,)
    with np.errstate(over="ignore", invalid="ignore"):
        # A damaged run may overflow; the residual is then infinite, which says it.
        results = [(_residual(workspace, material, limits), limits) for limits in candidates]
    (residual, increment, scale), limits = min(results, key=lambda item: item[0][0])
    source = material.limits_source or "the pair that fits best, as the file does not tell"
    text = (
        f"balance of forces: largest residual {residual:.2g} at increment {increment}, beside "
        f"element forces up to {scale:.3g} (C0 = {material.c0:g} from {material.c0_source}; "
        f"limits of the hinges {limits[0]:g} and {limits[1]:g} deg: {source})"
    )
    return Balance(residual, increment, scale, text)


def _missing(workspace: Workspace, material: Material) -> str:
    hinges, load = workspace.hinges, workspace.load
    lacks = {
        "the bars": workspace.bars is None,
        "the bar areas": workspace.bar_area is None,
        "C0 (give it with the option c0)": material.c0 is None,
        "rest angles or stiffness of the hinges": hinges is not None
        and (hinges.rest_angle is None or hinges.stiffness is None),
        "the law of the bends": hinges is not None
        and bool((hinges.code == BEND).any())
        and material.bend_law is None,
        "the load history": load.history is None,
        "whether forces or displacements were imposed": load.mode == "unknown",
        "the reference load": load.reference is None,
        "which degrees of freedom were imposed": load.mode == "displacement"
        and load.history is not None
        and load.history.shape[1] != len(load.dofs),
    }
    return ", ".join(name for name, is_missing in lacks.items() if is_missing)


def _residual(
    workspace: Workspace, material: Material, limits: tuple[float, float]
) -> tuple[float, int, float]:
    worst, where, scale = -1.0, 0, 0.0
    free = ~workspace.held.ravel()
    load = workspace.load
    assert load.history is not None  # noqa: S101 - see _missing
    assert load.reference is not None  # noqa: S101 - see _missing
    for begin in range(0, workspace.n_increments, _BLOCK):
        block = slice(begin, begin + _BLOCK)
        internal, largest = internal_forces(workspace, material, limits, block)
        if load.mode == "force":
            out = internal - load.history[block, :1] * load.reference
        else:
            # Fhis is minus the applied force, and the applied force equals the internal one.
            out = internal.copy()
            out[:, load.dofs] += load.history[block]
        size = np.nan_to_num(np.abs(out[:, free]), nan=np.inf).max(axis=1, initial=0.0)
        scale = max(scale, largest)
        if size.max() > worst:
            worst, where = float(size.max()), begin + int(size.argmax()) + 1
    return worst, where, scale


def internal_forces(
    workspace: Workspace, material: Material, limits: tuple[float, float], block: slice
) -> tuple[Floats, float]:
    """Return the gradient of the strain energy of the increments in `block`.

    Parameters
    ----------
    workspace, material : with bars, C0 and hinge constants
    limits : (lower, upper) end of the linear range [deg]
    block : increments, from 0

    Returns
    -------
    (B, 3N) forces, and the largest contribution of one element
    """
    positions = workspace.nodes + workspace.displacements[block]
    forces = np.zeros_like(positions)
    bars, rest, area = workspace.bars, workspace.bar_length, workspace.bar_area
    assert bars is not None  # noqa: S101 - see _missing
    assert rest is not None  # noqa: S101 - see _missing
    assert area is not None  # noqa: S101 - see _missing
    assert material.c0 is not None  # noqa: S101 - see _missing
    axis = positions[:, bars[:, 1]] - positions[:, bars[:, 0]]
    length = np.linalg.norm(axis, axis=2)
    stretch = length / rest
    # Ogden, exponents 5 and 1: axial force = A dW/d(stretch) = C0 A / 4 (stretch^4 - 1).
    tension = material.c0 * area / 4 * (stretch**4 - 1)
    pull = (tension / length)[..., None] * axis
    _scatter(forces, bars[:, 1], pull)
    _scatter(forces, bars[:, 0], -pull)
    largest = float(np.abs(tension).max(initial=0.0))
    hinges = workspace.hinges
    if hinges is not None and hinges.stiffness is not None and hinges.rest_angle is not None:
        angle = geometry.dihedral_angles(positions, hinges.indices)
        bends = hinges.code == BEND
        moment = enhanced_linear(angle, hinges.rest_angle, limits)
        if material.bend_law == "four-thirds":
            moment[:, bends] = four_thirds(angle[:, bends], hinges.rest_angle[bends])
        moment *= hinges.stiffness * hinges.length
        gradient = geometry.dihedral_gradients(positions, hinges.indices)
        push = moment[..., None, None] * gradient
        for corner in range(4):
            _scatter(forces, hinges.indices[:, corner], push[:, :, corner])
        largest = max(largest, float(np.abs(push).max(initial=0.0)))
    return forces.reshape(len(positions), -1), largest


def _scatter(forces: Floats, nodes: NDArray[np.int64], values: Floats) -> None:
    np.add.at(forces, (slice(None), nodes), values)


def enhanced_linear(angle: Floats, rest: Floats, limits: tuple[float, float]) -> Floats:
    """Return moment per unit of stiffness and length: linear, and infinite when folded shut.

    Liu & Paulino (2017), doi:10.1098/rspa.2017.0348: with limits t1 and t2, the moment is
    angle - rest between them, and a tangent that goes to infinity at 0 and 2 pi outside.

    Parameters
    ----------
    angle : (B, H) [rad], in (0, 2 pi)
    rest : (H,) [rad]
    limits : (t1, t2) [deg]
    """
    # A limit at 0 or 360 degrees means none; the floor only keeps the other branch finite.
    low = np.deg2rad(max(limits[0], 1e-9))
    high = np.deg2rad(min(limits[1], 360 - 1e-9))
    moment = angle - rest
    below, above = angle < low, angle > high
    gap = 2 * np.pi - high
    left = (low - rest) + 2 * low / np.pi * np.tan(np.pi * (angle - low) / (2 * low))
    right = (high - rest) + 2 * gap / np.pi * np.tan(np.pi * (angle - high) / (2 * gap))
    return np.where(below, left, np.where(above, right, moment))


def four_thirds(angle: Floats, rest: Floats) -> Floats:
    """Return moment per unit of stiffness and length: sign(d) |d|^(4/3), d = angle - rest."""
    difference = angle - rest
    return np.sign(difference) * np.abs(difference) ** (4 / 3)
