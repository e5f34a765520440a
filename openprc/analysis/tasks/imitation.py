"""NARMA: nonlinear autoregressive moving average systems that a reservoir has to imitate."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import TaskError

# Without input the unstable fixed points of these systems lie between 0.6 and 4.6; a response
# of twice that does not come back.
_DIVERGED = 10.0
_RANGE_SLACK = 1e-9


@dataclass(frozen=True)
class NarmaSystem:
    """One NARMA recursion.

    For order 2 it is ``y(t+1) = a y(t) + b y(t) y(t-1) + c u(t)^3 + d``. For an order n above
    it is ``y(t+1) = a y(t) + b y(t) sum_{i=0}^{n-1} y(t-i) + c u(t-n+1) u(t) + d``, inside a
    hyperbolic tangent where ``squash`` says so.
    """

    order: int
    a: float
    b: float
    c: float
    d: float
    source: str
    squash: bool = False

    @property
    def formula(self) -> str:
        """The recursion in words that fit on a line."""
        n, a, b, c, d = self.order, self.a, self.b, self.c, self.d
        if n == 2:
            return f"y(t+1) = {a:g} y(t) + {b:g} y(t) y(t-1) + {c:g} u(t)^3 + {d:g}"
        body = (
            f"{a:g} y(t) + {b:g} y(t) sum_(i=0..{n - 1}) y(t-i) + {c:g} u(t-{n - 1}) u(t) + {d:g}"
        )
        return f"y(t+1) = tanh[{body}]" if self.squash else f"y(t+1) = {body}"

    @property
    def escape(self) -> float:
        """Unstable fixed point without input; infinite for the bounded form.

        It is the larger root of ``m b y^2 - (1 - a) y + d = 0`` with m = 1 for order 2 and m = n
        above. Where the input is not negative, a response that has stayed above it for n steps
        grows from then on.
        """
        if self.squash:
            return math.inf
        terms = 1 if self.order == 2 else self.order
        half = 0.5 * (1.0 - self.a) / (terms * self.b)
        return half + math.sqrt(half**2 - self.d / (terms * self.b))

    @property
    def input_range(self) -> tuple[float, float]:
        """Closed interval of inputs that the system is defined for."""
        return (-0.5, 0.5) if self.order == 2 else (0.0, 0.5)


_ATIYA = "Atiya and Parlos 2000, doi:10.1109/72.846741"
_SYSTEMS = {
    2: NarmaSystem(
        2, 0.4, 0.4, 0.6, 0.1,
        "order-2 system of Hauser et al. 2011, eq. 7, doi:10.1007/s00422-012-0471-0, after "
        + _ATIYA,
    ),
    20: NarmaSystem(
        20, 0.3, 0.05, 1.5, 0.01,
        "Rodan and Tino 2011, doi:10.1109/TNN.2010.2089641, without the +0.2 outside the tanh "
        "that some sources add",
        squash=True,
    ),
    30: NarmaSystem(
        30, 0.2, 0.04, 1.5, 0.001,
        "Schrauwen et al. 2008, doi:10.1016/j.neucom.2007.12.020",
    ),
}  # fmt: skip
_LARGEST_PLAIN = 10


def narma_system(order: int) -> NarmaSystem:
    """Return the recursion of an order.

    Orders 3 to 10 share the coefficients that were published for order 10. From about 12 on
    these have no bounded response to inputs on [0, 0.5], which is why orders 20 and 30 have
    systems of their own.

    Raises
    ------
    TaskError
        For any other order than 2 to 10, 20 and 30.
    """
    if order in _SYSTEMS and not isinstance(order, bool):
        return _SYSTEMS[order]
    if isinstance(order, int | np.integer) and 3 <= order <= _LARGEST_PLAIN:
        source = _ATIYA if order == 10 else f"coefficients of order 10 in {_ATIYA}"
        return NarmaSystem(int(order), 0.3, 0.05, 1.5, 0.1, source)
    raise TaskError(
        f"the order is {order!r}",
        expected="a whole number from 2 to 10, or 20, or 30",
        fix="choose one of these; 2, 5, 10, 20 and 30 are usual",
        key="order",
    )


def NARMA_task(
    u: ArrayLike, order: int = 2, *, horizon: int = 0, any_range: bool = False
) -> NDArray[np.float64]:
    """Return the response y of a NARMA system to an input sequence, (K,).

    Element t is y(t + horizon). With ``horizon=0`` the sequence starts with y(0) = 0 and y(t+1)
    is computed from u(t), so element t has seen the input up to u(t-1). With ``horizon=1``
    element t is the value computed from u(t): that is what a state that has seen u(t) is
    trained on. Before t = 0 input and response are zero; the washout covers that.

    Parameters
    ----------
    u : (K,) or (K, 1)
        One value per symbol, within [0, 0.5]; for order 2 within [-0.5, 0.5].
    order : int
        2 to 10, 20 or 30; see `narma_system` for recursions and sources.
    horizon : {0, 1}
    any_range : bool
        Do not check the range of the input.

    Raises
    ------
    TaskError
        When the input has the wrong shape or range, is not finite, or makes the system diverge.

    Examples
    --------
    >>> NARMA_task([0.0, 0.5, 0.0], order=2)
    array([0.   , 0.1  , 0.215])
    """
    system = narma_system(order)
    if horizon not in (0, 1):
        raise TaskError(
            f"the horizon is {horizon!r}", expected="0 or 1", fix="choose one", key="horizon"
        )
    inputs = _checked_input(u, system, any_range=any_range)
    response = _respond(inputs, system)
    return response[horizon : horizon + len(inputs)]


def _checked_input(u: ArrayLike, system: NarmaSystem, *, any_range: bool) -> NDArray[np.float64]:
    values = np.asarray(u, dtype=np.float64)
    if values.ndim == 2 and values.shape[1] == 1:
        values = values[:, 0]
    if values.ndim != 1 or not values.size:
        raise TaskError(
            f"the input has shape {values.shape}",
            expected="(K,), at least one value",
            fix="choose one column of the input",
            key="u",
        )
    bad = int(np.count_nonzero(~np.isfinite(values)))
    if bad:
        raise TaskError(
            f"{bad} of {len(values)} input values are NaN or infinite",
            expected="finite numbers",
            fix="check where the input comes from; a constant signal cannot be rescaled",
            key="u",
        )
    low, high = system.input_range
    least, most = float(values.min()), float(values.max())
    if not any_range and (least < low - _RANGE_SLACK or most > high + _RANGE_SLACK):
        raise TaskError(
            f"the input runs from {least:.4g} to {most:.4g}",
            expected=f"values from {low:g} to {high:g} for order {system.order}",
            fix="rescale it: 0.5 * (u - u.min()) / (u.max() - u.min())",
            key="u",
        )
    return values


def _respond(u: NDArray[np.float64], system: NarmaSystem) -> NDArray[np.float64]:
    """Return y(0) to y(K), (K+1,)."""
    n, a, b, c, d = system.order, system.a, system.b, system.c, system.d
    inputs = [0.0] * (n - 1) + u.tolist()
    # The n zeros in front are the history before t = 0; y[t + n] below is y(t + 1).
    y = [0.0] * n
    for t in range(len(u)):
        now = y[-1]
        if n == 2:
            value = a * now + b * now * y[-2] + c * inputs[t + 1] ** 3 + d
        else:
            value = a * now + b * now * sum(y[-n:]) + c * inputs[t] * inputs[t + n - 1] + d
            if system.squash:
                value = math.tanh(value)
        if not abs(value) < _DIVERGED:
            raise TaskError(
                f"NARMA{n} diverged at step {t + 1} of {len(u)}",
                expected="a response that stays bounded",
                fix="use another input sequence, a narrower one (such as [0, 0.4]), a lower "
                "order, or order 20, which is bounded; about 1 in 20 uniform sequences of "
                "10000 steps makes NARMA10 diverge",
                key="u",
            )
        y.append(value)
    escape = system.escape
    if len(u) >= n and min(y[-n:]) > escape and float(u.min()) >= 0.0:
        raise TaskError(
            f"NARMA{n} is diverging at the end of {len(u)} steps: its last {n} values are above "
            f"{escape:.4g}",
            expected="a response that stays bounded",
            fix="use another input sequence, a narrower one (such as [0, 0.4]), a lower order, or "
            "order 20, which is bounded",
            key="u",
        )
    return np.asarray(y[n - 1 :])
