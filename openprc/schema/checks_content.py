"""Checks of the numbers themselves: time, missing data, indices, inputs."""

from __future__ import annotations

from collections.abc import Iterator

import h5py
import numpy as np

from openprc.schema.digest import checksum
from openprc.schema.layout import CHECKSUM
from openprc.schema.timebase import UNIFORM_TOLERANCE, describe_time, max_deviation
from openprc.schema.units import UNITS
from openprc.schema.validate import Complaint, check
from openprc.schema.view import OBSERVED, POSITIONS, TIME, View

_PRODUCER = "correct the producer and make the file again"
#: A body that grows this many times beyond its first frame has hardly done so in earnest.
_ABSURD_GROWTH = 1e3


@check("OPS-T01", "error", "time is finite")
def finite_time(view: View) -> Iterator[Complaint]:
    """NaN and infinite instants."""
    bad = np.flatnonzero(~np.isfinite(view.time))
    if bad.size:
        yield TIME, f"{view.time[bad[0]]} at frame {bad[0]}", "finite numbers", _PRODUCER


@check("OPS-T02", "error", "time increases strictly")
def increasing_time(view: View) -> Iterator[Complaint]:
    """Instants that repeat or go back."""
    if not np.isfinite(view.time).all():
        return
    bad = np.flatnonzero(np.diff(view.time) <= 0)
    if bad.size:
        i = int(bad[0])
        yield (
            TIME,
            f"frame {i} is at {view.time[i]:g}, frame {i + 1} at {view.time[i + 1]:g}",
            "strictly increasing time",
            _PRODUCER,
        )


@check("OPS-T03", "error", "a claim of uniform time holds for every frame")
def uniform_claim(view: View) -> Iterator[Complaint]:
    """False claims of uniformity."""
    t0, dt = view.attribute(TIME, "t0"), view.attribute(TIME, "dt")
    numbers = isinstance(t0, int | float) and isinstance(dt, int | float)
    if view.attribute(TIME, "uniform") != 1 or not numbers or not view.time.size:
        return
    off = max_deviation(view.time, t0, dt)
    if not off <= UNIFORM_TOLERANCE:
        yield (
            TIME,
            f"a frame is {off:.3g} dt away from t0 + i dt (t0 = {t0!r}, dt = {dt!r})",
            f"at most {UNIFORM_TOLERANCE:g} dt",
            "set uniform to 0, or write exact instants",
        )


@check("OPS-T04", "hint", "evenly spaced frames are said to be so")
def unclaimed_uniformity(view: View) -> Iterator[Complaint]:
    """Uniform clocks that do not say so."""
    if view.attribute(TIME, "uniform") == 0 and np.isfinite(view.time).all():
        claim = describe_time(view.time)
        if claim["uniform"]:
            yield TIME, f"the frames are {claim['dt']!r} apart", "uniform = 1", "say so"


@check("OPS-T05", "error", "the unit of time fits its kind")
def time_unit(view: View) -> Iterator[Complaint]:
    """Seconds for physical time, plain numbers for load steps."""
    kind, unit = view.attribute(TIME, "kind"), view.attribute(TIME, "unit")
    wanted = {"physical": "time", "pseudo": "number"}.get(kind) if isinstance(kind, str) else None
    if wanted and unit in UNITS and UNITS[unit].dimension != wanted:
        yield TIME, f"{kind} time in {unit!r}", f"a unit of {wanted}", "correct kind or unit"


@check("OPS-T06", "warning", "there is more than one frame")
def several_frames(view: View) -> Iterator[Complaint]:
    """Snapshots."""
    if view.n_frames == 1:
        yield TIME, "a single frame", "a trajectory", "import the whole run, not a snapshot"


@check("OPS-N01", "error", "a NaN position is marked as missing")
def unmarked_gaps(view: View) -> Iterator[Complaint]:
    """NaN without a mask."""
    if view.dataset(POSITIONS) is None or OBSERVED in view.datasets:
        return
    found = view.statistics(POSITIONS)
    if found.first_nan is not None:
        yield (
            POSITIONS,
            f"{found.n_nan} NaN, first at frame {found.first_nan[0]}, node {found.first_nan[1]}",
            f"{OBSERVED} that marks them",
            "declare_nodes(observed=True)",
        )


