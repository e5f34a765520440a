"""VALUE: numbers equal a motion that is known in closed form."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from openprc.errors import OpenPRCError
from openprc.schema.trajectory import Trajectory
from openprc.testing.cases import ImporterCase, RecorderCase
from openprc.testing.check import check
from openprc.testing.diagnosis import deviation, explain
from openprc.testing.outcome import NotApplicable, fail
from openprc.testing.recordings import recorded
from openprc.testing.workbench import imported

#: Largest deviation, relative to the spread, unless the truth says otherwise.
TOLERANCE = 1e-9

Subject = ImporterCase | RecorderCase


def _truth(case: Subject, *keys: str) -> Mapping[str, Any]:
    truth = case.truth() if case.truth else {}
    if not any(key in truth for key in keys):
        raise NotApplicable(f"the case states no truth for {' or '.join(keys)}")
    return truth


def _file(case: Subject) -> Path:
    return imported(case) if isinstance(case, ImporterCase) else recorded(case)


def _tolerance(truth: Mapping[str, Any], name: str) -> float:
    given = truth.get("tolerance", TOLERANCE)
    return float(given.get(name, TOLERANCE) if isinstance(given, Mapping) else given)


def _compare(name: str, found: Any, truth: Any, tolerance: float) -> None:
    one, two = np.asarray(found, np.float64), np.asarray(truth, np.float64)
    if one.ndim == 2 and two.ndim == 1:
        two = two[:, np.newaxis]
    if one.shape != two.shape:
        why = explain(one, two, tolerance=tolerance)
        fail(
            f"{name} have the shape {one.shape}{'; ' if why else ''}{why}",
            expected=f"{two.shape}",
            fix="look at the order of axes and the number of frames",
        )
    off = deviation(one, two)
    if off <= tolerance:
        return
    why = explain(one, two, tolerance=tolerance)
    at = np.unravel_index(int(np.nanargmax(np.abs(one - two))), one.shape)
    place = ", ".join(str(int(i)) for i in at)
    fail(
        f"{name} deviate by {off:.3g} of their spread, most at [{place}]: {one[at]:.9g}"
        f"{'; ' if why else ''}{why}",
        expected=f"{two[at]:.9g}, within {tolerance:.3g}",
        fix="correct what the reader makes of the file"
        if why
        else "compare the file with the closed form, frame by frame",
    )


@check("VALUE-1", "positions and velocities equal the closed form", "importer", "recorder")
def positions_are_right(case: Subject, folder: Path) -> None:
    """Compare node by node, in the unit of the truth."""
    del folder
    truth = _truth(case, "positions", "velocities")
    with Trajectory(_file(case)) as run:
        if "positions" in truth:
            found = run.positions(unit=truth.get("unit"))
            _compare("positions", found, truth["positions"], _tolerance(truth, "positions"))
        if "velocities" in truth:
            _compare("velocities", run.velocities(), truth["velocities"],
                     _tolerance(truth, "velocities"))  # fmt: skip


@check("VALUE-2", "times equal the closed form", "importer", "recorder")
def times_are_right(case: Subject, folder: Path) -> None:
    """Compare the clock of the file."""
    del folder
    truth = _truth(case, "time")
    with Trajectory(_file(case)) as run:
        _compare("times", run.time, truth["time"], _tolerance(truth, "time"))


def _each(
    what: str, wanted: Mapping[Any, Any], get: Callable[[Any], Any], tolerance: float
) -> None:
    for name, values in wanted.items():
        try:
            found = get(name)
        except OpenPRCError as error:
            fail(
                f"there is no {what} {name!r}: {error.found}",
                expected=error.expected,
                fix="declare and append it",
            )
        if found is None:
            fail(
                f"the {what} {name!r} holds no symbols",
                expected="the sequence and its hold",
                fix="pass sequence= and hold= to writer.declare_input()",
            )
        _compare(f"values of the {what} {name!r}", found, values, tolerance)


@check("VALUE-3", "inputs, on the clock of the file and as symbols, equal the closed form",
       "importer", "recorder")  # fmt: skip
def inputs_are_right(case: Subject, folder: Path) -> None:
    """Compare every input that the truth names."""
    del folder
    truth = _truth(case, "inputs", "sequences")
    tolerance = _tolerance(truth, "inputs")
    with Trajectory(_file(case)) as run:
        _each("input", truth.get("inputs", {}), lambda name: run.input(name).value, tolerance)
        _each("input", truth.get("sequences", {}), lambda name: run.input(name).sequence,
              tolerance)  # fmt: skip


@check("VALUE-4", "channels and quantities of elements equal the closed form",
       "importer", "recorder")  # fmt: skip
def readings_are_right(case: Subject, folder: Path) -> None:
    """Compare every channel, and every quantity of elements, that the truth names."""
    del folder
    truth = _truth(case, "channels", "elements")
    with Trajectory(_file(case)) as run:
        _each("channel", truth.get("channels", {}), run.channel, _tolerance(truth, "channels"))
        _each("quantity", truth.get("elements", {}), lambda pair: run.element(*pair),
              _tolerance(truth, "elements"))  # fmt: skip


__all__ = ["TOLERANCE"]
