"""Recordings in containers and codecs that are known to mislead: frame order and time axis."""

from __future__ import annotations

import csv
import random
from pathlib import Path

import numpy as np
import pytest
from video_clips import read_bar_code

from openprc.errors import VideoError
from openprc.vision import VideoSource

cv2 = pytest.importorskip("cv2")

CODEC = Path(__file__).resolve().parents[2] / "../shared/data/vision/codec"
pytestmark = pytest.mark.skipif(not CODEC.exists(), reason="the codec clips are not here")

CONSTANT = ["h264_bframes.mp4", "mpeg2_ps.mpg", "av1.mp4"]
VARIABLE = ["vfr_h264.mp4", "vfr_h264.mkv"]


def decodes(name):
    """Tell whether this OpenCV decodes a clip: the wheel of version 5 opens AV1 only."""
    capture = cv2.VideoCapture(str(CODEC / name))
    delivered, _ = capture.read()
    capture.release()
    return delivered


def opened(name, **options):
    if name.startswith("av1") and not decodes(name):
        pytest.skip(f"OpenCV {cv2.__version__} decodes no AV1: the error is tested below")
    return VideoSource(CODEC / name, **options)


def read(name, **options):
    source = opened(name, **options)
    frames = [(frame.stamp, frame.duplicate, read_bar_code(frame.grey)) for frame in source]
    stamps, duplicates, numbers = zip(*frames, strict=True)
    return source, source.time_axis(stamps, duplicated=np.flatnonzero(duplicates)), list(numbers)


def true_times():
    with (CODEC / "vfr_times_ms.csv").open(newline="") as stream:
        return np.array([float(row["t_ms"]) / 1e3 for row in csv.DictReader(stream)])


@pytest.mark.parametrize("name", CONSTANT + VARIABLE)
def test_every_frame_once_and_in_order(name):
    source, _, numbers = read(name)
    assert numbers == list(range(120))
    assert source.decoded == 120
    assert source.shape == (240, 320)


@pytest.mark.parametrize("name", CONSTANT)
def test_constant_rate(name):
    _, axis, _ = read(name)
    assert axis.uniform
    np.testing.assert_allclose(axis.times, np.arange(120) / 30, rtol=0, atol=1e-9)
    assert not axis.dropped


@pytest.mark.parametrize("name", VARIABLE)
def test_variable_rate(name):
    _, axis, _ = read(name)
    assert not axis.uniform
    np.testing.assert_allclose(axis.times, true_times() - true_times()[0], rtol=0, atol=1e-9)
    (drop,) = axis.dropped
    assert drop.after == 60
    assert drop.seconds == pytest.approx(0.5)
    assert "1 hole" in " ".join(axis.notes)


def test_program_stream_says_what_it_lacks():
    source, axis, _ = read("mpeg2_ps.mpg")
    text = " ".join(axis.notes)
    assert "without a time stamp" in text
    assert "index / 30 Hz" in text
    assert "declares 119 frames and delivered 120" in text
    assert "declares 119 frames and delivered 120" in " ".join(source.notes)


def test_stamp_that_is_not_there_is_nan():
    stamps = [frame.stamp for frame in opened("mpeg2_ps.mpg")]
    assert np.isnan(stamps[-1])
    assert np.isfinite(stamps[:-1]).all()
    assert stamps[0] == 0.0


def test_wrong_count_of_the_matroska_file_is_noted():
    source, axis, _ = read("vfr_h264.mkv")
    assert source.frame_count == 138
    for notes in (source.notes, axis.notes):
        assert "declares 138 frames and delivered 120" in " ".join(notes)


@pytest.mark.parametrize("name", ["vfr_h264.mkv", "mpeg2_ps.mpg"])
def test_strict_raises_at_the_end(name):
    source = opened(name, strict=True)
    with pytest.raises(VideoError, match=r"declares 1\d\d frames and delivered 120"):
        list(source)


@pytest.mark.parametrize("name", ["h264_bframes.mp4", "av1.mp4"])
def test_strict_has_nothing_to_say_about_whole_clips(name):
    _, axis, _ = read(name, strict=True)
    assert axis.notes == ()


@pytest.mark.parametrize("name", ["mpeg2_ps.mpg", "h264_bframes.mp4", "vfr_h264.mkv"])
def test_read_frame_in_any_order(name):
    source = opened(name)
    order = [119, 0, 60, 61, 61, 13, 118, 7, *random.Random(5).sample(range(120), 6)]
    for index in order:
        assert read_bar_code(source.read_frame(index)) == index
    for index in range(120):
        assert read_bar_code(source.read_frame(index)) == index
    with pytest.raises(VideoError, match="no frame 120: the recording ends after 120"):
        source.read_frame(120)
    assert read_bar_code(source.read_frame(5)) == 5


@pytest.mark.parametrize("start", [1, 59, 117])
def test_frames_from_the_middle(start):
    source = opened("mpeg2_ps.mpg")
    seen = [(frame.index, read_bar_code(frame.grey)) for frame in source.frames(start=start)]
    assert seen == [(k, k) for k in range(start, 120)]


def test_av1_is_decoded_or_the_error_says_what_to_install():
    if decodes("av1.mp4"):
        assert VideoSource(CODEC / "av1.mp4").codec == "AV01"
        return
    with pytest.raises(VideoError, match=r"codec AV01\) opens but delivers no frame") as caught:
        VideoSource(CODEC / "av1.mp4")
    assert cv2.__version__ in caught.value.found
    assert "4.14 decodes AV1" in caught.value.fix
