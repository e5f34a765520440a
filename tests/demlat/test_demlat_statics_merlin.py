"""Saved states of MERLIN runs: the static model balances each of them.

The files are outputs of MERLIN and MERLIN2 (Liu & Paulino 2017, doi:10.1098/rspa.2017.0348).
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from openprc.demlat.statics import StaticProblem, find_equilibrium
from openprc.schema.geometry import Bars, Geometry, Hinges

DATA = Path(__file__).resolve().parents[2] / "../shared/data/merlin"
if not DATA.exists():
    pytest.skip("the recorded MERLIN runs are not beside this checkout", allow_module_level=True)

# file, modulus C0, limits [deg], largest residual
RUNS = [
    ("merlin1_miura_folding.mat", 1e6, (0.1, 359.9), 7e-5),
    ("merlin1_miura_bending.mat", 1e4, (0.1, 359.9), 2e-8),
    ("merlin1_miura_bistable.mat", 1e4, (45.0, 315.0), 1e-10),
    ("merlin1_kresling_folding.mat", 5e3, (45.0, 315.0), 1e-10),
    ("merlin2_simplefold_n4b5_disp.mat", 1e4, (0.1, 359.9), 2e-9),
    ("merlin2_kresling_n4b5_disp.mat", 5e3, (45.0, 315.0), 1e-10),
]


def read(name, modulus, limits):
    """Return the body, states (T, N, 3), the loads on it (T, N, 3) and where they are told."""
    run = loadmat(DATA / name, simplify_cells=True, mat_dtype=True)
    truss, angles = run["truss"], run["angles"]
    nodes = truss["Node"]
    bars = truss["Bars"].astype(int) - 1
    rest = truss["L"]
    rows, stiffness, neutral = [], [], []
    for kind, constant, angle in (("bend", "b", "pb0"), ("fold", "f", "pf0")):
        table = np.reshape(angles[kind], (-1, 4)).astype(int) - 1
        per_length = angles["kp" + constant] if "kpf" in angles else angles["K" + constant]
        rows.append(table)
        stiffness.append(np.reshape(per_length, -1)[: len(table)])
        neutral.append(np.reshape(angles[angle], -1)[: len(table)])
    count = sum(map(len, rows))
    # Hinge b lies on bar b, and the constants are per length.
    body = Geometry(
        positions=nodes,
        masses=np.ones(len(nodes)),
        bars=Bars(
            indices=bars,
            stiffness=modulus * truss["A"] / rest,
            rest_length=rest,
            law=["ogden"] * len(bars),
        ),
        hinges=Hinges(
            indices=np.concatenate(rows),
            stiffness=np.concatenate(stiffness) * rest[:count],
            rest_angle=np.concatenate(neutral),
            law=["enhanced-linear"] * count,
            limit_low=np.full(count, np.radians(limits[0])),
            limit_high=np.full(count, np.radians(limits[1])),
        ),
    )
    moves = run["U_his"] if "U_his" in run else run["Uhis"]
    states = nodes + moves.T.reshape(-1, *nodes.shape)
    held = np.zeros(nodes.shape, dtype=bool)
    for node, *axes in np.atleast_2d(run["Supp"]).astype(int):
        held[node - 1] |= np.array(axes, dtype=bool)
    loads = np.zeros((len(states), nodes.size))
    if "LF_his" in run:
        loads[:] = np.reshape(run["LF_his"], (-1, 1)) * run["F"].ravel()
    else:
        imposed = np.flatnonzero(run["AnalyInputOpt"]["Load"].ravel())
        # Displacements are imposed, and the history is minus the force that this takes.
        loads[:, imposed] = -np.reshape(run["Fhis"], (len(states), -1))
    return body, states, loads.reshape(-1, *nodes.shape), held


@pytest.mark.parametrize(("name", "modulus", "limits", "limit"), RUNS)
def test_every_saved_state_is_in_balance(name, modulus, limits, limit):
    body, states, loads, held = read(name, modulus, limits)
    worst, largest = 0.0, 0.0
    for x, load in zip(states, loads, strict=True):
        problem = StaticProblem(geometry=body, loads=load, held=held)
        worst = max(worst, np.abs(problem.gradient(x).ravel()[problem.free]).max())
        largest = max(largest, np.abs(problem.bar_forces(x)).max())
    assert worst < limit
    assert largest > 1e3 * limit


@pytest.mark.parametrize(("increment", "kind"), [(2, "minimum"), (29, "stationary")])
def test_search_settles_on_a_saved_state_from_beside_it(increment, kind):
    # Under a force the sheet folds through a limit point: later states are unstable.
    body, states, loads, held = read(*RUNS[0][:3])
    problem = StaticProblem(geometry=body, loads=loads[increment], held=held)
    wobble = np.random.default_rng(0).normal(scale=1e-4, size=states[0].shape)
    found = find_equilibrium(problem, states[increment] + wobble, kind=kind)
    assert found.stability.kind == ("stable" if kind == "minimum" else "unstable")
    assert np.abs(found.positions - states[increment]).max() < 1e-4
