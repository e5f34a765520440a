"""Movements to generate in closed loop: van der Pol, quadratic limit cycle, Lissajous."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from openprc.analysis.tasks.runge_kutta import rk4_step
from openprc.analysis.tasks.scoring import Metric
from openprc.analysis.tasks.task import GenerationTask, positive_count, positive_number
from openprc.errors import TaskError

_HAUSER = "Hauser et al. 2012, doi:10.1007/s00422-012-0516-4"


class OscillatorTask(GenerationTask):
    """A limit cycle of a planar system, integrated until it has settled.

    Attributes
    ----------
    time_scale : float [s]
        Seconds per unit of the equations' time.
    """

    metric: ClassVar[Metric] = "nrmse"
    time_scale: float

    @abstractmethod
    def rates(self, x1: Any, x2: Any) -> tuple[Any, Any]:
        """Return the time derivatives."""

    @property
    @abstractmethod
    def _settling(self) -> float:
        """Time, in units of the equations, after which the start is forgotten."""

    @property
    def _largest_step(self) -> float:
        return 0.01

    def trajectory(self, n: int, dt: float) -> NDArray[np.float64]:
        """Return x1 and x2 at `n` instants `dt` [s] apart, (n, 2), on the limit cycle."""
        sampling = positive_number(dt, "dt") / self.time_scale
        n_inner = max(1, math.ceil(sampling / self._largest_step))
        h = sampling / n_inner
        state: tuple[float, ...] = (1.0, 0.0)
        for _ in range(math.ceil(self._settling / self._largest_step)):
            state = rk4_step(self.rates, state, self._largest_step)
        samples = []
        for _ in range(positive_count(n, "n")):
            samples.append(state)
            for _ in range(n_inner):
                state = rk4_step(self.rates, state, h)
        return np.array(samples)


@dataclass(frozen=True)
class VanDerPolTask(OscillatorTask):
    """The van der Pol oscillator.

    Parameters
    ----------
    mu : float
        Strength of the nonlinear damping. At 1 the period is 6.6633 units of time; near 0 it
        is 2 pi (1 + mu^2 / 16).
    time_scale : float [s]
    """

    mu: float = 1.0
    time_scale: float = 1.0
    name: ClassVar[str] = "van-der-pol"
    source: ClassVar[str] = f"van der Pol 1926, doi:10.1080/14786442608564127; {_HAUSER}"

    def __post_init__(self) -> None:
        positive_number(self.mu, "mu")
        positive_number(self.time_scale, "time_scale")

    @property
    def formula(self) -> str:
        """The two equations."""
        return f"x1' = x2, x2' = -x1 + {self.mu:g} (1 - x1^2) x2"

    def rates(self, x1: Any, x2: Any) -> tuple[Any, Any]:
        """Return the time derivatives."""
        return x2, -x1 + self.mu * (1.0 - x1 * x1) * x2

    @property
    def _settling(self) -> float:
        return 40.0 / min(self.mu, 1.0)

    @property
    def _largest_step(self) -> float:
        return 0.01 / max(self.mu, 1.0)


@dataclass(frozen=True)
class QuadraticLimitCycleTask(OscillatorTask):
    """A limit cycle around the origin with a cubic restoring term.

    Parameters
    ----------
    epsilon : float
        Weight of that term in the first equation. At 1 the angle of the state follows the
        linear part alone, so that the period is sqrt(2) pi.
    time_scale : float [s]
    """

    epsilon: float = 1.0
    time_scale: float = 1.0
    name: ClassVar[str] = "quadratic-limit-cycle"
    source: ClassVar[str] = _HAUSER

    def __post_init__(self) -> None:
        positive_number(self.epsilon, "epsilon")
        positive_number(self.time_scale, "time_scale")

    @property
    def formula(self) -> str:
        """The two equations."""
        return (
            f"x1' = x1 + x2 - {self.epsilon:g} x1 (x1^2 + x2^2), "
            "x2' = -2 x1 + x2 - x2 (x1^2 + x2^2)"
        )

    def rates(self, x1: Any, x2: Any) -> tuple[Any, Any]:
        """Return the time derivatives."""
        square = x1 * x1 + x2 * x2
        return x1 + x2 - self.epsilon * x1 * square, -2.0 * x1 + x2 - x2 * square

    @property
    def _settling(self) -> float:
        return 30.0


@dataclass(frozen=True)
class LissajousTask(GenerationTask):
    """A Lissajous figure; by default an eight.

    Parameters
    ----------
    ratio : (2,) int
        Oscillations of x1 and of x2 per period.
    phase : float [rad]
        By which x1 is ahead.
    period : float [s]
    """

    ratio: tuple[int, int] = (1, 2)
    phase: float = 0.0
    period: float = 1.0
    metric: ClassVar[Metric] = "nrmse"
    name: ClassVar[str] = "lissajous"
    source: ClassVar[str] = _HAUSER

    def __post_init__(self) -> None:
        positive_number(self.period, "period")
        pair = tuple(self.ratio)
        if len(pair) != 2:
            raise TaskError(
                f"ratio is {pair!r}",
                expected="two whole numbers",
                fix="such as (1, 2)",
                key="ratio",
            )
        a, b = (positive_count(value, "ratio") for value in pair)
        if math.gcd(a, b) != 1:
            raise TaskError(
                f"ratio is {a} to {b}",
                expected="numbers without a common divisor",
                fix=f"use {a // math.gcd(a, b)} to {b // math.gcd(a, b)} and a shorter period",
                key="ratio",
            )

    @property
    def formula(self) -> str:
        """Both coordinates."""
        a, b = self.ratio
        return (
            f"x1 = sin(2 pi {a} t / {self.period:g} + {self.phase:g}), "
            f"x2 = sin(2 pi {b} t / {self.period:g})"
        )

    def trajectory(self, n: int, dt: float) -> NDArray[np.float64]:
        """Return x1 and x2 at `n` instants `dt` [s] apart, (n, 2)."""
        step = positive_number(dt, "dt")
        turn = 2.0 * np.pi * step * np.arange(positive_count(n, "n")) / self.period
        a, b = self.ratio
        return np.stack([np.sin(a * turn + self.phase), np.sin(b * turn)], axis=1)
