"""One rod's record, cleaned: one clock, nodes last but one, and every oddity noted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from openprc.errors import SchemaError
from openprc_pyelastica import axes as axes_
from openprc_pyelastica.clock import Clock
from openprc_pyelastica.containers import Entries
from openprc_pyelastica.long_runs import element_lengths
from openprc_pyelastica.quantities import QUANTITIES, WHOLE_ROD_UNITS

#: Lengths over dilatations are rest lengths; how much they may vary over time.
REST_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Series:
    """A stored quantity beyond positions and velocities.

    Parameters
    ----------
    values : (T', ...) or (...)
        Components last. T' is T, or T - 1 when the quantity was not stored at the start.
    unit : str
    first_frame : int or None
        Frame of ``values[0]``, None for what is not on the clock of the rod, constants mostly.
    half_step : bool
        Whether the values belong to half a step before the time of the frame.
    """

    values: NDArray[np.float64]
    unit: str
    first_frame: int | None
    half_step: bool = False


@dataclass(frozen=True)
class Rod:
    """One rod, rigid body or point of a recording.

    Parameters
    ----------
    name : str
    time : (T,) [s]
    positions : (T, N, 3) [m]
    velocities : (T, N, 3) [m/s], optional
    bars : (E, 2)
        Neighbouring nodes; a ring closes with (N - 1, 0).
    rest_length : (E,) [m]
    rest_source : str
        Where `rest_length` comes from, in words.
    mass : (N,) [kg], optional
    extras : mapping of str to Series
    notes : tuple of str
    """

    name: str
    time: NDArray[np.float64]
    positions: NDArray[np.float64]
    velocities: NDArray[np.float64] | None
    bars: NDArray[np.int64]
    rest_length: NDArray[np.float64]
    rest_source: str
    mass: NDArray[np.float64] | None = None
    extras: Mapping[str, Series] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return int(self.positions.shape[1])

    @cached_property
    def lengths(self) -> NDArray[np.float64]:
        """Lengths of the bars, from the positions: (T, E) [m]."""
        with np.errstate(over="ignore", invalid="ignore"):
            return element_lengths(self.positions, self.bars)


def build(
    name: str,
    slots: Mapping[str, str],
    extras: Sequence[str],
    entries: Entries,
    *,
    clock: Clock,
    axes: str,
) -> Rod:
    """Put one rod together.

    Parameters
    ----------
    name : str
        Name of the rod, as the nodes will be labelled.
    slots : mapping of canonical name to key
    extras : sequence of keys
        Keys of this rod without a canonical name.
    entries : mapping of key to array
    clock : Clock
        The samples to keep and their times.
    axes : {"auto", "3n", "n3"}

    Raises
    ------
    SchemaError, ConfigError
        The arrays do not make a rod, or do not say which axis holds the nodes.
    """
    notes: list[str] = []
    arrays = {quantity: entries[key] for quantity, key in slots.items()}
    position = arrays["position"]
    if position.ndim == 2:
        layout: axes_.Layout = "n3"
        arrays["position"] = position = position[:, np.newaxis, :]
        notes.append(f"{name}: {slots['position']} is a single point, one node without bars")
    else:
        layout, reason = axes_.decide(arrays, axes=axes, key=slots["position"])
        if reason:
            notes.append(f"{name}: {reason}")
    positions = clock.frames(axes_.nodes_last(position, layout), key=slots["position"])
    if position.dtype.itemsize < 8:
        notes.append(
            f"{name}: positions were stored in {position.dtype}; small motions are rounded"
        )
    n_nodes = positions.shape[1]
    series = {
        quantity: _series(quantity, array, slots[quantity], clock=clock, layout=layout)
        for quantity, array in arrays.items()
        if quantity not in ("position", "time", "step")
    }
    velocities = _velocities(series, positions)
    series |= {key: loose(entries[key], key, clock=clock) for key in extras}
    notes += [f"{name}: {remark}" for remark in remarks(series)]
    bars = _bars(n_nodes, series)
    rest, source = _rest_length(positions, bars, series)
    mass = _mass(series, n_nodes)
    return Rod(
        name, clock.time, positions, velocities, bars, rest, source, mass, series, tuple(notes)
    )


def _series(
    quantity: str,
    array: NDArray[np.generic],
    key: str,
    *,
    clock: Clock,
    layout: axes_.Layout,
) -> Series:
    info = QUANTITIES[quantity]
    if array.ndim == 2 + info.rank and clock.fits(len(array)):
        ordered = axes_.canonical_order(array, layout, rank=info.rank)
        values, first = clock.align(ordered, key=key)
        return Series(values, info.unit, first, info.half_step)
    if array.ndim == 1 and info.rank == 0:
        # One number for each node or element; there can be T of them by chance.
        return Series(array.astype(np.float64), info.unit, None, info.half_step)
    return replace(loose(array, key, clock=clock), unit=info.unit, half_step=info.half_step)


def loose(array: NDArray[np.generic], key: str, *, clock: Clock) -> Series:
    """Return an array of unknown meaning, on the clock when its length fits."""
    values = array.astype(np.float64)
    unit = WHOLE_ROD_UNITS.get(key.rsplit("/", 1)[-1].lower(), "arb")
    if values.ndim and clock.fits(len(values)):
        aligned, first = clock.align(values, key=key)
        return Series(aligned, unit, first)
    return Series(values, unit, None)


def remarks(series: Mapping[str, Series]) -> list[str]:
    """Say which of the quantities do not begin with the first frame."""
    late = sorted(key for key, item in series.items() if item.first_frame == 1)
    if not late:
        return []
    return [
        f"{', '.join(late)}: one sample fewer than there are times; taken as not stored at the "
        "first frame"
    ]


def _velocities(
    series: dict[str, Series], positions: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    item = series.get("velocity")
    if item is None or item.first_frame != 0:
        return None
    values = item.values[:, np.newaxis] if item.values.ndim == 2 else item.values
    if values.shape != positions.shape:
        return None
    del series["velocity"]
    return values


def _bars(n_nodes: int, series: Mapping[str, Series]) -> NDArray[np.int64]:
    first = np.arange(n_nodes - 1, dtype=np.int64)
    bars = np.stack([first, first + 1], axis=1)
    if n_nodes > 2 and n_nodes in (_count(series, "element"), _count(series, "joint")):
        bars = np.concatenate([bars, np.array([[n_nodes - 1, 0]])])
    return bars


def _count(series: Mapping[str, Series], place: str) -> int | None:
    """Return how many elements, or joints between them, there are; as many as nodes in a ring."""
    for quantity, item in series.items():
        info = QUANTITIES.get(quantity)
        on_clock = item.first_frame is not None or (info is not None and info.rank == 0)
        if info and info.place == place and on_clock and item.values.ndim > info.rank:
            return int(item.values.shape[-1 - info.rank])
    return None


def _rest_length(
    positions: NDArray[np.float64], bars: NDArray[np.int64], series: Mapping[str, Series]
) -> tuple[NDArray[np.float64], str]:
    first = np.linalg.norm(positions[0, bars[:, 1]] - positions[0, bars[:, 0]], axis=1)
    stored = series.get("rest_lengths")
    if stored is not None and stored.values.shape[-1:] == first.shape:
        values = np.atleast_2d(stored.values)
        if np.ptp(values, axis=0).max(initial=0.0) == 0.0:
            return values[0], "the stored rest lengths"
    lengths, dilatation = series.get("lengths"), series.get("dilatation")
    if (
        lengths is not None
        and dilatation is not None
        and lengths.values.shape == dilatation.values.shape
        and lengths.values.shape[1:] == first.shape
    ):
        # lengths = dilatation * rest length, and both are of the same half step.
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = lengths.values / dilatation.values
        rest = np.median(ratio, axis=0)
        if np.all(np.abs(ratio - rest) <= REST_TOLERANCE * rest):
            return rest, "stored lengths over stored dilatations"
    return first, "the first frame"


def _mass(series: dict[str, Series], n_nodes: int) -> NDArray[np.float64] | None:
    item = series.get("mass")
    if item is None or item.values.shape[-1:] != (n_nodes,):
        return None
    values = np.atleast_2d(item.values)
    if values.ndim != 2 or np.ptp(values, axis=0).max() > 0.0 or not np.all(values > 0.0):
        return None
    del series["mass"]
    mass: NDArray[np.float64] = values[0]
    return mass


def check_common_clock(rods: Sequence[Rod]) -> None:
    """Refuse rods that were sampled at different times.

    Raises
    ------
    SchemaError
        Naming the rods that differ.
    """
    first = rods[0]
    for other in rods[1:]:
        if not np.array_equal(first.time, other.time):
            raise SchemaError(
                f"rod {other.name} has {len(other.time)} samples up to t = {other.time[-1]:.6g} s, "
                f"rod {first.name} {len(first.time)} up to t = {first.time[-1]:.6g} s",
                expected="one clock for all rods of a file",
                fix=f"import them one at a time: rods={first.name}, then rods={other.name}",
                key="rods",
            )
