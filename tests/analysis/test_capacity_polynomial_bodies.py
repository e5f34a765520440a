"""Bodies that are functions of the present input: capacities are Legendre coefficients."""

import numpy as np
import pytest

from openprc.analysis.capacity import (
    CapacityWarning,
    information_processing_capacity,
    polynomial_rows,
)
from openprc.errors import TaskError

ROWS = 20000


def of_one_state(state, u, *, degrees, **choices):
    return information_processing_capacity(
        state[:, None], u, delays=dict.fromkeys(range(1, degrees + 1), 0), **choices
    )


@pytest.mark.parametrize(
    ("function", "expected", "tolerance"),
    [
        (lambda u: u**3, {1: 21 / 25, 3: 4 / 25}, 0.005),
        (lambda u: u**4, {2: 45 / 49, 4: 4 / 49}, 0.005),
        (lambda u: u + u**2, {1: 15 / 19, 2: 4 / 19}, 0.005),
        (np.sign, {1: 3 / 4, 3: 7 / 64, 5: 0.0430, 7: 0.0229}, 0.006),
    ],
    ids=["u^3", "u^4", "u + u^2", "sign u"],
)
def test_coefficients_of_known_functions(function, expected, tolerance):
    # Midpoints in random order: the uniform distribution without the error of sampling it.
    u = (np.random.default_rng(1).permutation(ROWS) + 0.5) * 2 / ROWS - 1
    found = of_one_state(function(u), u, degrees=8)
    by_hand = [expected.get(degree, 0.0) for degree in range(1, 9)]
    np.testing.assert_allclose(found.raw, by_hand, atol=tolerance)
    drawn = np.random.default_rng(2).uniform(-1, 1, ROWS)
    found = of_one_state(function(drawn), drawn, degrees=8)
    np.testing.assert_allclose(found.raw, by_hand, atol=2 * tolerance)
    assert found.total <= 1.0 + 1e-9


def test_a_polynomial_of_the_basis_is_held_fully():
    u = np.random.default_rng(3).uniform(-1, 1, 5000)
    square = of_one_state(u**2, u, degrees=4, basis="legendre")
    assert square.raw[1] == pytest.approx(1.0, abs=1e-6)
    assert square.n_significant == 1
    rows = polynomial_rows(u, max_degree=2)
    both = information_processing_capacity(rows.T, u, delays={1: 3, 2: 3}, washout=3)
    held = [both.terms.labels().index(name) for name in ("P1(u(t))", "P2(u(t))")]
    np.testing.assert_allclose(both.raw[held], 1.0, atol=1e-9)
    assert both.n_significant == 2


DISTRIBUTIONS = {
    "uniform": lambda rng: rng.uniform(size=ROWS),
    "normal": lambda rng: rng.normal(size=ROWS),
    "exponential": lambda rng: rng.exponential(size=ROWS),
    "beta": lambda rng: rng.beta(2, 5, size=ROWS),
    "binary": lambda rng: rng.choice([-1.0, 1.0], ROWS),
}


@pytest.mark.parametrize("name", list(DISTRIBUTIONS))
def test_one_state_has_a_capacity_of_one_whatever_the_input(name):
    u = DISTRIBUTIONS[name](np.random.default_rng(4))
    assert of_one_state(u, u, degrees=4).total == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("name", ["normal", "exponential", "beta", "binary"])
def test_legendre_counts_twice_unless_the_input_is_uniform(name):
    u = DISTRIBUTIONS[name](np.random.default_rng(4))
    with pytest.raises(TaskError, match=r"the targets overlap\n.*targets that do not overlap"):
        of_one_state(u, u, degrees=4, basis="legendre")
    with pytest.warns(CapacityWarning, match="linear readouts of 1 independent states"):
        found = of_one_state(u, u, degrees=4, basis="legendre", excess="report")
    assert found.total > 1.8
    exact = of_one_state(u, u, degrees=4, basis="legendre", orthonormalize="exact")
    assert exact.raw_total == pytest.approx(1.0, abs=1e-9)


def test_hermite_suits_a_normal_input():
    u = DISTRIBUTIONS["normal"](np.random.default_rng(5))
    found = of_one_state(u**3, u, degrees=4, basis="hermite")
    # u^3 = He_3 + 3 He_1, so 9/15 and 6/15.
    np.testing.assert_allclose(found.raw, [0.6, 0.0, 0.4, 0.0], atol=0.05)


def test_few_values_end_the_polynomials():
    rng = np.random.default_rng(6)
    u = rng.choice([0.0, 1.0], 3000)
    found = information_processing_capacity(u[:, None], u, delays={1: 3, 2: 3, 3: 2}, washout=3)
    # 4 inputs, 6 pairs and 1 triple of different delays.
    assert len(found.terms) == 11
    assert "2 distinct values, so its polynomials end at degree 1: 13 of 24" in str(
        found.metadata["notes"]
    )
    with pytest.raises(TaskError, match="1 of 1 targets do not exist"):
        information_processing_capacity(u[:, None], u, terms=[[(2, 0)]])


@pytest.mark.parametrize("draw", list(DISTRIBUTIONS.values()), ids=list(DISTRIBUTIONS))
def test_empirical_polynomials_are_orthonormal(draw):
    u = draw(np.random.default_rng(7))[:2000]
    rows = polynomial_rows(u, max_degree=6)
    rows = np.vstack([np.ones(len(u)), rows])
    np.testing.assert_allclose(rows @ rows.T / len(u), np.eye(len(rows)), atol=1e-10)


def test_as_many_polynomials_as_the_input_has_values_but_one():
    rng = np.random.default_rng(8)
    for n_values in (2, 3, 5, 9):
        u = rng.choice(np.arange(n_values, dtype=float) ** 2, 4000)
        assert len(polynomial_rows(u, max_degree=12)) == n_values - 1


def test_legendre_and_hermite_rows_are_those_of_numpy():
    u = np.linspace(-1.0, 1.0, 501)
    for degree, row in enumerate(polynomial_rows(u, max_degree=5, basis="legendre"), start=1):
        by_numpy = np.polynomial.Legendre.basis(degree)(u) * np.sqrt(2 * degree + 1)
        np.testing.assert_allclose(row, by_numpy, atol=1e-12)
    z = (u - u.mean()) / u.std()
    factorial = 1.0
    for degree, row in enumerate(polynomial_rows(u, max_degree=5, basis="hermite"), start=1):
        factorial *= degree
        by_numpy = np.polynomial.HermiteE.basis(degree)(z) / np.sqrt(factorial)
        np.testing.assert_allclose(row, by_numpy, atol=1e-12)


def test_wrong_basis_and_constant_input():
    with pytest.raises(TaskError, match="the basis is 'chebyshev'"):
        polynomial_rows(np.arange(9.0), max_degree=2, basis="chebyshev")
    with pytest.raises(TaskError, match="the input does not vary"):
        polynomial_rows(np.full(9, 0.1), max_degree=2)
