"""Extremes of the step: up to and above the stability limit, and very many steps."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache

import numpy as np
from bodies import Line, bar_table, energy_error
from cells import SINGLE_WAYS, WAYS, Extreme, Way

from openprc.demlat.integrators import INTEGRATORS
from openprc.demlat.planning.stability import step_limit
from openprc.schema.experiment import Experiment, StepCheck
from openprc.schema.geometry import Geometry

BALANCE = "energy that is not accounted for over what moves back and forth"


@cache
def lattice(*, damped: bool) -> Experiment:
    """Return a 4 x 4 lattice with diagonals, held on the left, thrown into motion."""
    rng = np.random.default_rng(5)
    n = 4
    grid = np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), -1).reshape(-1, 2)
    rest = np.zeros((n * n, 3))
    rest[:, :2] = 0.1 * grid
    apart = np.abs(grid[:, None] - grid[None, :]).max(axis=2)
    pairs = [(i, j) for i in range(n * n) for j in range(i) if apart[i, j] == 1]
    fixed = np.arange(n * n) < n
    start = rest + np.where(fixed[:, None], 0.0, 0.01 * rng.uniform(-1, 1, rest.shape))
    lengths = [float(np.linalg.norm(rest[i] - rest[j])) for i, j in pairs]
    k = 222.15 * rng.uniform(0.8, 1.2, len(pairs))
    c = 0.01 if damped else 0.0
    bars = bar_table([(i, j, k[e], lengths[e], c) for e, (i, j) in enumerate(pairs)])
    geometry = Geometry(positions=start, masses=np.full(n * n, 0.01), fixed=fixed, bars=bars)
    return Experiment(geometry=geometry, duration=1.0, dt=1e-3, save_interval=1e-2)


def limit_of(experiment: Experiment, integrator: str) -> float:
    """Return the stability limit [s]; of schemes without one, that of rk4."""
    scheme = INTEGRATORS[integrator]
    like = "rk4" if scheme.stability == "none" else integrator
    return step_limit(replace(experiment, integrator=like)).limit


def at_fractions() -> Iterator[Extreme]:
    """Yield steps around the limit, taken on purpose (step_check is "warn")."""
    for damped in (False, True):
        for fraction in (0.5, 0.8, 0.9, 0.95, 1.0, 1.05, 1.1):
            quick = fraction in (0.5, 0.95, 1.05)
            yield Extreme(
                name="step of the limit, " + ("damped" if damped else "undamped"),
                level=f"{fraction:g}",
                build=_at(fraction, damped=damped, n_steps=20_000),
                judge=energy_error,
                measure=BALANCE + ", 20 000 steps of a 4 x 4 lattice",
                tolerance=2e-2,
                quick=quick,
                ways=(*WAYS, *SINGLE_WAYS),
            )
    yield Extreme(
        name="step above the limit, unforced",
        level="1.05",
        build=_at(1.05, damped=False, n_steps=20_000, check="refuse"),
        judge=energy_error,
        measure=BALANCE,
    )


def _at(
    fraction: float, *, damped: bool, n_steps: int, check: StepCheck = "warn"
) -> Callable[[Way], Experiment]:
    def build(way: Way) -> Experiment:
        scene = lattice(damped=damped)
        dt = fraction * limit_of(scene, way.integrator)
        return replace(
            scene,
            integrator=way.integrator,
            precision=way.precision,
            dt=100 * dt if way.adaptive else dt,
            save_interval=100 * dt,
            duration=n_steps * dt,
            tolerance=(1e-5 if way.precision == "float32" else 1e-6) if way.adaptive else None,
            step_check=check,
        )

    return build


def many_steps() -> Iterator[Extreme]:
    """Yield long runs of an undamped line: energy, and the phase of its modes."""
    line = Line([100.0, 100.0], [1.0, 1.0], [1.0, 1.0])

    def build(n_steps: int, fraction: float) -> Callable[[Way], Experiment]:
        def made(way: Way) -> Experiment:
            scene = line.experiment(periods=1.0)
            dt = fraction * limit_of(scene, way.integrator)
            frame = n_steps / 100 * dt
            return replace(
                scene,
                integrator=way.integrator,
                precision=way.precision,
                dt=frame if way.adaptive else dt,
                save_interval=frame,
                duration=100 * frame,
                tolerance=(1e-5 if way.precision == "float32" else 1e-9) if way.adaptive else None,
            )

        return made

    for n_steps, quick in ((100_000, True), (10_000_000, False)):
        for fraction in (0.1, 0.01):
            judges = {"energy": energy_error, "phase": line.error}
            for measure, judge in judges.items():
                if measure == "energy" and fraction < 0.1:
                    continue
                yield Extreme(
                    name=f"many steps: {measure}",
                    level=f"{n_steps:.0e} at {fraction:g} of the limit",
                    build=build(n_steps, fraction),
                    judge=judge,
                    measure=BALANCE if measure == "energy" else "largest error of a displacement",
                    quick=quick,
                    ways=(*WAYS, *SINGLE_WAYS),
                )


def rows() -> Iterator[Extreme]:
    """Yield every row of this page."""
    yield from at_fractions()
    yield from many_steps()
