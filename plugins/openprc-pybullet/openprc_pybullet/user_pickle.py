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
        return {str(key): _array(item, str(key), path) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str | bytes) and value:
        if all(isinstance(step, Mapping) for step in value):
            return _stack_dicts(value, path)
        if all(isinstance(step, tuple | list) for step in value):
            return _stack_tuples(value, path)
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
    return {str(key): _array([step[key] for step in steps], str(key), path) for key in steps[0]}


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
    for place in range(width):
        array = _array([step[place] for step in steps], f"entry {place}", path)
        found[_role(array, place, found)] = array
    return found


def _role(array: NDArray[np.generic], place: int, taken: Mapping[str, Any]) -> str:
    """Name an unnamed entry: first scalar the time, first triples the positions."""
    if array.ndim == 1 and "t" not in taken:
        return "t"
    if array.ndim >= 2 and array.shape[-1] == 3 and "positions" not in taken:
        return "positions"
    if array.ndim == 2 and array.shape[-1] == 4 and "orientation" not in taken:
        return "orientation"
    return f"entry{place}"


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
