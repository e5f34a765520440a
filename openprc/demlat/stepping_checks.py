"""Which bodies can be stepped symbol by symbol, and what of them is an input."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from openprc.demlat.models.barhinge.support import supports
from openprc.demlat.planning.step_choice import refuse_open_step
from openprc.errors import ConfigError, UnsupportedScene
from openprc.schema.experiment import MULTIPLE_TOLERANCE, Signal, whole_multiple
from openprc.schema.experiment_checks import check_experiment

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment

#: Schemes that advance by a fixed step and carry nothing over that a new symbol would falsify, or
#: carry over a force that they can be told to renew.
STEPPED = ("rk4", "verlet", "pefrl", "respa", "midpoint")
#: Largest denominator of the shares of a symbol at which sensors are read.
FINEST = 1000


def input_names(experiment: Experiment, inputs: Sequence[str] | None) -> tuple[str, ...]:
    """Return the names of the signals that are decided at run time.

    Raises
    ------
    ConfigError
        When one is not used by an actuator, or there is none.
    """
    used = tuple(dict.fromkeys(actuator.signal for actuator in experiment.actuators))
    names = used if inputs is None else tuple(inputs)
    unknown = [name for name in names if name not in used]
    if unknown or not names or len(set(names)) < len(names):
        raise ConfigError(
            f"the inputs {list(names)}",
            expected="names of signals that an actuator uses, each once: "
            + (", ".join(used) or "there is none"),
            fix="add an actuator of type 'force' or 'position'",
            key="inputs",
        )
    return names


def refuse_what_cannot_be_stepped(experiment: Experiment, inputs: Sequence[str]) -> None:
    """Refuse scenes that cannot be continued symbol by symbol.

    Raises
    ------
    UnsupportedScene
    """
    refuse_open_step(experiment, where="a body that is stepped")
    geometry = experiment.geometry
    if experiment.collision.enabled and geometry.collidable.any():
        raise UnsupportedScene(
            "contact in a body that is stepped",
            expected="a body without contact, whose steps need not be taken back",
            fix="disable collision, or run the whole experiment",
            key="physics.enable_collision",
        )
    if geometry.bars.rigid.any() or geometry.hinges.rigid.any():
        raise UnsupportedScene(
            "rigid elements in a body that is stepped",
            expected="soft elements: inputs that jump would break constraints",
            fix="give them a large stiffness, or run the whole experiment",
            key="geometry",
        )
    if experiment.integrator not in STEPPED:
        raise UnsupportedScene(
            f"the integrator {experiment.integrator!r} in a body that is stepped",
            expected="one of " + ", ".join(STEPPED) + ": a fixed step and nothing that looks ahead",
            fix="use rk4 or verlet",
            key="simulation.integrator",
        )
    moved = [a for a in experiment.actuators if a.signal in inputs and a.type == "velocity"]
    if moved:
        raise UnsupportedScene(
            f"the input {moved[0].signal!r} prescribes a velocity",
            expected="forces or positions",
            fix="prescribe the position that the velocity leads to",
            key="inputs",
        )


def reading_frames(readings: int | Sequence[float]) -> tuple[int, list[int]]:
    """Return into how many frames a symbol is divided, and which of them are read.

    Raises
    ------
    ConfigError
        When the readings are no number of times, or no rising shares of a symbol.
    """
    if isinstance(readings, int) and not isinstance(readings, bool) and readings >= 1:
        return readings, list(range(readings))
    shares = np.asarray(readings, dtype=np.float64)
    rising = shares.ndim == 1 and shares.size > 0 and bool((np.diff(shares) > 0.0).all())
    if not rising or not (shares[0] > 0.0 and shares[-1] <= 1.0):
        raise ConfigError(
            f"readings={readings!r}",
            expected="a whole number from 1, or rising shares of a symbol in (0, 1]",
            key="readings",
        )
    parts = [Fraction(float(share)).limit_denominator(FINEST) for share in shares]
    if np.abs(np.array([float(part) for part in parts]) - shares).max() > MULTIPLE_TOLERANCE:
        raise ConfigError(
            f"readings={readings!r}",
            expected=f"shares with a denominator of at most {FINEST}",
            key="readings",
        )
    frames = math.lcm(*(part.denominator for part in parts))
    return frames, [int(part * frames) - 1 for part in parts]


def with_held_inputs(
    experiment: Experiment, inputs: Sequence[str], hold: float, frames: int
) -> Experiment:
    """Return the experiment with one sample, held, for each input, and frames for readings.

    Raises
    ------
    ConfigError
        When a symbol cannot be divided so into steps.
    """
    if not (np.isfinite(hold) and hold > 0.0):
        raise ConfigError(f"hold={hold!r}", expected="a time above 0 s", key="hold")
    if not whole_multiple(hold, frames * experiment.dt):
        raise ConfigError(
            f"symbols of {hold:g} s with {frames} frame(s) in steps of {experiment.dt:g} s",
            expected="a whole number of steps in a frame",
            fix=f"take another hold, or dt = {_near(hold / frames, experiment.dt):.6g} s",
            key="hold",
        )
    held = {
        name: Signal(
            name=name,
            values=experiment.signals[name].values[:1],
            dt=hold,
            interpolation="hold",
            unit=experiment.signals[name].unit,
        )
        for name in inputs
    }
    return replace(
        experiment,
        signals={**experiment.signals, **held},
        duration=hold,
        save_interval=hold / frames,
    )


def _near(frame: float, dt: float) -> float:
    """Return the largest step of at most `dt` that divides a frame."""
    return frame / math.ceil(frame / dt)


def check_supported(experiment: Experiment) -> None:
    """Refuse what is wrong, or what the engine cannot model.

    Raises
    ------
    ConfigError, UnsupportedScene
    """
    check_experiment(experiment)
    found = supports(experiment)
    if found:
        raise UnsupportedScene(
            found[0].found, expected=found[0].expected, fix=found[0].fix, key=found[0].path
        )
