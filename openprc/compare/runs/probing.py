"""What is asked of a single run: numbers that are known of its scene, and its energy."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from openprc.compare.report import ProbeResult
from openprc.errors import OpenPRCError
from openprc.schema.trajectory import Trajectory

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.scenes.scene import Scene

    Reals = NDArray[np.float64]

_SAMPLES = 1000


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


def energy_over_time(path: Path) -> tuple[Reals, Reals] | None:
    """Return times [s] and the total energy less that of the first frame [J], thinned.

    None where the run did not record one.
    """
    with Trajectory(path) as run:
        if "total_energy" not in run.systems or run.time_kind != "physical":
            return None
        step = -(-run.n_frames // _SAMPLES)
        energy = run.system("total_energy", unit="J")[::step]
        return run.time[::step], energy - energy[0]


__all__ = ["energy_over_time", "probe_run"]
