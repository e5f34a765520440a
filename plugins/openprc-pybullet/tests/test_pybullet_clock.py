"""dt from float32 stamps and printed times."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from openprc_pybullet.clock import regular_clock, simplest_between, step_of_stamps

from openprc.errors import ConfigError, MissingData, NonUniformTime


@pytest.mark.parametrize("dt", [1 / 240, 1 / 1000, 1 / 500, 0.01, 1 / 60, 0.0123, 2.5e-4, 1 / 4800])
@pytest.mark.parametrize("steps", [2, 50, 20_000])
def test_step_is_recovered_exactly(dt, steps):
    count = np.arange(steps)
    stamps = (count * dt).astype(np.float32)
    found = step_of_stamps(count, stamps, given=None, file="x.log")
    assert found == pytest.approx(dt, rel=1e-15 if steps > 100 else 2e-7)


@given(st.fractions(1, 50, max_denominator=20), st.fractions(1, 50, max_denominator=20))
@settings(max_examples=50, deadline=None)
def test_simplest_fraction_by_search(a, b):
    low, high = float(min(a, b)), float(max(a, b))
    found = simplest_between(low, high)
    exact = Fraction(found).limit_denominator(400)
    assert low <= found <= high
    for denominator in range(1, exact.denominator):
        first = -(-Fraction(low) * denominator // 1)
        assert first > Fraction(high) * denominator


def test_one_step_needs_dt():
    zero = np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.float32)
    with pytest.raises(MissingData, match="holds one step"):
        step_of_stamps(*zero, given=None, file="x.log")
    assert step_of_stamps(*zero, given=0.01, file="x.log") == 0.01


def test_step_that_changes_is_refused():
    count = np.arange(100)
    stamps = np.where(count < 50, count * 0.01, count * 0.02).astype(np.float32)
    with pytest.raises(NonUniformTime, match="the time step was changed while logging"):
        step_of_stamps(count, stamps, given=None, file="x.log")


def test_given_step_must_agree():
    count = np.arange(100)
    stamps = (count / 240).astype(np.float32)
    assert step_of_stamps(count, stamps, given=0.0041666667, file="x") == 0.0041666667
    with pytest.raises(ConfigError, match=r"dt=0\.01 s is given"):
        step_of_stamps(count, stamps, given=0.01, file="x.log")


@pytest.mark.parametrize("decimals", [4, 6])
@pytest.mark.parametrize("first", [0, 1, 10])
def test_printed_times_are_put_back(decimals, first):
    exact = (first + np.arange(500)) / 240
    found = regular_clock(np.round(exact, decimals), 0.5000001 * 10.0**-decimals)
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    "times", [[0.0, 0.1], [0.0, 0.1, 0.1, 0.2], [0.0, 0.1, 0.25, 0.3], [-0.3, -0.2, -0.1, 0.0]]
)
def test_other_times_are_left_alone(times):
    assert regular_clock(np.array(times), 5e-7) is None
