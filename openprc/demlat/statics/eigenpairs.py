"""Lowest eigenpairs of the stiffness along the constraints, dense or by shift-invert."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from scipy import linalg, sparse  # noqa: TID253 - eigenvalue problems are what this is for
from scipy.sparse.csgraph import connected_components  # noqa: TID253 - as above
from scipy.sparse.linalg import (  # noqa: TID253 - as above
    ArpackNoConvergence,
    LinearOperator,
    eigsh,
    splu,
)

from openprc.demlat.statics.factorization import (
    PENALTY,
    Constraints,
    factor_definite,
    out_of_balance,
)
from openprc.errors import NotConverged

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.demlat.statics.assembly import StaticProblem

    Reals = NDArray[np.float64]

#: An eigenvalue within this share of the largest one counts as zero.
ZERO_TOLERANCE = 1e-11
#: Up to this many degrees of freedom all eigenvalues are computed by dense algebra.
DENSE_LIMIT = 400
#: Singular values of the constraints below this count as redundant.
_RANK_TOLERANCE = 1e-9


def lowest_eigenpairs(
    problem: StaticProblem,
    positions: Reals,
    masses: Reals | None,
    *,
    n: int,
    zero_tolerance: float,
) -> tuple[Reals, Reals, float]:
    """Return up to `n` eigenvalues, vectors (n_free, E), and what counts as zero.

    ``W u = w M u`` for u along the constraints, W the Hessian of the Lagrangian.

    Parameters
    ----------
    problem : StaticProblem
    positions : (N, 3) [m]
    masses : (n_free,) [kg], or None for the identity
    n : int
    zero_tolerance : float
    """
    size = len(problem.free)
    mass = np.ones(size) if masses is None else masses
    _, multipliers, constraints = out_of_balance(problem, positions)
    hessian = problem.hessian(positions, multipliers)
    root = 1.0 / np.sqrt(mass)
    scaling = sparse.diags_array(root)
    # With vectors scaled by the root of the masses the problem has an identity on the right.
    scaled = sparse.csr_array(scaling @ hessian @ scaling)
    # Gershgorin's bound of the largest eigenvalue.
    largest = float(abs(scaled).sum(axis=1).max()) if size else 0.0
    rows = None if constraints is None else sparse.csr_array(constraints.jacobian @ scaling)
    if size <= DENSE_LIMIT or n >= size // 4:
        values, vectors = _dense(scaled, rows, n)
    else:
        values, vectors = _sparse(scaled, rows, n, largest)
    return values, vectors * root[:, np.newaxis], zero_tolerance * largest


def _dense(matrix: sparse.csr_array, rows: sparse.csr_array | None, n: int) -> tuple[Reals, Reals]:
    full = matrix.toarray()
    if rows is None:
        count = min(n, len(full))
        if count == 0:
            return np.zeros(0), np.zeros((0, 0))
        return linalg.eigh(full, subset_by_index=[0, count - 1])
    along = linalg.null_space(rows.toarray(), rcond=_RANK_TOLERANCE)
    if along.shape[1] == 0:
        return np.zeros(0), np.zeros((len(full), 0))
    count = min(n, along.shape[1])
    values, inner = linalg.eigh(along.T @ full @ along, subset_by_index=[0, count - 1])
    return values, along @ inner


def _sparse(
    matrix: sparse.csr_array, rows: sparse.csr_array | None, n: int, largest: float
) -> tuple[Reals, Reals]:
    """Lanczos on the shifted inverse.

    The shift makes the matrix definite along the constraints, so it lies below all eigenvalues
    and negative ones are the first to be found. As small a shift as serves is taken, since
    eigenvalues that are close to each other compared with it are hard to tell apart.
    """
    size = matrix.shape[0]
    identity = sparse.eye_array(size)
    constraints = None if rows is None else Constraints(rows)
    penalty = PENALTY * largest
    shift, factors = 1e-9 * largest, None
    while True:
        moved = sparse.csr_array(matrix + shift * identity)
        if constraints is None:
            factors = factor_definite(moved)
        else:
            factors = factor_definite(moved + penalty * constraints.normal)
        # Gershgorin: from a shift of the largest row sum on it is definite.
        if factors is not None or shift > 2.0 * largest:
            break
        shift *= 10.0
    if factors is None:
        raise NotConverged(
            "a stiffness matrix whose entries span too many orders of magnitude",
            expected="eigenvalues that double precision can tell apart",
            fix="bring the stiffnesses of the elements nearer to each other",
        )
    solve: Callable[[Reals], Reals] = factors.solve
    if rows is not None:
        count = rows.shape[0]
        corner = sparse.csr_array(sparse.eye_array(count) * (-1e-13 / largest))
        bordered = sparse.block_array([[moved, sparse.csr_array(rows.T)], [rows, corner]])
        saddle = splu(sparse.csc_array(bordered))

        def solve(u: Reals) -> Reals:
            solution: Reals = saddle.solve(np.concatenate([u, np.zeros(count)]))[:size]
            return solution

    inverse = LinearOperator((size, size), matvec=solve, dtype=np.float64)
    start = solve(np.random.default_rng(0).standard_normal(size))
    try:
        values, vectors = eigsh(
            matrix, k=n, sigma=-shift, OPinv=inverse, which="LM", v0=start, tol=0.0
        )
    except ArpackNoConvergence as error:
        raise NotConverged(
            f"only {len(error.eigenvalues)} of {n} eigenvalues were found",
            expected="eigenvalues that Lanczos' method can tell apart",
            fix="ask for fewer",
        ) from error
    order = np.argsort(values)
    return values[order], vectors[:, order]


# --- zero modes -------------------------------------------------------------------------------


def split_zero_modes(
    problem: StaticProblem,
    positions: Reals,
    vectors: Reals,
    is_zero: NDArray[np.bool_],
    masses: Reals | None,
) -> tuple[Reals, int]:
    """Turn the zero modes so that motions of rigid pieces come first, and count those.

    Parameters
    ----------
    vectors : (n_free, E)
        Orthonormal with respect to `masses`.
    is_zero : (E,) bool
    masses : (n_free,) [kg], or None for the identity
    """
    rigid = rigid_motions(problem, positions)
    if not is_zero.any() or rigid.shape[1] == 0:
        return vectors, 0
    root = np.sqrt(np.ones(len(vectors)) if masses is None else masses)[:, np.newaxis]
    basis = linalg.orth(root * rigid)
    zero = root * vectors[:, is_zero]
    # Cosines of the angles between both spaces; a common motion has the cosine 1.
    turn, cosines, _ = np.linalg.svd(zero.T @ basis)
    n_rigid = int((cosines > 1.0 - 1e-6).sum())
    turned = vectors.copy()
    turned[:, is_zero] = (zero @ turn) / root
    return turned, n_rigid


def pieces(problem: StaticProblem) -> tuple[int, NDArray[np.int32]]:
    """Return how many connected pieces there are, and the piece of every node: (N,)."""
    n = problem.geometry.n_nodes
    bars, hinges = problem.geometry.bars.indices, problem.geometry.hinges.indices
    bends = problem.geometry.bends.indices
    pairs = np.concatenate(
        [bars, hinges[:, :2], hinges[:, 1:3], hinges[:, 2:], bends[:, :2], bends[:, 1:]]
    )
    graph = sparse.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    count, labels = connected_components(graph, directed=False)
    return count, labels


def rigid_motions(problem: StaticProblem, positions: Reals) -> Reals:
    """Return velocities of rigid pieces that respect what is held: (n_free, R)."""
    count, labels = pieces(problem)
    held = problem.held
    columns = []
    for piece in range(count):
        nodes = np.flatnonzero(labels == piece)
        motions = piece_motions(positions[nodes])
        stuck = motions[held[nodes].ravel()]
        admissible = linalg.null_space(stuck, rcond=1e-9) if len(stuck) else np.eye(6)
        moving = motions @ admissible
        whole = np.zeros((problem.geometry.n_nodes * 3, moving.shape[1]))
        whole[(3 * nodes[:, None] + np.arange(3)).ravel()] = moving
        columns.append(whole[problem.free])
    return np.concatenate(columns, axis=1)


def piece_motions(positions: Reals) -> Reals:
    """Return three translations and three rotations of nodes (P, 3) [m]: (3 P, 6).

    Lengths are relative to the size of the piece, about its centre.
    """
    arms = positions - positions.mean(axis=0)
    size = float(np.abs(arms).max()) or 1.0
    motions = np.zeros((len(positions), 3, 6))
    for axis in range(3):
        motions[:, axis, axis] = 1.0
        motions[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arms / size)
    return motions.reshape(-1, 6)
