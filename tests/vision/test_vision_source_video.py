"""Video files: what is read, what is known beforehand, and what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
from video_clips import FPS, SHAPE, image, read_bar_code, write_clip

from openprc.errors import ConfigError, UnreadableFile, VideoError
from openprc.vision import VideoSource

cv2 = pytest.importorskip("cv2")


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    return write_clip(tmp_path_factory.mktemp("clips") / "waves.avi", count=20)


def axis_of(source):
    frames = [(frame.stamp, frame.duplicate) for frame in source]
    return source.time_axis(
        [stamp for stamp, _ in frames],
        duplicated=[k for k, (_, duplicate) in enumerate(frames) if duplicate],
    )


def test_lossless_frames_come_back_exactly(clip):
    source = VideoSource(clip)
    for frame in source.frames():
        np.testing.assert_array_equal(frame.grey, image(frame.index))
        assert frame.grey.dtype == np.uint8
        assert frame.intensity is frame.grey
        assert frame.stamp == pytest.approx(frame.index / FPS)
        assert not frame.duplicate
    assert frame.index == 19
    assert source.decoded == 20
    assert source.notes == ()


def test_what_the_header_says(clip):
    source = VideoSource(clip)
    assert (source.width, source.height, source.shape) == (SHAPE[1], SHAPE[0], SHAPE)
    assert (source.fps, source.frame_count, source.kind) == (30.0, 20, "video")
    assert (source.container, source.codec.upper()) == ("AVI", "FFV1")
    assert (source.path, source.name) == (clip, "waves.avi")
    assert source.value_range is None


def test_description_is_json_and_names_no_folder(clip):
    text = json.dumps(VideoSource(clip).describe(), allow_nan=False)
    assert str(clip.parent) not in text
    described = json.loads(text)
    assert described["path"] == "waves.avi"
    assert described["grey_conversion"] == "ITU-R BT.601"
    assert len(described["content_hash"]) == 64


def test_read_reset_release_and_with(clip):
    with VideoSource(clip) as source:
        assert source.read().index == 0
        assert source.read().index == 1
        source.reset()
        assert source.read().index == 0
    assert source.read().index == 0
    source.reset()
    count = 0
    while source.read() is not None:
        count += 1
    assert count == 20


def test_two_readers_of_one_source_do_not_disturb_each_other(clip):
    source = VideoSource(clip)
    for one, two in zip(source.frames(), source.frames(), strict=True):
        assert one.index == two.index == read_bar_code(source.read_frame(one.index))
        assert read_bar_code(one.grey) == read_bar_code(two.grey) == one.index


def test_image_that_was_read_may_be_written_on(clip):
    source = VideoSource(clip)
    source.read_frame(3)[:] = 0
    assert read_bar_code(source.read_frame(3)) == 3


@pytest.mark.parametrize("index", [-1, 2.5])
def test_frame_number_that_is_none(clip, index):
    with pytest.raises(ConfigError, match="frame number is"):
        VideoSource(clip).read_frame(index)


def test_start_that_is_none(clip):
    with pytest.raises(ConfigError, match="start is -1"):
        next(VideoSource(clip).frames(start=-1))


def test_first_frame_of_a_later_start_knows_the_one_before(tmp_path):
    source = VideoSource(write_clip(tmp_path / "twice.avi", numbers=[0, 1, 1, 2]))
    assert [frame.duplicate for frame in source.frames(start=2)] == [True, False]


def test_colour_becomes_grey_by_bt601(tmp_path):
    writer = cv2.VideoWriter(
        str(tmp_path / "c.avi"), cv2.VideoWriter.fourcc(*"HFYU"), 30.0, (64, 48)
    )
    picture = np.empty((48, 64, 3), np.uint8)
    picture[:] = (200, 100, 50)
    for _ in range(3):
        writer.write(picture)
    writer.release()
    source = VideoSource(tmp_path / "c.avi")
    assert source.read_frame(0).shape == (48, 64, 3)
    expected = 0.299 * 50 + 0.587 * 100 + 0.114 * 200
    # The codec stores the colours in another space, rounded.
    assert abs(source.read().grey.astype(float) - expected).max() <= 2


def test_sixteen_bit_video_keeps_its_depth(tmp_path):
    rng = np.random.default_rng(0)
    pictures = rng.integers(0, 4096, (4, 48, 64), dtype=np.uint16)
    pictures[0, 0, 0] = 4000
    writer = cv2.VideoWriter(
        str(tmp_path / "deep.avi"),
        cv2.CAP_FFMPEG,
        cv2.VideoWriter.fourcc(*"FFV1"),
        30.0,
        (64, 48),
        [cv2.VIDEOWRITER_PROP_DEPTH, cv2.CV_16U, cv2.VIDEOWRITER_PROP_IS_COLOR, 0],
    )
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no 16-bit FFV1")
    for picture in pictures:
        writer.write(picture)
    writer.release()
    source = VideoSource(tmp_path / "deep.avi")
    assert source.value_range == (0.0, 4095.0)
    assert source.bit_depth == 16
    for frame, picture in zip(source, pictures, strict=True):
        assert frame.intensity.dtype == np.uint16
        np.testing.assert_array_equal(frame.intensity, picture)
        np.testing.assert_array_equal(frame.grey, np.rint(picture * (255 / 4095)))


# --- refused ---


def test_missing_file(tmp_path):
    with pytest.raises(UnreadableFile, match="does not exist"):
        VideoSource(tmp_path / "nothing.mp4")


def test_directory_without_images(tmp_path):
    with pytest.raises(UnreadableFile, match=r"no image(.|\n)*not by its folder"):
        VideoSource(tmp_path)


def test_empty_file(tmp_path):
    (tmp_path / "empty.mp4").touch()
    with pytest.raises(UnreadableFile, match=r"empty \(0 bytes\)"):
        VideoSource(tmp_path / "empty.mp4")


def test_text_in_a_video_name(tmp_path):
    (tmp_path / "text.mp4").write_text("This is no video.\n" * 100)
    with pytest.raises(VideoError, match="not a video: it begins with b'This is no"):
        VideoSource(tmp_path / "text.mp4")


def test_playlist_is_not_followed(tmp_path, clip):
    (tmp_path / "list.m3u8").write_text(f"#EXTM3U\n#EXTINF:1,\n{clip}\n")
    with pytest.raises(VideoError, match="not a video"):
        VideoSource(tmp_path / "list.m3u8")


def test_avi_without_a_frame(tmp_path):
    path = tmp_path / "none.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, (64, 48))
    writer.release()
    with pytest.raises(VideoError, match=r"codec MJPG\) opens but delivers no frame") as caught:
        VideoSource(path)
    assert "opencv-python-headless" in caught.value.fix
    assert caught.value.file == str(path)


def test_av1_that_is_not_decoded_names_the_wheel(clip, monkeypatch):
    from openprc.vision.source.video_file import VideoFile

    monkeypatch.setattr(VideoFile, "images", lambda self, *, start=0: (_ for _ in ()))
    monkeypatch.setattr("openprc.vision.source.video_file.fourcc", lambda code: "AV01")
    with pytest.raises(VideoError, match=r"AV01(.|\n)*4.14 decodes AV1"):
        VideoSource(clip)


def test_name_with_letters_of_many_alphabets(clip, tmp_path):
    path = tmp_path / "Miura 折り紙 été №7.avi"
    path.write_bytes(clip.read_bytes())
    source = VideoSource(path)
    assert source.name == path.name
    assert len(list(source)) == 20


@pytest.mark.parametrize("fps", [0, -1, np.nan])
def test_rate_that_is_none(clip, fps):
    with pytest.raises(ConfigError, match="fps is"):
        VideoSource(clip, fps=fps)


# --- headers that lie ---


def test_declared_rate_that_the_stamps_contradict(clip, monkeypatch):
    class Liar(VideoSource):
        def _begin(self, reader, **options):
            reader.declared_fps = 1000.0
            super()._begin(reader, **options)

    source = Liar(clip)
    assert source.fps == pytest.approx(30.0)
    assert "declares 1000 frames per second" in " ".join(source.notes)
    axis = axis_of(source)
    np.testing.assert_allclose(axis.times, np.arange(20) / 30, rtol=0, atol=1e-9)


def test_neither_rate_nor_stamps_is_refused_on_opening(clip, monkeypatch):
    from openprc.vision.source.video_file import VideoFile

    whole = VideoFile.images

    def without_stamps(self, *, start=0):
        self.declared_fps = 0.0
        for picture, _ in whole(self, start=start):
            yield picture, np.nan

    monkeypatch.setattr(VideoFile, "images", without_stamps)
    with pytest.raises(ConfigError, match=r"no time stamps(.|\n)*option fps"):
        VideoSource(clip)
    axis = axis_of(VideoSource(clip, fps=50.0))
    np.testing.assert_allclose(axis.times, np.arange(20) / 50)


@pytest.mark.parametrize("declared", [-9.2e18, 0.0, 9.2e18])
def test_count_that_is_no_count(clip, declared, monkeypatch):
    real = cv2.VideoCapture

    class Capture:
        def __init__(self, path):
            self._inner = real(path)

        def get(self, key):
            return declared if key == cv2.CAP_PROP_FRAME_COUNT else self._inner.get(key)

        def __getattr__(self, name):
            return getattr(self._inner, name)

    monkeypatch.setattr(cv2, "VideoCapture", Capture)
    source = VideoSource(clip)
    assert source.frame_count == 0
    assert "which is no count" in " ".join(source.notes)
    assert len(list(source)) == 20
    with pytest.raises(VideoError, match="no count"):
        VideoSource(clip, strict=True)


def test_rotation_that_the_container_asks_for(tmp_path):
    path = write_clip(tmp_path / "turned.mp4", codec="mp4v", count=5)
    # The matrix of the track header, 16.16 fixed point: identity, then a turn by 90 degrees.
    upright = (
        b"\x00\x01\x00\x00" + bytes(12) + b"\x00\x01\x00\x00" + bytes(12) + b"\x40\x00\x00\x00"
    )
    turned = (
        bytes(4)
        + b"\x00\x01\x00\x00"
        + bytes(4)
        + b"\xff\xff\x00\x00"
        + bytes(8)
        + (SHAPE[0] << 16).to_bytes(4, "big")
        + bytes(4)
        + b"\x40\x00\x00\x00"
    )
    assert len(upright) == len(turned) == 36
    data = path.read_bytes()
    at = data.index(upright, data.index(b"tkhd"))
    path.write_bytes(data[:at] + turned + data[at + 36 :])
    source = VideoSource(path)
    assert source.orientation in (90, 270)
    assert source.shape == (SHAPE[1], SHAPE[0])
    assert source.read().grey.shape == source.shape
    assert f"rotation by {source.orientation} degrees" in " ".join(source.notes)


def test_interlaced_recording_is_noted(tmp_path):
    path = tmp_path / "woven.avi"
    writer = cv2.VideoWriter(
        str(path), cv2.VideoWriter.fourcc(*"FFV1"), 25.0, SHAPE[::-1], isColor=False
    )
    for k in range(40):
        woven = image(6 * k)
        woven[1::2] = image(6 * k + 3)[1::2]
        writer.write(woven)
    writer.release()
    source = VideoSource(path)
    list(source)
    assert "interlaced" in " ".join(source.notes)


def test_progressive_recordings_are_not_called_interlaced(tmp_path):
    rng = np.random.default_rng(0)
    path = tmp_path / "noise.avi"
    writer = cv2.VideoWriter(
        str(path), cv2.VideoWriter.fourcc(*"FFV1"), 25.0, SHAPE[::-1], isColor=False
    )
    for _ in range(40):
        writer.write(rng.integers(0, 255, SHAPE, dtype=np.uint8))
    writer.release()
    for source in (
        VideoSource(path),
        VideoSource(write_clip(tmp_path / "w.avi", numbers=range(0, 240, 6))),
    ):
        list(source)
        assert source.notes == ()
