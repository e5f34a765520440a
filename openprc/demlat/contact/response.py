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
from openprc.demlat.contact.impacts import CLOSED
from openprc.demlat.contact.pushes import approach, is_seam, last_hit, mobility, push, roles_of
from openprc.demlat.contact.table import ALLOWED, FRICTION, LEVER, NORMAL
from openprc.demlat.contact.triangle import dot, measure, minus, times
from openprc.demlat.models.barhinge.tables import CONTACT, LEDGER_STRIDE

#: Sweeps end when no normal speed changes by more than this share of the largest one.
CONVERGED = 1e-9
#: Sweeps end when no gap is left that is more negative than this share.
SHUT = 1e-9


@jit
def press(touch: Any, motion: Any, contact: int) -> float:
    """Take out what is left of the approach; return by how much the normal speed changed."""
    record = touch.record
    gap, normal, shares, inside = measure(touch, motion, motion.x, contact, 0.0)
    room, pressing = gap - record[contact, ALLOWED], record[contact, NORMAL]
    if room >= 0.0 and pressing == 0.0:
        return 0.0
    roles = roles_of(touch, contact, shares)
    ease = mobility(motion, roles, normal)
    if ease <= 0.0 or (not inside and is_seam(touch, motion, contact, shares, 0.0)):
        return 0.0
    speed = dot(approach(motion, roles, 0.0), normal)
    if pressing == 0.0:
        if speed >= 0.0:
            return 0.0
        record[contact, LEVER] = 0.0
    more = max(-speed / ease, -pressing)
    latest = last_hit(touch, contact)
    lever = min(room / speed, latest) if room * speed > 0.0 else 0.0
    record[contact, NORMAL] = pressing + more
    record[contact, LEVER] += lever * more
    push(motion, roles, times(normal, more), lever)
    if touch.friction > 0.0:
        u = approach(motion, roles, 0.0)
        slip = minus(u, times(normal, dot(u, normal)))
        fast = math.sqrt(dot(slip, slip))
        if fast > 0.0:
            ease_along = mobility(motion, roles, times(slip, 1.0 / fast))
            if ease_along > 0.0:
                lever = 0.0
                if record[contact, NORMAL] > 0.0:
                    lever = record[contact, LEVER] / record[contact, NORMAL]
                lever = min(max(lever, 0.0), latest)
                _rub(touch, motion, contact, roles, times(slip, -1.0 / ease_along), lever)
    return abs(more) * ease


@jit
def _rub(touch: Any, motion: Any, contact: int, roles: Any, wanted: Any, lever: float) -> None:
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
    push(motion, roles, minus(new, old), lever)


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
    roles = roles_of(touch, contact, shares)
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
