"""The default tracker: Lucas-Kanade leads, a template of the reference frame decides.

Every position is the best match of the point's surroundings in the reference frame, so errors do
not add up; Lucas-Kanade, the neighbours and the point's own motion only say where to begin.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from openprc.vision.tracking.config import KLTConfig
from openprc.vision.tracking.correlation import Correlator, estimate_noise
from openprc.vision.tracking.frame_search import FrameSearch
from openprc.vision.tracking.local_motion import neighbour_table
from openprc.vision.tracking.neighbour_checks import check_places, check_steps
from openprc.vision.tracking.point_state import PointState, gradients, warps_at
from openprc.vision.tracking.predictor import PyramidalKLT, Step
from openprc.vision.tracking.reacquisition import along_with_neighbours, carry
from openprc.vision.tracking.status import Status
from openprc.vision.tracking.template_renewal import renew_templates
from openprc.vision.tracking.track_steps import FrameTracks
from openprc.vision.tracking.wide_search import whole_shift, wide_search

if TYPE_CHECKING:
    from openprc.vision.source.frame import Frame

#: Quality, compared with the usual, and distance [px] from where Lucas-Kanade leads, of points that
#: need not be followed back.
_AS_EVER, _RIGHT_THERE = 0.98, 1.0
#: A lost point must match this well, compared with what it usually does.
_RETURN_QUALITY = 0.85
#: Frames for which a lost point is taken to go on as it did.
_COASTING = 10
#: Lost points for which a larger surrounding is searched in one frame.
_WIDE_AT_ONCE = 16


class RefinedTracks:
    """Follows points by matching them with templates."""

    def __init__(self, config: KLTConfig) -> None:
        self.config = config
        self.notes: tuple[str, ...] = ()
        self.noise = float("nan")
        self._klt = PyramidalKLT(config)
        self._correlator = Correlator(config.refinement)

    def place(self, frame: Frame, points: NDArray[np.float64]) -> FrameTracks:
        """Cut a template around each of `points` (N, 2) [px] in the reference frame."""
        image = self._correlator.prepare(frame.intensity)
        self.noise = estimate_noise(frame.intensity)
        state = self._state = PointState(points, self._correlator.add_templates(image, points))
        self._neighbours = neighbour_table(points, self.config.neighbours)
        self._last_step = 0.0
        self._before = self._reference = frame.grey
        without = ~state.tracked
        edge = without & self._beyond_edge(points, frame.grey.shape)
        state.status[edge] = Status.OOB
        self._note_refused(int(edge.sum()), int((without & ~edge).sum()))
        self._last = self._tracks(frame)
        return self._last

    def step(self, frame: Frame) -> FrameTracks:
        """Find all points in the next frame."""
        if frame.duplicate:
            return self._repeat(frame)
        state = self._state
        image = self._correlator.prepare(frame.intensity)
        search = FrameSearch(self._correlator, image, state, self.config)
        before = state.warps[:, :2].copy()
        live = np.flatnonzero(state.tracked)
        drifted = self._follow(search, frame, live)
        lost = np.flatnonzero(~search.found & (state.first_template >= 0))
        if len(lost):
            carry(state, lost, before, search.warps[:, :2], search.found, self._neighbours)
            if self.config.reacquire:
                self._reacquire(search, frame.grey, lost, frame.index)
            else:
                search.found &= state.tracked
        drifted |= check_steps(search, before, self._neighbours)
        drifted |= check_places(search, self._neighbours)
        self._commit(search, before, drifted, frame)
        renew_templates(
            state,
            self._correlator,
            image,
            self._neighbours,
            index=frame.index,
            config=self.config,
        )
        self._before = frame.grey
        self._last = self._tracks(frame)
        return self._last

    def _follow(
        self, search: FrameSearch, frame: Frame, live: NDArray[np.intp]
    ) -> NDArray[np.bool_]:
        """Find the points seen in the last frame; return which failed the way back (N,)."""
        state = self._state
        everyone = len(live)
        self._follow_plainly(search, frame, live)
        live = live[~search.found[live]]
        start = state.warps[live, :2]
        step = self._klt.step(self._before, frame.grey, start, last_step=self._last_step)
        trusted = step.fb_error <= self.config.fb_threshold
        if np.count_nonzero(~trusted) > everyone / 2:
            # Most went astray: a jolt, for which the pyramid was too low, or any pyramid is.
            for shift in (np.zeros(2), whole_shift(self._before, frame.grey)):
                step = self._second_try(frame, start, step, trusted, shift)
                trusted = step.fb_error <= self.config.fb_threshold
        guess = state.warps[live]
        guess[:, :2] = step.positions
        search.attempt(live[trusted], guess[trusted], steps_from=start[trusted])
        search.led = search.found.copy()
        # Those that failed are looked for where the neighbours lead to, then where the
        # doubtful Lucas-Kanade led to, then where their own motion would have led to.
        for attempt in ("neighbours", "doubtful", "coasting"):
            rest = np.flatnonzero(~search.found[live])
            if not len(rest):
                break
            points, was = live[rest], start[rest]
            again = state.warps[points]
            if attempt == "neighbours":
                motion = along_with_neighbours(
                    points,
                    was,
                    state.warps[:, :2],
                    search.warps[:, :2],
                    search.found,
                    self._neighbours,
                )
                turned = motion.gradients @ gradients(again)
                again = warps_at(motion.positions, turned)
            elif attempt == "doubtful":
                again[:, :2] = step.positions[rest]
            else:
                again[:, :2] = was + state.velocity[points]
            floor = _RETURN_QUALITY * np.nan_to_num(state.usual[points])
            search.attempt(points, again, floor=floor, steps_from=was)
        drifted = np.zeros(len(state.reference), bool)
        drifted[live] = step.found & ~trusted
        return drifted & ~search.found

    def _follow_plainly(self, search: FrameSearch, frame: Frame, live: NDArray[np.intp]) -> None:
        """Find the points (n,) that match as well as ever right where Lucas-Kanade leads.

        The match is a stricter check than the way back, which is left to all others.
        """
        state = self._state
        live = live[np.isfinite(state.usual[live])]
        if not len(live):
            return
        start = state.warps[live, :2]
        step = self._klt.step(
            self._before, frame.grey, start, last_step=self._last_step, back=False
        )
        guess = state.warps[live]
        guess[:, :2] = step.positions
        search.attempt(
            live[step.found],
            guess[step.found],
            floor=_AS_EVER * state.usual[live[step.found]],
            steps_from=start[step.found],
            within=_RIGHT_THERE,
        )

    def _second_try(
        self,
        frame: Frame,
        start: NDArray[np.float64],
        step: Step,
        trusted: NDArray[np.bool_],
        shift: NDArray[np.float64],
    ) -> Step:
        again = np.flatnonzero(~trusted)
        other = self._klt.step(
            self._before,
            frame.grey,
            start[again],
            last_step=np.inf,
            guess=start[again] + shift if shift.any() else None,
        )
        better = other.fb_error < step.fb_error[again]
        rows = again[better]
        merged = Step(*(np.copy(getattr(step, name)) for name in Step.__slots__))
        for name in Step.__slots__:
            getattr(merged, name)[rows] = getattr(other, name)[better]
        return merged

    def _reacquire(
        self,
        search: FrameSearch,
        grey: NDArray[np.uint8],
        lost: NDArray[np.intp],
        index: int,
    ) -> None:
        """Look for lost points (n,) where they are expected."""
        state = self._state
        floor = _RETURN_QUALITY * np.nan_to_num(state.usual)
        survivors = search.found.copy()
        search.attempt(lost, state.warps[lost], floor=floor[lost])
        # The other guesses in turns: a point that is hidden for long costs little.
        turn = (index + lost) % 2 == 0
        rest = lost[~search.found[lost] & (turn | (state.missed[lost] < 3))]
        if len(rest) and survivors.any():
            motion = along_with_neighbours(
                rest,
                state.reference[rest],
                state.reference,
                search.warps[:, :2],
                survivors,
                self._neighbours,
            )
            search.attempt(
                rest,
                warps_at(motion.positions, motion.gradients),
                templates=state.first_template[rest],
                floor=floor[rest],
            )
            rest = rest[~search.found[rest]]
        # A point whose neighbours have left the image has left it with them, whatever looks
        # like it inside; and nothing goes straight on for long.
        free = ~self._beyond_edge(state.warps[rest, :2], grey.shape)
        free &= state.missed[rest] < _COASTING
        if len(rest):
            coasting = state.warps[rest[free]]
            coasting[:, :2] = state.coasting[rest[free]]
            search.attempt(rest[free], coasting, floor=floor[rest[free]])
            self._search_widely(search, grey, rest[~search.found[rest]], index, floor)

    def _search_widely(
        self,
        search: FrameSearch,
        grey: NDArray[np.uint8],
        lost: NDArray[np.intp],
        index: int,
        floor: NDArray[np.float64],
    ) -> None:
        """Search a larger surrounding for some of the lost points (n,), others next time."""
        state = self._state
        if len(lost) > _WIDE_AT_ONCE:
            lost = np.roll(lost, -index * _WIDE_AT_ONCE)[:_WIDE_AT_ONCE]
        deformation = gradients(state.warps[lost]) @ state.base[lost]
        guess = wide_search(
            self._reference,
            grey,
            state.reference[lost],
            warps_at(state.warps[lost, :2], deformation),
            size=self.config.refinement.subset,
            radius=self.config.search_radius,
        )
        search.attempt(lost, guess, templates=state.first_template[lost], floor=floor[lost])

    def _commit(
        self,
        search: FrameSearch,
        before: NDArray[np.float64],
        drifted: NDArray[np.bool_],
        frame: Frame,
    ) -> None:
        """Take over what was found."""
        state, found = self._state, search.found
        steady = found & state.tracked
        state.velocity[steady] = search.warps[steady, :2] - before[steady]
        if steady.any():
            speed = np.hypot(state.velocity[steady, 0], state.velocity[steady, 1])
            self._last_step = float(np.percentile(speed, 90))
        returned = np.flatnonzero(found & (search.template != state.template))
        state.forget(returned)
        state.depth[returned] = 0
        state.base[returned], state.base_sigma[returned] = np.eye(2), 0.0
        state.template[found] = search.template[found]
        state.warps[found] = search.warps[found]
        state.coasting[found] = search.warps[found, :2]
        state.missed = np.where(found, 0, state.missed + 1)
        state.quality, state.sigma = search.quality, search.sigma
        state.learn(found)
        has_template = state.first_template >= 0
        gone = ~found & has_template
        outside = gone & self._beyond_edge(state.warps[:, :2], frame.grey.shape)
        code = np.where(drifted, Status.DRIFT, Status.LOST)
        kept = (state.status == Status.DRIFT) & ~state.tracked
        code = np.where(kept, Status.DRIFT, code)
        state.status[gone] = code[gone]
        state.status[outside] = Status.OOB
        state.status[found] = Status.TRACKED
        state.tracked = found

    def _beyond_edge(
        self, points: NDArray[np.float64], shape: tuple[int, ...]
    ) -> NDArray[np.bool_]:
        """Return for which points (N, 2) the subset leaves the image."""
        half = self.config.refinement.subset // 2
        x, y = points[:, 0], points[:, 1]
        fits = (x >= half) & (x <= shape[1] - 1 - half) & (y >= half) & (y <= shape[0] - 1 - half)
        beyond: NDArray[np.bool_] = ~fits
        return beyond

    def _note_refused(self, at_edge: int, flat: int) -> None:
        n, size = len(self._state.reference), self.config.refinement.subset
        notes = []
        if at_edge:
            notes.append(
                f"{at_edge} of {n} points lie so near the edge of the reference frame that "
                f"their subset of {size} px leaves it; they are not followed (status OOB)"
            )
        if flat:
            notes.append(
                f"{flat} of {n} points lie where the reference frame shows no texture within "
                f"{size} px; they are not followed (status LOST)"
            )
        self.notes = (*self.notes, *notes)

    def _repeat(self, frame: Frame) -> FrameTracks:
        """Say of a frame equal to the last what was said of that."""
        status = self._last.status.copy()
        status[status == Status.REFERENCE] = Status.TRACKED
        return replace(
            self._last, index=frame.index, stamp=frame.stamp, duplicate=True, status=status
        )

    def _tracks(self, frame: Frame) -> FrameTracks:
        state = self._state
        seen = (state.status == Status.TRACKED) | (state.status == Status.REFERENCE)
        deformation = gradients(state.warps) @ state.base
        sigma = np.hypot(state.sigma, state.base_sigma)
        return FrameTracks(
            index=frame.index,
            stamp=frame.stamp,
            duplicate=frame.duplicate,
            positions=np.where(seen[:, None], state.warps[:, :2], np.nan),
            status=state.status.copy(),
            quality=np.where(seen, state.quality, np.nan).astype(np.float32),
            sigma=np.where(seen[:, None], sigma, np.nan).astype(np.float32),
            template=state.depth.copy(),
            deformation=np.where(seen[:, None, None], deformation, np.nan).astype(np.float32),
        )
