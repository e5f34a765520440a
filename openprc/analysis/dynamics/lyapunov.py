"""Lyapunov exponents of a driven body: whether it forgets how it began, and how fast.

The exponent is conditional on the drive: two copies of the body under the same input approach
each other where it is negative, which is what a reservoir needs, and diverge where it is
positive. Everything here is for a body that can be set to a state; for recordings see
`openprc.analysis.dynamics.replica_convergence`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.dynamics.echo_state import settable_state
from openprc.errors import Diverged, TaskError

_BLOCKS = 10
_VANISHED = (
    "the perturbation vanished exactly {steps} symbols after it was made: the body has a "
    "finite memory, and no rate"
)


@dataclass(frozen=True)
class LyapunovExponents:
    """Conditional Lyapunov exponents of a driven body.

    Parameters
    ----------
    per_symbol : (n,) float64
        In descending order; natural logarithm of the factor per symbol. ``-inf`` where a
        perturbation vanishes exactly, as in a delay line.
    standard_error : (n,) float64
        From the scatter between ten blocks of the record; 0 where the exponent is ``-inf``.
    hold : float or None [s]
        Duration of a symbol.
    n_symbols : int
        Symbols averaged over.
    method : str
    remark : str
        Empty, or what to know about the figure.
    """

    per_symbol: NDArray[np.float64]
    standard_error: NDArray[np.float64]
    hold: float | None
    n_symbols: int
    method: str
    remark: str

    @property
    def largest(self) -> float:
        """The largest exponent, per symbol."""
        return float(self.per_symbol[0])

    @property
    def per_second(self) -> NDArray[np.float64]:
        """The exponents per second, (n,) [1/s].

        Raises
        ------
        TaskError
            When the duration of a symbol is not known.
        """
        if self.hold is None:
            raise TaskError(
                "the duration of a symbol is not known",
                expected="hold in seconds",
                fix="pass hold=... to have figures per second",
                key="hold",
            )
        return self.per_symbol / self.hold

    @property
    def forgets(self) -> bool:
        """Whether the largest exponent is below zero by more than two standard errors."""
        return bool(self.largest + 2.0 * self.standard_error[0] < 0.0)


def lyapunov_exponent(
    body: Any,
    u: ArrayLike,
    *,
    washout: int,
    perturbation: float = 1e-8,
    hold: float | None = None,
    seed: int | np.random.Generator = 0,
) -> LyapunovExponents:
    """Return the largest conditional exponent from two trajectories.

    A copy of the body is displaced by `perturbation`, both take the same symbol, and the
    difference is brought back to its length along its new direction: Benettin et al. 1980,
    doi:10.1007/BF02128236, for a body under a drive.

    Parameters
    ----------
    body
        With ``reset()``, ``step(u) -> (N,)``, and an attribute ``state`` (N,) that can be set
        and that determines what follows.
    u : (K,) or (K, C)
        The drive.
    washout : int
        Symbols after which averaging starts, while the perturbation turns into the direction
        that grows most. It takes part in the washout too.
    perturbation : float
        Length of the difference, in the unit of the states: small against them, large
        against their rounding errors.
    hold : float, optional [s]
        Duration of a symbol, for figures per second.
    seed : int or numpy.random.Generator
        Of the direction of the first perturbation.

    Raises
    ------
    TaskError
        When the body cannot be set to a state, or `washout` leaves fewer than ten symbols.
    Diverged
        When the states leave the range of finite numbers.
    """
    symbols = _checked_drive(body, u, washout, perturbation=perturbation)
    body.reset()
    state = np.array(body.state, dtype=np.float64)
    direction = np.random.default_rng(seed).normal(size=state.shape)
    difference = direction * (perturbation / np.linalg.norm(direction))
    growth = np.zeros(len(symbols) - washout)
    for k, symbol in enumerate(symbols):
        following = _stepped(body, state, symbol, k=k)
        displaced = state + difference
        moved = _stepped(body, displaced, symbol, k=k) - following
        length = float(np.linalg.norm(moved))
        # What rounding left of the displacement, which matters where states are large.
        applied = float(np.linalg.norm(displaced - state))
        if not applied > 0.5 * perturbation:
            raise TaskError(
                f"a perturbation of {perturbation:g} is lost in the rounding of states of size "
                f"{np.linalg.norm(state):.3g} at symbol {k}",
                expected="a perturbation that the states can show",
                fix="pass a larger perturbation, or check that the states stay bounded",
                key="perturbation",
            )
        if length == 0.0:
            return _vanished(k + 1, 1, hold=hold, n=len(growth), method="two trajectories")
        if k >= washout:
            growth[k - washout] = np.log(length / applied)
        difference = moved * (perturbation / length)
        state = following
    return _averaged(growth[:, None], hold=hold, method="two trajectories")


def lyapunov_spectrum(
    body: Any,
    u: ArrayLike,
    *,
    washout: int,
    n_exponents: int = 1,
    hold: float | None = None,
    seed: int | np.random.Generator = 0,
) -> LyapunovExponents:
    """Return the largest conditional exponents from the Jacobian of the body.

    Tangent vectors are carried along and made orthogonal again after every symbol (Benettin et
    al. 1980, doi:10.1007/BF02128236).

    Parameters
    ----------
    body
        As in `lyapunov_exponent`, and with ``jacobian(u) -> (N, N)``: the derivative of the
        next state by the present one.
    n_exponents : int
        How many, up to N.

    Raises
    ------
    TaskError
        As `lyapunov_exponent`; when the body offers no Jacobian, or has fewer states.
    Diverged
        As `lyapunov_exponent`.
    """
    symbols = _checked_drive(body, u, washout, perturbation=1.0)
    jacobian: Callable[[NDArray[np.float64]], ArrayLike] | None = getattr(body, "jacobian", None)
    if not callable(jacobian) or not 1 <= n_exponents <= body.n_states:
        raise TaskError(
            f"{type(body).__name__} offers no jacobian(u)"
            if not callable(jacobian)
            else f"n_exponents is {n_exponents} and the body has {body.n_states} states",
            expected="a Jacobian, and from 1 to N exponents",
            fix="use lyapunov_exponent, which needs none"
            if not callable(jacobian)
            else "ask for fewer",
            key="body" if not callable(jacobian) else "n_exponents",
        )
    body.reset()
    state = np.array(body.state, dtype=np.float64)
    start = np.random.default_rng(seed).normal(size=(len(state), n_exponents))
    tangents = np.linalg.qr(start)[0]
    growth = np.zeros((len(symbols) - washout, n_exponents))
    for k, symbol in enumerate(symbols):
        body.state = state
        moved = np.asarray(jacobian(symbol), dtype=np.float64) @ tangents
        tangents, upper = np.linalg.qr(moved)
        factors = np.abs(np.diagonal(upper))
        if not factors[0] > 0.0:
            return _vanished(k + 1, n_exponents, hold=hold, n=len(growth), method="tangent vectors")
        if k >= washout:
            with np.errstate(divide="ignore"):
                growth[k - washout] = np.log(factors)
        state = _stepped(body, state, symbol, k=k)
    return _averaged(growth, hold=hold, method="tangent vectors")


def _checked_drive(
    body: Any, u: ArrayLike, washout: int, *, perturbation: float
) -> NDArray[np.float64]:
    symbols = np.asarray(u, dtype=np.float64)
    symbols = symbols[:, None] if symbols.ndim == 1 else symbols
    if symbols.ndim != 2 or washout < 0 or len(symbols) - washout < _BLOCKS:
        raise TaskError(
            f"the input has shape {np.shape(u)} and the washout is {washout} symbols",
            expected=f"(K,) or (K, C), with at least {_BLOCKS} symbols after the washout",
            fix="drive for longer",
            key="u",
        )
    if not (np.isfinite(perturbation) and perturbation > 0.0):
        raise TaskError(
            f"perturbation is {perturbation!r}",
            expected="a positive number, in the unit of the states",
            fix="pass a small fraction of the states, such as 1e-8 of them",
            key="perturbation",
        )
    body.reset()
    settable_state(body)
    return symbols


def _stepped(
    body: Any, state: NDArray[np.float64], symbol: NDArray[np.float64], *, k: int
) -> NDArray[np.float64]:
    body.state = state
    body.step(symbol)
    following = np.array(body.state, dtype=np.float64)
    if not np.isfinite(following).all():
        raise Diverged(
            f"the states are no longer finite after symbol {k}",
            expected="a body that stays bounded under this drive",
            fix="lower the drive or the gain of the body",
            key="u",
        )
    return following


def _vanished(
    steps: int, count: int, *, hold: float | None, n: int, method: str
) -> LyapunovExponents:
    return LyapunovExponents(
        per_symbol=np.full(count, -np.inf),
        standard_error=np.zeros(count),
        hold=hold,
        n_symbols=n,
        method=method,
        remark=_VANISHED.format(steps=steps),
    )


def _averaged(growth: NDArray[np.float64], *, hold: float | None, method: str) -> LyapunovExponents:
    mean = growth.mean(axis=0)
    error = np.zeros(len(mean))
    finite = np.isfinite(mean)
    blocks = [block[:, finite].mean(axis=0) for block in np.array_split(growth, _BLOCKS)]
    error[finite] = np.std(blocks, axis=0, ddof=1) / np.sqrt(_BLOCKS)
    order = np.argsort(-mean, kind="stable")
    remark = "" if finite.all() else "some directions vanish exactly: their exponents are -inf"
    return LyapunovExponents(
        per_symbol=mean[order],
        standard_error=error[order],
        hold=hold,
        n_symbols=len(growth),
        method=method,
        remark=remark,
    )
