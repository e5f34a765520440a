"""Stored quantities beyond positions and velocities: channels, or kept below /extensions."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError
from openprc_pyelastica.clock import Clock
from openprc_pyelastica.grouping import Grouping
from openprc_pyelastica.quantities import canonical
from openprc_pyelastica.recording import Recording
from openprc_pyelastica.rods import Series, loose, remarks

if TYPE_CHECKING:
    from openprc.schema import TrajectoryWriter

DISTRIBUTION = "openprc-pyelastica"
#: Version of the layout below /extensions/openprc-pyelastica.
EXTENSION_VERSION = "1.0"

#: Numbers of the whole rod up to this width become channels without being asked for.
CHANNEL_WIDTH = 3


@dataclass(frozen=True)
class Channel:
    """A sensor: its columns, unit, and values (T, C)."""

    name: str
    columns: tuple[str, ...]
    unit: str
    value: NDArray[np.float64]


def shared_series(loaded: Recording, found: Grouping, clock: Clock) -> dict[str, Series]:
    """Return what belongs to no rod in particular, on the clock of the file."""
    keys = [*found.extras.get("", ())]
    keys += [key for name, key in found.shared.items() if name not in ("time", "step")]
    series = {key: loose(loaded.entries[key], key, clock=clock) for key in keys}
    loaded.notes += remarks(series)
    return series


def split(
    prefix: str, series: Mapping[str, Series], wanted: set[str], frames: int
) -> tuple[list[Channel], dict[str, Series]]:
    """Sort quantities into channels and the rest.

    Parameters
    ----------
    prefix : str
        Name of the rod that they belong to, empty for none.
    series : mapping of key to Series
    wanted : set of str
        Keys or names that the caller wants as channels; those met are removed.
    frames : int
        Number of frames that are written.

    Returns
    -------
    channels : list of Channel
        What was asked for, and short rows about the whole rod such as energies.
    kept : dict of name to Series

    Raises
    ------
    ConfigError
        A quantity that was asked for has no value at the first frame.
    """
    channels: list[Channel] = []
    kept: dict[str, Series] = {}
    for key, item in series.items():
        cut = item
        if item.first_frame is not None:
            cut = replace(item, values=item.values[: frames - item.first_frame])
        name = clean_name(f"{prefix}.{key}" if prefix and not key.startswith(prefix) else key)
        asked = bool({key, name} & wanted)
        wanted -= {key, name} if asked else set()
        if asked and cut.first_frame != 0:
            raise ConfigError(
                f"{key} has no value at the first frame",
                expected="a quantity with one value a frame",
                fix="leave it out of channels; it is kept below /extensions",
                key="channels",
            )
        series_like = cut.first_frame == 0 and cut.values.ndim >= 1
        width = int(np.prod(cut.values.shape[1:]))
        short = canonical(key) is None and cut.values.ndim <= 2 and 0 < width <= CHANNEL_WIDTH
        finite = bool(np.isfinite(cut.values).all())
        if asked or (series_like and short and finite):
            columns = column_names(cut.values.shape[1:])
            flat = cut.values.reshape(len(cut.values), width)
            channels.append(Channel(name, columns, cut.unit, flat))
        else:
            kept[name] = cut
    return channels, kept


def column_names(shape: tuple[int, ...]) -> tuple[str, ...]:
    """Name the columns of a flattened sample of the given shape."""
    if not shape:
        return ("value",)
    if shape == (3,):
        return ("x", "y", "z")
    return tuple("_".join(map(str, index)) for index in np.ndindex(*shape))


def clean_name(key: str) -> str:
    """Return a key as a name that the file contract allows."""
    return re.sub(r"[^A-Za-z0-9_.-]+", ".", key).lstrip(".-") or "value"


def put_extensions(writer: TrajectoryWriter, kept: Mapping[str, Series], notes: list[str]) -> None:
    """Store quantities below the plugin's subtree, each with what is known about its time."""
    if not kept:
        return
    writer.declare_extension(DISTRIBUTION, EXTENSION_VERSION)
    half = sorted(name for name, item in kept.items() if item.half_step)
    for name, item in kept.items():
        about = []
        if item.first_frame is None:
            about.append("not on the clock of the frames")
        elif item.first_frame:
            about.append(f"row 0 is frame {item.first_frame}")
        if item.half_step:
            about.append("evaluated half a simulation step before the time of the frame")
        writer.put_extension(
            DISTRIBUTION, name, item.values, unit=item.unit, comment="; ".join(about)
        )
    if half:
        notes.append(
            f"{', '.join(half)}: half a simulation step older than positions, velocities and "
            "directors of the same frame"
        )
