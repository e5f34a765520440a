"""Order of every integrator on bodies of four kinds, and the balance of its energy ledger.

    python benchmarks/integrator_order.py [--integrators rk4 verlet ...] [--json]

The step is halved from rung to rung, and the slope of the error over it is the order. Integrators
that choose their steps are held to steps of one length by a force of nothing whose signal has a
knot at every one of them, at a tolerance that never rejects a step; how the error follows the
tolerance without that, by a slope that should be one, is printed besides. Kinds:

- undamped, damped: a mass on a spring, with and without dashpot, against its closed form; for
  schemes that keep constraints a pendulum with a rigid bar, with and without drag, against the
  equation of its angle solved to 1e-13 by SciPy
- driven: the same with the pivot moved by a cubic signal
- bends: a crooked chain with dashpots, bars soft or rigid, in the field of gravity

Where there is no closed form the reference is SciPy's DOP853 from knot to knot, dop853 with a
tolerance of 1e-13, or rk4-dae with steps of a five-thousandth of a frame. Every measured order
has to be within 0.2 of the declared one ("ok"). The lattice of the demo is run once with each, and
the energy that the ledger cannot account for is given as a fraction of the work of the drive.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.integrate import solve_ivp

from openprc.demlat import BarHingeModel
from openprc.demlat.integrators import INTEGRATORS
from openprc.demlat.samples import write_sample
from openprc.demlat.signal_table import sample_signal
from openprc.hooks import run_experiment
from openprc.schema import Trajectory
from openprc.schema.experiment import Actuator, Experiment, Signal, load_experiment, save_experiment
from openprc.schema.geometry import Bars, Bends, Geometry

WITHIN = 0.2
KINDS = ("undamped", "damped", "driven", "bends")
STEPS = [0.0125 / 2**i for i in range(5)]
FORCED = {"rk45": [0.05 / 2**i for i in range(5)], "dop853": [0.2, 0.1, 0.05]}
LOOSE = 0.1
TOLERANCES = [10.0**-i for i in range(4, 10)]
STIFFNESS, MASS, STRETCH, DURATION, FRAME = 100.0, 1.0, 0.1, 2.0, 0.1
LENGTH, GRAVITY, DRAG, DASHPOT = 1.0, 9.81, 0.4, 2.0
START = 1.0  # [rad], of the pendulum
N_CHAIN, EASED = 6, 0.5


# --- bodies --------------------------------------------------------------------------------------


def body(kind: str, *, rigid: bool) -> Experiment:
    """Return the scene of a kind, with soft or rigid bars."""
    if kind == "bends":
        return _chain(rigid=rigid)
    damped = kind == "damped"
    start = [math.sin(START), -math.cos(START), 0.0] if rigid else [LENGTH + STRETCH, 0.0, 0.0]
    bars = Bars(
        indices=[[0, 1]],
        stiffness=[STIFFNESS],
        rest_length=[LENGTH],
        damping=[DASHPOT if damped and not rigid else 0.0],
        rigid=[rigid],
    )
    driven = kind == "driven"
    geometry = Geometry(
        positions=[[0.0, 0.0, 0.0], start],
        masses=[MASS, MASS],
        fixed=[not driven, False],
        bars=bars,
    )
    scene = Experiment(
        geometry=geometry,
        duration=DURATION,
        dt=FRAME,
        save_interval=FRAME,
        gravity=(0.0, -GRAVITY if rigid else 0.0, 0.0),
        damping=DRAG if damped and rigid else 0.0,
        step_check="warn",
    )
    if not driven:
        return scene
    # The spline through these samples is at rest at the start, or the first frame would jump.
    t = FRAME * np.arange(round(DURATION / FRAME) + 1)
    shift = 0.05 * np.stack([np.sin(3.0 * t) ** 2, 0.3 * (1.0 - np.cos(5.0 * t)), 0.0 * t], axis=1)
    signal = Signal(name="pivot", values=shift, dt=FRAME, interpolation="cubic")
    return replace(
        scene,
        signals={"pivot": signal},
        actuators=(Actuator(node=0, signal="pivot", type="position"),),
    )


def _chain(*, rigid: bool) -> Experiment:
    rng = np.random.default_rng(0)
    steps = 0.3 * (rng.standard_normal((N_CHAIN - 1, 3)) + np.array([2.0, 0.0, 0.0]))
    first = np.arange(N_CHAIN - 1)
    inner = np.arange(N_CHAIN - 2)
    geometry = Geometry(
        positions=np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)]),
        masses=rng.uniform(0.5, 2.0, N_CHAIN),
        fixed=np.arange(N_CHAIN) == 0,
        bars=Bars(
            indices=np.stack([first, first + 1], axis=1),
            stiffness=rng.uniform(100.0, 200.0, N_CHAIN - 1),
            rest_length=np.linalg.norm(steps, axis=1),
            damping=np.full(N_CHAIN - 1, 0.0 if rigid else EASED),
            rigid=np.full(N_CHAIN - 1, rigid),
        ),
        bends=Bends(
            indices=np.stack([inner, inner + 1, inner + 2], axis=1),
            stiffness=rng.uniform(2.0, 4.0, N_CHAIN - 2),
            rest_angle=rng.uniform(1.5, 2.5, N_CHAIN - 2),
            damping=np.full(N_CHAIN - 2, 0.2 * EASED),
        ),
    )
    return Experiment(
        geometry=geometry,
        duration=0.5,
        dt=FRAME,
        save_interval=FRAME,
        gravity=(0.0, 0.0, -GRAVITY),
        damping=0.3,
        step_check="warn",
    )


# --- what the motion is --------------------------------------------------------------------------


@cache
def exact(kind: str, *, rigid: bool) -> np.ndarray:
    """Return positions at the frames: (T, N, 3) [m]."""
    scene = body(kind, rigid=rigid)
    if kind == "driven" and not rigid:
        return _pulled(scene)
    if kind in ("driven", "bends"):
        best = (
            replace(scene, integrator="rk4-dae", dt=FRAME / 5120)
            if rigid
            else replace(scene, integrator="dop853", tolerance=1e-13)
        )
        return run(best)[0]
    t = scene.frame_times
    x = np.zeros((len(t), 2, 3))
    if rigid:
        drag = scene.drag[1] / MASS

        def swing(_: float, y: np.ndarray) -> list[float]:
            return [y[1], -GRAVITY / LENGTH * math.sin(y[0]) - drag * y[1]]

        angle = solve_ivp(
            swing, (0.0, DURATION), [START, 0.0], method="DOP853", t_eval=t, rtol=1e-13, atol=1e-14
        ).y[0]
        x[:, 1, 0], x[:, 1, 1] = np.sin(angle), -np.cos(angle)
        return x
    rate = scene.geometry.bars.damping[0] / (2.0 * MASS)
    omega = math.sqrt(STIFFNESS / MASS - rate**2)
    wave = np.cos(omega * t) + rate / omega * np.sin(omega * t)
    x[:, 1, 0] = LENGTH + STRETCH * np.exp(-rate * t) * wave
    return x


def _pulled(scene: Experiment) -> np.ndarray:
    """Return the motion of a mass that a driven node pulls along; the spring turns with it."""
    signal, t = scene.signals["pivot"], scene.frame_times

    def motion(now: float, y: np.ndarray) -> np.ndarray:
        arm = y[:3] - sample_signal(signal, np.array([now]))[0]
        length = np.linalg.norm(arm)
        return np.concatenate([y[3:], -STIFFNESS / MASS * (1.0 - LENGTH / length) * arm])

    x = np.zeros((len(t), 2, 3))
    x[:, 0] = sample_signal(signal, t)
    x[0, 1] = scene.geometry.positions[1]
    state = np.concatenate([x[0, 1], np.zeros(3)])
    for frame in range(len(t) - 1):  # between knots the spline is smooth
        state = solve_ivp(
            motion, t[frame : frame + 2], state, method="DOP853", rtol=1e-13, atol=1e-14
        ).y[:, -1]
        x[frame + 1, 1] = state[:3]
    return x


def forced(scene: Experiment, step: float) -> Experiment:
    """Return the scene with a signal that no step goes past: every step then has this length."""
    beat = Signal(name="beat", values=np.zeros(round(scene.duration / step) + 1), dt=step)
    nothing = Actuator(node=scene.geometry.n_nodes - 1, signal="beat", type="force")
    frame = max(step, FRAME)
    return replace(
        scene,
        signals={**scene.signals, "beat": beat},
        actuators=(*scene.actuators, nothing),
        dt=frame,
        save_interval=frame,
        tolerance=LOOSE,
    )


def run(scene: Experiment) -> tuple[np.ndarray, int]:
    """Return the positions of a run in memory, and the number of its steps."""
    model = BarHingeModel(scene)
    frames = np.concatenate([block.x.copy() for _, block in model.blocks()])
    steps = scene.steps_per_frame * (scene.n_frames - 1)
    return frames, model.effort.get("steps", steps)


# --- orders --------------------------------------------------------------------------------------


def order(name: str, kind: str) -> dict[str, Any]:
    """Return errors, steps, and the order of an integrator on a kind of body."""
    scheme = INTEGRATORS[name]
    rigid = scheme.rigid != "no"
    scene = replace(body(kind, rigid=rigid), integrator=name)
    adaptive = scheme.step == "adaptive"
    truth = exact(kind, rigid=rigid)

    def errors_of(scenes: list[Experiment]) -> tuple[list[float], list[float]]:
        errors, lengths = [], []
        for one in scenes:
            x, steps = run(one)
            every = round(one.save_interval / FRAME)
            errors.append(float(np.abs(x - truth[::every, :, : x.shape[2]]).max()))
            lengths.append(one.duration / steps)
        return errors, lengths

    if adaptive:
        # Not past knots of the signal that drives, and short against the fastest mode.
        share = {"driven": 2.0, "bends": 4.0}.get(kind, 1.0)
        rungs = [step / share for step in FORCED[name]]
        errors, lengths = errors_of([forced(scene, rung) for rung in rungs])
    else:
        rungs = [step / 16 for step in STEPS] if scheme.step == "legacy" else STEPS
        errors, lengths = errors_of([replace(scene, dt=rung) for rung in rungs])
    # Where rounding, or the reference, is reached there is no order to be seen.
    floor = 1e-11 * float(np.ptp(truth, axis=0).max())
    seen = [number for number, error in enumerate(errors) if error > floor]
    slope = float(np.polyfit(np.log(np.array(lengths)[seen]), np.log(np.array(errors)[seen]), 1)[0])
    result: dict[str, Any] = {"rung": rungs, "step": lengths, "error": errors, "order": slope}
    result["slopes"] = [
        math.log(errors[a] / errors[b]) / math.log(lengths[a] / lengths[b])
        for a, b in itertools.pairwise(seen)
    ]
    if adaptive:
        free = errors_of([replace(scene, tolerance=tolerance) for tolerance in TOLERANCES])[0]
        result["over_tolerance"] = float(np.polyfit(np.log(TOLERANCES), np.log(free), 1)[0])
    return result


def energy_gap(folder: Path, name: str) -> float:
    """Return the unaccounted energy of the demo's lattice as a fraction of the work done."""
    path = write_sample(folder).path
    save_experiment(replace(load_experiment(path), integrator=name), path)
    with Trajectory(run_experiment(path, folder / "simulation.h5").path) as run:
        total, work, lost = (run.system(n) for n in ("total_energy", "work_in", "dissipated"))
    return float(np.abs(total - total[0] - work + lost).max() / np.abs(work).max())


