"""Chaotic series to predict: Mackey-Glass, Lorenz and Henon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from openprc.analysis.tasks.runge_kutta import rk4_step
from openprc.analysis.tasks.task import (
    Randomness,
    generator_of,
    positive_count,
    positive_number,
)
from openprc.errors import Diverged, TaskError


class SeriesSystem(Protocol):
    """Anything that a series of any length can be drawn from."""

    name: str
    formula: str
    source: str

    def series(self, n: int, *, rng: Randomness | None = None) -> NDArray[np.float64]:
        """Return (n, C) samples; without `rng` always the same ones."""
        ...


@dataclass(frozen=True)
class MackeyGlass:
    """Blood cells that are made after a delay.

    Parameters
    ----------
    tau : float
        Delay; 17 is mildly chaotic, 30 more so. A whole number of `step`.
    beta, gamma, exponent : float
    sampling : float
        Time between samples, a whole number of `step`.
    step : float
        Runge-Kutta step. The delayed value between two steps is that of the cubic through
        values and slopes, so the order of the method is kept.
    history : float
        Constant value before time 0. With `rng` it is drawn from this +- 0.1.
    transient : float
        Time left out at the start.
    """

    tau: float = 17.0
    beta: float = 0.2
    gamma: float = 0.1
    exponent: float = 10.0
    sampling: float = 1.0
    step: float = 0.1
    history: float = 1.2
    transient: float = 1000.0
    source: ClassVar[str] = "Mackey and Glass 1977, doi:10.1126/science.267326"

    def __post_init__(self) -> None:
        for key in ("tau", "beta", "gamma", "exponent", "sampling", "step", "history"):
            positive_number(getattr(self, key), key)
        positive_number(self.transient, "transient", zero=True)
        for key in ("tau", "sampling"):
            _whole_multiple(getattr(self, key), self.step, key)

    @property
    def name(self) -> str:
        """``mackey-glass<tau>``."""
        return f"mackey-glass{self.tau:g}"

    @property
    def formula(self) -> str:
        """The delay equation."""
        return (
            f"dx/dt = {self.beta:g} x(t-{self.tau:g}) / (1 + x(t-{self.tau:g})^{self.exponent:g})"
            f" - {self.gamma:g} x(t), sampled every {self.sampling:g}"
        )

    def series(self, n: int, *, rng: Randomness | None = None) -> NDArray[np.float64]:
        """Return x at `n` instants, (n, 1)."""
        start = self.history
        if rng is not None:
            start += generator_of(rng)[0].uniform(-0.1, 0.1)
        stride = _whole_multiple(self.sampling, self.step, "sampling")
        first = round(self.transient / self.step)
        x = self.integrate(first + (positive_count(n, "n") - 1) * stride, history=start)
        return x[first::stride, None]

    def integrate(self, n_steps: int, *, history: float) -> NDArray[np.float64]:
        """Return x at 0, step, ..., n_steps step, (n_steps + 1,)."""
        h, gamma = self.step, self.gamma
        delay = _whole_multiple(self.tau, h, "tau")
        x = np.empty(n_steps + 1)
        x[0] = history
        # Values and slopes of one delay; before time 0 the slope is 0, at 0 it jumps.
        values = np.full(delay + 1, history)
        slopes = np.zeros(delay + 1)
        done = 0
        while done < n_steps:
            count = min(delay, n_steps - done)
            at_nodes = self._production(values)
            middle = 0.5 * (values[:-1] + values[1:]) + 0.125 * h * (slopes[:-1] - slopes[1:])
            at_middle = self._production(middle).tolist()
            nodes = at_nodes.tolist()
            now = float(x[done])
            block = [now]
            for i in range(count):
                p0, pm, p1 = nodes[i], at_middle[i], nodes[i + 1]
                k1 = p0 - gamma * now
                k2 = pm - gamma * (now + 0.5 * h * k1)
                k3 = pm - gamma * (now + 0.5 * h * k2)
                k4 = p1 - gamma * (now + h * k3)
                now += (h / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)
                block.append(now)
            x[done + 1 : done + count + 1] = block[1:]
            done += count
            if count == delay:
                values = np.asarray(block)
                slopes = at_nodes - gamma * values
        return x

    def _production(self, delayed: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.beta * delayed / (1.0 + delayed**self.exponent)


@dataclass(frozen=True)
class Lorenz:
    """Convection in three numbers.

    Parameters
    ----------
    sigma, rho, beta : float
        At 10, 28 and 8/3 the largest Lyapunov exponent is 0.9056 (Sprott 2003).
    sampling : float
        Time between samples.
    step : float
        Largest Runge-Kutta step; it is shortened to divide `sampling`.
    columns : tuple of str
        Which of x, y and z are given.
    transient : float
    """

    sigma: float = 10.0
    rho: float = 28.0
    beta: float = 8.0 / 3.0
    sampling: float = 0.02
    step: float = 0.005
    columns: tuple[str, ...] = ("x",)
    transient: float = 50.0
    name: ClassVar[str] = "lorenz"
    source: ClassVar[str] = "Lorenz 1963, doi:10.1175/1520-0469(1963)020<0130:DNF>2.0.CO;2"

    def __post_init__(self) -> None:
        for key in ("sigma", "rho", "beta", "sampling", "step"):
            positive_number(getattr(self, key), key)
        positive_number(self.transient, "transient", zero=True)
        columns = tuple(self.columns)
        if not columns or not set(columns) <= set("xyz") or len(set(columns)) != len(columns):
            raise TaskError(
                f"the columns are {self.columns!r}",
                expected="some of 'x', 'y' and 'z', each once",
                fix='columns=("x",), for instance',
                key="columns",
            )
        object.__setattr__(self, "columns", columns)

    @property
    def formula(self) -> str:
        """The three equations."""
        return (
            f"x' = {self.sigma:g} (y - x), y' = x ({self.rho:g} - z) - y, "
            f"z' = x y - {self.beta:.6g} z, sampled every {self.sampling:g}"
        )

    def rates(self, x: Any, y: Any, z: Any) -> tuple[Any, Any, Any]:
        """Return the time derivatives."""
        return self.sigma * (y - x), x * (self.rho - z) - y, x * y - self.beta * z

    def series(self, n: int, *, rng: Randomness | None = None) -> NDArray[np.float64]:
        """Return the chosen columns at `n` instants, (n, C).

        The start is (1, 1, 20); `rng` moves it by up to 1 in each direction.
        """
        state: tuple[float, ...] = (1.0, 1.0, 20.0)
        if rng is not None:
            moved = generator_of(rng)[0].uniform(-1.0, 1.0, 3).tolist()
            state = tuple(a + b for a, b in zip(state, moved, strict=True))
        n_inner = max(1, int(np.ceil(self.sampling / self.step - 1e-9)))
        h = self.sampling / n_inner
        for _ in range(int(np.ceil(self.transient / h))):
            state = rk4_step(self.rates, state, h)
        samples = []
        for _ in range(positive_count(n, "n")):
            samples.append(state)
            for _ in range(n_inner):
                state = rk4_step(self.rates, state, h)
        chosen = ["xyz".index(column) for column in self.columns]
        return np.array(samples)[:, chosen]


@dataclass(frozen=True)
class Henon:
    """A map of the plane, written as a recursion of second order.

    Parameters
    ----------
    a, b : float
        At 1.4 and 0.3 the largest Lyapunov exponent is 0.419.
    transient : int
    """

    a: float = 1.4
    b: float = 0.3
    transient: int = 100
    name: ClassVar[str] = "henon"
    source: ClassVar[str] = "Henon 1976, doi:10.1007/BF01608556"

    def __post_init__(self) -> None:
        positive_count(self.transient, "transient", least=0)

    @property
    def formula(self) -> str:
        """The recursion."""
        return f"x(t+1) = 1 - {self.a:g} x(t)^2 + {self.b:g} x(t-1)"

    def series(self, n: int, *, rng: Randomness | None = None) -> NDArray[np.float64]:
        """Return x at `n` steps, (n, 1), from 0, 0 or near it.

        Raises
        ------
        Diverged
            When the parameters have no attractor near the origin.
        """
        before, now = 0.0, 0.0
        if rng is not None:
            before, now = generator_of(rng)[0].uniform(-0.1, 0.1, 2).tolist()
        values = []
        for t in range(self.transient + positive_count(n, "n")):
            before, now = now, 1.0 - self.a * now * now + self.b * before
            if not abs(now) < 1e3:
                raise Diverged(
                    f"the Henon map left its attractor at step {t + 1}",
                    expected="a bounded series",
                    fix="use a = 1.4 and b = 0.3",
                    key="a",
                )
            values.append(now)
        return np.array(values[self.transient :])[:, None]


def _whole_multiple(value: float, step: float, key: str) -> int:
    count = round(value / step)
    if count < 1 or abs(count * step - value) > 1e-9 * value:
        raise TaskError(
            f"{key} is {value:g} and the step {step:g}",
            expected="a whole number of steps",
            fix="choose a step that divides both tau and sampling",
            key=key,
        )
    return count
