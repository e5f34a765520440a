"""Contact as a part of every step with a fixed size, whatever the scheme."""

from __future__ import annotations

import math
from typing import Any

from openprc.demlat.compiled.jit import chosen_by_type, jit
from openprc.demlat.contact.impacts import let_bounce
from openprc.demlat.contact.records import forget_chains, open_records
from openprc.demlat.contact.response import let_part, let_rest
from openprc.demlat.contact.search import MARGIN, copy_to, gather, keep_lists, largest_move
from openprc.demlat.contact.table import Motion

#: In place of a coordinate that left the plausible range: a list was too short. What was done
#: since the state was last saved is to be repeated with more room.
OVERFULL = -2


def remember(contacts: Any, state: Any) -> None:
    """Keep the state at the start of a step."""


@chosen_by_type(remember)
def _remember(contacts, state):
    if len(contacts) == 0:
        return lambda contacts, state: None

    def keep(contacts, state):
        copy_to(contacts[0].start, state.x)
        copy_to(contacts[0].acceleration, state.v)

    return keep


@jit
def respond(table: Any, body: Any, state: Any, h: float) -> int:
    """Let bodies touch; return 1 if the state changed, 0 if not, `OVERFULL` without room."""
    acceleration, lists, touch = table.acceleration, table.lists, table.touch
    for at in range(acceleration.size):
        acceleration[at] = (state.v[at] - acceleration[at]) / h
    stride = body.stride
    margin = MARGIN * largest_move(lists, stride, state.x, table.start)
    if not keep_lists(lists, stride, state.x, margin):
        return OVERFULL
    if not gather(lists, touch, stride, state.x, margin):
        return OVERFULL
    if touch.count[0] == 0:
        return 0
    motion = Motion(
        stride,
        state.x,
        state.v,
        body.inverse_mass,
        table.start,
        acceleration,
        state.ledger,
    )
    open_records(touch, motion, h)
    changed = let_bounce(touch, motion)
    changed |= let_rest(touch, motion)
    changed |= let_part(touch, motion)
    forget_chains(touch)
    return int(changed)


def collide(scheme: Any, body: Any, state: Any, h: float) -> bool:
    """Let bodies touch at the end of a step; say whether a list was too short for that."""


@chosen_by_type(collide)
def _collide(scheme, body, state, h):
    kinds = dict(zip(body.fields, body.types, strict=True))
    if len(kinds["contacts"]) == 0:
        return lambda scheme, body, state, h: False

    def after_step(scheme, body, state, h):
        outcome = respond(body.contacts[0], body, state, h)
        if outcome == 1:
            forget_forces(scheme)
        return outcome == OVERFULL

    return after_step


def forget_forces(scheme: Any) -> None:
    """Tell a scheme that carries forces from step to step that the state has changed."""


@chosen_by_type(forget_forces)
def _forget_forces(scheme):
    fields = getattr(scheme, "fields", ())
    if "clock" in fields:

        def unwind(scheme):
            scheme.clock[0] = math.nan

        return unwind
    if "fast" in fields:
        return lambda scheme: forget_forces(scheme.fast)
    return lambda scheme: None
