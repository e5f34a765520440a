"""Back to the templates of the reference frame where possible, to new ones where due."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from openprc.vision.tracking import key_templates
from openprc.vision.tracking.config import KLTConfig
from openprc.vision.tracking.correlation import Correlator, PreparedImage
from openprc.vision.tracking.point_state import FRESH, PointState, gradients, warps_at

#: Frames between two looks back to the template of the reference frame.
_LOOK_BACK = 5


def renew_templates(
    state: PointState,
    correlator: Correlator,
    image: PreparedImage,
    neighbours: NDArray[np.intp],
    *,
    index: int,
    config: KLTConfig,
) -> None:
    """Go back to the reference frame's templates where possible, cut new ones where due."""
    deformation = gradients(state.warps) @ state.base
    back = np.flatnonzero(state.tracked & (state.depth > 0))
    back = back[(index + back) % _LOOK_BACK == 0]
    if len(back):
        guess = warps_at(state.warps[back, :2], deformation[back])
        first = correlator.refine(image, state.first_template[back], guess)
        near = np.linalg.norm(first.positions - guess[:, :2], axis=1) <= config.max_offset
        good = first.accepted & near
        rows = back[good]
        state.warps[rows] = first.warps[good]
        state.quality[rows], state.sigma[rows] = first.zncc[good], first.sigma[good]
        state.template[rows] = state.first_template[rows]
        state.depth[rows], state.base[rows] = 0, np.eye(2)
        state.base_sigma[rows] = 0.0
        state.forget(rows)
    settled = state.tracked & (state.age >= FRESH)
    due = np.flatnonzero(
        settled
        & key_templates.worn(
            state.usual,
            state.fresh,
            gradients(state.warps),
            neighbours,
            settled,
            config=config,
        )
    )
    if not len(due):
        return
    new = correlator.add_templates(image, state.warps[due, :2])
    due, new = due[new >= 0], new[new >= 0]
    state.base[due] = deformation[due]
    state.base_sigma[due] = np.hypot(state.base_sigma[due], state.sigma[due])
    state.warps[due, 2:] = 0.0
    state.template[due] = new
    state.depth[due] += 1
    state.forget(due)
