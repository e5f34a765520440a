"""Rest coordinates and topology from a second file, for runs that were saved without them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingData, UnreadableFile
from openprc.schema import safety
from openprc_merlin import containers, histories, obj_sequence

#: What a workspace may lend to a run that was saved without it: everything but its histories.
_LENT = ("truss", "angles", "Node", "Panel", "Supp", "Load", "F", "AnalyInputOpt")
#: Names of tables of loose arrays: MERLIN's, those of Sim-FAST's classes, and plain ones.
_TABLES: Mapping[str, tuple[tuple[str, ...], int]] = MappingProxyType(
    {
        "Bars": (("Bars", "bars", "node_ij_mat"), 2),
        "Trigl": (("Trigl", "faces", "triangles"), 3),
        "fold": (("fold", "hinges"), 4),
        "bend": (("bend",), 4),
    }
)
#: Sim-FAST's rows are wing, crease, crease, wing; MERLIN's crease, crease, wing, wing.
_SPRINGS = "node_ijkl_mat"
_NODES = ("node", "nodes", "rest", "positions", "vertices", "coordinates_mat")


def load(path: Path) -> dict[str, Any]:
    """Read rest coordinates, and the topology where the file has one, as MERLIN variables.

    Arrays of a workspace are counted from 1, those of an archive from 0, as NumPy counts:
    ``bars`` (M, 2), ``hinges`` (H, 4) with the crease first, ``faces`` (F, 3). Sim-FAST's
    ``coordinates_mat``, ``node_ij_mat`` and ``node_ijkl_mat`` are known, too.

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
        arrays = safety.load_npz(path)
        return _joined(_only(arrays, path), arrays, first=0, path=path)
    if suffix in (".csv", ".txt", ".dat"):
        return {"Node": _table(path)}
    variables = containers.read(path).variables
    lent = {key: variables[key] for key in _LENT if key in variables}
    truss = lent.get("truss")
    if isinstance(truss, dict) and "Node" in truss:
        return lent
    nodes = lent["Node"] if "Node" in lent else _only(variables, path)
    return {**lent, **_joined(nodes, variables, first=1, path=path)}


def _joined(nodes: Any, arrays: Mapping[str, Any], *, first: int, path: Path) -> dict[str, Any]:
    """Return nodes and what loose tables connect them by, counted from 1."""
    found: dict[str, Any] = {}
    for name, (names, width) in _TABLES.items():
        for key in names:
            if key in arrays:
                found[name] = _table_of(arrays[key], width, key, path) + (1 - first)
                break
    if _SPRINGS in arrays:
        springs = _table_of(arrays[_SPRINGS], 4, _SPRINGS, path) + (1 - first)
        found["fold"] = springs[:, [1, 2, 0, 3]]
    if not found:
        return {"Node": nodes}
    truss = {key: found[key] for key in ("Bars", "Trigl") if key in found}
    angles = {key: found[key] for key in ("fold", "bend") if key in found}
    joined: dict[str, Any] = {"truss": {"Node": nodes, **truss}}
    return {**joined, "angles": angles} if angles else joined


def _table_of(value: Any, width: int, key: str, path: Path) -> NDArray[np.float64]:
    fits = isinstance(value, np.ndarray) and value.dtype.kind in "fiu" and value.ndim == 2
    if not fits or value.shape[1] != width:
        shape = "x".join(map(str, value.shape)) if isinstance(value, np.ndarray) else "no array"
        raise MissingData(
            f"{key} is {shape}",
            expected=f"one row of {width} nodes for every element",
            fix="save the table again",
            file=path,
            key="reference",
        )
    return np.asarray(value, dtype=np.float64)


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
    named = [k for k in fitting if k.lower() in _NODES]
    tables = {key for names, _ in _TABLES.values() for key in names}
    fitting = {k: v for k, v in fitting.items() if k not in tables}
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
