import json
import math

import numpy as np
import pytest

from openprc.analysis.benchmarks.choices import Choices, choose_input, open_trainer
from openprc.analysis.benchmarks.diagnosis import DimensionBenchmark, InputCorrelation
from openprc.analysis.benchmarks.pictures import save_pictures
from openprc.analysis.benchmarks.standard_suite import Item, StandardSuite, volterra_task
from openprc.errors import TaskError
from openprc.reservoir.training.split import Split
from openprc.schema import results

GROUPS = ["dimension", "input_correlation", "memory", "kernel_quality", "narma2", "narma5",
          "narma10", "narma20", "volterra2"]  # fmt: skip


@pytest.fixture(scope="module")
def suite(tmp_path_factory, echo_run):
    """Return everything that is found on a network of 20 nodes, with the folder it is kept in."""
    folder = tmp_path_factory.mktemp("suite")
    told = []
    with open_trainer(echo_run, Choices(), experiment_dir=folder) as trainer:
        u = choose_input(trainer, None).values
        found = StandardSuite(n_networks=1, prcpy=True).run(
            trainer, u, progress=lambda share, what: told.append((share, what))
        )
        yield found, folder, told


def test_everything_is_measured(suite):
    found, _, told = suite
    assert list(found.scores) == [*GROUPS, "prcpy"]
    assert found.skipped == {}
    assert [what for _, what in told] == [*GROUPS, "prcpy"]
    assert [share for share, _ in told] == pytest.approx([k / 10 for k in range(10)])


def test_the_numbers_hang_together(suite):
    found, _, _ = suite
    memory, dimension = found.scores["memory"].metrics, found.scores["dimension"].metrics
    assert dimension["n_states"] == dimension["n_changing"] == 20
    assert memory["rank"] == dimension["numerical_rank"] == 20
    assert 5 < memory["ipc_total"] <= 20
    assert memory["mc_jaeger"] < memory["mc_linear"]
    assert 1 < dimension["effective_rank"] < dimension["effective_rank_singular"] < 20
    assert 1 < dimension["condition_number"] < math.inf
    kernel = found.scores["kernel_quality"].metrics
    assert 1 <= kernel["echo_decay"] <= kernel["echo_last_delay"] + 1 < 20
    assert 10 < kernel["kernel_rank"] <= 20
    correlation = found.scores["input_correlation"].metrics
    assert 0.9 < correlation["multiple_r"] <= 1
    assert correlation["n_correlated"] >= 10
    for name, metric, score in found.tasks():
        assert score.metrics[f"{name}_{metric}"] < 1.3, name
        assert {"skill", "esn_nrmse", "raw_input_nrmse"} <= set(score.metrics), name


def test_one_file_holds_it(suite):
    found, folder, _ = suite
    path = found.save()
    stored = results.read_result(path)
    assert {name.split("/")[0] for name in stored.arrays} == {*GROUPS, "prcpy"}
    assert path == folder / "metrics" / "metrics.h5"
    kept = float(stored.array("memory/ipc_total"))
    assert kept == found.scores["memory"].metrics["ipc_total"]
    again = json.loads(json.dumps(found.as_dict()))
    assert again["groups"]["memory"]["metrics"]["ipc_total"] == kept


def test_pictures(suite, tmp_path):
    found, _, _ = suite
    paths = save_pictures(found, tmp_path / "pictures")
    assert {path.stem for path in paths} == {
        "prediction_narma2", "prediction_narma5", "prediction_narma10", "prediction_narma20",
        "prediction_volterra2", "memory_profile", "capacity_by_delay_and_degree",
        "capacity_by_degree", "spectrum", "redundancy", "correlation_of_states",
        "correlation_with_input", "lags_behind_input",
    }  # fmt: skip
    for path in paths:
        assert path.read_bytes().startswith(b"\x89PNG"), path.name


def test_warnings_are_told_once(suite):
    found, _, _ = suite
    for text, groups in found.warnings().items():
        assert len(set(groups)) == len(groups), text


def test_without_an_input_the_states_are_still_measured(make_run):
    with open_trainer(make_run(inputs=False), Choices()) as trainer:
        found = StandardSuite().run(trainer)
    assert list(found.scores) == ["dimension"]
    assert set(found.skipped) == set(GROUPS[1:])
    assert set(found.skipped.values()) == {"the file does not say what drove the body"}


def test_load_steps_have_a_dimension_and_no_memory(make_run):
    with open_trainer(make_run(time_kind="pseudo"), Choices()) as trainer:
        u = choose_input(trainer, None).values
        found = StandardSuite(n_networks=0).run(trainer, u)
    assert list(found.scores) == ["dimension"]
    assert all("load steps" in reason for reason in found.skipped.values())


def test_binary_input_adds_xor(make_run, symbols):
    path = make_run(drive=np.sign(symbols))
    with open_trainer(path, Choices()) as trainer:
        found = StandardSuite(n_networks=0).run(trainer, choose_input(trainer, None).values)
    assert found.scores["xor"].metrics["xor_corr2"] > 0.8
    # A polynomial of degree 2 of a binary symbol is no other function than that of degree 1.
    assert found.scores["memory"].metrics["ipc_total"] <= 20


def test_a_suite_of_one(loaded):
    trainer, _ = loaded()
    found = StandardSuite([Item(DimensionBenchmark("mine"))]).run(trainer)
    assert list(found.scores) == ["mine"]
    with pytest.raises(TaskError, match="no experiment_dir"):
        found.save()


def test_dimension_tells_of_constant_and_dependent_states(loaded):
    trainer, _ = loaded()
    metadata = DimensionBenchmark().run(trainer).metadata
    assert metadata["warnings"] == ["1 states never change and were left out: node0.z"]


def test_correlation_finds_the_lag(make_run, symbols):
    from openprc.reservoir.features.node_features import NodePositions

    path = make_run()
    with open_trainer(path, Choices(features=NodePositions(dims=[2]))) as trainer:
        found = InputCorrelation(n_surrogates=19).run(trainer, symbols)
    assert np.isnan(found.metrics["pearson"][0])
    assert (found.metrics["peak_lag"][1:] >= 0).all()


def test_volterra_window_spans_rows():
    assert volterra_task(0.01).mean == 0.1
    assert volterra_task(0.2).mean == pytest.approx(0.4)
    assert volterra_task(0.2).n_warmup == 4


def test_a_split_that_is_too_long_is_refused(make_run):
    choices = Choices(split=Split(washout=100.0))
    with (
        open_trainer(make_run(), choices) as trainer,
        pytest.raises(TaskError, match="24 s of states"),
    ):
        StandardSuite().run(trainer)


def test_long_recordings_are_thinned_for_the_costly_part(loaded, symbols, monkeypatch):
    trainer, _ = loaded()
    whole = InputCorrelation(n_surrogates=19).run(trainer, symbols)
    assert whole.metadata["n_rows_dcor"] == whole.metadata["n_rows"] == 550
    monkeypatch.setattr("openprc.analysis.benchmarks.diagnosis.MOST_ROWS", 200)
    thin = InputCorrelation(n_surrogates=19).run(trainer, symbols)
    assert thin.metadata["n_rows_dcor"] == 184
    np.testing.assert_array_equal(thin.metrics["pearson"], whole.metrics["pearson"])
    apart = np.abs(thin.metrics["dcor"] - whole.metrics["dcor"])[1:]
    assert 0 < apart.max() < 0.15
