"""The point of a triangle, or of another node, that is nearest to a node."""

from __future__ import annotations

import math
from typing import Any

from openprc.demlat.compiled.jit import jit
from openprc.demlat.contact.table import SIDE

#: All three corners take part: the nearest point is inside.
INSIDE = 7


@jit
def dot(a: Any, b: Any) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jit
def minus(a: Any, b: Any) -> Any:
    """Return ``a - b``."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@jit
def times(a: Any, factor: float) -> Any:
    """Return ``factor * a``."""
    return a[0] * factor, a[1] * factor, a[2] * factor


@jit
def cross(a: Any, b: Any) -> Any:
    """Return the vector product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@jit
def _along_edge(p: Any, a: Any, b: Any) -> float:
    """Return where the foot of p on a-b is: 0 at a, 1 at b, never beyond them."""
    edge = minus(b, a)
    square = dot(edge, edge)
    if square == 0.0:
        return 0.0
    return min(max(dot(minus(p, a), edge) / square, 0.0), 1.0)


@jit
def nearest_on_triangle(p: Any, a: Any, b: Any, c: Any) -> Any:
    """Return the barycentric coordinates of the point nearest to p, and whether it is inside.

    Inside, they are ratios of areas: those of the triangles between the foot of p and the
    sides (Ericson, Real-Time Collision Detection, 2005, sec. 3.4). Where one is negative, or
    the triangle has no area, the nearest point is on an edge: the nearest of those on all three.
    """
    ab, ac, ap = minus(b, a), minus(c, a), minus(p, a)
    normal = cross(ab, ac)
    square = dot(normal, normal)
    if square > 0.0:
        v = dot(cross(ap, ac), normal) / square
        w = dot(cross(ab, ap), normal) / square
        u = 1.0 - v - w
        if u >= 0.0 and v >= 0.0 and w >= 0.0:
            return u, v, w, True
    best = math.inf
    result = (1.0, 0.0, 0.0, False)
    for edge in range(3):
        if edge == 0:
            start, end = a, b
        elif edge == 1:
            start, end = b, c
        else:
            start, end = c, a
        s = _along_edge(p, start, end)
        gap = minus(p, start)
        gap = minus(gap, times(minus(end, start), s))
        far = dot(gap, gap)
        if far < best:
            best = far
            if edge == 0:
                result = (1.0 - s, s, 0.0, False)
            elif edge == 1:
                result = (0.0, 1.0 - s, s, False)
            else:
                result = (s, 0.0, 1.0 - s, False)
    return result


@jit
def where(stride: int, x: Any, node: int) -> Any:
    """Return the three components of `node` in flat coordinates."""
    return x[node], x[stride + node], x[2 * stride + node]


@jit
def earlier(motion: Any, x: Any, node: int, s: float) -> Any:
    """Return where `node` was at the time `s` before the end of the step."""
    p, u = where(motion.stride, x, node), where(motion.stride, motion.v, node)
    a = where(motion.stride, motion.acceleration, node)
    half = 0.5 * s * s
    return (
        p[0] - s * u[0] + half * a[0],
        p[1] - s * u[1] + half * a[1],
        p[2] - s * u[2] + half * a[2],
    )


@jit
def members(touch: Any, contact: int) -> Any:
    """Return the node of a contact and the three corners, or thrice the other node."""
    node, other = touch.near[contact, 0], touch.near[contact, 1]
    if other >= 0:
        return node, other, other, other
    first = 3 * (-1 - other)
    return node, touch.faces[first], touch.faces[first + 1], touch.faces[first + 2]


@jit
def signed_height(touch: Any, motion: Any, x: Any, contact: int) -> float:
    """Return how far the node is above the plane of the face [m]."""
    p, a, b, c = members(touch, contact)
    origin = where(motion.stride, x, a)
    normal = cross(
        minus(where(motion.stride, x, b), origin), minus(where(motion.stride, x, c), origin)
    )
    size = math.sqrt(dot(normal, normal))
    if size == 0.0:
        return 0.0
    return dot(minus(where(motion.stride, x, p), origin), normal) / size


@jit
def measure(touch: Any, motion: Any, x: Any, contact: int, s: float) -> Any:
    """Look at a contact at the time `s` before the end of the step.

    Returns
    -------
    gap : float [m]
        Negative where they overlap. A node that is behind a face overlaps all the more.
    normal : 3 floats
        Towards the node; 0 where there is none.
    shares : 3 floats
        Of the corners in the nearest point.
    inside : bool
        Whether that is inside the face; False for two nodes.
    """
    p, a, b, c = members(touch, contact)
    place = earlier(motion, x, p, s)
    at_a = earlier(motion, x, a, s)
    if touch.near[contact, 1] >= 0:
        apart = minus(place, at_a)
        far = math.sqrt(dot(apart, apart))
        scale = 1.0 / far if far > 0.0 else 0.0
        return far - touch.distance, times(apart, scale), (1.0, 0.0, 0.0), False
    at_b = earlier(motion, x, b, s)
    at_c = earlier(motion, x, c, s)
    share_a, share_b, share_c, inside = nearest_on_triangle(place, at_a, at_b, at_c)
    if inside:
        normal = cross(minus(at_b, at_a), minus(at_c, at_a))
        normal = times(normal, touch.record[contact, SIDE] / math.sqrt(dot(normal, normal)))
        far = dot(minus(place, at_a), normal)
    else:
        normal = minus(place, times(at_a, share_a))
        normal = minus(normal, times(at_b, share_b))
        normal = minus(normal, times(at_c, share_c))
        far = math.sqrt(dot(normal, normal))
        normal = times(normal, 1.0 / far if far > 0.0 else 0.0)
    return far - touch.radius, normal, (share_a, share_b, share_c), inside
