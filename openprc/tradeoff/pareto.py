"""Which settings nothing beats, and what an error costs in between."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

from openprc.tradeoff.point import Point

#: Takes a point and returns what it costs, or None where that is not known.
Cost = Callable[[Point], float | None]
#: Takes a point and returns how wrong it is, or None where there was no result.
Error = Callable[[Point], float | None]


def cpu_seconds(point: Point) -> float | None:
    """Return the CPU time [s]."""
    return point.cpu_seconds


def evaluations(point: Point) -> float | None:
    """Return the number of evaluations of all forces [1]."""
    return None if point.evaluations is None else float(point.evaluations)


def trajectory_error(point: Point) -> float | None:
    """Return the error of positions [1]."""
    return point.trajectory_error


def score_error(figure: str) -> Error:
    """Return what gives the error of a figure of a task."""
    return lambda point: point.score_errors.get(figure)


def error_by(metric: str) -> Error:
    """Return the error that a metric means: "trajectory", or the name of a figure."""
    return trajectory_error if metric == "trajectory" else score_error(metric)


def usable(points: Iterable[Point], cost: Cost, error: Error) -> list[Point]:
    """Return the points that ended well and have both numbers."""
    return [
        point
        for point in points
        if point.status == "ok" and cost(point) is not None and error(point) is not None
    ]


def pareto_front(
    points: Sequence[Point], *, cost: Cost = cpu_seconds, error: Error = trajectory_error
) -> tuple[Point, ...]:
    """Return the points that no other is as cheap and as exact as, and better in one of both.

    Sorted by cost. Of points with equal numbers the first one stays.

    Examples
    --------
    >>> from openprc.tradeoff.pareto import pareto_front
    >>> from openprc.tradeoff.point import Point
    >>> points = [
    ...     Point(group="", label=name, setting={}, cpu_seconds=cost, trajectory_error=error)
    ...     for name, cost, error in (("a", 1.0, 1e-2), ("b", 2.0, 2e-2), ("c", 3.0, 1e-4))
    ... ]
    >>> [point.label for point in pareto_front(points)]
    ['a', 'c']
    """
    able = usable(points, cost, error)
    front: list[Point] = []
    best = math.inf
    for point in sorted(able, key=lambda p: (cost(p), error(p))):  # type: ignore[arg-type, return-value]
        wrong = error(point)
        if wrong is not None and wrong < best:
            front.append(point)
            best = wrong
    return tuple(front)


def cheapest(
    points: Sequence[Point],
    target: float,
    *,
    cost: Cost = cpu_seconds,
    error: Error = trajectory_error,
) -> Point | None:
    """Return the cheapest point with an error of at most `target`, or None."""
    good = [p for p in usable(points, cost, error) if (error(p) or 0.0) <= target]
    return min(good, key=cost, default=None)  # type: ignore[arg-type]


def cost_of(
    ladder: Sequence[Point],
    target: float,
    *,
    cost: Cost = cpu_seconds,
    error: Error = trajectory_error,
) -> float | None:
    """Return what an error costs on a ladder of settings, coarse ones first.

    Interpolated on logarithmic axes between the rungs around it; None where no rung gets there,
    and the cost of the first rung that has a result where that one is good enough: then
    stability, and not accuracy, sets the step.
    """
    before: Point | None = None
    for point in usable(ladder, cost, error):
        here, price = error(point), cost(point)
        assert here is not None  # noqa: S101 - told by `usable`
        assert price is not None  # noqa: S101
        if here > target:
            before = point
            continue
        if before is None or here == 0.0:
            return price
        there, paid = error(before) or here, cost(before) or price
        share = math.log(there / target) / math.log(there / here)
        return float(paid * (price / paid) ** share)
    return None


__all__ = [
    "Cost",
    "Error",
    "cheapest",
    "cost_of",
    "cpu_seconds",
    "error_by",
    "evaluations",
    "pareto_front",
    "score_error",
    "trajectory_error",
    "usable",
]
