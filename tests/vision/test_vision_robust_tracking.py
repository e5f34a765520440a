"""Bad pictures and bad answers of the optical flow: no position is believed that is not there."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.vision import ArraySource, KLTConfig, Status, Tracker, TrajectorySet, VideoSource
from openprc.vision.synth import cases

cv2 = pytest.importorskip("cv2")

SHAPE = (120, 160)
POINTS = np.array([(40.0, 40.0), (80, 60), (120, 80), (60, 90), (100, 30), (130, 50), (30, 70)])
SETTINGS = {
    "refined": KLTConfig(),
    "printed": KLTConfig(win_size=(21, 21), max_level=3, fb_threshold=1.0),
    "plain": KLTConfig(refine="none"),
}
every_setting = pytest.mark.parametrize("config", SETTINGS.values(), ids=SETTINGS)


@pytest.fixture(scope="module")
def clip():
    return cases.case("translation", n_frames=14, shape=SHAPE, noise=1.0)


@pytest.fixture(scope="module")
def frames(clip):
    return list(clip.frames())


def run(images, points=POINTS, *, config=None, **options):
    return Tracker(ArraySource(images, fps=30.0), points, config=config, **options).run()


def farthest(result, truth):
    """Return the largest error [px] among the positions that are given out."""
    away = np.linalg.norm(result.positions - truth, axis=2)
    assert np.array_equal(np.isfinite(away), result.seen)
    return away[result.seen].max()


# --- answers of the optical flow that are none ---


@every_setting
@pytest.mark.parametrize(
    ("place", "status"),
    [((np.nan, 30.0), "LOST"), ((np.inf, 30.0), "LOST"), ((-4.0, 60.0), "OOB"),
     ((1e9, 60.0), "OOB")],
    ids=["nan", "inf", "left", "far"],
)  # fmt: skip
def test_success_of_the_optical_flow_without_a_place_is_not_believed(
    clip, frames, config, place, status, monkeypatch
):
    real = cv2.calcOpticalFlowPyrLK
    given = []

    def answers(before, after, points, guess, **settings):
        given.append(points)
        there, found, error = real(before, after, points, guess, **settings)
        # Point 1 alone lies near here in all frames.
        mine = np.linalg.norm(points[:, 0] - POINTS[1], axis=1) < 12
        there[mine, 0] = place
        found[mine] = 1
        return there, found, error

    monkeypatch.setattr(cv2, "calcOpticalFlowPyrLK", answers)
    result = run(frames, config=config)
    assert all(np.isfinite(points).all() for points in given)
    assert farthest(result, clip.truth(POINTS)) < 0.2
    others = np.arange(len(POINTS)) != 1
    assert result.seen[:, others].all()
    if config.refine == "none":
        assert not result.seen[1:, 1].any()
        assert Status(int(result.status[1, 1])).name == status


# --- pictures that show nothing, or something else ---


@every_setting
@pytest.mark.parametrize("what", ["black", "white", "grain", "other scene"])
def test_nothing_is_tracked_in_pictures_of_something_else(clip, frames, config, what):
    rng = np.random.default_rng(0)
    others = {
        "black": [np.zeros(SHAPE, np.uint8)] * 4,
        "white": [np.full(SHAPE, 255, np.uint8)] * 4,
        "grain": [rng.integers(0, 256, SHAPE).astype(np.uint8) for _ in range(4)],
        "other scene": list(cases.case("translation", n_frames=4, shape=SHAPE, seed=9).frames()),
    }[what]
    result = run([*frames[:5], *others, *frames[9:]], config=config)
    assert result.seen[:5].all()
    assert not result.seen[5:9].any()
    assert np.isin(result.status[5:9], [Status.LOST, Status.DRIFT, Status.OOB]).all()
    tracks = TrajectorySet.from_tracking_result(result)
    assert np.isnan(tracks.positions[5:9]).all()
    assert not tracks.observed[5:9].any()
    if config.refine != "none":
        assert farthest(result, clip.truth(POINTS)) < 0.1
        assert result.seen[-1].all()
    assert any("no point was found in" in note for note in result.notes)


def test_blank_first_frame_leaves_a_gap_before_and_none_after(clip, frames):
    result = run([np.zeros(SHAPE, np.uint8), *frames[1:]], clip.truth(POINTS)[1], reference_frame=1)
    assert not result.seen[0].any()
    assert np.isnan(result.positions[0]).all()
    assert (result.status[1] == Status.REFERENCE).all()
    assert farthest(result, clip.truth(POINTS)) < 0.1
    assert result.seen[1:].all()
    filled = TrajectorySet.from_tracking_result(result).fill_gaps("linear", max_gap=20)
    assert np.isnan(filled.positions[0]).all()


@pytest.mark.parametrize("config", [SETTINGS["refined"], SETTINGS["plain"]], ids=["icgn", "plain"])
def test_reference_in_the_middle_says_in_each_frame_what_is_true(clip, frames, config):
    truth = clip.truth(POINTS)
    result = run(frames, truth[7], config=config, reference_frame=7)
    assert farthest(result, truth) < 0.1
    assert result.seen.all()
    assert np.flatnonzero((result.status == Status.REFERENCE).all(axis=1)).tolist() == [7]
    np.testing.assert_allclose(result.timestamps, np.arange(14) / 30)


# --- patterns that look alike one cell further ---


@pytest.mark.parametrize("jump", [9, 17, 26])
def test_folded_sheet_that_jumps_is_never_reported_a_cell_off(jump):
    clip = cases.case("miura", n_frames=8, shape=(160, 220), noise=1.0)
    images = list(clip.frames())
    x, y = np.meshgrid(np.arange(50.0, 171, 20), np.arange(40.0, 121, 20))
    points = np.column_stack([x.ravel(), y.ravel()])
    images = [*images[:3], *(np.roll(image, jump, axis=1) for image in images[3:])]
    truth = clip.truth(points)
    truth[3:, :, 0] += jump
    result = run(images, points)
    assert result.seen[:3].mean() > 0.9
    assert farthest(result, truth) < 1.0


def test_one_point_led_a_cell_off_is_brought_back_or_given_up(monkeypatch):
    y, x = np.mgrid[:120, :160]
    rng = np.random.default_rng(4)
    images = [
        np.rint(
            128 + 50 * np.cos(2 * np.pi * (x - 0.8 * k) / 16) * np.cos(2 * np.pi * y / 16)
            + rng.normal(0, 1, x.shape)
        ).astype(np.uint8)
        for k in range(8)
    ]  # fmt: skip
    u, v = np.meshgrid(np.arange(32.0, 129, 16), np.arange(32.0, 97, 16))
    points = np.column_stack([u.ravel(), v.ravel()])
    truth = points + np.arange(8)[:, None, None] * [0.8, 0.0]
    astray = 17
    real = cv2.calcOpticalFlowPyrLK

    def misled(before, after, places, guess, **settings):
        there, found, error = real(before, after, places, guess, **settings)
        # Both ways, so that forward-backward does not notice.
        forward = before.tobytes() == images[3].tobytes()
        if forward:
            near = np.linalg.norm(places[:, 0] - truth[3, astray], axis=1) < 4
            there[near, 0, 0] += 16
        elif after.tobytes() == images[3].tobytes() and before.tobytes() == images[4].tobytes():
            near = np.linalg.norm(places[:, 0] - truth[4, astray] - [16, 0], axis=1) < 4
            there[near, 0, 0] = truth[3, astray, 0]
        return there, found, error

    monkeypatch.setattr(cv2, "calcOpticalFlowPyrLK", misled)
    result = run(images, points)
    others = np.arange(len(points)) != astray
    assert result.seen[:, others].mean() > 0.9
    away = np.linalg.norm(result.positions - truth, axis=2)
    assert not (away[:, astray] > 1).any()


# --- clocks of runs that were stopped ---


def test_stopped_run_keeps_the_rate_that_was_asked_for(clip, tmp_path):
    path = clip.write(tmp_path / "clip.avi", fps=30.0)

    def stop(done, total):
        if done == 6:
            raise KeyboardInterrupt

    whole = Tracker(VideoSource(path, fps=1000.0), POINTS).run()
    part = Tracker(VideoSource(path, fps=1000.0), POINTS, progress=stop).run(on_interrupt="keep")
    assert part.n_frames == 5
    np.testing.assert_allclose(part.timestamps, np.arange(5) / 1000, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(part.timestamps, whole.timestamps[:5])
    np.testing.assert_array_equal(part.positions, whole.positions[:5])
