"""The figures by hand."""

import numpy as np
import pytest

from openprc.analysis.tasks.scoring import nearest_level, score, squared_correlation
from openprc.errors import TaskError

Y, P = [1.0, 2.0, 3.0, 4.0], [1.1, 1.9, 3.2, 3.8]


def test_nrmse_and_squared_correlation_by_hand():
    assert score("nrmse", Y, P) == pytest.approx([np.sqrt(0.02)], abs=1e-14)
    # Deviations of y: -1.5 -.5 .5 1.5; of p: -1.4 -.6 .7 1.3. Products 4.7, squares 5 and 4.5.
    assert score("corr2", Y, P) == pytest.approx([4.7**2 / (5.0 * 4.5)], abs=1e-14)


def test_squared_correlation_of_several_outputs():
    y = np.array([[1.0, 0.0], [2.0, 1.0], [3.0, 0.0]])
    p = np.array([[-2.0, 5.0], [-4.0, 5.0], [-6.0, 5.0]])
    assert squared_correlation(y, p) == pytest.approx([1.0, 0.0])


def test_decisions():
    levels = (3.0, -1.0, 1.0, -3.0)
    assert nearest_level([-9.0, -2.1, -1.9, 0.1, 2.5], levels).tolist() == [-3, -3, -1, 1, 3]
    sent, got = [3.0, -1.0, 1.0, -3.0], [2.2, 0.1, 0.9, -8.0]
    assert score("ser", sent, got, levels=levels) == pytest.approx([0.25])
    assert score("accuracy", sent, got, levels=levels) == pytest.approx([0.75])


@pytest.mark.parametrize(
    ("metric", "y", "p", "words"),
    [
        ("nrmse", Y, P[1:], "target has shape \\(4, 1\\) and the prediction \\(3, 1\\)"),
        ("nrmse", Y, [1.0, np.nan, 1.0, 1.0], "the prediction has shape"),
        ("nrmse", [], [], "the target has shape \\(0, 1\\)"),
        ("nrmse", [1.0, 1.0], [1.0, 2.0], "output 0 of the target is constant"),
        ("corr2", [0.1, 0.1, 0.1], [1.0, 2.0, 3.0], "output 0 of the target is constant"),
        ("ser", Y, P, "'ser' without levels"),
        ("rmse", Y, P, "the metric is 'rmse'\n.*nrmse, ser, accuracy, corr2"),
    ],
)
def test_wrong_scores(metric, y, p, words):
    with pytest.raises(TaskError, match=words):
        score(metric, y, p)
