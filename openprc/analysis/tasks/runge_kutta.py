"""The classical Runge-Kutta step on a tuple of numbers, for the small systems of tasks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

#: Time derivatives of a state, both as tuples. Elements may be arrays: many states at once.
Rates = Callable[..., tuple[Any, ...]]


def rk4_step(rates: Rates, state: tuple[Any, ...], h: float) -> tuple[Any, ...]:
    """Return the state a time `h` later; the error of a step is of order h^5.

    Parameters
    ----------
    rates : callable
        ``rates(*state)`` of an autonomous system.
    state : tuple
    h : float
    """
    k1 = rates(*state)
    k2 = rates(*[x + 0.5 * h * k for x, k in zip(state, k1, strict=True)])
    k3 = rates(*[x + 0.5 * h * k for x, k in zip(state, k2, strict=True)])
    k4 = rates(*[x + h * k for x, k in zip(state, k3, strict=True)])
    return tuple(
        x + (h / 6.0) * (a + 2.0 * (b + c) + d)
        for x, a, b, c, d in zip(state, k1, k2, k3, k4, strict=True)
    )
