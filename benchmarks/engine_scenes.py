"""The scenes on which the engine and its peers are timed, as plain arrays.

Square lattices with both diagonals in every cell and Miura sheets with a diagonal in every
panel; nodes are numbered row by row and elements come direction by direction, so that
neighbours in a list are neighbours in memory for everyone who cares. NumPy only: a scene is
written to one ``.npz``, which a peer in another interpreter reads back to the same bits.

`reference_positions` is the classical Runge-Kutta scheme in NumPy, written for being read.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema import Experiment

    Reals = NDArray[np.float64]

SIDE = 0.1  # [m] of lattice cells and of Miura panels
MASS = 0.01  # [kg]
STIFFNESS, SPREAD = 222.15, 0.2  # [N/m], relative half width
BAR_DAMPING = 0.01  # [N*s/m]
DRAG_RATE = 0.8  # [1/s], drag per mass
FOLD_STIFFNESS, FACET_STIFFNESS = 0.01, 0.1  # [N*m/rad]
START_AMPLITUDE = 0.02  # [m]
SECTOR, FOLD, FOLD_AT_START = np.pi / 3, np.pi / 4, 0.95 * np.pi / 4  # [rad]
STIFF_BARS = 2.2e6  # [N/m]
TIME_STEP = 1e-3  # [s]


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """One scene without gravity or actuators.

    Attributes
    ----------
    name : str
    dt : float [s]
    positions, velocities : (N, 3) [m], [m/s]
        At t = 0.
    masses : (N,) [kg]
    drag : (N,) [kg/s]
    fixed : (N,) bool
    bars : (M, 2) [node]
    stiffness, damping, rest_length : (M,) [N/m], [N*s/m], [m]
    hinges : (K, 4) [node]
        ``[j, k, i, l]``, crease first.
    hinge_stiffness : (K,) [N*m/rad]
    rest_angle : (K,) [rad]
        pi is flat, in [0, 2 pi).
    """

    name: str
    dt: float
    positions: Reals
    velocities: Reals
    masses: Reals
    drag: Reals
    fixed: NDArray[np.bool_]
    bars: NDArray[np.int32]
    stiffness: Reals
    damping: Reals
    rest_length: Reals
    hinges: NDArray[np.int32]
    hinge_stiffness: Reals
    rest_angle: Reals

    @property
    def size(self) -> tuple[int, int, int]:
        """Numbers of nodes, bars and hinges."""
        return len(self.positions), len(self.bars), len(self.hinges)


def save_scene(scene: Scene, path: Path) -> None:
    """Write all arrays to one ``.npz``."""
    np.savez(path, **{field.name: getattr(scene, field.name) for field in fields(scene)})


def load_scene(path: Path) -> Scene:
    """Read what `save_scene` wrote."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    return Scene(**arrays | {"name": str(arrays["name"]), "dt": float(arrays["dt"])})


def to_experiment(
    scene: Scene,
    *,
    duration: float,
    save_interval: float,
    dt: float | None = None,
    integrator: str = "rk4",
    tolerance: float | None = None,
    step_check: Literal["refuse", "warn"] = "refuse",
) -> Experiment:
    """Return the scene as the engine takes it; times in [s], `dt` that of the scene if None."""
    # Peers import this module where another package, or none, goes by the name openprc.
    from openprc.schema import Experiment  # noqa: PLC0415
    from openprc.schema.geometry import Bars, Geometry, Hinges  # noqa: PLC0415

    return Experiment(
        geometry=Geometry(
            positions=scene.positions,
            velocities=scene.velocities,
            masses=scene.masses,
            fixed=scene.fixed,
            bars=Bars(
                indices=scene.bars,
                stiffness=scene.stiffness,
                rest_length=scene.rest_length,
                damping=scene.damping,
            ),
            hinges=Hinges(
                indices=scene.hinges,
                stiffness=scene.hinge_stiffness,
                rest_angle=scene.rest_angle,
            ),
        ),
        duration=duration,
        dt=scene.dt if dt is None else dt,
        save_interval=save_interval,
        integrator=integrator,
        tolerance=tolerance,
        step_check=step_check,
        damping=float((scene.drag / scene.masses).mean() * scene.masses.mean()),
    )


# --- shapes -----------------------------------------------------------------------------------


def lattice(name: str, *, n: int, seed: int = 0) -> Scene:
    """Return n x n nodes with both diagonals in every cell, deflected smoothly in 3-D."""
    node = np.arange(n * n, dtype=np.int32).reshape(n, n)
    rows, columns = np.divmod(np.arange(n * n), n)
    flat = np.stack([columns * SIDE, rows * SIDE, np.zeros(n * n)], axis=1)
    bars = _pairs(
        (node[:, :-1], node[:, 1:]),
        (node[:-1], node[1:]),
        (node[:-1, :-1], node[1:, 1:]),
        (node[:-1, 1:], node[1:, :-1]),
    )
    none = np.zeros((0, 4), dtype=np.int32)
    return _scene(name, flat, flat + _deflection(flat), bars, none, np.zeros(0), node, seed)


