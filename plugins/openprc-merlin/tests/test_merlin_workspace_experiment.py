"""Workspaces as experiments: laws, supports, loads, units, and the way through a folder."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from openprc_merlin import samples
from openprc_merlin.__main__ import main
from openprc_merlin.workspace_experiment import workspace_experiment

from openprc.errors import ConfigError, MissingData
from openprc.hooks.importing import import_file
from openprc.hooks.running import run_experiment
from openprc.schema import Trajectory
from openprc.schema.experiment import load_experiment


@pytest.fixture
def space():
    """Return the variables of the sample, the modulus of its bars told."""
    variables = samples.workspace()
    variables["AnalyInputOpt"]["ModElastic"] = np.array([[1e8]])
    return variables


def test_sample_in_millimetres(space, mat):
    path = mat(space)
    plain = workspace_experiment(path)
    small = workspace_experiment(path, unit="mm", force_unit="mN")
    body, other = plain.geometry, small.geometry
    np.testing.assert_allclose(body.positions, samples.REST)
    np.testing.assert_allclose(other.positions, 1e-3 * samples.REST)
    assert set(body.bars.law) == {"ogden"}
    np.testing.assert_allclose(other.bars.stiffness, body.bars.stiffness)  # mN/mm is N/m
    np.testing.assert_allclose(other.bars.rest_length, 1e-3 * body.bars.rest_length)
    # Hinge: K per length times the crease, 2 long.
    np.testing.assert_allclose(body.hinges.stiffness, 2.0 * samples.KF)
    np.testing.assert_allclose(other.hinges.stiffness, 1e-6 * body.hinges.stiffness)
    assert body.hinges.law.tolist() == ["enhanced-linear"]
    np.testing.assert_allclose(np.degrees(body.hinges.limit_high), 315.0)
    assert body.labels == ("1", "2", "3", "4")
    assert body.fixed.tolist() == [True, True, True, False]
    assert plain.n_frames == samples.N_INCREMENTS + 1
    (signal,) = small.signals.values()
    np.testing.assert_allclose(signal.values[-1], [0, 0, 1e-3])
    assert any("lengths were taken to be in mm" in note for note in small.notes)


def test_sample_follows_its_closed_form_when_run_again(space, mat, tmp_path):
    assert main([str(mat(space)), "--out", str(tmp_path / "exp"), "--increments", "80"]) == 0
    made = run_experiment(tmp_path / "exp", producer="merlin")
    with Trajectory(made.path) as tr:
        angle = tr.element("hinges", "angle")[:, 0] - np.pi
        assert angle[-1] > 0.3
        np.testing.assert_allclose(
            tr.input("load").value[:, 0], samples.load_factors(angle), atol=2e-4
        )


def test_mass_is_shared_out_by_area(space, mat):
    path = mat(space)
    assert (workspace_experiment(path).geometry.masses == 1.0).all()
    masses = workspace_experiment(path, mass=0.6).geometry.masses
    # Two equal triangles: the crease nodes belong to both.
    np.testing.assert_allclose(masses, [0.1, 0.2, 0.2, 0.1])


def test_partial_supports_become_constant_positions(space, mat):
    space["Supp"] = np.array([[1, 1, 0, 1], [2, 1, 1, 1], [3, 1, 1, 1]], dtype=float)
    space["truss"]["FixedDofs"] = np.array([[1.0, 3, 4, 5, 6, 7, 8, 9]]).T
    experiment = workspace_experiment(mat(space))
    assert experiment.geometry.fixed.tolist() == [False, True, True, False]
    support = experiment.actuators[0]
    assert (support.node, support.axes, support.type) == (0, (True, False, True), "position")
    np.testing.assert_allclose(experiment.signals[support.signal].values, [samples.REST[0]])
    assert experiment.held_axes[0].tolist() == [True, False, True]


def test_displacement_wins_over_a_support(space, mat):
    space["AnalyInputOpt"]["LoadType"] = "Displacement"
    space["AnalyInputOpt"]["Load"] = np.eye(12)[:, [11]]
    space["truss"]["FixedDofs"] = np.r_[1:10, 12].astype(float)[:, None]
    experiment = workspace_experiment(mat(space))
    drive = next(a for a in experiment.actuators if a.node == 3)
    assert drive.axes == (False, False, True)
    values = experiment.signals[drive.signal].values[:, 0]
    np.testing.assert_allclose(values, np.r_[0.0, np.sin(samples.fold_angles())])
    assert not experiment.geometry.fixed[3]


def test_first_increment_is_merlins(space, mat):
    space["AnalyInputOpt"]["InitialLoadFactor"] = np.array([[0.25]])
    experiment = workspace_experiment(mat(space), increments=4)
    np.testing.assert_allclose(experiment.signals["load"].values[:, 2], [0.0, 0.25, 0.5, 0.75, 1.0])
    assert any("0.25, from AnalyInputOpt.InitialLoadFactor" in n for n in experiment.notes)
    del space["AnalyInputOpt"]["InitialLoadFactor"]
    first = workspace_experiment(mat(space, "other.mat"))
    assert any("the first value of Fhis" in note for note in first.notes)


def test_four_thirds_bends(space, mat):
    space["angles"]["bend"], space["angles"]["fold"] = (
        space["angles"]["fold"],
        np.zeros((0, 4)),
    )
    for name in ("pb0", "Kb"):
        space["angles"][name] = space["angles"][name.replace("b", "f")]
    space["angles"]["pf0"] = space["angles"]["Kf"] = np.zeros((0, 1))
    space["AnalyInputOpt"]["MaterCalib"] = "auto"
    hinges = workspace_experiment(mat(space)).geometry.hinges
    assert hinges.law.tolist() == ["four-thirds"]
    assert not hinges.limited.any()
    np.testing.assert_allclose(hinges.stiffness, 2.0 * samples.KF)


def without(name):
    def change(space):
        for owner in (space, space["truss"], space["angles"], space["AnalyInputOpt"]):
            owner.pop(name, None)

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (without("A"), "bars with their areas"),
        (without("pf0"), "rest angles and stiffness of the hinges"),
        (without("Load"), "does not tell the load"),
    ],
)
def test_what_the_workspace_lacks_is_named(space, mat, change, words):
    space["limlft"], space["limrht"] = np.array([[45.0]]), np.array([[315.0]])
    change(space)
    with pytest.raises(MissingData, match=words):
        workspace_experiment(mat(space))


def test_modulus_can_be_given(space, mat):
    for name in ("ModElastic", "C0", "E0"):
        without(name)(space)
    space.pop("STAT", None)
    path = mat(space)
    with pytest.raises(MissingData, match="modulus C0 of the bars"):
        workspace_experiment(path)
    bars = workspace_experiment(path, c0=50.0).geometry.bars
    np.testing.assert_allclose(bars.stiffness, 50.0 * 0.1 / bars.rest_length)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"unit": "N"}, "the unit 'N'"),
        ({"force_unit": "parsec"}, "the unit 'parsec'"),
        ({"mass": 0.0}, "a number above 0"),
        ({"increments": -1}, "a number above 0"),
    ],
)
def test_argument_that_is_wrong(space, mat, given, words):
    with pytest.raises(ConfigError, match=words):
        workspace_experiment(mat(space), **given)


def test_command_reports_errors_and_replaces_nothing(space, mat, tmp_path, capsys):
    path = mat(space)
    assert main([str(tmp_path / "none.mat"), "--out", str(tmp_path / "a")]) == 2
    assert "none.mat" in capsys.readouterr().err
    assert main([str(path), "--out", str(tmp_path / "a"), "--mass", "2"]) == 0
    assert capsys.readouterr().out.endswith(f"openprc run {tmp_path / 'a'} --producer merlin\n")
    assert load_experiment(tmp_path / "a").geometry.masses.sum() == pytest.approx(2.0)
    with pytest.raises(SystemExit):
        main([str(path), "--out", str(tmp_path / "a")])
    assert "holds an experiment already" in capsys.readouterr().err


@pytest.mark.parametrize(
    "name",
    [
        "merlin2_kresling_n4b5_disp.mat",
        pytest.param("merlin1_miura_folding.mat", marks=pytest.mark.slow),
    ],
)
def test_from_the_command_line_to_the_same_trajectory(data, tmp_path, name):
    source, folder = data / name, tmp_path / "exp"
    openprc = Path(sys.executable).with_name("openprc")
    for command in (
        [sys.executable, "-m", "openprc_merlin", str(source), "--out", str(folder)],
        [str(openprc), "run", str(folder), "--producer", "merlin"],
    ):
        subprocess.run(command, check=True, capture_output=True)
    imported = import_file(source, tmp_path / "imported.h5", options={"unit": "m"})
    with Trajectory(folder / "output" / "simulation.h5") as new, Trajectory(imported.path) as old:
        np.testing.assert_array_equal(new.time, old.time)
        np.testing.assert_allclose(new.positions(), old.positions(), atol=1e-7)
        for kind, quantity in (("bars", "strain"), ("bars", "length"), ("hinges", "angle")):
            np.testing.assert_allclose(
                new.element(kind, quantity), old.element(kind, quantity), atol=2e-7
            )
        for kind in ("bars", "hinges", "faces"):
            np.testing.assert_array_equal(new.indices(kind), old.indices(kind))
        if "load" in old.inputs:
            np.testing.assert_allclose(new.input("load").value, old.input("load").value, atol=1e-7)
        else:
            assert new.channel_columns("reaction") == old.channel_columns("reaction")
            np.testing.assert_allclose(new.channel("reaction"), old.channel("reaction"), atol=1e-8)
