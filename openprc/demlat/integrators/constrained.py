"""What schemes for rigid elements share: how they fail, and what they say then.

A scheme's class says ``can_fail = constrained = True``. Between two steps it leaves the factor
at the state's positions and velocities that keep the constraints; see
`openprc.demlat.models.barhinge.rigid_elements`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from openprc.demlat.compiled.jit import chosen_by_type
from openprc.demlat.integrators import stepping
from openprc.demlat.models.barhinge.rigid_elements import FAILED_ROW, RESIDUAL, failed_row
from openprc.errors import Diverged

if TYPE_CHECKING:
    from openprc.demlat.models.barhinge.assembly import Assembly
    from openprc.schema.experiment import Experiment


@chosen_by_type(stepping.failed)
def _failed(scheme, body):
    if not getattr(scheme.instance_class, "constrained", False):
        return None
    return lambda scheme, body: failed_row(body) >= 0


def unsatisfied(experiment: Experiment, assembly: Assembly, time: float) -> Diverged:
    """Return the error that names the element which could not be kept rigid; `time` in [s]."""
    rigid: Any = assembly.body.constraints
    row, residual = int(rigid.status[FAILED_ROW]), float(rigid.status[RESIDUAL])
    if row < len(assembly.rigid.system.names):  # type: ignore[union-attr]
        name, unit = assembly.rigid.system.names[row], "of its length"  # type: ignore[union-attr]
    else:
        hinge = int(rigid.stop[row - rigid.row_element.size])
        name, unit = f"the stop of hinge {hinge}", "rad"
    if name.startswith("hinge"):
        unit = "rad"
    left = (
        f"{residual:.3g} {unit} is left" if math.isfinite(residual) else "no number is left of it"
    )
    return Diverged(
        f"{name} could not be kept rigid by t = {time:.6g} s: {left}",
        expected=f"at most {rigid.tolerance:.3g}, relative to lengths or in rad",
        fix=f"use a smaller dt: it is {experiment.dt:g} s; where elements lock each other, or are"
        " pulled apart by driven nodes, make one of them elastic",
        key="simulation.dt",
    )
