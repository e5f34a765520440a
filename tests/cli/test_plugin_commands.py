"""Commands that plugins take part in: plugins, import, run, demo."""

from __future__ import annotations

import json

import numpy as np
import pytest

from openprc.cli import demo as demo_module
from openprc.hooks import FeatureSpec, OptionSpec, Registry, Sample
from openprc.hooks.hookspecs import PLUGIN_API
from openprc.schema import Trajectory, validate_file

ABSENT = "no_such_package_zq"


class Importer:
    """Reads a file of numbers: one channel that follows the input."""

    def sniff(self, path):
        return 0.9 if path.suffix == ".fak" else 0.0

    def import_run(self, path, writer, *, options):
        data = np.loadtxt(path, ndmin=1)
        writer.declare_channel("c", ["now [mm]", "past"], unit="mm")
        past = np.concatenate([[0.0], data[:-1]])
        writer.append(
            0.1 * np.arange(len(data)), channels={"c": np.stack([data + past**2, past], axis=1)}
        )
        writer.note("read [all] of it")


def write_sample(folder):
    u = np.random.default_rng(5).uniform(-1.0, 1.0, 300)
    path = folder / "run.fak"
    np.savetxt(path, u)
    return Sample(path, inputs={"u": {"sequence": u, "hold": 0.1}})


@pytest.fixture
def fake(install):
    """Return a function that makes the record of the importer above."""

    def make(name="fake", behind=Importer, **fields):
        return install.importer(name, behind, suffixes=(".fak",), **fields)

    return make


@pytest.fixture
def run_file(tmp_path):
    path = tmp_path / "run.1.fak"
    path.write_text("0.1\n0.2\n0.3\n")
    return path


# --- plugins -----------------------------------------------------------------------------------


def test_plugins_lists_what_there_is(openprc, install, fake):
    far = fake("far", needs={"import": (ABSENT,)}, install="pip install zeppelin")
    install(
        fine={
            "openprc_producers": [fake(), far],
            "openprc_features": [FeatureSpec("f", "A feature", "a:b")],
        },
        gone=SystemExit("no zeppelin"),
    )
    outcome = openprc("plugins")
    assert (outcome.code, outcome.err) == (0, "")
    for words in ("fine", "gone: it cannot be imported: SystemExit: no zeppelin",
                  "to do: reinstall or remove it", f"unavailable: needs {ABSENT}",
                  "pip install zeppelin", "openprc-fine/f", "demlat"):  # fmt: skip
        assert words in outcome.text
    data = openprc("plugins", "--json").data
    assert data["plugin_api"] == PLUGIN_API
    assert {p["name"]: p["state"] for p in data["plugins"]} == {
        "builtin": "ok", "fine": "ok", "gone": "broken",
    }  # fmt: skip
    states = {p["name"]: p["state"] for p in data["producers"]}
    assert (states["fake"], states["far"]) == ("ok", f"unavailable: needs {ABSENT}")
    assert "openprc-fine/f" in data["feature"]


def test_strict_makes_a_broken_plugin_an_exit_code(openprc, install, fake, monkeypatch):
    install(fine={"openprc_producers": [fake()]})
    assert openprc("plugins", "--strict").code == 0
    install(gone=ImportError("x"))
    assert openprc("plugins").code == 0
    assert openprc("plugins", "--strict").code == 1
    monkeypatch.setenv("OPENPRC_PLUGINS", "")
    outcome = openprc("plugins", "--strict")
    assert outcome.code == 0
    assert "disabled" in outcome.text
    assert "to do" not in outcome.text


def test_the_listing_does_not_depend_on_the_order(openprc, install, fake):
    one, two = fake("one"), fake("two")
    install(a={"openprc_producers": [one]}, b={"openprc_producers": [two]})
    first = openprc("plugins").out
    install(b={"openprc_producers": [two]}, a={"openprc_producers": [one]})
    assert openprc("plugins").out == first


def test_debug_shows_the_trace_of_a_plugin(install, monkeypatch):
    from openprc.cli.main import main

    monkeypatch.setenv("OPENPRC_PLUGIN_DEBUG", "1")
    error = ZeroDivisionError("in the plugin")
    install(gone=error)
    with pytest.raises(Exception, match="in the plugin") as caught:
        main(["plugins"])
    assert caught.value.__cause__ is error


# --- import ------------------------------------------------------------------------------------


