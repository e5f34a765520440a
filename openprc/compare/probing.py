"""Numbers that are known of a scene, measured in a run of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from openprc.compare.report import ProbeResult
from openprc.errors import OpenPRCError
from openprc.schema.trajectory import Trajectory

if TYPE_CHECKING:
    from openprc.scenes.scene import Scene


def probe_run(path: Path, scene: Scene) -> tuple[ProbeResult, ...]:
    """Measure in a run what is known of its scene; what cannot be measured says why."""
    results = []
    with Trajectory(path) as run:
        for probe in scene.reference.probes:
            measured, reason = None, ""
            if run.time_kind == "pseudo" and not scene.quasi_static:
                reason = "the run has load steps instead of time"
            else:
                try:
                    measured = float(probe.measure(run))
                except OpenPRCError as error:
                    reason = error.found
                if measured is not None and not np.isfinite(measured):
                    measured, reason = None, "it is not a finite number"
            deviation = None if measured is None else measured - probe.value
            if deviation is not None and probe.value != 0.0:
                deviation /= abs(probe.value)
            results.append(
                ProbeResult(
                    name=probe.name, unit=probe.unit, expected=probe.value, measured=measured,
                    deviation=deviation, tolerance=probe.tolerance, reason=reason,
                )
            )  # fmt: skip
    return tuple(results)


__all__ = ["probe_run"]
