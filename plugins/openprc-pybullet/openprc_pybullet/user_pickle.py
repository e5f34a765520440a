"""Pickles that people write from their loop: a list with one entry a step, or a dict of arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import NotATrajectory, SchemaError


def stack_steps(value: object, path: Path) -> dict[str, NDArray[np.generic]]:
    """Return named arrays with time along axis 0.

    Takes a dict of arrays, a list of dicts with the same keys, a list of tuples (time,
    positions, orientations, ... told apart by shape), or one array of positions.

    Raises
    ------
    NotATrajectory
        When it is none of these.
    SchemaError
        When the steps differ in their keys or shapes.
    """
    if isinstance(value, np.ndarray):
        return {"positions": value}
    if isinstance(value, Mapping):
        return _named({str(key): item for key, item in value.items()}, path)
    if isinstance(value, Sequence) and not isinstance(value, str | bytes) and value:
        if all(isinstance(step, Mapping) for step in value):
            return _stack_dicts(value, path)
        if all(isinstance(step, tuple | list) for step in value):
            return _stack_tuples(value, path)
        if all(isinstance(step, np.ndarray) and step.ndim == 2 for step in value):
            return {"positions": _array(value, "positions", path)}
    raise NotATrajectory(
        f"the pickle holds a {type(value).__name__}, not steps",
        expected="a list of dicts or tuples, one a step, or a dict of arrays",
        fix="save arrays: numpy.savez(file, t=times, positions=positions)",
        file=path,
    )


def _stack_dicts(steps: Sequence[Mapping[Any, Any]], path: Path) -> dict[str, NDArray[np.generic]]:
    keys = set(steps[0])
    for index, step in enumerate(steps):
        if set(step) != keys:
            odd = ", ".join(map(str, sorted(keys ^ set(step), key=str)))
            raise SchemaError(
                f"step {index} differs from step 0 in its keys: {odd}",
                expected="the same keys in every step",
                fix="save the same quantities in every step",
                file=path,
            )
    return _named({str(key): [step[key] for step in steps] for key in steps[0]}, path)


def _named(items: Mapping[str, Any], path: Path) -> dict[str, NDArray[np.generic]]:
    """Stack named entries; what PyBullet's own calls return becomes positions and the rest."""
    found: dict[str, NDArray[np.generic]] = {}
    for key, item in items.items():
        parts = live_poses(item)
        if parts is None:
            found[key] = _array(item, key, path)
        else:
            found |= {key if role == "positions" else f"{key}.{role}": part
                      for role, part in parts.items()}  # fmt: skip
    return found


def _stack_tuples(steps: Sequence[Sequence[Any]], path: Path) -> dict[str, NDArray[np.generic]]:
    width = len(steps[0])
    for index, step in enumerate(steps):
        if len(step) != width:
            raise SchemaError(
                f"step {index} has {len(step)} entries, step 0 has {width}",
                expected="tuples of one length",
                fix="save the same quantities in every step",
                file=path,
            )
    found: dict[str, NDArray[np.generic]] = {}
    whole = live_poses(steps) or _only_triples(steps, path)
    if whole is not None:
        return whole
    for place in range(width):
        entries = [step[place] for step in steps]
        parts = live_poses(entries)
        if parts is not None:
            found |= {
                role if role not in found else f"entry{place}.{role}": part
                for role, part in parts.items()
            }
            continue
        array = _array(entries, f"entry {place}", path)
        found[_role(array, place, found)] = array
    return found


