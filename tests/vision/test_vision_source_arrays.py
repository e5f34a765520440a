"""Images in memory as a source, and one way to open whatever is passed."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from video_clips import image, write_clip

from openprc.errors import ConfigError, VideoError
from openprc.vision import ArraySource, VideoSource
from openprc.vision.source import open_source

cv2 = pytest.importorskip("cv2")

STACK = np.stack([image(k) for k in range(6)])


def axis_of(source):
    return source.time_axis([frame.stamp for frame in source])


@pytest.mark.parametrize(
    "images", [STACK, list(STACK), iter(list(STACK))], ids=["array", "list", "iterator"]
)
def test_frames_are_those_passed(images):
    source = ArraySource(images, fps=20.0, name="waves")
    np.testing.assert_array_equal([frame.grey for frame in source], STACK)
    np.testing.assert_allclose(axis_of(source).times, np.arange(6) / 20)
    assert (source.fps, source.frame_count, source.kind) == (20.0, 6, "array")
    assert (source.path, source.name, source.shape) == (None, "waves", STACK.shape[1:])
    np.testing.assert_array_equal(source.read_frame(3), STACK[3])
    assert source.describe()["path"] == "waves"


def test_images_that_are_made_on_demand_are_not_made_in_advance():
    class Drawn:
        made = 0

        def __len__(self):
            return 10**6

        def __getitem__(self, k):
            type(self).made += 1
            return image(k)

    source = ArraySource(Drawn(), fps=10.0)
    assert Drawn.made <= 2
    np.testing.assert_array_equal(source.read_frame(17), image(17))
    assert Drawn.made <= 3


def test_import_loads_no_opencv():
    code = (
        "import sys, openprc.vision.source;"
        "sys.exit(bool({'cv2', 'numba', 'scipy'} & sys.modules.keys()))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_times_may_be_given():
    times = np.array([0.0, 0.1, 0.25, 0.3, 0.5, 0.9])
    source = ArraySource(STACK, times=10 + times)
    np.testing.assert_allclose(axis_of(source).times, times)
    assert not axis_of(source).uniform


def test_grey_is_contiguous_whatever_the_layout():
    source = ArraySource(STACK.transpose(0, 2, 1), fps=1.0)
    for frame, picture in zip(source, STACK, strict=True):
        assert frame.grey.flags.c_contiguous
        np.testing.assert_array_equal(frame.grey, picture.T)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({}, "do not say when they were taken"),
        ({"fps": 1.0, "times": np.arange(6)}, "both fps and times"),
        ({"times": np.arange(5)}, r"times has the shape \(5,\) for 6 images"),
        ({"times": [0, 1, 2, 2, 3, 4]}, "does not increase"),
        ({"times": [0, 1, 2, np.nan, 4, 5]}, "does not increase"),
        ({"fps": -1}, "fps is -1"),
    ],
    ids=["none", "both", "length", "twice", "nan", "negative"],
)
def test_clock_that_makes_no_sense(options, said):
    with pytest.raises(ConfigError, match=said):
        ArraySource(STACK, **options)


def test_one_pixel_makes_the_difference_between_a_duplicate_and_a_frame():
    frames = [STACK[0], STACK[0].copy(), STACK[0].copy()]
    frames[2][50, 51] ^= 1
    assert [frame.duplicate for frame in ArraySource(frames, fps=1.0)] == [False, True, False]


def test_no_image_and_no_axis_of_time():
    with pytest.raises(VideoError, match="there is no image"):
        ArraySource([], fps=1.0)
    with pytest.raises(VideoError, match=r"shape \(96, 128\)(.|\n)*image\[None\]"):
        ArraySource(STACK[0], fps=1.0)


def test_change_in_the_middle_names_the_frame():
    for other in (STACK[0][:-1], STACK[0].astype(np.uint16), np.dstack([STACK[0]] * 3)):
        source = ArraySource([STACK[0]] * 9 + [other], fps=1.0)
        with pytest.raises(VideoError, match="frame 9 is"):
            list(source)
        with pytest.raises(VideoError, match="frame 1 is"):
            list(ArraySource([STACK[0], other], fps=1.0))


@pytest.mark.parametrize(
    "picture",
    [np.zeros((5, 6, 2), np.uint8), np.zeros((0, 6), np.uint8), np.zeros((5, 6), complex)],
    ids=["two-channels", "empty", "complex"],
)
def test_what_is_no_image(picture):
    with pytest.raises(VideoError, match="frame 0 has the shape"):
        ArraySource([picture], fps=1.0)


def test_anything_can_be_opened(tmp_path):
    path = write_clip(tmp_path / "w.avi", count=6)
    for given in (path, str(path)):
        assert isinstance(open_source(given), VideoSource)
    assert open_source(STACK, fps=5.0).fps == 5.0
    source = open_source(path, fps=5.0)
    assert open_source(source) is source
    with pytest.raises(ConfigError, match="the options fps come too late"):
        open_source(source, fps=6.0)
