"""Lengths of bars and bends of hinges with first and second derivatives."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from openprc.errors import NotConverged

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Reals = NDArray[np.float64]
    Nodes = NDArray[np.int32]

#: From a = x_i - x_j, b = x_k - x_j, c = x_k - x_l to the nodes j, k, i, l.
_EDGES = np.array([[-1.0, 0.0, 1.0, 0.0], [-1.0, 1.0, 0.0, 0.0], [0.0, 1.0, 0.0, -1.0]])


def bar_directions(x: Reals, indices: Nodes) -> tuple[Reals, Reals]:
    """Return lengths (M,) [m] and unit vectors (M, 3) from the first to the second node.

    A bar whose nodes are at one point gets the vector 0.
    """
    along = x[indices[:, 1]] - x[indices[:, 0]]
    length = np.sqrt(np.sum(along * along, axis=1))
    unit = np.divide(along, length[:, None], out=np.zeros_like(along), where=length[:, None] != 0)
    return length, unit


def bar_gradients(unit: Reals) -> Reals:
    """Return d(length)/dx at both nodes: (M, 2, 3) [1]."""
    return np.stack([-unit, unit], axis=1)


def bar_stiffness(lengths: Reals, unit: Reals, force: Reals, tangent: Reals) -> Reals:
    """Return second derivatives of energies: (M, 2, 3, 2, 3) [N/m].

    ``k n n^T + (N / l) (I - n n^T)`` with its sign by node. A spring of rest length 0 whose
    nodes are at one point has the limit ``k I``.
    """
    ratio = np.divide(force, lengths, out=tangent.copy(), where=lengths != 0)
    block = (tangent - ratio)[:, None, None] * unit[:, :, None] * unit[:, None, :]
    block += ratio[:, None, None] * np.eye(3)
    sign = np.array([[1.0, -1.0], [-1.0, 1.0]])
    result: Reals = np.einsum("pq,eab->epaqb", sign, block)
    return result


def hinge_bends(x: Reals, indices: Nodes) -> Reals:
    """Return the dihedral angles minus pi: (K,) [rad] in [-pi, pi], exact near flat.

    ``atan2(-|b| n.a, -m.n)`` with m = a x b, n = b x c (Blondel & Karplus 1996,
    doi:10.1002/(SICI)1096-987X(19960715)17:9<1132::AID-JCC5>3.0.CO;2-T).
    """
    a, b, _, m, n = _vectors(x, indices)
    bend: Reals = np.arctan2(-np.sqrt(_dot(b, b)) * _dot(n, a), -_dot(m, n))
    return bend


def hinge_gradients(x: Reals, indices: Nodes) -> Reals:
    """Return d(angle)/dx at the nodes j, k, i, l: (K, 4, 3) [rad/m].

    Liu & Paulino 2017, doi:10.1098/rspa.2017.0348. Defined for complex positions too.

    Raises
    ------
    NotConverged
        When a wing lies on its crease line, where the angle has no meaning.
    """
    a, b, c, m, n = _vectors(x, indices)
    crease, mm, nn = np.sqrt(_dot(b, b)), _dot(m, m), _dot(n, n)
    _refuse_degenerate(np.abs(crease * mm * nn), indices)
    by_a = (crease / mm)[:, None] * m
    by_c = (crease / nn)[:, None] * n
    p, q = _dot(a, b) / crease**2, _dot(c, b) / crease**2
    by_b = -(p[:, None] * by_a + q[:, None] * by_c)
    return np.stack([-by_a - by_b, by_b + by_c, by_a, -by_c], axis=1)


def hinge_hessians(x: Reals, indices: Nodes) -> Reals:
    """Return second derivatives of the angle at j, k, i, l: (K, 4, 3, 4, 3) [rad/m2].

    The derivative of `hinge_gradients`, written in the edge vectors a, b, c; like the gradient
    it never divides by the sine of the angle. An equivalent form is in Tamstorf & Grinspun
    2013, doi:10.1016/j.gmod.2013.07.001.

    Raises
    ------
    NotConverged
        When a wing lies on its crease line.
    """
    a, b, c, m, n = _vectors(x, indices)
    bb, mm, nn = _dot(b, b), _dot(m, m), _dot(n, n)
    _refuse_degenerate(bb * mm * nn, indices)
    crease = np.sqrt(bb)
    along = b / crease[:, None]
    fold_a = (crease / mm)[:, None, None] * _reflection(m, mm)
    fold_c = (crease / nn)[:, None, None] * _reflection(n, nn)
    by_a, by_c = (crease / mm)[:, None] * m, (crease / nn)[:, None] * n
    p, q = _dot(a, b) / bb, _dot(c, b) / bb
    second = np.zeros((len(indices), 3, 3, 3, 3))
    second[:, 0, :, 0] = -fold_a @ _cross_matrix(b)
    second[:, 2, :, 2] = fold_c @ _cross_matrix(b)
    ab = _outer(m / mm[:, None], along) + fold_a @ _cross_matrix(a)
    cb = _outer(n / nn[:, None], along) - fold_c @ _cross_matrix(c)
    second[:, 0, :, 1], second[:, 1, :, 0] = ab, np.swapaxes(ab, 1, 2)
    second[:, 2, :, 1], second[:, 1, :, 2] = cb, np.swapaxes(cb, 1, 2)
    p_b = (a - 2.0 * p[:, None] * b) / bb[:, None]
    q_b = (c - 2.0 * q[:, None] * b) / bb[:, None]
    second[:, 1, :, 1] = -(
        _outer(by_a, p_b) + p[:, None, None] * ab + _outer(by_c, q_b) + q[:, None, None] * cb
    )
    result: Reals = np.einsum("up,euavb,vq->epaqb", _EDGES, second, _EDGES, optimize=True)
    return result


def _vectors(x: Reals, indices: Nodes) -> tuple[Reals, Reals, Reals, Reals, Reals]:
    j, k, i, l = (x[indices[:, column]] for column in range(4))  # noqa: E741
    a, b, c = i - j, k - j, k - l
    return a, b, c, _cross(a, b), _cross(b, c)


def _cross(a: Reals, b: Reals) -> Reals:
    """Return vector products (K, 3); twice as fast as NumPy does it for a few hundred rows."""
    product = np.empty_like(a)
    for k in range(3):
        product[:, k] = a[:, k - 2] * b[:, k - 1] - a[:, k - 1] * b[:, k - 2]
    return product


def _dot(a: Reals, b: Reals) -> Reals:
    product: Reals = np.einsum("kx,kx->k", a, b)
    return product


def _outer(a: Reals, b: Reals) -> Reals:
    return a[:, :, None] * b[:, None, :]


def _reflection(normal: Reals, square: Reals) -> Reals:
    return np.eye(3) - _outer(normal, normal) * (2.0 / square)[:, None, None]


def _cross_matrix(v: Reals) -> Reals:
    """Return (K, 3, 3) such that the product with u is ``v x u``."""
    matrix = np.zeros((len(v), 3, 3))
    matrix[:, 0, 1], matrix[:, 0, 2], matrix[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    matrix[:, 1, 0], matrix[:, 2, 0], matrix[:, 2, 1] = v[:, 2], -v[:, 1], v[:, 0]
    return matrix


def _refuse_degenerate(product: Reals, indices: Nodes) -> None:
    bad = np.flatnonzero(~(product > 0.0))
    if len(bad):
        raise NotConverged(
            f"hinge {int(bad[0])} {indices[bad[0]].tolist()} has a wing on its crease line",
            expected="four nodes that form two triangles",
            fix="start from another state, or give the facets bars that keep their shape",
        )
