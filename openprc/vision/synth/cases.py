"""Named clips, each hard in its own way."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from openprc.errors import UnknownName
from openprc.vision.synth.clip import Scene
from openprc.vision.synth.motions import Motion, affine, fold, rotation, standing_wave, translation
from openprc.vision.synth.photometry import Occluder, Photometry
from openprc.vision.synth.textures import Texture, miura, speckle

#: Frames of a cycle of the slow motions.
_CYCLE = 40.0


def _sway(k: float) -> np.ndarray:
    """Return a small sub-pixel motion, (2,) [px]."""
    phase = 2.0 * np.pi * k / _CYCLE
    return np.array([3.3 * np.sin(phase), 2.1 * (1.0 - np.cos(phase))])


def _rise(k: float) -> float:
    """Return how far a deformation has gone: 0 at frame 0, 1 half a cycle later."""
    return 0.5 * (1.0 - np.cos(2.0 * np.pi * k / _CYCLE))


def _reach(k: float) -> float:
    """Return `_rise` for half a cycle, and 1 from then on: most frames are fully deformed."""
    return _rise(min(k, _CYCLE / 2))


def _centre(shape: tuple[int, int]) -> tuple[float, float]:
    return (shape[1] - 1) / 2.0, (shape[0] - 1) / 2.0


def _turned(k: float) -> np.ndarray:
    # To 5 deg and 3 % within a quarter of a cycle, and not back.
    return _swung(min(k, _CYCLE / 4))


def _swung(k: float) -> np.ndarray:
    swing = np.sin(2.0 * np.pi * k / _CYCLE)
    angle, stretch = np.deg2rad(5.0) * swing, 0.03 * swing
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]]) @ np.diag([1.0 + stretch, 1.0 - stretch])


def _fast(step: float) -> Callable[[float], np.ndarray]:
    # A circle, on which every frame is one `step` further.
    radius = 5.0 * step / (2.0 * np.pi)

    def shift(k: float) -> np.ndarray:
        phase = step * k / radius
        return radius * np.array([np.cos(phase) - 1.0, np.sin(phase)])

    return shift


def _flicker(k: float) -> float:
    # No two frames alike, and frame 0 as it is.
    return 1.0 + 0.25 * np.sin(2.4 * k) if k else 1.0


def case(
    name: str,
    *,
    noise: float = 1.0,
    n_frames: int | None = None,
    shape: tuple[int, int] = (360, 480),
    seed: int = 0,
) -> Scene:
    """Return a clip by name; `CASES` lists them.

    Parameters
    ----------
    noise : float
        One-sigma [grey levels].
    n_frames : int, optional
        41 where left out, 1001 for ``long``.
    shape : (int, int) [px]
    seed : int
        Of pattern and noise.

    Raises
    ------
    UnknownName
    """
    if name not in CASES:
        raise UnknownName(
            f"there is no clip {name!r}",
            expected="one of " + ", ".join(CASES),
            fix="choose one of these",
            key="name",
        )
    texture, motion, light, hidden = CASES[name](shape, seed)
    count = n_frames or (1001 if name.startswith("long") else 41)
    bar = None
    if hidden:
        travel = shape[1] + 60.0
        bar = Occluder(width=60.0, left=lambda k: -60.0 + travel * (k - 4) / max(count - 9, 1))
    return Scene(
        texture=texture,
        motion=motion,
        n_frames=count,
        shape=shape,
        photometry=Photometry(noise=noise, **light),
        occluder=bar,
        seed=seed,
    )


_Parts = tuple[Texture, Motion, dict[str, Any], bool]


def _on_speckle(
    motion: Callable[[tuple[int, int]], Motion], *, hidden: bool = False, **light: Any
) -> Callable[[tuple[int, int], int], _Parts]:
    return lambda shape, seed: (speckle(seed=seed), motion(shape), light, hidden)


def _on_miura(
    motion: Callable[[tuple[int, int]], Motion], **light: Any
) -> Callable[[tuple[int, int], int], _Parts]:
    return lambda shape, seed: (miura(seed=seed), motion(shape), light, False)


def _swaying(_shape: tuple[int, int]) -> Motion:
    return translation(_sway)


def _folding(shape: tuple[int, int]) -> Motion:
    return fold(lambda k: 0.12 * _reach(k), crease=_centre(shape)[0])


def _flapping(shape: tuple[int, int]) -> Motion:
    return fold(lambda k: 0.12 * _rise(k), crease=_centre(shape)[0])


def _creasing(shape: tuple[int, int]) -> Motion:
    # One facet stays flat: windows across the crease see a kink.
    return fold(lambda k: 0.12 * _rise(k), crease=_centre(shape)[0], left=lambda _k: 0.0)


def _deforming(shape: tuple[int, int]) -> Motion:
    return affine(_turned, lambda k: 0.5 * _sway(k), centre=_centre(shape))


def _swinging(shape: tuple[int, int]) -> Motion:
    return affine(_swung, lambda k: 0.5 * _sway(k), centre=_centre(shape))


CASES: dict[str, Callable[[tuple[int, int], int], _Parts]] = {
    "translation": _on_speckle(_swaying),
    "affine": _on_speckle(_deforming),
    "rotation": _on_speckle(
        lambda s: rotation(lambda k: np.deg2rad(20.0) * _reach(k), centre=_centre(s))
    ),
    "fold": _on_speckle(_folding),
    "crease": _on_speckle(_creasing),
    "wave": _on_speckle(
        lambda _s: standing_wave(lambda k: 4.0 * np.sin(2 * np.pi * k / _CYCLE), length=160.0)
    ),
    "fast": _on_speckle(lambda _s: translation(_fast(12.6))),
    "very-fast": _on_speckle(lambda _s: translation(_fast(24.0))),
    "miura": _on_miura(_swaying),
    "miura-fold": _on_miura(_folding),
    "flicker": _on_speckle(_swaying, gain=_flicker),
    "gradient": _on_speckle(
        _swaying, gain=lambda k: 1.0 - 0.4 * _rise(k), slope=lambda k: 0.4 * _rise(k)
    ),
    "defocus": _on_speckle(_swaying, defocus=lambda k: 1.2 * _rise(k)),
    "motion-blur": _on_speckle(lambda _s: translation(_fast(12.6)), shutter=0.5),
    "occlusion": _on_speckle(_swaying, hidden=True),
    "wave-occlusion": _on_speckle(
        lambda _s: standing_wave(lambda k: 2.0 * np.sin(2 * np.pi * k / _CYCLE), length=160.0),
        hidden=True,
    ),
    "long": _on_speckle(_swaying),
    "long-affine": _on_speckle(_swinging),
    "long-miura-fold": _on_miura(_flapping),
}
