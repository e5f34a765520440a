"""Photron recordings: every depth by closed form, the header's traps, and a real one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from openprc.errors import UnreadableFile, VideoError
from openprc.vision import VideoSource

cv2 = pytest.importorskip("cv2")

DATA = Path(__file__).resolve().parents[2] / "../shared/data/vision"
HEADER = {
    "Camera Type": "FASTCAM",
    "Record Rate(fps)": 1000,
    "Total Frame": 6,
    "Save Step": 1,
    "Image Width": 10,
    "Image Height": 7,
    "Color Type": "Mono",
    "Color Bit": 8,
    "File Format": "MRaw",
    "EffectiveBit Depth": 12,
    "EffectiveBit Side": "Lower",
}


def pack(values, bits):
    """Write each value with `bits` bits, most significant first, one after the other."""
    if bits == 16:
        return values.astype("<u2").tobytes()
    text = "".join(f"{value:0{bits}b}" for value in values.ravel())
    text += "0" * (-len(text) % 8)
    return int(text, 2).to_bytes(len(text) // 8, "big")


def record(folder, pictures, *, bits, suffix=".cih", **changes):
    fields = {**HEADER, "Color Bit": bits, "Total Frame": len(pictures), **changes}
    text = "#Camera Information Header\n" + "".join(
        f"{name} : {value}\n" for name, value in fields.items() if value is not None
    )
    (folder / f"run{suffix}").write_text(text)
    (folder / "run.mraw").write_bytes(b"".join(pack(picture, bits) for picture in pictures))
    return folder / f"run{suffix}"


@pytest.fixture
def pictures():
    rng = np.random.default_rng(8)
    return lambda bits: rng.integers(0, 2**bits, (6, 7, 10), dtype=np.uint16)


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
@pytest.mark.parametrize("given", ["run.cih", "run.mraw"])
def test_every_depth(tmp_path, pictures, bits, given):
    truth = pictures(bits)
    record(tmp_path, truth, bits=bits, **{"EffectiveBit Depth": bits})
    source = VideoSource(tmp_path / given)
    assert (source.shape, source.fps, source.frame_count) == ((7, 10), 1000.0, 6)
    assert source.kind == "raw"
    for frame, picture in zip(source, truth, strict=True):
        np.testing.assert_array_equal(frame.intensity, picture)
        np.testing.assert_array_equal(frame.grey, np.rint(picture * (255 / (2**bits - 1))))
        assert frame.stamp == pytest.approx(frame.index / 1000)
    assert source.value_range == (None if bits == 8 else (0.0, 2.0**bits - 1))
    np.testing.assert_array_equal(source.read_frame(4), truth[4])
    np.testing.assert_array_equal(source.read_frame(1), truth[1])


def test_values_in_the_lower_bits_of_sixteen(tmp_path, pictures):
    path = record(tmp_path, pictures(12), bits=16, **{"EffectiveBit Side": "Lower"})
    assert VideoSource(path).value_range == (0.0, 4095.0)
    path = record(tmp_path, pictures(12) * 16, bits=16, **{"EffectiveBit Side": "Higher"})
    assert VideoSource(path).value_range == (0.0, 65535.0)


def test_frames_that_were_skipped_on_saving_change_the_rate(tmp_path, pictures):
    path = record(tmp_path, pictures(8), bits=8, **{"Save Step": 4})
    source = VideoSource(path)
    assert source.fps == 250.0
    assert "every 4th frame was kept" in " ".join(source.notes)


def test_xml_header(tmp_path, pictures):
    truth = pictures(12)
    path = record(tmp_path, truth, bits=12)
    path.rename(tmp_path / "old.txt")
    (tmp_path / "run.cihx").write_bytes(
        b"\x00\x01binary head<cih><imageDataInfo><resolution><width>10</width><height>7</height>"
        b"</resolution><colorInfo><type>Mono</type><bit>12</bit></colorInfo></imageDataInfo>"
        b"<recordInfo><recordRate>2000</recordRate></recordInfo>"
        b"<frameInfo><totalFrame>6</totalFrame></frameInfo></cih>\xff\xfe"
    )
    source = VideoSource(tmp_path / "run.mraw")
    assert source.fps == 2000.0
    np.testing.assert_array_equal([frame.intensity for frame in source], truth)


def test_recording_that_was_cut_off(tmp_path, pictures):
    path = record(tmp_path, pictures(8), bits=8)
    raw = tmp_path / "run.mraw"
    raw.write_bytes(raw.read_bytes()[:-75])
    source = VideoSource(path)
    assert len(list(source)) == 4
    assert "declares 6 frames and delivered 4" in " ".join(source.notes)
    with pytest.raises(VideoError, match="declares 6 frames and delivered 4"):
        list(VideoSource(path, strict=True))


def test_more_frames_than_the_header_says(tmp_path, pictures):
    source = VideoSource(record(tmp_path, pictures(8), bits=8, **{"Total Frame": 5}))
    assert len(list(source)) == 5
    assert "room for 6 frames" in " ".join(source.notes)


def test_less_than_one_frame(tmp_path, pictures):
    path = record(tmp_path, pictures(8), bits=8)
    (tmp_path / "run.mraw").write_bytes(b"12345")
    with pytest.raises(VideoError, match="there is no frame"):
        VideoSource(path)


@pytest.mark.parametrize("lacking", ["run.cih", "run.mraw"])
def test_half_of_the_pair(tmp_path, pictures, lacking):
    record(tmp_path, pictures(8), bits=8)
    (tmp_path / lacking).unlink()
    other = "run.mraw" if lacking == "run.cih" else "run.cih"
    with pytest.raises(VideoError, match=f"there is no .*{lacking[3:]}.* beside it"):
        VideoSource(tmp_path / other)
    with pytest.raises(UnreadableFile, match="does not exist"):
        VideoSource(tmp_path / lacking)


@pytest.mark.parametrize("value", [None, "many", 0, -640, "1e99"])
@pytest.mark.parametrize("name", ["Image Width", "Record Rate(fps)", "Color Bit", "Total Frame"])
def test_header_that_lacks_a_number(tmp_path, pictures, name, value):
    path = record(tmp_path, pictures(8), bits=8, **{name: value})
    with pytest.raises(VideoError, match="the header says") as caught:
        VideoSource(path)
    assert caught.value.key == name


@pytest.mark.parametrize(("kind", "bits"), [("Color", 24), ("Mono", 14)])
def test_frames_that_are_not_read_here(tmp_path, pictures, kind, bits):
    path = record(tmp_path, pictures(8), bits=8, **{"Color Type": kind, "Color Bit": bits})
    with pytest.raises(VideoError, match=f"{kind} frames of {bits} bit(.|\n)*export"):
        VideoSource(path)


@pytest.mark.skipif(not DATA.exists(), reason="the recorded videos are not here")
def test_real_recording():
    source = VideoSource(DATA / "beam_highspeed.cih")
    assert (source.shape, source.frame_count) == ((40, 640), 75)
    # Recorded at 15 kHz, every 100th frame kept.
    assert source.fps == 150.0
    raw = np.fromfile(DATA / "beam_highspeed.mraw", dtype=np.uint8).reshape(75, 40, 640)
    np.testing.assert_array_equal([frame.grey for frame in source], raw)
