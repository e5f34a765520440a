"""Stability of an equilibrium from the eigenvalues of its constrained stiffness."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from openprc.demlat.statics.eigenpairs import ZERO_TOLERANCE, lowest_eigenpairs, split_zero_modes
from openprc.errors import ConfigError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.demlat.statics.assembly import StaticProblem

    Reals = NDArray[np.float64]


#: Bodies with thousands of mechanisms need not have all of them listed.
MOST_ZEROS = 96


@dataclass(frozen=True, kw_only=True, eq=False)
class Stability:
    """How the energy curves around an equilibrium.

    Attributes
    ----------
    kind : {"stable", "neutral", "unstable"}
        "stable": every motion but those of a rigid body costs energy. "neutral": none gains
        energy and some mechanism costs none (to second order). "unstable": some gain energy.
    eigenvalues : (E,) [N/m]
        The lowest of the stiffness along the constraints, ascending.
    directions : (E, N, 3)
        Unit vectors, 0 at held axes.
    n_negative, n_zero : int
        Among `eigenvalues`; all negative ones are there.
    n_rigid, n_mechanisms : int
        Zero eigenvalues that are motions of rigid pieces, and the others.
    """

    kind: Literal["stable", "neutral", "unstable"]
    eigenvalues: Reals
    directions: Reals
    n_negative: int
    n_zero: int
    n_rigid: int
    n_mechanisms: int


def stability(
    problem: StaticProblem,
    positions: Reals,
    *,
    n: int = 12,
    zero_tolerance: float = ZERO_TOLERANCE,
) -> Stability:
    """Return the lowest eigenvalues of the stiffness matrix over free degrees of freedom.

    Rigid elements restrict it to motions that keep them, and add the curvature of their
    constraints times the forces they carry.

    Parameters
    ----------
    problem : StaticProblem
    positions : (N, 3) [m]
        An equilibrium.
    n : int
        How many eigenvalues, at least; more are computed until none below zero is left out,
        and none at zero while there are fewer than `MOST_ZEROS`.
    zero_tolerance : float
        An eigenvalue within this share of the largest one counts as zero.

    Raises
    ------
    ConfigError
        When `n` is below 1.

    Examples
    --------
    >>> from openprc.demlat.geometry_builder import GeometryBuilder
    >>> from openprc.demlat.statics import StaticProblem, stability
    >>> build = GeometryBuilder()
    >>> corners = build.add_nodes([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    >>> for a in range(4):
    ...     bar = build.add_bar(corners[a], corners[a - 1], stiffness=10.0)
    >>> problem = StaticProblem(geometry=build.geometry())
    >>> found = stability(problem, problem.positions)
    >>> print(found.kind, found.n_rigid, found.n_mechanisms)
    neutral 6 2
    """
    if n < 1:
        raise ConfigError(f"n = {n}", expected="at least one eigenvalue", key="n")
    wanted = n
    while True:
        values, vectors, zero = lowest_eigenpairs(
            problem, positions, None, n=wanted, zero_tolerance=zero_tolerance
        )
        if len(values) < wanted or values[-1] > zero:
            break
        if wanted >= MOST_ZEROS and values[-1] >= -zero:
            break
        wanted *= 2
    is_zero = np.abs(values) <= zero
    vectors, n_rigid = split_zero_modes(problem, positions, vectors, is_zero, None)
    n_negative, n_zero = int((values < -zero).sum()), int(is_zero.sum())
    kind: Literal["stable", "neutral", "unstable"] = "stable"
    if n_negative:
        kind = "unstable"
    elif n_zero > n_rigid:
        kind = "neutral"
    directions = np.zeros((len(values), problem.geometry.n_nodes * 3))
    directions[:, problem.free] = vectors.T
    return Stability(
        kind=kind,
        eigenvalues=values,
        directions=directions.reshape(len(values), problem.geometry.n_nodes, 3),
        n_negative=n_negative,
        n_zero=n_zero,
        n_rigid=n_rigid,
        n_mechanisms=n_zero - n_rigid,
    )
