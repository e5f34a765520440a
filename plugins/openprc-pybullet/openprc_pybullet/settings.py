"""The importer's options as one frozen record."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from openprc.errors import ConfigError
from openprc_pybullet import OPTIONS

_DEFAULTS: dict[str, Any] = {option.name: option.default for option in OPTIONS}


@dataclass(frozen=True, slots=True)
class Settings:
    """Options of an import, in the types that the readers use; see `openprc_pybullet.OPTIONS`."""

    urdf: tuple[str, ...]
    urdf_flags: tuple[str, ...]
    urdf_scale: float
    bodies: tuple[int, ...]
    include_static: bool
    dt: float | None
    t0: float
    unit: str
    time_unit: str
    position_key: str | None
    time_key: str | None
    input_key: str | None
    input_unit: str
    input_quantity: str
    trust: bool

    @classmethod
    def from_options(cls, options: Mapping[str, Any]) -> Settings:
        """Read the mapping that the host hands over.

        Raises
        ------
        ConfigError
            When `dt` or `urdf_scale` is not a positive number or `t0` is not finite.
        """
        values = _DEFAULTS | {key: options[key] for key in _DEFAULTS if key in options}
        dt, scale = values["dt"], values["urdf_scale"]
        if not (math.isfinite(scale) and scale > 0):
            raise ConfigError(
                f"urdf_scale is {scale!r}",
                expected="a positive number",
                fix="give globalScaling of loadURDF",
                key="urdf_scale",
            )
        if dt is not None and not (math.isfinite(dt) and dt > 0):
            raise ConfigError(
                f"dt is {dt!r}", expected="a positive number of seconds", fix="correct it", key="dt"
            )
        if not math.isfinite(values["t0"]):
            raise ConfigError(
                f"t0 is {values['t0']!r}", expected="a finite time in s", fix="correct it", key="t0"
            )
        return cls(
            urdf=_as_tuple(values["urdf"]),
            urdf_flags=_as_tuple(values["urdf_flags"]),
            urdf_scale=float(scale),
            bodies=tuple(int(body) for body in _as_tuple(values["bodies"])),
            include_static=bool(values["include_static"]),
            dt=None if dt is None else float(dt),
            t0=float(values["t0"]),
            unit=values["unit"],
            time_unit=values["time_unit"],
            position_key=values["position_key"],
            time_key=values["time_key"],
            input_key=values["input_key"],
            input_unit=values["input_unit"],
            input_quantity=values["input_quantity"] or "",
            trust=bool(options.get("trust", False)),
        )


def _as_tuple(value: Any) -> tuple[Any, ...]:
    if value is None:
        return ()
    return (value,) if isinstance(value, str | int) else tuple(value)
