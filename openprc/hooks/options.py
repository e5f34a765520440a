"""Options of importers, runners and exporters: text or values, checked once."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from openprc.errors import ConfigError
from openprc.hooks.specs import ExporterSpec, OptionSpec, ProducerSpec

_TRUE, _FALSE = ("1", "true", "yes", "on"), ("0", "false", "no", "off")


def resolve_options(
    spec: ProducerSpec, given: Mapping[str, Any], *, trust: bool = False
) -> dict[str, Any]:
    """Return every option of an importer, defaults filled in and values of the stated kind.

    Raises
    ------
    ConfigError
        When an option is unknown (the nearest known one is named) or has a wrong value.
    """
    values = check_options(spec, spec.options, given)
    if spec.trusts_pickle:
        values["trust"] = bool(trust)
    return values


def check_options(
    spec: ProducerSpec | ExporterSpec, options: tuple[OptionSpec, ...], given: Mapping[str, Any]
) -> dict[str, Any]:
    """Return every one of `options`, defaults filled in and values of the stated kind.

    Raises
    ------
    ConfigError
        When an option is unknown (the nearest known one is named) or has a wrong value.
    """
    known = {option.name: option for option in options}
    for name in given:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            raise ConfigError(
                f"{spec.name} has no option {name!r}",
                expected="one of " + (", ".join(known) or "none: it takes no options"),
                fix=f"did you mean {near[0]!r}?" if near else "leave it out",
                key=name,
            )
    return {name: _value(spec, option, given.get(name)) for name, option in known.items()}


def _value(spec: ProducerSpec | ExporterSpec, option: OptionSpec, given: Any) -> Any:
    if given is None:
        return option.default if not option.multiple else tuple(option.default or ())
    if option.multiple:
        items = given if isinstance(given, list | tuple) else (given,)
        return tuple(_one(spec, option, item) for item in items)
    if isinstance(given, list | tuple):
        if len(given) != 1:
            raise _wrong(spec, option, f"given {len(given)} times", "one value")
        given = given[0]
    return _one(spec, option, given)


def _one(spec: ProducerSpec | ExporterSpec, option: OptionSpec, given: Any) -> Any:
    if option.choices and str(given) not in option.choices:
        raise _wrong(spec, option, repr(given), "one of " + ", ".join(option.choices))
    if option.kind == "str":
        return str(given)
    if option.kind == "path":
        if not isinstance(given, str | Path) or not str(given):
            raise _wrong(spec, option, repr(given), "a path")
        return Path(given)
    if option.kind == "bool":
        text = str(given).lower()
        if text in _TRUE or text in _FALSE:
            return text in _TRUE
        raise _wrong(spec, option, repr(given), "true or false")
    return _number(spec, option, given)


def _number(spec: ProducerSpec | ExporterSpec, option: OptionSpec, given: Any) -> int | float:
    whole = option.kind == "int"
    expected = "a whole number" if whole else "a finite number"
    if isinstance(given, bool):
        raise _wrong(spec, option, repr(given), expected)
    try:
        number = int(given) if whole else float(given)
    except (TypeError, ValueError, OverflowError):
        raise _wrong(spec, option, repr(given), expected) from None
    # int(1.5) is 1; nobody asked for that.
    lost = whole and not isinstance(given, str) and number != given
    if lost or not math.isfinite(number):
        raise _wrong(spec, option, repr(given), expected)
    return number


def _wrong(
    spec: ProducerSpec | ExporterSpec, option: OptionSpec, found: str, expected: str
) -> ConfigError:
    return ConfigError(
        f"option {option.name} of {spec.name} is {found}",
        expected=expected,
        fix=option.help,
        key=option.name,
    )
