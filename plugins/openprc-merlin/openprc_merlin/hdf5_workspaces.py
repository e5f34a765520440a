"""HDF5 workspaces: MATLAB v7.3 files and Octave's own ``save -hdf5``.

Both store arrays in column order, so every array is transposed on the way in.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.errors import UnreadableFile, UnsafeFile
from openprc.schema import safety
from openprc_merlin.mat5 import FunctionHandle

#: A workspace nests a handful of levels; references could run in circles.
MAX_DEPTH = 16
MAX_OBJECTS = 1_000_000
#: What h5py raises on damaged or unforeseen content, depending on which byte is wrong.
_DAMAGE = (
    ArithmeticError,
    AttributeError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,
    TypeError,
    ValueError,
)


def flavour(file: h5py.File) -> str:
    """Tell which program wrote the file: ``"matlab"``, ``"octave"`` or ``""``."""
    for name in file:
        if name.startswith("#") or not isinstance(file.get(name, getlink=True), h5py.HardLink):
            continue
        item = file[name]
        if "MATLAB_class" in item.attrs:
            return "matlab"
        if isinstance(item, h5py.Group) and {"type", "value"} <= set(item):
            return "octave"
    return ""


def read(path: Path) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Read every variable that can be represented.

    Raises
    ------
    UnreadableFile
        When the file is HDF5 but no workspace, or part of it cannot be decoded.
    UnsafeFile
        When it leads outside itself, or its references run in circles.
    """
    with safety.open_hdf5(path, allow_references=True, allow_vlen=True) as file:
        kind = _flavour_or_error(file, path)
        if not kind:
            raise UnreadableFile(
                f"this HDF5 file is no saved workspace; it holds {sorted(file)[:8]}",
                expected="a MATLAB v7.3 file, or one written by Octave with save -hdf5",
                fix="name the file that holds truss, angles and U_his",
                file=path,
            )
        reader = _Reader(file, path)
        convert = reader.matlab if kind == "matlab" else reader.octave
        try:
            variables = {name: convert(file[name], 0) for name in file if not name.startswith("#")}
        except _DAMAGE as error:
            raise _damaged(path, error) from error
    return variables, ()


def _flavour_or_error(file: h5py.File, path: Path) -> str:
    try:
        return flavour(file)
    except _DAMAGE as error:
        raise _damaged(path, error) from error


def _damaged(path: Path, error: Exception) -> UnreadableFile:
    return UnreadableFile(
        f"the workspace cannot be decoded: {type(error).__name__}: {error}",
        expected="the layout of MATLAB v7.3 or of Octave's save -hdf5",
        fix="save it again, with -v7 if it is smaller than 2 GB",
        file=path,
    )


