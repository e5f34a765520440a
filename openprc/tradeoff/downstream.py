"""What happens to a run after it: how it is stored, read out, and measured, at what cost.

The trajectory is given. What of its digits survives storage and readout decides what the body
seems to compute, and how many rows an estimator sees decides how well that is known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from openprc.errors import ConfigError
from openprc.hooks.running import silent
from openprc.tradeoff.downstream_estimators import estimator_points
from openprc.tradeoff.downstream_readouts import readout_points
from openprc.tradeoff.downstream_rows import DownstreamRows, downstream_rows
from openprc.tradeoff.downstream_storage import storage_points

if TYPE_CHECKING:
    from openprc.analysis.benchmarks.choices import Choices
    from openprc.hooks.protocols import Progress
    from openprc.scenes.scene import Scene
    from openprc.tradeoff.point import Point

#: Group to what yields its points.
GROUPS: Mapping[str, Callable[[DownstreamRows], Iterator[Point]]] = MappingProxyType(
    {"storage": storage_points, "readout": readout_points, "estimator": estimator_points}
)


def downstream_points(
    run: str | Path,
    scene: Scene | None,
    *,
    groups: tuple[str, ...] = tuple(GROUPS),
    choices: Choices | None = None,
    progress: Progress = silent,
) -> Iterator[Point]:
    """Yield the points of the downstream side of a run.

    "storage": states rounded as they would be by storing them, read out by QR; errors against
    the same states in full precision. "readout": readouts and their penalties on the states as
    they are; errors against QR. "estimator": capacities in-sample and held-out, on fewer and
    fewer rows; errors against in-sample ones on all of them.

    Parameters
    ----------
    run : path-like
        A simulation.h5, in double precision.
    scene : Scene or None
        Names input and features.
    groups : tuple of str
        Some of the three.
    choices : Choices, optional
        Spans above all; by default a fifth of the rows is washed out, and a tenth tested on.
    progress : callable

    Raises
    ------
    MissingInputError, MissingData, NonUniformTime, TaskError
        When the run admits no task.
    ConfigError
        When a group is not there.
    """
    for group in groups:
        if group not in GROUPS:
            raise ConfigError(
                f"the group {group!r}",
                expected="one of " + ", ".join(GROUPS),
                fix="correct the name",
                key="groups",
            )
    with downstream_rows(run, scene, choices) as rows:
        for number, group in enumerate(groups):
            for point in GROUPS[group](rows):
                progress(number / len(groups), f"{group}: {point.label}")
                yield point


__all__ = ["GROUPS", "downstream_points"]
