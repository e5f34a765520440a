"""Bodies whose motion is known, and how far a run is from it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from openprc.schema import Trajectory
from openprc.schema.experiment import Experiment
from openprc.schema.geometry import Bars, Geometry, Hinges

Reals = NDArray[np.float64]
X, Y, Z = np.eye(3)


def bar_table(rows: Sequence[Sequence[float]], **more: object) -> Bars:
    """Return bars from rows (i, j, stiffness, rest length, damping)."""
    table = np.array(rows, dtype=float).reshape(-1, 5)
    return Bars(
        indices=table[:, :2].astype(int),
        stiffness=table[:, 2],
        rest_length=table[:, 3],
        damping=table[:, 4],
        **more,
    )


class Line:
    """Masses in a row on linear springs that begins at a wall: a linear body, solved by modes.

    On one line, and moving along it, springs stay linear at any stretch.

    Parameters
    ----------
    stiffness, mass, length : (n,) [N/m], [kg], [m]
        Of spring i, which ends at mass i.
    damping : (n,) [N*s/m]
    drag : float
        As `Experiment.damping`.
    offset : float [m]
        Where the wall is.
    amplitude : float [m]
        Displacement of the last mass at the start, in the slowest mode.
    """

    def __init__(
        self,
        stiffness: Sequence[float],
        mass: Sequence[float],
        length: Sequence[float],
        *,
        damping: Sequence[float] | None = None,
        offset: float = 0.0,
        amplitude: float = 0.1,
        speed: float = 0.0,
    ) -> None:
        self.k, self.m = np.array(stiffness, dtype=float), np.array(mass, dtype=float)
        self.lengths = np.array(length, dtype=float)
        self.c = np.zeros_like(self.k) if damping is None else np.array(damping, dtype=float)
        self.rest = offset + np.concatenate([[0.0], np.cumsum(self.lengths)])
        stiff, damp = self._matrix(self.k), self._matrix(self.c)
        root = np.sqrt(self.m)
        squares, modes = np.linalg.eigh(stiff / root[:, None] / root[None, :])
        self.omega = np.sqrt(np.maximum(squares, 0.0))
        shape = modes[:, 0] / root
        shape = shape / shape[np.argmax(np.abs(shape))]
        self.u0 = amplitude * shape
        self.v0 = speed * shape
        self._stiff, self._damp = stiff, damp

    def _matrix(self, values: Reals) -> Reals:
        n = len(values)
        matrix = np.diag(values.copy())
        for i in range(1, n):
            matrix[i - 1, i - 1] += values[i]
            matrix[i - 1, i] = matrix[i, i - 1] = -values[i]
        return matrix

    @property
    def period(self) -> float:
        """Of the slowest mode [s]."""
        return float(2.0 * np.pi / self.omega[0])

    def displacements(self, times: Reals) -> Reals:
        """Return u(t): (T, n) [m]; undamped, or with damping in proportion to the stiffness."""
        root = np.sqrt(self.m)
        scaled = self._stiff / root[:, None] / root[None, :]
        squares, modes = np.linalg.eigh(scaled)
        lossy = np.einsum("ia,ij,ja->a", modes, self._damp / root[:, None] / root[None, :], modes)
        u0, v0 = modes.T @ (root * self.u0), modes.T @ (root * self.v0)
        q = np.empty((len(times), len(squares)))
        for a, (square, loss) in enumerate(zip(squares, lossy, strict=True)):
            rate = 0.5 * loss
            under = square - rate * rate
            if under > 0.0:
                w = np.sqrt(under)
                wave = np.cos(w * times) * u0[a] + np.sin(w * times) * (v0[a] + rate * u0[a]) / w
                q[:, a] = np.exp(-rate * times) * wave
            else:
                w = np.sqrt(-under)
                fast = -(rate + w)
                slow = square / fast  # the difference would lose its digits
                first = (v0[a] - fast * u0[a]) / (slow - fast)
                q[:, a] = first * np.exp(slow * times) + (u0[a] - first) * np.exp(fast * times)
        return (q @ modes.T) / root

    def experiment(self, *, periods: float = 2.0, n_frames: int = 41) -> Experiment:
        """Return the body in its slowest mode; step and integrator are placeholders."""
        n = len(self.m)
        positions = np.outer(self.rest, X)
        positions[1:, 0] += self.u0
        velocities = np.zeros_like(positions)
        velocities[1:, 0] = self.v0
        rows = [(i, i + 1, self.k[i], self.lengths[i], self.c[i]) for i in range(n)]
        geometry = Geometry(
            positions=positions,
            velocities=velocities,
            masses=np.concatenate([[1.0], self.m]),
            fixed=np.arange(n + 1) == 0,
            bars=bar_table(rows),
        )
        frame = periods * self.period / (n_frames - 1)
        return Experiment(
            geometry=geometry, duration=(n_frames - 1) * frame, dt=frame, save_interval=frame
        )

    def error(self, run: Trajectory) -> float:
        """Return the largest error of a displacement over the largest displacement."""
        exact = self.displacements(run.time)
        found = run.positions()[:, 1:, 0] - self.rest[1:]
        return float(np.abs(found - exact).max() / np.abs(exact).max())


def fold(
    angle: float,
    *,
    altitude: float = 1.0,
    rest_angle: float = np.pi,
    stiffness: float = 1.0,
    bar_stiffness: float = 1e4,
    speed: float = 0.0,
    mass: float = 1.0,
) -> Experiment:
    """Return two triangles with a crease along x: one is fixed, the other free to turn.

    Parameters
    ----------
    angle : float [rad]
        Dihedral angle at the start; pi is flat.
    altitude : float [m]
        Of the free wing over the crease, which is 1 m long.
    speed : float [m/s]
        Of the free wing, towards smaller angles.
    """
    j, k, i = 0.0 * X, X, 0.5 * X + Y
    l = 0.5 * X + altitude * (np.cos(angle) * Y + np.sin(angle) * Z)  # noqa: E741
    way = np.sin(angle) * Y - np.cos(angle) * Z
    positions = np.array([j, k, i, l])
    velocities = np.zeros((4, 3))
    velocities[3] = speed * way
    length = float(np.linalg.norm(l - j))
    geometry = Geometry(
        positions=positions,
        velocities=velocities,
        masses=[1.0, 1.0, 1.0, mass],
        fixed=[True, True, True, False],
        bars=bar_table([(0, 3, bar_stiffness, length, 0.0), (1, 3, bar_stiffness, length, 0.0)]),
        hinges=Hinges(indices=[[0, 1, 2, 3]], stiffness=[stiffness], rest_angle=[rest_angle]),
    )
    return Experiment(geometry=geometry, duration=1.0, dt=0.01, save_interval=0.01)


def energy_error(run: Trajectory) -> float:
    """Return the energy that is not accounted for over what moves back and forth.

    Largest ``|E - E_0 - W + D|`` over the largest kinetic energy or change of potential energy.
    """
    total, work, lost = (run.system(name) for name in ("total_energy", "work_in", "dissipated"))
    gap = np.abs(total - total[0] - work + lost).max()
    kinetic, potential = run.system("kinetic_energy"), run.system("potential_energy")
    scale = max(float(kinetic.max()), float(np.ptp(potential)))
    return float(gap / scale) if scale > 0.0 else float(gap)


def against(reference: Callable[[], Reals]) -> Callable[[Trajectory], float]:
    """Return a judge: largest error of a coordinate over the largest displacement."""

    def judge(run: Trajectory) -> float:
        exact, found = reference(), run.positions()
        scale = np.abs(exact - exact[0]).max()
        return float(np.abs(found - exact[..., : found.shape[2]]).max() / scale)

    return judge