class _Reader:
    """Converts HDF5 objects, counting them so that circular references end."""

    def __init__(self, file: h5py.File, path: Path) -> None:
        self._file = file
        self._path = path
        self._count = 0

    def _enter(self, item: Any, depth: int) -> None:
        self._count += 1
        if depth > MAX_DEPTH or self._count > MAX_OBJECTS:
            raise UnsafeFile(
                f"references nest deeper than {MAX_DEPTH} or reach over {MAX_OBJECTS} objects",
                expected="a workspace of structs, cells and arrays",
                fix="save the needed variables only: truss angles U_his LF_his",
                file=self._path,
                key=str(item.name),
            )

    # --- MATLAB v7.3 -----------------------------------------------------------------

    def matlab(self, item: h5py.Group | h5py.Dataset, depth: int) -> Any:
        """Convert one object of a v7.3 file; None when it has no counterpart."""
        self._enter(item, depth)
        kind = _text_attribute(item, "MATLAB_class")
        if isinstance(item, h5py.Group):
            if kind == "function_handle":
                inner = item.get("function_handle/function")
                return FunctionHandle("" if inner is None else _characters(inner[()], "matlab"))
            if "MATLAB_sparse" in item.attrs or kind not in ("struct", ""):
                return None
            return {
                name: self.matlab(item[name], depth + 1)
                for name in item
                if not name.startswith("#")
            }
        if item.attrs.get("MATLAB_empty", 0):
            # The stored numbers are the dimensions, not the data.
            shape = tuple(int(n) for n in np.ravel(item[()]))
            return {"char": "", "cell": []}.get(kind, np.zeros(shape))
        if h5py.check_ref_dtype(item.dtype) is not None:
            return [
                self.matlab(self._file[reference], depth + 1) if reference else None
                for reference in np.ravel(item[()])
            ]
        if "MATLAB_object_decode" in item.attrs:
            return None
        if kind == "char":
            return _characters(item[()], "matlab")
        return _numbers(item[()])

    # --- Octave ------------------------------------------------------------------------

    def octave(self, item: h5py.Group | h5py.Dataset, depth: int) -> Any:
        """Convert one object of an Octave file; None when it has no counterpart."""
        self._enter(item, depth)
        if not isinstance(item, h5py.Group) or not {"type", "value"} <= set(item):
            return None
        kind = bytes(item["type"][()]).split(b"\0")[0].decode("ascii", "replace")
        value = item["value"]
        if kind in ("scalar struct", "struct"):
            return {name: self.octave(value[name], depth + 1) for name in value if name != "dims"}
        if kind == "cell":
            if not isinstance(value, h5py.Group):
                return []
            names = sorted((n for n in value if n.startswith("_")), key=lambda n: int(n[1:]))
            return [self.octave(value[name], depth + 1) for name in names]
        if kind == "function handle":
            inner = value.get("fcn", value.get("nm")) if isinstance(value, h5py.Group) else None
            return FunctionHandle(
                "" if inner is None else bytes(inner[()]).split(b"\0")[0].decode("utf-8", "replace")
            )
        if not isinstance(value, h5py.Dataset):
            return None
        if item.attrs.get("OCTAVE_EMPTY_MATRIX", 0) or value.attrs.get("OCTAVE_EMPTY_MATRIX", 0):
            shape = tuple(int(n) for n in np.ravel(value[()]))
            return "" if "string" in kind else np.zeros(shape)
        if kind in ("string", "sq_string"):
            return _characters(value[()], "octave")
        if "range" in kind:
            return _range(value[()])
        if kind.endswith(("matrix", "scalar", "bool")) and not kind.startswith(("diag", "perm")):
            return _numbers(value[()])
        return None


def _text_attribute(item: h5py.HLObject, name: str) -> str:
    value = item.attrs.get(name, "")
    return value.decode("ascii", "replace") if isinstance(value, bytes) else str(value)


def _characters(value: Any, writer: str) -> str:
    """Join character codes: uint16 columns in MATLAB, int8 columns in Octave."""
    if isinstance(value, bytes | str):
        return value.decode("utf-8", "replace") if isinstance(value, bytes) else value
    codes = np.atleast_2d(np.asarray(value).T)
    if writer == "octave":
        codes = codes.astype(np.uint8)
    return "\n".join("".join(chr(int(code)) for code in row) for row in codes)


def _numbers(value: Any) -> NDArray[np.float64] | NDArray[np.complex128] | None:
    """Return the transposed array as float64 or complex128; scalars become (1, 1)."""
    array = np.asarray(value)
    if array.dtype.names is not None:
        if set(array.dtype.names) != {"real", "imag"}:
            return None
        array = array["real"].astype(np.float64) + 1j * array["imag"].astype(np.float64)
    if array.dtype.kind not in "fiubc":
        return None
    array = np.atleast_2d(array.T)
    return array.astype(np.complex128 if array.dtype.kind == "c" else np.float64, copy=False)


def _range(value: Any) -> NDArray[np.float64] | None:
    """Expand Octave's ``base:increment:limit`` to a (1, n) row."""
    record = np.asarray(value).ravel()
    names = record.dtype.names or ()
    step = next((name for name in ("increment", "inc") if name in names), None)
    if not {"base", "limit"} <= set(names) or step is None:
        return None
    base, limit, increment = (float(record[name][0]) for name in ("base", "limit", step))
    if increment == 0.0:
        return np.zeros((1, 0))
    # The tolerance is Octave's own: three units in the last place of the limit.
    count = int(np.floor((limit - base) / increment * (1 + 3 * np.finfo(float).eps))) + 1
    if count > 1 << 28:
        return None
    return (base + increment * np.arange(max(count, 0)))[None, :]
