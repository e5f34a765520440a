"""Impacts within a step; see `openprc.demlat.contact.response`."""

from __future__ import annotations

import math
from typing import Any

from openprc.demlat.compiled.jit import jit
from openprc.demlat.contact.pushes import approach, is_seam, last_hit, mobility, push, roles_of
from openprc.demlat.contact.table import ALLOWED, CROSSED, LEVER, ORDER
from openprc.demlat.contact.triangle import dot, measure, minus, times, where

#: Speeds below this share of those that make them up are rounding.
ROUNDING = 1e-12
#: Gaps below this share of the distance of contact are closed.
CLOSED = 1e-13
ONES = (1.0, 1.0, 1.0)


@jit
def _room(touch: Any, motion: Any, contact: int, s: float) -> float:
    """Return the gap at `s` before the end over the one that is let be."""
    gap, _, _, _ = measure(touch, motion, motion.x, contact, s)
    return gap - touch.record[contact, ALLOWED]


@jit
def time_of_impact(touch: Any, motion: Any, contact: int, hi: float) -> float:
    """Return how long before the end bodies met that had room at `hi`; -1 if they did not.

    A bracket is narrowed by false position (the Illinois rule: Dowell & Jarratt 1971,
    doi:10.1007/BF01934364), and halved where that is slow.
    """
    lo, room_lo = 0.0, _room(touch, motion, contact, 0.0)
    if room_lo >= 0.0:
        lo = touch.record[contact, CROSSED]
        if lo == 0.0 or lo >= hi:
            return -1.0
        room_lo = _room(touch, motion, contact, lo)
        if room_lo >= 0.0:
            return -1.0
    room_hi = _room(touch, motion, contact, hi)
    if room_hi <= CLOSED * touch.distance:
        return hi
    last = 0
    for turn in range(80):
        s = hi - room_hi * (hi - lo) / (room_hi - room_lo)
        if turn % 8 == 7 or not lo < s < hi:
            s = 0.5 * (lo + hi)
        room = _room(touch, motion, contact, s)
        if abs(room) <= CLOSED * touch.distance or hi - lo <= 1e-15 * hi:
            return s
        if room < 0.0:
            lo, room_lo = s, room
            if last == -1:
                room_hi *= 0.5
            last = -1
        else:
            hi, room_hi = s, room
            if last == 1:
                room_lo *= 0.5
            last = 1
    return 0.5 * (lo + hi)


@jit
def _bounce(touch: Any, motion: Any, roles: Any, normal: Any, restitution: float, s: float) -> Any:
    """Return the impulse of an impact, friction included."""
    u = approach(motion, roles, s)
    speed = dot(u, normal)
    size = -(1.0 + restitution) * speed / mobility(motion, roles, normal)
    impulse = times(normal, size)
    if touch.friction > 0.0:
        slip = minus(u, times(normal, speed))
        fast = math.sqrt(dot(slip, slip))
        if fast > ROUNDING * abs(speed):
            along = times(slip, 1.0 / fast)
            ease = mobility(motion, roles, along)
            if ease > 0.0:
                rub = min(touch.friction * size, fast / ease)
                impulse = minus(impulse, times(along, rub))
    return impulse


@jit
def strike(touch: Any, motion: Any, contact: int) -> int:
    """Let two bodies that met in the step bounce; return 2 then, 1 if they stay together, or 0."""
    latest = last_hit(touch, contact)
    s = time_of_impact(touch, motion, contact, latest)
    if s < 0.0:
        return 0
    gap, normal, shares, inside = measure(touch, motion, motion.x, contact, s)
    roles = roles_of(touch, contact, shares)
    if mobility(motion, roles, normal) <= 0.0:
        return 0
    u = approach(motion, roles, s)
    end = approach(motion, roles, 0.0)
    speed = dot(u, normal)
    if speed >= -ROUNDING * (abs(dot(end, normal)) + math.sqrt(dot(u, u))):
        return 0
    if not inside and is_seam(touch, motion, contact, shares, s):
        return 0
    restitution, most = touch.restitution, min(gap, touch.record[contact, ALLOWED])
    for _ in range(2):
        impulse = _bounce(touch, motion, roles, normal, restitution, s)
        push(motion, roles, impulse, s)
        after, _, _, _ = measure(touch, motion, motion.x, contact, 0.0)
        if restitution == 0.0 or after >= most - CLOSED * touch.distance:
            break
        # It falls back within the step: as if nothing had been, but without rebound.
        push(motion, roles, times(impulse, -1.0), s)
        restitution = 0.0
    touch.record[contact, CROSSED] = 0.0
    for k in range(4):
        if (
            roles[1][k] != 0.0
            and dot(where(motion.stride, motion.inverse_mass, roles[0][k]), ONES) > 0.0
        ):
            touch.since[roles[0][k]] = s
    return 2 if restitution > 0.0 else 1


@jit
def sort_by_time(touch: Any, motion: Any) -> int:
    """Put contacts in which bodies met into `ORDER`, the earliest first; return how many.

    Sorting is Shell's: without further memory, and quick when little is out of order.
    """
    near, record, count = touch.near, touch.record, 0
    for c in range(touch.count[0]):
        s = time_of_impact(touch, motion, c, last_hit(touch, c))
        if s >= 0.0:
            record[c, LEVER] = s
            near[count, ORDER] = c
            count += 1
    gap = 1
    while 3 * gap < count:
        gap = 3 * gap + 1
    while gap >= 1:
        for at in range(gap, count):
            chosen = near[at, ORDER]
            s = record[chosen, LEVER]
            while at >= gap and record[near[at - gap, ORDER], LEVER] < s:
                near[at, ORDER] = near[at - gap, ORDER]
                at -= gap
            near[at, ORDER] = chosen
        gap //= 3
    return count


@jit
def let_bounce(touch: Any, motion: Any) -> bool:
    """Deal with the impacts of a step; say whether there was one."""
    count = sort_by_time(touch, motion)
    if count == 0:
        return False
    strongest = 0
    for place in range(count):
        strongest = max(strongest, strike(touch, motion, touch.near[place, ORDER]))
    n = touch.count[0]
    for sweep in range(touch.iterations):
        # Who only lands is left to `let_rest`.
        again = 0
        for place in range(n):
            again = max(again, strike(touch, motion, place if sweep % 2 == 0 else n - 1 - place))
        strongest = max(strongest, again)
        if again < 2:
            break
    return strongest > 0
