"""The groups of settings: what is measured for each of them, and in which order."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from openprc.demlat.integrators import INTEGRATORS
from openprc.hooks.registry import default_registry
from openprc.tradeoff import ladders
from openprc.tradeoff.pareto import cost_of, cpu_seconds

if TYPE_CHECKING:
    from openprc.hooks.protocols import Progress
    from openprc.tradeoff.choices import Choices
    from openprc.tradeoff.point import Point
    from openprc.tradeoff.workbench import Workbench

#: Refined are ladders that reach the target for up to so many times the least cost.
NEAR = 2.0


def measure_group(bench: Workbench, group: str, choices: Choices, *, progress: Progress) -> None:
    """Measure every setting of a group, as far as it makes sense on the scene."""
    tasks = list(_TASKS[group](bench, choices))
    for number, (name, task) in enumerate(tasks):
        progress(number / len(tasks), name)
        task()


Tasks = Iterator[tuple[str, Callable[[], object]]]


def _integrators(bench: Workbench, choices: Choices) -> Tasks:
    for name in choices.schemes(bench.experiment):
        yield (
            name,
            lambda name=name: ladders.integrator_ladder(bench, name, enough=choices.enough),
        )
    if choices.target is not None and choices.metric == "trajectory":
        yield "around the target", lambda: refine(bench, "integrator", choices.target or 0.0)


def _constraints(bench: Workbench, choices: Choices) -> Tasks:
    for name in choices.schemes(bench.experiment):
        base = _base(bench, name, choices)
        if base is not None and INTEGRATORS[name].rigid != "no":
            yield (
                f"{name}, tolerance of constraints",
                lambda base=base: ladders.constraint_ladder(bench, base),
            )


def _precision(bench: Workbench, choices: Choices) -> Tasks:
    for name in ("rk4", "verlet", "dop853"):
        if name in choices.schemes(bench.experiment):
            yield (
                f"{name} in float32",
                lambda name=name: ladders.integrator_ladder(
                    bench, name, enough=choices.enough, group="precision", precision="float32"
                ),
            )


def _storage(bench: Workbench, choices: Choices) -> Tasks:
    # What storing loses shows where nothing else is lost.
    yield "storage", lambda: ladders.storage_points(bench, bench.reference.setting)


def _backends(bench: Workbench, choices: Choices) -> Tasks:
    for name in ("cpu", "jax", "cuda"):
        yield f"rk4 on {name}", lambda name=name: ladders.backend_ladder(bench, name)


def _models(bench: Workbench, choices: Choices) -> Tasks:
    yield "rigid bars", lambda: ladders.rigid_ladders(bench, enough=choices.enough)
    for item in default_registry().producers:
        if "run" in item.spec.capabilities and item.name != "demlat":
            yield (
                item.name,
                lambda item=item: ladders.producer_ladder(
                    bench, item.qualified_name, label=item.name, enough=choices.enough
                ),
            )


_TASKS: dict[str, Callable[[Workbench, Choices], Tasks]] = {
    "integrator": _integrators,
    "constraints": _constraints,
    "precision": _precision,
    "storage": _storage,
    "backend": _backends,
    "model": _models,
}


def _base(bench: Workbench, name: str, choices: Choices) -> Point | None:
    """Return the point that other axes are varied at: as exact as wanted, or as can be had."""
    measured = [p for p in bench.store.points if p.group == "integrator" and p.label == name]
    return ladders.best_rung(measured, choices.enough)


def refine(bench: Workbench, group: str, target: float) -> None:
    """Measure settings that should just reach a target, on the ladders that reach it cheaply."""
    found: dict[str, list[Point]] = {}
    for point in bench.store.points:
        if point.group == group and "step_check" not in point.setting:
            found.setdefault(point.label, []).append(point)
    costs = {label: cost_of(points, target, cost=cpu_seconds) for label, points in found.items()}
    least = min((cost for cost in costs.values() if cost is not None), default=math.inf)
    for label, points in found.items():
        cost = costs[label]
        if cost is None or cost > NEAR * least:
            continue
        setting = _between(points, target)
        if setting is not None:
            bench.measure(group, label, setting)


def _between(points: Sequence[Point], target: float) -> dict[str, Any] | None:
    """Return the setting between two rungs that should just reach the target."""
    good = [p for p in points if p.trajectory_error]
    for before, after in itertools.pairwise(good):
        e0, e1 = before.trajectory_error or 0.0, after.trajectory_error or 0.0
        if not e0 > target >= e1:
            continue
        share = math.log(e0 / (0.9 * target)) / math.log(e0 / e1)
        if not 0.0 < share < 1.0:
            return None
        if "tolerance" in before.setting:
            t0, t1 = before.setting["tolerance"], after.setting["tolerance"]
            return {**before.setting, "tolerance": float(f"{t0 * (t1 / t0) ** share:.2g}")}
        n0, n1 = before.setting["steps_per_frame"], after.setting["steps_per_frame"]
        count = math.ceil(n0 * (n1 / n0) ** share)
        return {**before.setting, "steps_per_frame": count} if n0 < count < n1 else None
    return None
