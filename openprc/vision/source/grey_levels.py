"""From what a file holds to grey levels: one fixed conversion for the whole clip.

Colour becomes grey as Y = 0.299 R + 0.587 G + 0.114 B (ITU-R BT.601), computed by OpenCV in
the depth of the input. Deeper than 8 bits, the values are kept as `intensity`, and `grey` is
``255 (v - low) / (high - low)``, rounded and clipped, with a range that is the same for every
frame: a range of each frame's own would flicker.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, VideoError
from openprc.vision.opencv import load_cv2
from openprc.vision.source.interlacing import MOSAIC, looks_like_mosaic

#: Depths that cameras have [bit].
_DEPTHS = (8, 10, 12, 14, 16)
_MOSAICS = ("RGGB", "BGGR", "GRBG", "GBRG")


class GreyLevels:
    """Converts the images of one clip.

    Parameters
    ----------
    value_range : (low, high), optional
        The values that become grey 0 and 255. Left out for 8-bit input, where nothing is
        scaled; for 16 bit it is the smallest usual depth (8, 10, 12, 14, 16 bit) that holds
        the first frames, for floating point 0..1 or 0..255.
    bayer : {"RGGB", "BGGR", "GRBG", "GBRG"}, optional
        The images are raw colour mosaics: the colours of the upper left 2 x 2 pixels.
    file : path, optional
        For messages.
    """

    def __init__(
        self,
        value_range: tuple[float, float] | None = None,
        *,
        bayer: str | None = None,
        file: Path | str | None = None,
    ) -> None:
        self.value_range = None if value_range is None else _checked(value_range)
        if bayer is not None and bayer not in _MOSAICS:
            raise ConfigError(
                f"bayer is {bayer!r}",
                expected="one of " + ", ".join(_MOSAICS),
                fix="name the colours of the upper left 2 x 2 pixels, row by row",
                key="bayer",
            )
        self.bayer = bayer
        self.file = file
        self.notes: list[str] = []
        self._form: tuple[tuple[int, ...], np.dtype[Any]] | None = None
        self._type: np.dtype[Any] = np.dtype(np.uint8)
        self._low, self._high = np.inf, -np.inf

    def convert(self, image: NDArray[Any], *, index: int) -> tuple[NDArray[np.uint8], NDArray[Any]]:
        """Return grey (H, W) uint8 and intensity (H, W) of the frame number `index`.

        Raises
        ------
        VideoError
            Another size, number of channels or depth than the first frame; no finite values.
        """
        plane = self._plane(image, index)
        if plane.dtype == np.uint8 and self.value_range is None:
            return plane, plane
        return self._scaled(plane), plane

    def learn(self, image: NDArray[Any], *, index: int) -> None:
        """Look at one of the first frames to find out which values occur."""
        plane = self._plane(image, index)
        if index == 0 and self.bayer is None and looks_like_mosaic(image):
            self._note(MOSAIC)
        self._type = plane.dtype
        if self._type != np.uint8 and self.value_range is None:
            self._low = min(self._low, float(plane.min()))
            self._high = max(self._high, float(plane.max()))

    def settle(self) -> None:
        """Fix the range of values, from what was learned, for the rest of the clip.

        Raises
        ------
        ConfigError
            Floating point values that need a `value_range`.
        """
        if self._type != np.uint8 and self.value_range is None:
            self.value_range = self._default_range()

    def _plane(self, image: NDArray[Any], index: int) -> NDArray[Any]:
        """Return the image in one channel: uint8, uint16 or float32."""
        self._check(image, index)
        if image.dtype == np.bool_:
            image = image.astype(np.uint8) * np.uint8(255)
        elif image.dtype not in (np.uint8, np.uint16):
            # Also puts the bytes of a foreign machine in order.
            small = image.dtype.kind == "u" and image.dtype.itemsize == 2
            image = image.astype(np.uint16 if small else np.float32)
        plane = np.ascontiguousarray(self._one_channel(image))
        if plane.dtype == np.float32 and not np.isfinite(plane).all():
            raise VideoError(
                f"frame {index} holds values that are not finite",
                expected="finite intensities",
                fix="replace them before tracking, masked pixels by the background's value",
                file=self.file,
            )
        return plane

    def _check(self, image: NDArray[Any], index: int) -> None:
        form = (image.shape, image.dtype)
        if self._form is None:
            if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (1, 3, 4)):
                raise VideoError(
                    f"frame {index} has the shape {image.shape}",
                    expected="(H, W), (H, W, 3) blue-green-red or (H, W, 4) with an alpha channel",
                    fix="convert the images to grey first",
                    file=self.file,
                )
            if image.size == 0 or image.dtype.kind not in "buif":
                raise VideoError(
                    f"frame {index} has the shape {image.shape} and the type {image.dtype}",
                    expected="pixels of whole or real numbers",
                    fix="check the images",
                    file=self.file,
                )
            self._form = form
        elif form != self._form:
            raise VideoError(
                f"frame {index} is {_words(*form)}, the frames before are {_words(*self._form)}",
                expected="one size, number of channels and depth in the whole clip",
                fix="split the recording where it changes, or convert the images to one form",
                file=self.file,
            )

    def _one_channel(self, image: NDArray[Any]) -> NDArray[Any]:
        if image.ndim == 2:
            if self.bayer is not None:
                cv2 = load_cv2()
                return cv2.cvtColor(image, getattr(cv2, f"COLOR_Bayer{self.bayer}2GRAY"))
            return image
        if image.shape[2] == 1:
            return image[:, :, 0]
        cv2 = load_cv2()
        if image.shape[2] == 4:
            self._note("the images have an alpha channel, which is not used")
            image = np.ascontiguousarray(image[:, :, :3])
        return cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)

    def _default_range(self) -> tuple[float, float]:
        low, high = self._low, self._high
        if self._type == np.uint16:
            # Blank frames at the start tell nothing.
            depth = next(depth for depth in _DEPTHS if high < 2**depth) if high else 16
            self._note(
                f"16-bit values up to {high:g} in the first frames: grey levels show the range "
                f"0 to {2**depth - 1} ({depth} bit); option value_range sets another"
            )
            return 0.0, 2.0**depth - 1.0
        for top in (1.0, 255.0):
            if low >= 0.0 and high <= top:
                self._note("floating point values: grey levels show the range 0 to {top:g}")
                return 0.0, top
        raise ConfigError(
            f"the values of the first frames go from {low:g} to {high:g}",
            expected="the range of values that grey levels 0 to 255 show, one for the whole clip",
            fix="pass value_range=(low, high)",
            file=self.file,
            key="value_range",
        )

    def _scaled(self, plane: NDArray[Any]) -> NDArray[np.uint8]:
        assert self.value_range is not None  # noqa: S101 - by settle
        low, high = self.value_range
        grey = (plane.astype(np.float32) - np.float32(low)) * np.float32(255.0 / (high - low))
        if grey.min() < -0.5 or grey.max() > 255.5:
            self._note(
                f"values beyond the range {low:g} to {high:g} are clipped in the grey levels; "
                "intensities keep them"
            )
        return np.clip(np.rint(grey), 0, 255).astype(np.uint8)

    def _note(self, text: str) -> None:
        if text not in self.notes:
            self.notes.append(text)


def _words(shape: tuple[int, ...], dtype: np.dtype[Any]) -> str:
    channels = f" x {shape[2]} channels" if len(shape) == 3 else ""
    return f"{shape[1]} x {shape[0]} px{channels} of {dtype}"


def _checked(value_range: tuple[float, float]) -> tuple[float, float]:
    try:
        low, high = (float(value) for value in value_range)
    except (TypeError, ValueError):
        low = high = np.nan
    if not (np.isfinite(low) and np.isfinite(high) and low < high):
        raise ConfigError(
            f"value_range is {value_range!r}",
            expected="two finite numbers, the lower first",
            fix="give the values that become grey 0 and 255, for example (0, 4095)",
            key="value_range",
        )
    return low, high
