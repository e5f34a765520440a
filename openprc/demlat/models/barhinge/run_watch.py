"""What the frames of a run say about it: numbers, energies, folds and motions that went wrong."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from openprc.demlat.integrators import INTEGRATORS
from openprc.demlat.models.barhinge.tables import FrameBuffer
from openprc.demlat.models.barhinge.turning import Turning
from openprc.errors import Diverged

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.experiment import Experiment

#: Share of the energy that moves back and forth from which on a gap in its balance is told.
TOLD = 0.02
#: Share of it that, when the scheme made it, leaves nothing of the motion: a hundred times what
#: came in. Verlet's scheme close below its limit swings within a tenth of that.
MADE = 0.99
#: Smallest rms displacement [mean bar] that schemes which choose their steps measure errors by.
QUIET = 1e-3
#: Share of the length of a step's motion from which on the rounding of coordinates is told.
COARSE = 1e-3
#: Displacement [mean bar] that is rounding: whoever rests is not short of digits.
AT_REST = 1e-12
#: Cosine between a bar and the velocity of its ends above which they move along it.
ALONG = 0.9
#: Share of a body's extent that nobody would miss: a fall through it is no energy to speak of.
NEGLIGIBLE = 1e-6
#: Strain of bars that is rounding: what its energy does is none.
TINY_STRAIN = 1e-9
#: Share of its rest length below which a bar has no direction worth the name.
SHRUNK = 1e-3

_SERIES = (
    ("x", "a position"),
    ("v", "a velocity"),
    ("tension", "the force of a bar"),
    ("moment", "the torque of a hinge"),
    ("bend_moment", "the torque of a bend"),
    ("energy", "an energy"),
    ("ledger", "work or a loss"),
)


class RunWatch:
    """Looks at every block of frames, and sums up what a reader of the result should know.

    The balance of energy: kinetic and potential energy, less the work of actuators and plus what
    dampers and contacts took, stay what they were at t = 0. What is missing was taken by the
    scheme, what is too much was made by it; either is compared with what moves back and forth,
    the largest kinetic energy or the range of the potential one.

    Parameters
    ----------
    experiment : Experiment
    scheme : str, optional
        What integrates it, in words; the experiment's integrator by default.
    balanced : bool
        Whether positions and velocities of a frame belong to one instant. Where they do not,
        no energy can be told from them, and none is weighed.
    """

    def __init__(self, experiment: Experiment, *, scheme: str = "", balanced: bool = True) -> None:
        self.experiment = experiment
        self.balanced = balanced
        self.scheme = scheme or f"the integrator {experiment.integrator!r}"
        geometry = experiment.geometry
        rigid = {"tension": geometry.bars.rigid, "moment": geometry.hinges.rigid}
        self._determined = {name: ~which for name, which in rigid.items() if which.any()}
        self._extent = float(np.ptp(geometry.positions, axis=0).max())
        weight = float(geometry.masses.sum() * np.linalg.norm(experiment.gravity))
        self._negligible = NEGLIGIBLE * weight * self._extent
        if len(bars := geometry.bars):
            rounding = TINY_STRAIN * float(bars.rest_length.mean())
            self._negligible += 0.5 * float(bars.stiffness.mean()) * rounding**2
        self._start = 0.0
        self._start_loss = 0.0
        self._worst = {"gap": (0.0, 0.0), "made": (0.0, 0.0)}
        self._kinetic = self._size = self._through = 0.0
        self._potential = (np.inf, -np.inf)
        self._made_at: float | None = None
        self._angles: NDArray[np.float64] | None = None
        self._folded: dict[int, float] = {}
        self._shrunk: tuple[float, int, float] = (np.inf, 0, 0.0)
        self._last: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
        self._crossed: dict[int, float] = {}
        self._turning = Turning(experiment)
        self._moved = self._fast = self._far = 0.0
        self._reference: NDArray[np.float64] | None = None

    def sound(self, first: int, block: FrameBuffer) -> int:
        """Look at a block; return how many of its frames, from the first, hold finite numbers."""
        count = len(block.x)
        for name, _ in _SERIES:
            column = self._column(block, name)
            with np.errstate(over="ignore", invalid="ignore"):
                total = float(column.sum())
            if not np.isfinite(total):
                bad = ~np.isfinite(column.reshape(len(column), -1)).all(axis=1)
                count = min(count, int(np.argmax(bad)) if bad.any() else count)
        if count:
            head = FrameBuffer(*(column[:count] for column in block))
            if self.balanced:
                self._weigh(first, head)
            self._follow_hinges(first, head)
            self._measure(first, head)
            self._follow_bars(first, head)
            self._turning.follow(head.x, head.v)
        return count

    def not_finite(self, first: int, block: FrameBuffer) -> Diverged:
        """Return the error for the first frame of a block, which is not finite."""
        name, what = next(
            (name, words)
            for name, words in _SERIES
            if not np.isfinite(self._column(block, name)[0]).all()
        )
        place = int(np.argwhere(~np.isfinite(self._column(block, name)[0]))[0][0])
        if name in self._determined:
            place = int(np.flatnonzero(self._determined[name])[place])
        time = first * self.experiment.save_interval
        return Diverged(
            f"{what} (number {place}) is no finite number by t = {time:.6g} s",
            expected="finite numbers",
            fix="look there for a number too large for"
            f" {self.experiment.precision}, or a bar of no length; frames before are in the"
            " partial file",
            key="simulation.dt",
        )

    def _column(self, block: FrameBuffer, name: str) -> NDArray[np.float64]:
        """Return a column without what may be NaN: reactions of redundant rigid elements."""
        column: NDArray[np.float64] = getattr(block, name)
        keep = self._determined.get(name)
        return column if keep is None else column[:, keep]

    def close(self) -> None:
        """Refuse a finished run whose motion the scheme made.

        Raises
        ------
        Diverged
        """
        made, time = self._worst["made"]
        if self._made_at is None or not made > MADE * self._moving:
            return
        raise Diverged(
            f"{self.scheme} made {made:.3g} J of energy by t = {time:.6g} s: from"
            f" t = {self._made_at:.6g} s on there is a hundred times what came in",
            expected="energy that only actuators and gravity bring in",
            fix=f"use a smaller dt than {self.experiment.dt:g} s, or an integrator that chooses its"
            " step; all frames are in the partial file",
            key="simulation.dt",
        )

    def remarks(self) -> Iterator[str]:
        """Yield what a reader of the finished run should know."""
        yield from self._balance()
        yield from self._turned_through()
        yield from self._turning.remarks()
        yield from self._lost_in_rounding()
        reach, bar, time = self._shrunk
        if self._crossed or reach < SHRUNK:
            if self._crossed:
                bar, time = next(iter(self._crossed.items()))
            yield (
                f"bar {bar} had hardly any length by t = {time:.6g} s"
                + (f", one of {len(self._crossed)} that went through none" if self._crossed else "")
                + ": its force turns about at once there, and a fixed step is of first order; take"
                " small steps, dop853 or rk45"
            )

    # --- energy -----------------------------------------------------------------------------

    def _weigh(self, first: int, block: FrameBuffer) -> None:
        with np.errstate(over="ignore"):
            kinetic, potential = block.energy[:, 0], block.energy[:, 1:].sum(axis=1)
            work, lost = block.ledger[:, 0], block.ledger[:, 1:].sum(axis=1)
            total = kinetic + potential - work
        if first == 0:
            self._start = float(total[0])
            self._start_loss = float(lost[0])
        # Losses only take. Where stiff dampers are hardly resolved, what they took is not well
        # known, while the motion is.
        made = total - self._start
        gap = made + lost - self._start_loss
        low, high = self._potential
        # What has moved back and forth up to each frame.
        kinetics = np.maximum(np.maximum.accumulate(kinetic), self._kinetic)
        highs = np.maximum(np.maximum.accumulate(potential), high)
        lows = np.minimum(np.minimum.accumulate(potential), low)
        moving = np.maximum(kinetics, highs - lows)
        self._kinetic, self._potential = float(kinetics[-1]), (float(lows[-1]), float(highs[-1]))
        self._through = max(self._through, float(np.abs(work).max()), float(np.abs(lost).max()))
        sizes = np.abs(block.energy).sum(axis=1) + np.abs(block.ledger).sum(axis=1)
        self._size = max(self._size, float(sizes.max()))
        interval = self.experiment.save_interval
        for name, values in (("gap", gap), ("made", made)):
            worst = int(np.argmax(np.abs(values) if name == "gap" else values))
            if abs(values[worst]) > abs(self._worst[name][0]):
                self._worst[name] = float(values[worst]), (first + worst) * interval
        mostly = made > np.maximum(MADE * moving, self._rounding)
        if self._made_at is None and mostly.any():
            self._made_at = (first + int(np.argmax(mostly))) * interval

    @property
    def _moving(self) -> float:
        """Energy that moves back and forth so far [J]."""
        return max(self._kinetic, self._potential[1] - self._potential[0])

    @property
    def _rounding(self) -> float:
        """What rounding may have done to the balance [J]."""
        experiment = self.experiment
        steps = experiment.steps_per_frame * experiment.n_frames
        eps = float(np.finfo(experiment.precision).eps)
        return eps * self._size * (100.0 + steps) + self._negligible

    def _balance(self) -> Iterator[str]:
        gap, time = self._worst["gap"]
        whole = max(self._moving, self._through)
        if abs(gap) > max(TOLD * whole, self._rounding):
            done = "took" if gap < 0.0 else "made"
            yield (
                f"{self.scheme} {done} {abs(gap):.3g} J of energy by t = {time:.6g} s,"
                f" {abs(gap) / whole:.2g} of what moves back and forth or was brought in: a smaller"
                " dt or tolerance keeps it"
            )

    # --- hinges -----------------------------------------------------------------------------

    def _follow_hinges(self, first: int, block: FrameBuffer) -> None:
        """Note hinges whose angle went through 0, from one frame to the next."""
        if not block.angle.shape[1]:
            return
        angles = block.angle
        if self._angles is not None:
            angles = np.concatenate([self._angles[np.newaxis], angles])
        frames, hinges = np.nonzero(np.abs(np.diff(angles, axis=0)) > np.pi)
        offset = first + 1 - (self._angles is not None)
        for frame, hinge in zip(frames.tolist(), hinges.tolist(), strict=True):
            self._folded.setdefault(hinge, (offset + frame) * self.experiment.save_interval)
        self._angles = angles[-1].copy()

    def _turned_through(self) -> Iterator[str]:
        if self._folded:
            hinge = next(iter(self._folded))
            yield (
                f"{len(self._folded)} hinges folded shut and through themselves, the first of them"
                f" hinge {hinge} by t = {self._folded[hinge]:.6g} s: its panels are inside each"
                " other from then on; limits of the hinge (law 'enhanced-linear') keep them apart"
            )

    # --- motion -----------------------------------------------------------------------------

    def _measure(self, first: int, block: FrameBuffer) -> None:
        if self._reference is None:
            self._reference = block.x[0].copy()
        moved = block.x - self._reference
        self._moved = max(self._moved, float(np.sqrt(np.mean(moved**2, axis=(1, 2)).max())))
        self._fast = max(self._fast, float(np.abs(block.v).max()))
        held = moved if self.experiment.precision == "float32" else block.x
        self._far = max(self._far, float(np.abs(held).max()))
        rest = self.experiment.geometry.bars.rest_length
        if len(rest) and (rest > 0.0).any():
            shares = block.length / np.where(rest > 0.0, rest, np.inf)
            shares = np.where(rest > 0.0, shares, np.inf)
            at = int(np.argmin(shares))
            frame, bar = divmod(at, shares.shape[1])
            if shares.flat[at] < self._shrunk[0]:
                time = (first + frame) * self.experiment.save_interval
                self._shrunk = float(shares.flat[at]), bar, time

    def _follow_bars(self, first: int, block: FrameBuffer) -> None:
        """Note bars whose ends went through each other from one frame to the next.

        Their directions are opposite, and their ends moved along them: ends of bars that turn
        about move across.
        """
        bars, interval = self.experiment.geometry.bars, self.experiment.save_interval
        x, v = block.x, block.v
        if self._last is not None:
            x, v = (np.concatenate(pair) for pair in zip(self._last, (x, v), strict=True))
        offset = first - (len(x) - len(block.x))
        self._last = x[-1:].copy(), v[-1:].copy()
        if not len(bars) or len(x) < 2:
            return
        reach = 2.0 * interval * float(np.abs(v).max()) * np.sqrt(3.0)
        near = np.flatnonzero((block.length.min(axis=0) < reach) & (bars.rest_length > 0.0))
        if not len(near):
            return
        i, j = bars.indices[near].T
        along, rate = x[:, j] - x[:, i], v[:, j] - v[:, i]
        sizes = np.linalg.norm(along, axis=2) * np.linalg.norm(rate, axis=2)
        axial = np.abs(np.einsum("tea,tea->te", along, rate)) > ALONG * sizes
        turned = np.einsum("tea,tea->te", along[1:], along[:-1]) < 0.0
        frames, which = np.nonzero(turned & axial[1:] & axial[:-1])
        for frame, bar in zip(frames.tolist(), near[which].tolist(), strict=True):
            self._crossed.setdefault(bar, (offset + frame + 1) * interval)

    def _lost_in_rounding(self) -> Iterator[str]:
        experiment = self.experiment
        eps = float(np.finfo(experiment.precision).eps)
        adaptive = INTEGRATORS[experiment.integrator].step == "adaptive"
        bars = experiment.geometry.bars.rest_length
        size = float(bars.mean()) if len(bars) else 0.0
        # What goes round and comes back to where it was at every frame is not quiet.
        slow = self._fast * experiment.save_interval < size
        if adaptive and slow and AT_REST * size < self._moved < QUIET * size:
            tolerance = experiment.tolerance or 1e-6
            share = tolerance * QUIET * size / self._moved
            if share > tolerance:
                yield (
                    f"nodes moved {self._moved:.2g} m (rms) at most, less than {QUIET:g} of the"
                    f" mean bar: {experiment.integrator!r} holds errors to the tolerance times"
                    f" that, {share:.2g} of the motion in a step; lower the tolerance"
                )
        step = self._fast * experiment.dt
        moves = self._fast * experiment.duration > NEGLIGIBLE * self._extent
        if not adaptive and moves and eps * self._far > COARSE * step:
            yield (
                f"coordinates reach {self._far:.3g} m and are rounded to {eps * self._far:.2g} m,"
                f" and nothing moves more than {step:.2g} m in a step of {experiment.dt:g} s:"
                " motion is lost in rounding; take a larger dt, or move the body to the origin"
            )
