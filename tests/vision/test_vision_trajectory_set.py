"""`TrajectorySet`: made from tracks, calibrated, chosen from; never changed."""

from __future__ import annotations

import dataclasses
import subprocess
import sys

import numpy as np
import pytest

from openprc.errors import ConfigError, UnitError
from openprc.vision import (
    NormalizedCalibration,
    ScaleBar,
    Status,
    TrackingResult,
    TrajectorySet,
)

T, N = 30, 5


@pytest.fixture
def result():
    t = np.arange(T) / 25.0
    phase = 2 * np.pi * t[:, None] + np.arange(N)
    positions = np.stack([100 + 5 * np.sin(phase), 60 + 3 * np.cos(phase)], axis=2)
    status = np.zeros((T, N), np.uint8)
    status[0] = Status.REFERENCE
    for frames, point, code in (
        (slice(10, 14), 1, Status.LOST),
        (slice(20, None), 2, Status.OOB),
        (slice(5, 6), 3, Status.DRIFT),
    ):
        status[frames, point] = code
    positions[np.isin(status, (1, 2, 3))] = np.nan
    rng = np.random.default_rng(4)
    return TrackingResult(
        positions=positions,
        status=status,
        timestamps=t,
        quality=rng.uniform(0.9, 1.0, (T, N)).astype("f4"),
        sigma=np.full((T, N, 2), 0.02, "f4"),
        template=np.zeros((T, N), "i4"),
        feature_ids=np.array([3, 5, 8, 13, 21]),
        notes=("a remark",),
    )


def test_pixels_stay_pixels(result):
    tracks = TrajectorySet.from_tracking_result(result)
    np.testing.assert_array_equal(tracks.positions, result.positions)
    assert (tracks.n_frames, tracks.n_features, tracks.dims, len(tracks)) == (T, N, 2, N)
    assert (tracks.units, tracks.axes, tracks.frame) == ("px", ("x", "y"), "image")
    assert tracks.fps == pytest.approx(25.0)
    assert tracks.duration == pytest.approx(29 / 25)
    np.testing.assert_array_equal(tracks.observed == 0, np.isnan(result.positions[..., 0]))
    np.testing.assert_array_equal(tracks.feature_ids, [3, 5, 8, 13, 21])
    np.testing.assert_array_equal(tracks.track_ratios(), result.track_ratios())
    assert tracks.notes == ("a remark",)
    assert np.isnan(tracks.sigma[10:14, 1]).all()
    assert np.isfinite(tracks.sigma[tracks.observed > 0]).all()


def test_a_place_of_a_lost_point_is_no_measurement(result):
    result.positions[12, 1] = (1.0, 2.0)
    tracks = TrajectorySet.from_tracking_result(result)
    assert np.isnan(tracks.positions[12, 1]).all()
    assert tracks.observed[12, 1] == 0


def test_interpolated_points_of_a_result_are_marked(result):
    result.positions[12, 1] = (1.0, 2.0)
    result.status[12, 1] = Status.INTERPOLATED
    assert TrajectorySet.from_tracking_result(result).observed[12, 1] == 2


def test_calibration_goes_with_positions_and_sigma(result):
    bar = ScaleBar((0.0, 0.0), (100.0, 0.0), 20.0, "mm")
    tracks = TrajectorySet.from_tracking_result(result, calibration=bar)
    assert tracks.units == "mm"
    assert tracks.calibration == bar
    seen = tracks.observed > 0
    np.testing.assert_allclose(tracks.positions[seen], 0.2 * result.positions[seen])
    np.testing.assert_allclose(tracks.sigma[seen], 0.2 * 0.02, rtol=1e-6)
    np.testing.assert_array_equal(tracks.positions_px, result.positions)
    assert tracks.metadata["operations"] == [{"operation": "calibrate", "units": "mm"}]


def test_what_a_calibration_distorts_is_noted(result):
    calibration = NormalizedCalibration((120, 200))
    tracks = TrajectorySet.from_tracking_result(result, calibration=calibration)
    assert tracks.units == "1"
    assert any("distorted" in note for note in tracks.notes)
    np.testing.assert_allclose(
        np.nanmean(tracks.positions, axis=(0, 1)),
        np.nanmean(result.positions, axis=(0, 1)) / (200, 120),
    )


def test_points_that_are_never_seen_survive(result):
    result.positions[:, 0] = np.nan
    result.status[:, 0] = Status.LOST
    bar = ScaleBar((0.0, 0.0), (100.0, 0.0), 20.0, "mm")
    tracks = TrajectorySet.from_tracking_result(result, calibration=bar)
    assert (tracks.observed[:, 0] == 0).all()
    made = tracks.fill_gaps().smooth(3)
    assert np.isnan(made.positions[:, 0]).all()
    assert np.isnan(made.velocities()[:, 0]).all()
    assert np.isnan(made.to_signals(1, "magnitude")[:, 0]).all()
    assert np.isnan(made.to_signals(1, "path")[:, 0]).all()
    assert np.isnan(made.resample(10.0).positions[:, 0]).all()


def test_the_printed_pipeline(result):
    tracks = TrajectorySet.from_tracking_result(result)
    good = result.track_ratios() >= 0.8
    made = tracks.select_features(good).fill_gaps("linear", max_gap=10).smooth(5)
    assert made.n_features == 4
    assert [item["operation"] for item in made.operations] == [
        "select_features", "fill_gaps", "smooth",
    ]  # fmt: skip
    assert np.isfinite(made.to_signals(dim=2)).all()
    assert made.units == "px"
    np.testing.assert_array_equal(made.feature_ids, [3, 5, 13, 21])


