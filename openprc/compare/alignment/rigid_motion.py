"""The rigid motion, with a scale where asked for, that brings one body onto another."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingData

Reals = NDArray[np.float64]

#: Directions narrower than this, in units of the largest one, turn about nothing.
FLAT = 1e-9
#: A mirror image is mentioned where it leaves less than this share of the deviation.
MIRRORED = 0.5


@dataclass(frozen=True)
class RigidMotion:
    """``x = scale R y + shift`` takes places y of the other file to the reference.

    Parameters
    ----------
    rotation : (d, d)
        Orthogonal, of determinant 1 unless `reflected`.
    shift : (d,) [unit of the comparison]
    scale : float
    reflected : bool
    rms : float
        What is left over the points that it was found from, to half of the digits.
    notes : tuple of str
    """

    rotation: Reals
    shift: Reals
    scale: float = 1.0
    reflected: bool = False
    rms: float = 0.0
    notes: tuple[str, ...] = ()

    @property
    def angle(self) -> float:
        """Angle of the rotation [rad]; of what remains without the reflection."""
        turn = -self.rotation if self.reflected and len(self.shift) == 3 else self.rotation
        skew = turn - turn.T
        if len(self.shift) == 2:
            return float(abs(np.arctan2(turn[1, 0], turn[0, 0])))
        # The arc cosine of the trace alone has half of the digits near 0.
        sine = np.linalg.norm((skew[2, 1], skew[0, 2], skew[1, 0])) / 2.0
        return float(np.arctan2(sine, (np.trace(turn) - 1.0) / 2.0))

    def apply(self, y: Reals, *, offset: Reals | None = None) -> Reals:
        """Return places (B, n, d) moved, less `offset` (n, d)."""
        from openprc.compare.deviations.compiled_sums import move_rigidly  # noqa: PLC0415 - numba, heavy

        moved = np.array(y, dtype="f8", order="C")
        shift = np.broadcast_to(self.shift, moved.shape[1:])
        if offset is not None:
            shift = shift - offset
        move_rigidly(moved, self.scale * self.rotation, np.ascontiguousarray(shift))
        return moved

    def turn(self, velocities: Reals) -> Reals:
        """Return velocities (B, n, d) turned and scaled."""
        return velocities @ (self.scale * self.rotation).T

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON output."""
        return {
            "rotation": self.rotation.tolist(),
            "shift": self.shift.tolist(),
            "scale": self.scale,
            "reflected": self.reflected,
            "angle": self.angle,
            "rms": self.rms,
        }


def fit_rigid_motion(
    pairs: Iterable[tuple[Reals, Reals]], *, scale: bool = False, reflect: bool = False
) -> RigidMotion:
    """Find the motion with the least squares of deviations from moments of the points.

    Kabsch 1976 (doi:10.1107/S0567739476001873); scale and determinant after Umeyama 1991
    (doi:10.1109/34.88573, eqs. 39 to 42).

    Parameters
    ----------
    pairs : iterable of ((B, n, d), (B, n, d))
        Places in the reference and in the other file; NaN is left out.
    scale : bool
    reflect : bool
        The motion may be a mirror image.

    Raises
    ------
    MissingData
        When no point is in both files.
    """
    from openprc.compare.deviations.compiled_sums import add_moments  # noqa: PLC0415 - numba, heavy

    sums, cross, origins = None, None, None
    for x, y in pairs:
        if origins is None or sums is None or cross is None:
            d = x.shape[2]
            # Of one frame, so that the result does not depend on the size of blocks.
            origins = np.stack([_middle(x[:1]), _middle(y[:1])])
            sums, cross = np.zeros(2 * d + 3), np.zeros((d, d))
        add_moments(np.ascontiguousarray(x), np.ascontiguousarray(y), origins, sums, cross)
    if sums is None or cross is None or origins is None or not sums[-1]:
        raise MissingData(
            "no node is seen in both files at one instant",
            expected="nodes to find the rigid motion from",
            fix='compare with rigid_motion="none", or another part of the clock',
            key="rigid_motion",
        )
    d, count = len(cross), sums[-1]
    mean_x, mean_y = sums[:d] / count, sums[d : 2 * d] / count
    covariance = cross / count - np.outer(mean_x, mean_y)
    var_x = max(0.0, sums[2 * d] / count - mean_x @ mean_x)
    var_y = max(0.0, sums[2 * d + 1] / count - mean_y @ mean_y)
    u, s, vt = np.linalg.svd(covariance)
    rank = int((s > FLAT * max(float(s[0]), 1e-300)).sum()) if s[0] > 0 else 0
    mirror = np.linalg.det(u) * np.linalg.det(vt) < 0 and rank == d
    notes: list[str] = []
    if rank < d - 1:
        rotation, product = _least_turn(u, s, vt, rank), float(s[:rank].sum())
        what = "coincide" if rank == 0 else "lie on a line"
        notes.append(f"the nodes {what}: the turn that they do not show is taken to be none")
    else:
        keep = np.ones(d)
        if np.linalg.det(u) * np.linalg.det(vt) < 0 and not (reflect and mirror):
            keep[-1] = -1.0
        rotation, product = (u * keep) @ vt, float(s @ keep)
    factor = product / var_y if scale and var_y > 0 else 1.0
    left = max(0.0, var_x - 2.0 * factor * product + factor**2 * var_y)
    reflected = bool(np.linalg.det(rotation) < 0)
    if mirror and not reflect:
        best = float(s.sum())
        other = best / var_y if scale and var_y > 0 else 1.0
        unmirrored = max(0.0, var_x - 2.0 * other * best + other**2 * var_y)
        if unmirrored < MIRRORED**2 * left:
            notes.append(
                f"a mirror image would fit better ({unmirrored**0.5:.3g} instead of"
                f" {left**0.5:.3g}): rows of images count downwards, see the setting reflect"
            )
    shift = (origins[0] + mean_x) - factor * rotation @ (origins[1] + mean_y)
    return RigidMotion(rotation, shift, factor, reflected, float(left**0.5), tuple(notes))


def _middle(points: Reals) -> Reals:
    known = points[np.isfinite(points).all(axis=2)]
    return known.mean(axis=0) if len(known) else np.zeros(points.shape[2])


def _least_turn(u: Reals, s: Reals, vt: Reals, rank: int) -> Reals:
    """Return the smallest rotation that takes the one known direction to the other."""
    d = len(s)
    if rank == 0:
        return np.eye(d)
    a, b = vt[0], u[:, 0]
    cosine = float(a @ b)
    if cosine < -1.0 + 1e-12:
        # Half a turn about any axis across.
        across = np.eye(d)[int(np.argmin(np.abs(a)))]
        across = across - (across @ a) * a
        across /= np.linalg.norm(across)
        return 2.0 * np.outer(across, across) - np.eye(d)
    # Rodrigues' formula for the turn that takes a to b.
    skew = np.outer(b, a) - np.outer(a, b)
    return np.eye(d) + skew + skew @ skew / (1.0 + cosine)


__all__ = ["RigidMotion", "fit_rigid_motion"]
