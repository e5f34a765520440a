"""Another clock: exact for smooth motion, nothing made up beyond the measurements."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from openprc.errors import ConfigError
from openprc.vision import Status, TrajectorySet

UNEVEN = np.cumsum(np.r_[0.0, np.tile([0.02, 0.04, 0.03], 20)])


def motion(t):
    return np.stack([3.0 + 2.0 * t, 5.0 - 7.0 * t], axis=-1)[:, np.newaxis]


def tracks(missing=(), times=UNEVEN, **attributes):
    positions = motion(times)
    positions[list(missing)] = np.nan
    return TrajectorySet(positions, times, **attributes)


@pytest.mark.parametrize("method", ["cubic", "pchip", "linear"])
def test_a_straight_motion_on_an_even_clock(method):
    made = tracks().resample(50.0, method=method)
    steps = np.diff(made.timestamps)
    np.testing.assert_allclose(steps, 0.02)
    assert made.timestamps[-1] <= UNEVEN[-1] + 1e-9
    assert UNEVEN[-1] - made.timestamps[-1] < 0.02
    np.testing.assert_allclose(made.positions, motion(made.timestamps), atol=1e-12)
    assert (made.observed == 1).all()


def test_orders_of_the_methods():
    """Cubic splines gain 16 times with half the step, straight lines 4 times."""
    gains = {}
    for method in ("cubic", "linear"):
        errors = []
        for n in (40, 80):
            t = np.linspace(0, 1, n)
            wave = np.stack([np.sin(9 * t), np.cos(9 * t)], axis=-1)[:, np.newaxis]
            made = TrajectorySet(wave, t).resample(321.0, method=method)
            s = made.timestamps
            truth = np.stack([np.sin(9 * s), np.cos(9 * s)], axis=-1)[:, np.newaxis]
            errors.append(np.abs(made.positions - truth)[60:-60].max())
        gains[method] = errors[0] / errors[1]
    assert gains["cubic"] == pytest.approx(16, rel=0.25)
    assert gains["linear"] == pytest.approx(4, rel=0.25)


def test_gaps_stay_gaps():
    made = tracks(range(20, 25)).resample(200.0)
    inside = (made.timestamps > UNEVEN[19] + 1e-9) & (made.timestamps < UNEVEN[25] - 1e-9)
    np.testing.assert_array_equal(made.observed[:, 0] == 0, inside)
    assert (made.status[inside] == Status.LOST).all()
    assert (made.status[~inside] == Status.TRACKED).all()
    np.testing.assert_array_equal(np.isnan(made.positions[:, 0, 0]), inside)


@pytest.mark.parametrize("method", ["cubic", "pchip", "linear"])
def test_nothing_before_the_first_and_after_the_last_measurement(method):
    made = tracks([*range(5), *range(50, 61)]).resample(200.0, method=method)
    known = (made.timestamps >= UNEVEN[5] - 1e-9) & (made.timestamps <= UNEVEN[49] + 1e-9)
    np.testing.assert_array_equal(made.observed[:, 0] > 0, known)
    np.testing.assert_allclose(made.positions[known], motion(made.timestamps[known]), atol=1e-12)


def test_what_was_filled_stays_marked():
    made = tracks(range(20, 25)).fill_gaps().resample(200.0)
    inside = (made.timestamps > UNEVEN[19] + 1e-9) & (made.timestamps < UNEVEN[25] - 1e-9)
    np.testing.assert_array_equal(made.observed[:, 0] == 2, inside)
    assert (made.status[inside] == Status.INTERPOLATED).all()
    np.testing.assert_allclose(made.positions, motion(made.timestamps), atol=1e-12)


def test_instants_among_dropped_frames_count_as_filled():
    times = np.r_[np.arange(10), np.arange(16, 26)] / 30
    made = tracks(times=times).resample(30.0)
    assert np.flatnonzero(made.observed[:, 0] == 2).tolist() == [10, 11, 12, 13, 14, 15]
    assert (np.delete(made.observed[:, 0], range(10, 16)) == 1).all()


def test_frames_are_taken_as_they_are():
    rng = np.random.default_rng(2)
    positions = rng.standard_normal((20, 2, 2))
    positions[7, 1] = np.nan
    before = TrajectorySet(
        positions, np.arange(20) / 30, sigma=np.full((20, 2, 2), 0.1),
        quality=rng.uniform(size=(20, 2)), template=np.arange(40).reshape(20, 2),
    )  # fmt: skip
    after = before.resample(times=before.timestamps)
    for name in ("positions", "observed", "quality", "template", "status"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
    np.testing.assert_array_equal(after.sigma[after.observed > 0], 0.1)
    assert np.isnan(after.sigma[7, 1]).all()
    assert before.resample(30.0).n_frames == 20


def test_sigma_between_frames_is_that_of_the_frames_and_grows_with_the_motion():
    t = np.arange(40) / 30
    still = np.zeros((40, 1, 2))
    sigma = np.full((40, 1, 2), 0.01)
    made = TrajectorySet(still, t, sigma=sigma).resample(100.0)
    np.testing.assert_allclose(made.sigma, 0.01)
    swing = np.stack([np.sin(40 * t), np.cos(40 * t)], axis=-1)[:, np.newaxis]
    made = TrajectorySet(swing, t, sigma=sigma).resample(100.0)
    assert made.sigma.max() > 0.05


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({}, "neither a rate nor times"),
        ({"rate": 10.0, "times": [0.0, 1.0]}, "both a rate and times"),
        ({"rate": 0.0}, "a rate of 0.0 Hz"),
        ({"rate": float("nan")}, "a rate of nan Hz"),
        ({"rate": 0.01}, "has 1 instant"),
        ({"times": [0.0, 5.0]}, "instants from 0 to 5 s"),
        ({"times": [-0.1, 0.5]}, "instants from -0.1 to 0.5 s"),
        ({"times": [0.5, 0.1]}, "do not increase"),
        ({"times": [[0.1]]}, "do not increase"),
        ({"rate": 10.0, "method": "nearest"}, "unknown method 'nearest'"),
    ],
)
def test_clocks_that_make_no_sense(arguments, words):
    with pytest.raises(ConfigError, match=words):
        tracks().resample(**arguments)


@settings(max_examples=80, deadline=None)
@given(
    mask=st.lists(st.booleans(), min_size=2, max_size=30).map(np.array),
    method=st.sampled_from(["pchip", "linear"]),
    rate=st.floats(1.3, 9.0),
    seed=st.integers(0, 2**32 - 1),
)
def test_values_lie_between_the_neighbouring_measurements(mask, method, rate, seed):
    rng = np.random.default_rng(seed)
    n = len(mask)
    times = np.cumsum(rng.uniform(0.8, 1.2, n))
    positions = rng.standard_normal((n, 1, 2))
    positions[~mask] = np.nan
    made = TrajectorySet(positions, times).resample(rate, method=method)
    left = np.clip(np.searchsorted(times, made.timestamps, side="right") - 1, 0, n - 2)
    low = np.minimum(positions[left], positions[left + 1])
    high = np.maximum(positions[left], positions[left + 1])
    known = made.observed[:, 0] > 0
    both = mask[left] & mask[left + 1]
    assert (known[both]).all()
    assert (made.positions[both] >= low[both] - 1e-12).all()
    assert (made.positions[both] <= high[both] + 1e-12).all()
    # An instant at a frame needs that frame only.
    exact = np.isclose(made.timestamps[:, None], times).any(axis=1)
    assert not known[~both & ~exact].any()
