"""Free motions of known frameworks in number and in words, and degenerate elements."""

import math

import numpy as np
import pytest

from openprc.demlat.planning import rigidity
from openprc.demlat.planning.mechanisms import free_motions, mechanisms
from openprc.demlat.planning.motion_words import say_direction, say_motion, say_nodes
from openprc.demlat.planning.rigidity import null_space, rigidity_matrix
from openprc.demlat.planning.scene_checks import motion_findings, scene_findings
from openprc.schema.experiment import Experiment
from openprc.schema.geometry import Bars, Bends, Geometry, Hinges

SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
SIDES = [(0, 1), (1, 2), (2, 3), (3, 0)]
IN_SPACE = (0.0, 0.0, -1.0)


def frame(points, pairs, *, fixed=(), rigid=(), gravity=(0.0, 0.0, 0.0), **elements):
    x, pairs = np.array(points, dtype=float), np.array(pairs, dtype=int).reshape(-1, 2)
    bars = Bars(
        indices=pairs,
        stiffness=np.ones(len(pairs)),
        rest_length=np.linalg.norm(x[pairs[:, 1]] - x[pairs[:, 0]], axis=1),
        rigid=np.isin(np.arange(len(pairs)), rigid),
    )
    held = np.isin(np.arange(len(x)), fixed)
    body = Geometry(positions=x, masses=np.ones(len(x)), fixed=held, bars=bars, **elements)
    return Experiment(geometry=body, duration=1.0, dt=0.01, save_interval=0.1, gravity=gravity)


def braced(n):
    """A planar lattice of n x n nodes with both diagonals in every cell."""
    node = np.arange(n * n).reshape(n, n)
    points = np.stack([*np.divmod(np.arange(n * n), n), np.zeros(n * n)], axis=1)
    runs = (
        (node[:-1], node[1:]),
        (node[:, :-1], node[:, 1:]),
        (node[:-1, :-1], node[1:, 1:]),
        (node[1:, :-1], node[:-1, 1:]),
    )
    return points, np.concatenate([np.stack([a.ravel(), b.ravel()], axis=1) for a, b in runs])


def texts(scene, kind="mechanism"):
    return [motion.text for motion in free_motions(scene).shown if motion.kind == kind]


# --- numbers -------------------------------------------------------------------------------------


def test_maxwells_count_of_a_square():
    # Maxwell 1864: coordinates = bars + mechanisms + motions as a whole - states of self-stress.
    open_square = free_motions(frame(SQUARE, SIDES))
    assert (open_square.n_mechanisms, open_square.n_whole, open_square.n_redundant) == (1, 3, 0)
    one = free_motions(frame(SQUARE, [*SIDES, (0, 2)]))
    assert (one.n_mechanisms, one.n_whole, one.n_redundant, one.rank) == (0, 3, 0, 5)
    both = free_motions(frame(SQUARE, [*SIDES, (0, 2), (1, 3)]))
    assert (both.n_mechanisms, both.n_redundant) == (0, 1)


