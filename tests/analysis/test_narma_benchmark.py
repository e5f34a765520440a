import subprocess
import sys

import numpy as np
import pytest

from openprc.analysis.benchmarks.base import Benchmark, Evaluated
from openprc.analysis.benchmarks.baseline import evaluate_baseline, shift_register
from openprc.analysis.benchmarks.narma_benchmark import NARMABenchmark
from openprc.analysis.tasks.imitation import NARMA_task
from openprc.analysis.visualization.time_series import TimeSeriesComparison
from openprc.errors import TaskError
from openprc.reservoir.features.node_features import NodePositions
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.readout.ridge import Ridge
from openprc.reservoir.training.trainer import Trainer
from openprc.schema import results

SPANS = {"washout": 2.0, "train_duration": 14.0, "test_duration": 8.0}


@pytest.fixture
def run(make_run, tmp_path):
    """Return a trainer on a run, and its input per frame, scaled to [0, 0.5]."""
    opened = []

    def make(*, features=None, readout=None, spans=SPANS, clock="auto", **keywords):
        loader = StateLoader(make_run(**keywords))
        opened.append(loader)
        trainer = Trainer(
            features or NodePositions(dims=[2]),
            readout or Ridge(1e-5),
            loader=loader,
            experiment_dir=tmp_path,
            clock=clock,
            **spans,
        )
        raw = loader.get_actuation_signal(actuator_idx=0, dof=2)
        return trainer, 0.5 * (raw - raw.min()) / (raw.max() - raw.min())

    yield make
    for loader in opened:
        loader.close()


def scaled(symbols):
    return 0.5 * (symbols - symbols.min()) / (symbols.max() - symbols.min())


def test_the_listing_of_the_paper(make_run, tmp_path, monkeypatch):
    """The listing as printed, but for the path and spans that fit the file."""
    make_run()
    monkeypatch.chdir(tmp_path)
    loader = StateLoader("./output/simulation.h5")
    u_raw = loader.get_actuation_signal(actuator_idx=0, dof=2)
    u_input = 0.5 * (u_raw - u_raw.min()) / (u_raw.max() - u_raw.min())
    trainer = Trainer(loader=loader, features=NodePositions(dims=[2]),
                      readout=Ridge(1e-5), experiment_dir="./",
                      washout=2.0, train_duration=14.0, test_duration=8.0)  # fmt: skip
    score = NARMABenchmark(group_name="narma_benchmark").run(trainer, u_input, order=2)
    score.save()
    picture = TimeSeriesComparison().plot(score.readout_path, start_frame=0, end_frame=500).save()
    loader.close()
    assert (tmp_path / "readout" / "readout_narma2.h5").is_file()
    assert (tmp_path / "metrics" / "metrics.h5").is_file()
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_metrics_and_baselines(run):
    trainer, u = run()
    score = NARMABenchmark().run(trainer, u, order=2)
    metrics = score.metrics
    assert metrics["narma2_nrmse"] == pytest.approx(np.sqrt(metrics["narma2_nmse"]))
    assert metrics["skill"] == pytest.approx(
        1.0 - metrics["narma2_nrmse"] / metrics["baseline_nrmse"]
    )
    # A network of 20 tanh states beats the tapped delay line; the delay line beats the cubic
    # of the present input, which has no memory.
    assert metrics["skill"] > 0.2
    assert metrics["narma2_nrmse"] < 0.3
    assert 0.3 < metrics["baseline_nrmse"] < metrics["cubic_nrmse"] < 1.0


def test_baseline_has_the_size_rows_and_penalty_of_the_body(run, symbols):
    trainer, u = run()
    score = NARMABenchmark().run(trainer, u, order=5)
    inputs = scaled(symbols)
    target = NARMA_task(inputs, 5, horizon=1)
    by_hand = evaluate_baseline(trainer, shift_register(inputs, 20), target)
    assert score.metrics["baseline_nrmse"] == by_hand.mean_nrmse
    # Twenty nodes move; the one that stands still is no state.
    assert (score.metadata["n_states"], score.metadata["n_taps"]) == (21, 20)
    assert score.metadata["baseline_regularization"] == 1e-5
    trained = score.trained[0].evaluation
    np.testing.assert_array_equal(by_hand.test_rows, trained.test_rows)
    np.testing.assert_array_equal(by_hand.train_rows, trained.train_rows)


def test_a_shift_register_as_body_has_no_skill(run, symbols):
    """States that are the baseline's own taps score exactly what the baseline scores."""

    class Taps:
        def transform(self, loader):
            return np.repeat(shift_register(scaled(symbols), 10), 4, axis=0)

        def names(self, loader):
            return [f"tap{k}" for k in range(10)]

    trainer, u = run(features=Taps())
    score = NARMABenchmark().run(trainer, u, order=2)
    assert score.metrics["skill"] == pytest.approx(0, abs=1e-9)
    assert "1 of 10 states follow the input: tap0" in score.metadata["warnings"]


