"""The annotated video: every frame is there, drawn on, and readable; or nothing is."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import ConfigError, ResultExists, VideoError
from openprc.vision import annotation
from openprc.vision.annotation import COLOURS, annotate_video
from openprc.vision.source.arrays import ArraySource
from openprc.vision.tracking.result import TrackingResult
from openprc.vision.tracking.status import Status

cv2 = pytest.importorskip("cv2")

N_FRAMES = 6


@pytest.fixture
def source():
    images = np.full((N_FRAMES, 81, 121), 90, np.uint8)
    return ArraySource(images, fps=10.0)


@pytest.fixture
def result():
    positions = np.zeros((N_FRAMES, 3, 2))
    positions[:] = [[30, 30], [60, 40], [90, 60]]
    positions[:, 0, 0] += np.arange(N_FRAMES)
    status = np.zeros((N_FRAMES, 3), np.uint8)
    status[0] = Status.REFERENCE
    status[3:, 1] = Status.LOST
    status[3:, 2] = Status.DRIFT
    positions[3:, 1:] = np.nan
    return TrackingResult(positions=positions, status=status, timestamps=np.arange(N_FRAMES) / 10.0)


def read(path):
    capture = cv2.VideoCapture(str(path))
    images = []
    while (got := capture.read())[0]:
        images.append(got[1])
    return images


def near(image, colour, tolerance=60):
    """Count the pixels of a colour."""
    return int((np.abs(image.astype(int) - colour).max(axis=2) < tolerance).sum())


@pytest.mark.parametrize("suffix", [".mp4", ".avi", ".mkv"])
def test_every_frame_is_there_with_odd_sizes(source, result, tmp_path, suffix):
    path = annotate_video(source, result, tmp_path / f"seen{suffix}")
    images = read(path)
    assert len(images) == N_FRAMES
    height, width = images[0].shape[:2]
    assert height % 2 == width % 2 == 0
    assert [item.name for item in tmp_path.iterdir()] == [f"seen{suffix}"]


def test_colours_say_what_became_of_points(source, result, tmp_path):
    images = read(annotate_video(source, result, tmp_path / "seen.avi", labels=False))
    bar = [image[-4:] for image in images]
    width = images[0].shape[1]
    # The health bar: all found, then one of three, lost and drifting a third each.
    assert near(bar[0], COLOURS[Status.TRACKED]) > 0.9 * 4 * width
    for code in (Status.TRACKED, Status.LOST, Status.DRIFT):
        assert near(bar[4], COLOURS[code]) == pytest.approx(4 * width / 3, rel=0.2)
    body = images[4][:-30]
    assert near(body, COLOURS[Status.LOST]) > 10
    assert near(body, COLOURS[Status.DRIFT]) > 10
    assert near(images[0][:-30], COLOURS[Status.LOST]) == 0


def test_trails_show_where_points_were(source, result, tmp_path):
    with_trail = read(annotate_video(source, result, tmp_path / "a.avi", labels=False))
    without = read(annotate_video(source, result, tmp_path / "b.avi", labels=False, trail=0))
    changed = np.abs(with_trail[5].astype(int) - without[5]).max(axis=2)[:-30] > 30
    assert changed.any()
    assert np.abs(with_trail[0].astype(int) - without[0]).max() <= 30


def test_progress_is_told(source, result, tmp_path):
    told = []
    annotate_video(
        source, result, tmp_path / "a.avi", progress=lambda done, total: told.append((done, total))
    )
    assert told == [(k + 1, N_FRAMES) for k in range(N_FRAMES)]


def test_nothing_is_overwritten_or_left(source, result, tmp_path):
    path = tmp_path / "seen.avi"
    path.write_text("mine")
    with pytest.raises(ResultExists, match="there is a finished file"):
        annotate_video(source, result, path)
    assert path.read_text() == "mine"
    annotate_video(source, result, path, overwrite=True)
    assert len(read(path)) == N_FRAMES


@pytest.mark.parametrize("name", ["seen.gif", "seen", "seen.h5"])
def test_names_that_cannot_be_written(source, result, tmp_path, name):
    with pytest.raises(ConfigError, match="a video cannot be named"):
        annotate_video(source, result, tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_tracks_of_another_video(result, tmp_path):
    short = ArraySource(np.full((3, 81, 121), 90, np.uint8), fps=10.0)
    with pytest.raises(ConfigError, match="the tracks have 6 frames, the video 3"):
        annotate_video(short, result, tmp_path / "seen.avi")
    assert list(tmp_path.iterdir()) == []


def test_frames_that_the_writer_drops_are_noticed(source, result, tmp_path, monkeypatch):
    write = annotation._Writer.__call__

    def dropping(self, image):
        self.count = getattr(self, "count", 0) + 1
        if self.count != 3:
            write(self, image)

    monkeypatch.setattr(annotation._Writer, "__call__", dropping)
    with pytest.raises(VideoError, match="5 of 6 frames read back"):
        annotate_video(source, result, tmp_path / "seen.avi")
    assert list(tmp_path.iterdir()) == []


def test_a_codec_that_is_not_there(source, result, tmp_path, monkeypatch):
    monkeypatch.setitem(annotation.CODECS, ".avi", "XXXX")
    with pytest.raises(VideoError, match="OpenCV cannot open it for writing"):
        annotate_video(source, result, tmp_path / "seen.avi")
    assert list(tmp_path.iterdir()) == []
