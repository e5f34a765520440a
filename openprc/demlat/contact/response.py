r"""What contacts do to the state at the end of a step: impacts, then rest, then gaps.

A step without contact ends with positions x and velocities v; over it, coordinates had the mean
acceleration a. A push P on a node at the time s before that end changes v by ``P / m`` and x by
``s P / m``; where the node was before, the parabola ``x - v s + a s^2 / 2`` tells. This is
second order in the step for forces that depend on positions.

*Impacts*, the earliest first. The time s of an impact is where the parabolas of two bodies touch;
there the normal speed u turns into ``-e u`` (Newton), and Coulomb's law limits the tangential
part of the push to mu times the normal part. Impacts are events of two bodies each, so one that
passes a push on (a cradle) is followed by the next sweep.

*Rest.* A rebound that would fall back within the same step is no rebound: the bodies stay
together. So there is a smallest speed of bouncing, ``e u < |a| s / 2`` for the acceleration a
that presses them together, some ``g h / 2`` under gravity. What is left of the approach is taken
out by sequential impulses whose sum stays a push (Catto 2005, Iterative dynamics with temporal
coherence), with friction within the cone of that sum.
Such pushes act all the time: with gap d and speed u of approach at the end they reach ``d / u``
back, half a step for what has been at rest, and put the node on the surface.

*Gaps* that are still negative are closed by moving nodes without changing velocities.

The work of pushes and moves against a and v is booked: ``P u(s) + P^2 / 2m`` is the energy that
a push gives, so what is lost is exact for constant a. Where a coordinate is held, its mass counts
as infinite; what moving obstacles give is work put in.
"""

from __future__ import annotations

import math
from typing import Any

from openprc.demlat.compiled.jit import jit
from openprc.demlat.contact.table import (
    ALLOWED,
    CROSSED,
    FRICTION,
    LEVER,
    NEXT,
    NORMAL,
    ORDER,
    SIDE,
    SLOP,
)
from openprc.demlat.contact.triangle import (
    dot,
    measure,
    members,
    minus,
    signed_height,
    times,
    where,
)
from openprc.demlat.models.barhinge.tables import CONTACT, LEDGER_STRIDE, WORK_IN

#: Speeds below this share of those that make them up are rounding.
ROUNDING = 1e-12
#: Sweeps end when no normal speed changes by more than this share of the largest one.
CONVERGED = 1e-9
#: Gaps below this share of the distance of contact are closed.
CLOSED = 1e-13
#: Sweeps end when no gap is left that is more negative than this share.
SHUT = 1e-9
ONES = (1.0, 1.0, 1.0)


@jit
def _roles(touch: Any, contact: int, shares: Any) -> Any:
    """Return the four nodes of a contact and how much of the push each one gets."""
    return members(touch, contact), (1.0, -shares[0], -shares[1], -shares[2])


@jit
def approach(motion: Any, roles: Any, s: float) -> Any:
    """Return the velocity of the node relative to what it touches, `s` before the end."""
    nodes, parts = roles
    x, y, z = 0.0, 0.0, 0.0
    for k in range(4):
        if parts[k] != 0.0:
            u = where(motion.stride, motion.v, nodes[k])
            a = where(motion.stride, motion.acceleration, nodes[k])
            x += parts[k] * (u[0] - s * a[0])
            y += parts[k] * (u[1] - s * a[1])
            z += parts[k] * (u[2] - s * a[2])
    return x, y, z


@jit
def mobility(motion: Any, roles: Any, direction: Any) -> float:
    """Return the relative velocity along `direction` that a push of 1 along it gives [1/kg]."""
    nodes, parts = roles
    total = 0.0
    for k in range(4):
        if parts[k] != 0.0:
            w = where(motion.stride, motion.inverse_mass, nodes[k])
            square = w[0] * direction[0] ** 2 + w[1] * direction[1] ** 2 + w[2] * direction[2] ** 2
            total += parts[k] * parts[k] * square
    return total


@jit
def push(motion: Any, roles: Any, impulse: Any, s: float) -> None:
    """Let `impulse` act on the node, and its reaction, at `s` before the end; book it."""
    nodes, parts = roles
    lost, work = 0.0, 0.0
    for k in range(4):
        if parts[k] == 0.0:
            continue
        for axis in range(3):
            at = axis * motion.stride + nodes[k]
            share = parts[k] * impulse[axis]
            speed = motion.v[at] - s * motion.acceleration[at]
            w = motion.inverse_mass[at]
            lost -= share * (speed + 0.5 * share * w)
            if w == 0.0:
                work -= share * speed
            else:
                motion.v[at] += w * share
                motion.x[at] += s * w * share
    motion.ledger[CONTACT * LEDGER_STRIDE] += lost
    motion.ledger[WORK_IN * LEDGER_STRIDE] += work


@jit
def _holds(touch: Any, contact: int, shares: Any, node: int) -> bool:
    """Say whether the nearest point of a contact with a face involves the corner `node`."""
    _, a, b, c = members(touch, contact)
    if a == node:
        return shares[0] > 0.0
    if b == node:
        return shares[1] > 0.0
    return c == node and shares[2] > 0.0


@jit
def _corners(shares: Any) -> int:
    return int(shares[0] > 0.0) + int(shares[1] > 0.0) + int(shares[2] > 0.0)