OPERATIONS = {
    "select_features": lambda s: s.select_features([0, 1]),
    "select_tracked": lambda s: s.select_tracked(0.9),
    "select_moving": lambda s: s.select_moving(3.0),
    "trim": lambda s: s.trim(0.1, 0.9),
    "fill_gaps": lambda s: s.fill_gaps("cubic", max_gap=10),
    "smooth": lambda s: s.smooth(5),
    "resample": lambda s: s.resample(40.0),
    "remove_camera_motion": lambda s: s.remove_camera_motion([0, 4]),
}


@pytest.mark.parametrize("name", OPERATIONS)
def test_operations_leave_the_set_alone_and_are_recorded(result, name):
    tracks = TrajectorySet.from_tracking_result(result)
    before = {
        field.name: np.copy(getattr(tracks, field.name)) for field in dataclasses.fields(tracks)
    }
    made = OPERATIONS[name](tracks)
    for field, value in before.items():
        np.testing.assert_array_equal(getattr(tracks, field), value)
    assert made is not tracks
    assert made.operations[-1]["operation"] == name
    assert tracks.operations == ()
    with pytest.raises(dataclasses.FrozenInstanceError):
        made.units = "mm"
    for array in (made.positions, made.observed, made.status, made.sigma):
        assert array.shape[:2] == (made.n_frames, made.n_features)
    np.testing.assert_array_equal(made.observed == 0, np.isnan(made.positions).any(axis=2))


def test_features_by_mask_and_by_index(result):
    tracks = TrajectorySet.from_tracking_result(result)
    mask = np.array([True, False, True, False, False])
    for chosen in (mask, [0, 2], np.array([0, 2], "u2")):
        made = tracks.select_features(chosen)
        np.testing.assert_array_equal(made.feature_ids, [3, 8])
        np.testing.assert_array_equal(made.quality, tracks.quality[:, [0, 2]])
        np.testing.assert_array_equal(made.positions_px, tracks.positions_px[:, [0, 2]])
    np.testing.assert_array_equal(tracks.select_features([4, 0]).feature_ids, [21, 3])


@pytest.mark.parametrize(
    ("mask", "words"),
    [
        (np.ones(4, bool), r"bool of shape \(4,\)"),
        (np.zeros(5, bool), "none of the 5 points is left"),
        ([5], "point 5 of 5"),
        ([-1], "point -1 of 5"),
        ([0.5, 1.5], "float64 of shape"),
        ([], "float64 of shape"),
    ],
)
def test_masks_that_do_not_fit(result, mask, words):
    with pytest.raises(ConfigError, match=words):
        TrajectorySet.from_tracking_result(result).select_features(mask)


def test_trimming_is_in_seconds(result):
    tracks = TrajectorySet.from_tracking_result(result).trim(0.2, 0.8)
    np.testing.assert_allclose(tracks.timestamps[[0, -1]], [0.2, 0.8])
    assert tracks.n_frames == 16
    assert TrajectorySet.from_tracking_result(result).trim(start_time=1.0).n_frames == 5
    with pytest.raises(ConfigError, match="no frame between 5 and 6 s"):
        tracks.trim(5, 6)


def test_three_dimensions_by_hand():
    positions = np.random.default_rng(0).standard_normal((8, 3, 3))
    tracks = TrajectorySet(positions, np.arange(8.0), units="mm", frame="world")
    assert (tracks.dims, tracks.axes) == (3, ("x", "y", "z"))
    np.testing.assert_array_equal(tracks.to_signals(3), positions)
    np.testing.assert_array_equal(tracks.to_signals(2), positions[..., :2])
    np.testing.assert_array_equal(tracks.to_signals(1, "z"), positions[..., 2])
    assert (tracks.observed == 1).all()
    assert (tracks.status == Status.TRACKED).all()


GOOD = {"positions": np.zeros((4, 2, 2)), "timestamps": np.arange(4.0)}
HALF = np.zeros((4, 2, 2))
HALF[1, 1, 0] = np.nan


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"positions": np.zeros((4, 2))}, r"shape \(4, 2\)"),
        ({"positions": np.zeros((4, 2, 4))}, r"shape \(4, 2, 4\)"),
        ({"positions": np.full((4, 2, 2), np.inf)}, "an infinite position"),
        ({"positions": HALF}, "NaN in some axes"),
        ({"timestamps": np.arange(3.0)}, r"times of shape \(3,\)"),
        ({"timestamps": np.array([0.0, 1.0, 1.0, 2.0])}, "increasing seconds"),
        ({"timestamps": np.array([0.0, 1.0, np.nan, 2.0])}, "increasing seconds"),
        ({"status": np.zeros((4, 3))}, "status: shape"),
        ({"observed": np.zeros((4, 2))}, "marks and NaN disagree"),
        ({"observed": np.full((4, 2), 3)}, "a mark of 3"),
        ({"sigma": np.zeros((4, 2))}, "sigma: shape"),
        ({"quality": np.zeros((4, 1))}, "quality: shape"),
        ({"feature_ids": np.arange(3)}, "feature_ids: shape"),
        ({"axes": ("x",)}, "axes"),
    ],
)
def test_arrays_that_do_not_fit_together(changes, words):
    with pytest.raises(ConfigError, match=words):
        TrajectorySet(**{**GOOD, **changes})


def test_units_come_from_the_closed_list():
    with pytest.raises(UnitError, match="inch"):
        TrajectorySet(**GOOD, units="inch")


def test_nothing_heavy_is_imported_on_the_way():
    code = (
        "import sys; from openprc.vision import TrajectorySet, save, load, info; "
        "print([m for m in ('cv2', 'numba', 'scipy', 'matplotlib') if m in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
