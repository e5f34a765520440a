"""The echo state network: the reference that physical reservoirs are compared with."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError
from openprc.reservoir.networks.base import DrivenNetwork, checked_number

# Up to here all eigenvalues together cost less than a search for the largest one, which
# converges slowly: those of a random matrix crowd along a circle.
_DENSE_EIGENVALUES = 600
# Below this share of connections a compressed matrix multiplies faster than a full one.
_SPARSE_BELOW = 0.1


class EchoStateNetwork(DrivenNetwork):
    """Leaky tanh units with random connections.

    ``x(t) = (1 - a) x(t-1) + a tanh(W x(t-1) + V u(t) + b)``: Jaeger 2001, GMD report 148,
    with the leak of Jaeger et al. 2007, doi:10.1016/j.neunet.2007.04.016, eq. 2.

    Parameters
    ----------
    n_nodes : int
        N.
    spectral_radius : float
        Largest absolute eigenvalue of W.
    input_scaling : float
        V is uniform on [-input_scaling, input_scaling].
    leak_rate : float
        a, above 0 and 1 at most.
    bias_scaling : float
        b is uniform on [-bias_scaling, bias_scaling].
    density : float
        Share of connections that are there. Those that are, are normally distributed.
    n_inputs : int
        C.
    seed : int or numpy.random.Generator
        The same number gives the same network, and networks that differ in scalings only are
        scaled copies of each other.

    Raises
    ------
    TaskError
        When a setting is out of range, or so few connections are there that W has no
        eigenvalue but zero.

    Examples
    --------
    >>> network = EchoStateNetwork(50, spectral_radius=0.9, seed=0)
    >>> network.drive([0.1, 0.2, 0.3]).shape
    (3, 50)
    """

    def __init__(
        self,
        n_nodes: int,
        *,
        spectral_radius: float = 0.9,
        input_scaling: float = 1.0,
        leak_rate: float = 1.0,
        bias_scaling: float = 0.0,
        density: float = 1.0,
        n_inputs: int = 1,
        seed: int | np.random.Generator,
    ) -> None:
        super().__init__(n_nodes, n_inputs=n_inputs)
        self.spectral_radius = checked_number(spectral_radius, key="spectral_radius", low=0.0)
        self.input_scaling = checked_number(input_scaling, key="input_scaling", low=0.0)
        self.leak_rate = checked_number(leak_rate, key="leak_rate", low=1e-12, high=1.0)
        self.bias_scaling = checked_number(bias_scaling, key="bias_scaling", low=0.0)
        self.density = checked_number(density, key="density", low=1e-12, high=1.0)
        self.seed = seed if isinstance(seed, int | np.integer) else None
        rng = np.random.default_rng(seed)
        # One stream each, so that no setting of one part changes the numbers of another.
        of_links, of_weights, of_input, of_bias = rng.spawn(4)
        weights = of_weights.normal(size=(self.n_nodes, self.n_nodes))
        if self.density < 1.0:
            weights *= of_links.random(weights.shape) < self.density
        radius = largest_eigenvalue(weights)
        if radius <= 0.0 < self.spectral_radius:
            raise TaskError(
                f"a density of {self.density:g} left {np.count_nonzero(weights)} connections "
                f"among {self.n_nodes} nodes and no closed loop, so W has no eigenvalue but zero",
                expected="at least one closed loop",
                fix="raise the density, or take another seed",
                key="density",
            )
        self.recurrent = weights * (self.spectral_radius / radius if radius else 0.0)
        self.into = self.input_scaling * of_input.uniform(-1.0, 1.0, (self.n_nodes, self.n_inputs))
        self.bias = self.bias_scaling * of_bias.uniform(-1.0, 1.0, self.n_nodes)
        self._product = _product_of(self.recurrent, self.density)

    def config(self) -> dict[str, Any]:
        """Return the settings as plain values; a generator passed as seed is not kept."""
        return {
            "type": "EchoStateNetwork",
            "n_nodes": self.n_nodes,
            "spectral_radius": self.spectral_radius,
            "input_scaling": self.input_scaling,
            "leak_rate": self.leak_rate,
            "bias_scaling": self.bias_scaling,
            "density": self.density,
            "n_inputs": self.n_inputs,
            "seed": None if self.seed is None else int(self.seed),
        }

    def _advance(
        self, symbols: NDArray[np.float64], state: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        # What the input adds is one product for all symbols; the rows then turn into states.
        rows = symbols @ self.into.T
        rows += self.bias
        product, leak, x = self._product, self.leak_rate, state
        for row in rows:
            row += product @ x
            np.tanh(row, out=row)
            if leak != 1.0:
                row *= leak
                row += (1.0 - leak) * x
            x = row
        return rows

    def _jacobian(
        self, symbol: NDArray[np.float64], state: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        bent = np.tanh(self.recurrent @ state + self.into @ symbol + self.bias)
        inner = (self.leak_rate * (1.0 - bent**2))[:, None] * self.recurrent
        inner[np.diag_indices(self.n_nodes)] += 1.0 - self.leak_rate
        return inner


def _product_of(recurrent: NDArray[np.float64], density: float) -> Any:
    """Return the matrix in the form that multiplies a vector fastest."""
    if density < _SPARSE_BELOW:
        from scipy.sparse import csr_array

        return csr_array(recurrent)
    return np.ascontiguousarray(recurrent)


def largest_eigenvalue(matrix: NDArray[np.float64]) -> float:
    """Return the largest absolute eigenvalue of a square matrix (N, N)."""
    if len(matrix) <= _DENSE_EIGENVALUES:
        return float(np.abs(np.linalg.eigvals(matrix)).max())
    from scipy.sparse.linalg import ArpackNoConvergence, eigs

    # Several are asked for, because the largest may be one of a crowd of nearly equal ones.
    start = np.ones(len(matrix))
    try:
        found = eigs(matrix, k=8, ncv=64, v0=start, return_eigenvectors=False, tol=1e-10)
    except ArpackNoConvergence:
        found = np.linalg.eigvals(matrix)
    return float(np.abs(found).max())
