"""A scene in front of a camera: frames, and where every point really is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.vision.synth.motions import Motion, forward
from openprc.vision.synth.photometry import Occluder, Photometry
from openprc.vision.synth.textures import Speckle, Texture

if TYPE_CHECKING:
    from openprc.vision.source.arrays import ArraySource

Values = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A pattern that moves, seen by a camera; every frame is made from formulas alone.

    The pattern is evaluated at the places where the pixels of a frame were in frame 0, so no
    image is ever warped and no interpolation limits the truth.

    Parameters
    ----------
    texture : Texture
    motion : Motion
    n_frames : int
    shape : (int, int)
        Height and width [px].
    photometry : Photometry
    occluder : Occluder, optional
    seed : int
        Of the noise.

    Examples
    --------
    >>> import numpy as np
    >>> from openprc.vision.synth import Scene, speckle, translation
    >>> clip = Scene(
    ...     texture=speckle(), motion=translation(lambda k: np.array([0.3 * k, 0.0])),
    ...     n_frames=5, shape=(60, 80),
    ... )
    >>> clip.truth([[40.0, 30.0]])[4]
    array([[41.2, 30. ]])
    """

    texture: Texture = field(default_factory=Speckle)
    motion: Motion
    n_frames: int
    shape: tuple[int, int] = (360, 480)
    photometry: Photometry = field(default_factory=Photometry)
    occluder: Occluder | None = None
    seed: int = 0

    def clean(self, k: int) -> Values:
        """Return frame `k` without noise and rounding, (H, W) [grey levels]."""
        y, x = np.mgrid[: self.shape[0], : self.shape[1]].astype(np.float64)
        light = self.photometry
        blur = light.defocus(k) if light.defocus is not None else 0.0
        if light.shutter and k:
            within = (np.arange(light.exposures) + 0.5) / light.exposures - 0.5
            moments = k + light.shutter * within
        else:
            moments = np.array([float(k)])
        total = np.zeros(self.shape)
        for moment in moments:
            total += self.texture.sample(*self.motion.back(x, y, moment), blur=blur)[0]
        brightness = total / len(moments)
        if self.occluder is not None:
            bar = self.occluder
            own = Speckle(contrast=bar.contrast, mean=bar.level, seed=bar.seed)
            hidden = bar.covers(x, k)
            brightness[hidden] = own.sample(x[hidden] - bar.left(k), y[hidden])[0]
        return light.expose(brightness, k)

    def frame(self, k: int) -> NDArray[np.uint8]:
        """Return frame `k`, (H, W), the same at every call."""
        if not 0 <= k < self.n_frames:
            raise IndexError(f"frame {k} of a clip of {self.n_frames}")
        image = self.clean(k)
        if self.photometry.noise:
            rng = np.random.default_rng([self.seed, k])
            image = image + rng.normal(0.0, self.photometry.noise, self.shape)
        return np.clip(np.rint(image), 0, 255).astype(np.uint8)

    def frames(self) -> Iterator[NDArray[np.uint8]]:
        """Yield all frames in order."""
        for k in range(self.n_frames):
            yield self.frame(k)

    def truth(self, points: ArrayLike) -> Values:
        """Return where points (N, 2) [px] of frame 0 are in every frame, (T, N, 2) [px].

        Also for points behind an occluder or outside the image; see `visible`. NaN stays NaN.
        """
        start = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        known = np.isfinite(start).all(axis=1)
        places = np.full((self.n_frames, len(start), 2), np.nan)
        for k in range(self.n_frames):
            places[k, known] = forward(self.motion, start[known], k)
        return places

    def visible(self, points: ArrayLike, *, margin: float = 0.0) -> NDArray[np.bool_]:
        """Return whether points (N, 2) of frame 0 are seen, (T, N).

        Parameters
        ----------
        margin : float [px]
            Half the window that has to be seen around the point.
        """
        places = self.truth(points)
        height, width = self.shape
        x, y = places[..., 0], places[..., 1]
        seen: NDArray[np.bool_] = (
            (x >= margin) & (x <= width - 1 - margin) & (y >= margin) & (y <= height - 1 - margin)
        )
        if self.occluder is not None:
            for k in range(self.n_frames):
                seen[k] &= ~self.occluder.covers(x[k], k, margin=margin)
        return seen

    def source(self, *, fps: float = 30.0) -> ArraySource:
        """Return the clip as a source of frames for the tracker, made as they are asked for."""
        from openprc.vision.source.arrays import ArraySource  # noqa: PLC0415 - needs OpenCV

        return ArraySource(LazyFrames(self), fps=fps)

    def write(self, path: str | Path, *, codec: str = "FFV1", fps: float = 30.0) -> Path:
        """Write the clip as a video; see `openprc.vision.synth.writing.write_clip`."""
        from openprc.vision.synth.writing import write_clip  # noqa: PLC0415 - needs OpenCV

        return write_clip(self, path, codec=codec, fps=fps)


@dataclass(frozen=True)
class LazyFrames:
    """The frames of a clip as a sequence, none of them kept."""

    clip: Scene

    def __len__(self) -> int:
        return self.clip.n_frames

    def __getitem__(self, k: int) -> NDArray[np.uint8]:
        return self.clip.frame(k)

    def __iter__(self) -> Iterator[NDArray[np.uint8]]:
        return self.clip.frames()