def measure(name: str, folder: Path) -> dict[str, Any]:
    """Return the orders of an integrator, and the energy gap."""
    scheme = INTEGRATORS[name]
    # The old stepping takes the nearest sample of a signal, and has no bends.
    kinds = KINDS[:2] if scheme.step == "legacy" else KINDS
    result: dict[str, Any] = {"declared": scheme.order, "kinds": {}}
    for kind in kinds:
        result["kinds"][kind] = order(name, kind)
    result["largest_deviation"] = max(
        abs(found["order"] - scheme.order) for found in result["kinds"].values()
    )
    result["ok"] = result["largest_deviation"] <= WITHIN
    if scheme.step != "legacy":  # it keeps no ledger
        result["energy_gap"] = energy_gap(folder / "lattice", name)
    return result


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--integrators", nargs="+", choices=list(INTEGRATORS),
                        default=list(INTEGRATORS))  # fmt: skip
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        results = {scheme: measure(scheme, Path(name) / scheme) for scheme in options.integrators}
    if options.json:
        print(json.dumps(results))
        return
    table = Table(title="orders, and the largest error at the last rung [m]")
    for title in ("", "declared", *KINDS, "over tolerance", "ok", "energy gap"):
        table.add_column(title, justify="left" if not title else "right", no_wrap=True)
    for scheme, result in results.items():
        cells = []
        for kind in KINDS:
            found = result["kinds"].get(kind)
            cells.append(
                "-" if found is None else f"{found['order']:.2f} ({found['error'][-1]:.0e})"
            )
        over = [f["over_tolerance"] for f in result["kinds"].values() if "over_tolerance" in f]
        gap = result.get("energy_gap")
        table.add_row(
            scheme, str(result["declared"]), *cells,
            f"{min(over):.2f} to {max(over):.2f}" if over else "-",
            "yes" if result["ok"] else "NO",
            "-" if gap is None else f"{gap:.1e}",
        )  # fmt: skip
    console = Console(width=max(Console().width, 130))
    console.print(table)


if __name__ == "__main__":
    main()
