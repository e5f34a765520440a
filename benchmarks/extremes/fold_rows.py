"""Extremes of hinges: near shut, flat, through themselves, and wings near the crease."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from bodies import against, fold
from cells import SINGLE_WAYS, WAYS, Extreme, Way, with_step
from references import converged

from openprc.schema.experiment import Experiment

REFERENCE = "largest error of a coordinate against dop853 at tolerance 1e-12"


def fold_row(
    name: str, level: str, scene: Experiment, *, slow: float, quick: bool = True
) -> Extreme:
    """Return a row that is judged by a converged reference."""
    reference = converged(lambda: scene)

    def build(way: Way) -> Experiment:
        return with_step(scene, way, slow=slow, fraction=0.1)

    return Extreme(
        name=name,
        level=level,
        build=build,
        judge=against(reference),
        measure=REFERENCE,
        quick=quick,
        ways=(*WAYS, *SINGLE_WAYS),
    )


def angles() -> Iterator[Extreme]:
    """Yield folds near shut, near flat, and through both."""
    for angle in (1e-1, 1e-3, 1e-6):
        scene = fold(angle, rest_angle=2.0 * angle)
        yield fold_row("hinge near shut", f"{angle:g} rad", scene, slow=2e-3, quick=angle < 1e-3)
    for angle in (1e-3, 1e-6, 1e-9):
        scene = fold(np.pi - angle)
        yield fold_row("hinge near flat", f"pi - {angle:g}", scene, slow=2e-3, quick=angle == 1e-6)
    scene = fold(np.pi + 0.5, speed=4.0, stiffness=0.5)
    yield fold_row("hinge through flat", "pi", replace(scene, duration=1.0), slow=1e-3)
    scene = fold(0.3, speed=6.0, stiffness=0.5)
    yield fold_row("hinge through itself", "0", replace(scene, duration=0.5), slow=1e-3)
    scene = fold(0.3, speed=6.0, stiffness=0.5, rest_angle=0.5)
    yield fold_row("hinge through itself", "0, rest 0.5", replace(scene, duration=0.5), slow=1e-3)


def collinear() -> Iterator[Extreme]:
    """Yield wings whose altitude goes to nothing; they are pulled through the crease line."""
    for decade in (-1, -2, -3, -4, -6, -8, -10):
        h = 10.0**decade
        scene = fold(np.pi - 0.1, altitude=h, stiffness=1e-3 * h, bar_stiffness=100.0)
        yield fold_row(
            "wing's altitude",
            f"1e{decade} m",
            replace(scene, duration=0.5),
            slow=1e-3,
            quick=decade in (-1, -4, -10),
        )
    # Bars that pull the wing onto the crease line.
    scene = fold(np.pi - 0.5, altitude=0.1, stiffness=1e-2, bar_stiffness=100.0)
    bars = replace(scene.geometry.bars, rest_length=[0.45, 0.45])
    scene = replace(scene, geometry=replace(scene.geometry, bars=bars), duration=0.5)
    yield fold_row("wing pulled through its crease", "0.1 m", scene, slow=1e-3)


def rows() -> Iterator[Extreme]:
    """Yield every row of this page."""
    yield from angles()
    yield from collinear()