def test_three_collinear_nodes_have_a_mechanism_and_a_self_stress_at_once():
    # Pellegrino & Calladine 1986, the first example: both bars pull against each other.
    line = frame([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [(0, 1), (1, 2)], fixed=(0, 2))
    found = free_motions(line)
    assert (found.n_mechanisms, found.n_redundant, found.rank) == (1, 1, 1)
    assert texts(line) == ["node 1 moves along y"]


@pytest.mark.parametrize("n", [3, 8, 20])
def test_grids_without_diagonals_shear_row_by_row(n, monkeypatch):
    # n rows and n columns shift one by one: 2 n motions, 3 of them of the grid as a whole.
    monkeypatch.setattr(rigidity, "DENSE", 100)  # the last one by sparse factors
    points, pairs = braced(n)
    assert mechanisms(frame(points, pairs[: 2 * n * (n - 1)])) == (2 * n - 3, 3)
    assert mechanisms(frame(points, pairs)) == (0, 3)


def test_dense_and_sparse_algebra_agree(monkeypatch):
    rng = np.random.default_rng(0)
    points = rng.normal(size=(60, 3))
    every = np.array([(i, j) for i in range(60) for j in range(i)])
    scene = frame(points, every[rng.permutation(len(every))[:150]], gravity=IN_SPACE)
    dense = null_space(rigidity_matrix(scene).matrix)
    monkeypatch.setattr(rigidity, "DENSE", 10)
    assert len(dense.loose) == 0
    sparse = null_space(rigidity_matrix(scene).matrix)
    assert dense.dimension == sparse.dimension == 180 - 150
    # The same space: each basis lies in the other's span.
    overlap = np.linalg.svd(dense.basis.T @ sparse.basis, compute_uv=False)
    np.testing.assert_allclose(overlap, 1.0, atol=1e-9)
    assert np.abs(rigidity_matrix(scene).matrix @ sparse.basis).max() < 1e-9


def test_a_long_chain_with_bends_is_soft_and_no_mechanism():
    n = 1500  # its softest motion strains the elements by less than a millionth
    points = np.zeros((n + 1, 3))
    points[:, 0] = np.arange(n + 1.0)
    first = np.arange(n)
    bends = Bends(
        indices=np.stack([first[:-1], first[1:], first[1:] + 1], axis=1), stiffness=np.ones(n - 1)
    )
    pairs = np.stack([first, first + 1], axis=1)
    assert mechanisms(frame(points, pairs, fixed=(0, 1), bends=bends)) == (0, 0)
    assert mechanisms(frame(points, pairs, fixed=(0, 1))) == (n - 1, 0)


def test_thousands_of_loose_nodes_are_counted_in_no_time():
    points = np.random.default_rng(0).normal(size=(5000, 3))
    found = free_motions(frame(points, [(0, 1)], gravity=IN_SPACE))
    assert (found.n_mechanisms, found.n_whole) == (0, 3 * 5000 - 1)
    assert found.shown[0].text == "nodes 0 and 1 move as a whole: 3 shifts and 2 turns"
    assert found.shown[-1].text == "4,991 more pieces move as a whole, 4,991 nodes"


def test_redundant_rigid_bars_are_counted_and_named():
    scene = frame(SQUARE, [*SIDES, (0, 2), (1, 3)], rigid=range(6))
    found = free_motions(scene)
    assert (found.n_redundant_rigid, len(found.redundant_rigid)) == (1, 1)
    assert found.redundant_rigid[0].startswith("bar ")
    # Soft bars are implied by nobody, though they are held more than once.
    assert free_motions(frame(SQUARE, [*SIDES, (0, 2), (1, 3)], rigid=(4,))).n_redundant_rigid == 0


# --- words ---------------------------------------------------------------------------------------


def test_who_moves_in_a_square():
    assert texts(frame(SQUARE, SIDES, fixed=(0, 1))) == ["nodes 2 and 3 shift together along x"]
    assert texts(frame(SQUARE, SIDES), "whole") == [
        "nodes 0, 1, 2 and 3 move as a whole: 2 shifts and a turn"
    ]


def test_a_pendulum_and_a_loose_node():
    pendulum = frame([[0, 0, 0], [1, 0, 0]], [(0, 1)], fixed=(0,), gravity=IN_SPACE)
    assert texts(pendulum, "whole") == ["node 1 moves along y and z"]
    loose = frame([[0, 0, 0], [1, 0, 0], [5, 5, 5]], [(0, 1)], fixed=(0, 1))
    assert texts(loose, "whole") == ["node 2 moves along x, y and z"]


def test_a_panel_turns_about_its_hinge_line():
    points = [[0, 0, 0], [1, 0, 0], [0.5, 1, 0.2], [0.5, 0.5, 1]]
    pairs = [(0, 1), (0, 2), (1, 2), (0, 3), (1, 3), (2, 3)]
    scene = frame(points, pairs, fixed=(0, 1), gravity=IN_SPACE)
    (text,) = texts(scene, "whole")
    assert text == "nodes 2 and 3 turn together about an axis along x through (0.5, 0, 0) m"


def test_a_fold_moves_its_last_wing_while_the_other_panel_rests():
    wing = np.array([0.5, -0.6, 0.8])
    points = [[0, 0, 0], [1, 0, 0], [0.5, 1, 0], wing]
    pairs = [(0, 1), (0, 2), (1, 2), (0, 3), (1, 3)]
    (text,) = texts(frame(points, pairs, gravity=IN_SPACE))
    # Across the wing and the crease, which lies along x: (0, 0.8, 0.6).
    assert text == "node 3 moves along (0, 0.8, 0.6)"
    held = Hinges(indices=[[0, 1, 2, 3]], stiffness=[1.0], rest_angle=[math.pi])
    assert texts(frame(points, pairs, gravity=IN_SPACE, hinges=held)) == []


def test_flat_lattices_in_space_bulge_node_by_node():
    points, pairs = braced(5)
    found = free_motions(frame(points, pairs, fixed=range(5), gravity=IN_SPACE))
    assert found.n_mechanisms + found.n_whole == 20
    inner = [motion for motion in found.shown if motion.kind == "mechanism"]
    assert all(motion.n_nodes == 1 and motion.text.endswith("along z") for motion in inner)


def test_words_of_motions():
    x = np.array([[1.0, 0, 0], [2.0, 0, 0], [2.0, 1.0, 0]])
    nodes = np.array([4, 5, 9])
    assert say_motion(nodes, x, np.tile([0, 0, 2.0], (3, 1))) == (
        "nodes 4, 5 and 9 shift together along z"
    )
    turning = np.cross([0, 0, 1.0], x - [1.0, 1.0, 0.0])
    assert "about an axis along z through (1, 1, 0) m" in say_motion(nodes, x, turning)
    bent = np.array([[0, 0, 0.1], [0, 0, 1.0], [0, 0.2, 0]])
    assert say_motion(nodes, x, bent).endswith("move, node 5 the most, along z")
    assert say_nodes(np.arange(9)) == "9 nodes (0, 1, 2, 3, 4, 5, ...)"
    assert say_direction(np.array([0.0, -3.0, -4.0])) == "(0, 0.6, 0.8)"


# --- findings ------------------------------------------------------------------------------------


def codes(scene):
    return [finding.code for finding in scene_findings(scene)]


def test_mechanisms_and_redundant_elements_become_findings():
    (finding,) = motion_findings(free_motions(frame(SQUARE, SIDES, fixed=(0, 1))))
    assert finding.code == "PLAN-MECHANISM"
    assert finding.found.endswith("such as: nodes 2 and 3 shift together along x")
    assert finding.expected
    assert finding.fix.startswith("brace it")
    stiff = frame(SQUARE, [*SIDES, (0, 2), (1, 3)], rigid=range(6))
    (finding,) = motion_findings(free_motions(stiff))
    assert (finding.code, finding.level) == ("PLAN-REDUNDANT-RIGID", "hint")
    assert list(motion_findings(free_motions(frame(SQUARE, [*SIDES, (0, 2)])))) == []


def test_what_is_too_large_is_said_not_to_be_searched(monkeypatch):
    monkeypatch.setattr(rigidity, "DENSE", 2)
    monkeypatch.setattr(rigidity, "MOST_COORDINATES", 4)
    assert free_motions(frame(SQUARE, SIDES)) is None
    (finding,) = motion_findings(None)
    assert finding.code == "PLAN-NOT-SEARCHED"


def test_bars_without_a_length_are_found():
    scene = frame([[0, 0, 0], [1, 0, 0], [1, 0, 0]], [(0, 1), (1, 2)], fixed=(0,))
    found = {finding.code: finding for finding in scene_findings(scene)}
    assert "joins two nodes at one point" in found["PLAN-ZERO-BAR"].found
    assert "PLAN-COINCIDENT-NODES" in found
    assert "PLAN-SHORT-BAR" not in found


@pytest.mark.parametrize(
    ("angle", "shut"), [(0.0, True), (5e-4, True), (-5e-4, True), (0.01, False), (3.0, False)]
)
def test_hinges_that_are_nearly_shut_are_found(angle, shut):
    wing = [0.5, math.cos(angle), math.sin(angle)]
    points = [[0, 0, 0], [1, 0, 0], [0.5, 1.0, 0], wing]
    pairs = [(0, 1), (0, 2), (1, 2), (0, 3), (1, 3)]
    fold = Hinges(indices=[[0, 1, 2, 3]], stiffness=[1.0], rest_angle=[1.0])
    scene = frame(points, pairs, fixed=(0, 1, 2), hinges=fold, gravity=IN_SPACE)
    assert ("PLAN-SHUT-HINGE" in codes(scene)) is shut


def test_a_collinear_hinge_is_thin_and_not_shut():
    points = [[0, 0, 0], [1, 0, 0], [0.5, 1.0, 0], [0.5, 1e-5, 0]]
    fold = Hinges(indices=[[0, 1, 2, 3]], stiffness=[1.0], rest_angle=[1.0])
    found = codes(frame(points, [(0, 1), (0, 2)], fixed=(0, 1), hinges=fold, gravity=IN_SPACE))
    assert "PLAN-THIN-HINGE" in found
    assert "PLAN-SHUT-HINGE" not in found
