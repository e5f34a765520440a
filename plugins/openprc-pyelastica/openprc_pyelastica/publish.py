"""Rods to the writer: nodes, bars, drive, and everything else that was stored."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError
from openprc_pyelastica import extras
from openprc_pyelastica.drive import Drive
from openprc_pyelastica.rods import Rod, Series

if TYPE_CHECKING:
    from openprc.schema import TrajectoryWriter

#: Bytes of positions that are appended at once: what the writer writes at once.
BLOCK_BYTES = 2 << 20


def write(
    writer: TrajectoryWriter,
    rods: list[Rod],
    shared: Mapping[str, Series],
    drive: Drive | None,
    *,
    frames: int,
    options: Mapping[str, Any],
    notes: list[str],
) -> None:
    """Declare and append everything.

    Parameters
    ----------
    writer : TrajectoryWriter
    rods : list of Rod
        On one clock.
    shared : mapping of key to Series
        Quantities of no rod in particular.
    drive : Drive, optional
    frames : int
        How many of the frames to write.
    options : mapping
        Options of the importer.
    notes : list of str
        Remarks are appended here.

    Raises
    ------
    ConfigError
        A quantity was asked for as a channel and is not stored.
    """
    _declare_nodes(writer, rods, options["plane"], notes)
    lengths = _declare_bars(writer, rods, frames, notes)
    wanted = set(options["channels"] or ())
    channels, kept = extras.split("", shared, wanted, frames)
    for rod in rods:
        more, rest = extras.split(rod.name, rod.extras, wanted, frames)
        channels += more
        kept |= rest
    if wanted:
        raise ConfigError(
            f"{', '.join(sorted(wanted))}: not stored in the file",
            expected=f"some of {', '.join(sorted(kept)) or 'nothing: there are no extra keys'}",
            fix="correct the option channels",
            key="channels",
        )
    for channel in channels:
        writer.declare_channel(channel.name, channel.columns, unit=channel.unit)
    extras.put_extensions(writer, kept, notes)
    if drive is not None:
        columns = extras.column_names(drive.value.shape[1:])
        writer.declare_input(drive.name, columns, quantity="drive", unit=options["input_unit"])
    positions = [rod.positions for rod in rods]
    given = [rod.velocities for rod in rods if rod.velocities is not None]
    velocities = given if len(given) == len(rods) else None
    rows = max(1, BLOCK_BYTES // (8 * sum(rod.positions[0].size for rod in rods)))
    for start in range(0, frames, rows):
        part = slice(start, min(start + rows, frames))
        writer.append(
            rods[0].time[part],
            positions=_joined([one[part] for one in positions]),
            velocities=None if velocities is None else _joined([one[part] for one in velocities]),
            elements={name: values[part] for name, values in lengths.items()},
            channels={channel.name: channel.value[part] for channel in channels},
            inputs={} if drive is None else {drive.name: drive.value[part]},
        )


def _joined(arrays: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the columns of several rods beside each other; of a single one they are not copied."""
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays, axis=1)


def _declare_nodes(
    writer: TrajectoryWriter, rods: list[Rod], plane: str | None, notes: list[str]
) -> None:
    with_velocity = [rod.name for rod in rods if rod.velocities is not None]
    if 0 < len(with_velocity) < len(rods):
        notes.append(f"only {', '.join(with_velocity)} hold velocities; they were left out")
    masses = [rod.mass for rod in rods]
    mass = None
    if all(one is not None for one in masses):
        mass = np.concatenate([one for one in masses if one is not None])
    writer.declare_nodes(
        sum(rod.n_nodes for rod in rods),
        rods[0].positions.shape[2],
        unit="m",
        axes=",".join(plane or "xyz"),
        velocities=len(with_velocity) == len(rods),
        mass=mass,
        labels=[f"{rod.name}:{node}" for rod in rods for node in range(rod.n_nodes)],
    )


def _declare_bars(
    writer: TrajectoryWriter, rods: list[Rod], frames: int, notes: list[str]
) -> dict[tuple[str, str], NDArray[np.float64]]:
    offsets = np.cumsum([0, *(rod.n_nodes for rod in rods)])
    bars = np.concatenate([rod.bars + offset for rod, offset in zip(rods, offsets, strict=False)])
    if not len(bars):
        return {}
    rest = np.concatenate([rod.rest_length for rod in rods])
    # Stored lengths and dilatations are half a step old; positions are of the frame itself.
    lengths = _joined([rod.lengths[:frames] for rod in rods])
    notes.append(
        "rest lengths of "
        + "; ".join(f"{rod.name}: {rod.rest_source}" for rod in rods if len(rod.bars))
    )
    series = {"length": "m"}
    written = {("bars", "length"): lengths}
    if np.all(rest > 0.0):
        series["strain"] = "1"
        written["bars", "strain"] = lengths / rest - 1.0
    else:
        notes.append("some rest lengths are zero, so that no strain was formed")
    writer.declare_elements("bars", bars, series=series, static={"rest_length": (rest, "m")})
    return written
