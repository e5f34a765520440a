"""Equilibrium paths through limit points and snap-backs: the load factor is an unknown, too."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from openprc.errors import ConfigError, NotConverged
from openprc_merlin.equilibrium_path import Balance, PathPoint, StepFailed, gave_up

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.demlat.statics.symmetric_factors import SymmetricFactors

    Floats = NDArray[np.float64]

#: Fewer iterations than this let the next step grow ...
_FEW = 3
#: ... by this factor, ...
_GROWTH = 1.5
#: ... as long as it moves no node farther than this, in median bar lengths. A body without
#: stiffness against its load begins with such a step.
_SHORT = 0.02


def arc_length_path(
    balance: Balance, start: Floats, *, first_factor: float, arc_length: float | None = None
) -> Iterator[PathPoint]:
    """Follow the equilibria under a growing and shrinking load, without end.

    The modified generalised displacement control method (Leon, Lages, de Araujo & Paulino
    2014, Mech. Res. Commun. 56:123). With dp the displacement per unit of load and
    dr that of the force out of balance, an increment begins with ``b sqrt(|dp_1|^2 / |dp|^2)``
    times the load, dp_1 being that of the first increment, in the direction in which dp goes on
    from the increment before; so all increments are about equally long, and the load turns at a
    limit point by itself. Corrections keep the displacement along the predictor:
    ``-(dp_0 . dr) / (dp_0 . dp)`` of the load, dp_0 that of the increment's beginning.

    b is halved and the increment repeated when it takes more than the iterations allowed. After
    an increment of less than three it grows by half, back to the first one or until a node
    moves by a fiftieth of a bar, whichever is longer.

    Parameters
    ----------
    balance : Balance
    start : (N, 3) [m]
        An equilibrium without the reference load.
    first_factor : float
        b, the load factor that the first increment aims at.
    arc_length : float, optional [m]
        Of that increment: the Euclidean norm of the displacement that it aims at, over all free
        degrees of freedom. It replaces the size of `first_factor`, not its sign.

    Yields
    ------
    PathPoint
        After each increment; `start` is not repeated.

    Raises
    ------
    ConfigError
        When the reference load does not act on any free axis, or `first_factor` is 0.
    NotConverged
        When no step down to `PathSettings.least_step` leads on.
    """
    if not balance.free_reference.any():
        raise ConfigError(
            "no reference load on an axis that can move",
            expected="force actuators whose signals do not end at 0",
            fix="give them one, or follow the positions with control=displacement",
            key="control",
        )
    if not (np.isfinite(first_factor) and first_factor != 0.0):
        raise ConfigError(
            f"{first_factor}",
            expected="the load factor of the first increment, not 0",
            fix="a hundredth of the load where the body snaps is a good start",
            key="initial-load-factor",
        )
    search = _ArcLength(balance, start, first_factor, arc_length)
    while True:
        yield search.advance()


class _ArcLength:
    """Where the path has got to, and how long the next step is."""

    def __init__(
        self, balance: Balance, start: Floats, first_factor: float, arc_length: float | None
    ) -> None:
        self.balance = balance
        self.x, self.factor = start.copy(), 0.0
        self.b = self.first = first_factor
        self.sign = 1.0
        self.count = 0
        self.square = 0.0
        self.before: Floats | None = None
        self.tangent: SymmetricFactors = balance.factors(self.x)
        self.given = arc_length is not None
        if arc_length is not None:
            size = float(np.linalg.norm(self.tangent.solve(balance.free_reference)))
            self.b = self.first = float(np.copysign(arc_length / size, first_factor))

    def advance(self) -> PathPoint:
        """Return the next point."""
        balance = self.balance
        forward = self.tangent.solve(balance.free_reference)
        length = float(forward @ forward)
        if self.before is None:
            self.square = length
        elif float(self.before @ forward) < 0.0:
            self.sign = -self.sign
        ratio = np.sqrt(self.square / length)
        self._keep_short(np.abs(forward).max() * ratio)
        while True:
            try:
                return self._increment(forward, self.sign * self.b * ratio)
            except (StepFailed, NotConverged) as failed:  # an element may have collapsed, too
                self.b *= 0.5
                share = abs(self.b / self.first)
                if share >= balance.settings.least_step:
                    continue
                raise gave_up(
                    f"increment {self.count + 1}, load factor {self.factor:.6g}",
                    failed,
                    step=f"the step is down to {share:.1g} of the first one",
                    fix="begin with a smaller initial-load-factor, or look at the last frames:"
                    " elements may have collapsed there",
                ) from None

    def _keep_short(self, size: float) -> None:
        """Shorten a step that would carry a node too far.

        A body that has no stiffness against its load, as a flat sheet of "four-thirds" hinges,
        begins on a short leash: its tangent tells the direction only.
        """
        longest = self.balance.longest
        if self.tangent.n_zero and self.count == 0 and not self.given:
            longest = _SHORT * self.balance.problem.length_scale
        if abs(self.b) * size > longest:
            self.b = float(np.copysign(longest / size, self.b))
            if self.count == 0:
                self.first = self.b

    def _grow(self, size: float) -> None:
        """Let b grow after an easy increment; `size` [m] is what a b of 1 moves a node by."""
        short = 0.0 if self.given else _SHORT * self.balance.problem.length_scale / size
        longest = max(abs(self.first), abs(self.b), short)
        self.b = float(np.copysign(min(abs(self.b) * _GROWTH, longest), self.b))

    def _increment(self, forward: Floats, predicted: float) -> PathPoint:
        balance, allowed = self.balance, self.balance.settings.max_iterations
        x, factor = balance.moved(self.x, predicted * forward), self.factor + predicted
        iteration, size = 1, np.inf
        while size >= balance.least:
            iteration += 1
            if iteration > allowed:
                raise StepFailed(f"{allowed} iterations were not enough")
            tangent = balance.factors(x)
            x, factor, size = self._corrected(x, factor, forward, tangent)
        # What the tangent at hand still improves costs no factorisation.
        x, factor, _ = self._corrected(x, factor, forward, tangent)
        self.x, self.factor, self.tangent, self.before = x, factor, tangent, forward
        self.count += 1
        if iteration < _FEW:
            self._grow(np.abs(predicted * forward).max() / abs(self.b))
        return balance.point(x, factor, iterations=iteration, n_negative=tangent.n_negative)

    def _corrected(
        self, x: Floats, factor: float, forward: Floats, tangent: SymmetricFactors
    ) -> tuple[Floats, float, float]:
        """Return the state after one correction, and its length [m]."""
        balance = self.balance
        wrong = balance.out_of_balance(x, factor)
        both = tangent.solve(np.stack([balance.free_reference, wrong], axis=1))
        change = -float(forward @ both[:, 1]) / float(forward @ both[:, 0])
        step = change * both[:, 0] + both[:, 1]
        share = balance.allowed_share(step)
        moved = balance.moved(x, share * step)
        return moved, factor + share * change, share * float(np.linalg.norm(step))
