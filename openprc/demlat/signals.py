"""Drives: noise, symbols, sines, chirps and pulses, made with the symbols that they carry.

Every generator returns a `Drive`; random ones draw from the `numpy.random.Generator` that they
are given. Frequencies at or above half the sampling rate are refused.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from openprc.demlat.drive import (
    MAX_SAMPLES,
    Drive,
    check_nyquist,
    checked_band,
    held_drive,
    positive,
    sample_count,
    signal_columns,
    smooth_step,
    whole_number,
)
from openprc.errors import ConfigError
from openprc.schema.experiment import Interpolation

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = [
    "Drive",
    "chirp",
    "from_array",
    "held_symbols",
    "prbs",
    "pulse",
    "ramp",
    "sine_product",
    "sum_of_sines",
    "white_noise",
]

SymbolKind = Literal["uniform", "binary", "gaussian"]
SYMBOL_KINDS: tuple[SymbolKind, ...] = get_args(SymbolKind)
ChirpKind = Literal["linear", "logarithmic"]
CHIRP_KINDS: tuple[ChirpKind, ...] = get_args(ChirpKind)
#: Frequencies [Hz] of the input of Hauser et al. 2011, doi:10.1007/s00422-012-0471-0.
HAUSER_FREQUENCIES = (2.11, 3.73, 4.33)


# --- random -----------------------------------------------------------------------------------


def white_noise(
    duration: float,
    dt: float,
    rng: np.random.Generator,
    *,
    std: float = 1.0,
    band: tuple[float, float] | None = None,
    interpolation: Interpolation = "linear",
) -> Drive:
    """Return Gaussian noise with a flat spectrum.

    Parameters
    ----------
    duration, dt : float [s]
    rng : numpy.random.Generator
    std : float [unit of what it drives]
        Expected standard deviation, in the band.
    band : (low, high) [Hz], optional
        Frequencies outside are left out. Without a band the samples are independent and are
        the symbols of the drive, `dt` being their `hold`.
    interpolation : {"linear", "hold", "cubic"}

    Examples
    --------
    >>> import numpy as np
    >>> from openprc.demlat.generators import white_noise
    >>> drive = white_noise(1.0, 1e-3, np.random.default_rng(1), std=0.01, band=(0.0, 20.0))
    >>> drive.values.shape
    (1001, 1)
    """
    held = interpolation == "hold"
    step, n = sample_count(duration, dt, held=held)
    size = positive(std, "std", zero=True)
    noise = size * rng.standard_normal(n)
    if band is None:
        return Drive(values=noise, dt=step, interpolation=interpolation, sequence=noise, hold=step)
    low, high = checked_band(band, step)
    spectrum = np.fft.rfft(noise)
    frequencies = np.fft.rfftfreq(n, step)
    inside = (frequencies >= low) & (frequencies <= high)
    # Every line of the spectrum stands for two, except 0 and the Nyquist frequency.
    lines = np.full(len(spectrum), 2.0)
    lines[0] = 1.0
    if n % 2 == 0:
        lines[-1] = 1.0
    if not inside.any():
        raise ConfigError(
            f"no line of the spectrum between {low:g} and {high:g} Hz",
            expected=f"a band wider than {1 / (n * step):g} Hz, one over the duration",
            fix="widen the band or make the drive longer",
            key="band",
        )
    spectrum[~inside] = 0.0
    kept = lines[inside].sum() / n
    values = np.fft.irfft(spectrum, n) / math.sqrt(kept)
    return Drive(values=values, dt=step, interpolation=interpolation)


def held_symbols(
    n_symbols: int,
    hold: float,
    rng: np.random.Generator,
    *,
    kind: SymbolKind = "uniform",
    low: float = -1.0,
    high: float = 1.0,
    rise: float | None = None,
    dt: float | None = None,
) -> Drive:
    """Return independent random symbols, each held for `hold` seconds.

    Parameters
    ----------
    n_symbols : int
    hold : float [s]
    rng : numpy.random.Generator
    kind : {"uniform", "binary", "gaussian"}
        Uniform in [low, high]; one of low and high; or Gaussian with mean
        ``(low + high) / 2`` and standard deviation ``(high - low) / 2``.
    low, high : float [unit of what it drives]
    rise : float [s], optional
        Every symbol begins with a smooth step of this length, the first one from 0: what
        drives positions must not jump.
    dt : float [s], optional
        Sampling of the steps; needed with `rise`, a whole part of `hold`.

    Examples
    --------
    >>> import numpy as np
    >>> from openprc.demlat.generators import held_symbols
    >>> drive = held_symbols(100, 0.1, np.random.default_rng(1), kind="binary")
    >>> drive.sequence.shape, drive.interpolation, round(drive.duration, 9)
    ((100, 1), 'hold', 10.0)
    """
    n = whole_number(n_symbols, "n_symbols")
    if kind not in SYMBOL_KINDS:
        raise ConfigError(
            f"symbols of the kind {kind!r}",
            expected="one of " + ", ".join(SYMBOL_KINDS),
            key="kind",
        )
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise ConfigError(f"low {low!r}, high {high!r}", expected="low < high", key="low")
    if kind == "uniform":
        symbols = rng.uniform(low, high, n)
    elif kind == "binary":
        symbols = np.where(rng.integers(0, 2, n) == 1, float(high), float(low))
    else:
        symbols = 0.5 * (low + high) + 0.5 * (high - low) * rng.standard_normal(n)
    return held_drive(symbols[:, None], positive(hold, "hold"), rise, dt)


def prbs(
    order: int,
    hold: float,
    *,
    periods: int = 1,
    low: float = -1.0,
    high: float = 1.0,
    rise: float | None = None,
    dt: float | None = None,
) -> Drive:
    """Return a pseudo-random binary sequence of maximal length.

    A period has ``N = 2^order - 1`` symbols, one more `high` than `low`. With levels -1 and 1
    its circular autocorrelation is 1 at delay 0 and -1/N at all others (Golomb 1967, Shift
    Register Sequences).

    Parameters
    ----------
    order : int
        Of the shift register, from 2 to 24.
    hold : float [s]
        How long a symbol lasts.
    periods : int
    low, high : float [unit of what it drives]
    rise, dt : float [s], optional
        As for `held_symbols`.
    """
    from scipy.signal import max_len_seq

    bits = whole_number(order, "order", least=2)
    if bits > 24:
        raise ConfigError(f"order {bits}", expected="2 to 24", key="order")
    repeats = whole_number(periods, "periods")
    if repeats * 2**bits > MAX_SAMPLES:
        raise ConfigError(
            f"{repeats} periods of {2**bits - 1} symbols",
            expected=f"at most {MAX_SAMPLES} symbols",
            key="periods",
        )
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise ConfigError(f"low {low!r}, high {high!r}", expected="low < high", key="low")
    period = np.where(max_len_seq(bits)[0] == 1, float(high), float(low))
    return held_drive(np.tile(period, repeats)[:, None], positive(hold, "hold"), rise, dt)


# --- deterministic ----------------------------------------------------------------------------


def sum_of_sines(
    duration: float,
    dt: float,
    frequencies: ArrayLike,
    *,
    amplitudes: ArrayLike = 1.0,
    phases: ArrayLike = 0.0,
    interpolation: Interpolation = "cubic",
) -> Drive:
    """Return ``sum_i a_i sin(2 pi f_i t + phi_i)``.

    Parameters
    ----------
    duration, dt : float [s]
    frequencies : (F,) [Hz]
        Each below ``1 / (2 dt)``.
    amplitudes : float or (F,) [unit of what it drives]
    phases : float or (F,) [rad]
    interpolation : {"linear", "hold", "cubic"}

    Raises
    ------
    ConfigError
        For a frequency that the samples cannot carry.
    """
    step, n = sample_count(duration, dt, held=interpolation == "hold")
    f = np.atleast_1d(np.asarray(frequencies, dtype="f8"))
    check_nyquist(f, step, "frequencies")
    try:
        a, phi = np.broadcast_to(amplitudes, f.shape), np.broadcast_to(phases, f.shape)
    except ValueError:
        raise ConfigError(
            f"{len(f)} frequencies, amplitudes of shape {np.shape(amplitudes)}"
            f" and phases of shape {np.shape(phases)}",
            expected="one for all, or one for each frequency",
            key="amplitudes",
        ) from None
    t = np.arange(n) * step
    values = np.zeros(n)
    for amplitude, frequency, phase in zip(a, f, phi, strict=True):
        values += amplitude * np.sin(2.0 * np.pi * frequency * t + phase)
    return Drive(values=values, dt=step, interpolation=interpolation)


def sine_product(
    duration: float,
    dt: float,
    frequencies: Sequence[float] = HAUSER_FREQUENCIES,
    *,
    amplitude: float = 1.0,
    interpolation: Interpolation = "cubic",
) -> Drive:
    """Return ``a sin(2 pi f1 t) sin(2 pi f2 t) ...``, by default the input of Hauser et al.

    With three frequencies it begins at 0 without speed and acceleration. It contains all sums
    and differences of the frequencies, so that their sum has to be below ``1 / (2 dt)``.

    Parameters
    ----------
    duration, dt : float [s]
    frequencies : sequence of float [Hz]
    amplitude : float [unit of what it drives]
    interpolation : {"linear", "hold", "cubic"}
    """
    step, n = sample_count(duration, dt, held=interpolation == "hold")
    f = np.atleast_1d(np.asarray(frequencies, dtype="f8"))
    check_nyquist(np.append(f, f.sum()), step, "frequencies")
    t = np.arange(n) * step
    values = amplitude * np.prod(np.sin(2.0 * np.pi * f[:, None] * t), axis=0)
    return Drive(values=values, dt=step, interpolation=interpolation)


def chirp(
    duration: float,
    dt: float,
    *,
    start: float,
    end: float,
    kind: ChirpKind = "linear",
    amplitude: float = 1.0,
    interpolation: Interpolation = "cubic",
) -> Drive:
    """Return a sine whose frequency goes from `start` to `end`; it begins at 0.

    Parameters
    ----------
    duration, dt : float [s]
    start, end : float [Hz]
    kind : {"linear", "logarithmic"}
        How the frequency grows.
    amplitude : float [unit of what it drives]
    interpolation : {"linear", "hold", "cubic"}
    """
    from scipy import signal

    step, n = sample_count(duration, dt, held=interpolation == "hold")
    check_nyquist(np.array([start, end]), step, "end")
    if kind not in CHIRP_KINDS:
        raise ConfigError(
            f"a chirp of the kind {kind!r}", expected="one of " + ", ".join(CHIRP_KINDS), key="kind"
        )
    if kind == "logarithmic" and min(start, end) <= 0.0:
        raise ConfigError(
            f"a logarithmic chirp from {start:g} to {end:g} Hz",
            expected="frequencies above 0",
            key="start",
        )
    t = np.arange(n) * step
    # scipy begins with a cosine.
    values = signal.chirp(t, start, duration, end, method=kind, phi=-90.0)
    return Drive(values=amplitude * values, dt=step, interpolation=interpolation)


def ramp(duration: float, dt: float, *, to: float, rise: float, start: float = 0.0) -> Drive:
    """Return a smooth step from 0 to `to` that takes `rise` [s] and begins at `start` [s]."""
    step, n = sample_count(duration, dt, held=False)
    span, begin = positive(rise, "rise"), positive(start, "start", zero=True)
    values = to * smooth_step((np.arange(n) * step - begin) / span)
    return Drive(values=values, dt=step, interpolation="cubic")


def pulse(duration: float, dt: float, *, height: float, width: float, start: float = 0.0) -> Drive:
    """Return one raised-cosine pulse of `height`, `width` [s] wide, that begins at `start` [s]."""
    step, n = sample_count(duration, dt, held=False)
    span, begin = positive(width, "width"), positive(start, "start", zero=True)
    if span < 4 * step:
        raise ConfigError(
            f"a pulse of {span:g} s sampled every {step:g} s",
            expected="at least four samples in the pulse",
            key="width",
        )
    s = np.clip((np.arange(n) * step - begin) / span, 0.0, 1.0)
    values = 0.5 * height * (1.0 - np.cos(2.0 * np.pi * s))
    return Drive(values=values, dt=step, interpolation="cubic")


def from_array(
    values: ArrayLike,
    dt: float,
    *,
    symbols: bool = False,
    interpolation: Interpolation | None = None,
    rise: float | None = None,
    sample_dt: float | None = None,
) -> Drive:
    """Return a drive of your own samples.

    Parameters
    ----------
    values : (T,), (T, 1) or (T, 3) [unit of what it drives]
    dt : float [s]
        Time between samples, or how long a symbol lasts.
    symbols : bool
        The values are symbols, each held for `dt`; else samples of something continuous.
    interpolation : {"linear", "hold", "cubic"}, optional
        Of samples; linear unless given. Symbols are held.
    rise, sample_dt : float [s], optional
        As `rise` and `dt` of `held_symbols`, for symbols.
    """
    rows, step = signal_columns(values, "values"), positive(dt, "dt")
    if not symbols:
        if rise is not None or sample_dt is not None:
            raise ConfigError("a rise time for samples", expected="symbols=True", key="rise")
        return Drive(values=rows, dt=step, interpolation=interpolation or "linear")
    if interpolation not in (None, "hold"):
        raise ConfigError(
            f"symbols with interpolation {interpolation!r}", expected="none", key="interpolation"
        )
    return held_drive(rows, step, rise, sample_dt)
