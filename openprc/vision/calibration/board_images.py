"""Pictures of boards, from arrays, files, folders and videos."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import CalibrationError, UnreadableFile
from openprc.vision.opencv import load_cv2

_ENDINGS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm", ".webp")


def read_image(image: Any) -> NDArray[np.uint8]:
    """Return one picture as grey levels, (H, W).

    Parameters
    ----------
    image : (H, W) or (H, W, 3) array, or path-like
        Colour is taken to be in OpenCV's order, blue first. More than 8 bits are scaled to the
        picture's own range: only the places of edges count here.

    Raises
    ------
    UnreadableFile, CalibrationError
    """
    cv2 = load_cv2()
    if isinstance(image, str | Path):
        path = Path(image)
        if not path.is_file():
            raise UnreadableFile(
                "this is a folder" if path.is_dir() else "there is no such file",
                expected="a picture",
                fix="check the path",
                file=path,
            )
        # Not imread: it cannot open some paths that are not ASCII.
        data = np.fromfile(path, np.uint8)
        found = (
            cv2.imdecode(data, cv2.IMREAD_ANYDEPTH | cv2.IMREAD_GRAYSCALE) if data.size else None
        )
        if found is None:
            raise UnreadableFile(
                "this is no picture that OpenCV can read",
                expected="PNG, TIFF, JPEG or BMP",
                fix="check the file",
                file=path,
            )
    else:
        found = np.asarray(image)
    if found.ndim == 3 and found.shape[2] in (3, 4) and found.size:
        if found.dtype != np.uint8:
            found = found[..., :3].mean(axis=2)
        else:
            code = cv2.COLOR_BGR2GRAY if found.shape[2] == 3 else cv2.COLOR_BGRA2GRAY
            found = cv2.cvtColor(np.ascontiguousarray(found), code)
    elif found.ndim == 3 and found.shape[2] == 1:
        found = found[..., 0]
    if found.ndim != 2 or found.size == 0 or found.dtype.kind not in "uif":
        raise CalibrationError(
            f"the picture is an array of {found.dtype} with the shape {found.shape}",
            expected="(H, W) grey levels or (H, W, 3) colours",
            fix="pass one picture",
            key="image",
        )
    if found.dtype != np.uint8:
        low, high = float(np.min(found)), float(np.max(found))
        if not np.isfinite([low, high]).all():
            raise CalibrationError(
                "the picture has values that are not finite",
                expected="finite grey levels",
                fix="repair the picture",
                key="image",
            )
        span = (high - low) or 1.0
        found = np.rint((found.astype(np.float64) - low) * (255.0 / span)).astype(np.uint8)
    return np.ascontiguousarray(found)


def pictures(images: Any, *, limit: int = 40) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """Yield names and pictures.

    Parameters
    ----------
    images : iterable of arrays or paths, a folder, a picture, or a video source
        Of a video, frames spread evenly over the whole.
    limit : int
        Largest number of frames of a video.

    Raises
    ------
    UnreadableFile, CalibrationError
    """
    if isinstance(images, str | Path):
        path = Path(images)
        if path.is_dir():
            files = sorted(item for item in path.iterdir() if item.suffix.lower() in _ENDINGS)
            yield from ((item.name, read_image(item)) for item in files)
        elif path.suffix.lower() in _ENDINGS or not path.exists():
            yield path.name, read_image(path)
        else:
            from openprc.vision.source.video_source import VideoSource  # noqa: PLC0415 - rare

            with VideoSource(path) as source:
                yield from _spread(source, limit)
    elif hasattr(images, "frames"):
        yield from _spread(images, limit)
    else:
        yield from _each(images)


def _each(images: Iterable[Any]) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    array = isinstance(images, np.ndarray) and images.ndim == 2
    for index, image in enumerate([images] if array else images):
        name = Path(image).name if isinstance(image, str | Path) else f"image {index}"
        yield name, read_image(image)


def _spread(source: Any, limit: int) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """Every n-th frame, n doubling while there are too many: the count need not be known."""
    kept: list[tuple[int, NDArray[np.uint8]]] = []
    every = 1
    for frame in source.frames():
        if frame.index % every:
            continue
        kept.append((frame.index, np.array(frame.grey)))
        if len(kept) >= 2 * limit:
            every *= 2
            kept = [item for item in kept if item[0] % every == 0]
    step = max(1, -(-len(kept) // limit))
    yield from ((f"frame {index}", picture) for index, picture in kept[::step])
