"""Whether two bodies were driven alike: unequal drives say nothing about simulators."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from openprc.schema import units

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.compare.alignment.common_clock import CommonClock
    from openprc.schema.stored import InputSignal
    from openprc.schema.trajectory import Trajectory

    Reals = NDArray[np.float64]

Verdict = Literal["same", "scaled", "different", "missing", "none"]

#: Signals are the same when the rms of their difference is below this share of their range ...
SAME = 1e-6
#: ... or below this where one had to be read between its frames.
SAME_RESAMPLED = 0.02


@dataclass(frozen=True)
class DriveComparison:
    """What can be said about the inputs of a pair.

    Parameters
    ----------
    verdict : {"same", "scaled", "different", "missing", "none"}
        "missing" where one file does not say what drove it, "none" where neither does.
    text : str
        One sentence.
    factor : float or None
        Of the other input over that of the reference, where it is scaled.
    """

    verdict: Verdict
    text: str
    factor: float | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON output."""
        return dict(self.__dict__)


def compare_drives(reference: Trajectory, other: Trajectory, clock: CommonClock) -> DriveComparison:
    """Compare what drove two bodies: sequences where both have them, else values.

    Inputs of one name belong together; where each file has a single one, these do.
    """
    names = (reference.inputs, other.inputs)
    if not any(names):
        return DriveComparison("none", "neither file says that anything drove the body")
    if not all(names):
        bare = reference if not names[0] else other
        return DriveComparison(
            "missing",
            f"{bare.path.name} does not say what drove it, so deviations may be those of drives",
        )
    shared = [(name, name) for name in names[0] if name in names[1]]
    if not shared and len(names[0]) == len(names[1]) == 1:
        shared = [(names[0][0], names[1][0])]
    alone = [n for n in (*names[0], *names[1]) if n not in {m for pair in shared for m in pair}]
    if not shared or alone:
        listed = ", ".join(dict.fromkeys(alone))
        return DriveComparison("different", f"inputs that only one of the files has: {listed}")
    found = [
        _compare(reference.input(first), other.input(second), clock) for first, second in shared
    ]
    for verdict in ("different", "scaled"):
        chosen = [item for item in found if item.verdict == verdict]
        factors = {round(item.factor, 9) for item in chosen if item.factor is not None}
        if verdict == "scaled" and len(factors) > 1:
            return DriveComparison("different", "inputs are scaled by different factors")
        if chosen:
            return chosen[0]
    return DriveComparison("same", "; ".join(item.text for item in found[:3]))


def _compare(first: InputSignal, second: InputSignal, clock: CommonClock) -> DriveComparison:
    name = first.name if first.name == second.name else f"{first.name} and {second.name}"
    if len(first.columns) != len(second.columns):
        return DriveComparison(
            "different",
            f"{name}: {len(first.columns)} and {len(second.columns)} columns",
        )
    a, b = units.unit(first.unit), units.unit(second.unit)
    if a.symbol != b.symbol and (a.dimension != b.dimension or not np.isfinite(a.si_factor)):
        return DriveComparison("different", f"{name}: in {a.symbol} and in {b.symbol}")
    factor = 1.0 if a.symbol == b.symbol else b.si_factor / a.si_factor
    if first.sequence is not None and second.sequence is not None:
        k = min(len(first.sequence), len(second.sequence))
        told = f"{name}: {k} symbols"
        pair = first.sequence[:k], factor * second.sequence[:k]
        if first.hold != second.hold:
            return DriveComparison(
                "different", f"{name}: a symbol lasts {first.hold:g} and {second.hold:g}"
            )
        return _judge(pair, told, SAME)
    exact = clock.reference.exact and clock.other.exact
    pair = (
        _sampled(first.value, clock.reference),
        factor * _sampled(second.value, clock.other),
    )
    return _judge(pair, f"{name}: values at {len(clock)} instants", SAME if exact
                  else SAME_RESAMPLED)  # fmt: skip


def _sampled(value: Reals, sampling: Any) -> Reals:
    if sampling.exact:
        return value[sampling.frames]
    columns = value.T
    return np.stack([np.interp(sampling.instants, sampling.clock, c) for c in columns], axis=1)


def _judge(pair: tuple[Reals, Reals], told: str, tolerance: float) -> DriveComparison:
    a, b = pair
    span = float(np.ptp(a)) or float(np.abs(a).max()) or 1.0
    apart = float(np.sqrt(np.mean((a - b) ** 2))) / span
    if apart <= tolerance:
        suffix = "" if tolerance == SAME else f" (rms {apart:.1g} of the range, between frames)"
        return DriveComparison("same", f"{told} agree{suffix}")
    power = float(np.vdot(a, a))
    scale = float(np.vdot(a, b)) / power if power > 0 else 0.0
    if scale and float(np.sqrt(np.mean((scale * a - b) ** 2))) <= tolerance * abs(scale) * span:
        return DriveComparison("scaled", f"{told} are {scale:.9g} times those of the reference",
                               scale)  # fmt: skip
    return DriveComparison(
        "different",
        f"{told} differ by {apart:.3g} of their range (rms): the runs were driven differently",
    )


__all__ = ["DriveComparison", "Verdict", "compare_drives"]
