"""Small clips whose frames carry their own number, and ways to damage them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

FPS = 30.0
SHAPE = (96, 128)
BITS, CELL = 10, 12


def bar_code(index):
    """Return a strip that shows `index`: ten cells, least significant bit first, white = 1."""
    cells = [255 * (index >> bit & 1) for bit in range(BITS)]
    return np.tile(np.repeat(cells, CELL), (CELL, 1)).astype(np.uint8)


def read_bar_code(grey):
    """Return the number that an image shows."""
    means = [grey[2:10, CELL * bit + 2 : CELL * bit + 10].mean() for bit in range(BITS)]
    return sum(int(mean > 127) << bit for bit, mean in enumerate(means))


def image(index, *, shape=SHAPE):
    """Return frame `index`: waves that move by a pixel a frame, and the number."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    picture = (127 + 100 * np.sin((x - index) / 5.0) * np.cos(y / 7.0)).astype(np.uint8)
    picture[:CELL, : BITS * CELL] = bar_code(index)
    return picture


def write_clip(path, *, codec="FFV1", count=60, fps=FPS, numbers=None, shape=SHAPE):
    """Write a clip; `numbers` are those that the frames show."""
    import cv2

    colour = codec != "FFV1"
    writer = cv2.VideoWriter(
        str(path), cv2.VideoWriter.fourcc(*codec), fps, shape[::-1], isColor=colour
    )
    assert writer.isOpened()
    for number in range(count) if numbers is None else numbers:
        picture = image(number, shape=shape)
        writer.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR) if colour else picture)
    writer.release()
    return Path(path)


def zeroed(path, begin, length, *, name="zeroed"):
    """Return a copy with a stretch of zeros; both are fractions of the file."""
    data = bytearray(Path(path).read_bytes())
    a, b = int(begin * len(data)), int((begin + length) * len(data))
    data[a:b] = bytes(b - a)
    return _written(path, name, data)


def cut_off(path, fraction, *, name="cut"):
    """Return a copy that ends early."""
    data = Path(path).read_bytes()
    return _written(path, name, data[: int(fraction * len(data))])


def patched(path, old, new, *, name="patched", count=1):
    """Return a copy in which the bytes `old` are replaced."""
    data = Path(path).read_bytes()
    assert data.count(old) >= 1
    return _written(path, name, data.replace(old, new, count))


def _written(path, name, data):
    other = Path(path).with_name(f"{name}_{Path(path).name}")
    other.write_bytes(data)
    return other
