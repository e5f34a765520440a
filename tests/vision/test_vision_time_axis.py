"""The time axis from stamps: constant, rounded, variable, with holes, without sense."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import ConfigError, VideoError
from openprc.vision import TimeAxis

NTSC = 30000 / 1001


def axis(stamps, declared=30.0, **options):
    return TimeAxis.from_stamps(stamps, declared_fps=declared, **options)


@pytest.mark.parametrize("start", [0.0, 0.08, 1234.5])
def test_exact_stamps_of_a_constant_rate(start):
    found = axis(start + np.arange(200) / 30)
    np.testing.assert_allclose(found.times, np.arange(200) / 30, rtol=0, atol=1e-12)
    assert found.uniform
    assert found.dt == pytest.approx(1 / 30, rel=1e-12)
    assert (found.dropped, found.duplicated, found.notes) == ((), (), ())
    assert "30 Hz" in found.how


@pytest.mark.parametrize("rate", [24.0, 25.0, NTSC, 60.0, 239.76, 37.3, 500.0, 1000.0, 4000.0])
@pytest.mark.parametrize("rounding", [np.rint, np.floor])
def test_whole_milliseconds_of_a_constant_rate(rate, rounding):
    stamps = rounding(1e3 * np.arange(400) / rate) / 1e3
    found = axis(stamps, rate)
    np.testing.assert_allclose(found.times, np.arange(400) / rate, rtol=0, atol=1e-9)
    assert found.uniform
    assert not found.dropped
    assert found.notes == ()


@pytest.mark.parametrize("declared", [0.0, np.nan, 1000.0, -1.0, 90000.0])
@pytest.mark.parametrize("rate", [30.0, NTSC, 25.0, 240.0])
def test_rate_is_found_where_the_declared_one_is_wrong(declared, rate):
    stamps = np.rint(1e3 * np.arange(600) / rate) / 1e3
    found = axis(stamps, declared)
    assert found.uniform
    np.testing.assert_allclose(found.times, np.arange(600) / rate, rtol=0, atol=1e-9)


def test_rate_that_nobody_lists_is_fitted():
    stamps = np.rint(1e3 * np.arange(600) / 37.3) / 1e3
    found = axis(stamps, 0.0)
    assert found.uniform
    # Rounding by half a millisecond over 600 frames bounds the error of the rate.
    assert found.rate == pytest.approx(37.3, abs=37.3 * 1e-3 / (599 / 37.3))


def test_quicktime_units_of_a_constant_rate():
    stamps = np.rint(600 * np.arange(300) / NTSC) / 600
    found = axis(stamps, NTSC)
    assert found.uniform
    assert found.dt == pytest.approx(1 / NTSC, rel=1e-12)


@pytest.mark.parametrize("unit", [None, 1e-3])
def test_holes_are_counted_in_frames(unit):
    places = np.delete(np.arange(120), [40, 41, 42, 90])
    stamps = places / 30
    if unit:
        stamps = np.rint(stamps / unit) * unit
    found = axis(stamps)
    np.testing.assert_allclose(found.times, places / 30, rtol=0, atol=1e-9)
    assert [(drop.after, drop.missing) for drop in found.dropped] == [(39, 3), (86, 1)]
    assert found.dropped[0].seconds == pytest.approx(4 / 30)
    assert found.missing == 4
    assert not found.uniform
    assert found.dt == pytest.approx(1 / 30)
    assert "2 holes" in found.notes[0]


def test_variable_rate_keeps_the_stamps():
    rng = np.random.default_rng(3)
    stamps = np.cumsum(rng.integers(15, 54, 300)) / 1e3
    found = axis(stamps, 26.0)
    np.testing.assert_array_equal(found.times, stamps - stamps[0])
    assert found.dt is None
    assert not found.uniform
    assert not found.dropped
    assert "variable" in found.how


def test_hole_in_a_variable_rate():
    rng = np.random.default_rng(4)
    steps = rng.integers(28, 39, 200) / 1e3
    steps[120] = 0.4
    found = axis(np.cumsum(steps), 30.0)
    (drop,) = found.dropped
    # A step leads from the frame before it: step 120 from frame 119.
    assert drop.after == 119
    assert drop.seconds == pytest.approx(0.4)
    assert 9 <= drop.missing <= 13


def test_stamps_that_are_missing_at_the_end_are_counted_on():
    stamps = np.arange(120) / 30
    stamps[119] = 0.0
    found = axis(stamps)
    np.testing.assert_allclose(found.times, np.arange(120) / 30, rtol=0, atol=1e-12)
    assert "1 frame without a time stamp" in found.notes[0]


def test_stamps_that_are_missing_in_the_middle_and_at_the_start():
    stamps = np.arange(50) / 25
    stamps[[0, 1, 20]] = np.nan
    found = axis(stamps, 25.0)
    np.testing.assert_allclose(found.times, np.arange(50) / 25, rtol=0, atol=1e-12)
    assert "3 frames without" in found.notes[0]


@pytest.mark.parametrize("stamps", [np.full(20, np.nan), np.zeros(20)], ids=["nan", "zero"])
def test_no_stamps_at_all_count_with_the_declared_rate(stamps):
    found = axis(stamps, 50.0)
    np.testing.assert_allclose(found.times, np.arange(20) / 50)
    assert found.uniform
    assert "declared" in found.how


def test_stamps_that_step_back_are_not_believed():
    stamps = np.arange(30) / 30
    stamps[17] = stamps[11]
    found = axis(stamps)
    np.testing.assert_allclose(found.times, np.arange(30) / 30)
    assert "do not increase" in found.notes[0]
    with pytest.raises(VideoError, match="do not increase"):
        axis(stamps, strict=True)


@pytest.mark.parametrize("declared", [0.0, np.nan, np.inf, -5.0])
def test_neither_stamps_nor_rate(declared):
    with pytest.raises(ConfigError, match=r"no time stamps and the declared rate(.|\n)*option fps"):
        axis(np.full(5, np.nan), declared)


@pytest.mark.parametrize("fps", [0, -3, np.nan, np.inf])
def test_rate_that_is_none(fps):
    with pytest.raises(ConfigError, match="fps is"):
        axis(np.arange(5) / 30, fps=fps)


def test_rate_of_the_user_wins_and_holes_keep_their_length_in_frames():
    places = np.delete(np.arange(50), [20, 21])
    found = axis(places / 30, fps=15000.0)
    np.testing.assert_allclose(found.times, places / 15000, rtol=1e-12)
    assert found.dt == pytest.approx(1 / 15000)
    assert [drop.missing for drop in found.dropped] == [2]


def test_rate_of_the_user_wins_over_a_variable_rate():
    stamps = np.cumsum(np.random.default_rng(3).integers(15, 54, 50)) / 1e3
    found = axis(stamps, fps=30.0)
    np.testing.assert_allclose(found.times, np.arange(50) / 30)
    assert "not regular and not used" in found.how


def test_counts_and_duplicates_are_reported():
    stamps = np.arange(10) / 30
    found = axis(stamps, declared_frames=14, duplicated=(3, 4))
    assert found.duplicated == (3, 4)
    assert "declares 14 frames and delivered 10" in found.notes[0]
    assert "2 frames equal to the one before" in found.notes[1]
    for options in ({"declared_frames": 14}, {"duplicated": (3,)}):
        with pytest.raises(VideoError, match="strict"):
            axis(stamps, strict=True, **options)
    assert axis(stamps, strict=True, declared_frames=10).notes == ()


@pytest.mark.parametrize("declared", [0, -9223372036854775808])
def test_count_that_says_nothing_is_no_fault(declared):
    assert axis(np.arange(10) / 30, declared_frames=declared, strict=True).notes == ()


@pytest.mark.parametrize("start", [0.0, 1.7e9])
def test_times_since_1970(start):
    places = np.delete(np.arange(200), [50])
    found = axis(start + places / 120, 120.0)
    np.testing.assert_allclose(found.times, places / 120, rtol=0, atol=1e-9)
    assert [drop.after for drop in found.dropped] == [49]


@pytest.mark.parametrize("count", [2, 3, 4])
@pytest.mark.parametrize("declared", [25.0, np.nan])
def test_few_frames(count, declared):
    found = axis(np.arange(count) / 25, declared)
    np.testing.assert_allclose(found.times, np.arange(count) / 25, rtol=0, atol=1e-12)
    assert found.uniform


def test_one_frame():
    assert axis([0.3]).times.tolist() == [0.0]
    with pytest.raises(VideoError, match="no frame was decoded"):
        axis([])
