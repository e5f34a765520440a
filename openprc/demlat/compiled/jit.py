"""The ways in which functions of the engine are compiled."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from functools import cache, wraps
from pathlib import Path
from typing import Any

import numba
from numba.extending import overload

from openprc.demlat.compiled.lanes import FAST

#: Division by zero gives infinity, as in NumPy, and needs no branch. NaNs stay NaNs.
_OPTIONS = {"error_model": "numpy", "fastmath": set(FAST), "_nrt": False}
#: Rooms of the engine that no compiled function takes anything from.
NEVER_COMPILED = ("meshing", "planning", "statics")
#: Nobody calls these from Python.
_INNER = _OPTIONS | {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def jit(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function that is called from compiled functions only."""
    compiled: Callable[..., Any] = numba.njit(**_INNER)(function)
    return compiled


def chosen_by_type(symbol: Callable[..., Any]) -> Callable[..., Any]:
    """Make calls of `symbol` in compiled code mean what the decorated function returns.

    The decorated function is given the numba types of the arguments while the caller is being
    compiled, and returns a function, or None to leave the choice to another one. So what a
    scene does not have costs nothing.
    """

    def register(choose: Callable[..., Any]) -> Callable[..., Any]:
        # numba wants the same signature from chooser and chosen, annotations included.
        choose.__annotations__ = {}

        @wraps(choose)
        def bare(*kinds: Any, **more: Any) -> Any:
            chosen = choose(*kinds, **more)
            if chosen is not None:
                chosen.__annotations__ = {}
            return chosen

        overload(symbol, jit_options=_INNER)(bare)
        return choose

    return register


def entry(build: Callable[[int], Callable[..., Any]]) -> Callable[..., Any]:
    """Compile the function that `build` returns, to be called from Python and kept on disk.

    numba keys its cache on the bytecode of a function and on what it closes over, not on the
    functions that it calls: `build` is given a stamp of the engine's source, and what it
    returns must mention it, so that an edit anywhere counts.
    """
    function = build(source_stamp())
    try:
        compiled: Callable[..., Any] = numba.njit(cache=True, nogil=True, **_OPTIONS)(function)
    except RuntimeError:
        # There is no folder in which the compiled code could be kept.
        compiled = numba.njit(nogil=True, **_OPTIONS)(function)
    return compiled


@cache
def source_stamp() -> int:
    """Return a checksum of the source of everything that is compiled."""
    stamp = 0
    root = Path(__file__).resolve().parents[1]
    for path in sorted(root.rglob("*.py")):
        if path.relative_to(root).parts[0] not in NEVER_COMPILED:
            stamp = zlib.crc32(path.read_bytes(), stamp)
    return stamp
