"""Whether two states of a body differ by a motion that its supports and loads allow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import linalg  # noqa: TID253 - null spaces are what this module finds

from openprc.demlat.statics.eigenpairs import piece_motions

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.demlat.statics.assembly import StaticProblem

    Reals = NDArray[np.float64]

_TOLERANCE = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class Motions:
    """Rigid motions of the whole body that change neither its energy nor what is held.

    Attributes
    ----------
    translations : (3, S)
        An orthonormal basis of free directions, S from 0 to 3.
    rotation : {"none", "axis", "all"}
    axis : (3,)
        Direction of the axis, for "axis".
    centre : (3,) [m]
        A point on the axis where translations do not supply one.
    """

    translations: Reals
    rotation: str
    axis: Reals
    centre: Reals

    def align(self, moving: Reals, target: Reals) -> Reals:
        """Return `moving` brought as near to `target` as the motions allow: (N, 3) [m].

        Rotations are proper: a mirror image is another state.
        """
        moved = moving + self._shift(target.mean(axis=0) - moving.mean(axis=0))
        if self.rotation == "none":
            return moved
        centre = self.centre if self.translations.shape[1] == 0 else target.mean(axis=0)
        if self.rotation == "all":
            turn = rotation_between(moved - centre, target - centre)
        else:
            turn = rotation_about(self.axis, moved - centre, target - centre)
        aligned: Reals = (moved - centre) @ turn.T + centre
        return aligned

    def _shift(self, gap: Reals) -> Reals:
        along: Reals = self.translations @ (self.translations.T @ gap)
        return along

    def distance(self, moving: Reals, target: Reals) -> float:
        """Return the root mean square distance of the nodes after alignment [m]."""
        gap = self.align(moving, target) - target
        return float(np.sqrt(np.mean(np.sum(gap**2, axis=1))))


def allowed_motions(problem: StaticProblem) -> Motions:
    """Find the rigid motions that leave supports and energy as they are.

    Loads that turn with no rotation allow turns about their own direction only; a rotation
    that moves a held axis only in the second order does not count.
    """
    x = problem.positions
    held = problem.held.ravel()
    motions = piece_motions(x)
    loaded = problem.applied[problem.applied.any(axis=1)]
    rows = [motions[held]]
    if len(loaded):
        size = float(np.linalg.norm(loaded, axis=1).max())
        net = problem.applied.sum(axis=0) / size
        rows.append(np.concatenate([net, np.zeros(3)])[np.newaxis])
        turning = np.zeros((len(loaded), 3, 6))
        for number, unit in enumerate(np.eye(3)):
            turning[:, :, 3 + number] = np.cross(unit, loaded / size)
        rows.append(turning.reshape(-1, 6))
    stack = np.concatenate(rows)
    allowed = linalg.null_space(stack, rcond=_TOLERANCE) if stack.any() else np.eye(6)
    shifts = _pure_shifts(stack)
    turns = linalg.orth(allowed[3:], rcond=_TOLERANCE) if allowed.shape[1] else np.zeros((3, 0))
    centre, axis = x.mean(axis=0), np.array([0.0, 0.0, 1.0])
    rotation = "none"
    if turns.shape[1] == 3 and not held.any():
        rotation = "all"
    elif turns.shape[1] == 1:
        axis = turns[:, 0]
        if held.any():
            centre = _centre(problem, allowed, axis)
        if _keeps_supports(problem, axis, centre):
            rotation = "axis"
    return Motions(translations=shifts, rotation=rotation, axis=axis, centre=centre)


def _pure_shifts(stack: Reals) -> Reals:
    translations = stack[:, :3]
    if not translations.any():
        return np.eye(3)
    return linalg.null_space(translations, rcond=_TOLERANCE)


def _centre(problem: StaticProblem, allowed: Reals, axis: Reals) -> Reals:
    """Return the point of the rotation axis nearest to the centre of the body [m]."""
    x = problem.positions
    middle = x.mean(axis=0)
    size = float(np.abs(x - middle).max()) or 1.0
    weights = np.linalg.lstsq(allowed[3:], axis, rcond=None)[0]
    velocity = allowed[:3] @ weights
    # The velocity w x (r - c) at the middle, in lengths of the piece.
    nearest: Reals = middle + size * np.cross(axis, velocity)
    return nearest


def _keeps_supports(problem: StaticProblem, axis: Reals, centre: Reals) -> bool:
    """Return whether finite turns about the axis keep held coordinates."""
    arms = problem.positions - centre
    turned = arms @ turn_matrix(axis, np.cos(1.0), np.sin(1.0)).T
    size = float(np.abs(arms).max()) or 1.0
    return bool((np.abs(turned - arms)[problem.held] < 1e-6 * size).all())


def rotation_between(moving: Reals, target: Reals) -> Reals:
    """Return the proper rotation that brings `moving` nearest to `target`: (3, 3).

    Kabsch 1976, doi:10.1107/S0567739476001873.
    """
    left, _, right = np.linalg.svd(target.T @ moving)
    sign = np.sign(np.linalg.det(left @ right))
    rotation: Reals = left @ np.diag([1.0, 1.0, sign]) @ right
    return rotation


def rotation_about(axis: Reals, moving: Reals, target: Reals) -> Reals:
    """Return the rotation about `axis` that brings `moving` nearest to `target`: (3, 3)."""
    across = moving - np.outer(moving @ axis, axis)
    cosine = float(np.sum(across * target))
    sine = float(np.sum(np.cross(axis, across) * target))
    size = float(np.hypot(cosine, sine))
    if size == 0.0:
        return np.eye(3)
    return turn_matrix(axis, cosine / size, sine / size)


def turn_matrix(axis: Reals, cosine: float, sine: float) -> Reals:
    """Return the rotation about a unit vector (Rodrigues' formula): (3, 3)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn: Reals = np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross)
    return turn
