"""Memory does not grow with the length of a recording; fingerprints of its content."""

from __future__ import annotations

import tracemalloc
import weakref

import numpy as np
import pytest
from video_clips import write_clip

from openprc.vision import ArraySource, VideoSource

cv2 = pytest.importorskip("cv2")


def peak(path):
    """Return the most memory that reading a clip takes beyond what it takes to open it [B]."""
    source = VideoSource(path)
    tracemalloc.start()
    try:
        for frame in source.frames():
            assert frame.grey.size
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_memory_does_not_grow_with_the_length(tmp_path):
    shape = (96, 160)
    short = peak(write_clip(tmp_path / "short.avi", codec="MJPG", count=20, shape=shape))
    long = peak(write_clip(tmp_path / "long.avi", codec="MJPG", count=140, shape=shape))
    # A frame in colour and its grey are four planes; NumPy counts what OpenCV allocates.
    assert long < short + 10 * 1024
    assert short < 12 * shape[0] * shape[1]


def test_two_frames_are_alive_at_a_time(tmp_path):
    alive = []
    most = 0
    for frame in VideoSource(write_clip(tmp_path / "w.avi", count=40)).frames():
        alive.append(weakref.ref(frame.grey))
        most = max(most, sum(reference() is not None for reference in alive))
    assert most <= 2


def test_fingerprint_follows_the_content_and_not_the_name(tmp_path):
    one = write_clip(tmp_path / "one.avi", count=20)
    two = tmp_path / "two.avi"
    two.write_bytes(one.read_bytes())
    other = write_clip(tmp_path / "other.avi", numbers=range(1, 21))
    for full in (False, True):
        hashes = [VideoSource(path).content_hash(full=full) for path in (one, two, other)]
        assert hashes[0] == hashes[1] != hashes[2]
        assert len(hashes[0]) == 64


def test_full_fingerprint_sees_a_byte_that_the_fast_one_skips(tmp_path):
    path = tmp_path / "stack.npy"
    stack = np.random.default_rng(1).integers(0, 255, (60, 320, 320), dtype=np.uint8)
    np.save(path, stack)
    fast, full = (VideoSource(path, fps=1.0).content_hash(full=full) for full in (False, True))
    # 6 MiB: the fast one reads the first, the middle and the last.
    data = bytearray(path.read_bytes())
    data[int(1.8 * 2**20)] ^= 1
    path.write_bytes(data)
    source = VideoSource(path, fps=1.0)
    assert source.content_hash() == fast
    assert source.content_hash(full=True) != full
    data[3 * 2**20] ^= 1
    path.write_bytes(data)
    assert VideoSource(path, fps=1.0).content_hash() != fast


def test_fingerprint_of_images_in_memory():
    stack = np.random.default_rng(1).integers(0, 255, (9, 20, 30), dtype=np.uint8)
    changed = stack.copy()
    changed[7, 3, 3] ^= 1
    one, two = ArraySource(stack, fps=1.0), ArraySource(changed, fps=1.0)
    assert one.content_hash() == ArraySource(stack.copy(), fps=9.0).content_hash()
    assert one.content_hash(full=True) != two.content_hash(full=True)


def test_fingerprint_of_a_folder(tmp_path):
    def folder(name, levels):
        (tmp_path / name).mkdir()
        for k, level in enumerate(levels):
            cv2.imwrite(str(tmp_path / name / f"{name}_{k}.png"), np.full((9, 9), level, np.uint8))
        return VideoSource(tmp_path / name, fps=1.0).content_hash()

    assert folder("a", [1, 2, 3]) == folder("b", [1, 2, 3])
    assert folder("c", [1, 2, 4]) != folder("d", [1, 2, 3])
