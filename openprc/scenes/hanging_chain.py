"""A chain of point masses that hangs and swings a little, in one of its modes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from openprc.errors import ConfigError
from openprc.scenes.closed_forms import GRAVITY, hanging_chain_modes
from openprc.scenes.option_checks import check_range
from openprc.scenes.probes import angular_frequency, deviation_probe, places
from openprc.scenes.scene import Probe, Reference, Scene
from openprc.schema.experiment import Experiment
from openprc.schema.geometry import Bars, Geometry

if TYPE_CHECKING:
    from openprc.scenes.probes import Reals
    from openprc.schema.trajectory import Trajectory

LENGTH, MASS = 1.0, 1.0  # m, kg, of the whole chain
FRAMES = 40


def build(*, n: int, mode: int, amplitude: float, stiffness: float, periods: int) -> Scene:
    """Return the hanging chain; options as in the record."""
    check_range("hanging-chain", {"stiffness": stiffness}, above=0.0)
    check_range("hanging-chain", {"periods": periods}, least=1)
    if n < 1 or not 1 <= mode <= n:
        raise ConfigError(
            f"mode {mode} of a chain of {n} masses",
            expected="at least one mass, and a mode from 1 to the number of masses",
            fix="give n and mode that fit",
            key="mode",
        )
    link, mass = LENGTH / n, MASS / n
    roots, shapes = hanging_chain_modes(n)
    shape = shapes[mode - 1]
    swing = amplitude * shape / np.abs(shape).max()
    # Links that slope more would make the small swing a large one.
    steep = 0.1 * link / float(np.abs(np.diff(shape / np.abs(shape).max())).max())
    check_range("hanging-chain", {"amplitude": amplitude}, above=0.0, most=steep)
    omega = math.sqrt(GRAVITY / link * roots[mode - 1])
    labels = ("pivot", *(f"mass{i}" for i in range(1, n + 1)))

    def exact(times: Reals) -> Reals:
        x = np.zeros((len(times), n + 1, 3))
        x[..., 0] = np.cos(omega * times)[:, np.newaxis] * swing
        # Links keep their lengths: what goes sideways comes up.
        x[:, 1:, 2] = -np.cumsum(np.sqrt(link**2 - np.diff(x[..., 0], axis=1) ** 2), axis=1)
        return x

    def measured(run: Trajectory) -> float:
        sideways = places(run, labels)[:, :, 0] @ swing
        return angular_frequency(sideways, run.dt) / (2.0 * math.pi)

    period = 2.0 * math.pi / omega
    interval = period / FRAMES
    # The masses pull on the stiffest mode of the bars: four times k / m, squared.
    steps = math.ceil(interval * math.sqrt(4.0 * stiffness / mass) / 0.25)
    first = np.arange(n)
    tension: Reals = mass * GRAVITY * (n - first).astype("f8")
    source = "w^2 = x g / l with L_N(x) = 0, Laguerre's polynomial"
    steepest = float(np.abs(np.diff(swing)).max()) / link
    return Scene(
        name="hanging-chain",
        experiment=Experiment(
            geometry=Geometry(
                positions=exact(np.zeros(1))[0],
                masses=np.full(n + 1, mass),
                fixed=np.arange(n + 1) == 0,
                labels=labels,
                bars=Bars(
                    indices=np.stack([first, first + 1], axis=1),
                    stiffness=np.full(n, stiffness),
                    # Under its weight the chain is as long as one of rigid links.
                    rest_length=link - tension / stiffness,
                ),
            ),
            duration=periods * FRAMES * interval,
            dt=interval / steps,
            save_interval=interval,
            gravity=(0.0, 0.0, -GRAVITY),
            integrator="verlet",
        ),
        reference=Reference(
            kind="closed form",
            text="a normal mode whose frequency is a root of a Laguerre polynomial; links slope by"
            f" up to {steepest:.1e}, and what is left out goes with the square of that",
            source=source,
            exact=exact,
            probes=(
                Probe(
                    name="frequency",
                    value=omega / (2.0 * math.pi),
                    unit="Hz",
                    tolerance=1e-5 + steepest**2,
                    measure=measured,
                    source=source,
                ),
                deviation_probe(
                    exact,
                    labels,
                    scale=amplitude,
                    tolerance=1e-3 + 10.0 * periods * steepest**2,
                    source=source,
                ),
            ),
        ),
        scale=amplitude,
    )
