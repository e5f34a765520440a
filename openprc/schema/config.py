"""config.json: settings and actuator wiring of an experiment, validated field by field.

Reading a configuration needs pydantic, so `openprc.schema.experiment_files` imports this
module only when a config.json is read or written. All mistakes are reported at once, under
the names that stand in the user's own file.
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import (  # noqa: TID253 - this module is loaded only to read a config
    BaseModel,
    ValidationError,
)
from pydantic_core import ErrorDetails

from openprc.errors import ConfigError, SchemaTooNew
from openprc.schema.config_legacy import OldNames, is_legacy, translate
from openprc.schema.config_sections import (
    ActuatorSection,
    Config,
    ExportSection,
    PhysicsSection,
    SimulationSection,
)
from openprc.schema.safety import check_readable

CONFIG_VERSION = "1.0"
#: A configuration is read into memory whole; nothing sensible is larger.
MAX_BYTES = 64 << 20


def load_config(path: str | Path) -> tuple[Config, bool]:
    """Read config.json in this or the older layout.

    Returns
    -------
    config : Config
    legacy : bool
        Whether the file had the older layout.

    Raises
    ------
    UnreadableFile
        When the file is missing or empty.
    ConfigError
        When it is not JSON or breaks the layout; all mistakes in one message.
    SchemaTooNew
        When the major version of the layout is not known here.
    """
    file = check_readable(path)
    if file.stat().st_size > MAX_BYTES:
        raise ConfigError(
            f"the file has {file.stat().st_size} bytes",
            expected=f"at most {MAX_BYTES}",
            fix="put time series into signals.h5",
            file=file,
        )
    data = _parse(file)
    if is_legacy(data):
        translated, names = translate(data)
        return parse_config(translated, file=file, names=names), True
    return parse_config(data, file=file), False


def parse_config(
    data: Mapping[str, Any], *, file: str | Path | None = None, names: OldNames | None = None
) -> Config:
    """Validate a configuration given as plain data.

    Parameters
    ----------
    data : mapping
        In the layout of this package.
    file : path-like, optional
        Named in messages.
    names : OldNames, optional
        The user's own names, when `data` was translated from the older layout.

    Raises
    ------
    ConfigError
        Listing every mistake.
    SchemaTooNew
        When the major version is newer than this package.
    """
    version = data.get("openprc_config")
    if isinstance(version, str) and version.partition(".")[0].isdigit():
        major = int(version.partition(".")[0])
        if major > int(CONFIG_VERSION.partition(".")[0]):
            raise SchemaTooNew(
                f"the configuration has layout version {version}",
                expected=f"version {CONFIG_VERSION} or another 1.x",
                fix="install a newer openprc",
                file=file,
                key="openprc_config",
            )
    try:
        config = Config.model_validate(dict(data))
    except ValidationError as error:
        details = error.errors(include_url=False)
    else:
        if not (names and names.mistakes):
            return config
        details = []
    raise _config_error(details, file=file, names=names)


def _parse(file: Path) -> dict[str, Any]:
    def refuse_constant(word: str) -> float:
        raise ConfigError(
            f"the number {word}",
            expected="finite numbers only",
            fix="write a number, or leave the key out to get its default",
            file=file,
        )

    def refuse_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        seen: dict[str, Any] = {}
        for key, value in pairs:
            if key in seen:
                raise ConfigError(
                    f"the key {key!r} appears twice in one object",
                    expected="every key once",
                    fix="remove one of them",
                    file=file,
                    key=key,
                )
            seen[key] = value
        return seen

    try:
        text = file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"byte {error.start} is not UTF-8",
            expected="JSON text in UTF-8",
            fix="save the file as UTF-8",
            file=file,
        ) from None
    try:
        data = json.loads(text, parse_constant=refuse_constant, object_pairs_hook=refuse_duplicates)
    except json.JSONDecodeError as error:
        raise ConfigError(
            f"invalid JSON at line {error.lineno}, column {error.colno}: {error.msg}",
            expected="one JSON object",
            fix="correct the text there (a missing or trailing comma is the usual cause)",
            file=file,
        ) from None
    except RecursionError:
        raise ConfigError("JSON nested too deeply", expected="four levels", file=file) from None
    if not isinstance(data, dict):
        raise ConfigError(
            f"the file holds a JSON {type(data).__name__}",
            expected="one JSON object with the keys " + ", ".join(Config.model_fields),
            file=file,
        )
    return data


def _config_error(
    details: list[ErrorDetails], *, file: str | Path | None, names: OldNames | None
) -> ConfigError:
    mistakes: list[tuple[str, str, str]] = []
    for detail in details:
        # A union reports each of its branches; the branch names are no part of the path.
        path = tuple(p for p in detail["loc"] if p not in ("float", "tuple[float, float, float]"))
        if detail["type"] == "multiple":
            path = (*path, detail["ctx"]["field"])
        key = names.user_key(path) if names else dotted(path)
        mistakes.append((key, *_explain(detail, path)))
    if names:
        mistakes += names.mistakes
    merged: dict[str, tuple[str, str]] = {}
    for key, found, fix in mistakes:
        # Of the branches of one union only the first explanation is kept.
        merged.setdefault(key, (found, fix))
    if len(merged) == 1:
        key, (found, fix) = next(iter(merged.items()))
        found, _, expected = found.partition("; expected ")
        return ConfigError(found, expected=expected, fix=fix, file=file, key=key)
    lines = "".join(
        f"\n  - {key}: {found}" + (f" ({fix})" if fix else "")
        for key, (found, fix) in merged.items()
    )
    return ConfigError(
        f"{len(merged)} mistakes{lines}",
        expected="a configuration as described by openprc.schema.config.Config",
        fix="correct every field named above",
        file=file,
        key=", ".join(merged),
    )


def dotted(path: tuple[int | str, ...]) -> str:
    """Return ``("actuators", 0, "node")`` as ``"actuators[0].node"``."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def _explain(detail: ErrorDetails, path: tuple[int | str, ...]) -> tuple[str, str]:
    kind, value = detail["type"], detail.get("input")
    if kind == "extra_forbidden":
        return "unknown key", suggest(str(path[-1]), _known_keys(path[:-1]))
    if kind == "missing":
        return f"the key is missing; expected {_description(path)}", "add it"
    if kind in ("multiple", "axes"):
        return detail["msg"], ""
    message = detail["msg"].removeprefix("Input should be ")
    expected = f"{message}, {_description(path)}" if _description(path) else message
    return f"found {_short(value)}; expected {expected}", ""


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def suggest(key: str, known: list[str]) -> str:
    """Return which known key was probably meant, or the list of them."""
    close = difflib.get_close_matches(key.lower(), known, n=1, cutoff=0.5)
    if close:
        return f"did you mean {close[0]!r}?"
    return "remove it; known here: " + ", ".join(known)


def _model_at(path: tuple[int | str, ...]) -> type[BaseModel] | None:
    sections: dict[str, type[BaseModel]] = {
        "simulation": SimulationSection,
        "physics": PhysicsSection,
        "actuators": ActuatorSection,
        "export": ExportSection,
    }
    if not path:
        return Config
    depth = 2 if path[0] == "actuators" else 1
    return sections.get(str(path[0])) if len(path) == depth else None


def _known_keys(path: tuple[int | str, ...]) -> list[str]:
    model = _model_at(path)
    return [] if model is None else list(model.model_fields)


def _description(path: tuple[int | str, ...]) -> str:
    while path and isinstance(path[-1], int):
        path = path[:-1]
    model = _model_at(path[:-1]) if path else None
    field = model.model_fields.get(str(path[-1])) if model else None
    return (field.description or "") if field else ""
