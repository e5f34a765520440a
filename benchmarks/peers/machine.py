"""What this machine can do at best, on one core: the limits that figures are held against."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numba
import numpy as np
from engine_scenes import Scene

LANES = 512  # float64 values, 4 KiB: in the nearest cache
CHAIN = 12  # multiply-adds on every value; longer chains leave the units waiting
REPEATS, ROUNDS = 2000, 7
FORCE_EVALUATIONS = 4  # of a Runge-Kutta step

# Operations of the laws as `peers.numba_scalar` writes them down: of these, square roots and
# divisions go through the divider, which is the slowest unit by far.
FLOPS = {"node": 33, "bar": 33, "hinge": 165}
ROOTS = {"bar": 1, "hinge": 1}
DIVISIONS = {"bar": 1, "hinge": 4}

jit = numba.njit(error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"})


@dataclass(frozen=True)
class Limits:
    """Throughput of one core, vectorised, float64.

    Attributes
    ----------
    gflops : float [1e9/s]
        Of multiply-adds, counted as two.
    root_ns, division_ns : float [ns]
        Of one value.
    """

    gflops: float
    root_ns: float
    division_ns: float

    def step_us(self, scene: Scene) -> dict[str, float]:
        """Return the least time [us] of a Runge-Kutta step by arithmetic and by the divider."""
        nodes, bars, hinges = scene.size
        flops = FLOPS["node"] * nodes + FLOPS["bar"] * bars + FLOPS["hinge"] * hinges
        roots = ROOTS["bar"] * bars + ROOTS["hinge"] * hinges
        divisions = DIVISIONS["bar"] * bars + DIVISIONS["hinge"] * hinges
        divider_ns = roots * self.root_ns + divisions * self.division_ns
        return {
            "arithmetic": FORCE_EVALUATIONS * flops / self.gflops * 1e-3,
            "divider": FORCE_EVALUATIONS * divider_ns * 1e-3,
        }

    def as_dict(self) -> dict[str, float]:
        """Return plain numbers."""
        return asdict(self)


@jit
def multiply_add(values: Any, repeats: int, factor: float, term: float) -> None:
    """Apply `CHAIN` multiply-adds to every value, `repeats` times."""
    for _ in range(repeats):
        for i in range(LANES):
            t = values[i]
            for _ in range(CHAIN):
                t = t * factor + term
            values[i] = t


@jit
def roots(values: Any, out: Any, repeats: int) -> None:
    """Take the square root of every value, `repeats` times."""
    for r in range(repeats):
        values[r % LANES] += 1.0  # so that no pass can be left out
        for i in range(LANES):
            out[i] = np.sqrt(values[i])


@jit
def divisions(values: Any, out: Any, repeats: int) -> None:
    """Divide by every value, `repeats` times."""
    for r in range(repeats):
        values[r % LANES] += 1.0
        for i in range(LANES):
            out[i] = (1.0 + r) / values[i]


def _nanoseconds(call: Callable[[], None]) -> float:
    """Return the CPU time of one value in one pass: the least of some rounds, after warming."""
    call()
    times = []
    for _ in range(ROUNDS):
        start = time.process_time_ns()
        call()
        times.append(time.process_time_ns() - start)
    return min(times) / (LANES * REPEATS)


def measure_limits() -> Limits:
    """Measure; takes about a second, most of it for compiling."""
    values, out = np.linspace(1.0, 2.0, LANES), np.empty(LANES)
    chain = _nanoseconds(lambda: multiply_add(values, REPEATS, 0.5, 0.75))
    return Limits(
        gflops=2.0 * CHAIN / chain,
        root_ns=_nanoseconds(lambda: roots(values, out, REPEATS)),
        division_ns=_nanoseconds(lambda: divisions(values, out, REPEATS)),
    )