def test_import_writes_beside_the_user_and_tells(openprc, install, fake, run_file, tmp_path):
    install(fine={"openprc_producers": [fake()]})
    outcome = openprc("import", run_file)
    assert outcome.code == 0
    target = tmp_path / "run.simulation.h5"
    assert validate_file(target).ok
    for words in ("fake", "run.simulation.h5", "note: read [all] of it", "hint OPS-I04"):
        assert words in outcome.text
    again = openprc("import", run_file)
    assert (again.code, "--force" in again.text) == (2, True)
    data = openprc("import", run_file, "--force", "--json").data
    assert (data["producer"], data["confidence"], data["n_frames"]) == ("fake", 0.9, 3)
    assert data["notes"] == ["read [all] of it"]


def test_import_takes_options(openprc, install, run_file):
    seen = []

    class Optional(Importer):
        def import_run(self, path, writer, *, options):
            seen.append(options)
            super().import_run(path, writer, options=options)

    options = (
        OptionSpec("dt", "time step", kind="float"),
        OptionSpec("rods", "which", multiple=True),
        OptionSpec("text", "a text with = in it"),
    )
    install(fine={"openprc_producers": [install.importer("fake", Optional, options=options)]})
    words = [
        "-o",
        "dt=0.5",
        "--option",
        "rods=a",
        "-o",
        "rods= b",
        "-o",
        "rods=c",
        "-o",
        "text=x=y",
    ]
    outcome = openprc("import", run_file, "--out", "o.h5", *words)
    assert outcome.code == 0
    assert seen == [{"dt": 0.5, "rods": ("a", " b", "c"), "text": "x=y"}]


def test_import_into_its_own_source(openprc, install, fake, run_file):
    install(fine={"openprc_producers": [fake()]})
    before = run_file.read_bytes()
    outcome = openprc("import", run_file, "--out", run_file, "--force")
    assert outcome.code == 2
    assert "would replace what is imported" in outcome.text
    assert run_file.read_bytes() == before


def test_the_example_plugin_from_file_to_file(openprc, csv_plugin, tmp_path):
    (tmp_path / "run.csv").write_text("t,x0 [mm],y0 [mm],u [N]\n0,1,2,3\n0.5,2,3,4\n")
    data = openprc("import", "run.csv", "--json").data
    assert (data["producer"], data["n_frames"], data["dims"]) == ("csv", 2, 2)
    with Trajectory("run.simulation.h5") as trajectory:
        np.testing.assert_allclose(
            trajectory.positions(unit="m")[:, 0], [[1e-3, 2e-3], [2e-3, 3e-3]]
        )
        assert trajectory.provenance["plugin"] == "openprc-example"


# --- run ---------------------------------------------------------------------------------------


class Runner:
    """Simulates that nothing moves."""

    def supports(self, experiment):
        return []

    def run(self, experiment, writer, *, seed, progress):
        writer.declare_nodes(experiment.geometry.n_nodes, 3, unit="m")
        for i, time in enumerate(experiment.frame_times):
            writer.append(time, positions=experiment.geometry.positions)
            progress((i + 1) / experiment.n_frames, "")
        writer.note(f"seed {seed}")


@pytest.fixture
def still(install):
    """Return a function that installs a runner as the producer `still`."""

    def put(behind=Runner):
        spec = install.importer("still", behind, capabilities=("run",))
        install(still={"openprc_producers": [spec]})

    return put


def test_run_with_a_producer_of_a_plugin(openprc, still, experiment_folder):
    still()
    outcome = openprc("run", experiment_folder, "--producer", "still", "--seed", "7")
    assert outcome.code == 0
    assert "note: seed 7" in outcome.text
    assert validate_file(experiment_folder / "output" / "simulation.h5").ok
    again = openprc("run", experiment_folder, "--producer", "still")
    assert (again.code, "--force" in again.text) == (2, True)
    data = openprc(
        "run", experiment_folder, "--producer", "still", "--force", "--out", "x.h5", "--json"
    ).data
    assert (data["path"], data["producer"], data["n_frames"]) == ("x.h5", "still", 11)


def test_ctrl_c_leaves_what_was_computed(openprc, still, experiment_folder):
    class Interrupted(Runner):
        def run(self, experiment, writer, *, seed, progress):
            super().run(experiment, writer, seed=seed, progress=progress)
            raise KeyboardInterrupt

    still(Interrupted)
    outcome = openprc("run", experiment_folder, "--producer", "still")
    assert outcome.code == 130
    assert "stopped" in outcome.err
    output = experiment_folder / "output"
    assert [p.name for p in output.iterdir()] == ["simulation.h5.partial"]
    told = openprc("repair", output / "simulation.h5.partial")
    assert (told.code, "11 frames saved, status interrupted" in told.text) == (0, True)


