"""The legacy importer on files made here, so that every layout and every defect occurs."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest

from openprc.errors import (
    Diverged,
    NotATrajectory,
    OpenPRCError,
    UnreadableFile,
    UnsafeFile,
)
from openprc.schema import Provenance, Trajectory, TrajectoryWriter
from openprc.schema.legacy import LegacyImporter
from openprc.schema.legacy_clock import rebuild

REST = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -1, 0.2]], dtype="f4")
BARS = np.array([[0, 1], [1, 2], [2, 0]], dtype="i4")
N_FRAMES = 41


def motion(n_frames=N_FRAMES, *, planar=False):
    """Node 1 is driven along x, node 2 swings, the others rest: (T, 4, 3) [m]."""
    t = np.arange(n_frames) * 0.05
    x = np.repeat(REST[None].astype("f8"), n_frames, axis=0)
    x[:, 1, 0] += 0.1 * np.sin(2 * t)
    x[:, 2, 1] += 0.05 * np.sin(3 * t)
    x[:, 2, 2] += 0.05 * t
    if planar:
        x[..., 2] = 0.0
    return x.astype("f4")


def write_run(path, places, *, stored_drive=False, two_dimensional_energy=False, **attrs):
    """Write simulation.h5 as the engine does; `attrs` replace root attributes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    n = len(places)
    with h5py.File(path, "w") as file:
        file.attrs.update(
            {
                "schema_version": "2.1.0",
                "frame_rate": 20.0,
                "completed": 1,
                "total_frames": n,
                "source_geometry": "../input/geometry.h5",
                **attrs,
            }
        )
        series = file.create_group("time_series")
        series["time"] = (np.arange(n) * 0.05).astype("f4")
        series["nodes/positions"] = places
        series["nodes/velocities"] = np.zeros_like(places)
        series["nodes/kinetic_energy"] = np.zeros(places.shape[:2], "f4")
        series["elements/bars/strain"] = np.zeros((n, len(BARS)), "f4")
        series["elements/bars/stress"] = np.zeros((n, len(BARS)), "f4")
        series["elements/hinges/angle"] = np.full((n, 1), 3.0, "f4")
        shape = (n, 1) if two_dimensional_energy else (n,)
        for name in ("kinetic_energy", "potential_energy", "total_energy"):
            series[f"system/{name}"] = np.arange(n, dtype="f4").reshape(shape)
        series["system/damping_loss"] = np.zeros((n, 1), "f4")
        if stored_drive:
            series["actuation_signals/1"] = (places[:, 1] - REST[1]).astype("f4")
            series["elements/bars/lengths"] = np.ones((n, len(BARS)), "f4")
    return path


def write_inputs(folder, **settings):
    """Write geometry.h5, config.json and signals.h5 of the older layout."""
    folder.mkdir(parents=True)
    with h5py.File(folder / "geometry.h5", "w") as file:
        file["nodes/positions"] = REST
        file["nodes/masses"] = np.full(4, 0.01, "f4")
        file["nodes/attributes"] = np.array([1, 3, 0, 0], "u1")
        file["elements/bars/indices"] = BARS
        file["elements/bars/stiffness"] = np.array([100, -1, 50], "f4")
        file["elements/bars/rest_length"] = np.array([1, 1.1, 1.1], "f4")
        file["elements/bars/damping"] = np.array([0.1, 0, 0.1], "f4")
        file["elements/hinges/indices"] = np.array([[0, 1, 2, 3]], "i4")
        file["elements/hinges/stiffness"] = np.array([0.5], "f4")
        file["elements/hinges/phi0"] = np.array([3.5], "f4")
    config = {
        "simulation": {"duration": 2.0, "dt_base": 0.01, "dt_save": 0.05},
        "global_physics": {"gravity": 0.0},
        "actuators": [{"node_idx": 1, "signal_name": "push", "type": "position", "dof": [1, 1, 1]}],
        **settings,
    }
    (folder / "config.json").write_text(json.dumps(config))
    t = np.arange(401) * 0.005
    signal = np.repeat(REST[1][None].astype("f8"), len(t), axis=0)
    signal[:, 0] += 0.1 * np.sin(2 * t)
    with h5py.File(folder / "signals.h5", "w") as file:
        file.attrs["dt_base"] = 0.005
        file["push"] = signal
        file["pull"] = np.linspace(0, 1, 401)
    return folder


