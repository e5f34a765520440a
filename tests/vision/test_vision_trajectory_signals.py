"""Signals and velocities: closed forms, and NaN only where nothing is known."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import ConfigError
from openprc.vision import TrajectorySet

UNEVEN = np.cumsum(np.r_[0.0, np.tile([0.02, 0.05, 0.03], 13)])


def circle(n=41, *, radius=2.0, missing=()):
    """One point once around a circle, in n frames of 1 s."""
    angle = np.linspace(0, 2 * np.pi, n)
    positions = radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)[:, np.newaxis]
    positions[list(missing)] = np.nan
    return TrajectorySet(positions, np.arange(n, dtype=float), units="mm"), angle


def test_components():
    tracks, angle = circle()
    np.testing.assert_allclose(tracks.to_signals(1)[:, 0], 2 * np.cos(angle))
    np.testing.assert_allclose(tracks.to_signals(1, "y")[:, 0], 2 * np.sin(angle))
    np.testing.assert_array_equal(tracks.to_signals(), tracks.positions)
    np.testing.assert_array_equal(tracks.to_signals(1, axis="y"), tracks.to_signals(1, "y"))


def test_magnitude_is_the_chord_from_where_a_point_was_first_seen():
    tracks, angle = circle()
    chord = 4 * np.sin(angle / 2)
    np.testing.assert_allclose(tracks.to_signals(1, "magnitude")[:, 0], chord, atol=1e-12)
    planar = tracks.to_signals(3)
    np.testing.assert_allclose(planar[:, 0, 2], chord, atol=1e-12)
    np.testing.assert_array_equal(planar[..., :2], tracks.positions)
    late, angle = circle(missing=range(10))
    expected = 4 * np.sin((angle[10:] - angle[10]) / 2)
    np.testing.assert_allclose(late.to_signals(1, "magnitude")[10:, 0], expected, atol=1e-12)
    far = tracks.to_signals(1, "magnitude", reference=np.zeros((1, 2)))
    np.testing.assert_allclose(far, 2.0)


def test_path_length_is_the_sum_of_the_chords():
    tracks, angle = circle()
    steps = 4 * np.sin(np.diff(angle) / 2)
    expected = np.r_[0.0, np.cumsum(steps)]
    for name in ("path", "distance"):
        np.testing.assert_allclose(tracks.to_signals(1, name)[:, 0], expected)
    assert expected[-1] == pytest.approx(4 * np.pi, rel=2e-3)


def test_missing_is_missing_and_no_zero():
    """The older tracker gave displacement 0 where it saw nothing."""
    gone = [*range(3), *range(15, 18), *range(38, 41)]
    tracks, _ = circle(missing=gone)
    for name in ("x", "y", "magnitude"):
        signal = tracks.to_signals(1, name)[:, 0]
        np.testing.assert_array_equal(np.flatnonzero(np.isnan(signal)), gone)
    assert np.isnan(tracks.speeds()[gone]).all()
    np.testing.assert_array_equal(
        np.isnan(tracks.to_signals(3)).any(axis=(1, 2)).nonzero()[0], gone
    )


def test_path_length_is_not_known_after_a_gap_unless_it_is_filled():
    tracks, _ = circle(missing=[*range(3), *range(15, 18)])
    path = tracks.to_signals(1, "path")[:, 0]
    assert np.isnan(path[:3]).all()
    assert path[3] == 0.0
    assert (np.diff(path[3:15]) > 0).all()
    assert np.isnan(path[15:]).all()
    filled = tracks.fill_gaps("linear", max_gap=5).to_signals(1, "path")[:, 0]
    assert np.isfinite(filled[3:]).all()
    assert (np.diff(filled[3:]) > 0).all()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((1, "z"), "no component 'z' of positions in 2 dimensions"),
        ((1, "radius"), "no component 'radius'"),
        ((4,), "dim is 4"),
        ((0,), "dim is 0"),
    ],
)
def test_signals_that_are_not_there(arguments, words):
    with pytest.raises(ConfigError, match=words):
        circle()[0].to_signals(*arguments)


def test_a_reference_for_every_point():
    with pytest.raises(ConfigError, match=r"reference positions of shape \(2,\)"):
        circle()[0].to_signals(1, "magnitude", reference=np.zeros(2))


# --- velocities -------------------------------------------------------------------------------


def parabola(times):
    positions = np.stack([3 * times**2 - times, 1 - 2 * times**2], axis=-1)[:, np.newaxis]
    return positions, np.stack([6 * times - 1, -4 * times], axis=-1)[:, np.newaxis]


@pytest.mark.parametrize("times", [np.arange(12) / 30, UNEVEN], ids=["even", "uneven"])
def test_velocity_of_a_parabola_is_exact_to_the_ends(times):
    positions, wanted = parabola(times)
    found = TrajectorySet(positions, times)
    np.testing.assert_allclose(found.velocities(), wanted, atol=1e-11)
    np.testing.assert_allclose(found.speeds(), np.linalg.norm(wanted, axis=2), atol=1e-11)


@pytest.mark.parametrize("times", [np.arange(30) / 30, UNEVEN[:30]], ids=["even", "uneven"])
def test_nan_is_only_where_nothing_is_known(times):
    positions, wanted = parabola(times)
    gone = [0, 5, 9, 10, 14, 16, 29]
    positions[gone] = np.nan
    found = TrajectorySet(positions, times).velocities()
    lonely = [15]  # between two missing frames
    known = np.setdiff1d(np.arange(30), [*gone, *lonely])
    assert np.isnan(found[gone + lonely]).all()
    assert np.isfinite(found[known]).all()
    np.testing.assert_allclose(found[known], wanted[known], atol=1e-11)


def test_two_measurements_have_one_slope():
    times = np.array([0.0, 1.0, 3.0, 4.0])
    positions = np.array([[0.0, 0.0], [2.0, -2.0], [np.nan, np.nan], [5.0, 5.0]])[:, np.newaxis]
    found = TrajectorySet(positions, times).velocities()[:, 0]
    np.testing.assert_array_equal(found[:2], [[2.0, -2.0]] * 2)
    assert np.isnan(found[2:]).all()
    alone = TrajectorySet(positions[:1], times[:1])
    assert np.isnan(alone.velocities()).all()
    assert np.isnan(alone.fps)


def test_velocities_converge_with_the_square_of_the_step():
    errors = []
    for n in (50, 100, 200):
        times = np.linspace(0, 1, n)
        times[1:-1] += 0.2 / n * np.sin(40 * times[1:-1])
        wave = np.stack([np.sin(7 * times), np.cos(5 * times)], axis=-1)[:, np.newaxis]
        found = TrajectorySet(wave, times).velocities()
        slope = np.stack([7 * np.cos(7 * times), -5 * np.sin(5 * times)], axis=-1)[:, np.newaxis]
        errors.append(np.abs(found - slope).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 1.8).all(), orders
