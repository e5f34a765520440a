"""Delay taps and polynomials: estimators of scikit-learn, by its own checks."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.utils.estimator_checks import check_estimator

from openprc.errors import TaskError
from openprc.reservoir.features.delay_taps import DelayTaps
from openprc.reservoir.features.polynomial_expansion import PolynomialExpansion

ALONG_ROWS = {
    "check_methods_subset_invariance": "a tap reads earlier rows",
    "check_methods_sample_order_invariance": "a tap reads earlier rows",
}


@pytest.mark.filterwarnings("ignore:Can't check dok sparse matrix:UserWarning")
@pytest.mark.parametrize(
    ("estimator", "exceptions"),
    [(DelayTaps(2), ALONG_ROWS), (DelayTaps(1), {}), (PolynomialExpansion(2), {})],
    ids=repr,
)
def test_scikit_learn_agrees(estimator, exceptions):
    results = check_estimator(estimator, expected_failed_checks=exceptions, on_skip=None)
    assert {r["check_name"] for r in results if r["status"] == "xfail"} == set(exceptions)
    assert sum(r["status"] == "passed" for r in results) > 30


@given(
    n_rows=st.integers(1, 30),
    n_columns=st.integers(1, 4),
    n_taps=st.integers(1, 6),
    spacing=st.integers(1, 9),
)
def test_every_tap_holds_the_row_that_its_name_says(n_rows, n_columns, n_taps, spacing):
    x = np.arange(1.0, n_rows * n_columns + 1).reshape(n_rows, n_columns)
    taps = DelayTaps(n_taps, spacing=spacing)
    found = taps.fit_transform(x)
    names = taps.get_feature_names_out([f"s{c}" for c in range(n_columns)])
    assert found.shape == (n_rows, len(names))
    assert taps.n_history_rows_ == (n_taps - 1) * spacing
    for column, name in enumerate(names):
        state, _, delay = name.partition("[k-")
        delay = int(delay[:-1]) if delay else 0
        source = x[:, int(state[1:])]
        assert np.isnan(found[:delay, column]).all()
        np.testing.assert_array_equal(found[delay:, column], source[: max(n_rows - delay, 0)])


def test_nothing_is_invented_where_history_or_samples_are_missing():
    x = np.array([[1.0], [np.nan], [3.0], [4.0]])
    found = DelayTaps(2).fit_transform(x)
    np.testing.assert_array_equal(found, [[1, np.nan], [np.nan, 1], [3, np.nan], [4, 3]])


@pytest.mark.parametrize(
    ("keywords", "words"),
    [
        ({"n_taps": 0}, "n_taps is 0"),
        ({"n_taps": True}, "n_taps is True"),
        ({"n_taps": 2, "spacing": 1.5}, "spacing is 1.5"),
    ],
)
def test_impossible_taps(keywords, words):
    with pytest.raises(TaskError, match=words):
        DelayTaps(**keywords).fit(np.zeros((4, 1)))


def test_monomials_keep_the_names_of_the_states():
    expansion = PolynomialExpansion(2).fit([[2.0, 3.0]])
    assert expansion.transform([[2.0, 3.0]]).tolist() == [[2.0, 3.0, 4.0, 6.0, 9.0]]
    assert expansion.get_feature_names_out(["node0.z", "node1.z"]).tolist() == [
        "node0.z", "node1.z", "node0.z^2", "node0.z node1.z", "node1.z^2",
    ]  # fmt: skip
    products = PolynomialExpansion(3, interaction_only=True).fit_transform([[2.0, 3.0, 5.0]])
    assert products.tolist() == [[2.0, 3.0, 5.0, 6.0, 10.0, 15.0, 30.0]]