def convert(path, out, **options):
    with TrajectoryWriter(out, provenance=Provenance("legacy"), on_failure="discard") as writer:
        LegacyImporter().import_run(path, writer, options=options)
    return Trajectory(out)


def notes(run):
    return "\n".join(run.provenance["notes"])


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


# --- planar runs, recordings ---


def test_plane_run_has_two_dimensions(tmp_path):
    path = write_run(tmp_path / "a.h5", motion(planar=True), stored_drive=True)
    with h5py.File(path, "r+") as file:
        file["time_series/actuation_signals/1"][:, 2] = 0.0
    with convert(path, tmp_path / "run.h5") as run:
        assert run.dims == 2
        np.testing.assert_array_equal(run.positions(), motion(planar=True)[..., :2])
        assert run.input().columns == ("x", "y")
        assert "two dimensions" in notes(run)


def write_laboratory(path, *, missing=False):
    t = np.arange(60) / 29.97
    places = np.zeros((60, 3, 3))
    places[..., 0] = 100.0 * np.arange(3) + 5 * np.sin(t)[:, None]
    places[..., 1] = 50.0
    if missing:
        places[10:13, 1, 0] = np.nan
    with h5py.File(path, "w") as file:
        file.attrs["fps"] = 29.97
        file["time_series/time"] = t
        file["time_series/nodes/positions"] = places
        file["time_series/actuation_signals/2"] = np.cos(t)[:, None]
    return path


def test_laboratory_gaps_become_the_mask(tmp_path):
    path = write_laboratory(tmp_path / "lab.h5", missing=True)
    with convert(path, tmp_path / "run.h5") as run:
        expected = np.ones((60, 3), "u1")
        expected[10:13, 1] = 0
        np.testing.assert_array_equal(run.observed(), expected)
        assert np.isnan(run.positions()[10:13, 1]).all()
        assert "3 of 180 places are missing" in notes(run)
        assert "leave that node out" not in notes(run)


def test_unit_of_a_recording_can_be_said(tmp_path):
    path = write_laboratory(tmp_path / "lab.h5")
    with convert(path, tmp_path / "run.h5", unit="mm") as run:
        assert run.position_unit == "mm"
        assert run.input().unit == "mm"


def test_infinite_place_is_refused(tmp_path):
    path = write_laboratory(tmp_path / "lab.h5")
    with h5py.File(path, "r+") as file:
        file["time_series/nodes/positions"][7, 2, 1] = np.inf
    with pytest.raises(UnreadableFile, match=r"node 2 is at .* in frame 7"):
        convert(path, tmp_path / "run.h5")


def test_uneven_recording_keeps_its_times(tmp_path):
    path = tmp_path / "tracking_data.h5"
    stored = 1.7e9 + np.cumsum(np.random.default_rng(1).uniform(0.02, 0.05, 80))
    with h5py.File(path, "w") as file:
        file.attrs["fps"] = 30.0
        file["time"] = stored
        file["trajectories"] = np.random.default_rng(2).normal(size=(80, 4, 3))
    with convert(path, tmp_path / "run.h5") as run:
        np.testing.assert_array_equal(run.time, stored - stored[0])
        assert not run.uniform
        assert run.dims == 3


def test_displacement_is_one_channel(tmp_path):
    path = tmp_path / "displacement_slice.h5"
    values = np.sin(np.arange(90.0))
    with h5py.File(path, "w") as file:
        file.attrs.update({"fps": 29.97, "duration": 3.0, "start_frame": 374})
        file["displacement"] = values
    with convert(path, tmp_path / "run.h5") as run:
        assert run.dims == 0
        np.testing.assert_array_equal(run.channel("displacement")[:, 0], values)
        np.testing.assert_allclose(run.time, np.arange(90) / 29.97, rtol=1e-15)
        assert "frame 0 is frame 374" in notes(run)
        assert "arb" in notes(run)


