"""The sparse factorisation against scipy's, and what it does with dependent rows."""

import numpy as np
import pytest
from from_python import callable_
from scipy import sparse
from scipy.sparse.linalg import splu

from openprc.demlat import linear
from openprc.demlat.linear import PIVOT_TOLERANCE, analyse

clear, factorise, multiply, refine, solve = (
    callable_(getattr(linear, name))
    for name in ("clear", "factorise", "multiply", "refine", "solve")
)


def positive_definite(n, rng):
    a = sparse.random_array((n, n), density=min(3.0 / n, 1.0), rng=rng)
    return (a @ a.T + 0.1 * sparse.eye_array(n)).tocoo()


def quasi_definite(n, rng):
    """[[H, G'], [G, -E]] with H and E positive definite: a KKT matrix."""
    m = n // 3
    g = sparse.random_array((m, n - m), density=min(3.0 / n, 1.0), rng=rng)
    blocks = [[positive_definite(n - m, rng), g.T], [g, -1e-3 * sparse.eye_array(m)]]
    return sparse.block_array(blocks).tocoo()


def factor_of(matrix, **options):
    triangle = sparse.tril(matrix).tocoo()
    factor, position = analyse(triangle.row, triangle.col, n=matrix.shape[0], **options)
    np.add.at(factor.values, position, triangle.data)
    return factor


def edges(pairs, n):
    """Return rows and columns of a graph's Laplacian, one triangle, with the matrix."""
    i, j = np.array(pairs).T
    matrix = np.zeros((n, n))
    np.add.at(matrix, (i, j), -1.0)
    matrix += matrix.T
    return sparse.coo_array(matrix - np.diag(matrix.sum(axis=1)))


def grid_pairs(side):
    number = np.arange(side * side).reshape(side, side)
    return [
        *zip(number[:-1].flat, number[1:].flat, strict=True),
        *zip(number[:, :-1].flat, number[:, 1:].flat, strict=True),
    ]


