"""`AlignmentSettings`: how two trajectories are brought together before they are compared."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal, get_args

from openprc.errors import ConfigError

Matching = Literal["auto", "label", "index", "assignment"]
Interpolant = Literal["auto", "nearest", "linear", "cubic", "hermite"]
Onto = Literal["coarser", "reference", "other"]
Rigid = Literal["none", "first", "all"]
Quantity = Literal["positions", "displacements"]


@dataclass(frozen=True, kw_only=True)
class AlignmentSettings:
    """What is matched with what, at which instants, in which frame.

    Parameters
    ----------
    match : {"auto", "label", "index", "assignment"}
        How nodes find each other. "auto" takes labels where both files have some in common, then
        the order where both have as many nodes at the same places, then places.
    pairs : mapping of str to str, optional
        Nodes of the reference to nodes of the other file, by label, or by number where there are
        no labels; nothing else is matched then.
    match_limit : float, optional [unit of the comparison]
        How far apart two nodes may be and still be the same in an assignment; by default half of
        the median distance between nearest neighbours, in the file where that is smaller.
    clock : str
        "auto", "time", "step" (the numbers that pseudo time counts), "index" (frames in order),
        or a recorded quantity that only grows or only falls: "input", "input:NAME:COLUMN",
        "channel:NAME:COLUMN", "node:LABEL:AXIS". "auto" takes time for runs in time; for load
        steps their numbers, or the input where equal numbers carry unequal loads.
    start, stop : float, optional
        Part of the reference's clock that is compared.
    onto : {"coarser", "reference", "other"}
        Whose instants are compared where the clocks differ.
    interpolant : {"auto", "nearest", "linear", "cubic", "hermite"}
        "auto" takes the cubic Hermite polynomial where velocities are stored and reproduce
        left-out frames no worse than twice the error of the cubic polynomial through four frames.
    time_shift : float or "estimate" [unit of time of the reference]
        What is added to the other clock.
    max_shift : float, optional
        Largest shift that an estimate may find; by default half of the common time.
    rigid_motion : {"none", "first", "all"}
        Whether the other body is first moved as a rigid one onto the reference: by its nodes at
        the first common instant, or at all instants.
    scale : float or "fit", optional
        Length of one unit of the other file in units of the comparison, on top of the
        conversion of units; "fit" estimates it with the rigid motion.
    reflect : bool
        The rigid motion may be a mirror image; rows of images count downwards.
    axes : tuple of str
        Axes of a file in three dimensions that a planar one shows; by default those of its
        names.
    quantity : {"positions", "displacements"}
        "displacements" subtracts the place of every node at the first common instant.
    filled : bool
        Whether places that were filled in rather than measured count.
    velocities, elements : bool
        Compare velocities, and lengths and angles of the elements of the reference, too.
    spectra, energy : bool
    segment : int, optional
        Samples in a segment of the spectra.
    bins : int
        Largest number of bins over time.
    block_bytes : int
        How much of a file is held at a time.

    Raises
    ------
    ConfigError
        When a value is not one of these.
    """

    match: Matching = "auto"
    pairs: Mapping[str, str] | None = None
    match_limit: float | None = None
    clock: str = "auto"
    start: float | None = None
    stop: float | None = None
    onto: Onto = "coarser"
    interpolant: Interpolant = "auto"
    time_shift: float | Literal["estimate"] = 0.0
    max_shift: float | None = None
    rigid_motion: Rigid = "none"
    scale: float | Literal["fit"] | None = None
    reflect: bool = False
    axes: tuple[str, ...] = ()
    quantity: Quantity = "positions"
    filled: bool = False
    velocities: bool = False
    elements: bool = False
    spectra: bool = True
    energy: bool = True
    segment: int | None = None
    bins: int = 2000
    block_bytes: int = 2 << 20

    def __post_init__(self) -> None:
        for name, choices in (
            ("match", Matching),
            ("onto", Onto),
            ("interpolant", Interpolant),
            ("rigid_motion", Rigid),
            ("quantity", Quantity),
        ):
            if getattr(self, name) not in get_args(choices):
                raise _wrong(name, getattr(self, name), "one of " + ", ".join(get_args(choices)))
        if self.time_shift != "estimate" and not _finite(self.time_shift):
            raise _wrong("time_shift", self.time_shift, 'a finite time, or "estimate"')
        if self.scale not in (None, "fit") and not _positive(self.scale):
            raise _wrong("scale", self.scale, 'a number above 0, or "fit"')
        if self.scale == "fit" and self.rigid_motion == "none":
            raise _wrong("scale", "fit", 'a number, or rigid_motion "first" or "all" beside it')
        for name in ("match_limit", "max_shift"):
            value = getattr(self, name)
            if value is not None and not _positive(value):
                raise _wrong(name, value, "a number above 0")
        for name in ("start", "stop"):
            value = getattr(self, name)
            if value is not None and not _finite(value):
                raise _wrong(name, value, "a finite number")
        if self.start is not None and self.stop is not None and self.stop <= self.start:
            raise _wrong("stop", self.stop, f"a number above start, {self.start:g}")
        for name, least in (("bins", 1), ("block_bytes", 1)):
            value = getattr(self, name)
            if not isinstance(value, int) or value < least:
                raise _wrong(name, value, f"a whole number of at least {least}")
        if self.segment is not None and (not isinstance(self.segment, int) or self.segment < 8):
            raise _wrong("segment", self.segment, "a whole number of at least 8")
        if self.clock.partition(":")[0] not in CLOCKS:
            raise _wrong("clock", self.clock, "one of " + ", ".join(CLOCKS))

    def as_dict(self) -> dict[str, Any]:
        """Return the settings as plain values, for JSON output."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        values["axes"] = list(self.axes)
        values["pairs"] = None if self.pairs is None else dict(self.pairs)
        return values


#: What the word before the first colon of a clock may be.
CLOCKS = ("auto", "time", "step", "index", "input", "channel", "node")


def _finite(value: object) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


def _positive(value: object) -> bool:
    return isinstance(value, int | float) and math.isfinite(value) and value > 0


def _wrong(name: str, value: object, expected: str) -> ConfigError:
    return ConfigError(
        f"{name} is {value!r}", expected=expected, fix="correct the setting", key=name
    )


__all__ = ["CLOCKS", "AlignmentSettings", "Interpolant", "Matching", "Onto", "Quantity", "Rigid"]
