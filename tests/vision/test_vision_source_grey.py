"""Grey levels from whatever the images hold: one conversion for the whole clip."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import ConfigError, VideoError
from openprc.vision import ArraySource

cv2 = pytest.importorskip("cv2")

RNG = np.random.default_rng(5)


def source_of(stack, **options):
    return ArraySource(stack, fps=1.0, **options)


def test_eight_bit_grey_is_left_alone():
    stack = RNG.integers(10, 60, (3, 20, 30), dtype=np.uint8)
    source = source_of(stack)
    for frame, picture in zip(source, stack, strict=True):
        np.testing.assert_array_equal(frame.grey, picture)
        assert frame.intensity is frame.grey
    assert source.value_range is None


@pytest.mark.parametrize("channels", [3, 4])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_colour_is_weighted_by_bt601(channels, dtype):
    top = {"u": np.iinfo(np.uint8).max, "f": 1.0}[np.dtype(dtype).kind]
    top = 65535 if dtype is np.uint16 else top
    stack = (RNG.uniform(0, 1, (2, 20, 30, channels)) * top).astype(dtype)
    blue, green, red = (stack[..., k].astype(float) for k in range(3))
    expected = 0.114 * blue + 0.587 * green + 0.299 * red
    source = source_of(stack)
    for frame, level in zip(source, expected, strict=True):
        assert frame.intensity.dtype == dtype
        # OpenCV weighs whole numbers in fixed point of 14 bit.
        off = {np.uint8: 0.6, np.uint16: 2.0, np.float32: 1e-5}[dtype]
        np.testing.assert_allclose(frame.intensity, level, rtol=0, atol=off)
        np.testing.assert_allclose(frame.grey, level * 255 / top, atol=1.2)
    assert ("alpha channel, which is not used" in " ".join(source.notes)) == (channels == 4)


@pytest.mark.parametrize(
    ("top", "depth"), [(200, 8), (1000, 10), (4000, 12), (16000, 14), (65535, 16), (0, 16)]
)
def test_sixteen_bit_range_is_the_depth_that_holds_the_first_frames(top, depth):
    stack = np.zeros((12, 20, 30), np.uint16)
    stack[5, 3, 3] = top
    source = source_of(stack)
    assert source.value_range == (0.0, 2.0**depth - 1)
    assert f"({depth} bit)" in " ".join(source.notes)


def test_range_does_not_change_from_frame_to_frame():
    stack = np.stack([np.full((20, 30), 40 * k, np.uint16) for k in range(1, 12)])
    source = source_of(stack)
    levels = [int(frame.grey[0, 0]) for frame in source]
    assert levels == [round(40 * k * 255 / 1023) for k in range(1, 12)]


def test_values_beyond_the_range_are_clipped_and_told():
    stack = np.full((12, 20, 30), 900, np.uint16)
    stack[10] = 5000
    source = source_of(stack)
    frames = list(source)
    assert frames[10].grey.max() == 255
    assert frames[10].intensity.max() == 5000
    assert "clipped in the grey levels" in " ".join(source.notes)


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.float16])
@pytest.mark.parametrize("top", [1.0, 255.0])
def test_real_numbers(dtype, top):
    stack = (RNG.uniform(0.1, 1.0, (2, 20, 30)) * top).astype(dtype)
    source = source_of(stack)
    assert source.value_range == (0.0, top)
    for frame, picture in zip(source, stack, strict=True):
        assert frame.intensity.dtype == np.float32
        np.testing.assert_allclose(frame.grey, picture.astype(float) * 255 / top, atol=0.51)


def test_real_numbers_of_another_range_need_it():
    stack = RNG.normal(0, 1000, (2, 20, 30))
    with pytest.raises(
        ConfigError, match=r"values of the first frames go from -(.|\n)*value_range="
    ):
        source_of(stack)
    frame = next(iter(source_of(stack, value_range=(-5000, 5000))))
    np.testing.assert_allclose(frame.grey, (stack[0] + 5000) * 255 / 10000, atol=0.51)


@pytest.mark.parametrize("value_range", [(1, 0), (0, 0), (0, np.inf), (1,), "ab"])
def test_range_that_is_none(value_range):
    with pytest.raises(ConfigError, match="value_range is"):
        source_of(np.zeros((2, 20, 30), np.uint16), value_range=value_range)


def test_values_that_are_not_finite_name_the_frame():
    stack = np.zeros((10, 20, 30), np.float32)
    stack[9, 4, 4] = np.nan
    with pytest.raises(VideoError, match="frame 9 holds values that are not finite"):
        list(source_of(stack))


def test_switches_and_signed_numbers():
    frame = next(iter(source_of(RNG.integers(0, 2, (2, 20, 30)).astype(bool))))
    assert set(np.unique(frame.grey)) == {0, 255}
    stack = RNG.integers(0, 200, (2, 20, 30), dtype=np.int32)
    np.testing.assert_array_equal(next(iter(source_of(stack))).grey, stack[0])


def test_bytes_of_a_foreign_machine():
    stack = RNG.integers(0, 4096, (2, 20, 30), dtype=np.uint16)
    frame = next(iter(source_of(stack.astype(">u2"))))
    assert frame.intensity.dtype == np.uint16
    np.testing.assert_array_equal(frame.intensity, stack[0])


def test_eight_bit_with_a_range_is_stretched():
    stack = RNG.integers(50, 101, (2, 20, 30), dtype=np.uint8)
    frame = next(iter(source_of(stack, value_range=(50, 100))))
    np.testing.assert_allclose(frame.grey, (stack[0] - 50.0) * 5.1, atol=0.501)
    np.testing.assert_array_equal(frame.intensity, stack[0])


@pytest.mark.parametrize("bayer", ["RGGB", "BGGR", "GRBG", "GBRG"])
def test_colour_mosaic(bayer):
    colour = {"R": 200, "G": 120, "B": 40}
    cell = np.array([colour[letter] for letter in bayer], np.uint8).reshape(2, 2)
    stack = np.tile(cell, (3, 16, 16))
    assert "colour mosaic (Bayer)" in " ".join(source_of(stack).notes)
    source = source_of(stack, bayer=bayer)
    grey = next(iter(source)).grey
    expected = 0.299 * 200 + 0.587 * 120 + 0.114 * 40
    assert abs(grey[2:-2, 2:-2].astype(float) - expected).max() <= 1
    assert source.notes == ()


def test_mosaic_that_is_none():
    with pytest.raises(ConfigError, match="bayer is 'RGB'"):
        source_of(np.zeros((2, 20, 30), np.uint8), bayer="RGB")
