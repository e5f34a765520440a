"""Extremes of a linear body: ratios of stiffness and mass, lengths, places, dampers."""

from __future__ import annotations

from collections.abc import Iterator

from bodies import Line
from cells import SINGLE_WAYS, WAYS, Extreme, Way, with_step

from openprc.schema.experiment import Experiment

EXACT_FORM = "largest error of a displacement against the modes' closed form"
EVERY = (*WAYS, *SINGLE_WAYS)


def line_row(
    name: str,
    level: str,
    line: Line,
    *,
    periods: float = 2.0,
    quick: bool = True,
    slow_share: float = 1 / 400,
    n_frames: int = 41,
) -> Extreme:
    """Return a row whose body is a `Line`."""

    def build(way: Way) -> Experiment:
        experiment = line.experiment(periods=periods, n_frames=n_frames)
        return with_step(experiment, way, slow=slow_share * line.period)

    return Extreme(
        name=name,
        level=level,
        build=build,
        judge=line.error,
        measure=EXACT_FORM,
        quick=quick,
        ways=EVERY,
    )


def stiffness_ratios() -> Iterator[Extreme]:
    """Yield a stiff spring before a soft one, moving in the slow mode."""
    for decade in range(13):
        line = Line([100.0 * 10.0**decade, 100.0], [1.0, 1.0], [1.0, 1.0])
        # What is stiffer takes shorter steps; a part of the slow swing shows as much.
        periods = 2.0 if decade < 8 else 0.1
        quick = decade in (0, 6)
        yield line_row("stiffness ratio", f"1e{decade}", line, quick=quick, periods=periods)


def mass_ratios() -> Iterator[Extreme]:
    """Yield a light or a heavy mass between two springs."""
    for decade in range(-6, 7):
        line = Line([100.0, 100.0], [10.0**decade, 1.0], [1.0, 1.0])
        yield line_row("mass ratio", f"1e{decade}", line, quick=decade in (-6, 0, 6))
    line = Line([100.0, 100.0], [1e-12, 1.0], [1.0, 1.0])
    # In single precision rounding drives the light node, and steps that are chosen get very short.
    yield line_row("nearly massless node", "1e-12 kg", line, quick=False, periods=0.003)


def lengths() -> Iterator[Extreme]:
    """Yield bodies of every size, and bars of very different lengths in one body."""
    for decade in range(-6, 4):
        size = 10.0**decade
        line = Line([100.0, 100.0], [1.0, 1.0], [size, size], amplitude=0.1 * size)
        yield line_row("length", f"1e{decade} m", line, quick=decade in (-6, 3))
    mixed = Line([100.0, 100.0, 100.0], [1.0] * 3, [1e-3, 1.0, 1e3], amplitude=5e-4)
    yield line_row("mixed lengths", "1e-3, 1, 1e3 m", mixed)
    mixed = Line([100.0, 100.0, 100.0], [1.0] * 3, [1e-6, 1.0, 1e3], amplitude=5e-7)
    yield line_row("mixed lengths", "1e-6, 1, 1e3 m", mixed)


def offsets() -> Iterator[Extreme]:
    """Yield a body far from the origin."""
    for decade in (3, 6, 9, 12):
        line = Line([100.0, 100.0], [1.0, 1.0], [1.0, 1.0], offset=10.0**decade)
        yield line_row("offset of the origin", f"1e{decade} m", line, quick=decade in (6, 12))


def dampers() -> Iterator[Extreme]:
    """Yield bars whose dashpots rule, up to a damping ratio of a thousand."""
    for zeta in (1.0, 10.0, 1e3):
        # In proportion to the stiffness: c = 2 zeta k / omega in the slow mode.
        bare = Line([100.0, 100.0], [1.0, 1.0], [1.0, 1.0])
        c = 2.0 * zeta * 100.0 / bare.omega[0]
        line = Line([100.0, 100.0], [1.0, 1.0], [1.0, 1.0], damping=[c, c])
        yield line_row(
            "stiff dashpots", f"zeta {zeta:g}", line, quick=zeta in (1.0, 1e3), periods=2.0
        )


def rows() -> Iterator[Extreme]:
    """Yield every row of this page."""
    yield from stiffness_ratios()
    yield from mass_ratios()
    yield from lengths()
    yield from offsets()
    yield from dampers()
