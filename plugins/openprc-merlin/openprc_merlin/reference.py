"""Rest coordinates from a second file, for runs that were saved without them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingData, UnreadableFile
from openprc.schema import safety
from openprc_merlin import containers, histories, obj_sequence

#: What a workspace may lend to a run that was saved without it: everything but its histories.
_LENT = ("truss", "angles", "Node", "Panel", "Supp", "Load", "F", "AnalyInputOpt")


def load(path: Path) -> dict[str, Any]:
    """Read rest coordinates, and the topology where the file has one, as MERLIN variables.

    Parameters
    ----------
    path : Path
        A workspace (``.mat``, ``.h5``), one OBJ file, an ``.npz`` or a table in text (``.csv``).

    Returns
    -------
    dict
        At least ``Node`` or ``truss``, as `containers.read` would return them.

    Raises
    ------
    MissingData
        When the file holds no N x 3 coordinates, or several arrays of that shape.
    UnreadableFile
        When it cannot be decoded.
    """
    path = safety.check_readable(path)
    suffix = path.suffix.lower()
    if suffix == ".obj":
        return obj_sequence.as_variables(obj_sequence.read_frame(path))
    if suffix == ".npz":
        return {"Node": _only(safety.load_npz(path), path)}
    if suffix in (".csv", ".txt", ".dat"):
        return {"Node": _table(path)}
    variables = containers.read(path).variables
    lent = {key: variables[key] for key in _LENT if key in variables}
    truss = lent.get("truss")
    if "Node" in lent or (isinstance(truss, dict) and "Node" in truss):
        return lent
    return {"Node": _only(variables, path)}


def _only(arrays: Mapping[str, Any], path: Path) -> NDArray[np.float64]:
    """Return the one array of coordinates: by name, else by shape."""
    fitting = {
        key: value
        for key, value in arrays.items()
        if isinstance(value, np.ndarray)
        and value.dtype.kind in "fiu"
        and value.ndim == 2
        and value.shape[1] == 3
        and not histories.is_displacement(key)
    }
    named = [k for k in fitting if k.lower() in ("node", "nodes", "rest", "positions", "vertices")]
    names = named if len(named) == 1 else list(fitting)
    if len(names) != 1:
        raise MissingData(
            f"{len(names)} arrays of shape N x 3: {', '.join(names) or 'none'}",
            expected="one array of rest coordinates, named nodes",
            fix="save the rest coordinates alone, N x 3",
            file=path,
            key="reference",
        )
    return np.asarray(fitting[names[0]], dtype=np.float64)


def _table(path: Path) -> NDArray[np.float64]:
    """Read three columns of numbers; one heading line is allowed."""
    rows: list[list[float]] = []
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise UnreadableFile(
            "this is not text",
            expected="three columns of numbers",
            fix="save the rest coordinates as comma-separated text",
            file=path,
            key="reference",
        ) from error
    for number, line in enumerate(lines, start=1):
        words = line.replace(",", " ").replace(";", " ").split()
        if not words or line.lstrip().startswith(("#", "%")):
            continue
        try:
            row = [float(word) for word in words]
        except ValueError:
            row = []
        if len(row) != 3:
            if not rows and number == 1:
                continue
            raise UnreadableFile(
                f"line {number} is {line.strip()[:60]!r}",
                expected="three numbers, x y z",
                fix="save the rest coordinates as comma-separated text, N rows of 3",
                file=path,
                key="reference",
            )
        rows.append(row)
    if not rows:
        raise MissingData(
            "no row of three numbers",
            expected="N rows of x y z",
            fix="save the rest coordinates as comma-separated text",
            file=path,
            key="reference",
        )
    return np.array(rows, dtype=np.float64)
