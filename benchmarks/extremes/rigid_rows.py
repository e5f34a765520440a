"""Extremes of constraints: masses, redundant bars, and bodies on the edge of a mechanism."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from bodies import X, Y, Z, against, bar_table
from cells import SINGLE_WAYS, WAYS, Extreme, with_step
from references import Reals

from openprc.demlat import BarHingeModel
from openprc.schema import Trajectory
from openprc.schema.experiment import Experiment
from openprc.schema.geometry import Geometry

EVERY = (*WAYS, *SINGLE_WAYS)


def rigid_body(
    positions: Reals, pairs: list[tuple[int, int]], masses: list[float], fixed: list[bool]
) -> Geometry:
    """Return nodes on rigid bars of the lengths that they have."""
    rows = [(i, j, 1.0, float(np.linalg.norm(positions[i] - positions[j])), 0.0) for i, j in pairs]
    bars = bar_table(rows, rigid=np.ones(len(rows), dtype=bool))
    return Geometry(positions=positions, masses=masses, fixed=fixed, bars=bars)


def scene_of(geometry: Geometry, *, duration: float = 1.0) -> Experiment:
    """Return it under gravity."""
    return Experiment(
        geometry=geometry,
        duration=duration,
        dt=0.01,
        save_interval=0.01,
        gravity=(0.0, 0.0, -9.81),
    )


def finer(scene: Experiment) -> Callable[[], Reals]:
    """Return the frames of rk4-dae at a sixteenth of the step of the study, once."""
    frames: list[Reals] = []

    def once() -> Reals:
        if not frames:
            fine = replace(scene, integrator="rk4-dae", dt=scene.save_interval / 320)
            blocks = BarHingeModel(fine).blocks()
            frames.append(np.concatenate([block.x.copy() for _, block in blocks]))
        return frames[0]

    return once


def row(
    name: str,
    level: str,
    scene: Experiment,
    judge: Callable[[Trajectory], float] | None = None,
    *,
    measure: str = "largest error of a coordinate against rk4-dae at a fine step",
    quick: bool = True,
    slow: float = 5e-4,
) -> Extreme:
    """Return a row of a rigid scene, in steps of at most `slow` [s]."""
    return Extreme(
        name=name,
        level=level,
        build=lambda way: with_step(scene, way, slow=slow),
        judge=judge or against(finer(scene)),
        measure=measure,
        quick=quick,
        ways=EVERY,
    )


def chains() -> Iterator[Extreme]:
    """Yield rigid chains of three links, thrown from the horizontal, with unequal masses."""
    for ratio in (1e-6, 1e-3, 1e3, 1e6):
        positions = np.outer(np.arange(4.0), X)
        masses = [1.0, 1.0, ratio, 1.0]
        geometry = rigid_body(positions, [(0, 1), (1, 2), (2, 3)], masses, [True] + [False] * 3)
        yield row(
            "rigid chain, mass ratio",
            f"{ratio:g}",
            scene_of(geometry, duration=0.5),
            quick=ratio in (1e-6, 1e6),
        )


def still(run: Trajectory) -> float:
    """Return how far a body that should rest has moved, over a metre."""
    x = run.positions()
    return float(np.abs(x - x[0]).max())


def edges() -> Iterator[Extreme]:
    """Yield redundant and nearly dependent constraints."""
    square = np.array([0 * X, X, X + Y, Y, 0.5 * X + 0.5 * Y + Z])
    pairs = [(i, j) for i in range(5) for j in range(i)]
    geometry = rigid_body(square, pairs, [1.0] * 5, [False] * 5)

    def falls(run: Trajectory) -> float:
        x = run.positions()
        drop = -0.5 * 9.81 * run.time**2
        exact = x[0] + drop[:, None, None] * Z
        return float(np.abs(x - exact).max() / 4.905)

    yield row(
        "redundant rigid bars",
        "1 too many",
        scene_of(geometry),
        falls,
        measure="largest error of a free fall over its depth",
    )
    line = np.array([0.0 * X, X, 2.0 * X])
    geometry = rigid_body(line, [(0, 1), (1, 2)], [1.0] * 3, [True, False, True])
    scene = replace(scene_of(geometry), gravity=(0.0, 0.0, 0.0))
    yield row(
        "straight rigid chain between walls",
        "at rest",
        scene,
        still,
        measure="largest displacement of a body that should rest",
    )
    yield row(
        "straight rigid chain between walls",
        "gravity across",
        scene_of(geometry),
        still,
        measure="largest displacement: to first order it is a mechanism, to second it cannot move",
    )
    for bow in (1e-3, 1e-6):
        bent = line + bow * np.array([[0.0], [1.0], [0.0]]) * Z
        geometry = rigid_body(bent, [(0, 1), (1, 2)], [1.0] * 3, [True, False, True])
        geometry = replace(geometry, velocities=[0 * X, 0.1 * Y, 0 * X])
        scene = replace(scene_of(geometry), gravity=(0.0, 0.0, 0.0))

        def circles(run: Trajectory, bow: float = bow) -> float:
            turn = 0.1 / bow * run.time
            exact = bow * np.stack([np.sin(turn), np.cos(turn)], axis=1)
            return float(np.abs(run.positions()[:, 1, 1:] - exact).max() / bow)

        yield row(
            "nearly straight rigid chain",
            f"bow {bow:g} m",
            scene,
            circles,
            measure="largest error of the middle on its circle over the circle's radius",
            quick=bow == 1e-3,
            slow=0.02 * bow,
        )
    sheet = np.array([[i, j, 0.0] for i in range(3) for j in range(3)], dtype=float)
    apart = np.abs(sheet[:, None] - sheet[None, :]).sum(axis=2)
    pairs = [(i, j) for i in range(9) for j in range(i) if apart[i, j] == 1.0]
    pairs += [(0, 4), (1, 5), (3, 7), (4, 8)]
    geometry = rigid_body(sheet, pairs, [1.0] * 9, [n < 2 for n in range(9)])
    yield row("flat rigid sheet", "under gravity", scene_of(geometry, duration=0.3))


def rows() -> Iterator[Extreme]:
    """Yield every row of this page."""
    yield from chains()
    yield from edges()
