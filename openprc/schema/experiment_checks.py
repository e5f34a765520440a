"""Checks of an experiment: each finds all mistakes of its kind and says where they are."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from openprc.errors import ConfigError
from openprc.schema.experiment import (
    ACTUATOR_TYPES,
    ACTUATOR_UNITS,
    INTERPOLATIONS,
    Bars,
    Experiment,
    Geometry,
    Hinges,
    Signal,
    whole_multiple,
)
from openprc.schema.units import UNITS

if TYPE_CHECKING:
    from numpy.typing import NDArray

SHOWN = 5
#: The names that an input of simulation.h5 may have.
_SIGNAL_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.\- ]*\Z")


@dataclass
class Mistakes:
    """Collects mistakes of one file and raises them together."""

    file: str | Path | None = None
    found: list[tuple[str, str, str, str]] = field(default_factory=list)

    def add(self, key: str, found: str, *, expected: str, fix: str = "") -> None:
        """Remember one mistake."""
        self.found.append((key, found, expected, fix))

    def raise_if_any(self) -> None:
        """Raise one `ConfigError` for everything that was added."""
        if not self.found:
            return
        if len(self.found) == 1:
            key, found, expected, fix = self.found[0]
            raise ConfigError(found, expected=expected, fix=fix, file=self.file, key=key)
        lines = "".join(
            f"\n  - {key}: {found}; expected {expected}" + (f" ({fix})" if fix else "")
            for key, found, expected, fix in self.found
        )
        raise ConfigError(
            f"{len(self.found)} mistakes{lines}",
            expected="none",
            fix="correct every one named above",
            file=self.file,
            key=", ".join(dict.fromkeys(key for key, *_ in self.found)),
        )


def list_some(numbers: NDArray[np.integer] | list[int]) -> str:
    """Return the first few of `numbers` as text."""
    shown = ", ".join(str(int(number)) for number in numbers[:SHOWN])
    return shown + (f", ... ({len(numbers)} in all)" if len(numbers) > SHOWN else "")


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


def check_geometry(
    geometry: Geometry, mistakes: Mistakes, *, driven: NDArray[np.bool_] | None = None
) -> None:
    """Check nodes, bars, hinges and faces.

    Parameters
    ----------
    driven : (N,) bool, optional
        Nodes whose position is prescribed on all axes; like fixed nodes they may have no mass.
    """
    if not _check_nodes(geometry, mistakes, driven):
        return
    n_nodes = geometry.n_nodes
    if _check_columns("elements/bars", geometry.bars, 2, _BAR_COLUMNS, mistakes):
        _check_bars(geometry.bars, geometry, mistakes)
    if _check_columns("elements/hinges", geometry.hinges, 4, _HINGE_COLUMNS, mistakes):
        _check_indices("elements/hinges", geometry.hinges.indices, n_nodes, mistakes)
        for key in ("stiffness", "damping"):
            _check_not_negative(f"elements/hinges/{key}", getattr(geometry.hinges, key), mistakes)
    faces = geometry.faces
    if faces.ndim != 2 or faces.shape[1] != 3:
        mistakes.add("elements/faces/indices", f"shape {faces.shape}", expected="(F, 3)")
    else:
        _check_indices("elements/faces", faces, n_nodes, mistakes)


_BAR_COLUMNS = ("stiffness", "rest_length", "damping", "prestress", "rigid")
_HINGE_COLUMNS = ("stiffness", "rest_angle", "damping", "rigid")


def _check_nodes(geometry: Geometry, mistakes: Mistakes, driven: NDArray[np.bool_] | None) -> bool:
    n = geometry.n_nodes
    before = len(mistakes.found)
    if n == 0:
        mistakes.add("nodes/positions", "no nodes", expected="at least one node")
        return False
    for key, values, shape in (
        ("positions", geometry.positions, (n, 3)),
        ("velocities", geometry.velocities, (n, 3)),
        ("masses", geometry.masses, (n,)),
        ("fixed", geometry.fixed, (n,)),
        ("collidable", geometry.collidable, (n,)),
    ):
        if values.shape != shape:
            mistakes.add(f"nodes/{key}", f"shape {values.shape}", expected=f"{shape}")
        elif not (finite := np.isfinite(values.reshape(n, -1)).all(axis=1)).all():
            mistakes.add(
                f"nodes/{key}",
                f"NaN or infinity at node {list_some(np.flatnonzero(~finite))}",
                expected="finite numbers",
            )
    if geometry.labels is not None and len(geometry.labels) != n:
        mistakes.add("nodes/label", f"{len(geometry.labels)} labels", expected=f"{n}, one a node")
    elif geometry.labels is not None and len(set(geometry.labels)) < n:
        double = next(text for text in geometry.labels if geometry.labels.count(text) > 1)
        mistakes.add("nodes/label", f"the label {double!r} twice", expected="unique labels")
    if len(mistakes.found) > before:
        return False
    held = geometry.fixed if driven is None else geometry.fixed | driven
    bad = np.flatnonzero((geometry.masses < 0) | ((geometry.masses == 0) & ~held))
    if len(bad):
        mistakes.add(
            "nodes/masses",
            f"mass {geometry.masses[bad[0]]:g} kg at node {list_some(bad)}",
            expected="a positive mass at every node that can move",
            fix="give the node a mass, or fix it",
        )
    moving = np.flatnonzero(geometry.fixed & geometry.velocities.any(axis=1))
    if len(moving):
        mistakes.add(
            "nodes/velocities",
            f"fixed node {list_some(moving)} has a velocity",
            expected="0 at fixed nodes",
        )
    return True


def _check_columns(
    group: str,
    elements: Bars | Hinges,
    width: int,
    columns: tuple[str, ...],
    mistakes: Mistakes,
) -> bool:
    before = len(mistakes.found)
    indices = elements.indices
    if indices.ndim != 2 or indices.shape[1] != width:
        mistakes.add(f"{group}/indices", f"shape {indices.shape}", expected=f"(E, {width})")
        return False
    for key in columns:
        values = getattr(elements, key)
        if values.shape != (len(indices),):
            mistakes.add(f"{group}/{key}", f"shape {values.shape}", expected=f"({len(indices)},)")
        elif not (finite := np.isfinite(values)).all():
            mistakes.add(
                f"{group}/{key}",
                f"NaN or infinity at element {list_some(np.flatnonzero(~finite))}",
                expected="finite numbers",
            )
    return len(mistakes.found) == before


def _check_indices(
    group: str, indices: NDArray[np.int32], n_nodes: int, mistakes: Mistakes
) -> bool:
    outside = np.flatnonzero(((indices < 0) | (indices >= n_nodes)).any(axis=1))
    if len(outside):
        mistakes.add(
            f"{group}/indices",
            f"element {list_some(outside)} names node {indices[outside[0]].tolist()}",
            expected=f"node numbers from 0 to {n_nodes - 1}",
        )
        return False
    ordered = np.sort(indices, axis=1)
    repeated = np.flatnonzero((np.diff(ordered, axis=1) == 0).any(axis=1))
    if len(repeated):
        mistakes.add(
            f"{group}/indices",
            f"element {list_some(repeated)} uses a node twice: {indices[repeated[0]].tolist()}",
            expected=f"{indices.shape[1]} different nodes",
        )
        return False
    return True


def _check_bars(bars: Bars, geometry: Geometry, mistakes: Mistakes) -> None:
    group = "elements/bars"
    for key in ("stiffness", "rest_length", "damping"):
        _check_not_negative(f"{group}/{key}", getattr(bars, key), mistakes)
    below = np.flatnonzero(bars.prestress < -1.0)
    if len(below):
        mistakes.add(
            f"{group}/prestress",
            f"{bars.prestress[below[0]]:g} at element {list_some(below)}",
            expected="at least -1, since rest_length * (1 + prestress) is a length",
        )
    if len(bars) == 0 or not _check_indices(group, bars.indices, geometry.n_nodes, mistakes):
        return
    _, first, count = np.unique(
        np.sort(bars.indices, axis=1), axis=0, return_index=True, return_counts=True
    )
    twice = first[count > 1]
    if len(twice):
        mistakes.add(
            f"{group}/indices",
            f"several bars between nodes {bars.indices[twice[0]].tolist()}"
            f" (first: element {list_some(np.sort(twice))})",
            expected="one bar between two nodes",
            fix="merge them: stiffnesses and dampings of parallel bars add up",
        )
    ends = geometry.positions[bars.indices]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    collapsed = np.flatnonzero((length == 0) & (bars.relaxed_length > 0))
    if len(collapsed):
        mistakes.add(
            f"{group}/indices",
            f"the nodes of element {list_some(collapsed)} are at one point",
            expected="a distance between them, else the bar has no direction",
        )


def _check_not_negative(key: str, values: NDArray[np.float64], mistakes: Mistakes) -> None:
    negative = np.flatnonzero(values < 0)
    if len(negative):
        mistakes.add(
            key,
            f"{values[negative[0]]:g} at element {list_some(negative)}",
            expected="0 or more",
        )


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
    if experiment.damping < 0:
        mistakes.add("physics.damping", f"{experiment.damping}", expected="0 or more")


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