@check("OPS-N02", "error", "positions are NaN exactly where the mask says missing")
def mask_agrees(view: View) -> Iterator[Complaint]:
    """Mask and NaN."""
    mask, positions = view.dataset(OBSERVED), view.dataset(POSITIONS)
    if mask is None or positions is None or positions.shape[:2] != mask.shape:
        return
    for start, rows in view.pieces(POSITIONS):
        nan = np.isnan(rows)
        missing = mask[start : start + len(rows)] == 0
        differs = (nan.any(axis=2) != missing) | (nan.all(axis=2) != missing)
        if differs.any():
            frame, node = (int(i) for i in np.argwhere(differs)[0])
            yield (
                OBSERVED,
                f"frame {start + frame}, node {node}: mask and NaN disagree",
                "NaN in all axes exactly where the mask is 0",
                _PRODUCER,
            )
            return


@check("OPS-N03", "error", "the mask holds 0, 1 or 2")
def mask_codes(view: View) -> Iterator[Complaint]:
    """Codes of the mask."""
    item = view.dataset(OBSERVED)
    if item is not None and item.size and int(item[()].max()) > 2:
        yield OBSERVED, f"a code of {int(item[()].max())}", "0, 1 or 2", _PRODUCER


@check("OPS-N04", "error", "nothing recorded is infinite")
def infinite(view: View) -> Iterator[Complaint]:
    """Infinite values."""
    for path, item in view.datasets.items():
        if path == TIME or not view.is_series(path) or item.dtype.kind != "f":
            continue
        found = view.statistics(path)
        if found.first_inf is not None:
            yield path, f"infinite at frame {found.first_inf[0]}", "finite numbers", _PRODUCER


@check("OPS-N05", "warning", "no axis is constant over all nodes and frames")
def padded_axis(view: View) -> Iterator[Complaint]:
    """Padded dimensions: they add states without variance."""
    if view.dataset(POSITIONS) is None or view.n_frames < 2:
        return
    found = view.statistics(POSITIONS)
    if found.low.ndim != 2 or found.low.shape[1] != 3 or found.low.shape[0] < 2:
        return
    low, high = found.low.min(axis=0), found.high.max(axis=0)
    for axis in np.flatnonzero(high == low):
        yield (
            POSITIONS,
            f"axis {axis} is {low[axis]:g} everywhere",
            "the dimensions that were measured",
            "store two dimensions",
        )


@check("OPS-N06", "error", "labels and ids of nodes are unique")
def unique_names(view: View) -> Iterator[Complaint]:
    """Duplicate labels and ids."""
    for name in ("label", "id"):
        path = f"/topology/nodes/{name}"
        item = view.dataset(path)
        if item is None:
            continue
        string = h5py.check_string_dtype(item.dtype) is not None
        values = [str(v) for v in (item.asstr()[()] if string else item[()])]
        doubles = (
            sorted({v for v in values if values.count(v) > 1})[:1]
            if (len(set(values)) < len(values))
            else []
        )
        for value in doubles:
            yield path, f"{value!r} twice", "unique values", "rename the nodes"


@check("OPS-N07", "error", "masses are not negative")
def masses(view: View) -> Iterator[Complaint]:
    """Negative and NaN masses."""
    item = view.dataset("/topology/nodes/mass")
    if item is not None and item.dtype.kind == "f" and not (item[()] >= 0).all():
        yield "/topology/nodes/mass", "a negative or NaN mass", "0 or more", _PRODUCER


@check("OPS-N08", "warning", "the body does not explode")
def exploded(view: View) -> Iterator[Complaint]:
    """Finite, absurd positions: a run that diverged without saying so."""
    item = view.dataset(POSITIONS)
    if item is None or item.ndim != 3 or view.n_frames < 2 or item.shape[1] < 2:
        return
    first = np.asarray(item[0], dtype="f8")
    if not np.isfinite(first).any():
        return
    # Points that are missing in the first frame say nothing about the size of the body.
    size = float(np.max(np.nanmax(first, axis=0) - np.nanmin(first, axis=0)))
    found = view.statistics(POSITIONS)
    reach = float(np.max(found.high.max(axis=0) - found.low.min(axis=0)))
    if size > 0 and reach > _ABSURD_GROWTH * size:
        yield (
            POSITIONS,
            f"the body is {size:g} across in the first frame and covers {reach:g} later",
            "motion of the size of the body",
            "check the time step of the simulation",
        )