def test_the_engine_runs_by_default(openprc, experiment_folder):
    data = openprc("run", experiment_folder, "--json").data
    assert (data["producer"], data["n_frames"], data["inputs"]) == ("demlat", 11, ["u"])
    with Trajectory(experiment_folder / "output" / "simulation.h5") as trajectory:
        assert trajectory.provenance["deterministic"] == 1
        assert trajectory.provenance["config"]["simulation"]["dt"] == 0.001
        # Node 0 goes where the signal says.
        np.testing.assert_allclose(
            trajectory.positions()[:, 0, 0], np.linspace(0.0, 0.1, 11), atol=1e-12
        )


# --- demo --------------------------------------------------------------------------------------


@pytest.fixture
def demo(openprc, install, fake, make_registry):
    """Return a function that runs the demo with producers of a plugin only."""

    def call(*words, **samples):
        specs = []
        for name, given in samples.items():
            sample, fields = given if isinstance(given, tuple) else (given, {})
            specs.append(fake(name, sample=install.code("write_sample", sample), **fields))
        install(fine={"openprc_producers": specs})
        make_registry()
        return openprc("demo", *words)

    return call


@pytest.fixture
def make_registry(monkeypatch):
    """Return a function that hides what the package itself brings: it takes long to run."""

    def make():
        registry = Registry()
        registry.plugins = tuple(p for p in registry.plugins if p.name != "builtin")
        monkeypatch.setattr(demo_module, "default_registry", lambda: registry)

    return make


def raising(error):
    def sample(folder):
        raise error

    return sample


def without_input(folder):
    return Sample(write_sample(folder).path)


def test_demo_goes_from_a_sample_to_a_score(demo, tmp_path):
    outcome = demo("--json", "--keep", "kept", fake=write_sample)
    assert outcome.code == 0
    (row,) = outcome.data["rows"]
    assert (row["producer"], row["way"], row["state"]) == ("fake", "import", "ok")
    assert (row["channels"], row["frames"]) == (2, 300)
    assert 0 < row["nrmse"] < 1
    assert row["skill"] == pytest.approx(1 - row["nrmse"] / row["baseline"])
    assert validate_file(tmp_path / "kept" / "fake" / "simulation.h5", profile="benchmark").ok
    again = demo("--keep", "kept", fake=write_sample)
    assert again.code == 0
    for words in ("OpenPRC demo", "NARMA2 NRMSE", "shift register", "files: kept"):
        assert words in again.text


def test_demo_leaves_nothing_unless_told(demo, tmp_path):
    assert demo(fake=write_sample).code == 0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("sample", "remark"),
    [
        (raising(ZeroDivisionError("1/0")), "failed while writing its sample: ZeroDivisionError"),
        (raising(SystemExit(0)), "failed while writing its sample: SystemExit: 0"),
        (lambda folder: None, "it returned a NoneType, not a Sample"),
        (lambda folder: Sample(folder / "none.fak"), "does not exist"),
        (lambda folder: Sample(write_sample(folder).path, inputs={"u": {}}), "KeyError"),
        (lambda folder: Sample(write_sample(folder).path, options={"a": 1}), "no option 'a'"),
    ],
)
def test_a_producer_that_fails_does_not_stop_the_others(demo, sample, remark):
    outcome = demo("--json", a=sample, b=write_sample)
    assert outcome.code == 1
    first, second = outcome.data["rows"]
    assert (first["state"], second["state"]) == ("failed", "ok")
    assert remark in first["remark"]


def test_a_body_that_nothing_drives_has_no_score(demo):
    outcome = demo("--json", a=without_input)
    (row,) = outcome.data["rows"]
    assert (outcome.code, row["state"], row["nrmse"]) == (0, "undriven", None)
    assert "nothing drove the body" in row["remark"]


def test_an_unavailable_producer_is_no_failure(demo):
    fields = {"needs": {"import": (ABSENT,)}, "install": "pip install zeppelin"}
    outcome = demo("--json", a=(write_sample, fields), b=write_sample)
    assert outcome.code == 0
    row = outcome.data["rows"][0]
    assert row["state"] == "unavailable"
    assert f"needs {ABSENT}" in row["remark"]
    assert "pip install zeppelin" in row["remark"]


def test_json_is_json_even_where_numbers_are_not(openprc, make_file):
    text = openprc("info", make_file(dims=2), "--json").out
    json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} is not JSON"))