def test_a_task_that_the_present_input_solves_better_is_told(run):
    trainer, u = run(features=NodePositions([3], [2]))
    score = NARMABenchmark().run(trainer, u, order=2)
    (remark,) = score.metadata["warnings"]
    assert remark.startswith("a cubic of the present input alone does better: its NRMSE is 0.5")


def test_input_per_frame_and_per_symbol_agree(run, symbols):
    trainer, per_frame = run()
    one = NARMABenchmark().run(trainer, per_frame, order=2)
    other = NARMABenchmark().run(trainer, scaled(symbols), order=2)
    assert dict(one.metrics) == dict(other.metrics)
    assert one.metadata["clock"] == "symbols"
    assert "read at the last frame of each symbol" in one.metadata["input_note"]
    assert "input_note" not in other.metadata


def test_interpolated_drive_is_read_where_symbols_begin(run, symbols):
    trainer, per_frame = run(interpolated=True)
    score = NARMABenchmark().run(trainer, per_frame, order=2)
    assert "the signal moves within symbols" in score.metadata["input_note"]
    u, _ = trainer.align_input(per_frame)
    np.testing.assert_allclose(u, scaled(symbols), atol=1e-12)


def test_frame_clock_is_remarked(run):
    trainer, u = run(clock="frames")
    score = NARMABenchmark().run(trainer, u, order=2)
    assert score.metadata["clock"] == "frames"
    assert any(w.startswith("frame clock; drive autocorrelation 0.7")
               for w in score.metadata["warnings"])  # fmt: skip


def test_file_without_symbols_runs_on_frames(run):
    trainer, u = run(sequence=False)
    assert NARMABenchmark().run(trainer, u, order=2).metadata["clock"] == "frames"
    with pytest.raises(TaskError, match="values per symbol need clock"):
        NARMABenchmark().run(trainer, u[::4], order=2)


def test_metrics_file(run):
    trainer, u = run()
    first = NARMABenchmark("one").run(trainer, u, order=2)
    path = first.save()
    assert path == first.metrics_path
    NARMABenchmark("two").run(trainer, u, order=5).save()
    NARMABenchmark("one").run(trainer, u, order=3).save()
    stored = results.read_result(path)
    assert stored.kind == "metrics"
    groups = {name.split("/")[0] for name in stored.arrays}
    assert groups == {"one", "two"}
    # The group of the same name was replaced as a whole.
    assert "one/narma3_nrmse" in stored.arrays
    assert "one/narma2_nrmse" not in stored.arrays
    attrs = stored.attrs
    assert attrs["two/narma_order"] == 5
    assert "doi:10.1109/72.846741" in attrs["two/source"]
    assert attrs["two/formula"].startswith("y(t+1) = 0.3 y(t)")
    assert attrs["two/source_run_id"] == trainer.loader.run_id
    assert float(stored.array("two/skill")) == pytest.approx(
        1 - float(stored.array("two/narma5_nrmse")) / float(stored.array("two/baseline_nrmse"))
    )


def test_nothing_is_written_before_save(run, tmp_path):
    trainer, u = run()
    NARMABenchmark().run(trainer, u, order=2)
    assert [item.name for item in tmp_path.iterdir()] == ["output"]


@pytest.mark.parametrize(
    ("u", "order", "words"),
    [
        (np.linspace(0, 0.5, 17), 2, "the length is 17\n.*600 \\(rows"),
        (np.ones((600, 2)), 2, "the input has shape \\(600, 2\\)"),
        (np.linspace(0, 2, 600), 5, "runs from 0 to 2"),
        (np.full(600, 0.5), 10, "NARMA10 diverged"),
        (np.linspace(0, 0.5, 600), 31, "the order is 31"),
        (np.full(600, np.nan), 2, "600 of 600 input symbols are NaN"),
    ],
)
def test_wrong_input(run, u, order, words):
    trainer, _ = run()
    with pytest.raises(TaskError, match=words):
        NARMABenchmark().run(trainer, u, order=order)


def test_load_steps_are_refused(run):
    spans = {"washout": 20, "train_duration": 1000, "test_duration": 500}
    trainer, u = run(time_kind="pseudo", spans=spans)
    with pytest.raises(TaskError, match="load steps of a quasi-static analysis"):
        NARMABenchmark().run(trainer, u, order=2)


@pytest.mark.parametrize("name", ["", "a/b", ".."])
def test_group_names(name):
    with pytest.raises(TaskError, match="the group name is"):
        NARMABenchmark(name)


def test_score_without_a_readout_or_folder(run):
    class Count(Benchmark):
        def _evaluate(self, trainer, u, **parameters):
            return Evaluated({"n": len(u)}, {})

    trainer, u = run()
    score = Count("count").run(trainer, u)
    assert score.metrics["n"] == 600
    with pytest.raises(TaskError, match="trained no readout"):
        _ = score.readout_path
    trainer.experiment_dir = None
    with pytest.raises(TaskError, match="no experiment_dir"):
        score.save()


def test_importing_the_package_is_light():
    code = (
        "import sys, openprc.analysis; "
        "print([m for m in ('sklearn', 'scipy', 'h5py', 'matplotlib') if m in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
