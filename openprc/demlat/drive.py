"""`Drive`: a signal together with the symbols that it carries."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.errors import ConfigError
from openprc.schema.experiment import INTERPOLATIONS, Interpolation, whole_multiple

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from openprc.demlat.setup import SimulationSetup

    Reals = NDArray[np.float64]

MAX_SAMPLES = 100_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Drive:
    """A signal, and the symbols behind it.

    Parameters
    ----------
    values : (T, 1) or (T, 3) [unit of what it drives]
    dt : float [s]
        Time between samples; sample k is at ``k * dt``.
    interpolation : {"linear", "hold", "cubic"}
    sequence : (K, C), optional
        The symbols before hold or interpolation, on which tasks with delays work.
    hold : float [s], optional
        How long a symbol lasts; symbol k begins at ``k * hold``.
    """

    values: NDArray[np.float64]
    dt: float
    interpolation: Interpolation = "linear"
    sequence: NDArray[np.float64] | None = None
    hold: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", signal_columns(self.values, "values"))
        if self.sequence is not None:
            object.__setattr__(self, "sequence", signal_columns(self.sequence, "sequence"))
        if self.interpolation not in INTERPOLATIONS:
            raise ConfigError(
                f"interpolation {self.interpolation!r}",
                expected="one of " + ", ".join(INTERPOLATIONS),
                key="interpolation",
            )
        if (self.sequence is None) != (self.hold is None):
            raise ConfigError(
                "a sequence without hold, or hold without a sequence",
                expected="both, or none",
                key="hold",
            )

    @property
    def duration(self) -> float:
        """How long the drive lasts [s]: every symbol when held, else up to the last sample."""
        return (len(self.values) - (self.interpolation != "hold")) * self.dt

    @property
    def times(self) -> Reals:
        """Times of the samples: (T,) [s]."""
        return np.arange(len(self.values), dtype=np.float64) * self.dt

    def add_to(self, setup: SimulationSetup, name: str, *, unit: str | None = None) -> str:
        """Add this drive to `setup` as the signal `name`, and return the name."""
        setup.add_signal(name, self, unit=unit)
        return name

    def scaled(self, factor: float) -> Drive:
        """Return this drive, and its symbols, times `factor`."""
        symbols = None if self.sequence is None else self.sequence * factor
        return replace(self, values=self.values * factor, sequence=symbols)

    def along(self, direction: ArrayLike, *, start: ArrayLike = (0.0, 0.0, 0.0)) -> Drive:
        """Return this drive in space: ``start + value * direction``, with three columns.

        Position actuators prescribe absolute coordinates, so that `start` is where the node
        is when the drive is 0. The symbols go along: they have the columns of the values.

        Raises
        ------
        ConfigError
            When the drive has three columns already.
        """
        way, origin = np.asarray(direction, dtype="f8"), np.asarray(start, dtype="f8")
        if way.shape != (3,) or origin.shape != (3,) or self.values.shape[1] != 1:
            raise ConfigError(
                f"a direction {way.shape} and a start {origin.shape}"
                f" for a drive of {self.values.shape[1]} column(s)",
                expected="three numbers each, and one column",
                key="direction",
            )
        symbols = None if self.sequence is None else origin + self.sequence * way
        return replace(self, values=origin + self.values * way, sequence=symbols)

    def ramped(self, time: float) -> Drive:
        """Return this drive times a smooth step from 0 to 1 over `time` [s].

        ``s^3 (10 - 15 s + 6 s^2)`` begins and ends without speed and acceleration, so that a
        position drive begins at rest, at 0.

        Raises
        ------
        ConfigError
            For held symbols, which jump anyway, or a ramp that is longer than the drive.
        """
        span = positive(time, "time")
        if self.interpolation == "hold":
            raise ConfigError(
                "a ramp on a held drive",
                expected="samples that are interpolated",
                fix="give held_symbols() a rise time instead",
                key="time",
            )
        if span > self.duration:
            raise ConfigError(
                f"a ramp of {span:g} s in a drive of {self.duration:g} s",
                expected="at most the length of the drive",
                key="time",
            )
        return replace(self, values=self.values * smooth_step(self.times / span)[:, None])


def smooth_step(s: NDArray[np.floating]) -> Reals:
    """Return ``s^3 (10 - 15 s + 6 s^2)``, 0 before and 1 after the unit interval."""
    c = np.clip(s, 0.0, 1.0)
    step: Reals = c**3 * (10.0 - 15.0 * c + 6.0 * c**2)
    return step


def held_drive(symbols: Reals, hold: float, rise: float | None, dt: float | None) -> Drive:
    """Return symbols (K, C), each held for `hold` [s].

    With `rise` [s] each begins with a smooth step of that length, sampled every `dt` [s].
    """
    if rise is None:
        if dt is not None:
            raise ConfigError(
                "dt without rise",
                expected="both: held symbols need no samples between them",
                key="dt",
            )
        return Drive(values=symbols, dt=hold, interpolation="hold", sequence=symbols, hold=hold)
    span = positive(rise, "rise")
    step = positive(hold / 64 if dt is None else dt, "dt")
    parts = whole_multiple(hold, step)
    if not parts or span > hold or span < 2 * step:
        raise ConfigError(
            f"a rise of {span:g} s in symbols of {hold:g} s, sampled every {step:g} s",
            expected="2 dt <= rise <= hold, and hold a multiple of dt",
            key="rise",
        )
    check_length(parts * len(symbols))
    share = smooth_step(np.arange(parts) * step / span)[:, None]
    before = np.concatenate([np.zeros_like(symbols[:1]), symbols[:-1]])
    steps = before[:, None] + share * (symbols - before)[:, None]
    values = np.concatenate([steps.reshape(-1, symbols.shape[1]), symbols[-1:]])
    return Drive(values=values, dt=step, interpolation="linear", sequence=symbols, hold=hold)


def signal_columns(values: Any, key: str) -> Reals:
    """Return `values` as read-only finite columns: (T, 1) or (T, 3)."""
    try:
        array = np.array(values, dtype="f8")
    except (TypeError, ValueError):
        raise ConfigError(
            "no table of numbers", expected="(T,), (T, 1) or (T, 3)", key=key
        ) from None
    array = array[:, None] if array.ndim == 1 else array
    if array.ndim != 2 or array.shape[1] not in (1, 3) or len(array) == 0:
        raise ConfigError(
            f"shape {np.shape(values)}", expected="(T,), (T, 1) or (T, 3), T > 0", key=key
        )
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if len(bad):
        raise ConfigError(f"NaN or infinity at sample {bad[0]}", expected="finite numbers", key=key)
    array.flags.writeable = False
    return array


def positive(value: Any, key: str, *, zero: bool = False) -> float:
    """Return `value` as a finite float above 0 (or from 0 on)."""
    number = np.asarray(value)
    fits = number.ndim == 0 and number.dtype.kind in "fiu" and math.isfinite(number)
    if not fits or number < 0 or (number == 0 and not zero):
        raise ConfigError(
            f"found {value!r}",
            expected="a number of at least 0" if zero else "a positive number",
            key=key,
        )
    return float(number)


def whole_number(value: Any, key: str, *, least: int = 1) -> int:
    """Return `value` as an int that is at least `least`."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise ConfigError(
            f"found {value!r}", expected=f"a whole number of at least {least}", key=key
        )
    check_length(int(value))
    return int(value)


