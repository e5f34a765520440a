"""The memory benchmark on a file, and its pictures."""

import json

import numpy as np
import pytest
from scipy.stats import chi2
from sklearn.preprocessing import StandardScaler

from openprc.analysis.benchmarks.memory_benchmark import MemoryBenchmark
from openprc.analysis.capacity import information_processing_capacity, memory_capacity
from openprc.analysis.visualization.capacity_plots import CapacityPlots
from openprc.errors import TaskError
from openprc.reservoir.features.node_features import NodePositions
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.readout.ridge import Ridge
from openprc.reservoir.training.trainer import Trainer
from openprc.schema import results

SPANS = {"washout": 2.0, "train_duration": 14.0, "test_duration": 8.0}


@pytest.fixture
def run(make_run, tmp_path):
    """Return a trainer on a run, and its input per frame."""
    opened = []

    def make(*, clock="auto", spans=SPANS, **keywords):
        loader = StateLoader(make_run(**keywords))
        opened.append(loader)
        trainer = Trainer(
            NodePositions(dims=[2]),
            Ridge(1e-5),
            loader=loader,
            experiment_dir=tmp_path,
            clock=clock,
            **spans,
        )
        return trainer, loader.get_actuation_signal(actuator_idx=0, dof=2)

    yield make
    for loader in opened:
        loader.close()


def test_the_listing_of_the_paper(run):
    trainer, u_input = run()
    loader, features = trainer.loader, trainer.features
    X = StandardScaler().fit_transform(features.transform(loader))
    s = np.linalg.svd(X, compute_uv=False)
    N = float(np.exp(-np.sum((s / s.sum()) * np.log(s / s.sum() + 1e-12))))
    eps = float(2 * chi2.isf(1e-4, df=N) / int(10.0 / loader.dt))
    score = MemoryBenchmark(group_name="memory_benchmark").run(
                trainer, u_input,
                tau_s=30, n_s=2, k_delay=1, eps=eps, ridge=1e-6)  # fmt: skip
    score.save()
    stored = results.read_result(score.metrics_path)
    assert stored.attrs["memory_benchmark/estimator"] == "heldout"
    assert stored.attrs["memory_benchmark/threshold_rule"] == f"eps = {eps:.6g}, as given"
    m = score.metrics
    assert m["n_targets"] == 527
    assert np.all(m["threshold"] == eps)
    assert 1 < m["mc_linear"] < m["ipc_total"] < m["rank"] == 20
    assert m["ipc_total"] == pytest.approx(m["mc_linear"] + m["mc_nonlinear"])
    # What chance leaves over, by the other estimator on the same rows.
    assert m["mc_linear"] < m["insample_mc_linear"] < m["insample_ipc_total"] <= 20.5


def test_in_sample_by_default_on_training_and_test_rows(run, symbols):
    trainer, u = run()
    score = MemoryBenchmark("memory").run(trainer, u, delays={1: 40, 2: 10})
    m = score.metrics
    states = trainer.states.values
    by_hand = information_processing_capacity(
        states, symbols, delays={1: 40, 2: 10}, washout=trainer.split.washout
    )
    np.testing.assert_allclose(m["capacities"], by_hand.raw, atol=1e-12)
    assert m["ipc_total"] == by_hand.total
    assert m["mc_jaeger"] == by_hand.memory_capacity
    assert m["mc_linear"] - m["mc_jaeger"] == pytest.approx(by_hand.values[0])
    assert m["n_rows"] == trainer.split.train + trainer.split.test
    assert 1 < m["effective_rank"] < m["effective_rank_singular"] < m["rank"] == 20
    metadata = score.metadata
    assert metadata["clock"] == "symbols"
    assert "Beta(r/2, (T-1-r)/2), r = 20" in metadata["threshold_rule"]
    assert metadata["delays"] == ["degree 1: 40", "degree 2: 10"]
    assert "warnings" not in metadata


