"""Echo-state (fading-memory) time: how long a body remembers.

Two views of the same thing. By replicas: how long the response still shows how the body began,
which is what a washout has to outlast. By the memory profile: how far back the inputs lie that
a linear readout can still recall.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.dynamics.replica_convergence import Convergence, convergence, time_below
from openprc.errors import TaskError


@dataclass(frozen=True)
class ReplicaTest:
    """Several runs of a body from different initial states, each compared with one from rest.

    Parameters
    ----------
    pairs : tuple of Convergence
    """

    pairs: tuple[Convergence, ...]

    @property
    def unit(self) -> str:
        """Unit of times; rates are per this unit."""
        return self.pairs[0].unit

    @property
    def converged(self) -> bool:
        """Whether all pairs converged: the echo state property, as far as it was tried."""
        return all(pair.converged for pair in self.pairs)

    @property
    def rate(self) -> float:
        """The slowest rate of all pairs, negative where they converge."""
        return max(pair.rate for pair in self.pairs)

    def time_to(self, tolerance: float = 1.0 / np.e) -> float:
        """Return the longest time of all pairs; see `Convergence.time_to`."""
        return max(pair.time_to(tolerance) for pair in self.pairs)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the pairs remark, each once."""
        return tuple(dict.fromkeys(pair.remark for pair in self.pairs if pair.remark))


def replica_test(
    body: Any,
    u: ArrayLike,
    *,
    spread: float,
    n_replicas: int = 3,
    scale: ArrayLike | None = None,
    hold: float | None = None,
    seed: int | np.random.Generator = 0,
) -> ReplicaTest:
    """Drive a body from rest and from random initial states, and see whether they converge.

    Parameters
    ----------
    body
        With ``reset()``, ``step(u) -> (N,)`` and an attribute ``state`` (N,) that can be set.
    u : (K,) or (K, C)
        The same drive for all; long enough for the steady state to fill its second half.
    spread : float
        Standard deviation of the initial states about rest, in the unit of the states.
    n_replicas : int
        Initial states that are tried besides rest.
    scale : (N,), optional
        As in `convergence`.
    hold : float, optional [s]
        Duration of a symbol; times are then in seconds, otherwise in symbols.
    seed : int or numpy.random.Generator
        Of the initial states.

    Raises
    ------
    TaskError
        When the state of the body cannot be set, or counts and spread make no sense; as
        `convergence`.
    """
    if n_replicas < 1 or not (np.isfinite(spread) and spread > 0.0):
        raise TaskError(
            f"n_replicas is {n_replicas} and spread is {spread!r}",
            expected="at least 1, and a positive number",
            fix="correct these",
            key="spread",
        )
    symbols = np.asarray(u, dtype=np.float64)
    symbols = symbols[:, None] if symbols.ndim == 1 else symbols
    rng = np.random.default_rng(seed)
    body.reset()
    rest = settable_state(body)
    reference = _run(body, symbols, rest)
    step, unit = (1.0, "symbols") if hold is None else (float(hold), "s")
    pairs = []
    for _ in range(n_replicas):
        other = _run(body, symbols, rest + spread * rng.normal(size=rest.shape))
        pairs.append(convergence(reference, other, step=step, unit=unit, scale=scale))
    return ReplicaTest(tuple(pairs))


def settable_state(body: Any) -> NDArray[np.float64]:
    """Return a copy of the state of a body, and make sure that it can be set.

    Raises
    ------
    TaskError
        When it cannot.
    """
    state = getattr(body, "state", None)
    settable = state is not None and np.shape(state) == (body.n_states,)
    if settable:
        try:
            body.state = np.array(state, dtype=np.float64)
        except AttributeError:
            settable = False
    if not settable:
        raise TaskError(
            f"the state of {type(body).__name__} cannot be set",
            expected="an attribute state, (N,), that can be read and set",
            fix="record two runs from different initial states under the same drive, and "
            "compare these with openprc.analysis.dynamics.replica_convergence",
            key="body",
        )
    return np.array(state, dtype=np.float64)


def _run(
    body: Any, symbols: NDArray[np.float64], start: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the states at the start and after each symbol, (K + 1, N)."""
    body.state = start
    return np.stack([start, *(np.array(body.step(symbol)) for symbol in symbols)])


@dataclass(frozen=True)
class MemoryTime:
    """What a profile of memory capacities says about how far back memory reaches.

    Parameters
    ----------
    decay : float
        Delay from which on the capacities stay at or below 1/e of the largest; infinite where
        the profile ends before that. Between delays the logarithm is interpolated.
    mean_delay : float
        Mean delay weighted by capacity.
    last_delay : float
        Largest delay whose capacity exceeds the threshold; -1 where none does.
    unit : str
        ``"symbols"`` or ``"s"``.
    remark : str
    """

    decay: float
    mean_delay: float
    last_delay: float
    unit: str
    remark: str


def memory_time(
    profile: ArrayLike,
    *,
    threshold: float = 0.0,
    first_delay: int = 0,
    hold: float | None = None,
) -> MemoryTime:
    """Reduce a profile of memory capacities to times.

    Parameters
    ----------
    profile : (K,)
        Capacity of delay ``first_delay + k`` at position k.
    threshold : float
        Capacities up to here are taken for zero: for estimates, the significance threshold.
    first_delay : int
        0, or 1 where the profile leaves the present input out.
    hold : float, optional [s]
        Duration of a symbol; times are then in seconds, otherwise in symbols.

    Raises
    ------
    TaskError
        When the profile is no row of finite numbers.
    """
    values = np.asarray(profile, dtype=np.float64)
    if values.ndim != 1 or not len(values) or not np.isfinite(values).all():
        raise TaskError(
            f"the profile has shape {values.shape}"
            + ("" if np.isfinite(values).all() else " and is not finite"),
            expected="(K,), one capacity per delay",
            fix="pass the linear capacities by delay",
            key="profile",
        )
    step, unit = (1.0, "symbols") if hold is None else (float(hold), "s")
    kept = np.where(values > threshold, values, 0.0)
    delay = step * (first_delay + np.arange(len(kept)))
    seen = np.flatnonzero(kept)
    if not len(seen):
        return MemoryTime(0.0, 0.0, -1.0, unit, "no capacity exceeds the threshold: no memory")
    decay = time_below(kept, delay, float(kept.max()) / np.e)
    remark = ""
    if seen[-1] == len(kept) - 1:
        remark = (
            f"the capacity of the last delay, {delay[-1]:g} {unit}, still exceeds the threshold: "
            "memory reaches further than the profile, and these figures are lower bounds"
        )
    return MemoryTime(
        decay=decay,
        mean_delay=float(delay @ kept / kept.sum()),
        last_delay=float(delay[seen[-1]]),
        unit=unit,
        remark=remark,
    )
