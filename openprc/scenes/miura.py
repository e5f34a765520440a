"""A Miura sheet: shaken for tasks, or folded slowly as programs for origami do it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from openprc.scenes.closed_forms import miura_fold_energy, miura_places, miura_tilt
from openprc.scenes.converged import converged_motion
from openprc.scenes.folded_sheets import sheet_elements
from openprc.scenes.option_checks import check_range
from openprc.scenes.probes import deviation_probe, places
from openprc.scenes.scene import Probe, Reference, Scene
from openprc.scenes.slow_drive import smooth_path
from openprc.schema.dihedral import dihedral_angles
from openprc.schema.experiment import Actuator, Experiment, Signal
from openprc.schema.geometry import Geometry

if TYPE_CHECKING:
    from openprc.scenes.probes import Reals
    from openprc.schema.trajectory import Trajectory

SECTOR = math.radians(60.0)
#: The sheet that is shaken: edges [m], tilt, areal density [kg/m2], E A [N], folds and facets
#: [N m / rad per m], dashpots of the bars [N s/m], drag over mass [1/s].
EDGE, TILT, DENSITY = 0.05, math.radians(45.0), 0.5
MODULUS, FOLD, FACET, BAR_DAMPING, DECAY = 50.0, 0.05, 0.5, 0.02, 20.0
HOLD, FRAMES_PER_SYMBOL, PARTS = 0.1, 5, 50  # s
CHECKED = 5
#: The sheet that is folded: the dimensionless example of MERLIN in m, N and kg.
BIG, FOLDED, MASS, FRAMES = 2.0, (math.radians(15.0), math.radians(60.0)), 1.0, 100


def build(
    *,
    variant: Literal["driven", "folding"],
    columns: int,
    rows: int,
    n_symbols: int,
    strength: float,
    seed: int,
    duration: float,
    fold: float,
    facet: float,
) -> Scene:
    """Return the Miura sheet; options as in the record."""
    check_range("miura", {"columns": columns, "rows": rows, "n_symbols": n_symbols}, least=1)
    check_range("miura", {"seed": seed}, least=0)
    check_range("miura", {"strength": strength, "fold": fold, "facet": facet}, above=0.0)
    check_range("miura", {"duration": duration}, least=1.0)
    if variant == "folding":
        return _folding(columns, rows, duration=duration, fold=fold, facet=facet)
    return _driven(columns, rows, n_symbols=n_symbols, strength=strength, seed=seed)


def _labels(columns: int, rows: int) -> tuple[str, ...]:
    return tuple(f"c{i}r{j}" for i in range(2 * columns + 1) for j in range(2 * rows + 1))


def _driven(columns: int, rows: int, *, n_symbols: int, strength: float, seed: int) -> Scene:
    from openprc.demlat.meshing import miura_sheet  # noqa: PLC0415 - meshes are for this branch
    from openprc.demlat.planning.step_choice import with_chosen_step  # noqa: PLC0415
    from openprc.demlat.signals import held_symbols  # noqa: PLC0415

    mesh = miura_sheet(columns, rows, a=EDGE, b=EDGE, sector_angle=SECTOR, tilt=TILT)
    masses = mesh.lumped_masses(DENSITY)
    left, right = mesh.node_sets["left"], mesh.node_sets["right"]
    drive = held_symbols(
        n_symbols,
        HOLD,
        np.random.default_rng(seed),
        low=0.0,
        high=0.5,
        rise=0.4 * HOLD,
        dt=HOLD / PARTS,
    )
    labels = _labels(columns, rows)
    experiment = Experiment(
        geometry=Geometry(
            positions=mesh.positions,
            masses=masses,
            fixed=np.isin(np.arange(mesh.n_nodes), left),
            labels=labels,
            **sheet_elements(mesh, modulus=MODULUS, fold=FOLD, facet=FACET, damping=BAR_DAMPING),
        ),
        signals={
            "force": Signal(
                name="force",
                values=strength / len(right) * drive.values,
                dt=drive.dt,
                interpolation="linear",
                unit="N",
                sequence=drive.sequence,
                hold=drive.hold,
            )
        },
        actuators=tuple(
            Actuator(node=int(node), signal="force", type="force", axes=(False, False, True))
            for node in right
        ),
        duration=n_symbols * HOLD,
        dt=HOLD / PARTS,
        save_interval=HOLD / FRAMES_PER_SYMBOL,
        damping=DECAY * float(masses.mean()),
    )
    # The force has a corner at every sample: steps end there.
    apart = PARTS // FRAMES_PER_SYMBOL
    steps = math.ceil(with_chosen_step(experiment).steps_per_frame / apart) * apart
    experiment = replace(experiment, dt=experiment.save_interval / steps)
    exact = converged_motion(experiment)
    scale = EDGE
    checked = min(CHECKED, n_symbols)
    return Scene(
        name="miura",
        experiment=experiment,
        reference=Reference(
            kind="converged",
            text=f"compared over the first {checked} symbols",
            source="SciPy's DOP853 to 1e-11 from corner to corner of the force",
            exact=exact,
            probes=(
                deviation_probe(
                    exact, labels, scale=scale, tolerance=1e-3, source="DOP853",
                    until=checked * HOLD,
                ),
            ),
        ),
        scale=scale,
        input_name="force",
    )  # fmt: skip


def _folding(columns: int, rows: int, *, duration: float, fold: float, facet: float) -> Scene:
    from openprc.demlat.meshing import miura_sheet  # noqa: PLC0415 - as above
    from openprc.demlat.planning.step_choice import with_chosen_step  # noqa: PLC0415

    size: dict[str, Any] = {
        "columns": columns, "rows": rows, "a": BIG, "b": BIG, "sector": SECTOR,
    }  # fmt: skip
    mesh = miura_sheet(columns, rows, a=BIG, b=BIG, sector_angle=SECTOR, tilt=FOLDED[0])
    i, j = np.divmod(np.arange(mesh.n_nodes), 2 * rows + 1)
    begin, end = (miura_places(np.array([tilt]), **size)[0, -1, 0] for tilt in FOLDED)
    width = smooth_path(begin, end, duration=duration)
    labels = _labels(columns, rows)
    sides, even = (i == 0) | (i == 2 * columns), j % 2 == 0
    held: list[tuple[Any, str, tuple[bool, bool, bool]]]
    held = [(node, "still", (True, False, False)) for node in np.flatnonzero(i == 0)]
    held += [(node, "width", (True, False, False)) for node in np.flatnonzero(i == 2 * columns)]
    held += [(node, "still", (False, False, True)) for node in np.flatnonzero(sides & even)]
    held += [(0, "still", (False, True, False))]
    elements = sheet_elements(mesh, modulus=1e5, fold=fold, facet=facet)
    hinges = elements["hinges"]
    folds = np.flatnonzero(mesh.hinge_kinds == "fold")

    def exact(times: Reals) -> Reals:
        tilt = miura_tilt(width.at(times) / (2 * columns), b=BIG, sector=SECTOR)
        return miura_places(tilt, **size)

    def energy(run: Trajectory) -> float:
        angles = dihedral_angles(places(run, labels)[-1:], hinges.indices[folds])[0]
        turned = angles - hinges.rest_angle[folds]
        return float(0.5 * (hinges.stiffness[folds] * turned**2).sum())

    source = "Schenk & Guest 2013, doi:10.1073/pnas.1217998110"
    scale = float(begin - end)
    experiment = Experiment(
        geometry=Geometry(
            positions=mesh.positions,
            masses=np.full(mesh.n_nodes, MASS),
            labels=labels,
            **elements,
        ),
        signals={
            "width": Signal(
                name="width", values=width.values, dt=width.dt, interpolation="cubic", unit="m"
            ),
            "still": Signal(
                name="still", values=np.zeros(2), dt=duration, interpolation="linear", unit="m"
            ),
        },
        actuators=tuple(
            Actuator(node=int(node), signal=signal, type="position", axes=axes)
            for node, signal, axes in held
        ),
        duration=duration,
        dt=duration / FRAMES,
        save_interval=duration / FRAMES,
        damping=1.0 * MASS,
        integrator="verlet",
    )
    return Scene(
        name="miura",
        experiment=with_chosen_step(experiment),
        reference=Reference(
            kind="closed form",
            text="the one way in which rigid panels fold, at the width of every instant; panels"
            f" bend a little, since folds are {fold / facet:.0e} times as stiff as they",
            source=source,
            exact=exact,
            probes=(
                Probe(
                    name="energy of the folds at the end",
                    value=miura_fold_energy(FOLDED[1], FOLDED[0], stiffness=fold, **size),
                    unit="J",
                    tolerance=5e-3,
                    measure=energy,
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
