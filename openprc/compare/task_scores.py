"""What a run computes, in a few figures: the same tasks, rows and readout for every run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.analysis.benchmarks.choices import Choices, choose_input, open_trainer
from openprc.analysis.benchmarks.standard_suite import delays_for, scale_to_narma, volterra_task
from openprc.analysis.capacity.capacities import Capacities
from openprc.analysis.capacity.measurement import measure
from openprc.analysis.capacity.settings import Settings
from openprc.analysis.capacity.terms import Terms
from openprc.analysis.tasks.narma import NarmaTask
from openprc.analysis.tasks.task import ImitationTask
from openprc.errors import (
    MissingData,
    MissingInputError,
    NonUniformTime,
    OpenPRCError,
    TaskError,
)
from openprc.reservoir.features.base import Feature, is_constant
from openprc.reservoir.io.whiteness import effective_samples
from openprc.reservoir.training.row_split import RowSplit
from openprc.reservoir.training.trainer import Trainer

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.scenes.scene import Scene

    Reals = NDArray[np.float64]

ORDERS = (2, 10)
#: Capacities, by the names of `TaskScores.figures`.
CAPACITIES = ("memory_capacity", "ipc")
FIGURES = (*(f"narma{order}_nrmse" for order in ORDERS), "volterra2_nrmse", *CAPACITIES)
#: Test rows below which an error says nothing.
FEWEST = 30
#: What a run may lack; anything else that is wrong with a file is raised.
LACKING = (MissingData, MissingInputError, NonUniformTime, TaskError)


@dataclass(frozen=True, kw_only=True)
class TaskScores:
    """What a run scored, and why it did not score the rest.

    Parameters
    ----------
    figures : mapping of str to float
        ``narma2_nrmse``, ``narma10_nrmse``, ``volterra2_nrmse``: sqrt(mean squared error) over
        the standard deviation of the target, on test rows. ``memory_capacity``: sum above
        threshold over the delays from 1 on; ``ipc``: information processing capacity, delay 0
        and products up to degree 3 included.
    skipped : mapping of str to str
        Figure to reason.
    notes : tuple of str
        What a reader of the figures should know.
    settings : mapping
        Features, input, clock, rows: how the figures were come by.
    """

    figures: Mapping[str, float]
    skipped: Mapping[str, str]
    notes: tuple[str, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        return {
            "figures": dict(self.figures),
            "skipped": dict(self.skipped),
            "notes": list(self.notes),
            "settings": dict(self.settings),
        }


def task_scores(
    path: str | Path, *, scene: Scene | None = None, choices: Choices | None = None
) -> TaskScores:
    """Score a run on the standard tasks; nothing is random, and nothing is written.

    Parameters
    ----------
    path : path-like
        A simulation.h5.
    scene : Scene, optional
        Names the input and the features, unless `choices` do.
    choices : Choices, optional
        States, readout, clock, spans; by default as in `openprc characterise`.

    Raises
    ------
    OpenPRCError
        When the file cannot be read. A run that lacks an input, moving states, physical time
        or rows is no error: `TaskScores.skipped` says so.
    """
    if scene is not None and scene.input_name is None and choices is None:
        reason = f"nothing drives the scene {scene.name} at random"
        return TaskScores(figures={}, skipped=dict.fromkeys(FIGURES, reason))
    choices = choices_for(scene, choices or Choices())
    try:
        with open_trainer(path, choices) as trainer:
            trainer.loader.require_physical_time("a task")
            trainer.loader.input_name(choices.split.input_name or 0)
            chosen = choose_input(trainer, choices.input_column)
            found = trainer_scores(trainer, chosen.values)
            return replace(
                found,
                settings={
                    **found.settings,
                    "input": f"{chosen.name}/{chosen.column}",
                    "features": repr(trainer.features),
                    "readout": repr(trainer.readout),
                },
            )
    except LACKING as problem:
        return TaskScores(figures={}, skipped=dict.fromkeys(FIGURES, reason_of(problem)))


def reason_of(problem: OpenPRCError) -> str:
    """Return what was found, with the place in the file where there is one."""
    inside = problem.key if problem.key and problem.key.startswith("/") else ""
    return f"{inside}: {problem.found}" if inside else problem.found


def trainer_scores(trainer: Trainer, u: Reals) -> TaskScores:
    """Score what a trainer is set up for.

    Parameters
    ----------
    u : (R,)
        The input, on the rows of the trainer.

    Raises
    ------
    TaskError, MissingData
        When the rows or the states are not there.
    """
    check_rows(trainer, u)
    figures: dict[str, float] = {}
    skipped: dict[str, str] = {}
    notes: list[str] = []
    for name, task, given in standard_tasks(u, step=trainer.rows.step):
        try:
            figures[name] = float(np.sqrt(imitation_nmse(trainer, task, given)))
        except TaskError as problem:
            skipped[name] = reason_of(problem)
    try:
        states = trainer.states
        found = capacities(states.values, u, split=trainer.split, usable=states.usable)
    except TaskError as problem:
        skipped |= dict.fromkeys(CAPACITIES, reason_of(problem))
    else:
        figures |= {"memory_capacity": found.memory_capacity, "ipc": found.total}
        notes += found.warnings
    if trainer.rows.kind == "frames":
        notes.append(
            "rows are frames: what a task asks to be remembered is a few frames ago; a file that "
            "stores the symbols of its input is scored symbol by symbol"
        )
    settings = {
        "clock": trainer.rows.kind,
        "row_step": trainer.rows.step,
        "n_states": trainer.states.values.shape[1],
        **{f"{name}_rows": rows for name, rows in trainer.split.spans.items()},
    }
    return TaskScores(figures=figures, skipped=skipped, notes=tuple(notes), settings=settings)


def choices_for(scene: Scene | None, choices: Choices) -> Choices:
    """Return choices with what a scene says about its input and its features filled in."""
    if scene is None:
        return choices
    if choices.features is None and scene.features is not None:
        choices = replace(choices, features=named_feature(scene.features))
    if choices.split.input_name is None and scene.input_name is not None:
        choices = replace(choices, split=replace(choices.split, input_name=scene.input_name))
    return choices


def named_feature(name: str) -> Feature:
    """Return a registered feature with its default settings.

    Raises
    ------
    OpenPRCError
        When there is none of that name.
    """
    from openprc.hooks.registry import default_registry  # noqa: PLC0415 - only for scenes

    registry = default_registry()
    feature: Feature = registry.load(registry.find("openprc_features", name))()
    return feature


def standard_tasks(u: Reals, *, step: float) -> Iterator[tuple[str, ImitationTask, Reals]]:
    """Yield figure, task and the input (R,) that the task is computed from.

    Parameters
    ----------
    u : (R,)
    step : float [s]
        Time between rows.
    """
    scaled = scale_to_narma(u)
    for order in ORDERS:
        yield f"narma{order}_nrmse", NarmaTask(order), scaled
    volterra = volterra_task(step)
    yield f"{volterra.name}_nrmse", volterra, u


def imitation_nmse(trainer: Trainer, task: ImitationTask, u: Reals) -> float:
    """Return the NMSE of a task on the test rows, without what the input alone would score.

    Parameters
    ----------
    u : (R,)
        On the rows of the trainer, in the range that the task is defined for.

    Raises
    ------
    TaskError
        When the task is not defined on this input.
    """
    series = task.target(u)
    usable = series.usable
    return float(trainer.train(series.for_rows(usable), task.name, usable=usable).nmse)


def state_nmse(
    states: Reals, u: Reals, *, task: ImitationTask, split: RowSplit, readout: Any
) -> float:
    """Return the NMSE of a task for states that are in memory: the sum that files are scored by.

    Rows are standardised by the training rows before they meet the readout.

    Parameters
    ----------
    states : (R, F)
        Row k has seen ``u[k]``.
    u : (R,)
        In the range that the task is defined for.
    split : RowSplit
    readout : estimator
        Such as `openprc.reservoir.LeastSquares` or `openprc.reservoir.Ridge`.

    Raises
    ------
    TaskError
        When the task is not defined on this input, or the split does not fit.
    """
    from openprc.reservoir.training.evaluation import evaluate  # noqa: PLC0415 - scikit-learn

    series = task.target(u)
    usable = series.usable
    target = series.for_rows(usable)
    return evaluate(readout, states, target, split=split, usable=usable).mean_nmse


def capacities(
    states: Reals,
    u: Reals,
    *,
    split: RowSplit,
    usable: NDArray[np.bool_] | None = None,
    delays: Mapping[int, int] | None = None,
    **settings: Any,
) -> Capacities:
    """Return the capacities of polynomials of past inputs, up to degree 3.

    Parameters
    ----------
    states : (R, F)
    u : (R,)
    usable : (R,) bool, optional
        Rows that were measured completely.
    delays : mapping, optional
        Largest delay for each degree; by default from how many rows there are.
    **settings
        Of `openprc.analysis.capacity.settings.Settings`.

    Raises
    ------
    TaskError
        When the input is not independent from row to row, so that capacities would be its own;
        when targets need more rows than there are, or states leave none to tell chance from.
    """
    terms = Terms.within(delays or delays_for(split), n_inputs=1, delay_step=1)
    chosen = Settings(**{"coloured": "refuse", **settings})
    found = measure(states, u, terms, settings=chosen, split=split, usable=usable)
    if chosen.estimator == "insample" and 2 * found.rank > found.n_rows:
        raise TaskError(
            f"{found.n_rows} rows for {found.rank} independent states",
            expected=f"at least {2 * found.rank} rows: with fewer, chance fills the states",
            fix="drive the body with more symbols, or choose fewer features",
            key="rows",
        )
    return found


def check_rows(trainer: Trainer, u: Reals) -> None:
    """Refuse a trainer with too few rows or an input of too few values, or states at rest.

    Raises
    ------
    TaskError
    """
    train, test = trainer.split.train, trainer.split.test
    if test < FEWEST or train < FEWEST:
        raise TaskError(
            f"{train} rows to train on and {test} to test on ({trainer.rows.kind})",
            expected=f"at least {FEWEST} of each",
            fix="drive the body with more symbols, or shorten the washout",
            key="rows",
        )
    count = effective_samples(u)
    if count < FEWEST:
        raise TaskError(
            f"the {len(u)} values of the input count as about {count:.0f} independent ones",
            expected=f"at least {FEWEST}: a slow path is no random drive",
            fix="drive the body with random symbols, or for longer",
            key="u",
        )
    rows = trainer.states.values[trainer.split.train_rows]
    if is_constant(rows).all():
        raise TaskError(
            f"none of the {rows.shape[1]} states changes on the training rows",
            expected="states that change",
            fix="check that the drive reaches the body",
            key="states",
        )
