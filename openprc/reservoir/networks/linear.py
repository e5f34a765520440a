"""Linear networks, whose memory is known in closed form."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError
from openprc.reservoir.networks.base import DrivenNetwork, checked_count, checked_number

Coupling = Literal["orthogonal", "cyclic"]

# The covariance of the states has a condition of about rho^(-2N). From here on down it is not
# formed.
_WELL_CONDITIONED = 1e-4


class LinearNetwork(DrivenNetwork):
    """``x(t) = W x(t-1) + v u(t)`` with W a multiple of an orthogonal matrix.

    Parameters
    ----------
    n_nodes : int
        N.
    spectral_radius : float
        rho; W is rho times an orthogonal matrix, so every perturbation shrinks by rho a step.
    coupling : {"orthogonal", "cyclic"}
        A random orthogonal matrix, uniformly distributed; or a ring, in which node i hands its
        state to node i + 1 and only node 0 takes the input.
    input_scaling : float
        Length of v.
    seed : int or numpy.random.Generator
        Of the orthogonal matrix and of v; a ring needs none.

    Raises
    ------
    TaskError
        When a setting is out of range.

    Notes
    -----
    White, Lee and Sompolinsky 2004, doi:10.1103/PhysRevLett.92.148102, on orthogonal networks;
    Rodan and Tino 2011, doi:10.1109/TNN.2010.2089641, on rings.
    """

    def __init__(
        self,
        n_nodes: int,
        *,
        spectral_radius: float = 0.9,
        coupling: Coupling = "orthogonal",
        input_scaling: float = 1.0,
        seed: int | np.random.Generator | None = None,
    ) -> None:
        super().__init__(n_nodes, n_inputs=1)
        self.spectral_radius = checked_number(spectral_radius, key="spectral_radius", low=0.0)
        self.input_scaling = checked_number(input_scaling, key="input_scaling", low=0.0)
        self.coupling = coupling
        self.seed = seed if isinstance(seed, int | np.integer) else None
        if coupling == "cyclic":
            turn = np.roll(np.eye(self.n_nodes), 1, axis=0)
            into = np.eye(self.n_nodes)[0]
        elif coupling == "orthogonal":
            if seed is None:
                raise TaskError(
                    "no seed is given for a random matrix",
                    expected="a whole number or a numpy.random.Generator",
                    fix="pass seed=0",
                    key="seed",
                )
            rng = np.random.default_rng(seed)
            turn, upper = np.linalg.qr(rng.normal(size=(self.n_nodes, self.n_nodes)))
            # Without these signs the matrices are not uniformly distributed (Mezzadri 2007,
            # Notices of the AMS 54:592).
            turn *= np.sign(np.diagonal(upper))
            into = rng.normal(size=self.n_nodes)
            into /= np.linalg.norm(into)
        else:
            raise TaskError(
                f"coupling is {coupling!r}",
                expected="orthogonal or cyclic",
                fix="choose one of these",
                key="coupling",
            )
        self.recurrent = self.spectral_radius * turn
        self.into = self.input_scaling * into

    def config(self) -> dict[str, Any]:
        """Return the settings as plain values; a generator passed as seed is not kept."""
        return {
            "type": "LinearNetwork",
            "n_nodes": self.n_nodes,
            "spectral_radius": self.spectral_radius,
            "coupling": self.coupling,
            "input_scaling": self.input_scaling,
            "seed": None if self.seed is None else int(self.seed),
        }

    def capacity_profile(self, max_delay: int) -> NDArray[np.float64]:
        """Return the linear memory capacity of each delay from 0 on, (max_delay + 1,), exactly.

        For white input of variance s the covariance of the states is s P with
        ``P = W P W^T + v v^T``, that of the states and u(t - k) is ``s W^k v``, and so
        ``C_k = (W^k v)^T P^-1 (W^k v)`` (Dambre et al. 2012, doi:10.1038/srep00514, in the
        linear case). Over all delays they add up to N; ``C_0 = 1 - rho^(2N)``.

        Raises
        ------
        TaskError
            When rho is 1 or more, so that the states have no stationary covariance, or when
            nothing comes in.
        """
        if not self.spectral_radius < 1.0 or not self.input_scaling:
            raise TaskError(
                f"the spectral radius is {self.spectral_radius:g} and the input scaling "
                f"{self.input_scaling:g}",
                expected="a spectral radius below 1 and an input scaling above 0",
                fix="change these",
                key="spectral_radius",
            )
        n_delays = checked_count(max_delay + 1, key="max_delay + 1")
        if self.spectral_radius == 0.0:
            return (np.arange(n_delays) == 0).astype(np.float64)
        echo = self.into / self.input_scaling
        if self.spectral_radius ** (2 * self.n_nodes) > _WELL_CONDITIONED:
            return _profile_by_lyapunov(self.recurrent, echo, n_delays)
        return _profile_by_projection(self.recurrent, echo, n_delays, rho=self.spectral_radius)

    def _advance(
        self, symbols: NDArray[np.float64], state: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        rows = symbols * self.into
        x = state
        for row in rows:
            row += self.recurrent @ x
            x = row
        return rows

    def _jacobian(
        self, symbol: NDArray[np.float64], state: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        return self.recurrent.copy()


class DelayLine(DrivenNetwork):
    """The last N inputs as states, the newest first: ``x_i(t) = u(t - i)``.

    Its memory capacity is N exactly, its kernel rank N, and with the last k inputs in common
    its generalisation rank N - k + 1 for k from 1 to N.

    Parameters
    ----------
    n_nodes : int
        N.
    """

    def __init__(self, n_nodes: int) -> None:
        super().__init__(n_nodes, n_inputs=1)

    def config(self) -> dict[str, Any]:
        """Return the settings as plain values."""
        return {"type": "DelayLine", "n_nodes": self.n_nodes}

    def capacity_profile(self, max_delay: int) -> NDArray[np.float64]:
        """Return the linear memory capacity of each delay from 0 on, (max_delay + 1,)."""
        n_delays = checked_count(max_delay + 1, key="max_delay + 1")
        return (np.arange(n_delays) < self.n_nodes).astype(np.float64)

    def _advance(
        self, symbols: NDArray[np.float64], state: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        history = np.concatenate([state[::-1], symbols[:, 0]])
        windows = np.lib.stride_tricks.sliding_window_view(history, self.n_nodes)
        return windows[1:, ::-1].copy()

    def _jacobian(
        self, symbol: NDArray[np.float64], state: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        return np.eye(self.n_nodes, k=-1)


def _profile_by_lyapunov(
    recurrent: NDArray[np.float64], echo: NDArray[np.float64], n_delays: int
) -> NDArray[np.float64]:
    from scipy.linalg import cho_factor, cho_solve, solve_discrete_lyapunov

    factor = cho_factor(solve_discrete_lyapunov(recurrent, np.outer(echo, echo)))
    profile = np.empty(n_delays)
    for k in range(n_delays):
        profile[k] = echo @ cho_solve(factor, echo)
        echo = recurrent @ echo
    return profile


def _profile_by_projection(
    recurrent: NDArray[np.float64], echo: NDArray[np.float64], n_delays: int, *, rho: float
) -> NDArray[np.float64]:
    """Return the squared lengths of the delays' unit vectors within the span of the states.

    Row k of the matrix below is the echo of the input k steps ago. Householder reflections
    with column exchanges keep every one of its shrinking rows to full relative precision (Cox
    and Higham 1998, doi:10.1137/S0895479896309426), which their sum of squares would not.
    """
    from scipy.linalg import qr

    n_rows = max(n_delays, len(echo) + int(np.ceil(np.log(1e-17) / np.log(rho))))
    echoes = np.empty((n_rows, len(echo)))
    for row in echoes:
        row[:] = echo
        echo = recurrent @ echo
    basis = qr(echoes, mode="economic", pivoting=True)[0]
    return np.sum(basis[:n_delays] ** 2, axis=1)
