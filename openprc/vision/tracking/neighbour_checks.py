"""What the neighbours say of the points found in a frame, and what is done about it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from openprc.vision.tracking.consistency import out_of_line, out_of_place
from openprc.vision.tracking.frame_search import FrameSearch
from openprc.vision.tracking.point_state import gradients, warps_at
from openprc.vision.tracking.reacquisition import along_with_neighbours

#: A point that correlates less than this is held to its place among its neighbours.
_FAINT = 0.97
#: One that correlates less than this, or has lost this many times what it usually lacks and
#: more, is not believed without agreement of its neighbours.
_DOUBTFUL = 0.85
_SUDDEN, _SUDDEN_LOSS = 6.0, 0.008


def check_steps(
    search: FrameSearch, before: NDArray[np.float64], neighbours: NDArray[np.intp]
) -> NDArray[np.bool_]:
    """Look where the neighbours of suspects lead to; return which are found to drift."""
    state = search.state
    drifted = np.zeros(len(state.reference), bool)
    suspects = out_of_line(
        before,
        search.warps[:, :2],
        search.found & state.tracked,
        neighbours,
        allowance=search.config.consistency,
    )
    if not len(suspects):
        return drifted
    others = search.found.copy()
    others[suspects] = False
    motion = along_with_neighbours(
        suspects, before[suspects], before, search.warps[:, :2], others, neighbours
    )
    own = search.warps[suspects, :2]
    away = np.linalg.norm(own - motion.positions, axis=1)
    with np.errstate(invalid="ignore"):
        odd = away > np.maximum(3 * motion.spread, search.config.consistency)
    suspects, own, away = suspects[odd], own[odd], away[odd]
    if not len(suspects):
        return drifted
    guess = warps_at(
        motion.positions[odd], motion.gradients[odd] @ gradients(state.warps[suspects])
    )
    templates = state.template[suspects]
    there = search.correlator.refine(search.image, templates, guess)
    matches = search.acceptable(there, guess)
    matches &= there.zncc >= 0.9 * search.quality[suspects]
    elsewhere = np.linalg.norm(there.positions - own, axis=1) > 0.5
    moved = matches & elsewhere
    search.keep(suspects[moved], there, moved, templates[moved])
    # A match elsewhere than the neighbours' is believed where Lucas-Kanade led to it.
    astray = ~matches & ~search.led[suspects]
    search.found[suspects[astray]] = False
    drifted[suspects[astray]] = True
    return drifted


def check_places(search: FrameSearch, neighbours: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return which points have slid away from their place among their neighbours (N,).

    Only of points whose correlation is low, because of noise or because something is in
    the way: they may slide by steps that are too small to be noticed one by one.
    """
    state = search.state
    drifted = np.zeros(len(state.reference), bool)
    with np.errstate(invalid="ignore"):
        # A fall that comes suddenly is rather something in the way than wear.
        fallen = 1.0 - search.quality > _SUDDEN * (1.0 - state.usual) + _SUDDEN_LOSS
        doubtful = (search.quality < _DOUBTFUL) | fallen
        faint = np.flatnonzero(search.found & ((search.quality < _FAINT) | fallen))
    if len(faint):
        slid = faint[
            out_of_place(
                faint,
                state.reference,
                search.warps[:, :2],
                (gradients(search.warps) @ state.base)[faint],
                search.found,
                neighbours,
                doubtful=doubtful[faint],
            )
        ]
        search.found[slid] = False
        drifted[slid] = True
    return drifted
