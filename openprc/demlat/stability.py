"""How large a time step the explicit scheme can take, estimated before the run."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from openprc.demlat.observables import hinge_gradients

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.experiment import Experiment

#: Largest ``h * |eigenvalue|`` of the classical Runge-Kutta scheme on the negative real axis;
#: on the imaginary axis it is 2 sqrt(2) = 2.83 (Hairer & Wanner, Solving Ordinary Differential
#: Equations II, sec. IV.2, doi:10.1007/978-3-642-05221-7).
STABILITY_LIMIT = 2.785
ITERATIONS = 60

Operator = Callable[["NDArray[np.float64]"], "NDArray[np.float64]"]


def stable_step(experiment: Experiment) -> float:
    """Return the largest stable time step [s], or infinity when nothing is stiff.

    Power iteration on ``M^-1 K`` and ``M^-1 C`` of the body as it lies at t = 0. Large
    rotations leave the estimate; a body that is stretched or folded far stiffens beyond it.

    """
    geometry = experiment.geometry
    drag, held = experiment.drag, experiment.held_axes
    masses = np.where(held, 1.0, geometry.masses[:, np.newaxis])
    mobility = np.where(held, 0.0, 1.0 / masses)
    groups = [_bar_gradients(experiment), _hinge_gradients(experiment)]

    def operator(coefficients: list[NDArray[np.float64]], direct: NDArray[np.float64]) -> Operator:
        def apply(u: NDArray[np.float64]) -> NDArray[np.float64]:
            force = direct[:, np.newaxis] * u
            for (indices, gradients), factor in zip(groups, coefficients, strict=True):
                amount = factor * np.einsum("eka,eka->e", gradients, u[indices])
                for column in range(indices.shape[1]):
                    np.add.at(force, indices[:, column], amount[:, None] * gradients[:, column])
            return mobility * force

        return apply

    bars, hinges = geometry.bars, geometry.hinges
    stiffness = operator([bars.stiffness, hinges.stiffness], np.zeros(len(drag)))
    damping = operator([bars.damping, hinges.damping], drag)
    omega = np.sqrt(_largest_eigenvalue(stiffness, mobility))
    rate = max(float(omega), _largest_eigenvalue(damping, mobility))
    return STABILITY_LIMIT / rate if rate > 0 else float("inf")


def _bar_gradients(
    experiment: Experiment,
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Return indices (M, 2) and d(length)/dx (M, 2, 3)."""
    indices = experiment.geometry.bars.indices
    ends = experiment.geometry.positions[indices]
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    unit = np.divide(along, length, out=np.zeros_like(along), where=length > 0)
    return indices, np.stack([-unit, unit], axis=1)


def _hinge_gradients(
    experiment: Experiment,
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Return indices (K, 4) and d(angle)/dx (K, 4, 3)."""
    indices = experiment.geometry.hinges.indices
    return indices, hinge_gradients(experiment.geometry.positions[np.newaxis], indices)[0]


def _largest_eigenvalue(operator: Operator, mobility: NDArray[np.float64]) -> float:
    # A fixed generator: the estimate, and with it the note in the file, is reproducible.
    u = np.where(mobility > 0, np.random.default_rng(0).standard_normal(mobility.shape), 0.0)
    eigenvalue = 0.0
    for _ in range(ITERATIONS):
        norm = float(np.linalg.norm(u))
        if norm == 0.0 or not np.isfinite(norm):
            break
        u = operator(u / norm)
        eigenvalue = float(np.linalg.norm(u))
    return eigenvalue
