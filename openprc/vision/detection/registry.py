"""Detectors by name: built in, registered by a plugin, or by the user's own script."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from inspect import Parameter, signature
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import ConfigError, UnknownName
from openprc.hooks.faults import owned_by
from openprc.hooks.registry import default_registry, resolve
from openprc.vision.detection.detectors import OpenCVDetector
from openprc.vision.detection.feature_map import FeatureMap
from openprc.vision.detection.images import grey_image, mask_image, why_nothing
from openprc.vision.opencv import conflict_note, load_cv2

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
    near = difflib.get_close_matches(str(name).lower().replace("_", "-"), names, n=1)
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
    value_range: tuple[float, float] | None = None,
    **settings: Any,
) -> FeatureMap:
    """Return the features of an image, strongest first.

    Parameters
    ----------
    image : (H, W), (H, W, 3) blue-green-red or (H, W, 4)
        8 bit as it is; deeper images are scaled, see `openprc.vision.detection.images`.
    method : str
        Name of the detector; see `get_detector`.
    mask : (H, W), optional
        0 or False where nothing is wanted.
    ref_frame_index : int
        Number of the frame, kept with the result.
    value_range : (low, high), optional
        The values that become grey 0 and 255 in an image deeper than 8 bits.
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
        A wrong setting or mask.
    VideoError
        What was passed is no image.
    """
    grey, notes = grey_image(image, value_range=value_range)
    allowed = None if mask is None else mask_image(mask, grey.shape)
    detector = get_detector(method, **settings)
    found = _found(detector, grey, allowed, method)
    conflict = conflict_note()
    notes = (*notes, *found.notes, *((conflict,) if conflict else ()))
    found = replace(found, ref_frame_index=int(ref_frame_index), notes=notes)
    return found.require(hint=why_nothing(grey, allowed) if not len(found) else "")


def identity(name: str) -> str | None:
    """Return what tells a detector from others that may have its name one day, for a cache.

    None for one that this process registered itself: its code may change without a sign.
    """
    known = ALIASES.get(name, name)
    if known in _OWN:
        return None
    item = default_registry().find(_HOOK, known)
    return f"{item.qualified_name} {item.version}"


def _hook_names() -> tuple[str, ...]:
    return tuple(item.name for item in default_registry().records(_HOOK))


def _made(name: str, factory: Callable[..., Any], settings: dict[str, Any]) -> Any:
    names, open_ended = _settings_of(factory)
    unknown = [] if open_ended else [key for key in settings if key not in names]
    if unknown:
        near = difflib.get_close_matches(unknown[0], names, n=1)
        raise ConfigError(
            f"the detector {name!r} has no setting {unknown[0]!r}",
            expected="some of " + ", ".join(names) if names else "no settings",
            fix=f"did you mean {near[0]!r}?" if near else "leave it out",
            key=unknown[0],
        )
    if not (isinstance(factory, type) and issubclass(factory, OpenCVDetector)):
        return factory(**settings)
    defaults = {f.name: f.default for f in fields(factory)}  # type: ignore[arg-type]
    return factory(
        **{key: _checked(name, key, value, defaults[key]) for key, value in settings.items()}
    )


def _settings_of(factory: Callable[..., Any]) -> tuple[list[str], bool]:
    """Return the names that a factory takes, and whether it takes others, too."""
    if is_dataclass(factory):
        return [f.name for f in fields(factory)], False
    try:
        parameters = signature(factory).parameters.values()
    except ValueError:
        # Compiled code need not say.
        return [], True
    named = (Parameter.KEYWORD_ONLY, Parameter.POSITIONAL_OR_KEYWORD)
    rest = any(parameter.kind is Parameter.VAR_KEYWORD for parameter in parameters)
    return [parameter.name for parameter in parameters if parameter.kind in named], rest


def _checked(name: str, key: str, value: Any, default: Any) -> Any:
    """Return a setting as the type that its default has."""
    if not isinstance(default, int | float):
        return value
    kind: Any = type(default)
    right = isinstance(value, int | float | np.number | np.bool_)
    if kind is bool:
        right = right and value in (0, 1)
    else:
        right = right and not isinstance(value, bool | np.bool_)
        right = right and bool(np.isfinite(value)) and value >= 0 and kind(value) == value
    if not right:
        words = {bool: "True or False", int: "a whole number from 0", float: "a number from 0"}
        raise ConfigError(
            f"{key} of the detector {name!r} is {value!r}",
            expected=words[kind],
            fix=f"the default is {default}",
            key=key,
        )
    return kind(value)


def _found(
    detector: Any, grey: NDArray[np.uint8], mask: NDArray[np.uint8] | None, name: str
) -> FeatureMap:
    if callable(getattr(detector, "features", None)):
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
    owner = identity(name)
    if owner is None:
        given = detector.detect(grey)
    else:
        with owned_by(owner, "detecting"):
            given = detector.detect(grey)
    if not isinstance(given, FeatureMap):
        given = FeatureMap.from_points(given, frame_shape=grey.shape, detector_name=name)
    if np.isnan(given.track_sigma).all():
        given = given.rated(grey)
    return given if mask is None else given.filter_by_mask(mask)
