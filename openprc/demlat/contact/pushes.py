"""Who takes part in a contact, how they move, and what a push does to them."""

from __future__ import annotations

from typing import Any

from openprc.demlat.compiled.jit import jit
from openprc.demlat.contact.table import NEXT
from openprc.demlat.contact.triangle import measure, members, where
from openprc.demlat.models.barhinge.tables import CONTACT, LEDGER_STRIDE, WORK_IN


@jit
def roles_of(touch: Any, contact: int, shares: Any) -> Any:
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


@jit
def last_hit(touch: Any, contact: int) -> float:
    """Return how long before the end one of those in the contact was last hit."""
    a, b, c, d = members(touch, contact)
    since = touch.since
    return min(min(since[a], since[b]), min(since[c], since[d]))
