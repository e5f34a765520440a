"""A saved run of MERLIN (Liu & Paulino 2017, doi:10.1098/rspa.2017.0348) folds as the formula."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from openprc.scenes.catalog import build_scene
from openprc.scenes.closed_forms import miura_places, miura_tilt

DATA = Path(__file__).resolve().parents[2] / "../shared/data/merlin"
FILE = DATA / "merlin1_miura_folding.mat"
if not FILE.exists():
    pytest.skip("the recorded MERLIN runs are not beside this checkout", allow_module_level=True)


@pytest.fixture(scope="module")
def run():
    return loadmat(FILE, simplify_cells=True, mat_dtype=True)


@pytest.fixture(scope="module")
def scene():
    return build_scene("miura", {"variant": "folding", "columns": 5, "rows": 5})


def test_the_sheet_is_that_of_the_example(run, scene):
    """Same nodes in the same order, bars and their stiffness, and hinges up to direction."""
    geometry, truss, angles = scene.experiment.geometry, run["truss"], run["angles"]
    np.testing.assert_allclose(geometry.positions, truss["Node"], atol=1e-12)
    saved = np.sort(truss["Bars"].astype(int) - 1, axis=1)
    order, own = np.lexsort(saved.T), np.sort(geometry.bars.indices, axis=1)
    mine = np.lexsort(own.T)
    np.testing.assert_array_equal(own[mine], saved[order])
    np.testing.assert_allclose(
        geometry.bars.stiffness[mine], (run["E0"] * truss["A"] / truss["L"])[order], rtol=1e-12
    )
    creases = {}
    for kind, constant in (("fold", "kpf"), ("bend", "kpb")):
        rows = angles[kind].astype(int) - 1
        lengths = np.linalg.norm(truss["Node"][rows[:, 0]] - truss["Node"][rows[:, 1]], axis=1)
        stiffness = np.broadcast_to(angles[constant], lengths.shape) * lengths
        creases |= {frozenset(r[:2]): k for r, k in zip(rows.tolist(), stiffness, strict=True)}
    hinges = geometry.hinges
    assert len(hinges) == len(creases)
    for row, stiffness in zip(hinges.indices.tolist(), hinges.stiffness, strict=True):
        assert creases[frozenset(row[:2])] == pytest.approx(stiffness, rel=1e-9)


def test_it_is_held_where_the_example_is(run, scene):
    """But for the width, which the example pushes and the scene prescribes."""
    held = np.zeros((121, 3), dtype=bool)
    for node, *axes in run["Supp"].astype(int):
        held[node - 1] |= np.array(axes, dtype=bool)
    pushed = run["Load"][:, 0].astype(int) - 1
    held[pushed, 0] = True
    np.testing.assert_array_equal(scene.experiment.held_axes, held)


def test_saved_states_are_on_the_path(run):
    """Within 1e-3 of the motion, at the width that each of them has."""
    nodes = run["truss"]["Node"]
    states = nodes + run["U_his"].T.reshape(-1, 121, 3)
    width = states[:, -11:, 0].mean(axis=1)
    tilt = miura_tilt(width / 10.0, b=2.0, sector=np.pi / 3)
    exact = miura_places(tilt, columns=5, rows=5, a=2.0, b=2.0, sector=np.pi / 3)
    # Panels bend a little where the sheet is pushed; its motion is that of the far edge.
    moved = np.linalg.norm(states[-1] - nodes, axis=1).max()
    apart = np.linalg.norm(states - exact, axis=2)
    assert np.ptp(width) > 5.0
    assert apart.max() < 1e-3 * moved
