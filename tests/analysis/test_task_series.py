"""Targets know the rows that they are defined on, and data know their input."""

import numpy as np
import pytest

from openprc.analysis.tasks import DelayRecallTask, TargetSeries, TaskData
from openprc.errors import TaskError
from openprc.reservoir import NodeDisplacements, Ridge, StateLoader, Trainer


def test_undefined_rows_are_nan_and_not_usable():
    series = TargetSeries(np.arange(5.0), n_warmup=1, n_tail=2)
    assert series.usable.tolist() == [False, True, True, False, False]
    np.testing.assert_array_equal(series.values[:, 0], [np.nan, 1, 2, np.nan, np.nan])
    assert series.names == ("y",)
    assert len(series) == 5


def test_the_given_array_is_not_changed():
    given = np.arange(5.0)[:, None]
    TargetSeries(given, n_warmup=2)
    assert given[0, 0] == 0.0


def test_rows_for_a_trainer():
    series = TargetSeries(np.arange(5.0), n_warmup=1, n_tail=1)
    assert series.for_rows([1, 3])[:, 0].tolist() == [1, 1, 2, 3, 3]
    assert series.for_rows(series.usable)[:, 0].tolist() == [1, 1, 2, 3, 3]
    with pytest.raises(TaskError, match=r"2 rows of training or test have no target\n.*1 to 3"):
        series.for_rows([0, 1, 4])


@pytest.mark.parametrize(
    ("values", "more", "words"),
    [
        (np.zeros((2, 2, 2)), {}, "shape \\(2, 2, 2\\)"),
        (np.zeros((4, 0)), {}, "shape \\(4, 0\\)"),
        (np.zeros(3), {"n_warmup": 2, "n_tail": 1}, "3 symbols and the task leaves 3 of them"),
        ([0.0, np.nan, 1.0, np.inf], {"n_warmup": 1}, "2 of 4 target rows are NaN"),
        (np.zeros((4, 2)), {"names": ("a",)}, "for 2 outputs"),
        (np.zeros((4, 2)), {"names": ("a", "a")}, "each once"),
    ],
)
def test_wrong_targets(values, more, words):
    with pytest.raises(TaskError, match=words):
        TargetSeries(values, **more)


@pytest.fixture
def data():
    u = np.random.default_rng(0).uniform(size=(50, 2))
    return TaskData(u, TargetSeries(u[:, 0] ** 2))


def test_stored_symbols_may_be_scaled_and_shifted(data):
    stored = data.input * [0.01, -3.0] + [5.0, 1.0]
    assert data.target_for(stored) is data.target
    assert data.target_for(stored.astype(np.float32)) is data.target


def test_other_symbols_are_refused(data):
    with pytest.raises(TaskError, match="stored input has shape \\(49, 2\\)"):
        data.target_for(data.input[1:])
    moved = data.input.copy()
    moved[7, 1] += 1e-3
    with pytest.raises(TaskError, match="column 1 of the stored input is not the input"):
        data.target_for(moved)
    still = data.input.copy()
    still[:, 0] = 1.0
    with pytest.raises(TaskError, match="column 0"):
        data.target_for(still)


def test_input_and_target_are_equally_long():
    with pytest.raises(TaskError, match="input has shape \\(3, 1\\) and the target \\(4, 1\\)"):
        TaskData(np.zeros(3), TargetSeries(np.zeros(4)))


def test_a_trainer_takes_the_rows_that_are_defined(make_run, symbols):
    loader = StateLoader(make_run())
    trainer = Trainer(
        NodeDisplacements(dims=[2]), Ridge(1e-8), loader=loader,
        washout=2.0, train_duration=15.0, test_duration=5.0,
    )  # fmt: skip
    series = DelayRecallTask(1).target(symbols)
    used = np.concatenate(trainer.split.masks(trainer.states.usable))
    result = trainer.train(series.for_rows(used), "delay1")
    assert result.nrmse < 0.3
