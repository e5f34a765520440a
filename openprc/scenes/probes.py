"""What runs of a scene are asked: where named nodes were, and how far that is from the known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from openprc.errors import MissingData
from openprc.scenes.scene import Probe

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.trajectory import Trajectory

    Reals = NDArray[np.float64]

Motion = Callable[["Reals"], "Reals"]


def places(trajectory: Trajectory, labels: Sequence[str] | None = None) -> Reals:
    """Return positions of nodes, by their labels, in three dimensions: (T, n, 3) [m].

    Parameters
    ----------
    trajectory : Trajectory
    labels : sequence of str, optional
        All nodes in the order of the file unless given.

    Raises
    ------
    MissingData
        When the file does not have a node of that label.
    """
    chosen = None if labels is None else _numbers(trajectory, labels)
    x = trajectory.positions(nodes=chosen, unit="m")
    flat = 3 - x.shape[2]
    return np.pad(x, ((0, 0), (0, 0), (0, flat))) if flat else x


def _numbers(trajectory: Trajectory, labels: Sequence[str]) -> list[int]:
    path = "/topology/nodes/label"
    stored = [str(name) for name in trajectory.node("label")] if trajectory.has(path) else []
    number = {name: row for row, name in enumerate(stored)}
    missing = [label for label in labels if label not in number]
    if missing:
        raise MissingData(
            f"no node is labelled {missing[0]!r}" if stored else "the nodes have no labels",
            expected="the labels of the scene: " + ", ".join(labels[:6]),
            fix="check a run of this scene, made with the same options",
            file=trajectory.path,
            key=path,
        )
    return [number[label] for label in labels]


def path_of(trajectory: Trajectory, label: str) -> Reals:
    """Return the positions of one node: (T, 3) [m]."""
    return places(trajectory, [label])[:, 0]


def at_time(trajectory: Trajectory, values: Reals, *, time: float) -> Reals:
    """Return frames (T, ...) at a time [s] between them, by a cubic through the four nearest.

    Raises
    ------
    MissingData
        When the run does not reach that time.
    """
    clock = instants(trajectory)
    slack = 1e-9 * max(abs(time), float(clock[-1] - clock[0]))
    if not clock[0] - slack <= time <= clock[-1] + slack:
        raise MissingData(
            f"frames from {clock[0]:g} s to {clock[-1]:g} s",
            expected=f"a frame at {time:g} s",
            fix="run the scene for its whole duration",
            file=trajectory.path,
            key="/time_series/time",
        )
    first = int(np.clip(np.searchsorted(clock, time) - 2, 0, max(len(clock) - 4, 0)))
    near = slice(first, first + 4)
    weights = np.ones(len(clock[near]))
    for i, here in enumerate(clock[near]):
        for j, there in enumerate(clock[near]):
            if i != j:
                weights[i] *= (time - there) / (here - there)
    found: Reals = np.tensordot(weights, values[near], axes=1)
    return found


def angular_frequency(samples: Reals, spacing: float) -> float:
    """Return the frequency of evenly spaced samples of an undamped sinusoid about 0 [rad/s].

    ``x[n + 1] + x[n - 1] = 2 cos(w h) x[n]`` for every amplitude and phase, by least squares.
    """
    middle, outer = samples[1:-1], samples[2:] + samples[:-2]
    cosine = float((middle * outer).sum() / (2.0 * (middle**2).sum()))
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)) / spacing)


def period_of_crossings(times: Reals, samples: Reals) -> float:
    """Return the mean period of an oscillation about 0 from where it crosses 0 upwards [s].

    Crossings lie on the parabola through the samples around them; NaN where there are fewer
    than two.
    """
    rising = np.flatnonzero((samples[:-1] < 0.0) & (samples[1:] >= 0.0))
    rising = rising[(rising > 0) & (rising < len(samples) - 2)]
    if len(rising) < 2:
        return float("nan")
    instants = []
    for row in rising:
        near = slice(row - 1, row + 3)
        # Time as a cubic function of the sample: no root has to be sought.
        value, clock = samples[near], times[near]
        weights = [
            np.prod([-other / (one - other) for j, other in enumerate(value) if j != i])
            for i, one in enumerate(value)
        ]
        instants.append(float(np.dot(weights, clock)))
    return (instants[-1] - instants[0]) / (len(instants) - 1)


def instants(trajectory: Trajectory, interval: float | None = None) -> Reals:
    """Return the times of the frames in the scene: (T,) [s].

    Parameters
    ----------
    trajectory : Trajectory
    interval : float [s], optional
        Time of the scene from one load step to the next, for paths of equilibria: those count
        steps, and have no time of their own.

    Raises
    ------
    MissingData
        When the file is such a path and there is no `interval`.
    """
    if trajectory.time_kind != "pseudo":
        return trajectory.time
    if interval is None:
        raise MissingData(
            "a path of equilibria, which has no time",
            expected="a run in time: this scene is known by its motion",
            fix="run it with a producer that integrates the motion",
            file=trajectory.path,
            key="/time_series/time",
        )
    return trajectory.time * interval


def deviation(
    trajectory: Trajectory,
    exact: Motion,
    labels: Sequence[str],
    *,
    until: float | None = None,
    interval: float | None = None,
) -> float:
    """Return the largest distance of a node from where it has to be [m].

    Parameters
    ----------
    trajectory : Trajectory
    exact : callable
        Times (T,) [s] to positions (T, N, 3) [m], in the order of `labels`.
    labels : sequence of str
    until : float [s], optional
        Frames after it are left out.
    interval : float [s], optional
        As for `instants`.
    """
    clock = instants(trajectory, interval)
    count = len(clock) if until is None else int(np.searchsorted(clock, until * (1.0 + 1e-9)))
    apart = places(trajectory, labels)[:count] - exact(clock[:count])
    return float(np.linalg.norm(apart, axis=2).max())


def deviation_probe(
    exact: Motion,
    labels: Sequence[str],
    *,
    scale: float,
    tolerance: float,
    source: str,
    until: float | None = None,
    interval: float | None = None,
) -> Probe:
    """Return the probe that every node is where it has to be, in units of `scale` [m].

    `interval` is given for paths of equilibria; see `instants`.
    """

    def measured(run: Trajectory) -> float:
        return deviation(run, exact, labels, until=until, interval=interval) / scale

    return Probe(
        name="largest deviation" if until is None else f"largest deviation until {until:g} s",
        value=0.0,
        unit="1",
        tolerance=tolerance,
        measure=measured,
        source=source,
    )
