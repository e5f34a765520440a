"""How the step began for each of its contacts."""

from __future__ import annotations

from typing import Any

from openprc.demlat.compiled.jit import jit
from openprc.demlat.contact.table import ALLOWED, CROSSED, NEXT, SIDE, SLOP
from openprc.demlat.contact.triangle import dot, measure, members, minus, signed_height, where


@jit
def open_records(touch: Any, motion: Any, h: float) -> None:
    """Say of every contact how the step began for it, and chain the contacts of a node."""
    record, near = touch.record, touch.near
    for c in range(touch.count[0]):
        near[c, NEXT] = touch.first_of[near[c, 0]]
        touch.first_of[near[c, 0]] = c
        for node in members(touch, c):
            touch.since[node] = h
        record[c, :] = 0.0
        if near[c, 1] >= 0:
            record[c, CROSSED] = _closest_approach(touch, motion, c, h)
        else:
            _choose_side(touch, motion, c, h)
        # Positions of the start stand for themselves: s = 0 leaves them as they are.
        gap, _, _, _ = measure(touch, motion, motion.start, c, 0.0)
        if gap < -SLOP * touch.distance:
            record[c, ALLOWED] = gap


@jit
def forget_chains(touch: Any) -> None:
    """Take the chains of nodes apart."""
    for c in range(touch.count[0]):
        touch.first_of[touch.near[c, 0]] = -1


@jit
def _closest_approach(touch: Any, motion: Any, contact: int, h: float) -> float:
    """Return how long before the end two nodes were closest on straight lines."""
    i, j, _, _ = members(touch, contact)
    apart = minus(where(motion.stride, motion.x, i), where(motion.stride, motion.x, j))
    before = minus(where(motion.stride, motion.start, i), where(motion.stride, motion.start, j))
    way = minus(apart, before)
    square = dot(way, way)
    if square == 0.0:
        return 0.0
    return h * min(max(dot(apart, way) / square, 0.0), 1.0)


@jit
def _choose_side(touch: Any, motion: Any, contact: int, h: float) -> None:
    """Set the side of the face that the node is on, and when it went through."""
    record = touch.record
    below = signed_height(touch, motion, motion.start, contact)
    now = signed_height(touch, motion, motion.x, contact)
    record[contact, SIDE] = 1.0 if now >= 0.0 else -1.0
    if below * now < 0.0:
        s = h * abs(now) / (abs(below) + abs(now))
        _, _, _, inside = measure(touch, motion, motion.x, contact, s)
        if inside:
            record[contact, SIDE] = 1.0 if below > 0.0 else -1.0
            record[contact, CROSSED] = s
