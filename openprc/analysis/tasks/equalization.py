"""Equalisation of a nonlinear channel: which symbol was sent?"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from openprc.analysis.tasks.scoring import Metric
from openprc.analysis.tasks.series import TargetSeries, TaskData
from openprc.analysis.tasks.task import Randomness, SourcedTask, generator_of, positive_count
from openprc.errors import TaskError

#: Weights of d(k+2), d(k+1), d(k), ..., d(k-7).
CHANNEL_TAPS = (0.08, -0.12, 1.0, 0.18, -0.1, 0.091, -0.05, 0.04, 0.03, 0.01)
_AHEAD = 2
_SYMBOLS = (-3.0, -1.0, 1.0, 3.0)


@dataclass(frozen=True)
class ChannelEqualizationTask(SourcedTask):
    """Tell the symbols that were sent from a distorted and noisy signal.

    The body is driven with ``u = q + quadratic q^2 + cubic q^3 + noise``, where q is the sent
    sequence d after a linear channel that mixes ten neighbouring symbols. The target of row k
    is d(k - delay), and the decision is for the nearest of -3, -1, 1 and 3.

    Parameters
    ----------
    snr : float [dB]
        Ten times the logarithm of mean(noise-free u^2) over the variance of the noise;
        12 to 32 in the original. Infinity leaves the noise out.
    delay : int
        Since q(k) already contains d(k+2), a causal equaliser that may use all of a symbol's
        traces ahead of its main one has delay 2.
    quadratic, cubic : float
        0 and 0 leave a linear channel.
    """

    snr: float = 28.0
    delay: int = 2
    quadratic: float = 0.036
    cubic: float = -0.011
    metric: ClassVar[Metric] = "ser"
    levels: ClassVar[tuple[float, ...]] = _SYMBOLS
    name: ClassVar[str] = "channel-equalization"
    source: ClassVar[str] = (
        "Jaeger and Haas 2004, doi:10.1126/science.1091277, after Mathews and Lee 1994"
    )

    def __post_init__(self) -> None:
        positive_count(self.delay, "delay", least=0)
        if math.isnan(self.snr) or self.snr == -math.inf:
            raise TaskError(
                f"the signal-to-noise ratio is {self.snr!r}",
                expected="a number of dB, or infinity",
                fix="12 to 32 are usual",
                key="snr",
            )

    @property
    def formula(self) -> str:
        """Channel, distortion and target."""
        taps = " ".join(
            f"{weight:+g} d(k{lag:+d})" if lag else f"{weight:+g} d(k)"
            for weight, lag in zip(CHANNEL_TAPS, range(_AHEAD, -8, -1), strict=True)
        )
        return (
            f"q(k) = {taps}; u = q {self.quadratic:+g} q^2 {self.cubic:+g} q^3 + noise; "
            f"y(k) = d(k-{self.delay})"
        )

    def channel(self, d: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the noise-free output of the channel.

        Parameters
        ----------
        d : (K + 9,)
            d(-7) to d(K+1).

        Returns
        -------
        (K,)
            u(0) to u(K-1).
        """
        q = np.convolve(d, CHANNEL_TAPS, mode="valid")
        return q + self.quadratic * q**2 + self.cubic * q**3

    def generate(self, n: int, *, rng: Randomness) -> TaskData:
        """Return `n` received values and the symbols that were sent, all rows defined."""
        generator, seed = generator_of(rng)
        n = positive_count(n, "n")
        oldest = max(len(CHANNEL_TAPS) - 1 - _AHEAD, self.delay)
        # d[i] is d(i - oldest), so that the symbols of the first rows exist too.
        d = generator.choice(np.array(_SYMBOLS), size=oldest + n + _AHEAD)
        received = self.channel(d[oldest - (len(CHANNEL_TAPS) - 1 - _AHEAD) :])
        noise_std = 0.0
        if math.isfinite(self.snr):
            power = float(np.mean(received**2))
            noise_std = math.sqrt(power * 10.0 ** (-self.snr / 10.0))
            received = received + noise_std * generator.standard_normal(n)
        sent = d[oldest - self.delay : oldest - self.delay + n]
        return TaskData(
            input=received,
            target=TargetSeries(sent, names=(f"d(k-{self.delay})",)),
            metadata={**self.metadata(), "noise_std": noise_std},
            seed=seed,
        )
