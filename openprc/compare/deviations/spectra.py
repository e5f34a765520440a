"""Power spectra of the motion in both files, and how coherent it is (Welch's method)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

#: Nodes that the spectra are averaged over; those that move most.
NODES = 32
#: Samples that are transformed in all: more take longer than reading, and change little.
SAMPLES = 1 << 24
#: Longest segment by default, and how many segments a short record gets, overlapping by half.
LONGEST, FEWEST = 1 << 13, 5
#: Fewer segments say nothing about coherence.
COHERENT = 4
#: Peaks that are listed, and how far each stands out, in units of the largest.
PEAKS, PROMINENCE = 5, 1e-3
#: A peak is a line where its third value is this close to what the window makes of one.
LINE = 0.05


@dataclass(frozen=True)
class Spectra:
    """Spectra of both files on one axis of frequencies.

    Parameters
    ----------
    frequencies : (F,) [Hz]
    reference, other : (F,) [unit^2/Hz]
        One-sided densities of the displacement, summed over axes, averaged over nodes.
    coherence : (F,) or None
        Between both files, averaged over nodes and axes with the power as weights.
    peaks_reference, peaks_other : (k,) [Hz]
        Largest first.
    segment, n_segments : int
        Samples in a segment, and segments.
    nodes : tuple of str
        Whose motion it is.
    notes : tuple of str
    """

    frequencies: Reals
    reference: Reals
    other: Reals
    coherence: Reals | None
    peaks_reference: Reals
    peaks_other: Reals
    segment: int
    n_segments: int
    nodes: tuple[str, ...]
    notes: tuple[str, ...] = ()

    @property
    def resolution(self) -> float:
        """Distance between frequencies [Hz]."""
        return float(self.frequencies[1])

    @property
    def dominant(self) -> tuple[float | None, float | None]:
        """Frequency of the largest peak of either file [Hz]."""
        pair = (self.peaks_reference, self.peaks_other)
        first, second = (float(p[0]) if len(p) else None for p in pair)
        return first, second

    @property
    def dominant_difference(self) -> float | None:
        """Relative difference of the dominant frequencies."""
        first, second = self.dominant
        return None if first is None or second is None else second / first - 1.0

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON output."""
        values = {
            name: value.tolist() if isinstance(value, np.ndarray) else value
            for name, value in self.__dict__.items()
        }
        values["nodes"], values["notes"] = list(self.nodes), list(self.notes)
        values["dominant"] = list(self.dominant)
        values["dominant_difference"] = self.dominant_difference
        values["resolution"] = self.resolution
        return values


