"""Whether runs differ because somebody is wrong, or because the body forgets nothing.

In a chaotic body any two integrators end up far apart, however good they are. What can be said
is up to when they agree, and whether their difference grows no faster than that of two runs of
one integrator that begin a hair apart.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from openprc.compare.chaos.growth import TOLD_APART, measure_growth, time_of_share

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from openprc.compare.chaos.twins import TwinStudy

    Reals = NDArray[np.float64]

Verdict = Literal["agrees", "chaos", "sensitive", "differs", "grows", "quasi-static"]
#: Runs that are further apart than this share of the scale are not said to agree.
SHARE = 1e-2


@dataclass(frozen=True, kw_only=True)
class Divergence:
    """What the difference of two runs over time says.

    Parameters
    ----------
    verdict : {"agrees", "chaos", "sensitive", "differs", "grows", "quasi-static"}
        "agrees": below 1 % of the scale throughout; "chaos": above it after `horizon`, and twins
        of one integrator have parted exponentially, a hundredfold or more, by then; "sensitive":
        they have parted as far, and not exponentially: a snap or an impact does that;
        "differs": above it, and twins do not explain that; "grows": above it, exponentially, and
        no twins were run to explain it; "quasi-static": above it, and one of the two is a path of
        equilibria, which has no inertia.
    horizon : float or None [s]
        When the difference first is 1 % of the scale.
    expected_horizon : float or None [s]
        For "agrees" in a chaotic body: when it will be, at the rate of the twins.
    like_start : float or None
        Displacement of the start, in shares of the scale, that would explain the horizon.
    rms_before : float [m]
        Root mean square of the difference up to the horizon.
    text : str
        One sentence.
    """

    verdict: Verdict
    horizon: float | None
    expected_horizon: float | None
    like_start: float | None
    rms_before: float
    text: str

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        return asdict(self)


def judge_difference(
    times: Reals,
    rms: Reals,
    *,
    scale: float,
    twins: TwinStudy | None = None,
    equilibria: bool = False,
) -> Divergence:
    """Say what the difference of two runs means.

    Parameters
    ----------
    times : (T,) [s]
    rms : (T,) [m]
        Root mean square over nodes of the difference.
    scale : float [m]
        Of the motion.
    twins : TwinStudy, optional
        Of the same experiment.
    equilibria : bool
        One of the two is a path of equilibria that was put in time, the other is not.
    """
    seen = np.isfinite(rms)
    times, rms = np.asarray(times)[seen], np.asarray(rms)[seen]
    horizon = time_of_share(times, rms, share=SHARE * scale)
    before = rms if horizon is None else rms[times < horizon]
    rms_before = float(np.sqrt(np.mean(before**2))) if len(before) else 0.0

    def judged(verdict: Verdict, text: str, **more: float | None) -> Divergence:
        values: dict[str, Any] = {"expected_horizon": None, "like_start": None} | more
        return Divergence(
            verdict=verdict, horizon=horizon, rms_before=rms_before, text=text, **values
        )

    if horizon is None:
        return _agreeing(times, rms, scale=scale, twins=twins, judged=judged)
    after = f"the difference is 1 % of the scale from t = {horizon:.4g} s on"
    if equilibria:
        last = float(rms[-1]) / scale
        return judged(
            "quasi-static",
            f"{after}: equilibria have no inertia, so they are apart from a run in time wherever it"
            f" still swings; at the end the difference is {last:.2g} of the scale",
        )
    if twins is None:
        growth = measure_growth(times, rms / scale)
        if growth is not None and growth.kind == "exponential":
            return judged(
                "grows",
                f"{after}; before, it grew exponentially over {growth.decades:.1f} decades at"
                f" {growth.rate:.3g} 1/s, which may be chaos: perturbed twins of the experiment"
                " would tell",
            )
        return judged("differs", f"{after}, and it did not grow exponentially before")
    growth = twins.growth
    factor = twins.amplification_at(horizon)
    like = SHARE / factor if factor > 0.0 else None
    if twins.chaotic and growth is not None and factor >= TOLD_APART:
        return judged(
            "chaos",
            f"{after}: that is chaos, not a fault. Twins part at {growth.rate:.3g} +-"
            f" {growth.uncertainty:.1g} 1/s, {factor:.2g} times by then, so the runs are as far"
            f" apart as if they had begun {like:.1g} of the scale apart",
            like_start=like,
        )
    if growth is not None and factor >= TOLD_APART:
        return judged(
            "sensitive",
            f"{after}: twins of one integrator part {factor:.2g} times by then as well, though not"
            f" exponentially, so the runs are as far apart as if they had begun {like:.1g} of the"
            " scale apart",
            like_start=like,
        )
    why = (
        f"twins part only {factor:.2g} times by then"
        if twins.chaotic
        else "twins of one integrator stay together"
        if growth is None or growth.kind in ("bounded", "decaying")
        else "twins of one integrator do not part exponentially"
    )
    return judged("differs", f"{after}, and chaos is not why: {why}", like_start=like)


def _agreeing(
    times: Reals,
    rms: Reals,
    *,
    scale: float,
    twins: TwinStudy | None,
    judged: Callable[..., Divergence],
) -> Divergence:
    largest = float(rms.max(initial=0.0)) / scale
    text = f"the difference stays below {max(largest, 1e-16):.2g} of the scale"
    if twins is None or not twins.chaotic or twins.growth is None or not largest > 0.0:
        return judged("agrees", text)
    growth = twins.growth
    later = float(times[-1]) + float(np.log(SHARE / largest)) / growth.rate
    return judged(
        "agrees",
        f"{text}; twins part at {growth.rate:.3g} 1/s, so it would be 1 % by t = {later:.3g} s",
        expected_horizon=later,
    )


__all__ = ["SHARE", "Divergence", "Verdict", "judge_difference"]
