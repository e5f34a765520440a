"""A run of a scene held against what is known about the scene."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from openprc.scenes.scene import Probe, Scene
    from openprc.schema.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class ProbeResult:
    """What a run says about a probe.

    Parameters
    ----------
    probe : Probe
    measured : float
    deviation : float
        ``|measured / value - 1|``, or ``|measured|`` where the value is 0.
    ok : bool
        Whether that is within the tolerance; what is no number is not.
    """

    probe: Probe
    measured: float
    deviation: float
    ok: bool

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        return {
            "name": self.probe.name,
            "expected": self.probe.value,
            "unit": self.probe.unit,
            "measured": self.measured,
            "deviation": self.deviation,
            "tolerance": self.probe.tolerance,
            "source": self.probe.source,
            "ok": self.ok,
        }


def verify_scene(scene: Scene, trajectory: Trajectory) -> list[ProbeResult]:
    """Return what a run of `scene` says about each of its probes.

    Raises
    ------
    MissingData
        When the run does not have the nodes of the scene, or is too short.
    """
    return [_result(probe, probe.measure(trajectory)) for probe in scene.reference.probes]


def _result(probe: Probe, measured: float) -> ProbeResult:
    apart = abs(measured - probe.value) / (abs(probe.value) if probe.value else 1.0)
    ok = math.isfinite(apart) and apart <= probe.tolerance
    return ProbeResult(probe=probe, measured=measured, deviation=apart, ok=ok)
