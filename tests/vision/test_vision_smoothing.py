"""Smoothing: exact for what it ought to leave alone, and nothing crosses a gap."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import savgol_filter

from openprc.errors import ConfigError
from openprc.vision import TrajectorySet
from openprc.vision.trajectories.smoothing import smooth

FPS = 100.0
UNEVEN = np.cumsum(np.r_[0.0, np.tile([0.009, 0.012, 0.01], 20)])


def one(values, times=None):
    """One point whose x is `values` and whose y is minus that."""
    x = np.asarray(values, dtype=float)
    t = np.arange(len(x)) / FPS if times is None else times
    return np.stack([x, -x], axis=-1)[:, np.newaxis], t


@pytest.mark.parametrize("method", ["mean", "savgol"])
@pytest.mark.parametrize("times", [None, UNEVEN], ids=["even", "uneven"])
def test_a_straight_motion_is_left_alone(method, times):
    t = np.arange(61) / FPS if times is None else times
    positions, t = one(3.0 - 5.0 * t, times)
    made = smooth(positions, t, window=7, method=method)
    np.testing.assert_allclose(made.positions, positions, atol=1e-12)


@pytest.mark.parametrize("times", [None, UNEVEN], ids=["even", "uneven"])
def test_the_polynomial_leaves_polynomials_alone(times):
    t = np.arange(61) / FPS if times is None else times
    positions, t = one(1 + 2 * t - 30 * t**2 + 40 * t**3, times)
    made = smooth(positions, t, window=9, method="savgol", polyorder=3)
    np.testing.assert_allclose(made.positions, positions, atol=1e-11)
    assert np.abs(smooth(positions, t, window=9).positions - positions).max() > 1e-3


def test_the_average_is_the_mean_of_the_window_and_shrinks_on_both_sides():
    rng = np.random.default_rng(3)
    x = rng.standard_normal(20)
    positions, t = one(x)
    found = smooth(positions, t, window=5).positions[:, 0, 0]
    for i in range(20):
        h = min(2, i, 19 - i)
        assert found[i] == pytest.approx(x[i - h : i + h + 1].mean(), abs=1e-12)


def test_the_polynomial_is_that_of_scipy():
    x = np.random.default_rng(5).standard_normal(50)
    positions, t = one(x)
    found = smooth(positions, t, window=11, method="savgol", polyorder=3).positions[:, 0, 0]
    np.testing.assert_allclose(found, savgol_filter(x, 11, 3, mode="interp"), atol=1e-12)


@pytest.mark.parametrize(
    ("method", "share", "gain"),
    [("mean", 10, 0.647), ("mean", 5, 0.0), ("savgol", 10, 0.9875), ("savgol", 5, 0.836)],
)
def test_frequency_response(method, share, gain):
    """An average of 5 takes 35 % off a motion at a tenth of the frame rate, the polynomial 1 %."""
    t = np.arange(400) / FPS
    positions, t = one(np.sin(2 * np.pi * FPS / share * t + 0.3))
    made = smooth(positions, t, window=5, method=method).positions[10:-10, 0, 0]
    assert np.sqrt(2 * (made[:370] ** 2).mean()) == pytest.approx(gain, abs=5e-4)
    if method == "mean":
        formula = abs(np.sin(np.pi * 5 / share) / (5 * np.sin(np.pi / share)))
        assert formula == pytest.approx(gain, abs=5e-4)
    phase = (made * np.sin(2 * np.pi * FPS / share * t[10:-10] + 0.3)).sum()
    assert phase >= -1e-9


def test_no_phase_shift_at_the_ends_of_a_run():
    t = np.arange(30) / FPS
    positions, t = one(t)
    positions[12:15] = np.nan
    made = smooth(positions, t, window=9).positions
    np.testing.assert_allclose(made, positions, atol=1e-12, equal_nan=True)


@pytest.mark.parametrize("method", ["mean", "savgol"])
@pytest.mark.parametrize("times", [None, UNEVEN[:20]], ids=["even", "uneven"])
def test_nothing_crosses_a_gap(method, times):
    """The older tracker made 2, 4 | 6, 8 of 0, 0 | 10, 10."""
    x = np.r_[np.zeros(8), [np.nan] * 3, np.full(9, 10.0)]
    positions, t = one(x, times)
    made = smooth(positions, t, window=5, method=method).positions[:, 0, 0]
    np.testing.assert_allclose(made, x, atol=1e-12, equal_nan=True)


def test_nothing_crosses_dropped_frames():
    x = np.r_[np.zeros(8), np.full(9, 10.0)]
    times = np.r_[np.arange(8), np.arange(20, 29)] / FPS
    positions, t = one(x, times)
    np.testing.assert_allclose(smooth(positions, t).positions[:, 0, 0], x, atol=1e-12)


@pytest.mark.parametrize(
    ("length", "order", "changed"), [(1, 2, False), (3, 2, False), (4, 2, False), (5, 2, True)]
)
def test_short_runs_get_the_polynomial_that_fits_or_stay(length, order, changed):
    x = np.full(30, np.nan)
    x[:15] = np.random.default_rng(1).standard_normal(15)
    x[20 : 20 + length] = np.random.default_rng(2).standard_normal(length)
    positions, t = one(x)
    made = smooth(positions, t, window=9, method="savgol", polyorder=order)
    found = made.positions[20 : 20 + length, 0, 0]
    assert made.n_short == 1
    if changed:
        wanted = savgol_filter(x[20 : 20 + length], length - (length + 1) % 2, order)
        np.testing.assert_allclose(found, wanted, atol=1e-12)
    else:
        np.testing.assert_allclose(found, x[20 : 20 + length], atol=1e-12)


@pytest.mark.parametrize(("method", "left"), [("mean", 1 / 5), ("savgol", 17 / 35)])
def test_sigma_of_white_noise(method, left):
    rng = np.random.default_rng(11)
    sigma = np.full((4000, 1, 2), 0.3)
    positions = 0.3 * rng.standard_normal((4000, 1, 2))
    made = smooth(positions, np.arange(4000) / FPS, window=5, method=method, sigma=sigma)
    inner = slice(5, -5)
    np.testing.assert_allclose(made.sigma[inner] ** 2, 0.09 * left, rtol=1e-9)
    assert made.positions[inner].std() == pytest.approx(0.3 * np.sqrt(left), rel=0.03)
    assert made.sigma[0, 0, 0] == pytest.approx(0.3 if method == "mean" else 0.282, rel=0.01)


def test_a_window_of_one_changes_nothing():
    positions, t = one(np.random.default_rng(0).standard_normal(9))
    np.testing.assert_array_equal(smooth(positions, t, window=1).positions, positions)


def test_settings_are_kept_and_short_runs_are_told():
    positions, t = one(np.r_[np.arange(12.0), np.nan, 1.0, 2.0])
    made = TrajectorySet(positions, t).smooth(5, "savgol", polyorder=3)
    assert made.operations == (
        {"operation": "smooth", "window": 5, "method": "savgol", "polyorder": 3},
    )
    assert made.notes == ("1 runs are shorter than the smoothing window of 5 frames",)
    np.testing.assert_array_equal(made.observed[:, 0], [1] * 12 + [0, 1, 1])


@pytest.mark.parametrize(
    ("settings_", "words"),
    [
        ({"window": 4}, "a window of 4 frames"),
        ({"window": 0}, "a window of 0 frames"),
        ({"window": 5.0}, r"a window of 5\.0 frames"),
        ({"method": "median"}, "unknown method 'median'"),
        ({"method": "savgol", "polyorder": 5}, "order 5 in a window of 5"),
        ({"method": "savgol", "polyorder": -1}, "order -1"),
    ],
)
def test_settings_that_make_no_sense(settings_, words):
    positions, t = one(np.zeros(9))
    with pytest.raises(ConfigError, match=words):
        smooth(positions, t, **settings_)


# --- properties -------------------------------------------------------------------------------


@settings(max_examples=100, deadline=None)
@given(
    mask=st.lists(st.booleans(), min_size=1, max_size=40).map(np.array),
    half=st.integers(0, 6),
    method=st.sampled_from(["mean", "savgol"]),
    even=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_runs_are_smoothed_as_if_each_were_alone(mask, half, method, even, seed):
    rng = np.random.default_rng(seed)
    n, window, order = len(mask), 2 * half + 1, min(2, 2 * half)
    times = np.arange(n) / FPS if even else np.cumsum(rng.uniform(0.9, 1.1, n)) / FPS
    positions = rng.standard_normal((n, 1, 2))
    positions[~mask] = np.nan
    options = {"window": window, "method": method, "polyorder": order}
    made = smooth(positions, times, **options)
    np.testing.assert_array_equal(np.isnan(made.positions), np.isnan(positions))
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(int))).reshape(-1, 2)
    for start, stop in edges:
        alone = np.full_like(positions, np.nan)
        alone[start:stop] = positions[start:stop]
        np.testing.assert_array_equal(
            smooth(alone, times, **options).positions[start:stop], made.positions[start:stop]
        )


@settings(max_examples=100, deadline=None)
@given(
    mask=st.lists(st.booleans(), min_size=1, max_size=40).map(np.array),
    half=st.integers(1, 6),
    order=st.integers(0, 4),
    even=st.booleans(),
    level=st.floats(-1e3, 1e3),
    slope=st.floats(-1e3, 1e3),
    seed=st.integers(0, 2**32 - 1),
)
def test_constants_and_lines_are_exact_between_any_gaps(
    mask, half, order, even, level, slope, seed
):
    rng = np.random.default_rng(seed)
    n, window = len(mask), 2 * half + 1
    times = np.arange(n) / FPS if even else np.cumsum(rng.uniform(0.8, 1.2, n)) / FPS
    order = min(order, window - 1)
    x = level + (slope * times if order >= 1 else 0.0 * times)
    positions = np.stack([x, x], axis=-1)[:, np.newaxis]
    positions[~mask] = np.nan
    scale = 1.0 + np.abs(x).max()
    for method in ("mean", "savgol"):
        made = smooth(positions, times, window=window, method=method, polyorder=order)
        np.testing.assert_allclose(made.positions, positions, atol=1e-10 * scale, equal_nan=True)
