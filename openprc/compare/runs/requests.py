"""Which producer, with which settings: ``demlat:verlet:dt=1e-4``, read once and checked."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

from openprc.demlat.integrators import INTEGRATORS
from openprc.errors import ConfigError
from openprc.hooks.options import check_options
from openprc.hooks.registry import Registry, default_registry
from openprc.schema.experiment import PRECISIONS, Experiment

if TYPE_CHECKING:
    from openprc.hooks.registry import Registered

#: Settings of an experiment that a request may change; all but the last two are numbers.
SETTINGS = ("dt", "tolerance", "constraint_tolerance", "accuracy", "integrator", "precision")
_SYNTAX = "NAME, NAME:SETTING or NAME:SETTING:SETTING, such as demlat:verlet:dt=1e-4"


@dataclass(frozen=True, kw_only=True)
class Request:
    """A producer and what is to be different from the experiment as it stands.

    Parameters
    ----------
    name : str
        As typed; what tables call the run.
    producer : str
    changes : mapping
        Fields of `Experiment`, from `SETTINGS`.
    options : mapping
        Options of the producer (`openprc.hooks.specs.ProducerSpec.run_options`), as given.
    """

    name: str
    producer: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def file_stem(self) -> str:
        """The name, fit for a file."""
        return re.sub(r"[^A-Za-z0-9._=+-]+", "-", self.name).strip("-.") or "run"

    def changed(self, experiment: Experiment) -> Experiment:
        """Return the experiment with the settings of this request."""
        return replace(experiment, **self.changes) if self.changes else experiment


def read_requests(
    text: str | Iterable[str],
    *,
    options: Iterable[str] = (),
    registry: Registry | None = None,
) -> tuple[Request, ...]:
    """Return the requests of a list such as ``"demlat,demlat:verlet:float32,pybullet"``.

    After the name of a producer come settings, each after a colon: the name of an integrator,
    ``float64`` or ``float32`` (the precision of the state), or ``KEY=VALUE``, where KEY is one
    of `SETTINGS` or an option of the producer. A key that is both is the producer's.

    Parameters
    ----------
    text : str or iterable of str
        One string is split at commas.
    options : iterable of str
        More settings in the same form, for every request of that producer.
    registry : Registry, optional

    Raises
    ------
    ConfigError
        When nothing, or something twice, is asked for, or a setting is not known.
    UnknownName, AmbiguousName
        When there is no such producer, or several.

    Examples
    --------
    >>> from openprc.compare.runs.requests import read_requests
    >>> one, two = read_requests("demlat,demlat:verlet:dt=1e-4")
    >>> two.producer, dict(two.changes)
    ('demlat', {'integrator': 'verlet', 'dt': 0.0001})
    """
    registry = registry or default_registry()
    words = text.split(",") if isinstance(text, str) else list(text)
    named = [word.strip() for word in words if word.strip()]
    if not named:
        raise ConfigError(
            "no producer is named",
            expected="a list such as demlat,pybullet",
            fix="see `openprc plugins`",
            key="--producers",
        )
    requests = [_one(word, registry, key="--producers") for word in named]
    for extra in options:
        added = _one(extra.strip(), registry, key="--options")
        meant = [n for n, request in enumerate(requests) if request.producer == added.producer]
        if not meant:
            raise ConfigError(
                f"{extra!r} is about {added.producer}, which is not compared",
                expected="settings of one of " + ", ".join(r.producer for r in requests),
                fix="correct the name, or add it to --producers",
                key="--options",
            )
        for number in meant:
            before = requests[number]
            requests[number] = replace(
                before,
                changes={**added.changes, **before.changes},
                options={**added.options, **before.options},
            )
    names = [request.name for request in requests]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ConfigError(
            f"{twice!r} is named twice",
            expected="every producer once for each of its settings",
            fix="leave one out, or give it other settings, such as demlat:verlet",
            key="--producers",
        )
    return tuple(requests)


def with_scene_options(
    requests: Iterable[Request], scene_name: str
) -> tuple[tuple[Request, ...], dict[str, dict[str, Any]]]:
    """Give requests the options with which their producers come closest to a scene.

    What a request says itself stands. A scene that is not in the library asks for nothing.

    Parameters
    ----------
    requests : iterable of Request
    scene_name : str

    Returns
    -------
    requests : tuple of Request
    added : mapping of str to mapping
        Name of a request to the options that it did not name itself.
    """
    from openprc.scenes.catalog import SCENES  # noqa: PLC0415 - only for scenes

    wanted = SCENES[scene_name].run_options if scene_name in SCENES else {}
    told, added = [], {}
    for request in requests:
        more = {
            key: value
            for key, value in wanted.get(request.producer, {}).items()
            if key not in request.options
        }
        if more:
            added[request.name] = more
        told.append(replace(request, options={**more, **request.options}))
    return tuple(told), added


def _one(text: str, registry: Registry, *, key: str) -> Request:
    producer, *settings = (part.strip() for part in text.split(":"))
    if not producer or not all(settings):
        raise ConfigError(
            f"{text!r} has an empty part", expected=_SYNTAX, fix="correct it", key=key
        )
    item = registry.producer(producer)
    changes: dict[str, Any] = {}
    options: dict[str, Any] = {}
    for setting in settings:
        name, equals, value = setting.partition("=")
        if not equals:
            name, value = _word(setting, item, text=text, key=key), setting
        known = {option.name for option in item.spec.run_options}
        if name in known:
            options[name] = value
        elif name in SETTINGS:
            changes[name] = _setting(name, value, text=text, key=key)
        else:
            raise _unknown(name, item, text=text, key=key)
    check_options(item.spec, item.spec.run_options, options)
    return Request(name=text, producer=producer, changes=changes, options=options)


def _word(setting: str, item: Registered, *, text: str, key: str) -> str:
    if setting in INTEGRATORS:
        return "integrator"
    if setting in PRECISIONS:
        return "precision"
    owners = [option.name for option in item.spec.run_options if setting in option.choices]
    if len(owners) == 1:
        return owners[0]
    raise _unknown(setting, item, text=text, key=key)


def _setting(name: str, value: str, *, text: str, key: str) -> Any:
    if name not in {column.name for column in fields(Experiment)}:
        raise ConfigError(
            f"{text!r} sets {name}, which experiments do not have",
            expected="one of " + ", ".join(SETTINGS),
            fix="leave it out",
            key=key,
        )
    choices = {"integrator": tuple(INTEGRATORS), "precision": PRECISIONS}.get(name)
    if choices is not None:
        if value in choices:
            return value
        raise _wrong(name, value, "one of " + ", ".join(choices), text=text, key=key)
    try:
        number = float(value)
    except ValueError:
        raise _wrong(name, value, "a number", text=text, key=key) from None
    if not 0.0 < number < float("inf"):
        raise _wrong(name, value, "a positive, finite number", text=text, key=key)
    return number


def _wrong(name: str, value: str, expected: str, *, text: str, key: str) -> ConfigError:
    return ConfigError(
        f"{name} in {text!r} is {value!r}", expected=expected, fix="correct it", key=key
    )


def _unknown(name: str, item: Registered, *, text: str, key: str) -> ConfigError:
    options = [option.name for option in item.spec.run_options]
    near = difflib.get_close_matches(name, [*INTEGRATORS, *PRECISIONS, *SETTINGS, *options], n=1)
    known = ", ".join([*SETTINGS, *options])
    return ConfigError(
        f"{item.name} has no setting {name!r} (in {text!r})",
        expected=f"an integrator, float32, float64, or KEY=VALUE with one of {known}",
        fix=f"did you mean {near[0]!r}?" if near else _SYNTAX,
        key=key,
    )


__all__ = ["SETTINGS", "Request", "read_requests", "with_scene_options"]
