import numpy as np
import pytest

from openprc.analysis.benchmarks.custom_benchmark import CustomBenchmark
from openprc.errors import TaskError
from openprc.reservoir.readout.ridge import Ridge
from openprc.reservoir.training.split import Split
from openprc.reservoir.training.trainer import Trainer
from openprc.schema import results


def test_logic_gets_the_input_on_the_rows_and_its_parameters(loaded, tmp_path):
    trainer, u = loaded()
    trainer.experiment_dir = tmp_path
    seen = {}

    def logic(benchmark, given_trainer, u_input, **kwargs):
        seen.update(benchmark=benchmark, trainer=given_trainer, n=len(u_input), **kwargs)
        return {"mean": u_input.mean(), "both": np.array([1.0, 2.0])}, {"note": "own"}

    benchmark = CustomBenchmark(group_name="mine", benchmark_logic=logic)
    score = benchmark.run(trainer, u, order=4)
    assert (seen["benchmark"], seen["trainer"], seen["order"]) == (benchmark, trainer, 4)
    # The input was given per frame, and a row is a symbol.
    assert (len(u), seen["n"]) == (2400, 600)
    stored = results.read_result(score.save())
    assert float(stored.array("mine/mean")) == score.metrics["mean"]
    assert stored.array("mine/both").tolist() == [1.0, 2.0]
    assert (stored.attrs["mine/note"], stored.attrs["mine/order"]) == ("own", 4)
    assert stored.attrs["mine/clock"] == "symbols"


@pytest.mark.parametrize(
    ("returned", "words"),
    [
        (3.0, "the function returned a float"),
        (({"a": 1.0},), "the function returned a tuple"),
        (([1.0], {}), "the function returned a tuple"),
        (({"a": np.nan}, {}), "metric 'a' is nan"),
        (({"a": "high"}, {}), "metric 'a' is 'high'"),
    ],
)
def test_what_logic_may_not_return(loaded, returned, words):
    trainer, u = loaded()
    benchmark = CustomBenchmark("mine", lambda *_, **__: returned)
    with pytest.raises(TaskError, match=words):
        benchmark.run(trainer, u)


def test_logic_has_to_be_a_function():
    with pytest.raises(TaskError, match="benchmark_logic is a dict"):
        CustomBenchmark("mine", {})


def test_load_steps_may_be_allowed(loaded):
    def logic(benchmark, trainer, u_input, **kwargs):
        return {"n": len(u_input)}, {}

    trainer, u = loaded(time_kind="pseudo")
    with pytest.raises(TaskError, match="load steps"):
        CustomBenchmark("mine", logic).run(trainer, u)
    score = CustomBenchmark("mine", logic, needs_dynamics=False).run(trainer, u)
    assert score.metrics["n"] == 600


def test_an_input_has_to_be_given(loaded):
    trainer, _ = loaded()
    with pytest.raises(TaskError, match="mine: no input was given"):
        CustomBenchmark("mine", lambda *_: ({}, {})).run(trainer)
    assert isinstance(trainer, Trainer)
    assert isinstance(trainer.readout, Ridge)
    assert trainer.spans == Split(washout=2.0, train=14.0, test=8.0)
