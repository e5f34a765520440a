"""Sine or square: tell which wave is on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.tasks.scoring import Metric
from openprc.analysis.tasks.series import TargetSeries, TaskData
from openprc.analysis.tasks.task import (
    ImitationTask,
    Kind,
    Randomness,
    generator_of,
    input_symbols,
    positive_count,
)
from openprc.errors import TaskError

_TOLERANCE = 1e-5


@dataclass(frozen=True)
class SineSquareTask(ImitationTask):
    """Classify a random sequence of sine and square periods.

    Every period has `points` symbols. Where the sine is at its crests both waves have the same
    value, so that a readout of the present symbol alone cannot decide.

    Parameters
    ----------
    points : int
        Symbols per period; a multiple of 4 puts symbols on the crests.
    """

    points: int = 12
    kind: ClassVar[Kind] = "own-input"
    metric: ClassVar[Metric] = "accuracy"
    levels: ClassVar[tuple[float, ...]] = (0.0, 1.0)
    name: ClassVar[str] = "sine-square"
    source: ClassVar[str] = (
        "sine and square wave classification in the manner of Paquot et al. 2012, "
        "doi:10.1038/srep00287"
    )

    def __post_init__(self) -> None:
        positive_count(self.points, "points", least=4)

    @property
    def formula(self) -> str:
        """Both waves and the target."""
        return (
            f"u = sin(2 pi i/{self.points}) or +1 for i < {self.points / 2:g} and -1 after, "
            f"i = 0..{self.points - 1}; y = 0 on a sine, 1 on a square"
        )

    @property
    def waves(self) -> NDArray[np.float64]:
        """One period of the sine and one of the square wave, (2, points)."""
        i = np.arange(self.points)
        square = np.where(2 * i < self.points, 1.0, -1.0)
        return np.stack([np.sin(2.0 * np.pi * i / self.points), square])

    def generate(self, n: int, *, rng: Randomness) -> TaskData:
        """Return `n` symbols, the last period cut where it must be, and their classes."""
        generator, seed = generator_of(rng)
        n = positive_count(n, "n")
        classes = generator.integers(0, 2, size=-(-n // self.points))
        return TaskData(
            input=self.waves[classes].ravel()[:n],
            target=TargetSeries(np.repeat(classes, self.points)[:n], names=("square",)),
            metadata=self.metadata(),
            seed=seed,
        )

    def target(self, u: ArrayLike) -> TargetSeries:
        """Return the classes of stored symbols that `generate` made, (K, 1).

        Scale and offset are those of the crests: the highest symbol stands for +1.

        Raises
        ------
        TaskError
            When a period is neither wave.
        """
        values = input_symbols(u, n_columns=1)[:, 0]
        low, high = float(values.min()), float(values.max())
        if not high > low:
            raise TaskError(
                "the input does not vary",
                expected="sine and square periods",
                fix="drive the body with the input of this task",
                key="u",
            )
        # Without any square period the highest symbol may be below a crest.
        crests = (1.0, float(self.waves[0].max()))
        for crest in crests:
            classes = self._classes(crest * (2.0 * (values - low) / (high - low) - 1.0))
            if classes is not None:
                return TargetSeries(classes, names=("square",))
        raise TaskError(
            f"the input is no sequence of sine and square periods of {self.points} symbols",
            expected="periods that start at the first symbol",
            fix="drive the body with the input of this task",
            key="u",
        )

    def _classes(self, values: NDArray[np.float64]) -> NDArray[np.float64] | None:
        classes = np.empty(len(values))
        for start in range(0, len(values), self.points):
            period = values[start : start + self.points]
            distance = np.abs(self.waves[:, : len(period)] - period).max(axis=1)
            if distance.min() > _TOLERANCE:
                return None
            classes[start : start + self.points] = np.argmin(distance)
        return classes