def check_length(samples: int) -> None:
    """Refuse drives beyond `MAX_SAMPLES`."""
    if samples > MAX_SAMPLES:
        raise ConfigError(
            f"{samples} samples", expected=f"at most {MAX_SAMPLES}", fix="use a larger dt", key="dt"
        )


def sample_count(duration: float, dt: float, *, held: bool) -> tuple[float, int]:
    """Return the time step, and how many samples cover `duration`, its end included."""
    total, step = positive(duration, "duration"), positive(dt, "dt")
    parts = whole_multiple(total, step)
    if not parts:
        raise ConfigError(
            f"a duration of {total:g} s, sampled every {step:g} s",
            expected="a multiple of dt",
            key="duration",
        )
    check_length(parts)
    return step, parts if held else parts + 1


def check_nyquist(frequencies: Reals, dt: float, key: str) -> None:
    """Refuse frequencies [Hz] at or above half the sampling rate."""
    limit = 0.5 / dt
    if not np.isfinite(frequencies).all() or (frequencies < 0).any():
        raise ConfigError(f"frequencies {frequencies.tolist()}", expected="0 Hz or more", key=key)
    highest = float(frequencies.max(initial=0.0))
    if highest >= limit:
        raise ConfigError(
            f"a frequency of {highest:g} Hz in samples {dt:g} s apart",
            expected=f"less than {limit:g} Hz, half the sampling rate",
            fix=f"use dt below {0.5 / highest:g} s",
            key=key,
        )


def checked_band(band: tuple[float, float], dt: float) -> tuple[float, float]:
    """Return a band (low, high) [Hz] that samples `dt` apart can carry."""
    edges = np.asarray(band, dtype="f8")
    if edges.shape != (2,) or not edges[0] < edges[1]:
        raise ConfigError(f"the band {band!r}", expected="(low, high) in Hz", key="band")
    check_nyquist(edges, dt, "band")
    return float(edges[0]), float(edges[1])
