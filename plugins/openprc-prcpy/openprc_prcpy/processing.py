"""From sweeps to states: background, smoothing, cut, normalisation, subsampling, in this order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, UnreadableFile
from openprc_prcpy.parameters import ProcessParameters
from openprc_prcpy.table import Sweep

#: Axes of two files may differ by this share of a step: rounding, not another grid.
_GRID_TOLERANCE = 0.5
#: What rows are called that have no axis of their own.
ROW = "row"


def with_an_axis(sweeps: Sequence[Sweep]) -> tuple[list[Sweep], str | None]:
    """Count the rows of files whose axis does not run, and say so.

    A column that is one number all along each file, such as the number of the device, is no
    axis.
    """
    if len(sweeps[0].xs) < 2 or any(np.ptp(sweep.xs) > 0 for sweep in sweeps):
        return list(sweeps), None
    rows = np.arange(len(sweeps[0].xs), dtype=np.float64)
    remark = (
        f"{sweeps[0].xs_name!r} is one number all along each file ({sweeps[0].xs[0]:g} in "
        f"{sweeps[0].path.name}) and no axis, so the rows are counted"
    )
    return [replace(one, xs=rows[: len(one.xs)], xs_name=ROW) for one in sweeps], remark


def stack(sweeps: Sequence[Sweep], *, folder: Path) -> tuple[NDArray[np.float64], str | None]:
    """Return the readouts of all files, (S, n), and a remark when their axes differ a little.

    Raises
    ------
    UnreadableFile
        A file has another number of rows, or another axis.
    """
    first = sweeps[0]
    step = np.abs(np.diff(first.xs))
    step = float(np.median(step[step > 0])) if (step > 0).any() else 0.0
    worst, where = 0.0, ""
    for sweep in sweeps:
        if len(sweep.values) != len(first.values):
            raise UnreadableFile(
                f"{len(sweep.values)} rows, and {first.path.name} has {len(first.values)}",
                expected="equally many rows in every file",
                fix="repeat the measurement that was cut off, or move the file out of the folder",
                file=folder,
                key=sweep.path.name,
            )
        off = float(np.max(np.abs(sweep.xs - first.xs)))
        if off > _GRID_TOLERANCE * step:
            row = int(np.argmax(np.abs(sweep.xs - first.xs)))
            raise UnreadableFile(
                f"{sweep.xs_name} is {sweep.xs[row]:g} in row {row + 1}, and "
                f"{first.xs[row]:g} in {first.path.name}",
                expected="one axis for all files",
                fix="interpolate the files to one axis first",
                file=folder,
                key=sweep.path.name,
            )
        if off > worst:
            worst, where = off, sweep.path.name
    remark = None
    if worst > 0.0:
        remark = (
            f"{first.xs_name} differs between files by up to {worst:.3g} ({where}); that of "
            f"{first.path.name} is used"
        )
    return np.stack([sweep.values for sweep in sweeps], axis=1), remark


def process(
    values: NDArray[np.float64],
    xs: NDArray[np.float64],
    *,
    parameters: ProcessParameters,
    background: NDArray[np.float64] | None,
    names: Sequence[str],
    folder: Path,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the processed sweeps, (S', n), and which rows of the files they are, (S',).

    Parameters
    ----------
    values : (S, n)
    xs : (S,)
    background : (S,), optional
    names : n file names, for messages

    Raises
    ------
    ConfigError
        The window is longer than the sweep, the cut leaves nothing, or there is no range to
        normalise.
    """
    rows = np.arange(len(xs))
    if background is not None:
        values = values - background[:, np.newaxis]
    if parameters.smooth:
        from scipy.signal import savgol_filter

        window = int(parameters.smooth_win or 0)
        if window > len(xs):
            raise _error(
                f"smooth_win is {window} and a sweep has {len(xs)} samples",
                f"at most {len(xs)}",
                "smooth_win",
                folder,
            )
        values = savgol_filter(values, window, int(parameters.smooth_rank or 0), axis=0)
    if parameters.cut_xs:
        inside = (xs >= parameters.x1) & (xs <= parameters.x2)
        if not inside.any():
            raise _error(
                f"nothing lies between x1 = {parameters.x1:g} and x2 = {parameters.x2:g}",
                f"limits within {xs.min():g} and {xs.max():g}",
                "cut_xs",
                folder,
            )
        values, rows = values[inside], rows[inside]
    if parameters.normalize_local:
        low, high = values.min(axis=0), values.max(axis=0)
        flat = np.flatnonzero(high == low)
        if len(flat):
            raise _error(
                f"{names[int(flat[0])]} holds one value only, {low[flat[0]]:g}",
                "a range to map to [0, 1]",
                "normalize_local",
                folder,
            )
        values = (values - low) / (high - low)
    if parameters.normalize_global:
        low, high = values.min(), values.max()
        if high == low:
            raise _error(
                f"all scans hold one value only, {low:g}",
                "a range to map to [0, 1]",
                "normalize_global",
                folder,
            )
        values = (values - low) / (high - low)
    if parameters.sample:
        values, rows = values[:: parameters.sample_rate], rows[:: parameters.sample_rate]
    return values, rows


def _error(found: str, expected: str, key: str, folder: Path) -> ConfigError:
    return ConfigError(
        found, expected=expected, fix=f"correct {key}, or turn it off", file=folder, key=key
    )