def segment_length(n_samples: int, wanted: int | None) -> int:
    """Return the samples of a segment: a length with small prime factors, or as told."""
    if wanted is not None:
        return min(wanted, n_samples)
    # k half-overlapping segments of L take (k + 1) L / 2 samples.
    most = min(LONGEST, max(8, 2 * n_samples // (FEWEST + 1)), n_samples)
    products = (2**i * 3**j * 5**k for i in range(14) for j in range(9) for k in range(6))
    return max(length for length in products if length <= most)


@dataclass
class SpectraSums:
    """Averages periodograms over segments, as instants go by.

    Segments overlap by half and have a Hann window and no mean (Welch 1967,
    doi:10.1109/TAU.1967.1161901). Where a record is so long that transforming it would take
    longer than reading it, segments are spread evenly over it with gaps between.

    Parameters
    ----------
    n_samples : int
    step : float [s]
    nodes : (m,) int
        Which of the matched nodes.
    dims : int
    wanted : int, optional
        Samples in a segment.
    """

    n_samples: int
    step: float
    nodes: NDArray[np.intp]
    dims: int
    wanted: int | None = None
    n_segments: int = 0
    n_gaps: int = 0
    _open: list[tuple[int, Reals, Reals]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.segment = length = segment_length(self.n_samples, self.wanted)
        columns = len(self.nodes) * self.dims
        hop = max(1, length // 2)
        every = (self.n_samples - length) // hop + 1
        most = max(FEWEST, SAMPLES // (2 * columns * length))
        chosen = np.arange(every)
        if every > most:
            chosen = np.unique(np.linspace(0, every - 1, most).round().astype(int))
        self.starts = chosen * hop
        self._next = 0
        self._window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)
        shape = (columns, length // 2 + 1)
        self._powers = np.zeros((2, *shape))
        self._cross = np.zeros(shape, dtype=complex)

    def add(self, first: int, x: Reals, y: Reals) -> None:
        """Add instants from `first` on: (B, n, d) each."""
        stop = first + len(x)
        while self._next < len(self.starts) and self.starts[self._next] < stop:
            shape = (len(self.nodes) * self.dims, self.segment)
            self._open.append((int(self.starts[self._next]), np.empty(shape), np.empty(shape)))
            self._next += 1
        if not self._open:
            return
        parts = [p[:, self.nodes].reshape(len(p), -1).T for p in (x, y)]
        still: list[tuple[int, Reals, Reals]] = []
        for start, a, b in self._open:
            low, high = max(first, start), min(stop, start + self.segment)
            for target, part in zip((a, b), parts, strict=True):
                target[:, low - start : high - start] = part[:, low - first : high - first]
            if high == start + self.segment:
                self._close(a, b)
            else:
                still.append((start, a, b))
        self._open = still

    def _close(self, x: Reals, y: Reals) -> None:
        from scipy.fft import rfft

        from openprc.compare.deviations.compiled_sums import add_powers, centre_columns  # noqa: PLC0415 - numba

        if not (np.isfinite(x).all() and np.isfinite(y).all()):
            self.n_gaps += 1
            return
        self.n_segments += 1
        for part in (x, y):
            centre_columns(part, self._window)
        add_powers(rfft(x, overwrite_x=True), rfft(y, overwrite_x=True), self._powers, self._cross)

    def result(self, labels: tuple[str, ...]) -> Spectra | str:
        """Return the spectra, or why there are none.

        Parameters
        ----------
        labels : n str
            Of the matched nodes.
        """
        if not self.n_segments:
            return (
                "no spectra: every segment has gaps"
                if self.n_gaps
                else "no spectra: too few instants"
            )
        frequencies = np.arange(self._powers.shape[2]) / (self.segment * self.step)
        scale = self.step / (self._window @ self._window) / self.n_segments
        sided = np.full(len(frequencies), 2.0)
        sided[0] = 1.0
        if self.segment % 2 == 0:
            sided[-1] = 1.0
        densities = self._powers.sum(axis=1) * (scale * sided / len(self.nodes))
        notes: list[str] = []
        if self.n_gaps:
            notes.append(f"{self.n_gaps} segments with gaps are left out of the spectra")
        peaks = [spectral_peaks(frequencies, density) for density in densities]
        if len(peaks[0]) and peaks[0][0] < 3.0 * frequencies[1]:
            notes.append(
                f"the largest peak is at {peaks[0][0]:.3g} Hz, which segments of"
                f" {self.segment} samples hardly resolve: raise segment"
            )
        return Spectra(
            frequencies=frequencies,
            reference=densities[0],
            other=densities[1],
            coherence=self._coherence() if self.n_segments >= COHERENT else None,
            peaks_reference=peaks[0],
            peaks_other=peaks[1],
            segment=self.segment,
            n_segments=self.n_segments,
            nodes=tuple(labels[node] for node in self.nodes),
            notes=tuple(notes),
        )

    def _coherence(self) -> Reals:
        product = self._powers[0] * self._powers[1]
        magnitude = self._cross.real**2 + self._cross.imag**2
        with np.errstate(invalid="ignore", divide="ignore"):
            each = np.where(product > 0, magnitude / product, 0.0)
            weight = np.sqrt(product)
            total = weight.sum(axis=0)
            return np.where(total > 0, (each * weight).sum(axis=0) / total, np.nan)


def spectral_peaks(frequencies: Reals, density: Reals) -> Reals:
    """Return the frequencies of the largest peaks, largest first: (k,) [Hz].

    A line as narrow as the Hann window shows it is placed by the ratio of two values (Grandke
    1983, doi:10.1109/TIM.1983.4315077, eq. 9), a broader peak by a parabola through the
    logarithms of three.

    Parameters
    ----------
    frequencies, density : (F,)
    """
    from scipy.signal import find_peaks

    top = float(density[1:].max(initial=0.0))
    # Rounding has a spectrum, too.
    if not top > 0:
        return np.empty(0)
    found, _ = find_peaks(density, prominence=PROMINENCE * top)
    found = found[found > 0]
    found = found[np.argsort(density[found])[::-1]][:PEAKS]
    offset = np.array([_offset(np.sqrt(density[k - 1 : k + 2])) for k in found if k > 0])
    return (found + offset) * frequencies[1]


def _offset(amplitudes: Reals) -> float:
    """Return where a peak is between the bins, from that of its largest value: three values."""
    low, top, high = (float(value) for value in amplitudes)
    side = 1.0 if high >= low else -1.0
    ratio, other = max(low, high) / top, min(low, high) / top
    line = (2.0 * ratio - 1.0) / (ratio + 1.0)
    # What the window makes of a line on the side away from it.
    if abs(other - (1.0 - line) / (2.0 + line)) < LINE:
        return side * line
    if not other > 0:
        return 0.0
    logs = np.log([low, top, high])
    bend = float(logs[0] - 2.0 * logs[1] + logs[2])
    return 0.5 * float(logs[0] - logs[2]) / bend if bend < 0 else 0.0


__all__ = ["NODES", "Spectra", "SpectraSums", "segment_length", "spectral_peaks"]