def test_displacement_without_a_rate_is_refused(tmp_path):
    path = tmp_path / "displacement_slice.h5"
    with h5py.File(path, "w") as file:
        file.attrs["fps"] = 0.0
        file["displacement"] = np.zeros(5)
    with pytest.raises(UnreadableFile, match=r"the frame rate is 0.0"):
        convert(path, tmp_path / "run.h5")


# --- the older video tracker ---


STATUS = np.ones((30, 4), "u1") * 0
STATUS[0] = 5
STATUS[10:, 1] = 1
STATUS[20:, 2] = 3
STATUS[5:8, 3] = 4


def write_vision(path, *, calibration=None, part="trajectories", scale=(1.0, 1.0)):
    t = np.arange(30) / 25.0
    pixels = np.stack([100 + 10 * np.sin(t)[:, None] + [0, 20, 40, 60]] * 2, axis=-1)
    places = pixels / scale
    places[10:, 1] = np.nan
    with h5py.File(path, "w") as file:
        group = file.create_group(f"vision/{part}")
        group["positions"] = places
        group["status"] = STATUS
        group["timestamps"] = t
        group.attrs["fps"] = 25.0
        if part == "trajectories":
            group["positions_px"] = pixels.astype("f4")
            group["feature_ids"] = np.array([3, 5, 8, 13], "i4")
            group.attrs["calibration"] = json.dumps(calibration)
        source = file.create_group("vision/source")
        source.attrs["path"] = "C:\\clips\\fold.mp4"
    return pixels


def test_vision_file_goes_back_to_pixels(tmp_path):
    path = tmp_path / "vision.h5"
    calibration = {"kind": "normalized", "frame_shape": [480, 640]}
    pixels = write_vision(path, calibration=calibration, scale=(640.0, 480.0))
    assert LegacyImporter().sniff(path) == 1.0
    with convert(path, tmp_path / "run.h5") as run:
        assert (run.position_unit, run.dims) == ("px", 2)
        seen = run.observed()
        np.testing.assert_array_equal(seen == 0, np.isin(STATUS, (1, 2, 3)))
        np.testing.assert_array_equal(seen == 2, STATUS == 4)
        np.testing.assert_allclose(run.positions()[seen > 0], pixels[seen > 0], rtol=1e-15)
        assert np.isnan(run.positions()[seen == 0]).all()
        np.testing.assert_array_equal(run.node("id"), [3, 5, 8, 13])
        assert "10 places of points marked as lost have numbers" in notes(run)
        assert "video fold.mp4" in notes(run)
        assert "clips" not in notes(run)


@pytest.mark.parametrize(
    ("stated", "unit"), [("mm", "mm"), ("camera_normalized", "arb"), ("furlong", "arb")]
)
def test_vision_file_with_a_camera(tmp_path, stated, unit):
    path = tmp_path / "vision.h5"
    write_vision(path, calibration={"kind": "camera", "physical_units": stated})
    with convert(path, tmp_path / "run.h5") as run:
        assert run.position_unit == unit


def test_vision_file_with_raw_tracks_only(tmp_path):
    path = tmp_path / "vision.h5"
    pixels = write_vision(path, part="tracking")
    with convert(path, tmp_path / "run.h5") as run:
        seen = run.observed()
        np.testing.assert_array_equal(run.positions()[seen > 0], pixels[seen > 0])
        assert run.dt == pytest.approx(0.04)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("status", np.full((30, 4), 9, "u1"), "the code 9"),
        ("status", np.zeros((30, 3), "u1"), r"uint8 of shape \(30, 3\)"),
        ("timestamps", np.zeros(30), "time is 0.0 at frame 1"),
        ("timestamps", np.arange(29.0), "29 times"),
        ("positions", np.zeros((30, 8)), r"shape \(30, 8\)"),
    ],
)
def test_damaged_vision_file_is_named(tmp_path, name, value, words):
    path = tmp_path / "vision.h5"
    write_vision(path, part="tracking")
    with h5py.File(path, "r+") as file:
        del file[f"vision/tracking/{name}"]
        file[f"vision/tracking/{name}"] = value
    with pytest.raises(UnreadableFile, match=words):
        convert(path, tmp_path / "run.h5")