def miura(name: str, *, cells: tuple[int, int], seed: int = 0) -> Scene:
    """Return a folded sheet of ``rows x columns`` cells (four panels each), deflected smoothly."""
    rest, node, bars, hinges, bending = _miura_sheet(cells, FOLD)
    return _scene(name, rest, rest + _deflection(rest), bars, hinges, bending, node, seed)


def stiff_miura(name: str, *, cells: tuple[int, int], seed: int = 0) -> Scene:
    """Return a sheet of nearly inextensible bars that starts less folded than its hinges rest.

    Both shapes are isometric, so the bars start relaxed and only the soft folds drive.
    """
    rest, node, bars, hinges, bending = _miura_sheet(cells, FOLD)
    start = _miura_sheet(cells, FOLD_AT_START)[0]
    scene = _scene(name, rest, start, bars, hinges, bending, node, seed)
    stiff = {"stiffness": np.full(len(bars), STIFF_BARS)}
    return Scene(**{f.name: getattr(scene, f.name) for f in fields(scene)} | stiff)


SCENES: dict[str, Callable[[], Scene]] = {
    "lat10": lambda: lattice("lat10", n=10),
    "lat30": lambda: lattice("lat30", n=30),
    "lat100": lambda: lattice("lat100", n=100),
    "miu4x8": lambda: miura("miu4x8", cells=(4, 8)),
    "miu20": lambda: miura("miu20", cells=(20, 20)),
    "miu4x8-stiff": lambda: stiff_miura("miu4x8-stiff", cells=(4, 8)),
}
#: (nodes, bars, hinges) that the scenes must have.
COUNTS = {
    "lat10": (100, 342, 0),
    "lat30": (900, 3422, 0),
    "lat100": (10_000, 39_402, 0),
    "miu4x8": (153, 408, 360),
    "miu20": (1681, 4880, 4720),
    "miu4x8-stiff": (153, 408, 360),
}


def make_scene(name: str) -> Scene:
    """Return the scene of that name, the same in every run."""
    scene = SCENES[name]()
    if scene.size != COUNTS[name]:
        message = f"scene {name} has (nodes, bars, hinges) = {scene.size}, not {COUNTS[name]}"
        raise AssertionError(message)
    return scene


def _pairs(*directions: tuple[NDArray[np.int32], ...]) -> NDArray[np.int32]:
    """Return the elements of every direction in turn: (E, columns)."""
    return np.concatenate([np.stack([c.ravel() for c in d], axis=1) for d in directions])


def _deflection(rest: Reals) -> Reals:
    """Return displacements [m] that vanish on the left edge: (N, 3)."""
    low, size = rest.min(axis=0), np.ptp(rest, axis=0)
    xi, eta = (rest[:, 0] - low[0]) / size[0], (rest[:, 1] - low[1]) / size[1]
    rise = np.sin(0.5 * np.pi * xi)
    shape = [rise * np.cos(np.pi * eta), rise * np.sin(np.pi * eta), rise * np.cos(0.7 * eta)]
    return START_AMPLITUDE * np.stack(shape, axis=1)


def _miura_sheet(
    cells: tuple[int, int], fold: float
) -> tuple[Reals, NDArray[np.int32], NDArray[np.int32], NDArray[np.int32], Reals]:
    """Return positions, node numbers, bars, hinges and hinge stiffnesses.

    Coordinates after Schenk & Guest 2013, doi:10.1073/pnas.1217998110, Eqs. 1-4, with equal
    sides; `fold` is the angle between the panels and the plane of the sheet [rad].
    """
    n_rows, n_columns = 2 * cells[0] + 1, 2 * cells[1] + 1
    r, c = np.divmod(np.arange(n_rows * n_columns), n_columns)
    reach = np.sqrt(1.0 + (np.cos(fold) * np.tan(SECTOR)) ** 2)
    across = SIDE * np.cos(fold) * np.tan(SECTOR) / reach
    along = SIDE * np.sqrt(1.0 - (np.sin(fold) * np.sin(SECTOR)) ** 2)
    height, offset = SIDE * np.sin(fold) * np.sin(SECTOR), SIDE / reach
    positions = np.stack([c * across, r * along + (c % 2) * offset, (r % 2) * height], axis=1)

    node = np.arange(n_rows * n_columns, dtype=np.int32).reshape(n_rows, n_columns)
    bars = _pairs(
        (node[:, :-1], node[:, 1:]),
        (node[:-1], node[1:]),
        (node[:-1, :-1], node[1:, 1:]),
    )
    # Every panel is split by its diagonal from (r, c) to (r + 1, c + 1).
    creases = _pairs(
        (node[:-1, 1:-1], node[1:, 1:-1], node[:-1, :-2], node[1:, 2:]),
        (node[1:-1, :-1], node[1:-1, 1:], node[2:, 1:], node[:-2, :-1]),
    )
    facets = _pairs((node[:-1, :-1], node[1:, 1:], node[1:, :-1], node[:-1, 1:]))
    hinges = np.concatenate([creases, facets])
    stiffness = np.repeat([FOLD_STIFFNESS, FACET_STIFFNESS], [len(creases), len(facets)])
    return positions, node, bars, hinges, stiffness


