"""Recordings of two cameras joined: clocks, gaps, wrong partners, and the offset between clocks."""

from __future__ import annotations

import numpy as np
import pytest
from stereo_rigs import converging, recording, swinging

from openprc.errors import CalibrationError
from openprc.vision.calibration.stereo_clock import estimate_time_offset, on_clock
from openprc.vision.tracking.status import Status

RIG = converging(30.0)


def both(times, others=None, **options):
    """Recordings of swinging points on one clock, or on two."""
    left = RIG.to_pixels(swinging(times, **options))[0]
    others = times if others is None else others
    return left, RIG.to_pixels(swinging(others, **options))[1]


def test_joined_frame_by_frame():
    times = np.arange(30) / 60.0
    left, right = both(times)
    left[5, 2] = np.nan
    right[7, 3] = np.nan
    tset = RIG.triangulate(recording(left, times), recording(right, times))
    truth = swinging(times)
    assert tset.positions.shape == (30, 6, 3)
    missing = np.isnan(tset.positions).all(axis=2)
    assert np.argwhere(missing).tolist() == [[5, 2], [7, 3]]
    assert np.abs(tset.positions - truth)[~missing].max() < 1e-9
    assert tset.status[5, 2] == tset.status[7, 3] == Status.LOST
    assert np.array_equal(tset.observed == 0, missing)
    assert (tset.units, tset.axes, tset.frame) == ("mm", ("x", "y", "z"), "left camera")
    assert np.array_equal(tset.timestamps, times)
    assert np.nanmax(tset.quality) < 1e-6
    # 15 um across, 55 um along the direction of view.
    across, along = np.nanmean(tset.sigma[..., 1]), np.nanmean(tset.sigma[..., 2])
    assert across == pytest.approx(0.0145, rel=0.1)
    assert along == pytest.approx(0.054, rel=0.1)


def test_a_reason_of_the_right_camera_is_kept():
    times = np.arange(10) / 60.0
    left, right = both(times)
    right[4, 1] = np.nan
    status = np.zeros((10, 6), np.uint8)
    status[4, 1] = Status.OOB
    tset = RIG.triangulate(recording(left, times), recording(right, times, status=status))
    assert tset.status[4, 1] == Status.OOB


def test_a_wrong_partner_is_missing():
    times = np.arange(10) / 60.0
    left, right = both(times)
    right[3, 0] += [0.0, 30.0]
    tset = RIG.triangulate(recording(left, times), recording(right, times))
    assert np.isnan(tset.positions[3, 0]).all()
    assert tset.status[3, 0] == Status.DRIFT
    assert any("1 positions have a reprojection error above 5 px" in note for note in tset.notes)
    kept = RIG.triangulate(recording(left, times), recording(right, times), max_error=100.0)
    assert np.isfinite(kept.positions[3, 0]).all()


def test_another_clock_is_interpolated_and_never_extrapolated():
    times = np.arange(60) / 60.0
    others = 0.013 + np.arange(45) / 50.0
    left, right = both(times, others)
    # The right camera's own clock began 0.25 s later.
    tset = RIG.triangulate(
        recording(left, times), recording(right, others - 0.25), time_offset=0.25
    )
    inside = (times >= others[0]) & (times <= others[-1])
    seen = np.isfinite(tset.positions).all(axis=(1, 2))
    assert np.array_equal(seen, inside)
    # Cubic in time: 2 pi 1.3 Hz x 20 ms is 0.16 rad, and 0.16^4 x 3/128 of 8 mm is 0.1 um; its
    # ends are linear: 0.16^2 / 8 of 8 mm.
    error = np.abs(tset.positions - swinging(times))[seen]
    assert np.median(error) < 1e-3
    assert error.max() < 0.15
    assert any("interpolated to the left camera's 60 times" in note for note in tset.notes)


def test_recordings_without_common_time():
    times = np.arange(10) / 60.0
    left, right = both(times)
    with pytest.raises(CalibrationError, match=r"time_offset = 5 s"):
        RIG.triangulate(recording(left, times), recording(right, times), time_offset=5.0)


