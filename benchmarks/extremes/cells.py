"""One extreme on one integrator: run it as a user would, and say in closed words how it went.

Every cell takes the whole way: the experiment is saved to a folder, read again, checked, run into
``simulation.h5`` and read from there, so that a verdict covers what a user is told as well.
"""

from __future__ import annotations

import math
import re
import tempfile
import time
import traceback
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import h5py
import numpy as np

from openprc.demlat.integrators import INTEGRATORS
from openprc.demlat.planning.stability import step_limit
from openprc.errors import ConfigError, Diverged, OpenPRCError, UnsupportedScene
from openprc.hooks import run_experiment
from openprc.schema import Trajectory
from openprc.schema.experiment import Experiment, save_experiment

Kind = Literal["exact", "accurate", "inaccurate, told", "refused", "diverged, told", "SILENT"]

#: Errors up to this are rounding.
EXACT = 1e-9
#: Errors up to this are what a user expects of a run without a word.
TOLERANCE = 1e-2
#: Remarks that say nothing against a result.
INFORMATIVE = re.compile(
    r"backend '|\S+ took \d+ steps and rejected|dt = \S+ s was chosen|collision_radius is not given"
    r"|\d+ of \d+ rigid|signal '.*' ends at|no strain is stored"
)
#: Integrators of all columns; those after the bar are run in single precision.
COLUMNS = tuple(INTEGRATORS)
SINGLE = tuple(
    name
    for name, scheme in INTEGRATORS.items()
    if scheme.vectors and scheme.rigid == "no" and scheme.step != "legacy"
)


@dataclass(frozen=True)
class Way:
    """How a cell is run: integrator and precision of its state."""

    integrator: str
    precision: Literal["float64", "float32"] = "float64"

    @property
    def adaptive(self) -> bool:
        """Whether the integrator chooses its steps."""
        return INTEGRATORS[self.integrator].step == "adaptive"


WAYS = tuple(Way(name) for name in COLUMNS)
SINGLE_WAYS = tuple(Way(name, "float32") for name in SINGLE)


@dataclass(frozen=True, kw_only=True)
class Extreme:
    """A scene that is extreme in one respect, and how its result is judged.

    Attributes
    ----------
    name, level : str
        Of the row: what is extreme, and how far.
    build : callable
        Returns the experiment for a `Way`.
    judge : callable
        Returns the relative error of a finished run, or the violation of an invariant.
    measure : str
        What `judge` returns.
    tolerance : float
        Larger errors have to be told.
    quick : bool
        Whether the row belongs to the quick study.
    ways : tuple of Way
    told : str
        Pattern of the remark that tells of errors here; any remark that is not informative by
        default.
    """

    name: str
    level: str
    build: Callable[[Way], Experiment]
    judge: Callable[[Trajectory], float]
    measure: str
    tolerance: float = TOLERANCE
    quick: bool = True
    ways: tuple[Way, ...] = WAYS
    told: str = ""


@dataclass(frozen=True, kw_only=True)
class Cell:
    """How one extreme went on one integrator.

    Attributes
    ----------
    kind : str
        One of the closed words.
    error : float or None
        As the row's measure says; None where nothing was finished.
    at : float or None [s]
        Time at which a run was stopped.
    seconds : float
        Processor time, compiling left out where it was done before.
    messages : tuple of str
        What the user was told: remarks, or the error.
    """

    name: str
    level: str
    integrator: str
    precision: str
    kind: Kind
    error: float | None
    at: float | None
    seconds: float
    messages: tuple[str, ...]

    @property
    def text(self) -> str:
        """Return what stands in the table."""
        if self.kind == "accurate":
            return f"accurate {self.error:.0e}"
        if self.kind in ("inaccurate, told", "SILENT"):
            return self.kind if self.error is None else f"{self.kind} {self.error:.0e}"
        if self.kind == "diverged, told" and self.at is not None:
            return f"diverged, told at {self.at:.2g} s"
        return self.kind

    def as_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return asdict(self) | {"text": self.text, "messages": list(self.messages)}


