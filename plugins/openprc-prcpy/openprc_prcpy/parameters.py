"""The processing that a PRCpy user asks for: the keys of ``process_params``, checked once."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from numbers import Integral, Real
from pathlib import Path
from typing import Any, NoReturn, Self

import numpy as np

from openprc.errors import ConfigError

DELIMITERS = {"tab": "\t", "\\t": "\t", "comma": ",", "semicolon": ";", "space": " "}
#: What works on sweeps, and so makes no sense for records in time.
SWEEP_STEPS = ("remove_bg", "smooth", "cut_xs", "normalize_local", "normalize_global", "sample")


@dataclass(frozen=True)
class ProcessParameters:
    """The keys of PRCpy's ``process_params``, ``Xs`` and ``Readouts`` in lower case.

    Steps are taken in the order of the fields: background, smoothing, cut, normalisation,
    subsampling. ``transpose`` excludes all of them.
    """

    xs: str | None = None
    readouts: str | None = None
    delimiter: str | None = None
    remove_bg: bool = False
    bg_fname: str | None = None
    smooth: bool = False
    smooth_win: int | None = None
    smooth_rank: int | None = None
    cut_xs: bool = False
    x1: float | None = None
    x2: float | None = None
    normalize_local: bool = False
    normalize_global: bool = False
    sample: bool = False
    sample_rate: int | None = None
    transpose: bool = False

    @classmethod
    def from_mapping(cls, given: Mapping[str, Any], *, folder: Path) -> Self:
        """Read a ``process_params`` dictionary; what is left out is off.

        Raises
        ------
        ConfigError
            A key is unknown, a value of the wrong kind, or a step lacks what it needs.
        """
        known = {field.name: str(field.type) for field in fields(cls)}
        values: dict[str, Any] = {}
        for key, value in given.items():
            if key == "normalize":
                _refuse_normalize(value, folder)
                continue
            name = key.lower() if key in ("Xs", "Readouts") else key
            if name not in known:
                near = difflib.get_close_matches(key, [*known, "Xs", "Readouts"], n=1)
                _refuse(
                    f"process_params has the key {key!r}",
                    expected="Xs, Readouts, " + ", ".join(list(known)[2:]),
                    fix=f"did you mean {near[0]!r}?" if near else "leave it out",
                    key=key,
                    folder=folder,
                )
            # PRCpy's users leave the name of a background that they do not subtract empty.
            if value is not None and (name, value) != ("bg_fname", ""):
                values[name] = _checked(key, value, known[name], folder=folder)
        found = cls(**values)
        found._complete(folder)
        return found

    def _complete(self, folder: Path) -> None:
        if self.transpose:
            active = [name for name in SWEEP_STEPS if getattr(self, name)]
            if active:
                _refuse(
                    f"transpose together with {', '.join(active)}",
                    expected="transpose alone: its rows are instants, not samples of a sweep",
                    fix="turn the others off",
                    key="transpose",
                    folder=folder,
                )
        for step, needed in (
            ("remove_bg", ("bg_fname",)),
            ("smooth", ("smooth_win", "smooth_rank")),
            ("cut_xs", ("x1", "x2")),
            ("sample", ("sample_rate",)),
        ):
            absent = [name for name in needed if getattr(self, name) is None]
            if getattr(self, step) and absent:
                _refuse(
                    f"{step} is on and {absent[0]} is not given",
                    expected=" and ".join(needed),
                    fix=f"give {absent[0]}, or turn {step} off",
                    key=absent[0],
                    folder=folder,
                )
        if self.smooth and not 0 <= _int(self.smooth_rank) < _int(self.smooth_win):
            _refuse(
                f"a window of {self.smooth_win} samples and a polynomial of degree "
                f"{self.smooth_rank}",
                expected="0 <= smooth_rank < smooth_win",
                fix="widen the window, or lower the degree",
                key="smooth_win",
                folder=folder,
            )
        if self.sample and _int(self.sample_rate) < 1:
            _refuse(
                f"sample_rate is {self.sample_rate}",
                expected="1 or more",
                fix="correct it, or turn sample off",
                key="sample_rate",
                folder=folder,
            )


def _refuse_normalize(value: Any, folder: Path) -> None:
    # In dictionaries of PRCpy's first versions; 0.1.14 ignores the key, whatever it says.
    if value:
        _refuse(
            "normalize is on, which PRCpy has given up",
            expected="normalize_local or normalize_global",
            fix="say which: each scan to [0, 1], or all scans together",
            key="normalize",
            folder=folder,
        )


def _int(value: int | None) -> int:
    return -1 if value is None else value


def _checked(key: str, value: Any, kind: str, *, folder: Path) -> Any:
    if kind.startswith("bool"):
        if isinstance(value, bool | np.bool_):
            return bool(value)
        wanted = "True or False"
    elif kind.startswith("int"):
        if isinstance(value, Integral) and not isinstance(value, bool):
            return int(value)
        wanted = "a whole number"
    elif kind.startswith("float"):
        if isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value):
            return float(value)
        wanted = "a finite number"
    elif isinstance(value, str | Path) and str(value):
        text = str(value)
        if key != "delimiter":
            return text
        text = DELIMITERS.get(text, text)
        if len(text) == 1:
            return text
        wanted = "one character, or tab, comma, semicolon, space"
    else:
        wanted = "text"
    raise ConfigError(
        f"{key} is {value!r}", expected=wanted, fix="correct it", file=folder, key=key
    )


def _refuse(found: str, *, expected: str, fix: str, key: str, folder: Path) -> NoReturn:
    raise ConfigError(found, expected=expected, fix=fix, file=folder, key=key)
