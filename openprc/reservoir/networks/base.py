"""What all networks share: a state, a step, a drive."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import TaskError


class DrivenNetwork(ABC):
    """A network that is driven one symbol at a time.

    Parameters
    ----------
    n_nodes, n_inputs : int
        Number of states N and of input columns C.

    Attributes
    ----------
    n_states : int
        N.
    """

    def __init__(self, n_nodes: int, *, n_inputs: int) -> None:
        self.n_nodes = checked_count(n_nodes, key="n_nodes")
        self.n_states = self.n_nodes
        self.n_inputs = checked_count(n_inputs, key="n_inputs")
        self._state = np.zeros(self.n_nodes)

    @property
    def state(self) -> NDArray[np.float64]:
        """The present states, (N,). May be set, as when two trajectories are compared."""
        return self._state

    @state.setter
    def state(self, value: ArrayLike) -> None:
        state = np.array(value, dtype=np.float64)
        if state.shape != (self.n_nodes,) or not np.isfinite(state).all():
            raise TaskError(
                f"the state has shape {state.shape}"
                + ("" if np.isfinite(state).all() else " and is not finite"),
                expected=f"({self.n_nodes},), finite numbers",
                fix="pass one number per node",
                key="state",
            )
        self._state = state

    def reset(self) -> None:
        """Return to the zero state."""
        self._state = np.zeros(self.n_nodes)

    def step(self, u: ArrayLike) -> NDArray[np.float64]:
        """Take one symbol in and return the new states, (N,).

        Parameters
        ----------
        u : (C,), or a number where C is 1
        """
        symbol = np.atleast_1d(np.asarray(u, dtype=np.float64))
        if symbol.shape != (self.n_inputs,):
            raise TaskError(
                f"the symbol has shape {symbol.shape}",
                expected=f"({self.n_inputs},)",
                fix="pass one number per input",
                key="u",
            )
        self._state = self._advance(symbol[None, :], self._state)[0]
        return self._state.copy()

    def drive(self, u: ArrayLike, *, initial: ArrayLike | None = None) -> NDArray[np.float64]:
        """Return the states after each symbol, (K, N): row k has seen ``u[k]``.

        The network starts from `initial`, or from the zero state, wherever it stood before,
        and is left at the last row.

        Parameters
        ----------
        u : (K,) or (K, C)
        initial : (N,), optional

        Raises
        ------
        TaskError
            When `u` or `initial` has the wrong shape or is not finite.
        """
        symbols = checked_symbols(u, self.n_inputs)
        if initial is None:
            self.reset()
        else:
            self.state = np.asarray(initial, dtype=np.float64)
        states = self._advance(symbols, self._state)
        self._state = states[-1].copy()
        return states

    def jacobian(self, u: ArrayLike) -> NDArray[np.float64]:
        """Return the derivative of the next state by the present one, (N, N), under `u`."""
        symbol = checked_symbols(
            np.atleast_1d(np.asarray(u, dtype=np.float64))[None], self.n_inputs
        )
        return self._jacobian(symbol[0], self._state)

    @abstractmethod
    def config(self) -> dict[str, Any]:
        """Return the settings as plain values, with the class name under ``"type"``."""

    @abstractmethod
    def _advance(
        self, symbols: NDArray[np.float64], state: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return (K, N) states for (K, C) symbols, beginning from `state`."""

    @abstractmethod
    def _jacobian(
        self, symbol: NDArray[np.float64], state: NDArray[np.float64]
    ) -> NDArray[np.float64]: ...

    def __repr__(self) -> str:
        """Show the class and its settings."""
        settings = ", ".join(f"{k}={v!r}" for k, v in self.config().items() if k != "type")
        return f"{type(self).__name__}({settings})"


def checked_symbols(u: ArrayLike, n_inputs: int) -> NDArray[np.float64]:
    """Return symbols as (K, C).

    Raises
    ------
    TaskError
        When they are not of that shape, or not finite.
    """
    symbols = np.asarray(u, dtype=np.float64)
    symbols = symbols[:, None] if symbols.ndim == 1 else symbols
    if symbols.ndim != 2 or symbols.shape[1] != n_inputs or not len(symbols):
        raise TaskError(
            f"the input has shape {np.shape(u)}",
            expected=f"(K, {n_inputs}), at least one symbol" if n_inputs > 1 else "(K,) or (K, 1)",
            fix="pass one row per symbol and one column per input of the network",
            key="u",
        )
    if not np.isfinite(symbols).all():
        bad = int(np.count_nonzero(~np.isfinite(symbols).all(axis=1)))
        raise TaskError(
            f"{bad} of {len(symbols)} symbols are NaN or infinite",
            expected="finite numbers",
            fix="check where the input comes from",
            key="u",
        )
    return symbols


def checked_count(value: Any, *, key: str) -> int:
    """Return a positive whole number.

    Raises
    ------
    TaskError
        When it is none.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise TaskError(
            f"{key} is {value!r}", expected="a whole number from 1", fix=f"correct {key}", key=key
        )
    return int(value)


def checked_number(value: Any, *, key: str, low: float, high: float = np.inf) -> float:
    """Return a number in [low, high].

    Raises
    ------
    TaskError
        When it is none.
    """
    if isinstance(value, bool) or not np.isscalar(value) or not low <= float(value) <= high:
        span = f"from {low:g} to {high:g}" if np.isfinite(high) else f"at least {low:g}"
        raise TaskError(
            f"{key} is {value!r}", expected=f"a number, {span}", fix=f"correct {key}", key=key
        )
    return float(value)
