"""All that is summed up while both files go by once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from openprc.compare.alignment.frame_reading import FrameReader
from openprc.compare.alignment.paired_frames import PairedFrames, SampledFile
from openprc.compare.deviations.element_errors import ElementSums
from openprc.compare.deviations.error_norms import ErrorSums
from openprc.compare.deviations.example_traces import Overview
from openprc.compare.deviations.spectra import NODES, Spectra, SpectraSums
from openprc.schema import units

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.compare.alignment.clocks import ClockPair
    from openprc.compare.alignment.coordinates import CommonSpace, Coordinates
    from openprc.compare.alignment.interpolants import Name
    from openprc.compare.alignment.node_matching import NodeMatch
    from openprc.compare.alignment.settings import AlignmentSettings
    from openprc.hooks.protocols import Progress
    from openprc.schema.trajectory import Trajectory


def speed_reader(
    trajectory: Trajectory,
    coordinates: Coordinates,
    nodes: NDArray[np.integer],
    clocks: ClockPair,
    settings: AlignmentSettings,
) -> FrameReader | None:
    """Return a reader of velocities that belong to the clock, None where there are none."""
    if coordinates.speed_factor is None or clocks.kind != "time":
        return None
    return FrameReader(
        trajectory, coordinates, nodes=nodes, filled=settings.filled, velocities=True
    )


class PairSums:
    """Deviations, and what else was asked for, of a pair.

    Parameters
    ----------
    reference : Trajectory
    pair : PairedFrames
    match : NodeMatch
    space : CommonSpace
    clocks : ClockPair
    settings : AlignmentSettings
    """

    def __init__(
        self,
        reference: Trajectory,
        pair: PairedFrames,
        match: NodeMatch,
        space: CommonSpace,
        clocks: ClockPair,
        settings: AlignmentSettings,
    ) -> None:
        self.pair = pair
        self.notes: list[str] = []
        self.errors = ErrorSums(len(pair), pair.n_nodes, settings.bins)
        self.overview = Overview(pair)
        self.elements = (
            ElementSums(reference, match, dims=pair.dims, unit=space.unit)
            if settings.elements
            else None
        )
        self.velocities: ErrorSums | None = None
        self._speeds = self._velocity_pair(settings, clocks) if settings.velocities else None
        if self._speeds is not None:
            self.velocities = ErrorSums(len(pair), pair.n_nodes, settings.bins)
        self._spectra = self._spectra_sums(clocks, settings) if settings.spectra else None

    def read(self, progress: Progress, name: str) -> None:
        """Go through all common instants."""
        for first, x, y in self.pair.blocks():
            self.errors.add(first, x, y)
            self.overview.add(first, x, y)
            if self.elements is not None:
                self.elements.add(x, y)
            if self._spectra is not None:
                self._spectra.add(first, x, y)
            if self._speeds is not None and self.velocities is not None:
                u, v = self._speeds.rows(first, first + len(x))
                if self.pair.motion is not None:
                    v = np.ascontiguousarray(self.pair.motion.turn(v))
                self.velocities.add(first, u, v)
            progress((first + len(x)) / len(self.pair), f"{name}: {first + len(x)} instants")

    def spectrum(self, labels: tuple[str, ...]) -> Spectra | None:
        """Return the spectra where there are any; say why not otherwise."""
        if self._spectra is None:
            return None
        found = self._spectra.result(labels)
        if isinstance(found, str):
            self.notes.append(found)
            return None
        self.notes += found.notes
        return found

    def _velocity_pair(self, settings: AlignmentSettings, clocks: ClockPair) -> PairedFrames | None:
        sides = []
        for file in (self.pair.reference, self.pair.other):
            reader = file.reader
            nodes = np.arange(reader.n_nodes) if reader.nodes is None else reader.nodes
            speeds = speed_reader(reader.trajectory, reader.coordinates, nodes, clocks, settings)
            if speeds is None:
                self.notes.append(
                    f"velocities are not compared: {reader.trajectory.path.name} has none that"
                    " belong to its clock and unit"
                )
                return None
            sides.append(SampledFile(speeds, file.sampling, _order_kept(file)))
        return PairedFrames(self.pair.clock, sides[0], sides[1], block_bytes=settings.block_bytes)

    def _spectra_sums(self, clocks: ClockPair, settings: AlignmentSettings) -> SpectraSums | None:
        step = self.pair.clock.step
        if clocks.kind != "time" or step is None or len(self.pair) < 8:
            why = (
                "the clock is not time"
                if clocks.kind != "time"
                else "the instants are not evenly spaced"
                if step is None and len(self.pair) >= 8
                else "there are fewer than 8 instants"
            )
            self.notes.append(f"no spectra: {why}")
            return None
        seconds = step * units.unit(clocks.unit).si_factor
        probes = np.unique(np.linspace(0, len(self.pair) - 1, 32).round().astype(int))
        seen = np.stack([self.pair.reference.rows(int(k), int(k) + 1)[0] for k in probes])
        with np.errstate(invalid="ignore"):
            spread = np.nan_to_num(np.ptp(seen, axis=0)).sum(axis=1)
        nodes = np.sort(np.argsort(spread, kind="stable")[::-1][:NODES])
        return SpectraSums(len(self.pair), seconds, nodes, self.pair.dims, settings.segment)


def _order_kept(file: SampledFile) -> Name:
    """Velocities have no derivative of their own: the cubic takes the Hermite's place."""
    if file.interpolant != "hermite":
        return file.interpolant
    return "cubic" if len(file.sampling.clock) >= 4 else "linear"


__all__ = ["PairSums", "speed_reader"]
