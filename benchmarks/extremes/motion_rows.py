"""Extremes of the motion: bars without length, strong drives, rotations, gravity, contact."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from bodies import X, Y, Z, against, bar_table
from cells import SINGLE_WAYS, WAYS, Extreme, with_step
from references import converged

from openprc.schema import Trajectory
from openprc.schema.experiment import Actuator, Collision, Experiment, Signal
from openprc.schema.geometry import Geometry

EVERY = (*WAYS, *SINGLE_WAYS)
REFERENCE = "largest error of a coordinate against dop853 at tolerance 1e-12"


def row(
    name: str,
    level: str,
    scene: Experiment,
    judge: Callable[[Trajectory], float],
    measure: str,
    *,
    slow: float,
    quick: bool = True,
    fraction: float = 0.1,
) -> Extreme:
    """Return a row of a scene whose step is chosen for it."""
    return Extreme(
        name=name,
        level=level,
        build=lambda way: with_step(scene, way, slow=slow, fraction=fraction),
        judge=judge,
        measure=measure,
        quick=quick,
        ways=EVERY,
    )


def one_bar(start: float, rest: float, *, stiffness: float = 100.0) -> Experiment:
    """Return a mass on a bar along x, at `start` from the wall, at rest."""
    geometry = Geometry(
        positions=[0.0 * X, start * X],
        masses=[1.0, 1.0],
        fixed=[True, False],
        bars=bar_table([(0, 1, stiffness, rest, 0.0)]),
    )
    return Experiment(geometry=geometry, duration=2.0, dt=0.01, save_interval=0.01)


def through_the_wall(
    start: float, rest: float, *, omega: float = 10.0
) -> Callable[[Trajectory], float]:
    """Return a judge of `one_bar` along x, through the wall and back: arcs, put together."""

    def judge(run: Trajectory) -> float:
        times = run.time
        # On x > 0 the middle is at rest, on x < 0 at -rest; both arcs are half of a symmetric
        # swing when start > 2 rest, else the mass never comes to the wall.
        if start <= 2.0 * rest:
            exact = rest + (start - rest) * np.cos(omega * times)
        else:
            # From rest at `start` to the wall: cos(omega t1) = -rest / (start - rest).
            t1 = np.arccos(-rest / (start - rest)) / omega
            phase = np.mod(times, 4.0 * t1)
            folded = np.where(phase > 2.0 * t1, 4.0 * t1 - phase, phase)
            side = np.where(folded > t1, -1.0, 1.0)
            near = np.where(folded > t1, 2.0 * t1 - folded, folded)
            exact = side * (rest + (start - rest) * np.cos(omega * near))
        return float(np.abs(run.positions()[:, 1, 0] - exact).max() / start)

    return judge


def without_length() -> Iterator[Extreme]:
    """Yield bars of no rest length, no length at the start, and through no length."""
    form = "largest error of the mass against its closed form"
    for name, start, rest in (
        ("rest 0", 1.0, 0.0),
        ("through 0, rest 0.3 m", 1.0, 0.3),
        ("start 0, rest 1 m", 0.0, 1.0),
        ("start 1e-6, rest 1 m", 1e-6, 1.0),
        ("start 1e-300, rest 1 m", 1e-300, 1.0),
    ):
        yield row(
            "bar without length",
            name,
            one_bar(start, rest),
            through_the_wall(start, rest) if start > 1e-3 else _beyond(rest),
            form,
            slow=1e-3,
        )


def _beyond(rest: float) -> Callable[[Trajectory], float]:
    def judge(run: Trajectory) -> float:
        exact = rest * (1.0 - np.cos(10.0 * run.time))
        return float(np.abs(run.positions()[:, 1, 0] - exact).max() / rest)

    return judge


def driven(amplitude: float, *, kind: str = "position", frequency: float = 1.0) -> Experiment:
    """Return a triangle on legs, one node of which is driven; its size is a metre."""
    h = np.sqrt(3.0) / 2.0
    positions = np.array([0.0 * X, X, 0.5 * X + h * Y, 0.5 * X + 0.3 * h * Y + 0.8 * Z])
    pairs = [(0, 1), (0, 2), (1, 2), (0, 3), (1, 3), (2, 3)]
    rows = [
        (i, j, 200.0, float(np.linalg.norm(positions[i] - positions[j])), 0.5) for i, j in pairs
    ]
    times = np.arange(0.0, 2.0 + 1e-9, 1e-3)
    wave = amplitude * np.sin(2.0 * np.pi * frequency * times) ** 2
    values = wave[:, None] * (0.6 * X + 0.8 * Y)
    if kind == "position":
        values = values + positions[0]
    signal = Signal(name="u", values=values, dt=1e-3, interpolation="cubic")
    geometry = Geometry(positions=positions, masses=[1.0] * 4, bars=bar_table(rows))
    return Experiment(
        geometry=geometry,
        signals={"u": signal},
        actuators=(Actuator(node=0, signal="u", type=kind),),
        duration=2.0,
        dt=0.01,
        save_interval=0.01,
    )


def strong_drives() -> Iterator[Extreme]:
    """Yield amplitudes of many body sizes, forces like blows, and jumps of a driven node."""
    for amplitude in (1.0, 10.0, 1e3):
        scene = driven(amplitude)
        yield row(
            "driven by body sizes",
            f"{amplitude:g}",
            scene,
            against(converged(_of(scene))),
            REFERENCE,
            slow=1e-3,
            quick=amplitude == 10.0,
        )
    for force in (1e4, 1e8):
        scene = replace(driven(force, kind="force", frequency=20.0), duration=0.1)
        yield row(
            "blow of a force",
            f"{force:g} N",
            scene,
            against(converged(_of(scene))),
            REFERENCE,
            slow=2e-4,
            quick=force == 1e4,
        )
    scene = driven(1.0)
    jump = Signal(name="u", values=[[0, 0, 0], [3.0, 0, 0]], dt=0.5, interpolation="hold")
    scene = replace(scene, signals={"u": jump}, duration=1.0)
    yield row(
        "driven node that jumps",
        "3 body sizes",
        scene,
        against(converged(_of(scene))),
        REFERENCE,
        slow=1e-3,
    )


def _of(scene: Experiment) -> Callable[[], Experiment]:
    return lambda: scene


def spinning(rate: float, turns: float, *, damping: float = 0.0) -> Experiment:
    """Return two masses on a bar that turn about their middle, stretched so that it stays."""
    k, m, rest = 1e4, 1.0, 1.0
    # k (2 r - rest) = m rate^2 r
    r = k * rest / (2.0 * k - m * rate**2)
    geometry = Geometry(
        positions=[-r * X, r * X],
        velocities=[-rate * r * Y, rate * r * Y],
        masses=[m, m],
        bars=bar_table([(0, 1, k, rest, damping)]),
    )
    duration = 2.0 * np.pi * turns / rate
    return Experiment(
        geometry=geometry, duration=duration, dt=duration / 100, save_interval=duration / 100
    )


def rotations() -> Iterator[Extreme]:
    """Yield a free bar that turns many times."""
    for turns, quick in ((10, True), (1000, True), (10_000, False)):
        scene, rate = spinning(50.0, turns), 50.0

        def judge(run: Trajectory, rate: float = rate) -> float:
            x = run.positions()
            r = abs(x[0, 1, 0])
            exact = r * np.stack([np.cos(rate * run.time), np.sin(rate * run.time)], axis=1)
            return float(np.abs(x[:, 1, :2] - exact).max() / r)

        yield row(
            "rotation",
            f"{turns} turns",
            scene,
            judge,
            "largest error of a mass on its circle over the radius",
            slow=5e-4,
            quick=quick,
            fraction=0.25,
        )


def weights() -> Iterator[Extreme]:
    """Yield free fall and a hanging mass under no gravity, and under a million m/s2."""
    for g in (0.0, 9.81, 1e6):
        scene = one_bar(1.0, 1.0)
        scene = replace(scene, gravity=(g, 0.0, 0.0), duration=1.0)

        def judge(run: Trajectory, g: float = g) -> float:
            exact = 1.0 + g / 100.0 * (1.0 - np.cos(10.0 * run.time))
            gap = np.abs(run.positions()[:, 1, 0] - exact).max()
            return float(gap / max(g / 100.0, 1.0))

        yield row(
            "gravity",
            f"{g:g} m/s2",
            scene,
            judge,
            "largest error of a hanging mass against its closed form",
            slow=1e-3,
        )


def impacts() -> Iterator[Extreme]:
    """Yield two balls of 0.1 m that meet head-on, from slow to many radii in a step."""
    for speed in (1.0, 100.0, 1e4, 1e6):
        geometry = Geometry(
            positions=[0.0 * X, X],
            velocities=[speed * X, 0.0 * X],
            masses=[1.0, 1.0],
            collidable=[True, True],
        )
        scene = Experiment(
            geometry=geometry,
            duration=2.0,
            dt=0.01,
            save_interval=0.01,
            collision=Collision(enabled=True, radius=0.1, restitution=1.0),
        )

        def judge(run: Trajectory, speed: float = speed) -> float:
            # The balls change their velocities when they touch.
            touch = 0.8 / speed
            after = np.maximum(run.time - touch, 0.0)
            exact = np.stack([np.minimum(run.time, touch) * speed, 1.0 + after * speed], axis=1)
            return float(np.abs(run.positions()[:, :, 0] - exact).max() / (2.0 * speed))

        yield Extreme(
            name="impact in a step of 0.01 s",
            level=f"{speed:g} m/s",
            build=lambda way, scene=scene: replace(
                scene, integrator=way.integrator, precision=way.precision
            ),
            judge=judge,
            measure="largest error of a ball against its closed form over the way of a ball",
            ways=EVERY,
        )


def rows() -> Iterator[Extreme]:
    """Yield every row of this page."""
    yield from without_length()
    yield from strong_drives()
    yield from rotations()
    yield from weights()
    yield from impacts()
