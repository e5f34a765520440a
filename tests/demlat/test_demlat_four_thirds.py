"""The law "four-thirds" of hinges, and stiffness matrices that are not definite."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from openprc.demlat.producer import DemlatProducer
from openprc.demlat.statics import StaticProblem, find_equilibrium
from openprc.demlat.statics.element_laws import HingeLaws
from openprc.demlat.statics.symmetric_factors import SymmetricFactors
from openprc.errors import ConfigError, UnsupportedScene
from openprc.hooks.running import refuse_unsupported
from openprc.schema.experiment import Experiment, load_experiment, save_experiment
from openprc.schema.geometry import Bars, Geometry, Hinges

ROW = [[1, 2, 0, 3]]
X = np.array([[-1.0, 0, 0], [0, 1, 0], [0, -1, 0], [1, 0, 0]])
PAIRS = np.array([[1, 2], [0, 1], [0, 2], [1, 3], [2, 3]])


def power(**changes):
    columns = {"stiffness": [0.7], "rest_angle": [2.5], "law": ["four-thirds"]} | changes
    return Hinges(indices=ROW, **columns)


@pytest.mark.parametrize("angle", [0.2, 2.4, 2.5, 2.6, 4.0, 5.4])
def test_law_is_the_one_that_is_printed(angle):
    laws, d, h = HingeLaws(power()), angle - 2.5, 1e-5
    at = [np.array([angle - np.pi + shift]) for shift in (-h, 0.0, h)]
    assert laws.force(at[1])[0] == pytest.approx(0.7 * np.sign(d) * abs(d) ** (4 / 3), rel=1e-12)
    assert laws.energy(at[1])[0] == pytest.approx(0.3 * abs(d) ** (7 / 3), rel=1e-12)
    energy, force = [laws.energy(b)[0] for b in at], [laws.force(b)[0] for b in at]
    smooth = 1e-4 if d == 0 else 1e-8
    assert (energy[2] - energy[0]) / (2 * h) == pytest.approx(force[1], rel=smooth, abs=1e-10)
    if d == 0:
        assert laws.tangent(at[1])[0] == 0.0
    else:
        slope = (force[2] - force[0]) / (2 * h)
        assert slope == pytest.approx(laws.tangent(at[1])[0], rel=1e-6)


def test_beside_other_laws_each_has_its_own():
    hinges = Hinges(
        indices=ROW * 3,
        stiffness=[1.0, 2.0, 3.0],
        rest_angle=[np.pi] * 3,
        law=["linear", "four-thirds", "enhanced-linear"],
        limit_low=[0.0, 0.0, 1.0],
        limit_high=[2 * np.pi, 2 * np.pi, 5.0],
    )
    bends = np.array([0.1, 0.1, 0.1])
    expected = [0.1, 2 * 0.1 ** (4 / 3), 0.3]
    np.testing.assert_allclose(HingeLaws(hinges).force(bends), expected, rtol=1e-14)


def test_rigid_hinge_has_no_law():
    assert HingeLaws(power(rigid=[True])).force(np.array([0.3])) == 0.0


def fold():
    """A crease whose free wing is pulled up; the hinge is the only thing that resists."""
    body = Geometry(
        positions=X,
        masses=np.ones(4),
        fixed=[True, True, True, False],
        bars=Bars(
            indices=PAIRS,
            stiffness=np.full(5, 1e5),
            rest_length=np.linalg.norm(X[PAIRS[:, 0]] - X[PAIRS[:, 1]], axis=1),
        ),
        hinges=power(rest_angle=[np.pi]),
    )
    loads = np.zeros((4, 3))
    loads[3, 2] = 0.1
    return StaticProblem(geometry=body, loads=loads)


def test_wing_settles_where_force_and_moment_balance():
    found = find_equilibrium(fold())
    phi = np.arctan2(found.positions[3, 2], found.positions[3, 0])
    assert found.hinge_moments[0] == pytest.approx(0.7 * phi ** (4 / 3), rel=1e-9)
    assert 0.1 * np.cos(phi) == pytest.approx(0.7 * phi ** (4 / 3), rel=1e-4)


def scene():
    return Experiment(geometry=fold().geometry, duration=1.0, dt=0.01, save_interval=0.1)


def test_it_is_kept_in_a_folder(tmp_path):
    save_experiment(scene(), tmp_path)
    assert load_experiment(tmp_path).geometry.hinges.law.tolist() == ["four-thirds"]


def test_the_engine_refuses_it():
    with pytest.raises(UnsupportedScene, match="the law 'four-thirds' on 1 hinges") as caught:
        refuse_unsupported(DemlatProducer().supports(scene()), producer="demlat")
    assert "--producer merlin" in str(caught.value)


def test_it_has_no_limits(tmp_path):
    body = replace(scene().geometry, hinges=power(limit_low=[0.5]))
    with pytest.raises(ConfigError, match="four-thirds element 0 has limits"):
        save_experiment(replace(scene(), geometry=body), tmp_path)


# --- factors ----------------------------------------------------------------------------------


def symmetric(values, seed=0):
    """Return a dense symmetric matrix of given eigenvalues, as a sparse one."""
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(len(values), len(values))))
    return sparse.csr_array(turn @ np.diag(values) @ turn.T)


@pytest.mark.parametrize("seed", range(5))
def test_pivots_count_negative_eigenvalues(seed):
    values = np.random.default_rng(seed).normal(size=30)
    factors = SymmetricFactors(symmetric(values, seed))
    assert factors.n_negative == (values < 0).sum()
    assert factors.n_zero == 0
    right = np.arange(60.0).reshape(30, 2)
    np.testing.assert_allclose(factors.matrix @ factors.solve(right), right, atol=1e-9)


def test_matrix_without_pivots_on_its_diagonal():
    # No order of elimination has factors without exchanges here; eigenvalues are 1 and -1.
    swap = sparse.csr_array(np.array([[0.0, 1.0], [1.0, 0.0]]))
    factors = SymmetricFactors(swap)
    np.testing.assert_allclose(factors.solve(np.array([2.0, 3.0])), [3.0, 2.0], rtol=1e-10)
    assert (factors.n_negative, factors.n_zero) == (1, 0)


def test_singular_matrix_is_large_along_its_mechanism():
    factors = SymmetricFactors(sparse.csr_array(np.diag([4.0, 0.0, -1.0])))
    assert (factors.n_negative, factors.n_zero) == (1, 1)
    step = factors.solve(np.array([4.0, 1.0, -1.0]))
    np.testing.assert_allclose(step[[0, 2]], [1.0, 1.0], rtol=1e-9)
    assert step[1] > 1e9
    assert SymmetricFactors(sparse.csr_array((0, 0))).solve(np.zeros(0)).shape == (0,)
