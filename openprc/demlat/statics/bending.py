"""Bends: their law over whole columns, and their turns with first and second derivatives.

The coordinate of a bend is its turn [rad], pi minus the angle between its arms: 0 is straight.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from openprc.errors import NotConverged

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.geometry import Bends

    Reals = NDArray[np.float64]
    Nodes = NDArray[np.int32]

#: From the arms u = x_i - x_j and v = x_k - x_j to the nodes i, j, k.
_ARMS = np.array([[1.0, -1.0, 0.0], [0.0, -1.0, 1.0]])
#: Below this sine of the turn the arms lie on one line, but for rounding.
_COLLINEAR = 1e-13


class BendLaws:
    """The law of `openprc.schema.geometry.Bends`, springs only.

    Parameters
    ----------
    bends : Bends
    """

    def __init__(self, bends: Bends) -> None:
        self.stiffness = bends.stiffness
        self.rest = np.pi - bends.rest_angle

    def energy(self, turns: Reals) -> Reals:
        """Return elastic energies at `turns` (B,) [rad]: (B,) [J]."""
        energy: Reals = 0.5 * self.stiffness * (turns - self.rest) ** 2
        return energy

    def force(self, turns: Reals) -> Reals:
        """Return moments at `turns` (B,) [rad]: (B,) [N m], positive when they straighten."""
        moments: Reals = self.stiffness * (turns - self.rest)
        return moments

    def tangent(self, turns: Reals) -> Reals:
        """Return d(moment)/d(turn): (B,) [N m/rad]."""
        return np.broadcast_to(self.stiffness, turns.shape)


def bend_turns(x: Reals, indices: Nodes) -> Reals:
    """Return pi minus the angles between arms: (B,) [rad] in [0, pi], exact near straight.

    The arctangent of |u x v| and -u.v; u x v is taken of u and u + v, which is small there.
    """
    u, v = _arms(x, indices)
    n = np.cross(u, u + v)
    turns: Reals = np.arctan2(np.sqrt(_dot(n, n)), -_dot(u, v))
    return turns


def have_arms(x: Reals, indices: Nodes) -> NDArray[np.bool_]:
    """Return which bends have two arms with a length: (B,)."""
    u, v = _arms(x, indices)
    sound: NDArray[np.bool_] = (_dot(u, u) > 0.0) & (_dot(v, v) > 0.0)
    return sound


def bend_gradients(x: Reals, indices: Nodes) -> Reals:
    """Return d(turn)/dx at the nodes i, j, k: (B, 3, 3) [rad/m].

    ``n x u / (u.u |n|)`` at i and ``v x n / (v.v |n|)`` at k with n = u x v (Swope & Ferguson
    1992, doi:10.1002/jcc.540130508). On one line the turn has a corner; there it is 0.

    Raises
    ------
    NotConverged
        When an arm has no length.
    """
    _refuse_points(x, indices)
    u, v = _arms(x, indices)
    axis, _ = _axes(u, v)
    by_u = np.cross(axis, u) / _dot(u, u)[:, None]
    by_v = np.cross(v, axis) / _dot(v, v)[:, None]
    return np.stack([by_u, -by_u - by_v, by_v], axis=1)


def bend_slopes(x: Reals, indices: Nodes) -> Reals:
    """Return how steeply the turn changes as a node moves, at most: (B,) [rad/m]."""
    u, v = _arms(x, indices)
    slopes: Reals = 1.0 / np.sqrt(_dot(u, u)) + 1.0 / np.sqrt(_dot(v, v))
    return slopes


def bend_stiffness(x: Reals, indices: Nodes, moment: Reals, tangent: Reals) -> Reals:
    """Return second derivatives of energies at the nodes i, j, k: (B, 3, 3, 3, 3) [N/m].

    With a moment M, a tangent k and the turn p, ``(k - M cot p) g g^T - M / sin p`` times the
    second derivative of cos p. Both factors stay finite at straight where M goes as p, the
    second one reaching k: then the bend resists every sideways motion alike.

    Parameters
    ----------
    x : (N, 3) [m]
    indices : (B, 3)
    moment, tangent : (B,) [N m], [N m/rad]
        The first two derivatives of the energy by the turn.

    Raises
    ------
    NotConverged
        When an arm has no length.
    """
    _refuse_points(x, indices)
    u, v = _arms(x, indices)
    axis, sine = _axes(u, v)
    sizes = np.sqrt(np.stack([_dot(u, u), _dot(v, v)], axis=1))
    along = np.stack([u, v], axis=1) / sizes[..., None]
    cosine = -_dot(along[:, 0], along[:, 1])
    sharp = sine > _COLLINEAR
    # On one line a moment has no direction; where it vanishes there, M / sin p is k.
    limit = np.where(np.abs(moment) <= 1e-12 * tangent, tangent, 0.0)
    ratio = np.divide(moment, sine, out=limit, where=sharp)
    # The directions in which the ends move when the turn grows.
    grow = np.stack([np.cross(axis, along[:, 0]), np.cross(along[:, 1], axis)], axis=1)
    flat = np.eye(3) - along[..., :, None] * along[..., None, :]
    second = np.zeros((len(indices), 2, 3, 2, 3))
    for arm in range(2):
        mixed = along[:, arm, :, None] * (sine[:, None] * grow[:, arm])[:, None, :]
        block = cosine[:, None, None] * flat[:, arm] - mixed - np.swapaxes(mixed, 1, 2)
        second[:, arm, :, arm] = block / (sizes[:, arm] ** 2)[:, None, None]
    coupling = flat[:, 0] @ flat[:, 1] / (sizes[:, 0] * sizes[:, 1])[:, None, None]
    second[:, 0, :, 1], second[:, 1, :, 0] = coupling, np.swapaxes(coupling, 1, 2)
    second *= ratio[:, None, None, None, None]
    slope = grow / sizes[..., None]
    direct = (tangent - ratio * cosine)[:, None, None] * slope
    second += direct[..., None, None] * slope[:, None, None]
    result: Reals = np.einsum("up,euavb,vq->epaqb", _ARMS, second, _ARMS, optimize=True)
    return result


def _arms(x: Reals, indices: Nodes) -> tuple[Reals, Reals]:
    i, j, k = (x[indices[:, column]] for column in range(3))
    return i - j, k - j


def _refuse_points(x: Reals, indices: Nodes) -> None:
    bad = np.flatnonzero(~have_arms(x, indices))
    if len(bad):
        raise NotConverged(
            f"an arm of bend {int(bad[0])} {indices[bad[0]].tolist()} has no length",
            expected="a distance between its vertex and either end",
            fix="start from another state, or give the arms bars that keep their length",
        )


def _axes(u: Reals, v: Reals) -> tuple[Reals, Reals]:
    """Return unit vectors along u x v (B, 3), 0 on one line, and sines of the angles (B,)."""
    n = np.cross(u, u + v)
    length = np.sqrt(_dot(n, n))
    sine = length / np.sqrt(_dot(u, u) * _dot(v, v))
    sharp = sine > _COLLINEAR
    axis = np.divide(n, length[:, None], out=np.zeros_like(n), where=sharp[:, None])
    return axis, sine


def _dot(a: Reals, b: Reals) -> Reals:
    product: Reals = np.sum(a * b, axis=1)
    return product
