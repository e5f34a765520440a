"""Prediction of a series some steps ahead."""

import numpy as np
import pytest

from openprc.analysis.tasks import Henon, Lorenz, PredictionTask, henon_task, mackey_glass_task
from openprc.errors import TaskError

SERIES = np.arange(10.0) ** 2


def test_steps_ahead_by_hand():
    data = PredictionTask(SERIES, steps=(1, 3)).generate(7)
    assert data.input[:, 0].tolist() == [0, 1, 4, 9, 16, 25, 36]
    assert data.target.values.T.tolist() == [[1, 4, 9, 16, 25, 36, 49], [9, 16, 25, 36, 49, 64, 81]]
    assert data.target.names == ("x(k+1)", "x(k+3)")
    assert data.target.usable.all()


def test_stored_symbols_give_the_same_target():
    task = PredictionTask(np.stack([SERIES, -SERIES], axis=1), steps=(2, 1))
    data = task.generate(8)
    stored = task.target(data.input)
    assert stored.n_tail == 2
    assert stored.names == data.target.names == ("x0(k+2)", "x1(k+2)", "x0(k+1)", "x1(k+1)")
    np.testing.assert_array_equal(stored.values[:6], data.target.values[:6])
    assert np.isnan(stored.values[6:]).all()


def test_every_step_of_henon_obeys_the_map():
    data = henon_task(steps=(1, 2)).generate(500, rng=3)
    x, y = data.input[:, 0], data.target.values
    np.testing.assert_allclose(y[1:, 0], 1 - 1.4 * x[1:] ** 2 + 0.3 * x[:-1], atol=1e-14)
    np.testing.assert_allclose(y[:, 1], 1 - 1.4 * y[:, 0] ** 2 + 0.3 * x, atol=1e-14)
    np.testing.assert_array_equal(henon_task().generate(9, rng=data.seed).input[:9], data.input[:9])


def test_normalisation():
    data = PredictionTask(SERIES, normalization="zscore").generate(9)
    assert data.metadata["offset"] == [pytest.approx(SERIES.mean())]
    assert data.metadata["scale"] == [pytest.approx(SERIES.std())]
    back = data.input[:, 0] * data.metadata["scale"] + data.metadata["offset"]
    np.testing.assert_allclose(back, SERIES[:9])
    ranged = PredictionTask(SERIES, normalization="range").generate(9)
    assert ranged.input.min() == 0.0
    assert ranged.target.values.max() == 1.0


def test_names_and_sources():
    assert mackey_glass_task().name == "mackey-glass17-ahead84"
    assert "doi:10.1126" in mackey_glass_task(30.0).source
    assert "x' = 10 (y - x)" in PredictionTask(Lorenz()).formula
    own = PredictionTask(SERIES, steps=range(1, 6), label="laser", origin="my laboratory")
    assert (own.name, own.source) == ("laser-ahead1to5", "my laboratory")
    assert PredictionTask(SERIES).name == "series-ahead1"
    assert own.kind == "own-input"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: PredictionTask(SERIES, steps=0), "steps is 0"),
        (lambda: PredictionTask(SERIES, steps=[]), "the steps are \\[\\]"),
        (lambda: PredictionTask(SERIES, steps=[2, 2]), "each once"),
        (lambda: PredictionTask(SERIES, normalization="unit"), "the normalization is 'unit'"),
        (lambda: PredictionTask([1.0, np.nan]), "1 of 2 input symbols"),
        (lambda: PredictionTask(SERIES).generate(10), "series has 10 values\n.*at least 11"),
        (lambda: PredictionTask(np.ones(9), normalization="zscore").generate(5), "does not vary"),
        (lambda: PredictionTask(SERIES, steps=10).target(SERIES), "10 symbols and the task leaves"),
        (lambda: PredictionTask(Henon()).generate(-1), "n is -1"),
    ],
)
def test_wrong_use(call, words):
    with pytest.raises(TaskError, match=words):
        call()