@pytest.mark.parametrize("n", [1, 2, 3, 40, 300])
@pytest.mark.parametrize("make", [positive_definite, quasi_definite])
def test_solutions_are_those_of_a_pivoting_solver(make, n):
    rng = np.random.default_rng(n)
    matrix = make(max(n, 3) if make is quasi_definite else n, rng)
    factor = factor_of(matrix)
    b = rng.normal(size=matrix.shape[0])
    dropped, negative = factorise(factor, PIVOT_TOLERANCE)
    x = b.copy()
    solve(factor, x)
    refine(factor, b, x)
    expected = splu(matrix.tocsc()).solve(b)
    np.testing.assert_allclose(x, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
    assert dropped == 0
    assert negative == np.sum(np.linalg.eigvalsh(matrix.toarray()) < 0)


def test_product_is_the_matrix_times_the_vector():
    rng = np.random.default_rng(0)
    matrix = quasi_definite(50, rng)
    x, out = rng.normal(size=50), np.zeros(50)
    multiply(factor_of(matrix), x, out)
    np.testing.assert_allclose(out, matrix @ x, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize(
    "pairs",
    [
        [(i, i + 1) for i in range(60)],  # a chain
        [(0, i + 1) for i in range(60)],  # a star
        [((i - 1) // 2, i) for i in range(1, 61)],  # a binary tree
    ],
)
def test_trees_in_any_numbering_have_no_fill(pairs):
    shuffle = np.random.default_rng(1).permutation(61)
    matrix = edges(shuffle[np.array(pairs)], 61)
    assert len(factor_of(matrix).l_row) == 60


def test_a_mesh_is_ordered_for_less_fill_than_its_band():
    side = 20
    factor = factor_of(edges(grid_pairs(side), side * side))
    assert len(factor.l_row) < 0.45 * side**3


@pytest.mark.parametrize("n", [60, 59])
def test_blocks_are_ordered_as_one(n):
    rng = np.random.default_rng(2)
    nodes = np.kron(edges(grid_pairs(5)[:-4], 25).toarray()[:20, :20] != 0, np.ones((3, 3)))
    matrix = sparse.coo_array((nodes + 20.0 * np.eye(60))[:n, :n])
    factor = factor_of(matrix, block=3)
    factorise(factor, PIVOT_TOLERANCE)
    b = rng.normal(size=n)
    x = b.copy()
    solve(factor, x)
    np.testing.assert_allclose(matrix @ x, b, rtol=0, atol=1e-13)
    for node in range(20):
        assert np.ptp(np.flatnonzero(factor.order // 3 == node)) < 3


def test_contributions_to_one_entry_add_up_from_either_triangle():
    factor, position = analyse([0, 1, 0, 1, 1], [0, 1, 1, 0, 1], n=2)
    clear(factor)
    np.add.at(factor.values, position, [4.0, 2.0, 0.5, 0.5, 1.0])
    factorise(factor, PIVOT_TOLERANCE)
    b = np.array([5.0, 4.0])
    solve(factor, b)  # [[4, 1], [1, 3]]
    np.testing.assert_allclose(b, [1.0, 1.0], rtol=1e-15)


def test_dependent_rows_are_counted_and_consistent_systems_solved():
    rng = np.random.default_rng(3)
    two_islands = [*grid_pairs(6), *(np.array(grid_pairs(5)) + 36)]
    matrix = edges(two_islands, 61)  # singular: a constant on each island
    factor = factor_of(matrix)
    dropped, negative = factorise(factor, PIVOT_TOLERANCE)
    assert (dropped, negative) == (2, 0)
    b = matrix @ rng.normal(size=61)
    x = b.copy()
    solve(factor, x)
    np.testing.assert_allclose(matrix @ x, b, rtol=0, atol=1e-13)
    out = factor.order[factor.inverse_pivot == 0.0]
    assert len(out) == 2
    assert np.all(x[out] == 0.0)


def test_a_row_of_zeros_is_dropped_and_its_neighbours_solved():
    factor, position = analyse([0, 1, 2], [0, 1, 2], n=3)
    factor.values[position] = [2.0, 0.0, 4.0]
    assert factorise(factor, PIVOT_TOLERANCE) == (1, 0)
    b = np.array([2.0, 7.0, 4.0])
    solve(factor, b)
    np.testing.assert_array_equal(b, [1.0, 0.0, 1.0])


def test_terms_that_cancel_count_as_zero_even_where_the_diagonal_is_zero():
    factor, position = analyse([0, 1, 2, 3, 0, 1, 2], [0, 1, 2, 3, 3, 3, 3], n=4)
    factor.values[position] = [3.0, 3.0, -3.0, 0.0, 0.3, 0.4, 0.5]  # 0.09 + 0.16 - 0.25
    assert factorise(factor, PIVOT_TOLERANCE)[0] == 1


def test_small_pivots_of_small_rows_are_not_mistaken_for_zero():
    scale = np.logspace(-12, 12, 20)
    matrix = sparse.coo_array(
        scale[:, None] * edges([(i, i + 1) for i in range(19)], 20).toarray() * scale
        + np.diag(1e-6 * scale**2)
    )
    assert factorise(factor_of(matrix), PIVOT_TOLERANCE) == (0, 0)


def test_nan_comes_through():
    factor, position = analyse([0, 1, 1], [0, 0, 1], n=2)
    factor.values[position] = [1.0, np.nan, 1.0]
    factorise(factor, PIVOT_TOLERANCE)
    b = np.ones(2)
    solve(factor, b)
    assert np.isnan(b).any()
    factor.values[position] = [1.0, 0.0, 1.0]
    factorise(factor, PIVOT_TOLERANCE)
    b[:] = 1.0
    solve(factor, b)
    np.testing.assert_array_equal(b, 1.0)  # and leaves nothing behind


def test_refinement_repairs_what_elimination_without_pivoting_loses():
    rng = np.random.default_rng(4)
    n, m = 60, 20
    g = rng.normal(size=(m, n))
    matrix = sparse.coo_array(np.block([[np.diag(np.logspace(-5, 5, n)), g.T], [g, -np.eye(m)]]))
    factor = factor_of(matrix)
    factorise(factor, PIVOT_TOLERANCE)
    truth = rng.normal(size=n + m)
    b = matrix @ truth
    x = b.copy()
    solve(factor, x)
    before = np.abs(matrix @ x - b).max()
    refine(factor, b, x)
    after = np.abs(matrix @ x - b).max()
    assert after < 1e-11
    assert after <= before


def test_solutions_repeat_bit_by_bit():
    rng = np.random.default_rng(5)
    factor = factor_of(positive_definite(80, rng))
    b = rng.normal(size=80)

    solutions = []
    for _ in range(2):
        factorise(factor, PIVOT_TOLERANCE)
        x = b.copy()
        solve(factor, x)
        refine(factor, b, x)
        solutions.append(x)
    np.testing.assert_array_equal(*solutions)


def test_no_unknowns_are_no_problem():
    factor, position = analyse([], [], n=0)
    assert factorise(factor, PIVOT_TOLERANCE) == (0, 0)
    assert len(position) == 0
