"""Two bars that meet in a shallow apex, pushed through the flat state by a spring."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from openprc.scenes.closed_forms import von_mises_force, von_mises_limit
from openprc.scenes.option_checks import check_range
from openprc.scenes.probes import deviation_probe, path_of
from openprc.scenes.scene import Probe, Reference, Scene
from openprc.scenes.slow_drive import SAMPLES, smooth_path
from openprc.schema.experiment import Actuator, Experiment, Signal
from openprc.schema.geometry import Bars, Geometry

if TYPE_CHECKING:
    from openprc.scenes.probes import Reals
    from openprc.schema.trajectory import Trajectory

SPAN = 1.0  # m, from a support to the middle
LOADER = 0.5  # m, relaxed length of the spring that pushes
FRAMES = 500
LABELS = ("left", "right", "apex", "press")
#: Drag at the highest speed, over the limit load.
DRAG = 1e-3


def build(*, rise: float, stiffness: float, loader: float, duration: float) -> Scene:
    """Return the truss; options as in the record."""
    check_range("von-mises-truss", {"rise": rise}, above=0.0, most=SPAN)
    check_range("von-mises-truss", {"stiffness": stiffness, "loader": loader}, above=0.0)
    check_range("von-mises-truss", {"duration": duration}, least=10.0)
    limit, critical = von_mises_limit(span=SPAN, rise=rise, stiffness=stiffness)
    steepest = 2.0 * stiffness * (math.hypot(SPAN, rise) / SPAN - 1.0)
    spring = loader * steepest
    # Far enough for the apex to come to rest below, with the spring nearly relaxed.
    top, bottom = rise + LOADER, LOADER - 1.1 * rise
    press = smooth_path(top, bottom, duration=duration)
    fastest_drive = 1.875 * (top - bottom) / duration
    drag = DRAG * limit / fastest_drive
    mass = drag * 1.0  # a decay of 1 / s
    omega = math.sqrt((2.0 * stiffness + spring) / mass)
    interval = duration / FRAMES
    places = np.array([[-SPAN, 0, 0], [SPAN, 0, 0], [0, 0, rise], [0, 0, top]], dtype="f8")
    column = np.zeros((SAMPLES, 3))
    column[:, 2] = press.values
    actuators = (
        Actuator(node=2, signal="upright", type="position", axes=(True, True, False)),
        Actuator(node=3, signal="press", type="position"),
    )
    snaps = loader <= 1.0

    def exact(times: Reals) -> Reals:
        x = np.repeat(places[np.newaxis], len(times), axis=0)
        x[:, 3, 2] = press.at(times)
        x[:, 2, 2] = _balanced(x[:, 3, 2], rise=rise, stiffness=stiffness, spring=spring)
        return x

    def push(run: Trajectory) -> Reals:
        gap = path_of(run, "press")[:, 2] - path_of(run, "apex")[:, 2]
        pushed: Reals = spring * (LOADER - gap)
        return pushed

    source = "P = 2 k z (L0 / sqrt(b^2 + z^2) - 1), largest 2 k (L0^(2/3) - b^(2/3))^(3/2)"
    probes = [
        Probe(
            name="limit load",
            value=limit,
            unit="N",
            tolerance=5e-3 if snaps else 2e-3,
            measure=lambda run: float(push(run).max()),
            source=source,
        )
    ]
    if not snaps:
        probes.append(
            deviation_probe(
                exact, LABELS, scale=rise, tolerance=2e-3, source=source, interval=interval
            )
        )
    return Scene(
        name="von-mises-truss",
        experiment=Experiment(
            geometry=Geometry(
                positions=places,
                masses=np.full(4, mass),
                fixed=np.array([True, True, False, False]),
                labels=LABELS,
                bars=Bars(
                    indices=np.array([[0, 2], [1, 2], [2, 3]]),
                    stiffness=np.array([stiffness, stiffness, spring]),
                    rest_length=np.array([math.hypot(SPAN, rise)] * 2 + [LOADER]),
                ),
            ),
            signals={
                "press": Signal(
                    name="press", values=column, dt=press.dt, interpolation="cubic", unit="m"
                ),
                "upright": Signal(
                    name="upright", values=np.zeros(2), dt=duration, interpolation="linear",
                    unit="m",
                ),
            },
            actuators=actuators,
            duration=duration,
            dt=interval / math.ceil(interval * omega / 0.3),
            save_interval=interval,
            damping=drag,
            integrator="verlet",
        ),
        reference=Reference(
            kind="closed form",
            text=f"the limit load at a height of {critical:.4g} m"
            + (
                ", past which the apex jumps: the spring is softer than the truss is steep"
                if snaps
                else ", and the height of the apex at every instant of a slow press"
            ),
            source=source,
            exact=None if snaps else exact,
            probes=tuple(probes),
        ),
        scale=rise,
        quasi_static=True,
    )  # fmt: skip


def _balanced(press: Reals, *, rise: float, stiffness: float, spring: float) -> Reals:
    """Return the height at which spring and truss balance, for each height of the press (T,)."""
    low, high = np.full(len(press), -1.5 * rise), np.full(len(press), 1.5 * rise)
    # The spring is stiffer than the truss is steep: the balance has one root, found by halving.
    for _ in range(60):
        middle = 0.5 * (low + high)
        held = von_mises_force(middle, span=SPAN, rise=rise, stiffness=stiffness)
        above = held < spring * (LOADER - press + middle)
        high = np.where(above, middle, high)
        low = np.where(above, low, middle)
    balanced: Reals = 0.5 * (low + high)
    return balanced