def test_everything_is_drawn_from_the_file_alone(run, tmp_path):
    trainer, u = run()
    score = MemoryBenchmark("memory").run(trainer, u, tau_s=12, n_s=3)
    path = score.save()
    stored = CapacityPlots.from_file(path, "memory")
    direct = CapacityPlots.of(score)
    np.testing.assert_array_equal(stored.counted, direct.counted)
    for plots in (stored, direct):
        for draw in (plots.memory_profile, plots.heat_map, plots.by_degree):
            picture = draw()
            assert picture.save(tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")
            assert "capacity" in "".join(
                axes.get_xlabel() + axes.get_ylabel() + axes.get_title(loc="left")
                for axes in picture.figure.axes
            )
    assert stored.heat_map().default_path == path.parent / "capacity_heat_map.png"
    labels = results.read_result(path).array("memory/labels")
    assert labels[0] == "P1(u(t))"
    assert len(labels) == score.metrics["n_targets"]
    with pytest.raises(TaskError, match="group 'narma' holds no capacities"):
        CapacityPlots.from_file(path, "narma")


def test_heights_and_cells_are_the_sums(run):
    trainer, u = run()
    score = MemoryBenchmark("memory").run(trainer, u, delays={1: 8, 2: 4})
    plots = CapacityPlots.of(score)
    image = plots.heat_map().figure.axes[0].images[0].get_array()
    m = score.metrics
    np.testing.assert_allclose(image.filled(0.0), m["profile"])
    # Of degree 2 nothing beyond delay 4 was asked for.
    assert image.mask.tolist() == [[False] * 9, [False] * 5 + [True] * 4]
    assert m["profile"].sum() == pytest.approx(m["ipc_total"])
    bars = plots.memory_profile().figure.axes[0].patches
    heights = [bar.get_height() for bar in bars]
    np.testing.assert_allclose(heights[:9], m["capacities"][:9])
    widths = [bar.get_width() for bar in plots.by_degree().figure.axes[0].patches]
    np.testing.assert_allclose(widths, [m["mc_linear"], m["mc_nonlinear"]])


def test_a_drive_read_at_frame_rate_is_told(run):
    trainer, u = run(clock="frames", interpolated=True)
    score = MemoryBenchmark("memory").run(trainer, u, tau_s=20, n_s=1)
    assert score.metadata["clock"] == "frames"
    (warning,) = score.metadata["warnings"]
    assert warning.startswith("autocorrelation 0.896 at lag 1")
    assert "one row per symbol" in warning
    assert score.metrics["ipc_total_raw"] <= score.metrics["rank"] + 1e-9
    with pytest.raises(TaskError, match="sums of capacities are inflated"):
        MemoryBenchmark("memory").run(trainer, u, tau_s=20, n_s=1, coloured="refuse")


def test_wrong_parameters(run):
    trainer, u = run()
    with pytest.raises(TaskError, match=r"has no parameter 'tau'\n.*tau_s, n_s, k_delay"):
        MemoryBenchmark().run(trainer, u, tau=3)
    with pytest.raises(TaskError, match="n_s is 0"):
        MemoryBenchmark().run(trainer, u, n_s=0)
    with pytest.raises(TaskError, match="estimator is 'both'"):
        MemoryBenchmark().run(trainer, u, estimator="both")


def test_load_steps_have_no_memory(run):
    spans = {"washout": 20, "train_duration": 1000, "test_duration": 500}
    trainer, u = run(time_kind="pseudo", spans=spans)
    with pytest.raises(TaskError, match="load steps of a quasi-static analysis"):
        MemoryBenchmark().run(trainer, u)


def test_the_record_is_plain_values():
    u = np.random.default_rng(1).uniform(-1, 1, 1000)
    states = np.stack([np.roll(u, 1), np.roll(u, 2) ** 2], axis=1)
    found = information_processing_capacity(states, u, delays={1: 3, 2: 3}, washout=3)
    plain = json.loads(json.dumps(found.to_dict()))
    assert plain["rank"] == 2
    assert plain["n_targets"] == len(plain["terms"]) == 4 + 10
    held = [term["label"] for term in plain["terms"] if term["significant"]]
    assert held == ["P1(u(t-1))", "P2(u(t-2))"]
    assert plain["terms"][1]["factors"] == [[1, 1, 0]]
    assert plain["by_degree"] == {"1": pytest.approx(1.0), "2": pytest.approx(1.0, abs=0.02)}
    profile = found.profile()
    assert profile.values.shape == (2, 4)
    assert profile.values[1].argmax() == 2
    only = information_processing_capacity(states, u, delays={2: 3}, washout=3)
    with pytest.raises(TaskError, match="there are no targets of degree 1"):
        CapacityPlots.of(only).memory_profile()


def test_blas_threads_change_nothing():
    u = np.random.default_rng(2).uniform(-1, 1, 1000)
    states = np.stack([np.roll(u, k) for k in range(4)], axis=1)
    one = memory_capacity(states, u, max_delay=8, blas_threads=1)
    other = memory_capacity(states, u, max_delay=8)
    np.testing.assert_allclose(one.raw, other.raw, atol=1e-12)