@check("OPS-V01", "error", "recorded values match the checksum that was stored with them")
def checksums(view: View) -> Iterator[Complaint]:
    """Values that changed after the file was written."""
    for path in view.datasets:
        stored = view.attribute(path, CHECKSUM)
        if not isinstance(stored, int) or not view.is_series(path):
            continue
        found = 0
        for _, rows in view.pieces(path):
            found = checksum(rows, found)
        if found != stored:
            yield (
                path,
                f"the checksum of the values is {found}, {stored} was stored",
                "values as they were written",
                "copy the file again from where it was made",
            )


@check("OPS-E01", "error", "elements name existing nodes")
def index_range(view: View) -> Iterator[Complaint]:
    """Indices out of range."""
    for path, item in _indices(view):
        table = item[()]
        if not table.size or not view.n_nodes:
            continue
        low, high = int(table.min()), int(table.max())
        if low < 0 or high >= view.n_nodes:
            worst = low if low < 0 else high
            yield path, f"node {worst}", f"0 to {view.n_nodes - 1}", "count nodes from 0"


@check("OPS-E02", "error", "no element names a node twice")
def degenerate(view: View) -> Iterator[Complaint]:
    """Elements that use a node twice."""
    for path, item in _indices(view):
        table = np.sort(item[()], axis=1)
        bad = np.flatnonzero((np.diff(table, axis=1) == 0).any(axis=1))
        if bad.size:
            yield (
                path,
                f"element {bad[0]} is {item[int(bad[0])].tolist()}",
                "different nodes",
                ("remove it"),
            )


@check("OPS-E03", "warning", "no two elements join the same nodes")
def duplicates(view: View) -> Iterator[Complaint]:
    """Duplicate elements: states that are copies of each other."""
    for path, item in _indices(view):
        table = np.sort(item[()], axis=1)
        unique = len(np.unique(table, axis=0)) if table.size else len(table)
        if unique < len(table):
            yield path, f"{len(table) - unique} duplicates", "each once", "remove the copies"


@check("OPS-C01", "warning", "channels and elements have no gaps")
def sensor_gaps(view: View) -> Iterator[Complaint]:
    """NaN in channels and elements."""
    for path, item in view.datasets.items():
        if not path.startswith(("/time_series/channels/", "/time_series/elements/")):
            continue
        if view.is_series(path) and item.dtype.kind == "f":
            found = view.statistics(path)
            if found.first_nan is not None:
                yield (
                    path,
                    f"{found.n_nan} NaN, the first at frame {found.first_nan[0]}",
                    "numbers",
                    "readouts refuse NaN: drop or interpolate the frames explicitly",
                )


@check("OPS-I01", "error", "inputs are numbers")
def input_gaps(view: View) -> Iterator[Complaint]:
    """NaN in inputs."""
    for path, item in view.datasets.items():
        if path.startswith("/inputs/") and item.dtype.kind == "f" and item.ndim == 2:
            found = view.statistics(path)
            if found.first_nan is not None or found.first_inf is not None:
                yield path, "NaN or infinite values", "numbers", _PRODUCER


@check("OPS-I02", "error", "symbols are held for a positive time")
def holds(view: View) -> Iterator[Complaint]:
    """Hold of symbol sequences."""
    for path in view.datasets:
        if path.startswith("/inputs/") and path.endswith("/sequence"):
            hold = view.attribute(path, "hold")
            if isinstance(hold, int | float) and not hold > 0:
                yield path, f"hold is {hold!r}", "a time above 0", _PRODUCER


@check("OPS-I03", "warning", "an input that is recorded varies")
def constant_input(view: View) -> Iterator[Complaint]:
    """Inputs without variation."""
    for path, item in view.datasets.items():
        if not (path.startswith("/inputs/") and path.endswith("/value")) or item.ndim != 2:
            continue
        found = view.statistics(path)
        if view.n_frames > 1 and (found.low == found.high).all():
            yield path, "constant", "a signal that drives the body", "check the wiring"


@check("OPS-I04", "hint", "the file says what drove the body")
def no_input(view: View) -> Iterator[Complaint]:
    """Files without inputs: tasks that need one will ask for it."""
    if view.attribute(TIME, "kind") == "physical" and not view.children("/inputs"):
        yield "/inputs", "no input", "what drove the body", "add it with `openprc attach-input`"


def _indices(view: View) -> Iterator[tuple[str, h5py.Dataset]]:
    for path, item in view.datasets.items():
        if path.startswith("/topology/") and path.endswith("/indices") and item.ndim == 2:
            yield path, item