def _scene(
    name: str,
    rest: Reals,
    start: Reals,
    bars: NDArray[np.int32],
    hinges: NDArray[np.int32],
    hinge_stiffness: Reals,
    node: NDArray[np.int32],
    seed: int,
) -> Scene:
    spread = np.random.default_rng(seed).uniform(-SPREAD, SPREAD, len(bars))
    fixed = np.zeros(len(rest), dtype=bool)
    fixed[node[:, 0]] = True
    masses = np.full(len(rest), MASS)
    return Scene(
        name=name,
        dt=TIME_STEP,
        positions=start,
        velocities=np.zeros_like(start),
        masses=masses,
        drag=DRAG_RATE * masses,
        fixed=fixed,
        bars=bars,
        stiffness=STIFFNESS * (1.0 + spread),
        damping=np.full(len(bars), BAR_DAMPING),
        rest_length=np.linalg.norm(rest[bars[:, 1]] - rest[bars[:, 0]], axis=1),
        hinges=hinges,
        hinge_stiffness=hinge_stiffness,
        rest_angle=hinge_angles(rest, hinges),
    )


# --- the scheme, to be read -------------------------------------------------------------------


def hinge_angles(x: Reals, hinges: NDArray[np.int32]) -> Reals:
    """Return dihedral angles in [0, 2 pi), pi being flat: (K,) [rad].

    Blondel & Karplus 1996,
    doi:10.1002/(SICI)1096-987X(19960715)17:9<1132::AID-JCC5>3.0.CO;2-T.
    """
    return _angles_and_gradients(x, hinges)[0]


def _angles_and_gradients(x: Reals, hinges: NDArray[np.int32]) -> tuple[Reals, Reals]:
    j, k, i, l = (x[hinges[:, column]] for column in range(4))  # noqa: E741
    a, b, c = i - j, k - j, k - l
    m, n = np.cross(a, b), np.cross(b, c)
    bb = np.sum(b * b, axis=1, keepdims=True)
    crease = np.sqrt(bb)
    bend = np.arctan2(-crease[:, 0] * np.sum(n * a, axis=1), -np.sum(m * n, axis=1))
    gi = crease * m / np.sum(m * m, axis=1, keepdims=True)
    gl = -crease * n / np.sum(n * n, axis=1, keepdims=True)
    p = np.sum(a * b, axis=1, keepdims=True) / bb
    q = np.sum(c * b, axis=1, keepdims=True) / bb
    gradients = np.stack([(p - 1) * gi - q * gl, (q - 1) * gl - p * gi, gi, gl], axis=1)
    return np.mod(bend + np.pi, 2.0 * np.pi), gradients


def reference_accelerations(scene: Scene, x: Reals, v: Reals) -> Reals:
    """Return the accelerations of all nodes, 0 where fixed: (N, 3) [m/s2]."""
    force = -scene.drag[:, np.newaxis] * v
    i, j = scene.bars.T
    d = x[j] - x[i]
    length = np.linalg.norm(d, axis=1)
    unit = d / length[:, np.newaxis]
    rate = np.sum(unit * (v[j] - v[i]), axis=1)
    tension = scene.stiffness * (length - scene.rest_length) + scene.damping * rate
    np.add.at(force, i, tension[:, np.newaxis] * unit)
    np.add.at(force, j, -tension[:, np.newaxis] * unit)
    angles, gradients = _angles_and_gradients(x, scene.hinges)
    difference = np.mod(angles - scene.rest_angle + np.pi, 2.0 * np.pi) - np.pi
    moment = scene.hinge_stiffness * difference
    np.add.at(force, scene.hinges, -moment[:, np.newaxis, np.newaxis] * gradients)
    return np.where(scene.fixed[:, np.newaxis], 0.0, force / scene.masses[:, np.newaxis])


def reference_positions(scene: Scene, *, n_steps: int) -> Reals:
    """Return positions after `n_steps` classical Runge-Kutta steps: (N, 3) [m]."""
    h, x, v = scene.dt, scene.positions, scene.velocities
    for _ in range(n_steps):
        a1 = reference_accelerations(scene, x, v)
        v2 = v + 0.5 * h * a1
        a2 = reference_accelerations(scene, x + 0.5 * h * v, v2)
        v3 = v + 0.5 * h * a2
        a3 = reference_accelerations(scene, x + 0.5 * h * v2, v3)
        v4 = v + h * a3
        a4 = reference_accelerations(scene, x + h * v3, v4)
        x = x + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
        v = v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
    return x
