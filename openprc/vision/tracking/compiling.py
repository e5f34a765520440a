# ruff: noqa: TID253 - the one thing that this file does is to call the compiler.
"""How the inner loops of the tracker are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba

#: Sums may be regrouped and contracted, but nothing assumes that there is no NaN: a pixel
#: without a value has to be seen in the result.
_OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "nsz", "arcp"},
}


def inner(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function that is called from compiled functions only."""
    compiled: Callable[..., Any] = numba.njit(**_OPTIONS)(function)
    return compiled


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function that Python calls, and keep the result on disk where there is a place.

    numba looks only at the file of a cached function to see whether it is stale, so a kernel
    and the functions that it calls live in one file.
    """
    try:
        compiled: Callable[..., Any] = numba.njit(cache=True, nogil=True, **_OPTIONS)(function)
    except RuntimeError:
        # There is no folder in which the compiled code could be kept.
        compiled = numba.njit(nogil=True, **_OPTIONS)(function)
    return compiled
