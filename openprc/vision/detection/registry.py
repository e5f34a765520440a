"""Detectors by name: built in, registered by a plugin, or by the user's own script."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import ConfigError, UnknownName
from openprc.hooks.registry import default_registry, resolve
from openprc.vision.detection.feature_map import FeatureMap
from openprc.vision.opencv import load_cv2

#: Other names of built-in detectors.
ALIASES = {"shi-tomasi": "gftt", "good-features-to-track": "gftt"}

_HOOK = "openprc_detectors"
_OWN: dict[str, Callable[..., Any]] = {}


def register_detector(name: str, factory: Callable[..., Any], *, overwrite: bool = False) -> None:
    """Make a detector known to `detect` in this process; a plugin uses the hook instead.

    Parameters
    ----------
    name : str
    factory : callable
        Called with the settings; returns an object whose ``detect(image)`` gives the points
        (N, 2) [px] of a grey image, or a `FeatureMap`. A class will do.
    overwrite : bool
        Replace a detector of this name that was registered before. Built-in names stay.

    Raises
    ------
    ConfigError
        The name is taken, or the factory cannot be called.
    """
    taken = name in _OWN and not overwrite
    if taken or name in ALIASES or name in _hook_names():
        raise ConfigError(
            f"there is a detector {name!r} already",
            expected="a new name",
            fix="choose another name" + (", or pass overwrite=True" if taken else ""),
            key="name",
        )
    if not callable(factory):
        raise ConfigError(
            f"the factory is {type(factory).__name__}, which cannot be called",
            expected="a class or a function that returns a detector",
            fix="register the class instead of an instance",
            key="factory",
        )
    _OWN[name] = factory


def detector_names() -> tuple[str, ...]:
    """Return the names that `detect` takes, without aliases."""
    return tuple(dict.fromkeys((*_hook_names(), *_OWN)))


def get_detector(name: str, **settings: Any) -> Any:
    """Return a detector.

    Parameters
    ----------
    name : str
        ``sift``, ``orb``, ``akaze``, ``gftt`` (also ``shi-tomasi``), or a registered one.
    **settings
        Its own settings; see `openprc.vision.detection.detectors`.

    Raises
    ------
    UnknownName
        There is no such detector.
    ConfigError
        It has no such setting.
    """
    known = ALIASES.get(name, name)
    if known in _OWN:
        return _made(known, _OWN[known], settings)
    if known in _hook_names() or "/" in known:
        item = default_registry().find(_HOOK, known)
        return _made(known, resolve(item, item.spec.load), settings)
    names = (*detector_names(), *ALIASES)
    near = difflib.get_close_matches(name, names, n=1)
    raise UnknownName(
        f"there is no detector {name!r}",
        expected="one of " + ", ".join(names),
        fix=f"did you mean {near[0]!r}?" if near else "choose one of these, or register yours",
        key="detector",
    )


def detect(
    image: ArrayLike,
    method: str = "sift",
    *,
    mask: ArrayLike | None = None,
    ref_frame_index: int = 0,
    **settings: Any,
) -> FeatureMap:
    """Return the features of an image, strongest first.

    Parameters
    ----------
    image : (H, W), (H, W, 3) blue-green-red or (H, W, 4)
        8 bit as it is; deeper images by the fixed scaling of
        `openprc.vision.source.grey_levels`.
    method : str
        Name of the detector; see `get_detector`.
    mask : (H, W), optional
        0 or False where nothing is wanted.
    ref_frame_index : int
        Number of the frame, kept with the result.
    **settings
        Of the detector.

    Returns
    -------
    FeatureMap
        With one keypoint for each orientation, as the detector gives them; `FeatureMap.top_n`
        and `FeatureMap.unique` keep one for each place.

    Raises
    ------
    NoFeaturesError
        Nothing is found.
    ConfigError
        A wrong setting, mask or image.
    """
    grey = grey_image(image)
    allowed = None if mask is None else mask_image(mask, grey.shape)
    detector = get_detector(method, **settings)
    found = _found(detector, grey, allowed, method)
    found = replace(found, ref_frame_index=int(ref_frame_index))
    return found.require(hint=_why_nothing(grey, allowed) if not len(found) else "")


def grey_image(image: ArrayLike) -> NDArray[np.uint8]:
    """Return an image as 8-bit grey levels (H, W)."""
    from openprc.vision.source.grey_levels import GreyLevels  # noqa: PLC0415 - needs OpenCV

    return GreyLevels().convert(np.ascontiguousarray(image), index=0)[0]


def mask_image(mask: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return a mask as (H, W) uint8, 0 where nothing is wanted and 255 elsewhere.

    Raises
    ------
    ConfigError
        Another size than the image, or nothing is left.
    """
    given = np.asarray(mask)
    if given.ndim == 3:
        given = given.max(axis=2)
    if given.shape != tuple(shape):
        size = " x ".join(str(edge) for edge in given.shape[::-1])
        raise ConfigError(
            f"a mask of {size} px",
            expected=f"{shape[1]} x {shape[0]} px, as the image",
            fix="draw the mask over a frame of this video",
            key="mask",
        )
    allowed = np.where(given != 0, np.uint8(255), np.uint8(0))
    if not allowed.any():
        raise ConfigError(
            "the mask is 0 everywhere",
            expected="white where points are wanted",
            fix="invert it, or leave it out",
            key="mask",
        )
    return allowed


