"""The legacy importer on files made here, so that every layout and every defect occurs."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
from older_files import BARS, N_FRAMES, REST, convert, motion, notes, write_inputs, write_run

from openprc.errors import (
    Diverged,
    UnreadableFile,
)
from openprc.schema.legacy import LegacyImporter
from openprc.schema.legacy_clock import rebuild


@pytest.fixture
def experiment(tmp_path):
    folder = tmp_path / "experiment"
    write_inputs(folder / "input")
    write_run(folder / "output/simulation.h5", motion())
    return folder


# --- the newer engine: no drive, no lengths, energies without the second axis ---


def test_newer_engine_with_its_folder(experiment, tmp_path):
    with convert(experiment, tmp_path / "run.h5") as run:
        np.testing.assert_array_equal(run.positions(), motion())
        np.testing.assert_array_equal(run.time, np.arange(N_FRAMES) * 0.05)
        assert run.systems == ("kinetic_energy", "potential_energy", "total_energy")
        np.testing.assert_array_equal(run.node("fixed"), [1, 0, 0, 0])
        drive = run.input("push")
        assert (drive.quantity, drive.unit, drive.columns) == ("position", "m", ("x", "y", "z"))
        np.testing.assert_allclose(
            drive.value[:, 0], 1 + 0.1 * np.sin(0.1 * np.arange(N_FRAMES)), atol=1e-6
        )
        assert "not carried over: elements/bars/stress" in notes(run)
        assert "nearest sample" in notes(run)


def test_rigid_bars_are_named_and_not_negative(experiment, tmp_path):
    with convert(experiment, tmp_path / "run.h5") as run:
        np.testing.assert_array_equal(run.element_static("bars", "rigid"), [0, 1, 0])
        np.testing.assert_array_equal(run.element_static("bars", "stiffness"), [100, 0, 50])


def test_masses_that_are_none_are_left_out(experiment, tmp_path):
    with h5py.File(experiment / "input/geometry.h5", "r+") as file:
        file["nodes/masses"][2] = -1.0
    with convert(experiment, tmp_path / "run.h5") as run:
        assert not run.has("/topology/nodes/mass")
        assert "the masses were left out" in notes(run)


def test_bar_lengths_and_strains_follow_from_the_positions(experiment, tmp_path):
    ends = motion().astype("f8")[:, BARS]
    length = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
    rest = np.array([1, 1.1, 1.1], "f4").astype("f8")
    with convert(experiment, tmp_path / "run.h5") as run:
        np.testing.assert_allclose(run.element("bars", "length"), length, rtol=1e-15)
        np.testing.assert_allclose(
            run.element("bars", "strain"), length / rest - 1, rtol=0, atol=1e-15
        )


def test_hinges_keep_crease_first_and_the_old_name_of_the_rest_angle(experiment, tmp_path):
    with convert(experiment, tmp_path / "run.h5") as run:
        np.testing.assert_array_equal(run.indices("hinges"), [[0, 1, 2, 3]])
        np.testing.assert_array_equal(run.element_static("hinges", "rest_angle"), [3.5])
        np.testing.assert_array_equal(run.element("hinges", "angle"), np.full((N_FRAMES, 1), 3.0))


def test_scalar_force_signal_and_overwritten_actuator(tmp_path):
    folder = tmp_path / "experiment"
    write_inputs(
        folder / "input",
        actuators=[
            {"node_idx": 2, "signal_name": "push", "type": "force"},
            {"node_idx": 2, "signal_name": "pull", "type": "force", "dof": [0, 0, 1]},
            {"node_idx": 3, "signal_name": "pull", "type": "force", "dof": [0, 0, 1]},
            {"node_idx": 0, "signal_name": "none", "type": "force"},
        ],
    )
    write_run(folder / "output/simulation.h5", motion())
    with convert(folder, tmp_path / "run.h5") as run:
        assert run.inputs == ("pull",)
        drive = run.input()
        assert (drive.unit, drive.targets) == ("N", ("node 2", "node 3"))
        np.testing.assert_allclose(drive.value[:, 0], np.arange(N_FRAMES) * 0.05 / 2.0, atol=1e-12)
        assert "only the last one act" in notes(run)
        assert "no signal none" in notes(run)
        assert "(dof)" in notes(run)


def test_drive_that_the_body_did_not_follow_is_noted(tmp_path):
    folder = tmp_path / "experiment"
    write_inputs(folder / "input")
    places = motion()
    places[:, 1] = REST[1]
    write_run(folder / "output/simulation.h5", places)
    with convert(folder, tmp_path / "run.h5") as run:
        assert "disagree at node 1" in notes(run)


# --- the older engine ---


def test_older_engine_stores_the_drive_and_energies_with_two_axes(tmp_path):
    path = write_run(tmp_path / "old.h5", motion(), stored_drive=True, two_dimensional_energy=True)
    with convert(path, tmp_path / "run.h5") as run:
        assert run.inputs == ("actuation_1",)
        np.testing.assert_array_equal(run.system("total_energy"), np.arange(N_FRAMES))
        assert run.channels == ("bar_length", "bar_strain")
        assert "no topology" in notes(run)


def test_run_without_anything_beside_it(tmp_path):
    path = write_run(tmp_path / "alone.h5", motion())
    with convert(path, tmp_path / "run.h5") as run:
        assert run.inputs == ()
        assert run.element_kinds == ()
        assert "nothing says what drove the body" in notes(run)


def test_geometry_of_another_run_is_not_used(experiment, tmp_path):
    write_run(experiment / "output/simulation.h5", motion()[:, :3])
    with convert(experiment, tmp_path / "run.h5") as run:
        assert run.element_kinds == ()
        assert "it has 4 nodes and the run 3" in notes(run)


def test_geometry_whose_fixed_nodes_are_elsewhere_is_not_used(experiment, tmp_path):
    places = motion()
    places[:, 0] += 0.5
    write_run(experiment / "output/simulation.h5", places)
    with convert(experiment, tmp_path / "run.h5") as run:
        assert run.element_kinds == ()
        assert "fixed nodes of it are up to 0.5 m elsewhere" in notes(run)


# --- unfinished and damaged runs ---


def test_preallocated_rows_are_left_out(tmp_path):
    path = write_run(tmp_path / "a.h5", motion(), total_frames=30)
    with convert(path, tmp_path / "run.h5") as run:
        assert run.n_frames == 30
        assert "11 of 41 rows are left out" in notes(run)


def test_unfinished_run_ends_where_time_stops(tmp_path):
    path = write_run(tmp_path / "a.h5", motion(), completed=0, total_frames=0)
    with h5py.File(path, "r+") as file:
        file["time_series/time"][25:] = 0.0
    with convert(path, tmp_path / "run.h5") as run:
        assert run.n_frames == 25
        assert "did not finish" in notes(run)


def test_diverged_run_is_refused(tmp_path):
    places = motion()
    places[17, 2] = np.nan
    path = write_run(tmp_path / "a.h5", places)
    with pytest.raises(Diverged, match=r"node 2 is at .* in frame 17"):
        convert(path, tmp_path / "run.h5")
    assert not (tmp_path / "run.h5").exists()


def test_time_that_goes_back_is_refused(tmp_path):
    path = write_run(tmp_path / "a.h5", motion())
    with h5py.File(path, "r+") as file:
        file["time_series/time"][20] = 0.0
    with pytest.raises(UnreadableFile, match=r"time is 0.0 at frame 20, after 0.949"):
        convert(path, tmp_path / "run.h5")


def test_empty_run_is_refused(tmp_path):
    path = write_run(tmp_path / "a.h5", motion(0))
    with pytest.raises(UnreadableFile, match="the run holds no frame"):
        convert(path, tmp_path / "run.h5")


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("elements/bars/indices", np.array([[0, 9]] * 3, "i4"), r"names node \[0, 9\] of 4"),
        ("elements/bars/indices", np.zeros((3, 3), "i4"), r"expected: \(E, 2\) integers"),
        ("elements/bars/damping", np.zeros(2, "f4"), r"expected: 3 numbers"),
        ("nodes/positions", np.zeros(4, "f4"), r"of shape \(4,\)"),
    ],
)
def test_damaged_geometry_is_named(experiment, tmp_path, name, value, words):
    with h5py.File(experiment / "input/geometry.h5", "r+") as file:
        del file[name]
        file[name] = value
    with pytest.raises(UnreadableFile, match=words) as caught:
        convert(experiment, tmp_path / "run.h5")
    assert caught.value.file.endswith("geometry.h5")
    assert "move the input folder away" in caught.value.fix


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "it is no JSON"),
        ("[]", "it holds a list"),
        ('{"actuators": 3}', "actuators is no list"),
        ('{"actuators": [{"signal_name": "a"}]}', "actuator 0 names no node"),
    ],
)
def test_damaged_settings_are_named(experiment, tmp_path, text, words):
    (experiment / "input/config.json").write_text(text)
    with pytest.raises(UnreadableFile, match=words):
        convert(experiment, tmp_path / "run.h5")


def test_signals_without_a_time_step_are_named(experiment, tmp_path):
    with h5py.File(experiment / "input/signals.h5", "r+") as file:
        file.attrs["dt_base"] = 0.0
    with pytest.raises(UnreadableFile, match=r"the time step of the signals is 0.0"):
        convert(experiment, tmp_path / "run.h5")


def test_signal_of_a_wrong_shape_is_named(experiment, tmp_path):
    with h5py.File(experiment / "input/signals.h5", "r+") as file:
        del file["push"]
        file["push"] = np.zeros((401, 2))
    with pytest.raises(UnreadableFile, match=r"the signal is float64 of shape \(401, 2\)"):
        convert(experiment, tmp_path / "run.h5")


def test_stored_drive_of_an_unknown_form_is_named(tmp_path):
    path = write_run(tmp_path / "a.h5", motion())
    with h5py.File(path, "r+") as file:
        file["time_series/actuation_signals/motor"] = np.zeros((N_FRAMES, 3))
    with pytest.raises(UnreadableFile, match="a form that is not known"):
        convert(path, tmp_path / "run.h5")


def test_drives_that_are_not_finite_are_named(experiment, tmp_path):
    path = write_run(tmp_path / "a.h5", motion())
    with h5py.File(path, "r+") as file:
        file["time_series/actuation_signals/1"] = np.full((N_FRAMES, 3), np.nan)
    with pytest.raises(
        UnreadableFile, match=r"the drive is \[nan, nan, nan\] at sample 0"
    ) as error:
        convert(path, tmp_path / "run.h5")
    assert error.value.key == "time_series/actuation_signals/1"
    with h5py.File(experiment / "input/signals.h5", "r+") as file:
        file["push"][7] = np.inf
    with pytest.raises(UnreadableFile, match=r"the drive is .*inf.* at sample 7"):
        convert(experiment, tmp_path / "run.h5")


# --- the clock ---


@pytest.mark.parametrize("dt", [0.01, 0.05, 0.043, 1 / 30, 1e-3, 0.0215])
@pytest.mark.parametrize("t0", [0.0, 0.1])
def test_single_precision_times_are_rebuilt_exactly(dt, t0):
    exact = t0 + np.arange(3000) * dt
    clock = rebuild(exact.astype("f4"), rates=[1.0 / dt])
    # One bit of the step is all that is open: 1 / (1 / dt) need not be dt.
    assert np.abs(clock.time - exact).max() <= 3000 * np.spacing(dt)
    assert "rebuilt" in clock.remark


def test_claimed_rate_that_does_not_fit_is_not_believed():
    stored = (np.arange(2000) * 0.042).astype("f4")
    clock = rebuild(stored, rates=[1.0 / 0.043])  # what int(0.043 / 0.001) does to that engine
    np.testing.assert_allclose(clock.time, np.arange(2000) * 0.042, rtol=0, atol=1e-12)


def test_uneven_times_stay_as_they_are():
    stored = np.cumsum(np.random.default_rng(0).uniform(0.5, 1.5, 200)).astype("f4")
    clock = rebuild(stored, rates=[1.0])
    np.testing.assert_array_equal(clock.time, stored.astype("f8"))
    assert clock.remark == ""


@pytest.mark.parametrize("attribute", ["schema_version", "every"])
def test_a_run_that_lost_its_attributes_is_still_in_metres(tmp_path, attribute):
    path = tmp_path / "simulation.h5"
    write_run(path, motion())
    with h5py.File(path, "r+") as file:
        for name in list(file.attrs) if attribute == "every" else [attribute]:
            del file.attrs[name]
        stored = file["time_series/nodes/positions"][()]
    assert LegacyImporter().sniff(path) == 1.0
    with convert(path, tmp_path / "run.h5") as result:
        assert result.position_unit == "m"
        np.testing.assert_array_equal(result.positions(), stored)
