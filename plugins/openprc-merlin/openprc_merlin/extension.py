"""The subtree /extensions/openprc-merlin and its check."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import h5py
import numpy as np

from openprc.schema import Finding

if TYPE_CHECKING:
    from openprc.schema import Trajectory

NAME = "openprc-merlin"
VERSION = "1.0"


def check(trajectory: Trajectory) -> Iterable[Finding]:
    """Yield what is wrong with the subtree.

    ``increments`` holds the increment number of every frame, 0 for the initial state.
    """
    base = f"/extensions/{NAME}"
    with h5py.File(trajectory.path, "r") as file:
        group = file.get(base)
        if not isinstance(group, h5py.Group):
            return
        increments = group.get("increments")
        if not isinstance(increments, h5py.Dataset):
            yield Finding(
                code="MERLIN-01",
                level="error",
                path=f"{base}/increments",
                found="missing",
                expected="one increment number a frame",
                fix="import the run again",
            )
            return
        numbers = increments[()]
    if numbers.shape != (trajectory.n_frames,) or not (np.diff(numbers) > 0).all():
        yield Finding(
            code="MERLIN-02",
            level="error",
            path=f"{base}/increments",
            found=f"shape {numbers.shape}, for {trajectory.n_frames} frames",
            expected="increasing numbers, one a frame",
            fix="import the run again",
        )
