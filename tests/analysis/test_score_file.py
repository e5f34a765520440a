import json
from pathlib import Path

import pytest

from openprc.analysis.benchmarks.choices import Choices, default_features
from openprc.analysis.benchmarks.report import score_file
from openprc.analysis.tasks.narma import NarmaTask
from openprc.errors import MissingData, MissingInputError, TaskError
from openprc.reservoir.features.channel_features import Channels
from openprc.reservoir.features.node_features import NodeDisplacements
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.training.split import Split
from openprc.schema import Provenance, TrajectoryWriter, results
from openprc.schema.legacy import LegacyImporter

DATA = Path(__file__).resolve().parents[2] / "../shared/data/upstream"


def test_report_of_a_body_with_memory(make_run):
    report = score_file(make_run())
    assert report.clock == "symbols"
    assert (report.input_name, report.input_column) == ("base", "z")
    # 600 symbols: 10 % washout, 60 % training, 30 % test. Node 0 and x and y do not move.
    assert (report.n_states, report.n_train, report.n_test) == (20, 360, 180)
    assert report.nrmse < 0.3
    assert report.nmse == pytest.approx(report.nrmse**2)
    assert report.skill == pytest.approx(1 - report.nrmse / report.baseline)
    assert report.skill > 0.2
    assert report.warnings == ()
    assert (report.readout_path, report.metrics_path) == (None, None)
    assert report.producer == "test"
    assert "node_ids=[1, 2" in report.features
    assert "dims=[2]" in report.features


def test_report_is_json(make_run, tmp_path):
    report = score_file(make_run(), task=NarmaTask(5), experiment_dir=tmp_path / "experiment")
    values = json.loads(json.dumps(report.as_dict()))
    assert values["task"] == "narma5"
    assert values["nrmse"] == report.nrmse
    assert values["metrics_path"].endswith("metrics.h5")
    stored = results.read_result(report.metrics_path)
    assert float(stored.array("narma5/narma5_nrmse")) == report.nrmse
    assert results.read_result(report.readout_path).attrs["NRMSE"] == report.nrmse


def test_nothing_is_written_without_a_folder(make_run):
    path = make_run()
    score_file(path)
    assert [item.name for item in path.parent.iterdir()] == [path.name]


def test_channels_where_nothing_moves(make_run):
    report = score_file(make_run(moving=False, channels=True))
    assert report.features == "Channels(channel_names=None)"
    assert report.n_states == 20
    assert score_file(make_run(nodes=False, channels=True)).nrmse == report.nrmse


def test_default_features(make_run):
    with StateLoader(make_run(channels=True)) as loader:
        chosen = default_features(loader)
        assert isinstance(chosen, NodeDisplacements)
        assert chosen.node_ids == list(range(1, 21))
        assert chosen.dims == [2]


def test_other_choices(make_run):
    path = make_run(channels=True)
    report = score_file(
        path,
        Choices(
            features=Channels(),
            input_column="z",
            split=Split(washout=1.0, test=4.0, input_name="base", samples_per_symbol=2),
        ),
    )
    assert (report.n_states, report.n_train, report.n_test) == (40, 475, 100)
    shorter = score_file(path, Choices(split=Split(washout=1.0, train=10.0, test=2.0)))
    assert (shorter.n_train, shorter.n_test) == (250, 50)
    assert "only 50 test rows: the error is uncertain" in shorter.warnings
    assert score_file(path, Choices(split=Split(train=10.0))).n_test == 600 - 60 - 250


def test_frames_without_symbols(make_run):
    report = score_file(make_run(sequence=False))
    assert report.clock == "frames"
    assert any(w.startswith("frame clock") for w in report.warnings)


@pytest.mark.parametrize(
    ("run", "keywords", "error", "words"),
    [
        ({"inputs": False}, {}, MissingInputError, "openprc attach-input"),
        ({"time_kind": "pseudo"}, {}, TaskError, "load steps"),
        ({"moving": False}, {}, MissingData, "no node moves and there are no channels"),
        ({"sequence": False, "constant_input": True}, {}, TaskError, "input 'base' does not vary"),
        ({}, {"input_column": "x"}, TaskError, "column 'x' of input 'base' does not vary"),
        ({}, {"input_column": "y"}, MissingInputError, "no column 'y'"),
        ({}, {"split": Split(input_name="top")}, MissingInputError, "there is no input 'top'"),
        (
            {"sequence": False},
            {"split": Split(clock="symbols")},
            MissingInputError,
            "no input stores the sym",
        ),
        ({"n_symbols": 3}, {}, TaskError, "train span|test span|target is constant|none of the"),
        (
            {},
            {"split": Split(washout=100.0)},
            TaskError,
            "train span is 0 rows|there are 24 s of states",
        ),
    ],
)
def test_files_that_cannot_be_scored(make_run, run, keywords, error, words):
    path = make_run(**run)
    with pytest.raises(error, match=words):
        score_file(path, Choices(**keywords))


@pytest.mark.skipif(not DATA.exists(), reason="recorded upstream runs are not at hand")
def test_recorded_lattice(tmp_path):
    """A 30 s run of the older package: 4x4 lattice, four driven corners, no symbols."""
    path = tmp_path / "lattice.h5"
    with TrajectoryWriter(path, provenance=Provenance("legacy"), on_failure="discard") as writer:
        source = DATA / "lattice_4x4_gen0" / "output" / "simulation.h5"
        LegacyImporter().import_run(source, writer, options={"unit": None})
    report = score_file(path)
    assert (report.clock, report.row_step) == ("frames", 0.01)
    assert (report.n_states, report.n_train, report.n_test) == (48, 1801, 900)
    assert report.nrmse == pytest.approx(0.1235, abs=2e-3)
    assert report.baseline == pytest.approx(0.4015, abs=2e-3)
    assert any("drive autocorrelation 0.929" in w for w in report.warnings)
    assert any("states follow the input: node0.x" in w for w in report.warnings)


@pytest.mark.skipif(not DATA.exists(), reason="recorded upstream runs are not at hand")
def test_recorded_laboratory_run_needs_no_memory(tmp_path):
    """The drive is so smooth that a cubic of the present input beats the body."""
    path = tmp_path / "laboratory.h5"
    with TrajectoryWriter(path, provenance=Provenance("legacy"), on_failure="discard") as writer:
        LegacyImporter().import_run(DATA / "lab" / "experiment.h5", writer, options={"unit": None})
    report = score_file(path)
    assert report.cubic == pytest.approx(0.185, abs=2e-3)
    assert report.cubic < report.nrmse < report.baseline
    assert any("the task needs no memory" in w for w in report.warnings)
    with pytest.raises(TaskError, match="NARMA10 diverged"):
        score_file(path, task=NarmaTask(10))
