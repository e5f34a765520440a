"""Integrating the powers of losses and actuators along with the motion."""

from __future__ import annotations

from typing import Any

from numba import types

from openprc.demlat.compiled.aligned import aligned_zeros
from openprc.demlat.compiled.jit import chosen_by_type
from openprc.demlat.compiled.lanes import add, load
from openprc.demlat.integrators import Settings
from openprc.demlat.models.barhinge.tables import Body, Reals, ledger_size


def make_rates(body: Body, settings: Settings) -> Reals | None:
    """Return an array for the powers, or None when no ledger is kept."""
    if not settings.ledger:
        return None
    return aligned_zeros(ledger_size(with_bends=bool(body.bends)), body.mass.dtype)


def book(ledger: Any, lanes: Any, rates: Any, weight: float) -> None:
    """Add `weight` times the powers to the ledger."""


@chosen_by_type(book)
def _book(ledger, lanes, rates, weight):
    if isinstance(rates, types.NoneType):
        return lambda ledger, lanes, rates, weight: None

    def every_row(ledger, lanes, rates, weight):
        for at in range(0, rates.size, len(lanes)):
            add(lanes, ledger, at, 0, weight * load(lanes, rates, at, 0))

    return every_row