def run_cell(extreme: Extreme, way: Way) -> Cell:
    """Run one cell through a folder, and judge it."""
    began = time.process_time()
    kind, error, at, messages = _outcome(extreme, way)
    return Cell(
        name=extreme.name,
        level=extreme.level,
        integrator=way.integrator,
        precision=way.precision,
        kind=kind,
        error=error,
        at=at,
        seconds=time.process_time() - began,
        messages=messages,
    )


def _outcome(
    extreme: Extreme, way: Way
) -> tuple[Kind, float | None, float | None, tuple[str, ...]]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            experiment = extreme.build(way)
            save_experiment(experiment, folder)
            path = run_experiment(folder).path
        except (UnsupportedScene, ConfigError) as error:
            return "refused", None, None, (_words(error),)
        except Diverged as error:
            return _stopped(error, folder)
        except OpenPRCError as error:
            return "SILENT", None, None, (f"{type(error).__name__}: {_words(error)}",)
        except Exception:  # noqa: BLE001 - a crash is a finding of this study
            return "SILENT", None, None, (traceback.format_exc(limit=-3),)
        with Trajectory(path) as run:
            remarks = tuple(r for r in run.provenance["notes"] if not INFORMATIVE.match(r))
            if run.status != "complete" or not all_finite(path):
                return "SILENT", math.nan, None, ("not finite", *remarks)
            error = float(extreme.judge(run))
        told = any(re.search(extreme.told, remark) for remark in remarks)
        if error <= EXACT:
            return "exact", error, None, remarks
        if error <= extreme.tolerance:
            return "accurate", error, None, remarks
        return ("inaccurate, told" if told else "SILENT"), error, None, remarks


def _words(error: OpenPRCError) -> str:
    return re.sub(r"/\S+/", "", f"{error.found}; expected {error.expected}; {error.fix}")


def _stopped(
    error: Diverged, folder: Path
) -> tuple[Kind, float | None, float | None, tuple[str, ...]]:
    """Judge a run that was stopped: what is left of it has to say so, and to be finite."""
    partial = folder / "output" / "simulation.h5.partial"
    found = re.search(r"t = (\S+) s", error.found)
    at = float(found.group(1)) if found else None
    if (folder / "output" / "simulation.h5").exists():
        return "SILENT", None, at, ("a diverged run left a result", _words(error))
    if not partial.exists():  # stopped before the first frame
        return "diverged, told", None, at, (_words(error),)
    with h5py.File(partial) as file:
        sound = file.attrs["status"] == "failed"
    if not sound or not all_finite(partial):
        return "SILENT", None, at, ("the partial file is not finite, or not failed", _words(error))
    return "diverged, told", None, at, (_words(error),)


def all_finite(path: Path) -> bool:
    """Say whether every number of every series of a file is finite.

    Reactions of redundant rigid elements are not determined, and NaN throughout; the file says so.
    """
    finite = True

    def look(name: str, item: Any) -> None:
        nonlocal finite
        if isinstance(item, h5py.Dataset) and item.dtype.kind == "f":
            values = item[()]
            if name.endswith(("/force", "/torque")):
                values = values[:, ~np.isnan(values).all(axis=0)]
            finite &= bool(np.isfinite(values).all())

    with h5py.File(path) as file:
        file["time_series"].visititems(look)
    return finite


def with_step(
    experiment: Experiment,
    way: Way,
    *,
    fraction: float = 0.25,
    slow: float,
    tolerance: float = 1e-9,
) -> Experiment:
    """Return the experiment with the integrator, and a step that suits it.

    Parameters
    ----------
    experiment : Experiment
    way : Way
    fraction : float
        Of the stability limit, for explicit schemes.
    slow : float [s]
        Of what the result depends on: no step is longer.
    tolerance : float
        Of integrators that choose their steps; in single precision at least 1e-5.
    """
    experiment = replace(
        experiment,
        integrator=way.integrator,
        precision=way.precision,
        dt=experiment.save_interval,
        step_check="warn",
    )
    if way.adaptive:
        least = 1e-5 if way.precision == "float32" else tolerance
        return replace(experiment, tolerance=least)
    like = "rk4" if way.integrator == "legacy" else way.integrator
    limit = step_limit(replace(experiment, integrator=like)).limit
    step = min(fraction * limit, slow)
    count = max(1, math.ceil(experiment.save_interval / step * (1.0 - 1e-12)))
    return replace(experiment, dt=experiment.save_interval / count)
