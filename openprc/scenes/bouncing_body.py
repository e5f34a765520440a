"""A ball that falls on a fixed face and bounces."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from openprc.scenes.closed_forms import GRAVITY, bounce_heights
from openprc.scenes.option_checks import check_range
from openprc.scenes.probes import deviation_probe, path_of
from openprc.scenes.scene import Probe, Reference, Scene
from openprc.schema.experiment import Collision, Experiment
from openprc.schema.geometry import Geometry

if TYPE_CHECKING:
    from openprc.scenes.probes import Reals
    from openprc.schema.trajectory import Trajectory

RADIUS, MASS, FLOOR = 0.02, 0.05, 1.0  # m, kg, m (from the centre of the floor to its corners)
LABELS = ("floor0", "floor1", "floor2", "ball")
DT, INTERVAL = 2e-4, 2e-3  # s


def build(*, height: float, restitution: float, bounces: int) -> Scene:
    """Return the ball; options as in the record."""
    check_range("bouncing-body", {"height": height}, above=0.0)
    check_range("bouncing-body", {"restitution": restitution}, above=0.0, most=1.0)
    check_range("bouncing-body", {"bounces": bounces}, least=1)
    fall = math.sqrt(2.0 * height / GRAVITY)
    powers = restitution ** np.arange(bounces + 1.0)
    # Impact n is after n - 1 whole flights, and the apex behind it half a flight later.
    impacts = fall * (1.0 + 2.0 * np.concatenate([[0.0], np.cumsum(powers[1:-1])]))
    apexes = impacts + fall * powers[1:]
    duration = math.ceil((apexes[-1] + 0.9 * fall * powers[-1]) / INTERVAL) * INTERVAL
    turn = 2.0 * math.pi * np.arange(3) / 3.0
    places = np.zeros((4, 3))
    places[:3, 0], places[:3, 1] = FLOOR * np.cos(turn), FLOOR * np.sin(turn)
    places[3, 2] = RADIUS + height

    def exact(times: Reals) -> Reals:
        x = np.repeat(places[np.newaxis], len(times), axis=0)
        x[:, 3, 2] = RADIUS + bounce_heights(times, height=height, restitution=restitution)
        return x

    def apex(run: Trajectory, number: int) -> float:
        flight = np.abs(run.time - apexes[number]) < 0.8 * fall * powers[number + 1]
        above = path_of(run, "ball")[flight, 2] - RADIUS
        top = int(np.clip(above.argmax(), 1, len(above) - 2))
        left, middle, right = above[top - 1 : top + 2]
        # The summit of the parabola through three frames.
        return float(middle - (right - left) ** 2 / (8.0 * (left - 2.0 * middle + right)))

    source = "heights h e^(2 n), flights of 2 e^n sqrt(2 h / g)"
    return Scene(
        name="bouncing-body",
        experiment=Experiment(
            geometry=Geometry(
                positions=places,
                masses=np.full(4, MASS),
                fixed=np.arange(4) < 3,
                collidable=np.arange(4) == 3,
                labels=LABELS,
                faces=np.array([[0, 1, 2]]),
            ),
            duration=duration,
            dt=DT,
            save_interval=INTERVAL,
            gravity=(0.0, 0.0, -GRAVITY),
            collision=Collision(
                enabled=True, radius=RADIUS, restitution=restitution, friction=0.0, faces=True
            ),
            integrator="verlet",
        ),
        reference=Reference(
            kind="closed form",
            text=f"parabolas between impacts; all of them end at {_end(fall, restitution)}",
            source=source,
            exact=exact,
            probes=(
                *(
                    Probe(
                        name=f"height after impact {number + 1}",
                        value=height * restitution ** (2 * number + 2),
                        unit="m",
                        tolerance=1e-2,
                        measure=lambda run, number=number: apex(run, number),  # type: ignore[misc]
                        source=source,
                    )
                    for number in range(bounces)
                ),
                deviation_probe(exact, LABELS, scale=height, tolerance=1e-2, source=source),
            ),
        ),
        scale=height,
    )


def _end(fall: float, restitution: float) -> str:
    if restitution == 1.0:
        return "no time, since nothing is lost"
    return f"{fall * (1.0 + restitution) / (1.0 - restitution):.4g} s"
