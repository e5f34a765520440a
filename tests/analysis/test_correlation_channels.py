"""Arrays that cannot be analysed are refused with words that help."""

import numpy as np
import pytest

from openprc.analysis import correlation as corr
from openprc.errors import TaskError

U, X = np.random.default_rng(7).normal(size=(2, 40))
GAP = np.where(np.arange(40) == 3, np.nan, X)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: corr.Linear(U[:30], X), r"u: the input has 30 rows and the states have 40"),
        (lambda: corr.Nonparametric(U[:30], X), r"x: the input has 30 rows"),
        (lambda: corr.Linear(np.ones(40), X), r"u: column 0 of the input never changes"),
        (lambda: corr.Linear(U, GAP), r"X: 1 of 40 rows are not finite, the first is row 3"),
        (lambda: corr.Redundancy(GAP), r"Y: 1 of 40 rows are not finite"),
        (lambda: corr.Linear(GAP, X), r"u: 1 of 40 rows are not finite"),
        (lambda: corr.Redundancy(X.reshape(10, 2, 2)), r"Y: the shape is \(10, 2, 2\)"),
        (lambda: corr.Redundancy(X[:5]), r"Y: there are 5 rows\n.*at least 8"),
        (lambda: corr.Redundancy(["a"] * 40), r"Y: the values are no real numbers"),
        (lambda: corr.Linear(U, np.ones(40)), r"X: none of the 1 channels changes"),
        (lambda: corr.Linear(U, X, names=["a", "b"]), r"names: 2 names, 2 of them different"),
        (
            lambda: corr.Linear(U, np.stack([U, X], axis=1), names=["a", "a"]),
            r"names: 2 names, 1 of them different, for 2 channels\n.*\n.*features.names",
        ),
        (
            lambda: corr.Nonparametric(np.stack([U, X], axis=1), X),
            r"x: the input has 2 columns",
        ),
    ],
)
def test_refused(call, words):
    with pytest.raises(TaskError, match=words):
        call()


def test_one_channel_and_a_column_of_input_are_welcome():
    lin = corr.Linear(U[:, None], X)
    assert lin.pearson.names == ("x0",)
    assert corr.Nonparametric(U, X).dcor.names == ("y0",)


def test_round_off_is_no_change():
    still = 0.1 + np.arange(40) % 2 * 1e-17 + 0.2
    assert corr.Linear(U, np.stack([still, X], axis=1)).dropped == ("x0",)


def test_names_that_do_not_exist():
    with pytest.raises(AttributeError, match="no attribute 'Curved'"):
        _ = corr.Curved
