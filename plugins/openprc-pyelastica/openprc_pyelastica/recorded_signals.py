"""What drives the body, as a script tells its recorder: functions of time, arrays, symbols."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError

#: Slack, in symbols, within which a time counts as the beginning of the next symbol.
SYMBOL_SLACK = 1e-6
_KEYS = frozenset({"value", "unit", "quantity", "targets", "columns", "sequence", "hold", "start"})


@dataclass(frozen=True)
class Signal:
    """A named drive.

    Parameters
    ----------
    name : str
    read : callable
        ``read(time, step)`` returns C numbers.
    columns : C names
    declaration : mapping
        The other arguments of `TrajectoryWriter.declare_input`.
    """

    name: str
    read: Callable[[float, int], NDArray[np.float64]]
    columns: tuple[str, ...]
    declaration: Mapping[str, Any] = field(default_factory=dict)


def signals_of(given: Mapping[str, Any] | None) -> tuple[Signal, ...]:
    """Turn the option `signals` into signals.

    Parameters
    ----------
    given : mapping of name to a callable, an array, or a mapping
        ``u(t)``; an array whose row k is the value at simulation step k; or
        ``{"value": either of them, "unit", "quantity", "targets", "columns", "sequence",
        "hold", "start"}``. With a sequence and its hold the value may be left out.

    Raises
    ------
    ConfigError
        A signal is none of these.
    """
    if given is None:
        return ()
    if not isinstance(given, Mapping):
        raise ConfigError(
            f"signals is a {type(given).__name__}",
            expected="a mapping of name to a function of t, an array, or a mapping",
            fix='say signals={"u": lambda t: ...}',
            key="signals",
        )
    return tuple(_signal(str(name), value) for name, value in given.items())


def _signal(name: str, given: Any) -> Signal:
    settings = dict(given) if isinstance(given, Mapping) else {"value": given}
    unknown = sorted(set(settings) - _KEYS)
    if unknown:
        raise _wrong(name, f"unknown keys {unknown}", "some of " + ", ".join(sorted(_KEYS)))
    symbols = None
    if "sequence" in settings:
        symbols = np.asarray(settings["sequence"], dtype=np.float64)
        symbols = symbols[:, np.newaxis] if symbols.ndim == 1 else symbols
        hold = settings.get("hold")
        if symbols.ndim != 2 or not symbols.size or hold is None or not hold > 0.0:
            raise _wrong(name, "a sequence without a hold above 0 s, or none of (K, C)", "both")
    value = settings.get("value")
    if value is None:
        if symbols is None:
            raise _wrong(name, "neither a value nor a sequence", "one of them")
        if settings.get("start", 0.0) > 0.0:
            raise _wrong(name, "a sequence that starts after t = 0, and no value", "a value, too")
        read = _held(symbols, float(settings["hold"]), float(settings.get("start", 0.0)))
    elif callable(value):
        read = _function(name, value)
    else:
        read = _row(name, value)
    width = len(read(0.0, 0))
    columns = tuple(settings.get("columns") or _columns(width))
    if len(columns) != width:
        raise _wrong(name, f"{len(columns)} columns for {width} values", "a name for each")
    declaration: dict[str, Any] = {
        "unit": settings.get("unit", "1"),
        "quantity": settings.get("quantity", "signal"),
        "targets": tuple(settings.get("targets", ())),
    }
    if symbols is not None:
        declaration |= {"sequence": symbols, "hold": float(settings["hold"])}
        declaration["start"] = float(settings.get("start", 0.0))
    return Signal(name, read, columns, declaration)


def _columns(width: int) -> tuple[str, ...]:
    if width == 1:
        return ("value",)
    return tuple("xyz") if width == 3 else tuple(f"c{i}" for i in range(width))


def _function(name: str, value: Callable[..., Any]) -> Callable[[float, int], NDArray[np.float64]]:
    def read(time: float, step: int) -> NDArray[np.float64]:
        del step
        numbers = np.atleast_1d(np.asarray(value(time), dtype=np.float64))
        if numbers.ndim != 1 or not np.isfinite(numbers).all():
            raise _wrong(
                name, f"{value!r} returned {numbers} at t = {time:g} s", "finite numbers (C,)"
            )
        return numbers

    return read


def _row(name: str, value: Any) -> Callable[[float, int], NDArray[np.float64]]:
    rows = np.asarray(value, dtype=np.float64)
    rows = rows[:, np.newaxis] if rows.ndim == 1 else rows
    if rows.ndim != 2 or not rows.size or not np.isfinite(rows).all():
        raise _wrong(name, f"an array of shape {np.shape(value)}", "finite numbers (K,) or (K, C)")

    def read(time: float, step: int) -> NDArray[np.float64]:
        if step >= len(rows):
            raise _wrong(
                name,
                f"{len(rows)} rows, and the simulation is at step {step}, t = {time:g} s",
                "a row for each simulation step, the one at t = 0 included",
            )
        return rows[step]

    return read


def _held(
    symbols: NDArray[np.float64], hold: float, start: float
) -> Callable[[float, int], NDArray[np.float64]]:
    def read(time: float, step: int) -> NDArray[np.float64]:
        del step
        symbol = math.floor((time - start) / hold + SYMBOL_SLACK)
        return symbols[min(symbol, len(symbols) - 1)]  # the last one stays

    return read


def _wrong(name: str, found: str, expected: str) -> ConfigError:
    return ConfigError(
        f"signal {name!r}: {found}",
        expected=expected,
        fix="give a function of t, an array with a row for each step, or a mapping with 'value'",
        key="signals",
    )
