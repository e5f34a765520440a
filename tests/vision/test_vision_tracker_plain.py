"""Plain Lucas-Kanade, settings, and what the tracker refuses."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import ConfigError, NoFeaturesError, VideoError
from openprc.vision import ArraySource, KLTConfig, Status, Tracker
from openprc.vision.synth import cases
from openprc.vision.tracking.predictor import PyramidalKLT

SHAPE = (120, 160)
POINTS = np.array([(40.0, 40.0), (80, 60), (120, 80), (60, 90)])


@pytest.fixture(scope="module")
def frames():
    return list(cases.case("translation", n_frames=12, shape=SHAPE).frames())


def source(images, **options):
    return ArraySource(images, fps=30.0, **options)


def test_the_printed_settings_are_taken():
    config = KLTConfig(win_size=(21, 21), max_level=3, fb_threshold=1.0)
    assert (config.win_size, config.max_level, config.fb_threshold) == ((21, 21), 3, 1.0)
    assert config.as_dict()["refinement"]["subset"] == 21


def test_plain_tracking_knows_no_quality_and_a_lost_point_stays_lost(frames):
    images = [image.copy() for image in frames]
    for image in images[4:7]:
        image[20:60, 20:60] = 128
    result = Tracker(source(images), POINTS, config=KLTConfig(refine="none")).run()
    assert np.isnan(result.quality).all()
    assert np.isnan(result.sigma).all()
    assert result.status[0].tolist() == [Status.REFERENCE] * 4
    assert result.seen[:, 1:].all()
    assert result.seen[:4, 0].all()
    assert not result.seen[4:, 0].any()
    assert result.status[-1, 0] in (Status.LOST, Status.DRIFT)
    assert np.isnan(result.positions[4:, 0]).all()


def test_plain_tracking_tells_what_left_the_image():
    wide = next(iter(cases.case("translation", n_frames=1, shape=(120, 320)).frames()))
    images = [wide[:, 4 * k : 4 * k + 160].copy() for k in range(12)]
    config = KLTConfig(refine="none", fb_threshold=3.0)
    result = Tracker(source(images), POINTS, config=config).run()
    assert result.status[-1, 0] == Status.OOB
    np.testing.assert_allclose(result.positions[-1, 2], [120 - 44, 80], atol=0.2)


def test_plain_tracking_obeys_the_largest_step(frames):
    images = [np.roll(frames[0], 5 * k, axis=1) for k in range(3)]
    config = KLTConfig(refine="none", max_step=3.0)
    result = Tracker(source(images), POINTS, config=config).run()
    assert (result.status[1] == Status.DRIFT).all()


def test_levels_follow_the_motion_and_the_size_of_the_image():
    klt = PyramidalKLT(KLTConfig())
    assert klt.levels((1080, 1920), 2.0) == 3
    assert klt.levels((1080, 1920), 13.0) == 4
    assert klt.levels((2160, 3840), 13.0) == 5
    assert klt.levels((40, 640), 2.0) == 0
    assert PyramidalKLT(KLTConfig(max_level=2)).levels((1080, 1920), 50.0) == 2


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"win_size": (2, 21)}, "win_size is"),
        ({"max_level": 11}, "max_level is 11"),
        ({"refine": "dic"}, "refine is 'dic'"),
        ({"fb_threshold": float("nan")}, "fb_threshold is nan"),
        ({"max_iterations": 0}, "max_iterations is 0"),
        ({"max_step": -1.0}, "max_step is -1.0"),
    ],
)
def test_settings_out_of_range_are_refused(settings, message):
    with pytest.raises(ConfigError, match=message):
        KLTConfig(**settings)


def test_no_point_is_an_error(frames):
    with pytest.raises(NoFeaturesError, match="there is no point to follow"):
        Tracker(source(frames), np.zeros((0, 2)))


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((3, 3)), r"shape \(3, 3\)"),
        ([(10.0, 10.0), (500.0, 10.0)], r"point 1 lies at \(500, 10\)"),
        ([(np.nan, 10.0)], "point 0 lies at"),
    ],
)
def test_points_that_cannot_be_are_refused(frames, points, message):
    with pytest.raises(ConfigError, match=message):
        Tracker(source(frames), points)


def test_points_at_the_edge_and_on_blank_ground_are_told(frames):
    images = [image.copy() for image in frames[:3]]
    for image in images:
        image[:40, :60] = 128
    result = Tracker(source(images), [(5.0, 60.0), (30.0, 20.0), (100.0, 60.0)]).run()
    assert result.status[:, 0].tolist() == [Status.OOB] * 3
    assert result.status[:, 1].tolist() == [Status.LOST] * 3
    assert result.status[-1, 2] == Status.TRACKED
    assert "so near the edge" in result.notes[0]
    assert "no texture" in result.notes[1]


def test_frames_before_the_reference_are_followed_backward(frames):
    clip = cases.case("translation", n_frames=12, shape=SHAPE)
    there = clip.truth(POINTS)
    result = Tracker(source(frames), there[6], reference_frame=6).run()
    assert result.status[6].tolist() == [Status.REFERENCE] * 4
    np.testing.assert_allclose(result.positions, there, atol=0.06)
    assert any("followed backward" in note for note in result.notes)


def test_frames_that_do_not_fit_into_memory_are_given_out_unseen(frames):
    room = 3.5 * frames[0].nbytes / 2**20
    config = KLTConfig(backward_memory=room)
    result = Tracker(source(frames), POINTS, config=config, reference_frame=6).run()
    assert result.n_frames == 12
    assert not result.seen[:3].any()
    assert result.seen[3:].all()
    assert any("the first 3 of 6 frames" in note for note in result.notes)


def test_a_reference_frame_after_the_end_is_an_error(frames):
    with pytest.raises(VideoError, match="the video ends after 12 frames"):
        Tracker(source(frames), POINTS, reference_frame=40).run()


@pytest.mark.parametrize("reference", [-1, 1.5])
def test_a_reference_frame_is_a_whole_number(frames, reference):
    with pytest.raises(ConfigError, match="reference_frame is"):
        Tracker(source(frames), POINTS, reference_frame=reference)


def test_features_of_another_frame_or_video_are_refused(frames):
    from openprc.vision import FeatureMap

    found = FeatureMap.from_points(POINTS, frame_shape=SHAPE, ref_frame_index=3)
    assert Tracker(source(frames), found).reference_frame == 3
    with pytest.raises(ConfigError, match="found in frame 3, and reference_frame is 0"):
        Tracker(source(frames), found, reference_frame=0)
    other = FeatureMap.from_points(POINTS, frame_shape=(360, 480))
    with pytest.raises(ConfigError, match="found in an image of 480 x 360 px"):
        Tracker(source(frames), other)


def test_losing_all_points_for_good_is_noted_and_an_error_when_strict(frames):
    images = frames[:4] + [np.full(SHAPE, k, np.uint8) for k in range(3)]
    result = Tracker(source(images), POINTS).run()
    assert not result.seen[4:].any()
    assert any("frame 4 and all after it" in note for note in result.notes)
    with pytest.raises(NoFeaturesError, match="frame 4 and all after it"):
        Tracker(source(images, strict=True), POINTS).run()


def test_an_interrupted_run_can_keep_what_is_finished(frames):
    def stop(done, total):
        assert total == 12
        if done == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Tracker(source(frames), POINTS, progress=stop).run()
    result = Tracker(source(frames, strict=True), POINTS, progress=stop).run(on_interrupt="keep")
    assert result.n_frames == 4
    assert "interrupted" in result.notes[-1]