@jit
def is_seam(touch: Any, motion: Any, contact: int, shares: Any, s: float) -> bool:
    """Say whether a node at an edge touches a face beyond that edge instead.

    Sliding over flat faces it would stumble over the edges between them.
    """
    if touch.near[contact, 1] >= 0:
        return False
    _, a, b, c = members(touch, contact)
    corners = _corners(shares)
    other = touch.first_of[touch.near[contact, 0]]
    while other >= 0:
        if other != contact and touch.near[other, 1] < 0:
            gap, _, theirs, inside = measure(touch, motion, motion.x, other, s)
            if gap < touch.distance and (inside or _corners(theirs) > corners):
                missing = 0
                if shares[0] > 0.0 and not _holds(touch, other, theirs, a):
                    missing += 1
                if shares[1] > 0.0 and not _holds(touch, other, theirs, b):
                    missing += 1
                if shares[2] > 0.0 and not _holds(touch, other, theirs, c):
                    missing += 1
                if missing == 0:
                    return True
        other = touch.near[other, NEXT]
    return False


# --- contacts of a step ---------------------------------------------------------------------


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


# --- impacts --------------------------------------------------------------------------------


@jit
def _latest(touch: Any, contact: int) -> float:
    a, b, c, d = members(touch, contact)
    since = touch.since
    return min(min(since[a], since[b]), min(since[c], since[d]))


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
    latest = _latest(touch, contact)
    s = time_of_impact(touch, motion, contact, latest)
    if s < 0.0:
        return 0
    gap, normal, shares, inside = measure(touch, motion, motion.x, contact, s)
    roles = _roles(touch, contact, shares)
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
        s = time_of_impact(touch, motion, c, _latest(touch, c))
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


# --- rest and gaps --------------------------------------------------------------------------


@jit
def press(touch: Any, motion: Any, contact: int) -> float:
    """Take out what is left of the approach; return by how much the normal speed changed."""
    record = touch.record
    gap, normal, shares, inside = measure(touch, motion, motion.x, contact, 0.0)
    room, pressing = gap - record[contact, ALLOWED], record[contact, NORMAL]
    if room >= 0.0 and pressing == 0.0:
        return 0.0
    roles = _roles(touch, contact, shares)
    ease = mobility(motion, roles, normal)
    if ease <= 0.0 or (not inside and is_seam(touch, motion, contact, shares, 0.0)):
        return 0.0
    speed = dot(approach(motion, roles, 0.0), normal)
    if pressing == 0.0:
        if speed >= 0.0:
            return 0.0
        record[contact, LEVER] = min(room / speed, _latest(touch, contact))
    more = max(-speed / ease, -pressing)
    record[contact, NORMAL] = pressing + more
    lever = record[contact, LEVER]
    push(motion, roles, times(normal, more), lever)
    if touch.friction > 0.0:
        u = approach(motion, roles, 0.0)
        slip = minus(u, times(normal, dot(u, normal)))
        fast = math.sqrt(dot(slip, slip))
        if fast > 0.0:
            ease_along = mobility(motion, roles, times(slip, 1.0 / fast))
            if ease_along > 0.0:
                _rub(touch, motion, contact, roles, times(slip, -1.0 / ease_along))
    return abs(more) * ease


@jit
def _rub(touch: Any, motion: Any, contact: int, roles: Any, wanted: Any) -> None:
    """Push against slip as far as the cone of friction allows."""
    record = touch.record
    old = (
        record[contact, FRICTION],
        record[contact, FRICTION + 1],
        record[contact, FRICTION + 2],
    )
    new = (old[0] + wanted[0], old[1] + wanted[1], old[2] + wanted[2])
    size, most = math.sqrt(dot(new, new)), touch.friction * record[contact, NORMAL]
    if size > most:
        new = times(new, most / size)
    for axis in range(3):
        record[contact, FRICTION + axis] = new[axis]
    push(motion, roles, minus(new, old), record[contact, LEVER])


@jit
def let_rest(touch: Any, motion: Any) -> bool:
    """Hold together what rests on something; say whether anything does."""
    n, first = touch.count[0], 0.0
    for sweep in range(touch.iterations):
        largest = 0.0
        for place in range(n):
            c = place if sweep % 2 == 0 else n - 1 - place
            largest = max(largest, press(touch, motion, c))
        first = max(first, largest)
        if largest <= CONVERGED * first:
            break
    return first > 0.0


@jit
def separate(touch: Any, motion: Any, contact: int) -> float:
    """Close a gap that is negative by moving nodes; return it."""
    gap, normal, shares, inside = measure(touch, motion, motion.x, contact, 0.0)
    room = gap - touch.record[contact, ALLOWED]
    if room >= -CLOSED * touch.distance:
        return 0.0
    roles = _roles(touch, contact, shares)
    ease = mobility(motion, roles, normal)
    if ease <= 0.0 or (not inside and is_seam(touch, motion, contact, shares, 0.0)):
        return 0.0
    nodes, parts = roles
    against = 0.0
    for k in range(4):
        if parts[k] == 0.0:
            continue
        for axis in range(3):
            at = axis * motion.stride + nodes[k]
            w, share = motion.inverse_mass[at], -parts[k] * normal[axis] * room / ease
            if w > 0.0:
                motion.x[at] += w * share
                against += share * motion.acceleration[at]
    motion.ledger[CONTACT * LEDGER_STRIDE] += against
    return -room


@jit
def let_part(touch: Any, motion: Any) -> bool:
    """Close negative gaps; say whether there were any."""
    n, moved = touch.count[0], False
    for sweep in range(touch.iterations):
        worst = 0.0
        for place in range(n):
            c = place if sweep % 2 == 0 else n - 1 - place
            worst = max(worst, separate(touch, motion, c))
        moved |= worst > 0.0
        if worst <= SHUT * touch.distance:
            break
    return moved
