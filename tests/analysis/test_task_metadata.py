"""Every task tells what it is."""

import json
import subprocess
import sys

import numpy as np
import pytest

import openprc.analysis.tasks as tasks
from openprc.analysis.tasks import (
    ArrayTask,
    ChannelEqualizationTask,
    DelayRecallTask,
    FunctionTask,
    GenerationTask,
    ImitationTask,
    InverseArmTask,
    LissajousTask,
    NarmaTask,
    ParityTask,
    PredictionTask,
    QuadraticLimitCycleTask,
    SineSquareTask,
    VanDerPolTask,
    VolterraTask,
    henon_task,
    lorenz_task,
    mackey_glass_task,
)
from openprc.analysis.tasks.own_target import check_names

ALL = [
    NarmaTask(), DelayRecallTask(), ParityTask(), VolterraTask(), ChannelEqualizationTask(),
    mackey_glass_task(), lorenz_task(), henon_task(), SineSquareTask(), InverseArmTask(),
    VanDerPolTask(), QuadraticLimitCycleTask(), LissajousTask(), ArrayTask([1.0, 2.0]),
    FunctionTask(np.square), PredictionTask([1.0, 2.0]),
]  # fmt: skip
OWN = (ArrayTask, FunctionTask)


@pytest.mark.parametrize("task", ALL, ids=lambda task: task.name)
def test_metadata(task):
    told = task.metadata()
    json.dumps(told)
    check_names(told["task"], told["metric"])
    assert told["kind"] in ("imitation", "own-input", "generation")
    assert len(told["formula"]) > 5
    assert told["source"]
    assert "symbol k" in told["alignment"]
    assert (told["n_warmup"], told["n_tail"]) == (task.n_warmup, task.n_tail)


@pytest.mark.parametrize("task", ALL[:13], ids=lambda task: task.name)
def test_sources_can_be_looked_up(task):
    # Jaeger's memory capacity stands in a report, which has a number and no DOI.
    assert "doi:10." in task.source or "GMD Report 152" in task.source


@pytest.mark.parametrize("task", ALL, ids=lambda task: task.name)
def test_tasks_cannot_be_changed(task):
    name = next(iter(task.parameters))
    with pytest.raises(AttributeError):
        setattr(task, name, 5)


@pytest.mark.parametrize("task", ALL[:13], ids=lambda task: task.name)
def test_defaults_give_finite_data_of_their_own_shape(task):
    if isinstance(task, GenerationTask):
        data = task.teacher(30, 0.05)
    elif hasattr(task, "generate"):
        data = task.generate(30, rng=2)
    else:
        u = np.random.default_rng(0).choice([-1.0, 1.0], 230)
        series = task.target(u)
        assert len(series) == 230
        assert np.isfinite(series.values[series.usable]).all()
        return
    assert np.isfinite(data.input).all()
    assert len(data.input) == len(data.target) == 30
    assert data.target_for(2.0 * data.input + 1.0) is data.target
    assert data.metadata["task"] == task.name


@pytest.mark.parametrize(
    "task", [NarmaTask(2), NarmaTask(10), DelayRecallTask([0, 3]), ParityTask(3, 1),
             VolterraTask(dt=0.05)], ids=lambda task: task.name,
)  # fmt: skip
@pytest.mark.parametrize("k", [20, 33])
def test_row_k_has_seen_symbol_k_and_none_after(task, k):
    assert isinstance(task, ImitationTask)
    u = np.random.default_rng(1).choice([0.1, 0.4], 40)
    other = u.copy()
    other[k] = 0.5 - u[k]
    before, after = task.target(u).values, task.target(other).values
    np.testing.assert_array_equal(before[:k], after[:k])
    assert not np.array_equal(before[k:], after[k:], equal_nan=True)


def test_names_are_found_lazily_and_the_package_is_light():
    for name in tasks.__all__:
        assert getattr(tasks, name) is not None
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = tasks.nothing
    code = (
        "import sys, openprc.analysis.tasks as t; [getattr(t, n) for n in t.__all__];"
        "print([m for m in ('scipy', 'sklearn', 'numba', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
