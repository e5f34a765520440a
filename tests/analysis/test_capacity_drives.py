"""Drives that are not white, or not one."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from openprc.analysis.capacity import (
    CapacityWarning,
    information_processing_capacity,
    memory_capacity,
)
from openprc.errors import TaskError
from openprc.reservoir.training.row_split import RowSplit

HOLD = 33


@pytest.fixture(scope="module")
def splined():
    """Return symbols, their spline at 33 frames per symbol, and ten taps one symbol apart."""
    symbols = np.random.default_rng(1).uniform(-1, 1, 3000)
    instants = np.arange(3000 * HOLD) / HOLD
    frames = CubicSpline(np.arange(3000), symbols)(np.minimum(instants, 2999))
    states = np.stack([np.roll(frames, k * HOLD) for k in range(10)], axis=1)
    return symbols, frames, states


def test_one_row_per_symbol_holds_ten_inputs(splined):
    symbols, _, states = splined
    found = memory_capacity(states[::HOLD], symbols, max_delay=30, washout=40)
    assert found.linear == pytest.approx(10.0, abs=1e-6)
    assert found.corrected_total == pytest.approx(10.0, abs=0.1)
    # Chance adds 10 states over 21 delays.
    assert found.raw_total == pytest.approx(10.0 + 10 * 21 / 2960, abs=0.1)
    assert found.warnings == ()


def test_one_row_per_frame_is_told_and_stays_below_the_rank(splined):
    _, frames, states = splined
    part = slice(0, 6000)
    with pytest.warns(CapacityWarning, match=r"autocorrelation 0\.99.* at lag 1.*raw capacities"):
        found = memory_capacity(states[part], frames[part], max_delay=90, washout=400)
    assert found.orthonormal
    assert found.raw_total <= 10 + 1e-9
    assert found.total <= found.raw_total
    assert "circular surrogates" in found.metadata["threshold_rule"]
    with pytest.raises(TaskError, match=r"autocorrelation 0\.99.*\n.*\n.*one row per symbol"):
        memory_capacity(states[part], frames[part], max_delay=90, washout=400, coloured="refuse")


def test_one_row_per_frame_has_too_much_capacity_if_nobody_looks(splined):
    _, frames, states = splined
    with pytest.raises(TaskError, match=r"sum to 8\d\.\d+, and linear readouts of 10 independent"):
        memory_capacity(states, frames, max_delay=90, washout=400, coloured="ignore")


@pytest.mark.parametrize("degrees", [{1: 30}, {1: 30, 2: 30}])
def test_a_slow_drive_is_adapted_to(degrees):
    rng = np.random.default_rng(3)
    u = rng.normal(size=3000)
    for k in range(1, len(u)):
        u[k] += 0.9 * u[k - 1]
    states = np.stack([np.roll(u, k) for k in range(10)], axis=1)
    how = {"delays": degrees, "washout": 40}
    with pytest.raises(TaskError, match="linear readouts of 10 independent states have no more"):
        information_processing_capacity(states, u, coloured="ignore", **how)
    with pytest.warns(CapacityWarning, match="exactly orthonormalised targets"):
        found = information_processing_capacity(states, u, **how)
    # The body holds 10 inputs and nothing else; each target adds what is new in it.
    assert found.raw_total == pytest.approx(10, abs=1e-6)
    assert found.linear == pytest.approx(10, abs=1e-6)
    assert found.nonlinear == 0.0


def test_a_slow_drive_needs_more_rows_than_targets():
    u = np.cumsum(np.random.default_rng(2).normal(size=300))
    states = np.stack([u, np.roll(u, 1)], axis=1)
    with pytest.raises(TaskError, match=r"autocorrelation 0\.9.*495 targets over 270 rows"):
        information_processing_capacity(states, u, delays={2: 29, 1: 29}, washout=30)


def test_shifts_keep_chance_low_where_the_beta_distribution_does_not():
    """A slow drive and slow states that never met: nothing may count."""
    rng = np.random.default_rng(4)
    slow = rng.normal(size=(2000, 11))
    for k in range(1, len(slow)):
        slow[k] += 0.97 * slow[k - 1]
    u, states = slow[:, 0], slow[:, 1:]
    careless = memory_capacity(
        states, u, max_delay=20, coloured="ignore", excess="report", alpha=0.05
    )
    assert careless.n_significant > 10
    with pytest.warns(CapacityWarning, match="circular shifts"):
        found = memory_capacity(states, u, max_delay=20, alpha=0.05)
    assert found.n_significant == 0


def test_what_chance_adds_is_that_of_slow_series_too():
    """Smoothed noise against other smoothed noise: rank / (T - 1) is far too little to take off."""
    smooth = gaussian_filter1d(np.random.default_rng(1).normal(size=(2400, 21)), 8, axis=0)
    u, states = smooth[:, 0], smooth[:, 1:]
    with pytest.warns(CapacityWarning, match="circular shifts"):
        found = information_processing_capacity(states, u, delays={1: 12, 2: 6, 3: 3})
    assert found.n_significant == 0
    assert (found.raw - 20 / (found.n_rows - 1)).sum() > 1.5
    assert abs(found.corrected_total) < 0.4


def test_held_out_capacities_of_a_slow_drive_are_told():
    rng = np.random.default_rng(5)
    u = rng.normal(size=1500)
    for k in range(1, len(u)):
        u[k] += 0.9 * u[k - 1]
    states = np.stack([np.roll(u, k) for k in range(4)], axis=1)
    with pytest.warns(CapacityWarning) as told:
        found = memory_capacity(
            states, u, max_delay=15, split=RowSplit(20, 900, 500), estimator="heldout",
            excess="report",
        )  # fmt: skip
    assert "the sum of held-out capacities means nothing" in str(told[0].message)
    assert "circular surrogates" in found.metadata["threshold_rule"]
    assert any("the targets overlap" in str(one.message) for one in told)


def test_two_independent_inputs_and_their_product():
    rng = np.random.default_rng(6)
    u = rng.uniform(-1, 1, (4000, 2))
    centred = u - u.mean(axis=0)
    states = np.stack(
        [u[:, 0], np.roll(u[:, 1], 2), centred[:, 0] * np.roll(centred[:, 1], 1)], axis=1
    )
    found = information_processing_capacity(states, u, delays={1: 3, 2: 3}, washout=3)
    assert len(found.terms) == 8 + 36
    counted = [found.terms.labels()[k] for k in np.flatnonzero(found.values)]
    assert counted == ["P1(u0(t))", "P1(u1(t-2))", "P1(u0(t)) P1(u1(t-1))"]
    assert found.total == pytest.approx(3.0, abs=0.01)


def test_correlated_inputs_are_refused_or_whitened():
    rng = np.random.default_rng(7)
    first = rng.normal(size=4000)
    u = np.stack([first, 0.8 * first + 0.6 * rng.normal(size=4000)], axis=1)
    with pytest.raises(TaskError, match=r"inputs 0 and 1 are correlated \(0\.\d+\), so targets"):
        memory_capacity(u, u, max_delay=5)
    found = memory_capacity(u, u, max_delay=5, correlated="whiten")
    assert found.total == pytest.approx(2.0, abs=1e-9)
    assert "whitened in their order" in found.metadata["notes"][0]
    with pytest.raises(TaskError, match="one of them is a combination of the others"):
        memory_capacity(u, u[:, [0, 0]], max_delay=5, correlated="whiten")
    with pytest.raises(TaskError, match="correlated is 'keep'"):
        memory_capacity(u, u, max_delay=5, correlated="keep")
    with pytest.raises(TaskError, match="input 1 does not vary"):
        memory_capacity(u, u * [1, 0], max_delay=5)


@pytest.mark.parametrize(
    ("states", "u", "how", "words"),
    [
        (np.zeros(5), np.zeros(5), {}, r"the states have shape \(5,\)"),
        (np.eye(40), np.arange(39.0), {}, r"the input has shape \(39,\) and there are 40 rows"),
        (np.eye(40), np.full(40, np.nan), {}, "40 of 40 input values are NaN"),
        (np.ones((40, 3)), None, {}, "none of the 3 states changes over the 35 rows"),
        (np.full((40, 3), np.nan), None, {}, "35 of 35 rows of the states are NaN"),
        (np.eye(40), None, {}, "35 rows for 3[45] independent states"),
        (np.eye(40), None, {"washout": 40}, "the washout is 40 of 40 rows"),
        (np.eye(40), None, {"washout": 39}, "reach back 5 rows, and 1 rows are left"),
        (np.eye(40), None, {"usable": np.ones(3, dtype=bool)}, r"usable has shape \(3,\)"),
        (np.eye(40), None, {"split": RowSplit(0, 30, 20)}, "the split needs 50 rows and there"),
    ],
)
def test_unfit_data(states, u, how, words):
    u = np.random.default_rng(8).uniform(size=len(states)) if u is None else u
    with pytest.raises(TaskError, match=words):
        memory_capacity(states, u, max_delay=5, coloured="ignore", **how)


def test_a_warning_names_the_line_that_asked():
    u = np.cumsum(np.random.default_rng(9).normal(size=600))
    states = np.stack([u, np.roll(u, 1)], axis=1)
    with pytest.warns(CapacityWarning) as told:
        memory_capacity(states, u, max_delay=3)
    with pytest.warns(CapacityWarning) as also:
        information_processing_capacity(states, u, delays={1: 3})
    assert told[0].filename == also[0].filename == __file__
