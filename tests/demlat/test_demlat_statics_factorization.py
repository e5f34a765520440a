"""Definiteness from pivots, steps along constraints, and both ways to eigenvalues."""

import numpy as np
import pytest
from scipy import sparse

from openprc.demlat.statics import eigenpairs
from openprc.demlat.statics.factorization import (
    Constraints,
    definite_step,
    factor_definite,
    stationary_step,
)
from openprc.errors import NotConverged


def symmetric(rng, n, *, shift=0.0):
    """Return a sparse symmetric matrix whose lowest eigenvalue is `shift`."""
    full = np.where(rng.random((n, n)) < 0.15, rng.standard_normal((n, n)), 0.0)
    full = full + full.T
    full += (shift - np.linalg.eigvalsh(full)[0]) * np.eye(n)
    return sparse.csr_array(full)


@pytest.mark.parametrize("n", [1, 7, 40])
@pytest.mark.parametrize("lowest", [-1.0, -1e-6, 1e-6, 1.0])
def test_definite_is_told_from_the_pivots(n, lowest):
    for seed in range(5):
        matrix = symmetric(np.random.default_rng(seed), n, shift=lowest)
        factors = factor_definite(matrix)
        assert (factors is not None) == (lowest > 0)
        if factors is not None:
            right = np.random.default_rng(seed).standard_normal(n)
            np.testing.assert_allclose(matrix @ factors.solve(right), right, atol=1e-8)


def test_singular_matrices_are_not_definite():
    assert factor_definite(sparse.csr_array(np.zeros((3, 3)))) is None
    assert factor_definite(sparse.csr_array(np.array([[1.0, -1.0], [-1.0, 1.0]]))) is None
    assert factor_definite(sparse.csr_array(np.array([[0.0, 1.0], [1.0, 0.0]]))) is None


def problem_with_redundancy(lowest):
    """Return W, which has a negative direction that the constraints close, A, and a force."""
    rng = np.random.default_rng(5)
    n = 12
    rows = rng.standard_normal((4, n))
    rows[3] = rows[0] - 2 * rows[1]
    along = np.linalg.svd(rows)[2][3:]
    inner = symmetric(rng, len(along), shift=lowest).toarray()
    across = np.linalg.svd(rows)[2][:3]
    full = along.T @ inner @ along - 5.0 * across.T @ across
    return sparse.csr_array(full), sparse.csr_array(rows), rng.standard_normal(n), along, inner


def test_step_along_redundant_constraints_is_the_reduced_one():
    matrix, rows, force, along, inner = problem_with_redundancy(0.5)
    constraints = Constraints(rows)
    expected = along.T @ np.linalg.solve(inner, -along @ force)
    step = definite_step(matrix, force, constraints, 0.0)
    np.testing.assert_allclose(step, expected, atol=1e-10)
    assert np.abs(rows @ step).max() < 1e-12
    np.testing.assert_allclose(stationary_step(matrix, force, constraints), expected, atol=1e-7)
    left = force + rows.T @ constraints.multipliers(force)
    np.testing.assert_allclose(left, along.T @ along @ force, atol=1e-12)


def test_step_is_refused_where_the_constraints_leave_a_negative_direction():
    matrix, rows, force, _, _ = problem_with_redundancy(-0.5)
    assert definite_step(matrix, force, Constraints(rows), 0.0) is None
    assert definite_step(matrix, force, Constraints(rows), 0.6) is not None
    assert definite_step(matrix, force, None, 0.6) is None


def test_shortest_step_closes_gaps():
    _, rows, _, _, _ = problem_with_redundancy(1.0)
    gaps = rows @ np.arange(12.0)
    step = Constraints(rows).shortest(gaps)
    np.testing.assert_allclose(step, np.linalg.pinv(rows.toarray()) @ gaps, atol=1e-9)
    assert np.linalg.norm(Constraints(rows, damping=10.0).shortest(gaps)) < np.linalg.norm(step)


def test_stationary_step_needs_a_matrix_that_is_not_zero():
    assert stationary_step(sparse.csr_array(np.zeros((2, 2))), np.zeros(2), None) is not None
    left = sparse.csr_array(np.diag([-1e-11, 1.0]))
    assert stationary_step(left, np.ones(2), None) is None


@pytest.mark.parametrize("lowest", [-3.0, 0.0, 2.0])
@pytest.mark.parametrize("constrained", [False, True])
def test_lanczos_agrees_with_dense_algebra(lowest, constrained):
    rng = np.random.default_rng(2)
    n = 60
    matrix = symmetric(rng, n, shift=lowest)
    rows = sparse.csr_array(rng.standard_normal((5, n))) if constrained else None
    largest = float(abs(matrix).sum(axis=1).max())
    dense, _ = eigenpairs._dense(matrix, rows, 6)
    values, vectors = eigenpairs._sparse(matrix, rows, 6, largest)
    np.testing.assert_allclose(values, dense, atol=1e-9 * largest)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(6), atol=1e-8)
    if rows is not None:
        assert np.abs(rows @ vectors).max() < 1e-8


def test_eigenvalues_beyond_double_precision_are_refused():
    matrix = sparse.csr_array(np.full((6, 6), np.nan))
    with pytest.raises(NotConverged, match="span too many orders of magnitude"):
        eigenpairs._sparse(matrix, None, 2, 1.0)
