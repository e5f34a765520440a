"""A PRCpy experiment folder as a matrix of states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, MissingData, UnreadableFile
from openprc_prcpy.file_names import (
    ScanName,
    Selection,
    find_prefix,
    scan_numbers,
    select,
    stem_of,
    visible_files,
)
from openprc_prcpy.parameters import ProcessParameters
from openprc_prcpy.processing import process, stack, with_an_axis
from openprc_prcpy.table import Sweep, read_sweep

Gaps = Literal["error", "close"]
InputChoice = Literal["auto", "names", "none"]


@dataclass(frozen=True)
class PRCpyData:
    """What a folder holds.

    Parameters
    ----------
    states : (T, F)
        A row for each scan and a column for each kept sample of the sweep; with ``transpose``
        a row for each instant and a column for each file.
    names : tuple of F str
        ``r0``, ``r16``, ... after the row in the file, as PRCpy has it; with ``transpose`` the
        file names without suffix.
    xs : (F,), with ``transpose`` (T,)
        The sweep axis or the times, as in the first file.
    scans : (T,) int
        Numbers of the scans; with ``transpose`` the rows, counted from 0.
    input : (T,) or None
        The input that the file names carry.
    input_unit : str or None
        As written there.
    files : tuple of str
        In the order in which they were used.
    left_out : tuple of str
        Files of the folder that are no scans.
    remarks : tuple of str
        What a user should know and would not see.
    xs_name, readouts_name, prefix : str
    background : Path or None
        The file that was subtracted.
    parameters : ProcessParameters
    """

    states: NDArray[np.float64]
    names: tuple[str, ...]
    xs: NDArray[np.float64]
    scans: NDArray[np.int64]
    input: NDArray[np.float64] | None
    input_unit: str | None
    files: tuple[str, ...]
    left_out: tuple[str, ...]
    remarks: tuple[str, ...]
    xs_name: str
    readouts_name: str
    prefix: str
    background: Path | None
    parameters: ProcessParameters

    @property
    def transpose(self) -> bool:
        """Whether time runs down the rows of the files."""
        return self.parameters.transpose


def read_prcpy(
    folder: str | Path,
    prefix: str | None,
    params: Mapping[str, Any],
    *,
    gaps: Gaps = "error",
    input_from: InputChoice = "auto",
) -> PRCpyData:
    """Read a PRCpy experiment with the arguments of PRCpy's ``Pipeline``.

    Parameters
    ----------
    folder : path-like
        One text file for each scan; with ``transpose`` one for each device.
    prefix : str or None
        What the names of the files begin with. With None it is found, if one stands out.
    params : mapping
        ``process_params``: ``Xs, Readouts, delimiter, remove_bg, bg_fname, smooth, smooth_win,
        smooth_rank, cut_xs, x1, x2, normalize_local, normalize_global, sample, sample_rate,
        transpose``. What is left out is off; a delimiter is found.
    gaps : {"error", "close"}
        What to do when scan numbers are missing: refuse, or count the files.
    input_from : {"auto", "names", "none"}
        Whether the input is read from the file names: where all of them carry a value that
        changes, always, or never.

    Returns
    -------
    PRCpyData

    Raises
    ------
    UnreadableFile
        The folder or a file is damaged, files differ in length or axis, a number is missing or
        appears twice.
    MissingData
        No file fits, a column or the background is not there.
    ConfigError
        `params` contradict themselves or the files.

    Examples
    --------
    >>> from pathlib import Path
    >>> from openprc_prcpy import read_prcpy
    >>> for k in (1, 2, 10):
    ...     name = f"scan_{k}_{k}_5mT.txt"
    ...     _ = Path(name).write_text(f"Frequency,Spectra\\n1.0,{k}\\n1.1,{2 * k}\\n")
    >>> data = read_prcpy(".", "scan", {}, gaps="close")
    >>> data.states
    array([[ 1.,  2.],
           [ 2.,  4.],
           [10., 20.]])
    >>> data.input, data.input_unit
    (array([ 1.5,  2.5, 10.5]), 'mT')
    """
    folder = Path(folder)
    parameters = ProcessParameters.from_mapping(params, folder=folder)
    if prefix is None:
        names = visible_files(folder)
        hidden = Path(parameters.bg_fname).name if parameters.bg_fname else None
        prefix = find_prefix([name for name in names if name != hidden], folder=folder)
    selection = select(
        folder, prefix, background=parameters.bg_fname, transpose=parameters.transpose
    )
    remarks = [selection.remark()]
    raw = _read_all(folder, selection, parameters)
    sweeps, remark = with_an_axis(raw)
    remarks.append(remark)
    xs = sweeps[0].xs
    values, remark = stack(sweeps, folder=folder)
    remarks.append(remark)
    files = tuple(item.name for item in selection.files)
    background, path = _background(folder, parameters, raw[0])
    values, rows = process(
        values, xs, parameters=parameters, background=background, names=files, folder=folder
    )
    if parameters.transpose:
        drive = unit = None
        scans, states = np.arange(len(values)), values
        columns = tuple(stem_of(name) for name in files)
    else:
        scans = scan_numbers(selection.files, gaps=gaps, folder=folder)
        drive, unit, remark = _input(selection.files, input_from, folder)
        remarks.append(remark)
        states, xs = np.ascontiguousarray(values.T), xs[rows]
        columns = tuple(f"r{row}" for row in rows)
    return PRCpyData(
        states=states,
        names=columns,
        xs=xs,
        scans=scans,
        input=drive,
        input_unit=unit,
        files=files,
        left_out=tuple(name for name, _ in selection.left_out),
        remarks=tuple(text for text in remarks if text),
        xs_name=sweeps[0].xs_name,
        readouts_name=sweeps[0].readouts_name,
        prefix=prefix,
        background=path,
        parameters=parameters,
    )


def _read_all(folder: Path, selection: Selection, parameters: ProcessParameters) -> list[Sweep]:
    xs, readouts = parameters.xs, parameters.readouts
    sweeps: list[Sweep] = []
    for item in selection.files:
        sweep = read_sweep(
            folder / item.name, xs=xs, readouts=readouts, delimiter=parameters.delimiter
        )
        # Columns that were guessed in the first file are asked for by name in the others.
        xs, readouts = sweep.xs_name, sweep.readouts_name
        sweeps.append(sweep)
    return sweeps


def _background(
    folder: Path, parameters: ProcessParameters, first: Sweep
) -> tuple[NDArray[np.float64] | None, Path | None]:
    if not parameters.remove_bg:
        return None, None
    path = folder / str(parameters.bg_fname)
    if not path.is_file():
        raise MissingData(
            f"there is no background file {parameters.bg_fname!r}",
            expected="a file in the folder of the scans",
            fix="correct bg_fname, or turn remove_bg off",
            file=folder,
            key="bg_fname",
        )
    # Sniffed on its own: backgrounds are often exported by another program than scans.
    sweep = read_sweep(path, xs=first.xs_name, readouts=first.readouts_name, delimiter=None)
    try:
        stack([first, sweep], folder=folder)
    except UnreadableFile as error:
        raise UnreadableFile(
            f"the background does not fit the scans: {error.found}",
            expected=error.expected,
            fix="measure the background with the settings of the scans",
            file=folder,
            key="bg_fname",
        ) from error
    return sweep.values, path


def _input(
    files: tuple[ScanName, ...], choice: InputChoice, folder: Path
) -> tuple[NDArray[np.float64] | None, str | None, str | None]:
    """Return the input (T,), its unit as written, and a remark."""
    if choice == "none":
        return None, None, None
    without = [item for item in files if item.value is None]
    if without and choice == "names":
        raise MissingData(
            f"{without[0].name} and {len(without) - 1} more names carry no input value",
            expected=f"names such as {files[0].name.partition('_')[0]}_1_62_923mT.txt, which is "
            "scan 1 at 62.923 mT",
            fix="rename the files, or attach the input after the import",
            file=folder,
            key="input",
        )
    if len(without) == len(files):
        return None, None, None
    if without:
        return None, None, (
            f"{len(without)} of {len(files)} names carry no input value (the first is "
            f"{without[0].name}), so no input was read from the names"
        )  # fmt: skip
    units = {item.unit for item in files}
    if len(units) > 1:
        other = next(item for item in files if item.unit != files[0].unit)
        raise ConfigError(
            f"{files[0].name} is in {files[0].unit or 'no unit'}, {other.name} in "
            f"{other.unit or 'no unit'}",
            expected="one unit in all names",
            fix="rename the files, or say input=none",
            file=folder,
            key="input",
        )
    value = np.array([item.value for item in files], dtype=np.float64)
    if choice == "auto" and len(value) > 1 and np.ptp(value) == 0.0:
        return None, None, (
            f"every name says {value[0]:g} {units.pop() or ''}: a setting, not an input".rstrip()
        )  # fmt: skip
    rest = next((item for item in files if item.rest), None)
    remark = "the input was read from the file names"
    if rest:
        remark += f"; what follows the value was not used ({rest.rest!r} in {rest.name})"
    return value, files[0].unit, remark
