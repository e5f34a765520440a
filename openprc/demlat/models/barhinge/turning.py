"""How far a body that is free to turn gets out of phase with its own rotation."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from openprc.demlat.integrators import INTEGRATORS
from openprc.demlat.planning.phase_drift import turn

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.experiment import Experiment

#: Radians that a body may turn too far or too little by the end without a word.
MOST = 3e-3


class Turning:
    """Sums up what the scheme adds to the rotation of a body as a whole.

    Only of bodies with at most one held node, which can turn without end, and of schemes with a
    fixed step. The angular velocity is ``I^-1 L`` about the centre of mass or the held node.

    Parameters
    ----------
    experiment : Experiment
    """

    def __init__(self, experiment: Experiment) -> None:
        self.experiment = experiment
        held = np.flatnonzero(experiment.held_axes.any(axis=1))
        self._pivot = int(held[0]) if len(held) else None
        self._free = len(held) <= 1 and experiment.geometry.n_nodes > 1
        self._free &= INTEGRATORS[experiment.integrator].step == "fixed"
        self.drift = 0.0
        self._fastest = 0.0

    def follow(self, x: NDArray[np.float64], v: NDArray[np.float64]) -> None:
        """Take frames of positions and velocities (T, N, dims) [m], [m/s]."""
        if not self._free:
            return
        masses = self.experiment.geometry.masses
        arms, speeds = np.zeros((2, *x.shape[:2], 3))
        arms[..., : x.shape[2]], speeds[..., : x.shape[2]] = x, v
        if self._pivot is None:
            shares = masses / masses.sum()
            arms -= np.einsum("n,tna->ta", shares, arms)[:, np.newaxis]
            speeds -= np.einsum("n,tna->ta", shares, speeds)[:, np.newaxis]
        else:
            arms = arms - arms[:, [self._pivot]]
        momentum = np.einsum("n,tna->ta", masses, np.cross(arms, speeds))
        squares = np.einsum("n,tna,tnb->tab", masses, arms, arms)
        inertia = np.trace(squares, axis1=1, axis2=2)[:, None, None] * np.eye(3) - squares
        # A body on one line has no inertia about it.
        rates = np.einsum("tab,tb->ta", np.linalg.pinv(inertia, rcond=1e-9), momentum)
        dt, name = self.experiment.dt, self.experiment.integrator
        for rate in np.linalg.norm(rates, axis=1).tolist():
            self._fastest = max(self._fastest, rate)
            phase = min(rate * dt, 2.0)
            self.drift += abs(turn(name, phase) - phase) * self.experiment.steps_per_frame

    def remarks(self) -> Iterator[str]:
        """Yield how far it got out of phase, where that matters."""
        if self.drift > MOST:
            yield (
                f"the body turned at up to {self._fastest:.3g} rad/s, and"
                f" {self.experiment.integrator!r} turned it some {self.drift:.2g} rad too far or"
                " too little by the end: positions are off by that times their distance from the"
                " axis; take a smaller dt, pefrl or dop853"
            )