def test_vision_file_without_a_calibration_is_named(tmp_path):
    path = tmp_path / "vision.h5"
    write_vision(path, calibration=None)
    with pytest.raises(UnreadableFile, match="expected: a JSON object"):
        convert(path, tmp_path / "run.h5")


# --- what is not an old trajectory ---


def write_features(file):
    file["vision/feature_map/keypoints"] = np.zeros((5, 2), "f4")


def write_cache(file):
    file.attrs.update({"content_hash": "ab", "video_path": "a.mp4"})


def write_equilibria(file):
    file["equilibria/eq_000/positions"] = np.zeros((4, 3))


def write_narma(file):
    file["NARMA/narma2_nrmse"] = 0.4


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (write_features, "points detected in one image"),
        (write_cache, "points detected in one image"),
        (write_equilibria, "a list of equilibria"),
        (write_narma, "benchmark results"),
    ],
)
def test_other_files_are_refused_by_name(tmp_path, write, words):
    path = tmp_path / "file.h5"
    with h5py.File(path, "w") as file:
        write(file)
    assert LegacyImporter().sniff(path) >= 0.5
    with pytest.raises(NotATrajectory, match=words):
        convert(path, tmp_path / "run.h5")


def test_files_of_the_present_contract_are_not_claimed(experiment, tmp_path):
    out = tmp_path / "run.h5"
    convert(experiment, out).close()
    assert LegacyImporter().sniff(out) == 0.0
    out.replace(experiment / "output/simulation.h5")
    assert LegacyImporter().sniff(experiment) == 0.0
    with pytest.raises(UnreadableFile, match="none of the layouts"):
        convert(experiment, out)


def make_decoy(kind, path):
    if kind == "empty":
        path.write_bytes(b"")
    elif kind == "noise":
        path.write_bytes(np.random.default_rng(0).bytes(4096))
    elif kind == "text":
        path.write_text("time,x,y\n0,1,2\n")
    elif kind == "truncated":
        write_run(path, motion())
        path.write_bytes(path.read_bytes()[:3000])
    elif kind == "foreign":
        with h5py.File(path, "w") as file:
            file["particles/all/position/value"] = np.zeros((3, 4, 3))
    elif kind == "folder":
        path.mkdir()


@pytest.mark.parametrize("kind", ["empty", "noise", "text", "truncated", "foreign", "folder"])
def test_decoys_are_not_claimed_and_refused(kind, tmp_path):
    path = tmp_path / "simulation.h5"
    make_decoy(kind, path)
    assert LegacyImporter().sniff(path) < 0.5
    with pytest.raises(UnreadableFile):
        convert(path, tmp_path / "run.h5")
    assert not (tmp_path / "run.h5").exists()


def test_missing_path(tmp_path):
    assert LegacyImporter().sniff(tmp_path / "nothing") == 0.0
    with pytest.raises(UnreadableFile, match="does not exist"):
        convert(tmp_path / "nothing", tmp_path / "run.h5")


def test_external_link_is_refused(tmp_path):
    path = write_run(tmp_path / "a.h5", motion())
    with h5py.File(path, "r+") as file:
        file["elsewhere"] = h5py.ExternalLink("b.h5", "/secret")
    assert LegacyImporter().sniff(path) == 0.0
    with pytest.raises(UnsafeFile, match="external link"):
        convert(path, tmp_path / "run.h5")


@pytest.mark.parametrize("seed", range(20))
def test_flipped_bytes_end_in_a_named_error_or_a_file(seed, tmp_path):
    path = write_run(tmp_path / "a.h5", motion(), stored_drive=True)
    raw = bytearray(path.read_bytes())
    rng = np.random.default_rng(seed)
    for place in rng.integers(0, len(raw), 20):
        raw[place] ^= 1 << int(rng.integers(8))
    path.write_bytes(raw)
    out = tmp_path / "run.h5"
    try:
        convert(path, out).close()
    except OpenPRCError:
        assert not out.exists()
    else:
        assert out.exists()
