"""The subtree /extensions/openprc-merlin and its check."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from openprc.schema import Finding

if TYPE_CHECKING:
    from openprc.schema import Trajectory

NAME = "openprc-merlin"
VERSION = "1.0"


def check(trajectory: Trajectory) -> Iterable[Finding]:
    """Yield what is wrong with the subtree.

    ``increments`` holds the increment number of every frame, 0 for the initial state. It may
    be left out where the clock counts increments.
    """
    base = f"/extensions/{NAME}"
    if not trajectory.has(f"{base}/increments"):
        if trajectory.time_kind == "pseudo" and np.array_equal(
            trajectory.time, np.arange(trajectory.n_frames)
        ):
            return
        yield Finding(
            code="MERLIN-01",
            level="error",
            path=f"{base}/increments",
            found="missing",
            expected="one increment number a frame",
            fix="import the run again",
        )
        return
    numbers = trajectory.extension(NAME, "increments")
    if numbers.shape != (trajectory.n_frames,) or not (np.diff(numbers) > 0).all():
        yield Finding(
            code="MERLIN-02",
            level="error",
            path=f"{base}/increments",
            found=f"shape {numbers.shape}, for {trajectory.n_frames} frames",
            expected="increasing numbers, one a frame",
            fix="import the run again",
        )
