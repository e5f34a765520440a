"""Bends: their law over whole columns, and their turns with first and second derivatives.

The coordinate of a bend is its turn [rad], pi minus the angle between its arms: 0 is straight.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

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


def bend_gradients(x: Reals, indices: Nodes) -> Reals:
    """Return d(turn)/dx at the nodes i, j, k: (B, 3, 3) [rad/m].

    ``-u x n / (u.u |n|)`` at i and ``-n x v / (v.v |n|)`` at k with n = u x v (Swope & Ferguson
    1992, doi:10.1002/jcc.540130508). On one line the turn has a corner; there it is 0.
    """
    u, v = _arms(x, indices)
    axis, _ = _axes(u, v)
    by_u = -np.cross(u, axis) / _dot(u, u)[:, None]
    by_v = -np.cross(axis, v) / _dot(v, v)[:, None]
    return np.stack([by_u, -by_u - by_v, by_v], axis=1)


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
    """
    u, v = _arms(x, indices)
    turns = bend_turns(x, indices)
    size_u, size_v = np.sqrt(_dot(u, u)), np.sqrt(_dot(v, v))
    axis, sine = _axes(u, v)
    sharp = sine > _COLLINEAR
    # On one line a moment has no direction; without one, M / sin p is k.
    ratio = np.divide(moment, sine, out=np.array(tangent, dtype="f8"), where=sharp)
    ratio = np.where(sharp | (np.abs(moment) <= 1e-12 * tangent), ratio, 0.0)
    along_u, along_v = u / size_u[:, None], v / size_v[:, None]
    cosine = -_dot(along_u, along_v)
    # Of the cosine of the angle, -cos p, by u and v.
    left, right = -_reject(along_u, along_v, axis, sine), -_reject(along_v, along_u, axis, sine)
    second = np.zeros((len(indices), 2, 3, 2, 3))
    flat_u, flat_v = _across(along_u), _across(along_v)
    for arm, along, off, size, flat in (
        (0, along_u, left, size_u, flat_u),
        (1, along_v, right, size_v, flat_v),
    ):
        mixed = along[:, :, None] * off[:, None, :]
        block = mixed + np.swapaxes(mixed, 1, 2) + cosine[:, None, None] * flat
        second[:, arm, :, arm] = block / (size * size)[:, None, None]
    coupling = flat_u @ flat_v / (size_u * size_v)[:, None, None]
    second[:, 0, :, 1], second[:, 1, :, 0] = coupling, np.swapaxes(coupling, 1, 2)
    second *= ratio[:, None, None, None, None]
    by_u = -np.cross(u, axis) / (size_u**2)[:, None]
    by_v = -np.cross(axis, v) / (size_v**2)[:, None]
    slope = np.stack([by_u, by_v], axis=1)
    second += ((tangent - ratio * cosine)[:, None, None] * slope)[..., None, None] * slope[
        :, None, None
    ]
    result: Reals = np.einsum("up,euavb,vq->epaqb", _ARMS, second, _ARMS, optimize=True)
    return result
