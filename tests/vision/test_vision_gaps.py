"""Gaps: filled between measurements, in time; never extrapolated, never touching a measurement."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from openprc.errors import ConfigError
from openprc.vision import Status, TrajectorySet
from openprc.vision.trajectories.gaps import fill_gaps, gap_lengths, rms_acceleration
from openprc.vision.trajectories.runs import is_uniform, neighbours, run_reach, time_holes

METHODS = ("linear", "pchip", "cubic")
FPS = 30.0


def tracks(motion, missing=(), *, times=None, n_frames=40, **attributes):
    """One point that follows `motion(t)` -> (T, 2), not seen in the frames of `missing`."""
    t = np.arange(n_frames) / FPS if times is None else np.asarray(times)
    positions = np.asarray(motion(t), dtype=float)[:, np.newaxis]
    positions[list(missing)] = np.nan
    return TrajectorySet(positions, t, **attributes)


def line(t):
    return np.stack([3.0 + 2.0 * t, 5.0 - 7.0 * t], axis=-1)


def parabola(t):
    return np.stack([4.0 * t**2, 1.0 - t**2], axis=-1)


@pytest.mark.parametrize("method", METHODS)
def test_a_straight_motion_is_filled_exactly(method):
    filled = tracks(line, range(10, 14)).fill_gaps(method)
    np.testing.assert_allclose(filled.positions[:, 0], line(filled.timestamps), atol=1e-12)
    assert filled.observed[:, 0].tolist() == [1] * 10 + [2] * 4 + [1] * 26
    assert (filled.status[10:14] == Status.INTERPOLATED).all()
    assert (np.delete(filled.status, range(10, 14)) == Status.TRACKED).all()


def test_a_cubic_motion_is_filled_exactly_by_the_spline():
    def motion(t):
        return np.stack([t**3 - t, 2 * t**2], axis=-1)

    for method, error in (("cubic", 1e-12), ("linear", 0.03)):
        filled = tracks(motion, range(10, 14)).fill_gaps(method)
        off = np.abs(filled.positions[:, 0] - motion(filled.timestamps)).max()
        assert off <= error
        assert (off > 1e-3) == (method == "linear")


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("missing", [range(7), range(30, 40), range(40)])
def test_nothing_is_extrapolated(method, missing):
    before = tracks(line, missing)
    after = before.fill_gaps(method)
    np.testing.assert_array_equal(after.positions, before.positions)
    np.testing.assert_array_equal(after.observed, before.observed)
    assert after.notes == ()


def test_the_step_of_the_older_tracker():
    """0 before and 10 after a gap: nothing but the way from 0 to 10 may come in between."""
    t = np.arange(20) / FPS
    x = np.where(t < t[10], 0.0, 10.0)
    x[8:12] = np.nan
    set_ = TrajectorySet(np.stack([x, x], axis=-1)[:, np.newaxis], t)
    for method in METHODS[:2]:
        filled = set_.fill_gaps(method).positions[:, 0, 0]
        assert (np.diff(filled) >= 0).all()
        assert filled.min() == 0.0
        assert filled.max() == 10.0


@pytest.mark.parametrize(("max_gap", "open_"), [(3, 4), (4, 0), (0, 4), (None, 0)])
def test_the_longest_gap_that_is_filled(max_gap, open_):
    set_ = tracks(line, range(10, 14)).fill_gaps("linear", max_gap=max_gap)
    assert np.isnan(set_.positions[:, 0, 0]).sum() == open_
    assert set_.operations[-1]["left"] == (1 if open_ else 0)


def test_dropped_frames_in_a_gap_count():
    """Three missing rows, but the camera lost twenty more frames meanwhile."""
    times = np.r_[np.arange(10), np.arange(30, 60)] / FPS
    set_ = tracks(line, range(9, 12), times=times)
    assert set_.fill_gaps("linear", max_gap=10).operations[-1]["left"] == 1
    assert set_.fill_gaps("linear", max_gap=22).operations[-1]["left"] == 1
    filled = set_.fill_gaps("linear", max_gap=23)
    np.testing.assert_allclose(filled.positions[:, 0], line(times), atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_interpolation_runs_in_time(method):
    times = np.cumsum(np.r_[0.0, np.tile([0.02, 0.05, 0.03], 13)])
    filled = tracks(line, range(10, 14), times=times).fill_gaps(method)
    np.testing.assert_allclose(filled.positions[:, 0], line(times), atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_nothing_is_carried_over_a_gap_that_stays_open(method):
    calm = tracks(parabola, [*range(8, 10), *range(15, 25)])
    wild = calm.positions.copy()
    wild[25:] += 1e6
    other = TrajectorySet(wild, calm.timestamps)
    first, second = calm.fill_gaps(method, max_gap=4), other.fill_gaps(method, max_gap=4)
    np.testing.assert_array_equal(first.positions[:15], second.positions[:15])
    assert np.isnan(first.positions[15:25]).all()


def test_sigma_grows_with_the_distance_from_the_measurements():
    sigma = np.full((40, 1, 2), 0.02)
    sigma[10:17] = np.nan
    filled = tracks(parabola, range(10, 17), sigma=sigma).fill_gaps("linear")
    grown = filled.sigma[10:17, 0, 0]
    assert grown.argmax() == 3
    np.testing.assert_allclose(grown, grown[::-1])
    np.testing.assert_array_equal(np.delete(filled.sigma, range(10, 17), axis=0), 0.02)
    # Acceleration 8 along x: half of it times the distances in time, and the line's own share.
    a = np.arange(1, 8) / FPS
    # Four frames apart: as far as half of the gap, or of any line over such a span.
    noise = np.sqrt(6 * 0.02**2) * (FPS / 4) ** 2
    alpha = np.sqrt(max(8.0**2 - noise**2, 0.0))
    w = np.arange(1, 8) / 8
    expected = np.sqrt(0.02**2 * (w**2 + (1 - w) ** 2) + (alpha / 2 * a * (8 / FPS - a)) ** 2)
    np.testing.assert_allclose(grown, expected, rtol=1e-9)


def test_sigma_covers_the_error_of_a_filled_oscillation():
    rng = np.random.default_rng(7)
    t = np.arange(3000) / FPS
    truth = np.stack([np.sin(9 * t), np.cos(9 * t)], axis=-1)
    sigma = np.full((3000, 1, 2), 0.002)
    measured = (truth + 0.002 * rng.standard_normal(truth.shape))[:, np.newaxis]
    gone = np.arange(3000) % 20 >= 14
    gone[:14], gone[-20:] = False, False
    measured[gone] = np.nan
    made = TrajectorySet(measured, t, sigma=sigma).fill_gaps("linear")
    score = ((made.positions - truth[:, np.newaxis]) / made.sigma)[gone]
    assert 0.7 < np.sqrt((score**2).mean()) < 1.3


def test_sigma_is_unknown_where_the_acceleration_is():
    sigma = np.full((6, 1, 2), 0.02)
    set_ = TrajectorySet(line(np.arange(6.0))[:, np.newaxis], np.arange(6.0), sigma=sigma)
    positions = set_.positions.copy()
    positions[[2, 3]] = np.nan
    alone = TrajectorySet(positions, np.arange(6.0), sigma=sigma).fill_gaps()
    assert np.isnan(alone.sigma[2:4]).all()
    assert np.isfinite(np.delete(alone.sigma, [2, 3], axis=0)).all()


def test_acceleration_of_a_parabola_on_an_uneven_clock():
    t = np.cumsum(np.r_[0.0, np.tile([0.02, 0.05, 0.03], 10)])
    found = rms_acceleration(parabola(t)[:, np.newaxis], t)
    np.testing.assert_allclose(found, [[8.0, 2.0]], rtol=1e-10)
    found = rms_acceleration(parabola(t)[:, np.newaxis], t, spacing=5)
    np.testing.assert_allclose(found, [[8.0, 2.0]], rtol=1e-10)
    assert np.isnan(rms_acceleration(np.zeros((2, 3, 2)), np.arange(2.0))).all()


def test_filling_says_what_it_did():
    set_ = tracks(line, [*range(5, 7), *range(10, 30)]).fill_gaps("pchip", max_gap=5)
    assert set_.notes == ("1 gaps (2 positions) were filled, pchip; 1 longer ones stay open",)
    assert set_.operations[-1] == {
        "operation": "fill_gaps", "method": "pchip", "max_gap": 5, "gaps": 1, "positions": 2,
        "left": 1,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("zero",), "unknown method 'zero'"),
        (("linear", -1), "max_gap is -1"),
        (("linear", 2.5), "max_gap is 2.5"),
    ],
)
def test_settings_that_make_no_sense(arguments, words):
    with pytest.raises(ConfigError, match=words):
        tracks(line).fill_gaps(*arguments)


# --- properties -------------------------------------------------------------------------------

masks = st.lists(st.booleans(), min_size=2, max_size=40).map(np.array)


@settings(max_examples=120, deadline=None)
@given(
    mask=masks,
    method=st.sampled_from(METHODS),
    max_gap=st.one_of(st.none(), st.integers(0, 8)),
    seed=st.integers(0, 2**32 - 1),
)
def test_filling_never_changes_a_measurement_and_never_leaves_their_span(
    mask, method, max_gap, seed
):
    rng = np.random.default_rng(seed)
    n = len(mask)
    times = np.cumsum(rng.uniform(0.5, 1.4, n))
    positions = rng.standard_normal((n, 1, 2))
    positions[~mask] = np.nan
    made = fill_gaps(positions, times, method=method, max_gap=max_gap)
    np.testing.assert_array_equal(made.positions[mask], positions[mask])
    filled = made.filled[:, 0]
    assert not (filled & mask).any()
    np.testing.assert_array_equal(np.isnan(made.positions[:, 0, 0]), ~mask & ~filled)
    seen = np.flatnonzero(mask)
    if len(seen):
        assert not filled[: seen[0]].any()
        assert not filled[seen[-1] :].any()
    else:
        assert not filled.any()
    if method != "cubic" and len(seen):
        low, high = np.nanmin(positions, axis=0), np.nanmax(positions, axis=0)
        assert (made.positions[filled] >= low - 1e-12).all()
        assert (made.positions[filled] <= high + 1e-12).all()
    lengths = gap_lengths(~np.isnan(positions[..., 0]), times)[:, 0]
    assert (filled == ((lengths > 0) & (True if max_gap is None else lengths <= max_gap))).all()
    again = fill_gaps(made.positions, times, method=method, max_gap=max_gap)
    assert not again.filled.any()
    np.testing.assert_array_equal(again.positions[filled | mask], made.positions[filled | mask])


@settings(max_examples=100, deadline=None)
@given(mask=masks)
def test_neighbours_and_reach_agree_with_a_plain_loop(mask):
    n = len(mask)
    before, after = neighbours(mask[:, np.newaxis])
    ahead, behind = run_reach(mask[:, np.newaxis])
    for i in range(n):
        seen = np.flatnonzero(mask)
        assert before[i, 0] == max(seen[seen <= i], default=-1)
        assert after[i, 0] == min(seen[seen >= i], default=n)
        start = stop = i
        while mask[i] and start > 0 and mask[start - 1]:
            start -= 1
        while mask[i] and stop < n - 1 and mask[stop + 1]:
            stop += 1
        assert (ahead[i, 0], behind[i, 0]) == (i - start, stop - i)


def test_runs_end_where_frames_were_dropped():
    times = np.r_[np.arange(4), np.arange(8, 12)] / FPS
    holes = time_holes(times)
    assert np.flatnonzero(holes).tolist() == [3]
    before, after = run_reach(np.ones((8, 1), bool), holes)
    assert before[:, 0].tolist() == [0, 1, 2, 3, 0, 1, 2, 3]
    assert after[:, 0].tolist() == [3, 2, 1, 0, 3, 2, 1, 0]
    assert is_uniform(times)
    assert not is_uniform(np.array([0.0, 1.0, 2.1, 3.0]))
    assert is_uniform(np.array([0.0]))
    assert len(time_holes(np.array([0.0]))) == 0
