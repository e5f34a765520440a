import numpy as np
import pytest

from openprc.analysis.benchmarks.task_benchmark import TaskBenchmark
from openprc.analysis.tasks.equalization import ChannelEqualizationTask
from openprc.analysis.tasks.limit_cycles import VanDerPolTask
from openprc.analysis.tasks.narma import NarmaTask
from openprc.analysis.tasks.own_target import ArrayTask
from openprc.analysis.tasks.prediction import PredictionTask
from openprc.analysis.tasks.recall import DelayRecallTask, ParityTask
from openprc.errors import TaskError
from openprc.reservoir.training.split import Split
from openprc.schema import results


def test_figures_of_body_and_baselines(loaded):
    trainer, u = loaded()
    score = TaskBenchmark(NarmaTask(2)).run(trainer, 0.25 * (1 + u))
    m = score.metrics
    assert m["skill"] == pytest.approx(1 - m["narma2_nrmse"] / m["baseline_nrmse"])
    assert m["skill_over_esn"] == pytest.approx(1 - m["narma2_nrmse"] / m["esn_nrmse"])
    # The body is such a network of 20 nodes itself.
    assert abs(m["skill_over_esn"]) < 0.5
    assert m["skill"] > 0.2
    assert score.metadata["esn_nodes"] == score.metadata["n_taps"] == 20
    assert score.group_name == "narma2"


def test_networks_may_be_left_out(loaded):
    trainer, u = loaded()
    score = TaskBenchmark(NarmaTask(2)).run(trainer, 0.25 * (1 + u), n_networks=0)
    assert not [name for name in score.metrics if "esn" in name]
    assert "esn" not in score.metadata


def test_a_task_of_memory_alone_has_no_skill(loaded):
    """The shift register recalls it perfectly, so nothing can be gained over it."""
    trainer, u = loaded()
    score = TaskBenchmark(DelayRecallTask([1, 2, 3])).run(trainer, u)
    assert score.metrics["baseline_corr2"] == pytest.approx(1.0, abs=1e-9)
    assert "skill" not in score.metrics
    assert any("takes memory only" in w for w in score.metadata["warnings"])
    assert score.metrics["per_output"].shape == (3,)
    assert score.metrics["delay1-3_corr2"] == pytest.approx(score.metrics["per_output"].mean())


def test_xor_is_beyond_the_shift_register(loaded, symbols):
    trainer, _ = loaded(drive=np.where(symbols > 0, 1.0, -1.0))
    score = TaskBenchmark(ParityTask(2)).run(trainer, np.where(symbols > 0, 1.0, -1.0))
    assert score.metrics["baseline_corr2"] < 0.1
    assert score.metrics["xor_corr2"] > 0.8
    assert score.metrics["skill"] > 0.7


def test_an_own_input_is_checked_and_scored(loaded):
    task = ChannelEqualizationTask(snr=28.0)
    data = task.generate(600, rng=5)
    trainer, u = loaded(drive=data.input[:, 0] / 4)
    score = TaskBenchmark(task).run(trainer, u, data=data)
    assert 0 <= score.metrics[f"{task.name}_ser"] < 0.2
    with pytest.raises(TaskError, match="is not the input of this task"):
        TaskBenchmark(task).run(trainer, u, data=task.generate(600, rng=6))
    with pytest.raises(TaskError, match="brings an input of its own"):
        TaskBenchmark(task).run(trainer, u)


def test_a_movement_needs_a_closed_loop(loaded):
    trainer, u = loaded()
    with pytest.raises(TaskError, match="close the loop"):
        TaskBenchmark(VanDerPolTask()).run(trainer, u)


def test_rows_without_a_target_are_left_out_and_told(loaded):
    """A series has no future behind its last value."""
    trainer, u = loaded(split=Split())
    score = TaskBenchmark(PredictionTask(np.arange(9.0), steps=(1, 5))).run(trainer, u)
    assert score.metadata["n_test"] == 180 - 5
    assert (
        "5 rows of training or test have no target and were left out"
        in (score.metadata["warnings"])
    )


def test_own_array_with_several_outputs_is_stored(loaded, symbols, tmp_path):
    trainer, u = loaded()
    trainer.experiment_dir = tmp_path
    y = np.stack([np.roll(symbols, 1), symbols**2], axis=1)
    score = TaskBenchmark(ArrayTask(y, name="mine")).run(trainer, u)
    stored = results.read_result(score.save())
    assert stored.array("mine/per_output").shape == (2,)
    assert results.read_result(score.readout_path).attrs["task_name"] == "mine"
    assert stored.attrs["mine/metric"] == "nrmse"


def test_several_inputs(loaded, symbols):
    trainer, _ = loaded()
    other = np.random.default_rng(0).uniform(-1, 1, len(symbols))
    score = TaskBenchmark(DelayRecallTask(1)).run(trainer, np.stack([symbols, other], axis=1))
    first, second = score.metrics["per_output"]
    assert first > 0.9
    assert second < 0.2
    assert score.metadata["n_taps"] == 10


def test_only_tasks_are_taken():
    with pytest.raises(TaskError, match="the task is a function"):
        TaskBenchmark(lambda u: u)
