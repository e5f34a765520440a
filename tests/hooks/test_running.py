"""Running an experiment with any producer."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest

from openprc.errors import (
    ConfigError,
    MissingDependency,
    PluginError,
    ResultExists,
    SchemaError,
    UnknownName,
    UnreadableFile,
    UnsupportedScene,
)
from openprc.hooks import Registry, run_experiment
from openprc.schema import Finding, Trajectory
from openprc.schema.atomic import partial_path


class Still:
    """Simulates that nothing moves."""

    def supports(self, experiment):
        return []

    def run(self, experiment, writer, *, seed, progress):
        writer.declare_nodes(experiment.geometry.n_nodes, 3, unit="m")
        for i, time in enumerate(experiment.frame_times):
            writer.append(time, positions=experiment.geometry.positions + 1e-3 * i)
            progress((i + 1) / experiment.n_frames, f"frame {i}")


def supporting(findings):
    class Picky(Still):
        def supports(self, experiment):
            if isinstance(findings, BaseException):
                raise findings
            return findings

    return Picky


def stopping(error, *, after):
    class Stopping(Still):
        def run(self, experiment, writer, *, seed, progress):
            writer.declare_nodes(experiment.geometry.n_nodes, 3, unit="m")
            for time in experiment.frame_times[:after]:
                writer.append(time, positions=experiment.geometry.positions)
            raise error

    return Stopping


@pytest.fixture
def simulate(make_entry, make_code, producer, experiment_folder):
    """Return a function that runs the experiment with a runner class."""

    def call(runner=Still, *, folder=experiment_folder, fields=None, **words):
        fields = {"capabilities": ("run",), **(fields or {})}
        spec = producer("still", make_code("Runner", runner), **fields)
        registry = Registry([make_entry(openprc_producers=[spec])])
        return run_experiment(folder, producer="still", registry=registry, **words)

    return call


@pytest.fixture
def result(experiment_folder):
    return experiment_folder / "output" / "simulation.h5"


def test_a_run_is_valid_described_and_traceable(simulate, result, experiment_folder):
    reports = []
    run = simulate(seed=7, progress=lambda fraction, message: reports.append(fraction))
    assert (run.path, run.producer, run.confidence) == (result, "still", 1.0)
    assert (run.n_frames, run.n_nodes, run.dims) == (11, 2, 3)
    np.testing.assert_allclose(reports, np.arange(1, 12) / 11)
    with Trajectory(result) as trajectory:
        told = trajectory.provenance
        np.testing.assert_array_equal(trajectory.time, np.arange(11) * 0.01)
    assert (told["producer"], told["plugin"], told["seed"]) == ("still", "openprc-fake", 7)
    assert told["config"]["simulation"]["duration"] == 0.1
    sources = [(row["role"], row["name"]) for row in told["inputs"]]
    assert sources == [(n.split(".")[0], n) for n in ("geometry.h5", "signals.h5", "config.json")]
    # Whether a stranger's producer repeats itself is not known here.
    assert "deterministic" not in told


def test_the_input_folder_itself_may_be_named(simulate, result, experiment_folder):
    assert simulate(folder=experiment_folder / "input").path == result


def test_another_place_for_the_result(simulate, result, tmp_path):
    assert simulate(out=tmp_path / "else.h5").path == tmp_path / "else.h5"
    assert not result.parent.exists()


@pytest.mark.parametrize("as_config", [False, True])
def test_an_existing_result_is_kept_unless_asked(simulate, result, experiment_folder, as_config):
    simulate()
    before = result.read_bytes()
    with pytest.raises(ResultExists, match="finished file of this name"):
        simulate()
    assert result.read_bytes() == before
    if as_config:
        path = experiment_folder / "input" / "config.json"
        settings = json.loads(path.read_text())
        settings["export"]["overwrite"] = True
        path.write_text(json.dumps(settings))
    simulate(overwrite=not as_config)
    assert result.read_bytes() != before


# --- what cannot be modelled -------------------------------------------------------------------


def test_an_error_of_supports_refuses_the_scene(simulate, result, experiment_folder):
    findings = [
        Finding("X-1", "warning", "gravity", "no gravity here"),
        Finding("X-2", "error", "elements/hinges", "3 hinges", "none", "use another producer"),
    ]
    with pytest.raises(UnsupportedScene, match="still cannot model it: 3 hinges") as caught:
        simulate(supporting(findings))
    error = caught.value
    assert (error.expected, error.fix, error.key) == (
        "none", "use another producer", "elements/hinges",
    )  # fmt: skip
    assert error.file == str(experiment_folder)
    assert not result.parent.exists()


def test_warnings_of_supports_are_told_with_the_result(simulate):
    remark = Finding("X-1", "warning", "gravity", "gravity is left out")
    assert remark in simulate(supporting([remark])).findings


@pytest.mark.parametrize(
    ("findings", "words"),
    [
        (ZeroDivisionError("1/0"), "failed while looking at the scene: ZeroDivisionError: 1/0"),
        (SystemExit(1), "failed while looking at the scene: SystemExit"),
        (None, "looking at the scene: TypeError"),
        (["no gravity"], r"supports\(\) returned a str, not a Finding"),
        ([None], r"supports\(\) returned a NoneType"),
    ],
)
def test_a_broken_supports(simulate, result, findings, words):
    with pytest.raises(PluginError, match=words):
        simulate(supporting(findings))
    assert not result.parent.exists()


# --- what stops midway -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "raised", "status"),
    [
        (KeyboardInterrupt(), KeyboardInterrupt, "interrupted"),
        (ZeroDivisionError("1/0"), PluginError, "failed"),
        (SystemExit(0), PluginError, "failed"),
        (ConfigError("odd"), ConfigError, "failed"),
    ],
)
def test_what_was_computed_is_kept_as_a_readable_prefix(simulate, result, error, raised, status):
    with pytest.raises(raised):
        simulate(stopping(error, after=4))
    assert not result.exists()
    with h5py.File(partial_path(result)) as file:
        assert file.attrs["status"] == status
    with Trajectory(partial_path(result), allow_incomplete=True) as trajectory:
        np.testing.assert_array_equal(trajectory.time, np.arange(4) * 0.01)
        assert trajectory.positions().shape == (4, 2, 3)


def test_without_a_frame_nothing_is_kept(simulate, result):
    with pytest.raises(PluginError, match="failed while running: ZeroDivisionError"):
        simulate(stopping(ZeroDivisionError(), after=0))
    assert list(result.parent.iterdir()) == []


def test_a_partial_file_in_the_way_is_told(simulate, result):
    with pytest.raises(KeyboardInterrupt):
        simulate(stopping(KeyboardInterrupt(), after=4))
    with pytest.raises(ResultExists, match="unfinished file") as caught:
        simulate()
    assert "openprc repair" in caught.value.fix
    simulate(overwrite=True)
    assert result.exists()
    assert not partial_path(result).exists()


def test_an_invalid_result_does_not_get_the_final_name(simulate, result):
    class Invalid(Still):
        def run(self, experiment, writer, *, seed, progress):
            super().run(experiment, writer, seed=seed, progress=progress)
            writer.commit()
            writer._file["time_series/nodes/positions"].attrs["unit"] = "furlong"

    with pytest.raises(SchemaError, match="OPS-L07: unknown unit 'furlong'"):
        simulate(Invalid)
    assert not result.exists()


# --- before anything runs ----------------------------------------------------------------------


def test_wrong_experiments(simulate, tmp_path, experiment_folder):
    with pytest.raises(UnreadableFile, match="the folder does not exist"):
        simulate(folder=tmp_path / "nothing")
    (tmp_path / "empty").mkdir()
    with pytest.raises(UnreadableFile, match="there is no experiment here"):
        simulate(folder=tmp_path / "empty")
    path = experiment_folder / "input" / "config.json"
    path.write_text(path.read_text().replace('"duration"', '"durration"'))
    with pytest.raises(ConfigError, match="did you mean 'duration'"):
        simulate()


def test_wrong_producers(simulate, experiment_folder):
    with pytest.raises(UnknownName, match="no producer named 'stil'"):
        run_experiment(experiment_folder, producer="stil", registry=Registry([]))
    with pytest.raises(UnknownName, match="legacy cannot run; it can import"):
        run_experiment(experiment_folder, producer="legacy", registry=Registry([]))
    needs = {"needs": {"run": ("no_such_package_zq",)}}
    with pytest.raises(MissingDependency, match="still needs no_such_package_zq to run"):
        simulate(fields=needs)
