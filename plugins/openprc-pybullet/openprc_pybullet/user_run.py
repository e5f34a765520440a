"""What people save from their own loop: named arrays, of which one holds the positions.

`select_run` finds time, positions and the rest among named arrays (from .npz, pickle or CSV)
and refuses to guess between two that fit equally well; `write_run` hands the run over.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, Diverged, MissingData, NotATrajectory, SchemaError
from openprc.schema import TrajectoryWriter
from openprc.schema.units import conversion_factor
from openprc_pybullet.clock import grid, regular_clock
from openprc_pybullet.settings import Settings

Arrays = Mapping[str, NDArray[np.generic]]

TIME_KEYS = ("t", "time", "times", "timestamp", "timestamps", "sim_time", "t_s", "time_s")
TIME_KEYS_MS = ("t_ms", "time_ms", "ms")
POSITION_KEYS = (
    "pos", "position", "positions", "xyz", "links", "link_pos", "link_positions",
    "link_com_pos", "vertices", "verts", "nodes", "points",
)  # fmt: skip
VELOCITY_KEYS = ("vel", "vels", "velocity", "velocities", "v", "link_vel", "link_velocities")
FACE_KEYS = ("faces", "obj_faces", "triangles", "tris")


@dataclass(frozen=True, slots=True)
class UserRun:
    """A run in arrays.

    Parameters
    ----------
    time : (T,) [s]
    positions : (T, N, D)
        In the unit that the user names.
    velocities : (T, N, D), optional
    faces : (F, 3) int, optional
    channels : mapping of name to (T, C)
    drive : (T, C), optional
        What drove the body.
    notes : tuple of str
    """

    time: NDArray[np.float64]
    positions: NDArray[np.float64]
    velocities: NDArray[np.float64] | None
    faces: NDArray[np.int64] | None
    channels: Mapping[str, NDArray[np.float64]]
    drive: NDArray[np.float64] | None
    notes: tuple[str, ...]


def select_run(
    arrays: Arrays,
    *,
    path: Path,
    settings: Settings,
    half_digit: float | None = None,
) -> UserRun:
    """Find the run among named arrays.

    Parameters
    ----------
    half_digit : float, optional
        Half of the last printed digit of the time, when it comes from text.

    Raises
    ------
    ConfigError
        When a named key is absent, or several arrays could be the positions.
    NotATrajectory
        When no array can be the positions.
    MissingData
        When there is no time and no `dt`.
    SchemaError
        When shapes disagree or time does not increase.
    Diverged
        When a position is not a finite number.
    """
    time_key = _named(arrays, settings.time_key, "time_key", path) or _first(
        arrays, (*TIME_KEYS, *TIME_KEYS_MS)
    )
    key = _named(arrays, settings.position_key, "position_key", path) or _position_key(
        arrays, {time_key, settings.input_key}, path
    )
    positions = _as_nodes(arrays[key], key, path)
    notes: list[str] = []
    time = _time(arrays, time_key, len(positions), path, settings, half_digit, notes)
    _refuse_divergence(positions, time, key, path)
    used = {time_key, key}
    velocities = None
    speed = _first(arrays, VELOCITY_KEYS)
    if speed is not None and arrays[speed].shape == arrays[key].shape:
        velocities = _as_nodes(arrays[speed], speed, path)
        used.add(speed)
    faces, face_key = _faces(arrays, positions.shape[1])
    used.add(face_key)
    drive = None
    input_key = _named(arrays, settings.input_key, "input_key", path)
    if input_key is not None:
        drive = _per_frame(arrays[input_key], len(time))
        used.add(input_key)
        if drive is None:
            raise SchemaError(
                f"the input has shape {arrays[input_key].shape} and there are {len(time)} frames",
                expected="one row a frame",
                fix="save the input at the instants of the positions",
                file=path,
                key=input_key,
            )
    channels, left_out = {}, []
    for name, array in arrays.items():
        if name in used:
            continue
        values = _per_frame(array, len(time))
        if values is None or not np.isfinite(values).all():
            left_out.append(f"{name} {array.shape}")
        else:
            channels[_clean(name)] = values
    if left_out:
        notes.append(f"left out, not one finite row a frame: {', '.join(left_out)}")
    return UserRun(time, positions, velocities, faces, channels, drive, tuple(notes))


def write_run(
    run: UserRun,
    writer: TrajectoryWriter,
    *,
    settings: Settings,
    labels: Sequence[str] | None = None,
) -> None:
    """Hand a run to the writer: channels get the unit arb, since arrays carry none."""
    n_nodes, dims = run.positions.shape[1:]
    writer.declare_nodes(
        n_nodes, dims, unit=settings.unit, velocities=run.velocities is not None, labels=labels
    )
    if run.faces is not None:
        writer.declare_elements("faces", run.faces)
    for name, values in run.channels.items():
        writer.declare_channel(name, _columns(name, values), unit="arb")
    inputs = {}
    if run.drive is not None and settings.input_key is not None:
        name = _clean(settings.input_key)
        inputs[name] = run.drive
        writer.declare_input(
            name,
            _columns(name, run.drive),
            quantity=settings.input_quantity,
            unit=settings.input_unit,
        )
    for note in run.notes:
        writer.note(note)
    given = {} if run.velocities is None else {"velocities": run.velocities}
    writer.append(
        run.time, positions=run.positions, channels=dict(run.channels), inputs=inputs, **given
    )


def _columns(name: str, values: NDArray[np.float64]) -> list[str]:
    width = values.shape[1]
    return [name] if width == 1 else [f"{name}{i}" for i in range(width)]


def _clean(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9_.\- ]", "_", name).lstrip(".- ") or "unnamed"


def _named(arrays: Arrays, key: str | None, option: str, path: Path) -> str | None:
    if key is None or key in arrays:
        return key
    raise ConfigError(
        f"there is no {key!r}",
        expected=f"one of {', '.join(arrays)}",
        fix="correct the name",
        file=path,
        key=option,
    )


def _first(arrays: Arrays, names: Sequence[str]) -> str | None:
    lower = {name.lower(): name for name in reversed(list(arrays))}
    return next((lower[name] for name in names if name in lower), None)


def _position_key(arrays: Arrays, taken: set[str | None], path: Path) -> str:
    free = {name: array for name, array in arrays.items() if name not in taken}
    known = [name for name in free if name.lower() in POSITION_KEYS and free[name].ndim >= 2]
    fitting = [
        name
        for name, array in free.items()
        if array.ndim == 3
        and array.shape[2] in (2, 3)
        and array.dtype.kind == "f"
        and name.lower() not in VELOCITY_KEYS
    ]
    candidates = known or fitting
    if len(candidates) == 1:
        return candidates[0]
    if candidates:
        raise ConfigError(
            f"several arrays could be the positions: {', '.join(candidates)}",
            expected="one",
            fix=f"name it: position_key={candidates[0]}",
            file=path,
            key="position_key",
        )
    shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
    raise NotATrajectory(
        f"no array looks like positions; there are {shapes or 'none'}",
        expected="an array (frames, nodes, 3), or (frames, 3 nodes) named with position_key",
        fix="save the positions of every step, or name their array with position_key",
        file=path,
    )


def _as_nodes(array: NDArray[np.generic], key: str, path: Path) -> NDArray[np.float64]:
    shape = array.shape
    if array.dtype.kind in "fiu":
        values = np.asarray(array, dtype=np.float64)
        if array.ndim == 3 and shape[2] in (2, 3) and min(shape) > 0:
            return values
        if array.ndim == 2 and shape[1] and shape[1] % 3 == 0 and shape[0]:
            return values.reshape(shape[0], shape[1] // 3, 3)
    hint = ""
    if array.ndim == 3 and shape[1] == 3:
        hint = "; this one has its axes the other way round, as PyElastica stores them"
    raise SchemaError(
        f"the positions have shape {shape}, type {array.dtype}{hint}",
        expected="(frames, nodes, 3) or (frames, 3 nodes)",
        fix="swap the axes, or name another array with position_key",
        file=path,
        key=key,
    )


def _time(
    arrays: Arrays,
    key: str | None,
    n_frames: int,
    path: Path,
    settings: Settings,
    half_digit: float | None,
    notes: list[str],
) -> NDArray[np.float64]:
    if key is None:
        if settings.dt is None:
            raise MissingData(
                f"nothing tells the time; there are {', '.join(arrays)}",
                expected=f"an array named {TIME_KEYS[0]} or {TIME_KEYS[1]}, or dt",
                fix="say time_key=NAME, or dt=SECONDS between frames",
                file=path,
            )
        return grid(settings.t0, settings.dt, count=n_frames)
    stored = np.asarray(arrays[key]).squeeze()
    if stored.shape != (n_frames,) or stored.dtype.kind not in "fiu":
        raise SchemaError(
            f"the time has shape {arrays[key].shape}, the positions have {n_frames} frames",
            expected="one number a frame",
            fix="name other arrays with time_key and position_key",
            file=path,
            key=key,
        )
    unit = "ms" if key.lower() in TIME_KEYS_MS else settings.time_unit
    factor = conversion_factor(unit, "s")
    time = stored.astype(np.float64)
    steps = np.diff(time)
    if not (np.isfinite(time).all() and np.all(steps > 0)):
        bad = int(np.flatnonzero(~(steps > 0))[0]) + 1 if np.any(~(steps > 0)) else 0
        raise SchemaError(
            f"time does not increase at frame {bad}: {time[max(bad - 1, 0)]:.9g}, {time[bad]:.9g}",
            expected="strictly increasing, finite times",
            fix="save every instant once, and each run to a file of its own",
            file=path,
            key=key,
        )
    half: float | NDArray[np.float64] | None = half_digit
    if half is None and stored.dtype == np.float32:
        half = np.spacing(np.abs(stored)).astype(np.float64)
    return settings.t0 + _on_grid(time * factor, half, factor, path, settings, notes)


def _on_grid(
    time: NDArray[np.float64],
    half: float | NDArray[np.float64] | None,
    factor: float,
    path: Path,
    settings: Settings,
    notes: list[str],
) -> NDArray[np.float64]:
    """Undo the rounding of printed or single-precision times, when it alone explains them."""
    if settings.dt is not None:
        exact = grid(float(time[0]), settings.dt, count=time.size)
        worst = float(np.abs(exact - time).max())
        if worst > 0.01 * settings.dt:
            raise ConfigError(
                f"dt={settings.dt:.9g} s is given and a frame stands {worst:.3g} s off that clock",
                expected="the step at which frames were saved",
                fix="leave dt out",
                file=path,
                key="dt",
            )
        return exact
    if half is None:
        return time
    regular = regular_clock(time, np.asarray(half) * factor)
    if regular is None:
        return time
    if np.abs(regular - time).max() > 0:
        step = float(regular[-1] - regular[0]) / (regular.size - 1)
        notes.append(
            f"times are rounded in the file; put back on multiples of {step:.12g} s, which round "
            "to every one of them"
        )
    return regular


def _refuse_divergence(
    positions: NDArray[np.float64], time: NDArray[np.float64], key: str, path: Path
) -> None:
    bad = np.argwhere(~np.isfinite(positions))
    if bad.size:
        frame, node = bad[0][:2]
        raise Diverged(
            f"node {node} is {positions[tuple(bad[0])]} in frame {frame} (t = {time[frame]:.6g} s)",
            expected="finite positions: the simulation blew up",
            fix="simulate again with a smaller time step, or save the frames before this one",
            file=path,
            key=key,
        )


def _faces(arrays: Arrays, n_nodes: int) -> tuple[NDArray[np.int64] | None, str | None]:
    key = _first(arrays, FACE_KEYS)
    if key is None:
        return None, None
    table = np.asarray(arrays[key])
    fits = table.ndim == 2 and table.shape[1] == 3 and table.dtype.kind in "iu" and table.size
    if not fits or table.min() < 0 or table.max() >= n_nodes:
        return None, None
    return table.astype(np.int64), key


def _per_frame(array: NDArray[np.generic], n_frames: int) -> NDArray[np.float64] | None:
    if array.ndim not in (1, 2) or array.shape[0] != n_frames or array.dtype.kind not in "fiub":
        return None
    if array.size == 0:
        return None
    return np.asarray(array, dtype=np.float64).reshape(n_frames, -1)