def test_recordings_of_other_points():
    times = np.arange(10) / 60.0
    left, right = both(times)
    with pytest.raises(CalibrationError, match="has 6 points, the right one 5"):
        RIG.triangulate(recording(left, times), recording(right[:, :5], times))


def test_sets_in_pixels_and_sets_without():
    from openprc.vision.trajectories.trajectory_set import TrajectorySet

    times = np.arange(10) / 60.0
    sets = [TrajectorySet.from_tracking_result(recording(p, times)) for p in both(times)]
    tset = RIG.triangulate(*sets)
    assert np.abs(tset.positions - swinging(times)).max() < 1e-9
    gone = TrajectorySet(sets[0].positions, times, units="mm")
    with pytest.raises(CalibrationError, match="in mm and have no pixels"):
        RIG.triangulate(gone, sets[1])


# --- clocks -----------------------------------------------------------------------------------


def test_on_clock_is_exact_for_cubics():
    times = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
    clock = np.array([-0.5, 0.0, 1.5, 2.25, 3.9, 5.0, 5.01])
    found = on_clock(times, (times**3 - times)[:, None], clock)[:, 0]
    assert found[1:6] == pytest.approx(clock[1:6] ** 3 - clock[1:6], abs=1e-12)
    assert np.isnan(found[[0, 6]]).all()


def test_on_clock_beside_missing_samples_and_holes():
    times = np.array([0.0, 1.0, 2.0, 3.0, 7.0, 8.0, 9.0, 10.0])
    values = (2.0 * times)[:, None]
    values[2] = np.nan
    found = on_clock(times, values, np.array([0.5, 1.5, 2.5, 5.0, 7.5, 9.5]))[:, 0]
    assert np.isnan(found[[1, 2, 3]]).all()
    assert found[[0, 4, 5]] == pytest.approx([1.0, 15.0, 19.0])


def test_on_clock_of_nothing():
    assert np.isnan(on_clock(np.zeros(0), np.zeros((0, 2)), np.array([0.0, 1.0]))).all()


@pytest.mark.parametrize("offset", [0.0, 0.1234, -0.31])
def test_time_offset_from_the_motion(offset):
    # The phase of the second clock is no multiple of the lags that are tried.
    times, others = np.arange(240) / 60.0, 0.0013 + np.arange(200) / 50.0
    rng = np.random.default_rng(3)
    left, right = both(times, others)
    found = estimate_time_offset(
        recording(left + 0.05 * rng.standard_normal(left.shape), times),
        recording(right + 0.05 * rng.standard_normal(right.shape), others - offset),
        max_offset=0.6,
    )
    assert found.seconds == pytest.approx(offset, abs=3e-4)
    assert found.correlation > 0.99
    assert found.sigma < 0.02


def test_a_periodic_motion_is_ambiguous():
    times = np.arange(300) / 60.0
    wave = 20.0 * np.sin(2 * np.pi * 2.0 * times)[:, None, None] + np.array([100.0, 200.0])
    found = estimate_time_offset(recording(wave, times), recording(wave, times), max_offset=1.0)
    assert "repeats itself" in found.notes[0]


def test_no_time_offset():
    times = np.arange(60) / 60.0
    left, right = both(times)
    still = recording(np.ones((60, 2, 2)), times)
    with pytest.raises(CalibrationError, match="nothing moves in the left"):
        estimate_time_offset(still, recording(right, times))
    with pytest.raises(CalibrationError, match="5 frames"):
        estimate_time_offset(recording(left[:5], times[:5]), recording(right, times))
    rng = np.random.default_rng(0)
    noise = [rng.standard_normal((400, 3, 2)) for _ in range(2)]
    clock = np.arange(400) / 60.0
    with pytest.raises(CalibrationError, match="do not agree"):
        estimate_time_offset(*(recording(n, clock) for n in noise), max_offset=1.0)
