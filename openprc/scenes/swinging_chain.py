"""A chain of point masses that is let go with all links aside: chaos within seconds."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from openprc.scenes.closed_forms import GRAVITY, chain_of_links, swinging_links
from openprc.scenes.converged import converged_motion
from openprc.scenes.option_checks import check_range
from openprc.scenes.probes import at_time, deviation_probe, path_of
from openprc.scenes.scene import Probe, Reference, Scene
from openprc.schema.experiment import Experiment
from openprc.schema.geometry import Bars, Geometry

if TYPE_CHECKING:
    from openprc.scenes.probes import Motion, Reals
    from openprc.schema.trajectory import Trajectory

LINK, MASS = 0.2, 0.1  # m, kg, of each
INTERVAL = 0.01  # s
#: How far the motion is checked; beyond it rounding and schemes grow out of hand [s].
HORIZON = 0.5


def build(*, n: int, angle: float, stiffness: float, duration: float, rigid: bool) -> Scene:
    """Return the swinging chain; options as in the record."""
    check_range("swinging-chain", {"n": n}, least=1, most=100)
    check_range("swinging-chain", {"stiffness": stiffness, "duration": duration}, above=0.0)
    labels = ("pivot", *(f"mass{i}" for i in range(1, n + 1)))
    first = np.arange(n)
    # Shortest period of the bars over 2 pi: rounded to a part of the interval.
    steps = math.ceil(INTERVAL * math.sqrt(4.0 * stiffness / MASS) / 0.2)
    experiment = Experiment(
        geometry=Geometry(
            positions=chain_of_links(np.full(n, angle), link=LINK),
            masses=np.full(n + 1, MASS),
            fixed=np.arange(n + 1) == 0,
            labels=labels,
            bars=Bars(
                indices=np.stack([first, first + 1], axis=1),
                stiffness=np.full(n, stiffness),
                rest_length=np.full(n, LINK),
                rigid=np.full(n, rigid),
            ),
        ),
        duration=math.ceil(duration / INTERVAL - 1e-9) * INTERVAL,
        dt=INTERVAL / (20 if rigid else steps),
        save_interval=INTERVAL,
        gravity=(0.0, 0.0, -GRAVITY),
        integrator="rk4-dae" if rigid else "verlet",
    )

    def links(times: Reals) -> Reals:
        return chain_of_links(swinging_links(times, n=n, link=LINK, start=angle), link=LINK)

    exact: Motion = links if rigid else converged_motion(experiment)
    # Largest tension at the pivot: all masses at the bottom of a swing from the side.
    give = 0.0 if rigid else 3.0 * n * MASS * GRAVITY / stiffness
    scale = n * LINK
    source = "Lagrange's equations of rigid links, by DOP853 to 1e-12"
    horizon = min(HORIZON, experiment.duration)

    def tip(run: Trajectory, axis: int, time: float) -> float:
        return float(at_time(run, path_of(run, labels[-1])[:, axis], time=time))

    instants = [time for time in (0.25, 0.5) if time <= horizon + 1e-9]
    expected = links(np.array(instants)) if instants else np.zeros((0, n + 1, 3))
    probes = [
        Probe(
            name=f"{'xyz'[axis]} of the tip at {time:g} s",
            value=float(expected[row, -1, axis]),
            unit="m",
            tolerance=(2e-5 + 20.0 * give) / max(abs(float(expected[row, -1, axis])), 1e-3),
            measure=lambda run, axis=axis, time=time: tip(run, axis, time),  # type: ignore[misc]
            source=source,
        )
        for row, time in enumerate(instants)
        for axis in (0, 2)
    ]
    return Scene(
        name="swinging-chain",
        experiment=experiment,
        reference=Reference(
            kind="converged",
            text=f"chaotic: known to rounding for the first {horizon:g} s, and then to fewer and"
            " fewer digits"
            + ("" if rigid else f"; the bars give by up to {give:.1e} m beside rigid links"),
            source=source if rigid else "the same bars, by SciPy's DOP853 to 1e-11",
            exact=exact,
            probes=(
                *probes,
                deviation_probe(
                    exact,
                    labels,
                    scale=scale,
                    tolerance=3e-3,
                    source="DOP853",
                    until=horizon,
                ),
            ),
        ),
        scale=scale,
        chaotic=True,
    )
