"""Copies of whole arrays inside compiled code, where nothing may be allocated."""

from __future__ import annotations

from typing import Any

from numba import types

from openprc.demlat.compiled.jit import chosen_by_type, jit
from openprc.demlat.compiled.lanes import load, store


@jit
def copy(lanes: Any, target: Any, source: Any) -> None:
    """Copy coordinates, or a row of a ledger, whose size is a multiple of the lanes."""
    for at in range(0, target.size, len(lanes)):
        store(lanes, target, at, load(lanes, source, at, 0))


def copy_if_any(lanes: Any, target: Any, source: Any) -> None:
    """Do so unless `source` is None."""


@chosen_by_type(copy_if_any)
def _copy_if_any(lanes, target, source):
    if isinstance(source, types.NoneType):
        return lambda lanes, target, source: None
    return lambda lanes, target, source: copy(lanes, target, source)
