"""Inverse dynamics of a planar arm of two links: path in, torques out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.tasks.scoring import Metric
from openprc.analysis.tasks.series import TargetSeries, TaskData
from openprc.analysis.tasks.task import (
    Randomness,
    SourcedTask,
    generator_of,
    positive_count,
    positive_number,
)
from openprc.errors import TaskError

# Below this sine of the elbow angle the arm is straight and its joints would have to spin.
_STRAIGHT = 1e-3


@dataclass(frozen=True)
class TwoLinkArm:
    """Two uniform rods in a plane, the first hinged at the origin.

    Joint angles q = (q1, q2) [rad]: q1 from the x axis to the first rod, q2 from there to the
    second. Equations of motion: ``M(q) q'' + c(q, q') + damping q' + g(q) = torque``, as they
    follow from Lagrange's equations for rods with their mass in the middle and the moment of
    inertia m l^2 / 12.

    Parameters
    ----------
    lengths : (2,) [m]
    masses : (2,) [kg]
    damping : float [N m s]
        Of both joints.
    gravity : float [m/s^2]
        Along -y; 0 for an arm that lies flat.
    elbow : {1, -1}
        Sign of q2.
    """

    lengths: tuple[float, float] = (0.5, 0.5)
    masses: tuple[float, float] = (1.0, 1.0)
    damping: float = 0.0
    gravity: float = 9.81
    elbow: int = 1

    def __post_init__(self) -> None:
        for key in ("lengths", "masses"):
            pair = tuple(getattr(self, key))
            if len(pair) != 2:
                raise TaskError(
                    f"{key} is {pair!r}",
                    expected="two numbers",
                    fix="give one for each link",
                    key=key,
                )
            object.__setattr__(self, key, tuple(positive_number(value, key) for value in pair))
        positive_number(self.damping, "damping", zero=True)
        positive_number(self.gravity, "gravity", zero=True)
        if self.elbow not in (1, -1):
            raise TaskError(
                f"the elbow is {self.elbow!r}", expected="1 or -1", fix="choose one", key="elbow"
            )

    def position(self, q: ArrayLike) -> NDArray[np.float64]:
        """Return where the tip is, (..., 2) [m]."""
        angles = np.asarray(q, dtype=np.float64)
        l1, l2 = self.lengths
        first, both = angles[..., 0], angles.sum(axis=-1)
        return np.stack(
            [l1 * np.cos(first) + l2 * np.cos(both), l1 * np.sin(first) + l2 * np.sin(both)],
            axis=-1,
        )

    def joint_angles(self, position: ArrayLike) -> NDArray[np.float64]:
        """Return the joint angles (K, 2) [rad] of positions (K, 2) [m] of the tip.

        Raises
        ------
        TaskError
            When a position is out of reach, or the arm would be straight or folded.
        """
        xy = np.asarray(position, dtype=np.float64)
        l1, l2 = self.lengths
        x, y = xy[..., 0], xy[..., 1]
        cosine = (x**2 + y**2 - l1**2 - l2**2) / (2.0 * l1 * l2)
        out = np.abs(cosine) > np.sqrt(1.0 - _STRAIGHT**2)
        if out.any():
            radius = np.hypot(x, y)
            raise TaskError(
                f"{int(np.count_nonzero(out))} positions are out of reach; the path is between "
                f"{radius.min():.4g} and {radius.max():.4g} m from the shoulder",
                expected=f"more than {abs(l1 - l2):.4g} and less than {l1 + l2:.4g} m",
                fix="move its centre, make it smaller, or the arm longer",
                key="position",
            )
        sine = self.elbow * np.sqrt(1.0 - cosine**2)
        q1 = np.arctan2(y, x) - np.arctan2(l2 * sine, l1 + l2 * cosine)
        return np.stack([q1, np.arctan2(sine, cosine)], axis=-1)

    def joint_motion(
        self, position: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return q, q' and q'' (K, 2) of a motion (K, 2) of the tip in SI units."""
        q = self.joint_angles(position)
        v, a = np.asarray(velocity, dtype=np.float64), np.asarray(acceleration, dtype=np.float64)
        l1, l2 = self.lengths
        first, both = q[..., 0], q.sum(axis=-1)
        # dx/dq: column 2 turns the outer rod only, column 1 both.
        outer = np.stack([-l2 * np.sin(both), l2 * np.cos(both)], axis=-1)
        inner = np.stack([-l1 * np.sin(first), l1 * np.cos(first)], axis=-1) + outer
        jacobian = np.stack([inner, outer], axis=-1)
        dq = np.linalg.solve(jacobian, v[..., None])[..., 0]
        w1, w12 = dq[..., [0]], dq.sum(axis=-1)[..., None]
        # What the tip accelerates by while the joints turn steadily points to each hinge.
        central = -(w1**2) * l1 * np.stack([np.cos(first), np.sin(first)], axis=-1)
        central -= w12**2 * l2 * np.stack([np.cos(both), np.sin(both)], axis=-1)
        ddq = np.linalg.solve(jacobian, (a - central)[..., None])[..., 0]
        return q, dq, ddq

    def torques(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> NDArray[np.float64]:
        """Return the joint torques (K, 2) [N m] of joint angles, rates and accelerations."""
        angle, rate, turn = (np.asarray(part, dtype=np.float64) for part in (q, dq, ddq))
        (l1, l2), (m1, m2) = self.lengths, self.masses
        q1, q2 = angle[..., 0], angle[..., 1]
        w1, w2 = rate[..., 0], rate[..., 1]
        a1, a2 = turn[..., 0], turn[..., 1]
        shared = 0.5 * m2 * l1 * l2
        outer = m2 * l2**2 / 3.0
        coupled = outer + shared * np.cos(q2)
        inner = m1 * l1**2 / 3.0 + m2 * l1**2 + outer + 2.0 * shared * np.cos(q2)
        bend = shared * np.sin(q2)
        weight = 0.5 * m2 * l2 * self.gravity * np.cos(q1 + q2)
        shoulder = inner * a1 + coupled * a2 - bend * (2.0 * w1 * w2 + w2**2) + self.damping * w1
        shoulder += (0.5 * m1 + m2) * l1 * self.gravity * np.cos(q1) + weight
        elbow = coupled * a1 + outer * a2 + bend * w1**2 + self.damping * w2 + weight
        return np.stack([shoulder, elbow], axis=-1)


@dataclass(frozen=True)
class InverseArmTask(SourcedTask):
    """Give the torques that make the tip of an arm follow the path that drives the body.

    Each coordinate of the path is a sum of sines of equal amplitude and random phase, so that
    velocities and accelerations, and with them the torques, are exact.

    Parameters
    ----------
    dt : float [s]
        Time between rows.
    centre : (2,) [m]
    amplitude : float [m]
        Largest possible excursion of each coordinate.
    frequencies : tuple of float [Hz]
    arm : TwoLinkArm
    """

    dt: float = 0.01
    centre: tuple[float, float] = (0.5, 0.3)
    amplitude: float = 0.15
    frequencies: tuple[float, ...] = (0.211, 0.373, 0.433)
    arm: TwoLinkArm = field(default_factory=TwoLinkArm)
    metric: ClassVar[Metric] = "nrmse"
    name: ClassVar[str] = "inverse-arm"
    formula: ClassVar[str] = (
        "torque = M(q) q'' + c(q, q') + damping q' + g(q), q from the position of the tip of a "
        "planar arm of two uniform rods"
    )
    source: ClassVar[str] = (
        "inverse dynamics of a two-link arm after Hauser et al. 2011, "
        "doi:10.1007/s00422-012-0471-0; arm and path are those of the parameters"
    )

    def __post_init__(self) -> None:
        positive_number(self.dt, "dt")
        positive_number(self.amplitude, "amplitude")
        if not self.frequencies:
            raise TaskError(
                "no frequencies",
                expected="at least one",
                fix="name the frequencies of the path",
                key="frequencies",
            )
        for frequency in self.frequencies:
            positive_number(frequency, "frequencies")

    def path(
        self, t: ArrayLike, phases: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return position, velocity and acceleration of the tip, (K, 2) in SI units.

        Parameters
        ----------
        t : (K,) [s]
        phases : (2, frequencies) [rad]
        """
        time = np.asarray(t, dtype=np.float64)[..., None, None]
        omega = 2.0 * np.pi * np.asarray(self.frequencies)
        each = self.amplitude / len(omega)
        angle = omega * time + phases
        position = np.asarray(self.centre) + each * np.sin(angle).sum(axis=-1)
        velocity = each * (omega * np.cos(angle)).sum(axis=-1)
        acceleration = -each * (omega**2 * np.sin(angle)).sum(axis=-1)
        return position, velocity, acceleration

    def generate(self, n: int, *, rng: Randomness) -> TaskData:
        """Return `n` positions (K, 2) [m] and the torques (K, 2) [N m] at the same instants.

        Raises
        ------
        TaskError
            When the arm does not reach the path.
        """
        generator, seed = generator_of(rng)
        phases = generator.uniform(0.0, 2.0 * np.pi, (2, len(self.frequencies)))
        t = self.dt * np.arange(positive_count(n, "n"))
        position, velocity, acceleration = self.path(t, phases)
        torques = self.arm.torques(*self.arm.joint_motion(position, velocity, acceleration))
        return TaskData(
            input=position,
            target=TargetSeries(torques, names=("shoulder", "elbow")),
            metadata={**self.metadata(), "phases": phases.ravel().tolist()},
            seed=seed,
        )
