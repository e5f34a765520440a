"""Which settings are tried on each axis, and when a ladder of them ends."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.demlat.integrators import INTEGRATORS
from openprc.demlat.planning.stability import stable_step
from openprc.errors import OpenPRCError
from openprc.tradeoff.settings import RIGID, configured

if TYPE_CHECKING:
    from openprc.tradeoff.point import Point
    from openprc.tradeoff.workbench import Workbench

#: Relative errors per step that schemes are asked for: half a decade each.
TOLERANCES = tuple(float(f"{10.0 ** (-0.5 * i):.3g}") for i in range(4, 25))
CONSTRAINT_TOLERANCES = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-13)
#: Seconds of a run that is repeated as seldom as can be.
LONG = 1.0
#: Steps begin at so many times the stability limit, where it is exceeded on purpose.
OVERSTEP = 4
#: A scheme that gives nothing with this share of its stability limit never will.
HOPELESS = 1.0 / 64.0
#: An error that a finer setting does not lower by this has come to the floor.
STAGNATION = 0.8
#: Rungs that may pass without getting anywhere.
PATIENCE = 2
#: Longest strain of a bar that is stiff enough to be thought rigid.
STIFF_STRAIN = 1e-2


def steps_per_frame(bench: Workbench, setting: Mapping[str, Any]) -> tuple[int, Iterator[int]]:
    """Return the fewest stable steps a frame, and a ladder that begins above the limit."""
    experiment = configured(bench.experiment, setting)
    limit = stable_step(experiment)
    # A share of a millionth is rounding: dt may lie on the limit.
    fewest = max(1, math.ceil(experiment.save_interval / limit * (1.0 - 1e-6)))
    begin = {max(1, fewest // k) for k in (OVERSTEP, 2)}
    coarse = sorted(n for n in begin if n < fewest)
    return fewest, itertools.chain(coarse, (fewest * 2**k for k in itertools.count()))


def climb(
    bench: Workbench,
    group: str,
    label: str,
    settings: Iterator[dict[str, Any]],
    *,
    enough: float,
    growth: float = 2.0,
    hopeless: Callable[[Mapping[str, Any]], bool] = lambda setting: False,
) -> list[Point]:
    """Measure settings, coarse ones first, until finer ones cannot help or cannot be afforded.

    Parameters
    ----------
    enough : float
        Error below which there is no reason to go on.
    growth : float
        By what the next run takes longer.
    hopeless : callable
        Says whether a setting that gave nothing is the last to be tried.
    """
    measured: list[Point] = []
    stuck, best = 0, math.inf
    for setting in settings:
        if "producer" not in setting and "backend" not in setting:
            expected = bench.expected_seconds(setting)
            if expected > 5.0 * bench.longest:
                if not measured:
                    why = f"one run would take about {expected:.2g} s, and --longest is less"
                    measured.append(bench.refuse(group, label, setting, why=why))
                return measured
        point = bench.measure(group, label, setting)
        measured.append(point)
        wrong = point.trajectory_error
        if point.status == "refused" and "above" not in point.note:
            return measured  # what is refused for its kind is refused at any step
        if wrong is None:
            if hopeless(setting):
                return measured
            continue
        stuck = stuck + 1 if wrong > STAGNATION * best else 0
        best = min(best, wrong)
        too_long = growth * (point.cpu_seconds or 0.0) > bench.longest
        if wrong < enough or too_long or stuck >= PATIENCE:
            return measured
    return measured


def integrator_ladder(
    bench: Workbench, name: str, *, enough: float, group: str = "integrator", **common: Any
) -> list[Point]:
    """Measure an integrator from above its stability limit down to the floor of its error.

    `common` is part of every setting, such as ``precision="float32"``.
    """
    base = {"integrator": name, **common}
    label = " ".join([name, *(str(value) for value in common.values())])
    scheme = INTEGRATORS[name]
    if scheme.step == "adaptive":
        least = 10.0 * float(np.finfo(common.get("precision", "float64")).eps)
        # Where runs are long, decades have to do.
        long = bench.expected_seconds({**base, "tolerance": TOLERANCES[0]}) > LONG
        rungs = ({**base, "tolerance": t} for t in TOLERANCES[:: 1 + long] if t >= least)
        growth = 10 ** ((0.5 + 0.5 * long) / scheme.order)
        return climb(bench, group, label, rungs, enough=enough, growth=growth)
    try:
        fewest, counts = steps_per_frame(bench, {**base, "step_check": "warn"})
    except OpenPRCError as problem:
        return [bench.refuse(group, label, base, why=problem.found)]

    def rung(count: int) -> dict[str, Any]:
        above = {"step_check": "warn"} if count < fewest else {}
        return {**base, "steps_per_frame": count, **above}

    return climb(
        bench,
        group,
        label,
        (rung(count) for count in counts),
        enough=enough,
        hopeless=lambda setting: setting["steps_per_frame"] * HOPELESS > fewest,
    )


def best_rung(points: Sequence[Point], error: float) -> Point | None:
    """Return the cheapest point below an error, or else the most exact one."""
    good = [p for p in points if p.trajectory_error is not None and "step_check" not in p.setting]
    below = [p for p in good if (p.trajectory_error or 0.0) <= error]
    if below:
        return min(below, key=lambda p: p.cpu_seconds or math.inf)
    return min(good, key=lambda p: p.trajectory_error or 0.0, default=None)


def constraint_ladder(bench: Workbench, base: Point) -> list[Point]:
    """Vary the tolerance of constraints at the step of a point."""
    return [
        bench.measure(
            "constraints",
            f"{base.label} constraints",
            {**base.setting, "constraint_tolerance": tolerance},
        )
        for tolerance in CONSTRAINT_TOLERANCES
    ]


def storage_points(bench: Workbench, base: Mapping[str, Any]) -> list[Point]:
    """Store a run in both precisions, and read it back."""
    return [
        bench.measure("storage", f"stored as {precision}", {**base, "storage": precision})
        for precision in ("float64", "float32")
    ]


def backend_ladder(bench: Workbench, name: str, *, rungs: int = 4) -> list[Point]:
    """Run a few steps of rk4 on a back end."""
    setting = {"integrator": "rk4", "backend": name}
    try:
        _, counts = steps_per_frame(bench, setting)
    except OpenPRCError as problem:
        return [bench.refuse("backend", f"rk4 on {name}", setting, why=problem.found)]
    fewest = steps_per_frame(bench, setting)[0]
    stable = itertools.islice((n for n in counts if n >= fewest), rungs)
    made = ({**setting, "steps_per_frame": n} for n in stable)
    return climb(bench, "backend", f"rk4 on {name}", made, enough=0.0)


def stretches_little(bench: Workbench) -> tuple[bool, float]:
    """Say whether every bar keeps its length to a hundredth, and by how much one changes."""
    geometry = bench.experiment.geometry
    if not len(geometry.bars):
        return False, 0.0
    i, j = geometry.bars.indices.T
    frames = bench.reference.positions[:: max(1, len(bench.reference.positions) // 200)]
    lengths = np.linalg.norm(frames[:, j] - frames[:, i], axis=2)
    strain = float((np.abs(lengths - lengths[0]) / lengths[0]).max()) if lengths.all() else np.inf
    return strain <= STIFF_STRAIN, strain


def rigid_ladders(bench: Workbench, *, enough: float) -> list[Point]:
    """Replace stiff bars by rigid ones, and let both schemes for constraints have a go."""
    geometry = bench.experiment.geometry
    setting = {"model": RIGID}
    if not len(geometry.bars) or geometry.bars.rigid.all():
        return []
    stiff, strain = stretches_little(bench)
    if not stiff:
        why = f"bars stretch by up to {strain:.2g} of their length: they are springs, not struts"
        return [bench.refuse("model", RIGID, setting, why=why)]
    points: list[Point] = []
    for name in ("rattle", "rk4-dae"):
        points += integrator_ladder(bench, name, enough=enough, group="model", model=RIGID)
    return points


def producer_ladder(bench: Workbench, producer: str, *, label: str, enough: float) -> list[Point]:
    """Let another simulator run the scene, at falling steps."""
    setting = {"producer": producer}
    scene = replace(bench.experiment, integrator="verlet")
    try:
        fewest = max(1, math.ceil(scene.save_interval / stable_step(scene)))
    except OpenPRCError as problem:
        return [bench.refuse("model", label, setting, why=problem.found)]
    counts = (fewest * 2**k for k in itertools.count(1))
    made = ({**setting, "steps_per_frame": n} for n in counts)
    return climb(bench, "model", label, made, enough=enough)
