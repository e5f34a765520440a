"""A storey of a Kresling tower, pressed from one state without strain into the other."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from openprc.scenes.option_checks import check_range
from openprc.scenes.probes import deviation_probe, places
from openprc.scenes.scene import Probe, Reference, Scene
from openprc.scenes.slow_drive import smooth_path
from openprc.schema.experiment import Actuator, Experiment, Signal
from openprc.schema.geometry import Bars, Geometry

if TYPE_CHECKING:
    from openprc.scenes.probes import Reals
    from openprc.schema.trajectory import Trajectory

RADIUS, MASS, STIFFNESS = 0.1, 0.02, 2e4  # m, kg, N/m
FRAMES = 200
DECAY = 20.0  # 1/s


def build(*, sides: int, twist: float, height: float, duration: float) -> Scene:
    """Return the tower; options as in the record."""
    check_range("kresling", {"sides": sides}, least=3)
    check_range("kresling", {"twist": twist}, above=0.0, below=180.0)
    check_range("kresling", {"height": height}, above=0.0)
    check_range("kresling", {"duration": duration}, least=1.0)
    from openprc.demlat.meshing import kresling, kresling_second_state  # noqa: PLC0415 - on demand
    from openprc.demlat.planning.step_choice import with_chosen_step  # noqa: PLC0415

    turn = math.radians(twist)
    low, turned = kresling_second_state(sides, radius=RADIUS, height=height, twist=turn)
    mesh = kresling(sides, radius=RADIUS, height=height, twist=turn)
    # Bars between fixed nodes would do nothing.
    bars = mesh.bars[(mesh.bars >= sides).any(axis=1)]
    lengths = np.linalg.norm(mesh.positions[bars[:, 1]] - mesh.positions[bars[:, 0]], axis=1)
    labels = (*(f"bottom{k}" for k in range(sides)), *(f"top{k}" for k in range(sides)))
    path = smooth_path(height, low, duration=duration)
    tower = _Storey(sides, turn, height)

    def exact(times: Reals) -> Reals:
        z = path.at(times)
        radius, angle = tower.balanced(z)
        x = np.repeat(mesh.positions[np.newaxis], len(times), axis=0)
        # The top turns as a whole, from where the mesh has it.
        azimuth = np.arctan2(mesh.positions[sides:, 1], mesh.positions[sides:, 0])
        azimuth = azimuth + (angle - turn)[:, np.newaxis]
        x[:, sides:, 0] = radius[:, np.newaxis] * np.cos(azimuth)
        x[:, sides:, 1] = radius[:, np.newaxis] * np.sin(azimuth)
        x[:, sides:, 2] = z[:, np.newaxis]
        return x

    def rotation(run: Trajectory) -> float:
        top = places(run, labels)[:, sides:, :2]
        first, last = top[0], top[-1]
        cross = (first[:, 0] * last[:, 1] - first[:, 1] * last[:, 0]).sum()
        return math.degrees(math.atan2(float(cross), float((first * last).sum())))

    def strain(run: Trajectory) -> float:
        x = places(run, labels)[-1]
        now = np.linalg.norm(x[bars[:, 1]] - x[bars[:, 0]], axis=1)
        return float(np.abs(now / lengths - 1.0).max())

    source = "h2^2 = h1^2 - 4 R^2 cos(twist) cos(pi / n) at pi - twist"
    scale = float(np.linalg.norm(exact(np.array([duration]))[0] - mesh.positions, axis=1).max())
    top = np.arange(sides, 2 * sides)
    experiment = Experiment(
        geometry=Geometry(
            positions=mesh.positions,
            masses=np.full(2 * sides, MASS),
            fixed=np.arange(2 * sides) < sides,
            labels=labels,
            bars=Bars(
                indices=bars,
                stiffness=np.full(len(bars), STIFFNESS),
                rest_length=lengths,
            ),
            faces=mesh.faces,
        ),
        signals={
            "height": Signal(
                name="height", values=path.values, dt=path.dt, interpolation="cubic", unit="m"
            )
        },
        actuators=tuple(
            Actuator(node=int(node), signal="height", type="position", axes=(False, False, True))
            for node in top
        ),
        duration=duration,
        dt=duration / FRAMES,
        save_interval=duration / FRAMES,
        damping=DECAY * MASS,
        integrator="verlet",
    )
    return Scene(
        name="kresling",
        experiment=with_chosen_step(experiment),
        reference=Reference(
            kind="closed form",
            text=f"a second state without strain, {low:.4g} m high and turned by"
            f" {math.degrees(turned - turn):.4g} degrees; between them radius and twist of the top"
            " balance the bars",
            source=source,
            exact=exact,
            probes=(
                Probe(
                    name="turn of the top",
                    value=math.degrees(turned - turn),
                    unit="deg",
                    tolerance=1e-3,
                    measure=rotation,
                    source=source,
                ),
                Probe(
                    name="largest strain at the end",
                    value=0.0,
                    unit="1",
                    tolerance=1e-4,
                    measure=strain,
                    source=source,
                ),
                deviation_probe(
                    exact,
                    labels,
                    scale=scale,
                    tolerance=2e-3,
                    source=source,
                    interval=duration / FRAMES,
                ),
            ),
        ),
        scale=scale,
        quasi_static=True,
    )


class _Storey:
    """Radius and twist of the top polygon of a storey, at which the bars balance.

    The energy ``(k / 2) ((a - a0)^2 + (b - b0)^2 + (r - r0)^2)`` of one corner, with ``a^2, b^2 =
    z^2 + R0^2 + R^2 - 2 R0 R cos(twist -+ pi / n)`` and ``r = 2 R sin(pi / n)``, has no slope.
    """

    def __init__(self, sides: int, twist: float, height: float) -> None:
        self.half, self.height = math.pi / sides, height
        self.start = np.array([RADIUS, twist])
        self.relaxed = self._lengths(self.start, height)[0]

    def _lengths(self, at: Reals, z: float) -> tuple[Reals, Reals, Reals]:
        """Return lengths (3,), their gradients (3, 2) and Hessians (3, 2, 2)."""
        radius, twist = at
        values, slopes = np.zeros(3), np.zeros((3, 2))
        curves = np.zeros((3, 2, 2))
        for row, angle in enumerate((twist - self.half, twist + self.half)):
            square = z**2 + RADIUS**2 + radius**2 - 2.0 * RADIUS * radius * math.cos(angle)
            values[row] = math.sqrt(square)
            half = np.array([radius - RADIUS * math.cos(angle), RADIUS * radius * math.sin(angle)])
            slopes[row] = half / values[row]
            mixed = RADIUS * math.sin(angle)
            bent = np.array([[1.0, mixed], [mixed, RADIUS * radius * math.cos(angle)]])
            curves[row] = (bent - np.outer(slopes[row], slopes[row])) / values[row]
        values[2], slopes[2, 0] = 2.0 * radius * math.sin(self.half), 2.0 * math.sin(self.half)
        return values, slopes, curves

    def balanced(self, heights: Reals) -> tuple[Reals, Reals]:
        """Return radius [m] and twist [rad] at heights (T,) [m] that change little by little."""
        at, last = self.start.copy(), self.height
        found = np.empty((len(heights), 2))
        for row, z in enumerate(heights.tolist()):
            # Newton's method needs a start nearby: long ways are gone in parts.
            for part in np.linspace(last, z, 2 + int(abs(z - last) / 5e-4)).tolist():
                at = self._newton(at, part)
            found[row], last = at, z
        return found[:, 0], found[:, 1]

    def _newton(self, at: Reals, z: float) -> Reals:
        for _ in range(50):
            values, slopes, curves = self._lengths(at, z)
            stretch = values - self.relaxed
            hessian = slopes.T @ slopes + np.einsum("b,bij->ij", stretch, curves)
            step = np.linalg.solve(hessian, slopes.T @ stretch)
            at = at - step
            if abs(step[0]) < 1e-15 and abs(step[1]) < 1e-14:
                break
        return at
