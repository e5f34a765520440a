"""Laboratory recordings in the layouts that grew around the older engine, made by hand."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.errors import UnreadableFile
from openprc.schema.legacy_clock import Clock, read_times, rebuild
from openprc.schema.legacy_drive import Drive, stored_drives
from openprc.schema.legacy_kinds import attribute, numeric, read

if TYPE_CHECKING:
    from openprc.schema import TrajectoryWriter


def import_laboratory(
    file: h5py.File, path: Path, writer: TrajectoryWriter, options: Mapping[str, Any]
) -> None:
    """Write an experiment.h5: tracked nodes, bar lengths, and the drive.

    Raises
    ------
    UnreadableFile
        The datasets do not fit together.
    """
    unit = options.get("unit") or "px"
    places = read(file["time_series/nodes/positions"]).astype(np.float64)
    rows = min(len(places), len(file["time_series/time"]))
    if rows < max(len(places), len(file["time_series/time"])):
        writer.note(f"time and positions differ in length; the first {rows} frames are kept")
    if rows == 0:
        raise _empty(path, "/time_series/time")
    stored = read_times(file["time_series/time"], rows, path=path)
    # The times were cut out of a recording in Unix time and kept its coarse steps.
    epoch = attribute(file, "xml_start_time", 0.0)
    clock = rebuild(stored, rates=[attribute(file, "fps", 0.0)], epoch=epoch)
    places, seen = declare_tracks(writer, places[:rows], path=path, unit=unit)
    drives = stored_drives(file, path, rows, wires=(), unit=unit)
    for drive in drives:
        drive.declare(writer)
    _note_copies(drives, places, writer)
    if not drives:
        writer.note("nothing says what drove the body")
    channels: dict[str, NDArray[np.float64]] = {}
    lengths = numeric(file, "time_series/elements/bars/lengths")
    if lengths is not None and lengths.ndim == 2 and len(lengths) >= rows:
        channels["bar_length"] = read(lengths, slice(0, rows)).astype(np.float64)
        columns = [f"bar {number}" for number in range(lengths.shape[1])]
        writer.declare_channel("bar_length", columns, unit=unit, quantity="length")
        writer.note(
            "the file does not say which nodes a bar joins, so its lengths are a channel and "
            "there is no topology"
        )
    _describe(file, writer, unit, clock, said="unit" in options and options["unit"] is not None)
    writer.append(
        clock.time,
        positions=places,
        observed=seen,
        channels=channels,
        inputs={drive.name: drive.value for drive in drives},
    )


def import_tracks(
    file: h5py.File, path: Path, writer: TrajectoryWriter, options: Mapping[str, Any]
) -> None:
    """Write a tracking_data.h5: the whole recording, on a clock that begins at 0.

    Raises
    ------
    UnreadableFile
        The recording is empty or its clock is damaged.
    """
    unit = options.get("unit") or "px"
    places = read(file["trajectories"]).astype(np.float64)
    if len(places) == 0:
        raise _empty(path, "/time")
    stored = read_times(file["time"], len(places), path=path)
    origin = float(stored[0])
    relative = stored.astype(np.float64) - origin
    clock = rebuild(relative, rates=[attribute(file, "fps", 0.0)], epoch=origin)
    if origin != 0.0:
        writer.note(f"time begins at 0; {origin!r} s, the first stored time, was subtracted")
    places, seen = declare_tracks(writer, places, path=path, unit=unit)
    writer.note("nothing says what drove the body")
    _describe(file, writer, unit, clock, said=options.get("unit") is not None)
    writer.append(clock.time, positions=places, observed=seen)


def import_displacement(
    file: h5py.File, path: Path, writer: TrajectoryWriter, options: Mapping[str, Any]
) -> None:
    """Write a displacement_slice.h5: one channel, no nodes.

    Raises
    ------
    UnreadableFile
        The frame rate is no positive number, or there is no frame.
    """
    values = read(file["displacement"]).astype(np.float64)
    values = values.reshape(len(values), -1) if values.ndim else values.reshape(0, 1)
    fps = attribute(file, "fps", 0.0)
    if len(values) == 0:
        raise _empty(path, "/displacement")
    if not (np.isfinite(fps) and fps > 0):
        raise UnreadableFile(
            f"the frame rate is {fps}",
            expected="a root attribute fps above 0 [Hz]",
            fix="correct the attribute",
            file=path,
            key="@fps",
        )
    unit = options.get("unit") or "arb"
    columns = [f"displacement {number}" for number in range(values.shape[1])]
    if len(columns) == 1:
        columns = ["displacement"]
    writer.declare_channel("displacement", columns, unit=unit, quantity="displacement")
    writer.note(f"times are frame number / {fps!r} Hz, the rate that the file states")
    if "start_frame" in file.attrs:
        writer.note(f"frame 0 is frame {file.attrs['start_frame']} of the recording")
    if options.get("unit") is None:
        writer.note("the file does not state a unit: arb (option unit)")
    writer.append(np.arange(len(values)) / fps, channels={"displacement": values})


def declare_tracks(
    writer: TrajectoryWriter,
    places: NDArray[np.float64],
    *,
    path: Path,
    unit: str,
    status: NDArray[np.uint8] | None = None,
    ids: list[int] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.uint8] | None]:
    """Declare tracked points; return their positions (T, N, D) and the mask, if one is needed.

    Parameters
    ----------
    places : (T, N, 2 or 3) [unit]
        NaN where nothing was measured. A column z of zeros is left out.
    status : (T, N), optional
        0 missing, 1 measured, 2 filled in; 0 makes the place NaN.

    Raises
    ------
    UnreadableFile
        A place is infinite.
    """
    if np.isinf(places).any():
        frame, node, _ = np.argwhere(np.isinf(places))[0]
        raise UnreadableFile(
            f"node {node} is at {places[frame, node].tolist()} in frame {frame}",
            expected="finite numbers, or NaN where nothing was measured",
            fix="export the recording again",
            file=path,
        )
    if places.shape[2] == 3 and not np.nan_to_num(places[..., 2]).any():
        places = places[..., :2]
        writer.note("z is 0 everywhere and was left out: the file has two dimensions")
    finite = np.isfinite(places).all(axis=2)
    seen = np.asarray(finite, dtype=np.uint8)
    if status is not None:
        seen *= status
    places = np.where(seen[..., np.newaxis] > 0, places, np.nan)
    gaps = bool((seen != 1).any())
    writer.declare_nodes(
        places.shape[1],
        places.shape[2],
        unit=unit,
        frame="image" if unit == "px" else "world",
        observed=gaps,
        ids=ids,
    )
    missing = int((seen == 0).sum())
    if missing:
        writer.note(f"{missing} of {seen.size} places are missing (NaN, observed = 0)")
    return places, seen if gaps else None


def _note_copies(
    drives: list[Drive], places: NDArray[np.float64], writer: TrajectoryWriter
) -> None:
    """Note where a drive is no independent measurement but a coordinate of a node."""
    for drive in drives:
        node = drive.nodes[0]
        if drive.value.shape[1] != 1 or node >= places.shape[1] or len(places) < 3:
            continue
        u = drive.value[:, 0]
        for axis, x in zip("xyz", places[:, node].T, strict=False):
            for sign, word in ((1.0, "plus"), (-1.0, "minus")):
                if np.ptp(u - sign * x) <= 1e-9 * np.ptp(u):
                    writer.note(
                        f"input {drive.name!r} is a constant {word} the {axis} of node {node}: "
                        "leave that node out of the features, or the readout sees the input"
                    )


def _describe(
    file: h5py.File, writer: TrajectoryWriter, unit: str, clock: Clock, *, said: bool
) -> None:
    if clock.remark:
        writer.note(clock.remark)
    if not said:
        writer.note(f"the file does not state a unit; {unit} was taken, as it is from a video")
    facts = [
        f"{name} = {file.attrs[name]}"
        for name in ("source_video", "source_sensor", "amplitude_group", "layout_key")
        if isinstance(file.attrs.get(name), str)
    ]
    if facts:
        writer.note("recorded by its authors: " + ", ".join(facts))


def _empty(path: Path, key: str) -> UnreadableFile:
    return UnreadableFile(
        "the recording holds no frame",
        expected="at least one",
        fix="export it again",
        file=path,
        key=key,
    )
