"""What an exported workspace says beyond MERLIN's variables: its units and instants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from openprc.errors import SchemaError
from openprc.schema import UNITS

#: The struct that the exporter adds.
STRUCT = "openprc"
TIME = "openprc.time"


@dataclass(frozen=True)
class Stated:
    """Units, "arb" where nothing is said, and the variables with the instants among them.

    Attributes
    ----------
    length, force : unit symbols
    has_time : whether there are instants, under the name `TIME`
    """

    length: str
    force: str
    has_time: bool
    variables: Mapping[str, Any]


def read(variables: Mapping[str, Any], *, file: Path) -> Stated:
    """Return what the struct of the exporter says; nothing where there is none.

    Raises
    ------
    SchemaError
        When it names a unit that is none of length, or of force.
    """
    said = variables.get(STRUCT)
    if not isinstance(said, Mapping):
        return Stated("arb", "arb", has_time=False, variables=variables)
    units = {}
    for name, dimensions in (
        ("length_unit", ("length", "pixel length", "arbitrary")),
        ("force_unit", ("force", "arbitrary")),
    ):
        symbol = said.get(name, "arb")
        known = UNITS.get(symbol) if isinstance(symbol, str) else None
        if known is None or known.dimension not in dimensions:
            raise SchemaError(
                f"the unit {symbol!r}",
                expected=f"a unit of {dimensions[0]}, or arb",
                fix="correct the field, or clear the struct before saving",
                file=file,
                key=f"{STRUCT}.{name}",
            )
        units[name] = symbol
    instants = said.get("time")
    has_time = isinstance(instants, np.ndarray)
    return Stated(
        units["length_unit"],
        units["force_unit"],
        has_time=has_time,
        variables={**variables, TIME: instants} if has_time else variables,
    )
