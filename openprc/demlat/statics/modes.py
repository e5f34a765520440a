"""Natural modes: frequencies and shapes of small vibrations about a state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from openprc.demlat.statics.eigenpairs import ZERO_TOLERANCE, lowest_eigenpairs, split_zero_modes
from openprc.demlat.statics.factorization import out_of_balance
from openprc.errors import ConfigError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from openprc.demlat.statics.assembly import StaticProblem

    Reals = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Modes:
    """The lowest modes, by ascending eigenvalue.

    Attributes
    ----------
    eigenvalues : (E,) [rad2/s2]
    angular_frequencies : (E,) [rad/s]
        0 for zero modes, NaN for modes that grow instead of vibrating.
    shapes : (E, N, 3) [kg^-1/2]
        Normalised to unit modal mass; 0 at held axes.
    kinds : tuple of E str
        "unstable", "rigid-body", "mechanism" or "vibration".
    residual : float [N]
        Largest force out of balance at a free axis that no rigid element carries; modes
        belong to an equilibrium.
    """

    eigenvalues: Reals
    angular_frequencies: Reals
    shapes: Reals
    kinds: tuple[str, ...]
    residual: float

    @property
    def frequencies(self) -> Reals:
        """Frequencies: (E,) [Hz]."""
        return self.angular_frequencies / (2.0 * np.pi)

    @property
    def vibrations(self) -> Reals:
        """Angular frequencies of the modes that vibrate: [rad/s]."""
        return self.angular_frequencies[[kind == "vibration" for kind in self.kinds]]

    def count(self, kind: str) -> int:
        """Return how many modes are of that kind."""
        return self.kinds.count(kind)


def natural_modes(
    problem: StaticProblem,
    positions: ArrayLike,
    *,
    n: int = 12,
    masses: ArrayLike | None = None,
    zero_tolerance: float = ZERO_TOLERANCE,
) -> Modes:
    """Return the `n` lowest modes of ``W u = w^2 M u`` without damping.

    W is the stiffness along the constraints of rigid elements, and M the lumped masses.

    Parameters
    ----------
    problem : StaticProblem
    positions : (N, 3) [m]
        An equilibrium, from `find_equilibrium`.
    n : int
        Zero modes count.
    masses : (N,) [kg], optional
        Those of the geometry unless given.
    zero_tolerance : float
        An eigenvalue within this share of the largest one counts as zero.

    Raises
    ------
    ConfigError
        When `n` is below 1, or a node that can move has no mass.

    Examples
    --------
    >>> from openprc.demlat.geometry_builder import GeometryBuilder
    >>> from openprc.demlat.statics import StaticProblem, natural_modes
    >>> build = GeometryBuilder()
    >>> ends = build.add_nodes([[0.0, 0.0], [1.0, 0.0]], mass=2.0)
    >>> bar = build.add_bar(*ends, stiffness=100.0)
    >>> problem = StaticProblem(geometry=build.geometry())
    >>> modes = natural_modes(problem, problem.positions)
    >>> print(modes.count("rigid-body"), f"{modes.vibrations[0]:.3f} rad/s")
    5 10.000 rad/s
    """
    if n < 1:
        raise ConfigError(f"n = {n}", expected="at least one mode", key="n")
    x = problem.place(np.asarray(positions, dtype="f8"))
    nodal = np.array(problem.geometry.masses if masses is None else masses, dtype="f8")
    if nodal.shape != (problem.geometry.n_nodes,):
        raise ConfigError(
            f"shape {nodal.shape}", expected=f"({problem.geometry.n_nodes},)", key="masses"
        )
    mass = np.repeat(nodal, 3)[problem.free]
    bad = problem.free[~(mass > 0.0)]
    if len(bad):
        raise ConfigError(
            f"mass {nodal[bad[0] // 3]:g} kg at node {int(bad[0] // 3)}",
            expected="a positive mass at every node that can move",
            fix="give the node a mass, or fix it",
            key="masses",
        )
    values, vectors, zero = lowest_eigenpairs(problem, x, mass, n=n, zero_tolerance=zero_tolerance)
    is_zero = np.abs(values) <= zero
    vectors, n_rigid = split_zero_modes(problem, x, vectors, is_zero, mass)
    kinds = np.where(values > 0, "vibration", "unstable").astype("U10")
    at_zero = np.flatnonzero(is_zero)
    kinds[at_zero[:n_rigid]] = "rigid-body"
    kinds[at_zero[n_rigid:]] = "mechanism"
    angular = np.full(len(values), np.nan)
    np.sqrt(values, out=angular, where=values > zero)
    angular[is_zero] = 0.0
    shapes = np.zeros((len(values), problem.geometry.n_nodes * 3))
    shapes[:, problem.free] = vectors.T
    return Modes(
        eigenvalues=values,
        angular_frequencies=angular,
        shapes=shapes.reshape(len(values), problem.geometry.n_nodes, 3),
        kinds=tuple(map(str, kinds)),
        residual=float(np.abs(out_of_balance(problem, x)[0]).max(initial=0.0)),
    )
