"""The clock of a trajectory: uniform, uneven, pseudo."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import (
    NonUniformTime,
)
from openprc.schema import Trajectory, validate_file


@pytest.fixture
def trajectory(complete):
    with Trajectory(complete) as opened:
        yield opened


# --- the clock --------------------------------------------------------------------------------

STEPS = [0.1, 0.01, 0.001, 0.3, 0.7, 1 / 3, 1 / 240, 1 / 30, 2e-5, 1e-9, 0.25, 7.0, 86400.0]


# Not a nanosecond at 1000 s: there the spacing of float64 is no millionth of the step.
CLOCKS = [(dt, t0) for dt in STEPS for t0 in (0.0, 0.3, -2.5, 1000.0) if dt > 1e-6 or t0 < 1000]


@pytest.mark.parametrize(("dt", "t0"), CLOCKS)
def test_uniform_clock_is_recognised_and_exact(make_small, dt, t0):
    time = t0 + np.arange(40) * dt
    with Trajectory(make_small(time=time)) as trajectory:
        assert trajectory.uniform
        assert trajectory.t0 == t0
        assert trajectory.dt == pytest.approx(dt, rel=1e-12 if abs(t0) < 10 else 1e-9)
        np.testing.assert_array_equal(trajectory.time, time)


@pytest.mark.parametrize("dt", [0.1, 0.01, 0.001, 0.3, 0.7, 0.05, 2e-5, 0.025])
@pytest.mark.parametrize("n", [2, 3, 10, 1000])
def test_decimal_step_comes_back_as_the_decimal(make_small, dt, n):
    with Trajectory(make_small(time=np.arange(n) * dt)) as trajectory:
        assert trajectory.dt == dt


def test_step_that_is_accumulated_is_still_uniform(make_small):
    time = np.cumsum(np.full(200, 0.1))
    with Trajectory(make_small(time=time)) as trajectory:
        assert trajectory.dt == pytest.approx(0.1, rel=1e-12)


@pytest.mark.parametrize(
    ("duration", "dt", "steps"), [(0.3, 0.1, 3), (0.7, 0.1, 7), (2.3, 0.1, 23)]
)
def test_duration_over_step_is_a_whole_number_of_frames(make_small, duration, dt, steps):
    assert int(duration / dt) in (steps, steps - 1)  # the trap
    with Trajectory(make_small(time=np.arange(steps + 1) * dt)) as trajectory:
        assert round((trajectory.time[-1] - trajectory.t0) / trajectory.dt) == steps
        assert trajectory.n_frames == steps + 1


@pytest.mark.parametrize(
    "time",
    [[0.0, 0.1, 0.3], [0.0, 0.1, 0.2 + 1e-6], [0.0, 1.0, 2.0, 2.9999], [0.0]],
    ids=["gap", "a little late", "last frame early", "single frame"],
)
def test_uneven_clock_has_no_step(make_small, time):
    with Trajectory(make_small(time=time)) as trajectory:
        assert not trajectory.uniform
        assert trajectory.t0 == 0.0
        with pytest.raises(NonUniformTime, match="not evenly spaced"):
            _ = trajectory.dt
    assert validate_file(trajectory.path).ok


def test_uneven_clock_says_how_uneven(make_small):
    with (
        Trajectory(make_small(time=[0.0, 0.1, 0.35])) as trajectory,
        pytest.raises(NonUniformTime, match=r"steps from 0\.1 to 0\.25[\s\S]*resample"),
    ):
        _ = trajectory.dt


def test_pseudo_time(make_small):
    path = make_small(time=[1, 2, 3], clock={"kind": "pseudo", "unit": "1"})
    with Trajectory(path) as trajectory:
        assert (trajectory.time_kind, trajectory.time_unit) == ("pseudo", "1")
        assert trajectory.dt == 1.0


def test_milliseconds(make_small):
    path = make_small(time=[0, 20, 40], clock={"unit": "ms"})
    with Trajectory(path) as trajectory:
        assert (trajectory.dt, trajectory.time_unit, trajectory.time_kind) == (
            20.0,
            "ms",
            "physical",
        )
