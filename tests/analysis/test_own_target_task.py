"""Targets from an array or a function of the user's."""

import numpy as np
import pytest

from openprc.analysis.tasks import ArrayTask, FunctionTask, array_task
from openprc.errors import TaskError


def test_an_array():
    y = np.stack([np.arange(4.0), np.ones(4)], axis=1)
    y[0] = np.nan
    task = array_task(y, name="lift-2", n_warmup=1, names=("lift", "drag"), source="tunnel")
    series = task.target(np.zeros(4))
    assert series.names == ("lift", "drag")
    np.testing.assert_array_equal(series.values, y)
    told = task.metadata()
    assert (told["task"], told["source"], told["task_y"]) == (
        "lift-2", "tunnel", "array of shape (4, 2)",
    )  # fmt: skip


def test_levels_are_read_off():
    task = ArrayTask([2, 0, 2, 1], metric="accuracy")
    assert task.levels == (0.0, 1.0, 2.0)
    assert task.score(task.y, [[1.6], [0.4], [1.4], [1.0]]) == pytest.approx([0.75])
    assert ArrayTask([2, 0], metric="ser", levels=(0.0, 2.0, 4.0)).levels == (0.0, 2.0, 4.0)


def test_a_function_gets_what_was_passed():
    task = FunctionTask(lambda u: np.where(np.arange(len(u)) < 2, np.nan, u**2), n_warmup=2)
    assert task.target([1.0, 2.0, 3.0]).values[2, 0] == 9.0
    assert FunctionTask(lambda u: u).target(np.ones((3, 2))).values.shape == (3, 2)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: ArrayTask([1.0, np.nan]), "1 of 2 target rows are NaN"),
        (lambda: ArrayTask(np.zeros((2, 2, 2))), "shape \\(2, 2, 2\\)"),
        (lambda: ArrayTask([1.0], name="a/b"), "the task name is 'a/b'"),
        (lambda: ArrayTask([1.0], name=""), "the task name is ''"),
        (lambda: ArrayTask([1.0], metric="mse"), "the metric is 'mse'"),
        (lambda: ArrayTask([1.0, 2.0], n_warmup=-1), "n_warmup is -1"),
        (lambda: ArrayTask([1.0, 2.0], n_warmup=2), "2 symbols and the task leaves 2"),
        (lambda: ArrayTask([1.0, 2.0], names=("a", "b")), "for 1 outputs"),
        (lambda: ArrayTask([1.0, 2.0]).target([1.0]), "2 rows and the input 1 symbols"),
        (lambda: FunctionTask(lambda u: u[1:]).target([1.0, 2.0]), "gave shape \\(1,\\) for 2"),
        (lambda: FunctionTask(lambda _: 1.0).target([1.0]), "gave shape \\(\\) for 1"),
        (lambda: FunctionTask(np.log).target([1.0, 0.0]), "1 of 2 target rows"),
        (lambda: FunctionTask(np.log, name="?"), "the task name is"),
        (lambda: FunctionTask(np.log, n_warmup=0.5), "n_warmup is 0.5"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero:RuntimeWarning")
def test_wrong_use(call, words):
    with pytest.raises(TaskError, match=words):
        call()