def _hook_names() -> tuple[str, ...]:
    return tuple(item.name for item in default_registry().records(_HOOK))


def _made(name: str, factory: Callable[..., Any], settings: dict[str, Any]) -> Any:
    if is_dataclass(factory):
        names = [f.name for f in fields(factory)]
        unknown = [key for key in settings if key not in names]
        if unknown:
            near = difflib.get_close_matches(unknown[0], names, n=1)
            raise ConfigError(
                f"the detector {name!r} has no setting {unknown[0]!r}",
                expected="some of " + ", ".join(names),
                fix=f"did you mean {near[0]!r}?" if near else "leave it out",
                key=unknown[0],
            )
        defaults = {f.name: f.default for f in fields(factory)}
        for key, value in settings.items():
            _check_number(name, key, value, defaults[key])
        return factory(**settings)
    try:
        return factory(**settings)
    except TypeError as error:
        raise ConfigError(
            f"the detector {name!r} does not take {', '.join(settings) or 'no settings'}: {error}",
            expected="settings that its factory knows",
            fix="look at its documentation",
            key="detector",
        ) from error


def _check_number(name: str, key: str, value: Any, default: Any) -> None:
    right = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if right and isinstance(default, int):
        right = float(value).is_integer()
    if not right or not np.isfinite(value) or value < 0:
        kind = "a whole number" if isinstance(default, int) else "a number"
        raise ConfigError(
            f"{key} of the detector {name!r} is {value!r}",
            expected=f"{kind} from 0",
            fix=f"the default is {default}",
            key=key,
        )


def _found(
    detector: Any, grey: NDArray[np.uint8], mask: NDArray[np.uint8] | None, name: str
) -> FeatureMap:
    if hasattr(detector, "features"):
        try:
            found: FeatureMap = detector.features(grey, mask=mask)
        except load_cv2().error as error:
            raise ConfigError(
                f"OpenCV's {name} refuses its settings or the image: {error.err}",
                expected="settings within the ranges of OpenCV's documentation",
                fix="leave settings out one by one",
                key="detector",
            ) from error
        return found
    given = detector.detect(grey)
    if not isinstance(given, FeatureMap):
        given = FeatureMap.from_points(
            given, frame_shape=grey.shape, image=grey, detector_name=name
        )
    return given if mask is None else given.filter_by_mask(mask)


def _why_nothing(grey: NDArray[np.uint8], mask: NDArray[np.uint8] | None) -> str:
    seen = grey if mask is None else grey[mask != 0]
    low, high = int(seen.min()), int(seen.max())
    if low == high:
        return (
            f"; the image is {'black' if high == 0 else 'white' if low == 255 else 'blank'}, "
            f"grey level {low} everywhere"
        )
    saturated = float(np.mean((seen == 0) | (seen == 255)))
    if saturated > 0.5:
        return f"; {saturated:.0%} of the pixels are black or white (saturated)"
    return f"; grey levels go from {low} to {high}"
