"""Damaged files: OpenCV ends in silence, so that every loss has to be found out and told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from video_clips import cut_off, patched, read_bar_code, write_clip, zeroed

from openprc.errors import VideoError
from openprc.vision import VideoSource
from openprc.vision.source.stored_size import stored_size

cv2 = pytest.importorskip("cv2")

CODEC = Path(__file__).resolve().parents[2] / "../shared/data/vision/codec"
COUNT = 60


@pytest.fixture(scope="module")
def clips(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    return {
        name: write_clip(folder / name, codec=codec, count=COUNT)
        for name, codec in (
            ("f.avi", "FFV1"),
            ("f.mkv", "FFV1"),
            ("m.avi", "MJPG"),
            ("m.mkv", "MJPG"),
            ("v.mp4", "mp4v"),
        )
    }


def follow(path, **options):
    """Return source, time axis and the numbers that the frames show."""
    source = VideoSource(path, **options)
    frames = [(frame.stamp, frame.duplicate, read_bar_code(frame.grey)) for frame in source]
    stamps, duplicates, numbers = (np.array(column) for column in zip(*frames, strict=True))
    return source, source.time_axis(stamps, duplicated=np.flatnonzero(duplicates)), numbers


@pytest.mark.parametrize("name", ["f.avi", "f.mkv", "m.avi", "m.mkv", "v.mp4"])
def test_whole_files_have_nothing_to_tell(clips, name):
    source, axis, numbers = follow(clips[name], strict=True)
    assert numbers.tolist() == list(range(COUNT))
    assert (source.notes, axis.notes, axis.dropped) == ((), (), ())
    np.testing.assert_allclose(axis.times, np.arange(COUNT) / 30, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", ["f.avi", "f.mkv", "m.avi", "m.mkv"])
def test_file_that_was_cut_off(clips, name):
    path = cut_off(clips[name], 0.5)
    source, axis, numbers = follow(path)
    assert 25 <= len(numbers) <= 31
    assert source.frame_count == COUNT
    assert source.decoded == len(numbers)
    said = f"declares {COUNT} frames and delivered {len(numbers)}"
    assert said in " ".join(source.notes)
    assert said in " ".join(axis.notes)
    with pytest.raises(VideoError, match=said):
        list(VideoSource(path, strict=True))


def test_mp4_that_was_cut_off_has_lost_its_index(clips):
    with pytest.raises(VideoError, match=r"'moov'.*is missing, as after an interrupted recording"):
        VideoSource(cut_off(clips["v.mp4"], 0.6))


def test_mp4_whose_index_is_cut_off(clips):
    with pytest.raises(VideoError, match=r"'moov'.*is cut off(.|\n)*copy it again"):
        VideoSource(cut_off(clips["v.mp4"], 0.995))


def test_mp4_with_an_index_that_names_nothing(clips):
    path = patched(clips["v.mp4"], b"trak", b"xrak")
    with pytest.raises(VideoError, match="cannot be opened: its index names no frame"):
        VideoSource(path)


def test_avi_with_a_spoilt_header(clips):
    data = bytearray(clips["m.avi"].read_bytes())
    data[12 : data.index(b"movi")] = bytes(data.index(b"movi") - 12)
    path = clips["m.avi"].with_name("headless.avi")
    path.write_bytes(data)
    with pytest.raises(VideoError, match="header is damaged"):
        VideoSource(path)


@pytest.mark.parametrize("begin", [0.3, 0.5, 0.72])
@pytest.mark.parametrize("name", ["m.avi", "m.mkv"])
def test_frames_that_are_missing_in_the_middle(clips, name, begin):
    path = zeroed(clips[name], begin, 0.1)
    source, axis, numbers = follow(path)
    missing = COUNT - len(numbers)
    assert 3 <= missing <= 12
    # The times follow the numbers in the pictures, past the hole as well.
    places = np.rint(axis.times * 30).astype(int)
    wrong = places != numbers
    # The picture whose data are half gone may show anything.
    assert wrong.sum() <= 1
    assert places[-1] == COUNT - 1
    assert axis.missing == missing
    assert not axis.uniform
    assert "hole" in " ".join(axis.notes)
    assert f"delivered {len(numbers)}" in " ".join(source.notes)
    with pytest.raises(VideoError):
        follow(path, strict=True)


def test_index_of_an_avi_file_tells_which_frames_are_lost(clips):
    path = zeroed(clips["m.avi"], 0.4, 0.1)
    source, axis, _ = follow(path)
    assert "index of the file lists" in " ".join(source.notes)
    (drop,) = axis.dropped
    assert 3 <= drop.missing <= 12
    with pytest.raises(VideoError, match="destroyed frame"):
        list(VideoSource(path, strict=True))


def test_decoder_that_stops_at_damage_is_made_to_go_on(clips):
    data = bytearray(clips["m.avi"].read_bytes())
    # The picture of one frame, behind the head of its chunk.
    at = data.index(b"movi")
    for _ in range(31):
        at = data.index(b"00dc", at + 1)
    size = int.from_bytes(data[at + 4 : at + 8], "little")
    data[at + 8 : at + 8 + size] = bytes(size)
    path = clips["m.avi"].with_name("spoilt.avi")
    path.write_bytes(data)
    source, axis, numbers = follow(path)
    assert numbers.tolist() == [k for k in range(COUNT) if k != 30]
    np.testing.assert_allclose(axis.times * 30, numbers, rtol=0, atol=1e-6)
    assert [(drop.after, drop.missing) for drop in axis.dropped] == [(29, 1)]
    assert "made to go on" in " ".join(source.notes)


@pytest.mark.parametrize("shape", [(48, 64), (128, 160)])
def test_size_that_changes_in_the_middle(clips, shape):
    path = with_another_size(clips["m.avi"], shape, count=5)
    said = f"from 128 x 96 to {shape[1]} x {shape[0]} px at about frame 40"
    with pytest.raises(VideoError, match=said):
        list(VideoSource(path))
    assert read_bar_code(VideoSource(path).read_frame(39)) == 39


def test_one_picture_of_another_size_is_damage(clips):
    path = with_another_size(clips["m.avi"], (48, 64), count=1)
    source, _, numbers = follow(path)
    assert len(numbers) == COUNT
    assert "1 picture of another size" in " ".join(source.notes)
    with pytest.raises(VideoError, match="another size"):
        list(VideoSource(path, strict=True))


def test_sizes_that_compressed_pictures_name():
    # MPEG-1/2: the sequence header has 12 bits of width and 12 of height behind its code.
    assert stored_size(b"\0\0\1\xb3\x14\x00\xf0\x25") == (320, 240)
    assert stored_size(b"\0\0\1\x00\x14\x00\xf0\x25") is None
    _, picture = cv2.imencode(".jpg", np.zeros((24, 40, 3), np.uint8))
    assert stored_size(picture.tobytes()) == (40, 24)
    assert stored_size(picture.tobytes()[:30]) is None
    assert stored_size(b"") is None


def with_another_size(path, shape, *, count):
    """Return a copy of a Motion JPEG file whose frames from 40 on have another size."""
    _, picture = cv2.imencode(".jpg", np.full((*shape, 3), 90, np.uint8))
    data = bytearray(path.read_bytes())
    at = data.index(b"movi")
    for _ in range(40):
        at = data.index(b"00dc", at + 1)
    for _ in range(count):
        at = data.index(b"00dc", at + 1)
        size = int.from_bytes(data[at + 4 : at + 8], "little")
        assert len(picture) <= size
        data[at + 8 : at + 8 + size] = picture.tobytes().ljust(size, b"\0")
    other = path.with_name("two_sizes.avi")
    other.write_bytes(data)
    return other


def test_first_frames_that_cannot_be_decoded(clips):
    data = bytearray(clips["m.avi"].read_bytes())
    at = data.index(b"movi")
    for _ in range(3):
        at = data.index(b"00dc", at + 1)
        size = int.from_bytes(data[at + 4 : at + 8], "little")
        data[at + 8 : at + 8 + size] = bytes(size)
    path = clips["m.avi"].with_name("late.avi")
    path.write_bytes(data)
    source, axis, numbers = follow(path)
    assert numbers.tolist() == list(range(3, COUNT))
    np.testing.assert_allclose(axis.times, np.arange(COUNT - 3) / 30, rtol=0, atol=1e-9)
    assert "delivered 57" in " ".join(source.notes)


def test_frame_that_the_codec_repeats_is_a_duplicate(tmp_path):
    path = write_clip(tmp_path / "frozen.avi", numbers=[0, 1, 2, 2, 2, 3, 4])
    _, axis, _ = follow(path)
    assert axis.duplicated == (3, 4)
    assert "2 frames equal to the one before" in " ".join(axis.notes)
    with pytest.raises(VideoError, match="equal to the one before"):
        follow(path, strict=True)


@pytest.mark.parametrize("name", ["f.avi", "f.mkv", "m.avi", "m.mkv", "v.mp4"])
@pytest.mark.parametrize("seed", range(4))
def test_flipped_bytes_never_pass_unnoticed_nor_crash(clips, name, seed):
    data = bytearray(clips[name].read_bytes())
    rng = np.random.default_rng(seed)
    for at in rng.integers(int(0.3 * len(data)), int(0.8 * len(data)), 200):
        data[at] ^= 0xFF
    path = clips[name].with_name(f"flipped{seed}_{name}")
    path.write_bytes(data)
    source, axis, numbers = follow(path)
    assert 0 < len(numbers) <= COUNT
    assert np.all(np.diff(axis.times) > 0)
    assert np.isfinite(axis.times).all()
    if len(numbers) < COUNT:
        assert f"delivered {len(numbers)}" in " ".join(source.notes)


@pytest.mark.skipif(not CODEC.exists(), reason="the codec clips are not here")
@pytest.mark.parametrize("name", ["h264_bframes.mp4", "vfr_h264.mkv", "mpeg2_ps.mpg"])
@pytest.mark.parametrize("begin", [0.3, 0.6])
def test_zeros_in_compressed_recordings(tmp_path, name, begin):
    whole = tmp_path / name
    whole.write_bytes((CODEC / name).read_bytes())
    source, axis, numbers = follow(zeroed(whole, begin, 0.08))
    assert 0 < len(numbers) <= 120
    assert np.all(np.diff(axis.times) > 0)
    if len(numbers) < 119:
        assert f"delivered {len(numbers)}" in " ".join(source.notes)
    assert axis.times[-1] < 6.0
