"""From two open files to their `PairComparison`: aligned first, then read once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from openprc.compare.alignment.clocks import ClockPair, clock_pair
from openprc.compare.alignment.common_clock import CommonClock, common_clock
from openprc.compare.alignment.coordinates import CommonSpace, Coordinates, common_space
from openprc.compare.alignment.frame_reading import FrameReader
from openprc.compare.alignment.interpolation_error import InterpolationError, choose_interpolant
from openprc.compare.alignment.node_matching import NodeMatch, match_nodes
from openprc.compare.alignment.paired_frames import PairedFrames, SampledFile, refuse_too_large
from openprc.compare.alignment.rigid_motion import RigidMotion, fit_rigid_motion
from openprc.compare.alignment.time_shift import TimeShift, estimate_shift
from openprc.compare.deviations.drives import compare_drives
from openprc.compare.deviations.energies import pair_energies
from openprc.compare.deviations.example_traces import worst_traces
from openprc.compare.deviations.pair_sums import PairSums, speed_reader
from openprc.compare.pair_comparison import PairComparison
from openprc.errors import ConfigError, MissingData
from openprc.schema import units

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.compare.alignment.settings import AlignmentSettings
    from openprc.hooks.protocols import Progress
    from openprc.schema.trajectory import Trajectory

    Reals = NDArray[np.float64]

REST = "/topology/nodes/rest"
#: Instants that are looked at for one that shows most nodes.
LOOKED_AT = 50
#: The interpolant is mentioned where its error is above this share of the deviation.
NOT_SMALL = 0.1


def compare_pair(
    reference: Trajectory,
    other: Trajectory,
    *,
    name: str,
    settings: AlignmentSettings,
    progress: Progress,
) -> PairComparison:
    """Compare one file with the reference.

    Raises
    ------
    OpenPRCError
        Where they cannot be compared; see `compare_files`.
    """
    progress(0.0, f"{name}: matching")
    space = common_space(reference, other, settings=settings)
    clocks = clock_pair(reference, other, settings=settings)
    files = (reference.path, other.path)
    notes = [*space.notes, *clocks.notes]
    estimated = settings.time_shift == "estimate"
    shift = TimeShift(0.0) if estimated else TimeShift(float(settings.time_shift))  # type: ignore[arg-type]
    clock: CommonClock | None = None
    if not estimated:
        clock = _common(clocks, shift.shift, settings, files)
    match = match_nodes(
        reference, other, _places(reference, other, space, clock, settings), settings=settings
    )
    notes += match.notes
    if estimated:
        _refuse_no_time(clocks, other)
        readers = tuple(
            FrameReader(t, c, nodes=n, filled=settings.filled)
            for t, c, n in (
                (reference, space.reference, match.reference),
                (other, space.other, match.other),
            )
        )
        shift = estimate_shift(
            (clocks.reference, clocks.other),
            (readers[0], readers[1]),
            turning=settings.rigid_motion != "none",
            most=settings.max_shift,
        )
        notes += shift.notes
    clock = clock or _common(clocks, shift.shift, settings, files)
    pair, interpolation = _paired(reference, other, space, match, clock, settings, clocks)
    if interpolation is not None:
        notes += interpolation.notes
    motion = _motion(pair, settings, progress, name)
    if motion is not None:
        pair = pair.moved(motion)
        notes += motion.notes
    if settings.quantity == "displacements":
        pair.offset = _offset(pair)
    drive = compare_drives(reference, other, clock)
    if drive.verdict in ("different", "scaled", "missing"):
        notes.append(f"drive: {drive.text}")
    found = PairSums(reference, pair, match, space, clocks, settings)
    found.read(progress, name)
    errors = found.errors.result()
    refuse_too_large(errors.rms, pair)
    notes += found.notes
    notes += _about(errors.rms, errors.displacement, interpolation, space.unit)
    if errors.n_missing:
        share = errors.n_missing / (errors.n_missing + errors.n_compared)
        notes.append(f"{errors.n_missing} pairs of places ({share:.2%}) are missing and left out")
    label = match.labels[errors.largest_node]
    energy = None
    if settings.energy and clocks.kind != "quantity":
        energy = pair_energies(reference, other, clock)
    return PairComparison(
        name=name,
        path=other.path,
        producer=str(other.provenance.get("producer", "")),
        unit=space.unit,
        time_unit=clocks.unit,
        clock=clocks.text,
        match=match,
        n_samples=len(clock),
        first_time=float(clock.times[0]),
        last_time=float(clock.times[-1]),
        interpolation=interpolation,
        interpolated=clock.resampled,
        transform=motion,
        shift=shift if estimated or shift.shift else None,
        errors=errors,
        largest_time=float(clock.times[errors.largest_sample]),
        times=_middles(clock.times, errors.width),
        velocity_errors=None if found.velocities is None else found.velocities.result(),
        elements=() if found.elements is None else found.elements.result(),
        spectra=found.spectrum(match.labels),
        energy=energy,
        drive=drive,
        traces=worst_traces(
            pair,
            found.overview,
            node=errors.largest_node,
            sample=errors.largest_sample,
            label=label,
        ),
        notes=tuple(dict.fromkeys([*notes, *found.notes])),
    )


def _refuse_no_time(clocks: ClockPair, other: Trajectory) -> None:
    if clocks.kind != "time":
        raise ConfigError(
            f"a time shift is to be estimated, and the clock is the {clocks.text}",
            expected="two runs in time",
            fix="leave time_shift out, or give it as a number",
            file=other.path,
            key="time_shift",
        )


def _common(
    clocks: ClockPair, shift: float, settings: AlignmentSettings, files: tuple
) -> CommonClock:
    return common_clock(
        clocks,
        shift=shift,
        onto=settings.onto,
        start=settings.start,
        stop=settings.stop,
        files=files,
    )


def _places(
    reference: Trajectory,
    other: Trajectory,
    space: CommonSpace,
    clock: CommonClock | None,
    settings: AlignmentSettings,
) -> tuple[Reals, Reals]:
    """Return places of all nodes in one state: at rest, or at an instant that shows most."""
    sides = ((reference, space.reference), (other, space.other))
    if all(trajectory.has(REST) for trajectory, _ in sides):
        rest = [_rest(trajectory, coordinates) for trajectory, coordinates in sides]
        return rest[0], rest[1]
    readers = [FrameReader(t, c, filled=settings.filled) for t, c in sides]
    if clock is None:
        return readers[0].single(0), readers[1].single(0)
    files = [
        SampledFile(reader, sampling, "linear" if len(sampling.clock) > 1 else "nearest")
        for reader, sampling in zip(readers, (clock.reference, clock.other), strict=True)
    ]
    best, most = (np.empty(0), np.empty(0)), -1
    for k in np.unique(np.linspace(0, len(clock) - 1, LOOKED_AT).round().astype(int)):
        rows = [file.rows(int(k), int(k) + 1)[0] for file in files]
        seen = sum(int(np.isfinite(places).all(axis=1).sum()) for places in rows)
        if seen > most:
            best, most = (rows[0].copy(), rows[1].copy()), seen
        if seen == len(rows[0]) + len(rows[1]):
            break
    return best


def _rest(trajectory: Trajectory, coordinates: Coordinates) -> Reals:
    ratio = units.conversion_factor(
        trajectory.unit(REST), trajectory.position_unit, file=str(trajectory.path), key=REST
    )
    return coordinates.of(trajectory.node("rest") * ratio)


def _paired(
    reference: Trajectory,
    other: Trajectory,
    space: CommonSpace,
    match: NodeMatch,
    clock: CommonClock,
    settings: AlignmentSettings,
    clocks: ClockPair,
) -> tuple[PairedFrames, InterpolationError | None]:
    files, told = [], None
    for trajectory, coordinates, nodes, sampling in (
        (reference, space.reference, match.reference, clock.reference),
        (other, space.other, match.other, clock.other),
    ):
        places = FrameReader(trajectory, coordinates, nodes=nodes, filled=settings.filled)
        if sampling.exact:
            files.append(SampledFile(places, sampling))
            continue
        speeds = speed_reader(trajectory, coordinates, nodes, clocks, settings)
        told = choose_interpolant(sampling, places, speeds, wanted=settings.interpolant)
        files.append(
            SampledFile(
                places, sampling, told.interpolant,
                speeds if told.interpolant == "hermite" else None,
            )
        )  # fmt: skip
    pair = PairedFrames(clock, files[0], files[1], block_bytes=settings.block_bytes)
    return pair, told


def _motion(
    pair: PairedFrames, settings: AlignmentSettings, progress: Progress, name: str
) -> RigidMotion | None:
    if settings.rigid_motion == "none":
        return None
    end = 1 if settings.rigid_motion == "first" else len(pair)

    def blocks():  # noqa: ANN202 - pairs of arrays
        for first, x, y in pair.blocks(0, end):
            progress(0.5 * first / len(pair), f"{name}: rigid motion")
            yield x, y

    return fit_rigid_motion(blocks(), scale=settings.scale == "fit", reflect=settings.reflect)


def _offset(pair: PairedFrames) -> Reals:
    """Return by how much the nodes of the other file are apart at the first instant."""
    x, y = pair.rows(0, 1)
    apart = y[0] - x[0]
    hidden = int((~np.isfinite(apart).all(axis=1)).sum())
    if hidden:
        raise MissingData(
            f"{hidden} nodes are not seen at the first common instant, where displacements begin",
            expected="all matched nodes",
            fix='start later, or compare quantity="positions"',
            file=pair.other.reader.trajectory.path,
            key="quantity",
        )
    return apart


def _middles(times: Reals, width: int) -> Reals:
    starts = np.arange(0, len(times), width)
    stops = np.minimum(starts + width, len(times)) - 1
    return 0.5 * (times[starts] + times[stops])


def _about(
    rms: float, displacement: float, interpolation: InterpolationError | None, unit: str
) -> list[str]:
    notes = []
    if displacement == 0.0:
        notes.append("the reference does not move: there is no relative deviation")
    if interpolation is None:
        return notes
    if interpolation.rms is None:
        notes.append(
            f"the error of the interpolant ({interpolation.text}) is not known: too few frames"
        )
    elif interpolation.rms > NOT_SMALL * rms:
        share = f"{interpolation.rms / rms:.2g} of the deviation" if rms else "all there is"
        notes.append(
            f"interpolating ({interpolation.text}) is itself wrong by about"
            f" {interpolation.rms:.2g} {unit} (rms), {share}"
        )
    return notes


__all__ = ["compare_pair"]
