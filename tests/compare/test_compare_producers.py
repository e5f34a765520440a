"""Requests as typed, and runs that work, are refused, or fail, side by side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from openprc.compare.runs.known_motion import reference_name, write_exact
from openprc.compare.runs.names import files_by_name, reference_first
from openprc.compare.runs.producers import run_producers
from openprc.compare.runs.requests import read_requests
from openprc.compare.studies import Choices, compare_producers, compare_runs
from openprc.errors import ConfigError, ResultExists, UnknownName
from openprc.scenes.catalog import build_scene
from openprc.schema.trajectory import Trajectory
from openprc.testing import closed_form_scenes


@pytest.fixture(scope="module")
def oscillator():
    return build_scene("oscillator", {"periods": 2})


def test_settings_after_the_name():
    plain, fine, single, merlin = read_requests(
        "demlat, demlat:verlet:dt=1e-4,demlat:rk4:float32,merlin:tolerance=1e-8"
    )
    assert (plain.producer, dict(plain.changes)) == ("demlat", {})
    assert dict(fine.changes) == {"integrator": "verlet", "dt": 1e-4}
    assert dict(single.changes) == {"integrator": "rk4", "precision": "float32"}
    # merlin has an option of that name, which goes first.
    assert (dict(merlin.changes), dict(merlin.options)) == ({}, {"tolerance": "1e-8"})
    assert fine.file_stem == "demlat-verlet-dt=1e-4"


def test_choices_of_an_option_need_no_key():
    (request,) = read_requests("pybullet:plain")
    assert dict(request.options) == {"start": "plain"}


def test_more_settings_for_all_of_a_producer():
    requests = read_requests(
        "demlat,pyelastica,pyelastica:poisson=0.3",
        options=["pyelastica:section=constant:poisson=0.4"],
    )
    assert [dict(request.options) for request in requests] == [
        {},
        {"section": "constant", "poisson": "0.4"},
        {"section": "constant", "poisson": "0.3"},
    ]


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        ("", (), "no producer is named"),
        (",,", (), "no producer is named"),
        ("demlat:", (), "has an empty part"),
        ("demlat,demlat", (), "'demlat' is named twice"),
        ("demlat:verle", (), "did you mean 'verlet'"),
        ("demlat:dt=fast", (), "dt in 'demlat:dt=fast' is 'fast'"),
        ("demlat:dt=-1", (), "a positive, finite number"),
        ("demlat:dt=nan", (), "a positive, finite number"),
        ("demlat:integrator=euler", (), "one of rk4, verlet"),
        ("demlat:precision=half", (), "one of float64, float32"),
        ("pybullet:start=now", (), "one of half-kick, plain"),
        ("demlat", ("pybullet:plain",), "about pybullet, which is not compared"),
    ],
)
def test_requests_that_are_wrong(text, options, words):
    with pytest.raises(ConfigError, match=words.replace("[", r"\[")):
        read_requests(text, options=options)


def test_an_unknown_producer_is_named():
    with pytest.raises(UnknownName, match="no producer named 'demlta'"):
        read_requests("demlta")


def test_every_request_has_a_row(oscillator, tmp_path):
    heard = []
    runs = run_producers(
        oscillator.experiment,
        read_requests("demlat,demlat:verlet,pyelastica,csv,demlat:dt=0.03"),
        tmp_path,
        progress=lambda fraction, message: heard.append(fraction),
    )
    assert [run.status for run in runs] == ["ok", "ok", "refused", "refused", "refused"]
    first, second, rod, importer, odd = runs
    assert first.path.name == "demlat.h5"
    assert second.path.name == "demlat-verlet.h5"
    assert first.cpu_seconds > 0.0
    assert first.fixed_seconds > 0.0
    assert "a single bar" in rod.reason
    assert "rotary inertia" in " ".join(rod.adds) or rod.adds
    assert "cannot run" in importer.reason
    assert "times dt" in odd.reason
    assert heard == sorted(heard)
    assert not list(tmp_path.glob("*.partial"))
    assert first.as_dict()["file"] == "demlat.h5"


def test_a_diverging_run_is_a_row(oscillator, tmp_path):
    wild = replace(oscillator.experiment, dt=oscillator.experiment.save_interval,
                   integrator="verlet", step_check="warn")  # fmt: skip
    stiff = replace(wild.geometry.bars, stiffness=1e12 * np.ones(1))
    wild = replace(wild, geometry=replace(wild.geometry, bars=stiff))
    (run,) = run_producers(wild, read_requests("demlat"), tmp_path)
    assert run.status == "diverged"
    assert run.path is None
    assert run.reason
    assert not (tmp_path / "demlat.h5").exists()


def test_nothing_is_overwritten(oscillator, tmp_path):
    (tmp_path / "demlat-verlet.h5").write_text("mine")
    requests = read_requests("demlat,demlat:verlet")
    with pytest.raises(ResultExists, match="finished file of this name"):
        run_producers(oscillator.experiment, requests, tmp_path)
    assert [item.name for item in tmp_path.iterdir()] == ["demlat-verlet.h5"]
    assert (tmp_path / "demlat-verlet.h5").read_text() == "mine"


def test_the_exact_motion_as_a_file(oscillator, tmp_path):
    path = write_exact(oscillator, tmp_path / "exact.h5")
    with Trajectory(path) as run:
        times = oscillator.experiment.frame_times
        assert run.time == pytest.approx(times)
        exact = oscillator.reference.exact(times)
        assert run.positions() == pytest.approx(exact[..., : run.dims])
        assert run.provenance["producer"] == reference_name(oscillator) == "closed-form"


def test_a_scene_is_compared_with_its_formula(oscillator, tmp_path):
    report = compare_producers(
        oscillator.experiment, read_requests("demlat,pyelastica"), tmp_path,
        scene=oscillator, choices=Choices(tasks=False),
    )  # fmt: skip
    assert report.names == ("closed-form", "demlat", "pyelastica")
    assert report.reference == "closed-form"
    assert report.pair("demlat").relative_rms < 1e-3
    assert report.pair("pyelastica") is None
    assert report.divergences["demlat"].verdict == "agrees"
    assert all(probe.within for probe in report.probes["demlat"])
    assert report.twins is None  # nothing to explain
    assert report.as_dict()["producers"][1]["status"] == "refused"
    assert {item.name for item in report.physics} >= {"nodes", "bars"}


def test_a_producer_may_be_the_reference(oscillator, tmp_path):
    report = compare_producers(
        oscillator.experiment, read_requests("demlat,demlat:verlet"), tmp_path,
        scene=oscillator, choices=Choices(tasks=False, reference="demlat:verlet"),
    )  # fmt: skip
    assert report.reference == "demlat:verlet"
    assert set(report.divergences) == {"closed-form", "demlat"}


def test_no_producer_that_can(oscillator, tmp_path):
    with pytest.raises(ConfigError, match="none of the producers runs it: pyelastica: a single"):
        compare_producers(oscillator.experiment, read_requests("pyelastica"), tmp_path)


def test_an_unknown_reference_is_refused_before_anything_runs(oscillator, tmp_path):
    with pytest.raises(ConfigError, match="no run called 'best'"):
        compare_producers(
            oscillator.experiment, read_requests("demlat"), tmp_path / "new",
            choices=Choices(reference="best"),
        )  # fmt: skip
    assert not (tmp_path / "new").exists()


def test_a_single_run_without_formula_is_still_reported(tmp_path):
    experiment = closed_form_scenes.oscillator(1.0).experiment
    report = compare_producers(
        experiment, read_requests("demlat"), tmp_path, choices=Choices(tasks=False)
    )
    assert report.comparison is None
    assert report.names == ("demlat",)


# --- names of files -----------------------------------------------------------------------------


def test_files_are_called_by_what_tells_them_apart(tmp_path):
    paths = [tmp_path / folder / "simulation.h5" for folder in ("a", "b")]
    files = files_by_name(paths)
    assert list(files.values()) == paths
    assert list(files) == ["a/simulation.h5", "b/simulation.h5"]
    assert next(iter(reference_first(files, "b/simulation.h5"))) == "b/simulation.h5"
    with pytest.raises(ConfigError, match="several runs are called"):
        reference_first(files, "simulation.h5")
    with pytest.raises(ConfigError, match="no run called 'c'"):
        reference_first(files, "c")


def test_one_file_and_the_same_file_twice(tmp_path):
    path = tmp_path / "a.h5"
    with pytest.raises(ConfigError, match="1 file to compare"):
        compare_runs([path])
    with pytest.raises(ConfigError, match="the same file is named twice"):
        compare_runs([path, tmp_path / "." / "a.h5"])
