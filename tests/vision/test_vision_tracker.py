"""The default tracker on clips whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.vision import ArraySource, KLTConfig, Status, Tracker
from openprc.vision.synth import cases

SHAPE = (200, 260)


def grid(step=28, margin=24, shape=SHAPE):
    x, y = np.meshgrid(
        np.arange(margin, shape[1] - margin, step), np.arange(margin, shape[0] - margin, step)
    )
    return np.stack([x.ravel(), y.ravel()], axis=1) + 0.3


def track(clip, points=None, **settings):
    points = grid() if points is None else points
    result = Tracker(clip.source(), points, config=KLTConfig(**settings)).run()
    return result, clip.truth(points), clip.visible(points, margin=12)


def errors(result, truth):
    """Distances [px] of all positions that were given out."""
    return np.linalg.norm(result.positions - truth, axis=2)[result.status == Status.TRACKED]


@pytest.mark.parametrize(
    ("name", "bound"),
    [("translation", 0.012), ("affine", 0.012), ("rotation", 0.012), ("fold", 0.014)],
)
def test_deformed_surroundings_are_followed_to_a_hundredth_of_a_pixel(name, bound):
    clip = cases.case(name, n_frames=11, shape=SHAPE)
    result, truth, visible = track(clip)
    assert np.sqrt((errors(result, truth) ** 2).mean()) < bound
    assert result.seen[visible].mean() > 0.99
    assert result.template_updates().max() == 0


def test_flicker_of_a_quarter_moves_and_loses_nothing():
    clip = cases.case("flicker", n_frames=16, shape=SHAPE)
    result, truth, _ = track(clip)
    assert np.sqrt((errors(result, truth) ** 2).mean()) < 0.02
    assert result.seen.all()


def test_motion_of_24_px_a_frame_is_followed():
    clip = cases.case("very-fast", n_frames=11, shape=SHAPE)
    result, truth, visible = track(clip)
    assert errors(result, truth).max() < 0.1
    assert result.seen[visible].mean() > 0.98


@pytest.mark.parametrize("name", ["occlusion", "wave-occlusion"])
def test_what_a_bar_has_hidden_is_found_again_and_nothing_follows_the_bar(name):
    clip = cases.case(name, n_frames=24, shape=SHAPE)
    result, truth, visible = track(clip)
    assert errors(result, truth).max() < 0.5
    hidden = ~visible.all(axis=0) & visible[-1]
    assert hidden.sum() > 10
    assert (result.status[:, hidden] != Status.TRACKED).any(axis=0).all()
    assert result.seen[-1][hidden].mean() >= 0.99
    assert np.isnan(result.positions[~result.seen]).all()


def test_without_reacquisition_a_hidden_point_stays_lost():
    clip = cases.case("occlusion", n_frames=24, shape=SHAPE)
    result, _, visible = track(clip, reacquire=False)
    hidden = ~visible.all(axis=0) & visible[-1]
    assert not result.seen[-1][hidden].all()
    gone = ~result.seen
    assert (gone[1:] | ~gone[:-1]).all()


def test_a_few_blank_frames_are_bridged():
    clip = cases.case("translation", n_frames=16, shape=SHAPE)
    frames = list(clip.frames())
    for k in (6, 7, 8):
        frames[k] = np.full(SHAPE, 9, np.uint8)
    points = grid()
    result = Tracker(ArraySource(frames, fps=30.0), points).run()
    assert not result.seen[6:9].any()
    assert result.seen[10:].mean() > 0.99
    assert errors(result, clip.truth(points)).max() < 0.1
    assert any("no point was found in 3 frames" in note for note in result.notes)


def test_a_body_that_moves_on_its_own_is_not_held_against_its_neighbours():
    still = np.stack(list(cases.case("translation", n_frames=1, shape=SHAPE, seed=1).frames()))[0]
    other = np.stack(list(cases.case("translation", n_frames=1, shape=SHAPE, seed=2).frames()))[0]
    frames = []
    for k in range(12):
        frame = still.copy()
        frame[60:140, 60 + 4 * k : 140 + 4 * k] = other[60:140, 60:140]
        frames.append(frame)
    points = np.array([(90.0, 90.0), (100, 110), (85, 105), (115, 95), (110, 112), (100, 85)])
    around = grid(step=20, margin=14)
    apart = (around[:, 0] < 46) | (around[:, 0] > 200) | (around[:, 1] < 46) | (around[:, 1] > 154)
    result = Tracker(ArraySource(frames, fps=30.0), np.vstack([points, around[apart]])).run()
    moved = result.positions[-1, : len(points)] - points
    np.testing.assert_allclose(moved, [[44.0, 0.0]] * len(points), atol=0.02)
    assert result.seen.all()


def test_sigma_is_the_spread_of_the_errors():
    clip = cases.case("translation", noise=3.0, n_frames=11, shape=SHAPE)
    result, truth, _ = track(clip)
    tracked = result.status == Status.TRACKED
    ratio = ((result.positions - truth) / result.sigma)[tracked]
    assert np.sqrt((ratio**2).mean()) == pytest.approx(1.0, abs=0.15)
    assert result.noise == pytest.approx(3.0, rel=0.3)


def test_deformation_is_that_of_the_motion():
    clip = cases.case("rotation", n_frames=11, shape=SHAPE)
    result, _, _ = track(clip)
    last = result.deformation[-1][result.seen[-1]]
    angle = np.degrees(np.arctan2(last[:, 1, 0] - last[:, 0, 1], last[:, 0, 0] + last[:, 1, 1]))
    np.testing.assert_allclose(angle, 10.0 * (1 - np.cos(np.pi / 2)), atol=0.3)


def test_stripes_leave_a_direction_open_and_their_points_are_refused_or_uncertain():
    rng = np.random.default_rng(0)
    y = np.arange(SHAPE[0], dtype=float)[:, None]
    frames = [
        np.rint(
            128 + 60 * np.sin((y - 0.2 * k) / 3.0) + np.zeros(SHAPE) + rng.normal(0, 1, SHAPE)
        ).astype(np.uint8)
        for k in range(5)
    ]
    result = Tracker(ArraySource(frames, fps=30.0), grid()).run()
    tracked = result.status == Status.TRACKED
    across = np.abs(result.positions - result.positions[0])[..., 0][tracked]
    assert (across < 1.0).all()
    assert tracked.mean() < 0.05


def test_a_repeated_frame_is_told_and_repeats_the_tracks():
    clip = cases.case("translation", n_frames=6, shape=SHAPE)
    frames = list(clip.frames())
    frames.insert(3, frames[2].copy())
    steps = list(Tracker(ArraySource(frames, fps=30.0), grid()).steps())
    assert [step.duplicate for step in steps] == [False] * 3 + [True] + [False] * 3
    np.testing.assert_array_equal(steps[3].positions, steps[2].positions)
