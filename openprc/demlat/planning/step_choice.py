"""Choosing the time step of an experiment."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from openprc.demlat.integrators import find_integrator
from openprc.demlat.planning.stability import step_limit
from openprc.errors import ConfigError, UnsupportedScene
from openprc.schema.experiment_checks import check_experiment

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment


def refuse_open_step(experiment: Experiment, *, where: str) -> None:
    """Refuse an experiment whose step is left to an accuracy.

    Raises
    ------
    UnsupportedScene
    """
    if experiment.accuracy is not None:
        raise UnsupportedScene(
            f"an accuracy of {experiment.accuracy:g} in {where}, where no pilot can be run",
            expected="an integrator and a dt",
            fix="choose them on one typical scene with"
            " openprc.demlat.planning.accuracy.settled(scene, only=('rk4', 'verlet')), and take"
            " its integrator and dt",
            file=experiment.path,
            key="simulation.accuracy",
        )


def with_chosen_step(experiment: Experiment) -> Experiment:
    """Return the experiment with the largest recommended step that divides `save_interval`.

    Its notes say which step that is, and what sets it. An experiment in which nothing is stiff
    takes one step a frame.

    Parameters
    ----------
    experiment : Experiment
        Whose `dt` is only a placeholder that divides `save_interval`.

    Raises
    ------
    ConfigError
        When the experiment is wrong, its integrator is not known, or reproduces old runs.
    """
    check_experiment(experiment)
    if find_integrator(experiment.integrator).step == "legacy":
        raise ConfigError(
            f"dt='auto' with the integrator {experiment.integrator!r}",
            expected="the step of the run that is to be reproduced",
            key="simulation.dt",
        )
    limit = step_limit(experiment)
    n_steps = max(1, math.ceil(experiment.save_interval / limit.recommended * (1.0 - 1e-12)))
    dt = experiment.save_interval / n_steps
    why = "nothing bounds it"
    if limit.culprit is not None and math.isfinite(limit.limit):
        why = f"{limit.culprit.text} sets the stability limit, {limit.limit:.4g} s"
    elif find_integrator(experiment.integrator).step == "adaptive":
        why = f"{experiment.integrator} chooses its steps itself; this is the first"
    note = f"dt = {dt:.6g} s was chosen, {n_steps} steps a frame: {why}"
    return replace(experiment, dt=dt, notes=(*experiment.notes, note))
