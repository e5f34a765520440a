"""What moves, and what only the camera moves."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import ConfigError, MissingData
from openprc.vision import TrajectorySet
from openprc.vision.trajectories.motion import camera_motion, find_static, motion_snr

T = 200
TIME = np.arange(T) / 50.0


def turned(points, angle, shift, scale=1.0):
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]]).transpose(2, 0, 1)
    return np.einsum("tij,tnj->tni", turn, points) * np.reshape(scale, (-1, 1, 1)) + shift[:, None]


@pytest.fixture
def shaken():
    """Twelve points of the background, six of a body that swings, and the camera shakes."""
    rng = np.random.default_rng(8)
    background = rng.uniform(0, 600, (12, 2))
    body = rng.uniform(200, 400, (6, 2))
    truth = np.tile(np.concatenate([background, body]), (T, 1, 1))
    truth[:, 12:, 0] += 20 * np.sin(2 * np.pi * 1.5 * TIME)[:, None]
    angle = 0.004 * np.sin(2 * np.pi * 3.1 * TIME)
    shift = np.stack([2 * np.sin(2 * np.pi * 2.3 * TIME), 1.5 * np.cos(5 * TIME) - 1.5], axis=1)
    return truth, angle, shift


def test_snr_of_a_point_at_rest_is_one():
    rng = np.random.default_rng(1)
    sigma = np.stack([np.full((4000, 3), 0.02), np.full((4000, 3), 0.05)], axis=2)
    positions = sigma * rng.standard_normal(sigma.shape)
    positions[:, 2, 0] += np.sin(TIME).repeat(20)
    found = motion_snr(positions, sigma)
    np.testing.assert_allclose(found[:2], 1.0, rtol=0.03)
    swing = np.sin(TIME).repeat(20).std()
    assert found[2] == pytest.approx(np.sqrt(swing**2 / (0.02**2 + 0.05**2) + 1), rel=0.05)


def test_snr_of_short_and_unseen_points():
    rng = np.random.default_rng(3)
    many = [motion_snr(rng.standard_normal((3, 1, 2)), np.ones((3, 1, 2)))[0] for _ in range(2000)]
    assert np.sqrt(np.mean(np.square(many))) == pytest.approx(1.0, rel=0.05)
    positions = np.zeros((5, 3, 2))
    positions[:, 1] = np.nan
    positions[1:, 2] = np.nan
    found = motion_snr(positions, np.full((5, 3, 2), 0.1))
    assert found[0] == 0.0
    assert np.isnan(found[1:]).all()


def test_snr_needs_a_sigma():
    with pytest.raises(MissingData, match="no uncertainty"):
        motion_snr(np.zeros((5, 3, 2)), None)
    with pytest.raises(MissingData, match="no uncertainty"):
        motion_snr(np.zeros((5, 3, 2)), np.full((5, 3, 2), np.nan))


def test_points_that_move_are_chosen():
    rng = np.random.default_rng(5)
    positions = 0.02 * rng.standard_normal((T, 5, 2))
    positions[:, [1, 3], 1] += np.sin(5 * TIME)[:, None]
    tracks = TrajectorySet(positions, TIME, sigma=np.full((T, 5, 2), 0.02))
    np.testing.assert_array_equal(tracks.select_moving(3.0).feature_ids, [1, 3])
    with pytest.raises(ConfigError, match="none of the 5 points is left"):
        tracks.select_moving(1e6)


@pytest.mark.parametrize("model", ["rigid", "similarity"])
def test_the_motion_of_the_camera_is_taken_off(shaken, model):
    truth, angle, shift = shaken
    scale = 1 + 0.01 * np.sin(TIME) * (model == "similarity")
    seen = turned(truth, angle, shift, scale)
    made = camera_motion(seen, np.arange(12), model=model)
    np.testing.assert_allclose(made.positions, truth, atol=1e-8)
    assert made.residual < 1e-9
    assert made.removed > 1.0
    assert made.n_unknown == 0


def test_a_shift_is_taken_off(shaken):
    truth, _, shift = shaken
    made = camera_motion(truth + shift[:, None], np.arange(12), model="translation")
    np.testing.assert_allclose(made.positions, truth + shift[0], atol=1e-9)
    left = camera_motion(turned(truth, *shaken[1:]), np.arange(12), model="translation")
    assert left.residual > 0.1


def test_still_points_are_found(shaken):
    seen = turned(*shaken)
    rng = np.random.default_rng(0)
    seen += 0.02 * rng.standard_normal(seen.shape)
    np.testing.assert_array_equal(find_static(seen), np.arange(12))
    made = TrajectorySet(seen, TIME).remove_camera_motion()
    assert made.operations[-1]["static"] == list(range(12))
    assert made.operations[-1]["residual"] == pytest.approx(0.02 * np.sqrt(2), rel=0.15)
    # Frame 0 is where the camera stays: its own noise is common to all frames.
    offset = (made.positions - shaken[0]).mean(axis=0)
    assert np.abs(made.positions - shaken[0] - offset).max() < 0.2
    assert "the rigid motion of 12 still points" in made.notes[-1]


def test_no_frame_need_show_all_of_the_background(shaken):
    seen = turned(*shaken)
    hidden = np.zeros(seen.shape[:2], bool)
    for point in range(12):
        start = 13 * point
        hidden[start : start + 40, point] = True
    seen[hidden] = np.nan
    made = camera_motion(seen, np.arange(12))
    np.testing.assert_allclose(made.positions[~hidden], shaken[0][~hidden], atol=1e-6)
    np.testing.assert_array_equal(np.isnan(made.positions[..., 0]), hidden)


def test_frames_without_background_become_missing(shaken):
    seen = turned(*shaken)
    seen[50:53, 1:12] = np.nan
    made = TrajectorySet(seen, TIME).remove_camera_motion(np.arange(12))
    assert (made.observed[50:53] == 0).all()
    assert (made.observed[:50] == 1).all()
    assert "in 3 frames too few of them are seen" in made.notes[-1]


def test_in_three_dimensions():
    rng = np.random.default_rng(2)
    truth = np.tile(rng.uniform(0, 100, (9, 3)), (T, 1, 1))
    truth[:, 8, 2] += np.sin(TIME)
    angle = 0.01 * np.sin(3 * TIME)
    seen = truth.copy()
    seen[..., :2] = turned(truth[..., :2], angle, np.zeros((T, 2)))
    seen[..., 2] += np.cos(TIME)[:, None] - 1
    made = camera_motion(seen, np.arange(8))
    np.testing.assert_allclose(made.positions, truth, atol=1e-8)


@pytest.mark.parametrize(
    ("static", "model", "error", "words"),
    [
        ([0], "rigid", ConfigError, "1 still points"),
        ([0, 1], "affine", ConfigError, "unknown model 'affine'"),
    ],
)
def test_settings_that_make_no_sense(shaken, static, model, error, words):
    with pytest.raises(error, match=words):
        TrajectorySet(shaken[0], TIME).remove_camera_motion(static, model=model)


def test_a_background_that_is_never_seen(shaken):
    seen = shaken[0].copy()
    seen[:, :3] = np.nan
    with pytest.raises(MissingData, match="no frame shows 2 of the 3 still points"):
        TrajectorySet(seen, TIME).remove_camera_motion([0, 1, 2])
