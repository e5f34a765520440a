import numpy as np
import pytest

from openprc.errors import TaskError
from openprc.reservoir.training.classification import (
    classification,
    commonest_label,
    symbol_error_rate,
)
from openprc.reservoir.training.scores import DEFINITIONS, NRMSE_DEFINITION, nmse, score

Y, P = [1.0, 2.0, 3.0, 4.0], [1.1, 1.9, 3.2, 3.8]

#: By hand: the errors are 0.1, 0.1, 0.2, 0.2, the variance is 1.25, the range 3, the mean 2.5.
BY_HAND = {
    "mse": 0.025,
    "rmse": np.sqrt(0.025),
    "nmse": 0.02,
    "nrmse": np.sqrt(0.02),
    "nrmse_range": np.sqrt(0.025) / 3.0,
    "nrmse_mean": np.sqrt(0.025) / 2.5,
    "nmse_power": 0.1 / 30.0,
    "nrmse_ddof1": np.sqrt(0.025) / np.sqrt(5.0 / 3.0),
    "r2": 0.98,
    "corr2": 4.7**2 / (5.0 * 4.5),
}


@pytest.mark.parametrize("name", DEFINITIONS)
def test_by_hand(name):
    assert score(Y, P, name=name)[0] == pytest.approx(BY_HAND[name], rel=1e-12)


@pytest.mark.parametrize(
    ("name", "published"),
    [
        ("nrmse", 0.141421),
        ("nrmse_range", 0.052705),
        ("nrmse_mean", 0.063246),
        ("nmse_power", 0.003333),
        ("nrmse_ddof1", 0.122474),
        ("corr2", 0.981778),
    ],
)
def test_the_numbers_that_the_literature_calls_nrmse(name, published):
    assert score(Y, P, name=name)[0] == pytest.approx(published, abs=5e-7)


def test_one_default_and_its_name_in_files():
    assert score(Y, P)[0] == score(Y, P, name="nrmse")[0]
    assert NRMSE_DEFINITION.startswith(DEFINITIONS["nrmse"])


def test_several_outputs():
    y, p = np.column_stack([Y, Y]), np.column_stack([P, Y])
    np.testing.assert_allclose(score(y, p, name="nmse"), [0.02, 0.0], atol=1e-15)
    np.testing.assert_allclose(nmse(y, np.full((4, 2), 2.5)), [1.0, 1.0], rtol=1e-12)


def test_a_constant_prediction_is_correlated_with_nothing():
    assert score(Y, np.full(4, 2.0), name="corr2")[0] == 0.0


@pytest.mark.parametrize(
    ("y", "p", "name", "words"),
    [
        (Y, P[:3], "nrmse", r"the target has shape \(4,\) and the prediction \(3,\)"),
        ([], [], "nrmse", "at least one row"),
        (Y, P, "rms", "the score is 'rms'"),
        ([1.0, 1.0], [1.0, 2.0], "nmse", "output 0 of the target is constant"),
        ([1.0, -1.0], [1.0, 2.0], "nrmse_mean", "the mean of output 0 is zero"),
        ([0.0, 0.0], [1.0, 2.0], "nmse_power", "the power of output 0 is zero"),
    ],
)
def test_scores_that_do_not_exist(y, p, name, words):
    with pytest.raises(TaskError, match=words):
        score(y, p, name=name)


def test_confusion_by_hand():
    true, named = np.array(list("aabbbc")), np.array(list("abbbcc"))
    found = classification(true, named, commonest="b")
    np.testing.assert_array_equal(found.labels, ["a", "b", "c"])
    np.testing.assert_array_equal(found.confusion, [[1, 1, 0], [0, 2, 1], [0, 0, 1]])
    assert found.accuracy == pytest.approx(4 / 6)
    assert found.symbol_error_rate == pytest.approx(2 / 6)
    assert found.majority == pytest.approx(3 / 6)
    assert commonest_label(true) == "b"


def test_symbols_are_decided_by_distance():
    y, p = [-3, -1, 1, 3, 1], [-2.1, -1.9, 1.9, 9.0, -0.1]
    assert symbol_error_rate(y, p) == pytest.approx(1 / 5)
    # A symbol that the target happens to lack is still a neighbour.
    assert symbol_error_rate([-3, 3], [-1.5, 3]) == 0.0
    assert symbol_error_rate([-3, 3], [-1.5, 3], alphabet=[-3, -1, 1, 3]) == 0.5
    with pytest.raises(TaskError, match="there are 2 symbols and 1 predictions"):
        symbol_error_rate([1, 3], [1])
