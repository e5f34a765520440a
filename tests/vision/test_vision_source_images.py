"""Recordings kept as images: folders, patterns, stacks; order, holes, depth and damage."""

from __future__ import annotations

import numpy as np
import pytest
from video_clips import image, read_bar_code

from openprc.errors import ConfigError, UnreadableFile, VideoError
from openprc.vision import VideoSource
from openprc.vision.source import open_source

cv2 = pytest.importorskip("cv2")


def write(folder, names, *, pictures=None):
    folder.mkdir(exist_ok=True)
    for k, name in enumerate(names):
        picture = image(k) if pictures is None else pictures[k]
        assert cv2.imwrite(str(folder / name), picture)
    return folder


def axis_of(source):
    return source.time_axis([frame.stamp for frame in source])


@pytest.mark.parametrize("suffix", [".png", ".tif", ".bmp", ".pgm"])
def test_folder_in_natural_order(tmp_path, suffix):
    folder = write(tmp_path / "rec", [f"img_{k}{suffix}" for k in range(12)])
    (folder / "notes.txt").write_text("not an image")
    (folder / "._img_3.png").write_text("what some systems leave behind")
    source = VideoSource(folder, fps=100.0)
    assert [read_bar_code(frame.grey) for frame in source] == list(range(12))
    assert (source.kind, source.frame_count, source.name) == ("images", 12, "rec")
    np.testing.assert_allclose(axis_of(source).times, np.arange(12) / 100)
    assert source.notes == ()


@pytest.mark.parametrize("pattern", ["b_%03d.png", "b_%d.png", "b_*.png"])
def test_pattern_chooses_one_of_two_sequences(tmp_path, pattern):
    write(tmp_path / "rec", [f"a_{k:03d}.png" for k in range(3)])
    folder = write(tmp_path / "rec", [f"b_{k:03d}.png" for k in range(5)])
    source = VideoSource(folder / pattern, fps=10.0)
    assert [read_bar_code(frame.grey) for frame in source] == list(range(5))
    with pytest.raises(
        VideoError, match=r"2 sequences: a_#.png \(3\), b_#.png \(5\)(.|\n)*pattern"
    ):
        VideoSource(folder, fps=10.0)


def test_list_of_images_keeps_its_order(tmp_path):
    folder = write(tmp_path / "rec", ["x.png", "b.png", "k.png"])
    source = open_source([folder / name for name in ("k.png", "x.png", "b.png")], fps=10.0)
    assert [read_bar_code(frame.grey) for frame in source] == [2, 0, 1]


@pytest.mark.parametrize("step", [1, 10])
def test_missing_numbers_are_told_and_leave_room(tmp_path, step):
    places = [0, 1, 2, 5, 6, 7, 8]
    folder = write(tmp_path / "rec", [f"img_{40 + step * k:04d}.png" for k in places])
    source = VideoSource(folder, fps=50.0)
    text = " ".join(source.notes)
    assert "2 numbers missing" in text
    assert f"{40 + 3 * step:04d}, {40 + 4 * step:04d}" in text
    axis = axis_of(source)
    np.testing.assert_allclose(axis.times, np.array(places) / 50)
    assert [(drop.after, drop.missing) for drop in axis.dropped] == [(2, 2)]
    with pytest.raises(VideoError, match="2 numbers missing"):
        VideoSource(folder, fps=50.0, strict=True)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["t1_20.png", "t2_11.png", "t3_55.png"], "several numbers"),
        (["shot_3.png", "shot_10.png", "shot_4711.png"], "no regular step"),
    ],
    ids=["two-numbers", "odd-steps"],
)
def test_numbers_that_do_not_count_frames(tmp_path, names, said):
    source = VideoSource(write(tmp_path / "rec", names), fps=1.0)
    assert [read_bar_code(frame.grey) for frame in source] == [0, 1, 2]
    assert said in " ".join(source.notes)
    np.testing.assert_allclose(axis_of(source).times, [0, 1, 2])


def test_two_images_of_one_number(tmp_path):
    folder = write(tmp_path / "rec", ["i_1.png", "i_01.png", "i_2.png"])
    with pytest.raises(VideoError, match="same number"):
        VideoSource(folder, fps=1.0)


def test_images_without_a_rate(tmp_path):
    folder = write(tmp_path / "rec", ["i_1.png", "i_2.png"])
    with pytest.raises(ConfigError, match=r"do not say when they were taken(.|\n)*option fps"):
        VideoSource(folder)


