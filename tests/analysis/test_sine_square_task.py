"""Waves by hand, and their recovery from stored symbols."""

import numpy as np
import pytest

from openprc.analysis.tasks import SineSquareTask
from openprc.errors import TaskError


def test_waves_by_hand():
    sine, square = SineSquareTask(8).waves
    root = np.sqrt(0.5)
    np.testing.assert_allclose(sine, [0, root, 1, root, 0, -root, -1, -root], atol=1e-15)
    assert square.tolist() == [1, 1, 1, 1, -1, -1, -1, -1]


def test_every_period_is_one_of_the_waves():
    task = SineSquareTask()
    data = task.generate(12 * 200, rng=0)
    classes = data.target.values.reshape(200, 12)
    assert (classes == classes[:, :1]).all()
    assert 70 < classes[:, 0].sum() < 130
    expected = task.waves[classes[:, 0].astype(int)]
    np.testing.assert_array_equal(data.input.reshape(200, 12), expected)


def test_crests_alone_do_not_tell():
    sine, square = SineSquareTask().waves
    np.testing.assert_allclose(sine[[3, 9]], square[[3, 9]])


@pytest.mark.parametrize("points", [5, 12])
@pytest.mark.parametrize("n", [12, 60, 67])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_recovery(points, n, seed):
    task = SineSquareTask(points)
    data = task.generate(n, rng=seed)
    found = task.target(0.02 * data.input - 1.0)
    np.testing.assert_array_equal(found.values, data.target.values)


def test_recovery_of_sines_alone():
    task = SineSquareTask(5)
    wave = np.tile(task.waves[0], 4)
    assert not task.target(3.0 * wave).values.any()


@pytest.mark.parametrize(
    ("u", "words"),
    [
        (np.zeros(24), "does not vary"),
        (np.random.default_rng(0).uniform(size=24), "no sequence of sine and square periods of 12"),
        (np.zeros((24, 2)), "expected: \\(K,\\) or \\(K, 1\\)"),
    ],
)
def test_other_inputs(u, words):
    with pytest.raises(TaskError, match=words):
        SineSquareTask().target(u)


def test_too_few_points():
    with pytest.raises(TaskError, match=r"points is 3\n.*from 4 on"):
        SineSquareTask(3)
