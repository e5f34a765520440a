"""Noticing, while it happens, that a simulation blew up."""

from __future__ import annotations

import math
from collections.abc import Sequence
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

    def find(self, tracks: Sequence[Track], rows: int) -> Hit | None:
        """Return the first of the first `rows` frames that cannot be true."""
        hits = [hit for track in tracks if (hit := self._of(track, rows))]
        return min(hits, key=lambda hit: hit.row) if hits else None

    def _of(self, track: Track, rows: int) -> Hit | None:
        body = track.body
        positions = track.blocks["position_collection"][:rows]
        velocities = track.blocks["velocity_collection"][:rows]
        limits = self._limits.get(body.name)

        def hit(row: int, reason: str) -> Hit:
            return Hit(row, body, float(track.times[row]), reason, limits)

        found: list[Hit] = []
        with np.errstate(over="ignore", invalid="ignore"):
            finite = np.isfinite(positions).all(axis=(1, 2)) & np.isfinite(velocities).all(
                axis=(1, 2)
            )
            if not finite.all():
                found.append(hit(int(np.argmin(finite)), "numbers that are not finite"))
            if body.is_rod:
                ends = body.bars.T
                arms = positions[:, :, ends[1]] - positions[:, :, ends[0]]
                stretch = (np.sqrt((arms**2).sum(axis=1)) / self._rest[body.name]).max(axis=1)
                wild = np.flatnonzero(stretch > self.max_stretch)
                if len(wild):
                    row = int(wild[0])
                    found.append(hit(row, f"an element {stretch[row]:.3g} times its rest length"))
            if limits is not None and math.isfinite(limits.stretch_speed):
                seen = velocities - velocities.mean(axis=2, keepdims=True)
                ratio = np.sqrt((seen**2).sum(axis=1)).max(axis=1) / limits.stretch_speed
                wild = np.flatnonzero(ratio > MAX_WAVE_RATIO)
                if len(wild):
                    row = int(wild[0])
                    found.append(
                        hit(row, f"a node {ratio[row]:.3g} times as fast as waves along the rod")
                    )
        return min(found, key=lambda item: item.row) if found else None
