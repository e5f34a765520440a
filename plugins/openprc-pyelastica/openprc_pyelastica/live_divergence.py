"""Noticing, while it happens, that a simulation blew up."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from openprc.errors import Diverged
from openprc_pyelastica.divergence import MAX_STRETCH
from openprc_pyelastica.recorded_systems import Body
from openprc_pyelastica.track import Track
from openprc_pyelastica.wave_speeds import RodLimits, of_rod

#: A node this many times faster than waves along its rod, as seen from the rod.
MAX_WAVE_RATIO = 10.0
MOTION = ("position_collection", "velocity_collection")


@dataclass(frozen=True)
class Hit:
    """The first row that cannot be true."""

    row: int
    body: Body
    time: float
    reason: str
    limits: RodLimits | None

    def error(self, kept: int) -> Diverged:
        """Return what is raised."""
        fix = "run again with a shorter time step"
        if self.limits is not None:
            fix += f": for this rod below {self.limits.step:.3g} s ({self.limits.text()})"
        return Diverged(
            f"{self.body.name} diverged by t = {self.time:.6g} s: {self.reason}",
            expected="finite numbers, and elements of about their rest length",
            fix=f"{fix}; the {kept} frames before are in the partial file",
            key="dt",
        )


class Guard:
    """Looks at blocks of frames before they are written."""

    def __init__(self, max_stretch: float = MAX_STRETCH) -> None:
        self.max_stretch = max_stretch
        self._rest: dict[str, NDArray[np.float64]] = {}
        self._limits: dict[str, RodLimits | None] = {}

    def watch(self, bodies: Sequence[Body]) -> None:
        """Take the rest lengths and wave speeds of the rods."""
        for body in bodies:
            self._limits[body.name] = of_rod(body.system) if body.is_rod else None
            if body.is_rod:
                self._rest[body.name] = np.array(body.system.rest_lengths, dtype=np.float64)

    def find(
        self, tracks: Sequence[Track], rows: int, *, lengths: Mapping[str, NDArray[np.float64]]
    ) -> Hit | None:
        """Return the first of the first `rows` frames that cannot be true.

        `lengths` are those of the elements, (rows, E) for each rod.
        """
        hits: list[Hit] = []
        with np.errstate(over="ignore", invalid="ignore"):
            for track in tracks:
                for search in (self._not_finite, self._stretched, self._too_fast):
                    found = search(track, rows, lengths.get(track.body.name))
                    if found is not None:
                        row, reason = found
                        limits = self._limits[track.body.name]
                        time = float(track.times[row])
                        hits.append(Hit(row, track.body, time, reason, limits))
        return min(hits, key=lambda hit: hit.row) if hits else None

    def _not_finite(
        self, track: Track, rows: int, _lengths: NDArray[np.float64] | None
    ) -> tuple[int, str] | None:
        bad = np.zeros(rows, dtype=bool)
        for name in MOTION:
            values = track.blocks[name][:rows]
            # A finite sum has finite terms, and takes a tenth of the time of looking at each.
            if not math.isfinite(values.sum()):
                bad |= ~np.isfinite(values).all(axis=(1, 2))
        return (int(np.argmax(bad)), "numbers that are not finite") if bad.any() else None

    def _stretched(
        self, track: Track, rows: int, lengths: NDArray[np.float64] | None
    ) -> tuple[int, str] | None:
        if lengths is None:
            return None
        rest = self._rest[track.body.name]
        if lengths.max() <= self.max_stretch * rest.min():
            return None
        stretch = (lengths / rest).max(axis=1)
        wild = np.flatnonzero(stretch > self.max_stretch)
        if not len(wild):
            return None
        return int(wild[0]), f"an element {stretch[wild[0]]:.3g} times its rest length"

    def _too_fast(
        self, track: Track, rows: int, _lengths: NDArray[np.float64] | None
    ) -> tuple[int, str] | None:
        limits = self._limits[track.body.name]
        if limits is None:
            return None
        velocities = track.blocks["velocity_collection"][:rows]
        most = MAX_WAVE_RATIO * limits.stretch_speed
        if 4.0 * max(velocities.max(), -velocities.min()) <= most:
            return None
        seen = velocities - velocities.mean(axis=2, keepdims=True)
        ratio = np.sqrt((seen**2).sum(axis=1)).max(axis=1) / limits.stretch_speed
        wild = np.flatnonzero(ratio > MAX_WAVE_RATIO)
        if not len(wild):
            return None
        return int(wild[0]), f"a node {ratio[wild[0]]:.3g} times as fast as waves along the rod"