@pytest.mark.parametrize("name", ["img_%04d.png", "img_*.png"])
def test_pattern_that_matches_nothing(tmp_path, name):
    with pytest.raises(UnreadableFile, match="there is no image"):
        VideoSource(tmp_path / name, fps=1.0)
    with pytest.raises(UnreadableFile, match="there is no image"):
        VideoSource(tmp_path / "nowhere" / name, fps=1.0)


def test_change_of_size_names_the_frame(tmp_path):
    pictures = [np.zeros((40, 60), np.uint8)] * 9 + [np.zeros((40, 62), np.uint8)]
    folder = write(tmp_path / "rec", [f"i_{k}.png" for k in range(10)], pictures=pictures)
    source = VideoSource(folder, fps=1.0)
    with pytest.raises(VideoError, match=r"frame 9 is 62 x 40 px.*before are 60 x 40 px"):
        list(source)


def test_change_of_channels_and_depth_names_the_frame(tmp_path):
    grey = np.zeros((40, 60), np.uint8)
    for other in (np.zeros((40, 60, 3), np.uint8), grey.astype(np.uint16)):
        pictures = [grey] * 9 + [other]
        folder = write(tmp_path / "rec", [f"i_{k}.png" for k in range(10)], pictures=pictures)
        with pytest.raises(VideoError, match="frame 9 is 60 x 40 px"):
            list(VideoSource(folder, fps=1.0))


@pytest.mark.parametrize("left", [0, 200])
def test_image_that_was_cut_off_names_the_frame(tmp_path, left):
    folder = write(tmp_path / "rec", [f"i_{k}.png" for k in range(10)])
    path = folder / "i_9.png"
    path.write_bytes(path.read_bytes()[:left])
    source = VideoSource(folder, fps=1.0)
    with pytest.raises(VideoError, match=rf"frame 9 is not an image.*\({left} bytes\)") as caught:
        list(source)
    assert caught.value.file == str(path)


def test_image_that_vanished(tmp_path):
    folder = write(tmp_path / "rec", [f"i_{k}.png" for k in range(10)])
    source = VideoSource(folder, fps=1.0)
    (folder / "i_9.png").unlink()
    with pytest.raises(VideoError, match="frame 9 cannot be read"):
        list(source)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_sixteen_bit_images_share_one_range(tmp_path, suffix):
    pictures = [np.full((40, 60), 100 * k + 7, np.uint16) for k in range(10)]
    pictures[5][0, 0] = 3900
    folder = write(tmp_path / "rec", [f"i_{k}{suffix}" for k in range(10)], pictures=pictures)
    source = VideoSource(folder, fps=1.0)
    assert source.value_range == (0.0, 4095.0)
    for frame, picture in zip(source, pictures, strict=True):
        assert frame.intensity.dtype == np.uint16
        np.testing.assert_array_equal(frame.intensity, picture)
        np.testing.assert_array_equal(frame.grey, np.rint(picture * (255 / 4095)))
    narrow = VideoSource(folder, fps=1.0, value_range=(0, 1000))
    assert next(narrow.frames(start=9)).grey[3, 3] == round(907 * 0.255)


def test_pages_of_a_tiff_file(tmp_path):
    pages = [np.full((20, 30), 1000 * k, np.uint16) for k in range(6)]
    assert cv2.imwritemulti(str(tmp_path / "stack.tif"), pages)
    source = VideoSource(tmp_path / "stack.tif", fps=5.0)
    assert (source.frame_count, source.container) == (6, "TIFF")
    for frame, page in zip(source, pages, strict=True):
        np.testing.assert_array_equal(frame.intensity, page)
    with pytest.raises(ConfigError, match="fps"):
        VideoSource(tmp_path / "stack.tif")


def test_stack_of_an_array_file(tmp_path):
    stack = np.stack([image(k) for k in range(5)])
    np.save(tmp_path / "stack.npy", stack)
    source = VideoSource(tmp_path / "stack.npy", fps=5.0)
    np.testing.assert_array_equal([frame.grey for frame in source], stack)
    assert source.container == "NumPy"


def test_array_files_that_hold_no_stack(tmp_path):
    np.save(tmp_path / "flat.npy", np.zeros((4, 5)))
    with pytest.raises(VideoError, match=r"shape \(4, 5\)(.|\n)*image\[None\]"):
        VideoSource(tmp_path / "flat.npy", fps=1.0)
    np.save(tmp_path / "objects.npy", np.array([{}, {}]), allow_pickle=True)
    with pytest.raises(VideoError, match="NumPy cannot read it"):
        VideoSource(tmp_path / "objects.npy", fps=1.0)
    (tmp_path / "text.tif").write_text("no TIFF at all")
    with pytest.raises(VideoError, match="not a TIFF file"):
        VideoSource(tmp_path / "text.tif", fps=1.0)
