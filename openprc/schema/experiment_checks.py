"""Checks of an experiment: each finds all mistakes of its kind and says where they are."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from openprc.schema.experiment import (
    ACTUATOR_TYPES,
    ACTUATOR_UNITS,
    AUTO,
    BAR_DAMPINGS,
    INTERPOLATIONS,
    PRECISIONS,
    STEP_CHECKS,
    Experiment,
    Signal,
    whole_multiple,
)
from openprc.schema.geometry_checks import check_geometry
from openprc.schema.mistakes import Mistakes, list_some
from openprc.schema.units import UNITS

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: The names that an input of simulation.h5 may have.
_SIGNAL_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.\- ]*\Z")


def check_experiment(
    experiment: Experiment,
    *,
    geometry_file: str | Path | None = None,
    signals_file: str | Path | None = None,
    config_file: str | Path | None = None,
) -> None:
    """Check everything that can be checked without a simulator.

    Raises
    ------
    ConfigError
        For the first of geometry, signals and settings that has mistakes, with all of them.
    """
    geometry = Mistakes(geometry_file)
    check_geometry(experiment.geometry, geometry, driven=_wholly_driven(experiment))
    geometry.raise_if_any()
    signals = Mistakes(signals_file)
    for name, signal in experiment.signals.items():
        check_signal(name, signal, signals)
    signals.raise_if_any()
    settings = Mistakes(config_file)
    check_times(experiment, settings)
    check_actuators(experiment, settings)
    settings.raise_if_any()


def _wholly_driven(experiment: Experiment) -> NDArray[np.bool_]:
    axes = np.zeros((experiment.geometry.n_nodes, 3), dtype=bool)
    for actuator in experiment.actuators:
        if actuator.type == "position" and 0 <= actuator.node < len(axes):
            axes[actuator.node] |= np.array(actuator.axes)
    whole: NDArray[np.bool_] = np.logical_and.reduce(axes, axis=1)
    return whole


def check_signal(name: str, signal: Signal, mistakes: Mistakes) -> None:
    """Check one signal."""
    key = f"signals/{name}"
    if not _SIGNAL_NAME.match(name):
        mistakes.add(key, f"the name {name!r}", expected="letters, digits, '_', '-', '.' or ' '")
    if not (np.isfinite(signal.dt) and signal.dt > 0):
        mistakes.add(f"{key}@dt", f"{signal.dt}", expected="a time step above 0 s")
    if signal.interpolation not in INTERPOLATIONS:
        mistakes.add(
            f"{key}@interpolation",
            repr(signal.interpolation),
            expected="one of " + ", ".join(INTERPOLATIONS),
        )
    if signal.unit is not None and signal.unit not in UNITS:
        mistakes.add(f"{key}@unit", repr(signal.unit), expected="one of " + " ".join(UNITS))
    if (signal.sequence is None) != (signal.hold is None):
        mistakes.add(
            f"{key}@hold",
            "a sequence without hold" if signal.hold is None else "hold without a sequence",
            expected="both, or none",
        )
    elif signal.sequence is not None and signal.hold is not None:
        if not (np.isfinite(signal.hold) and signal.hold > 0):
            mistakes.add(f"{key}@hold", f"{signal.hold}", expected="a time above 0 s")
        if signal.sequence.ndim != 2 or not np.isfinite(signal.sequence).all():
            mistakes.add(
                f"sequences/{name}",
                f"shape {signal.sequence.shape}, or numbers that are not finite",
                expected="finite numbers (K, C)",
            )
    values = signal.values
    if values.ndim != 2 or values.shape[1] not in (1, 3):
        mistakes.add(
            key,
            f"shape {values.shape}",
            expected="(T,) or (T, 1) for all enabled axes, or (T, 3) for x, y, z",
        )
        return
    least = 4 if signal.interpolation == "cubic" else 1
    if len(values) < least:
        mistakes.add(key, f"{len(values)} samples", expected=f"at least {least}")
    bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if len(bad):
        mistakes.add(key, f"NaN or infinity at sample {list_some(bad)}", expected="finite numbers")


def check_times(experiment: Experiment, mistakes: Mistakes) -> None:
    """Check duration, save interval and time step against each other."""
    times = {name: getattr(experiment, name) for name in ("duration", "save_interval", "dt")}
    for name, value in times.items():
        if not np.isfinite(value) or value < 0 or (value == 0 and name != "duration"):
            mistakes.add(f"simulation.{name}", f"{value}", expected="a time above 0 s")
    if mistakes.found:
        return
    for name, part in (("save_interval", "dt"), ("duration", "save_interval")):
        count = whole_multiple(times[name], times[part])
        if count is None or (count == 0 and name == "save_interval"):
            nearest = max(round(times[name] / times[part]), 1) * times[part]
            mistakes.add(
                f"simulation.{name}",
                f"{times[name]:g} s is {times[name] / times[part]:.6g} times {part}"
                f" = {times[part]:g} s",
                expected=f"a whole multiple, such as {nearest:.12g} s",
            )
    for name, value in (("gravity", np.array(experiment.gravity)), ("damping", experiment.damping)):
        if not np.isfinite(value).all():
            mistakes.add(f"physics.{name}", f"{value}", expected="finite numbers")
    for key, value, known in (
        ("physics.bar_damping", experiment.bar_damping, BAR_DAMPINGS),
        ("simulation.precision", experiment.precision, PRECISIONS),
        ("export.precision", experiment.stored.precision, PRECISIONS),
        ("simulation.step_check", experiment.step_check, STEP_CHECKS),
    ):
        if value not in known:
            mistakes.add(key, repr(value), expected="one of " + ", ".join(known))
    for name in ("tolerance", "constraint_tolerance"):
        value = getattr(experiment, name)
        if value is not None and not (np.isfinite(value) and value > 0):
            mistakes.add(f"simulation.{name}", f"{value}", expected="a number above 0")
    check_accuracy(experiment, mistakes)
    if experiment.damping < 0:
        mistakes.add("physics.damping", f"{experiment.damping}", expected="0 or more")


def check_accuracy(experiment: Experiment, mistakes: Mistakes) -> None:
    """Check that whatever is left to accuracy has one."""
    accuracy = experiment.accuracy
    if accuracy is not None:
        if not 0.0 < accuracy < 1.0:
            mistakes.add(
                "simulation.accuracy",
                f"{accuracy}",
                expected="a share of the displacement, above 0 and below 1, such as 1e-4",
            )
        return
    for key, open_, what in (
        ("simulation.integrator", experiment.integrator == AUTO, f"the integrator {AUTO!r}"),
        ("simulation.dt", not experiment.dt_stated, "no time step"),
    ):
        if open_:
            mistakes.add(
                key, what, expected="one, or simulation.accuracy, which chooses it", fix="give one"
            )


def check_actuators(experiment: Experiment, mistakes: Mistakes) -> None:
    """Check that every actuator finds its node and a fitting signal."""
    taken: dict[tuple[int, int, str], int] = {}
    for number, actuator in enumerate(experiment.actuators):
        key = f"actuators[{number}]"
        if actuator.type not in ACTUATOR_TYPES:
            mistakes.add(
                f"{key}.type", repr(actuator.type), expected="one of " + ", ".join(ACTUATOR_TYPES)
            )
            continue
        n_nodes = experiment.geometry.n_nodes
        if not 0 <= actuator.node < n_nodes:
            mistakes.add(
                f"{key}.node", f"{actuator.node}", expected=f"a node from 0 to {n_nodes - 1}"
            )
            continue
        signal = experiment.signals.get(actuator.signal)
        if signal is None:
            close = difflib.get_close_matches(actuator.signal, experiment.signals, n=1)
            mistakes.add(
                f"{key}.signal",
                f"no signal is named {actuator.signal!r}",
                expected="one of " + (", ".join(map(repr, experiment.signals)) or "(no signals)"),
                fix=f"did you mean {close[0]!r}?" if close else "add the signal",
            )
            continue
        wanted = ACTUATOR_UNITS[actuator.type]
        if signal.unit is not None and UNITS[signal.unit].dimension != UNITS[wanted].dimension:
            mistakes.add(
                f"{key}.type",
                f"{actuator.type!r} with signal {actuator.signal!r}, which is in {signal.unit!r}",
                expected=f"a signal in {wanted!r}",
            )
        if not any(actuator.axes):
            mistakes.add(f"{key}.axes", "no axis is enabled", expected="at least one")
        if actuator.type == "force":
            continue
        if experiment.geometry.fixed[actuator.node]:
            mistakes.add(
                f"{key}.node",
                f"node {actuator.node} is fixed and has a {actuator.type} actuator",
                expected="one or the other",
                fix="do not fix the node; axes that are not driven stay free",
            )
        for axis in _enabled(actuator.axes):
            # Position and velocity both prescribe the motion, so they exclude each other too.
            other = taken.setdefault((actuator.node, axis, "motion"), number)
            if other != number:
                mistakes.add(
                    f"{key}.node",
                    f"the {'xyz'[axis]} motion of node {actuator.node} is already prescribed"
                    f" by actuators[{other}]",
                    expected="one position or velocity actuator on an axis",
                )


def _enabled(axes: tuple[bool, bool, bool]) -> Iterator[int]:
    return (axis for axis in range(3) if axes[axis])