def _only_triples(
    steps: Sequence[Sequence[Any]], path: Path
) -> dict[str, NDArray[np.generic]] | None:
    """Return the nodes of steps that hold triples and nothing else, None for other steps.

    Raises
    ------
    SchemaError
        When two or three triples may be nodes, or position, velocity and spin of one body.
    """
    if not all(_is_row(item) and len(item) == 3 for step in steps for item in step):
        return None
    width = len(steps[0])
    if width in (2, 3):
        raise SchemaError(
            f"every step holds {width} triples without names: {width} nodes, or the position and "
            "velocities of one body",
            expected="steps that say what they hold",
            fix="save dicts, such as {'t': t, 'positions': nodes} or "
            "{'t': t, 'position': x, 'velocity': v}",
            file=path,
        )
    return {"positions": np.array([list(step) for step in steps], dtype=np.float64)}


def _role(array: NDArray[np.generic], place: int, taken: Mapping[str, Any]) -> str:
    """Name an unnamed entry: first growing real numbers the time, first triples the positions.

    Whole numbers that grow count steps; they are no seconds.
    """
    if array.ndim == 1 and bool(np.all(np.diff(array.astype(np.float64)) > 0)):
        name = "t" if array.dtype.kind == "f" else "step"
        if name not in taken:
            return name
    if array.ndim >= 2 and array.shape[-1] == 3 and "positions" not in taken:
        return "positions"
    if array.ndim == 2 and array.shape[-1] == 4 and "orientation" not in taken:
        return "orientation"
    return f"entry{place}"


def live_poses(frames: object) -> dict[str, NDArray[np.generic]] | None:
    """Take apart what PyBullet's calls returned frame by frame, None for anything else.

    ``getBasePositionAndOrientation`` returns (x y z), (x y z w), for one body or for several in
    a list; ``getMeshData`` a number and that many vertices.
    """
    if not isinstance(frames, Sequence) or not frames or isinstance(frames, str | bytes):
        return None
    if all(_is_mesh(frame) for frame in frames):
        sizes = {int(frame[0]) for frame in frames}
        if len(sizes) == 1:
            return {"positions": np.array([frame[1] for frame in frames], dtype=np.float64)}
        return None
    if all(_is_pose(frame) for frame in frames):
        frames = [[frame] for frame in frames]
    elif not all(isinstance(f, tuple | list) and f and all(map(_is_pose, f)) for f in frames):
        return None
    if len({len(frame) for frame in frames}) != 1:
        return None
    placed = np.array([[pose[0] for pose in frame] for frame in frames], dtype=np.float64)
    turned = np.array([[pose[1] for pose in frame] for frame in frames], dtype=np.float64)
    found: dict[str, NDArray[np.generic]] = {"positions": placed}
    if placed.shape[1] == 1:
        return found | {"orientation": turned[:, 0]}
    return found | {f"orientation{body}": turned[:, body] for body in range(placed.shape[1])}


def _is_pose(item: object) -> bool:
    return (
        isinstance(item, tuple | list)
        and len(item) == 2
        and [np.shape(part) if _is_row(part) else None for part in item] == [(3,), (4,)]
    )


def _is_row(item: object) -> bool:
    if isinstance(item, np.ndarray):
        return item.dtype.kind in "fiu"
    return isinstance(item, tuple | list) and all(isinstance(x, float | int) for x in item)


def _is_mesh(item: object) -> bool:
    return (
        isinstance(item, tuple | list)
        and len(item) == 2
        and isinstance(item[0], int)
        and isinstance(item[1], tuple | list)
        and len(item[1]) == item[0] > 0
        and all(_is_row(row) and len(row) == 3 for row in item[1])
    )


def _array(items: Any, key: str, path: Path) -> NDArray[np.generic]:
    try:
        array = np.asarray(items)
    except ValueError as error:
        raise _not_numbers(key, path, "its shape changes from step to step") from error
    if array.dtype.kind not in "fiub":
        raise _not_numbers(key, path, f"it holds {array.dtype.name}, not numbers")
    return array


def _not_numbers(key: str, path: Path, found: str) -> SchemaError:
    return SchemaError(
        f"this cannot be made into an array: {found}",
        expected="numbers of one shape in every step",
        fix="save numeric arrays, the same quantities in every step",
        file=path,
        key=key,
    )
