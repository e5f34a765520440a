"""Bends: angle, gradient and stiffness against closed forms, and compiled code against NumPy."""

from dataclasses import replace

import numpy as np
import pytest
from slender_bodies import crooked_chain, experiment, numpy_forces, triples

from openprc.demlat.forces import ForceField
from openprc.demlat.statics.bending import (
    BendLaws,
    bend_gradients,
    bend_stiffness,
    bend_turns,
    have_arms,
)
from openprc.errors import NotConverged
from openprc.schema.geometry import Bends, Geometry

ROW = np.array([[0, 1, 2]])
TURNS = (0.0, 1e-12, 1e-9, 1e-6, 1e-3, 0.5, 1.5, 2.5, np.pi - 1e-3, np.pi - 1e-9)
#: Turns between the ends, where a moment has a direction.
BENT = (1e-3, 0.5, 1.5, 2.5, 3.1)


def corner(turn, *, arms=(1.3, 0.6), rotation=None):
    """Return three nodes in a plane, and d(turn)/dx there: (3, 3) each."""
    a, b = arms
    nodes = np.array([[-a, 0, 0], [0, 0, 0], [b * np.cos(turn), b * np.sin(turn), 0]])
    first, last = np.array([0, 1 / a, 0]), np.array([-np.sin(turn), np.cos(turn), 0]) / b
    slope = np.stack([first, -first - last, last])
    turned = np.eye(3) if rotation is None else rotation
    return nodes @ turned.T, slope @ turned.T


def rotation(seed):
    return np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]


def sharpness(turn):
    """Return the angle to where the arms lie on one line, over which derivatives change."""
    return min(turn, np.pi - turn)


def one_bend(nodes, *, rest=np.pi, stiffness=1.0, damping=0.0):
    bends = Bends(indices=ROW, stiffness=[stiffness], rest_angle=[rest], damping=[damping])
    return Geometry(positions=nodes, masses=np.ones(3), bends=bends)


# --- shapes -------------------------------------------------------------------------------------


@pytest.mark.parametrize("turn", TURNS)
def test_turns_are_exact_from_straight_to_folded_back(turn):
    assert bend_turns(corner(turn)[0], ROW)[0] == pytest.approx(turn, rel=1e-15, abs=1e-15)
    turned = corner(turn, rotation=rotation(1))[0]
    assert bend_turns(turned, ROW)[0] == pytest.approx(turn, rel=0, abs=1e-15)


@pytest.mark.parametrize("turn", TURNS[1:])
def test_gradients_are_the_closed_form(turn):
    nodes, slope = corner(turn)
    np.testing.assert_allclose(bend_gradients(nodes, ROW)[0], slope, rtol=0, atol=1e-14)


@pytest.mark.parametrize("turn", BENT)
def test_gradients_are_differences_of_turns(turn):
    nodes = corner(turn, rotation=rotation(2))[0]
    found, step = bend_gradients(nodes, ROW)[0], np.longdouble(1e-6 * sharpness(turn))
    for node, axis in np.ndindex(3, 3):
        shift = np.zeros((3, 3), np.longdouble)
        shift[node, axis] = step
        ends = [bend_turns(nodes + sign * shift, ROW)[0] for sign in (1, -1)]
        assert float((ends[0] - ends[1]) / (2 * step)) == pytest.approx(
            found[node, axis], rel=0, abs=1e-11 / sharpness(turn)
        )


@pytest.mark.parametrize("turn", BENT)
@pytest.mark.parametrize("rest", [0.0, 0.7])
def test_stiffness_is_the_difference_of_forces(turn, rest):
    nodes, k = corner(turn, rotation=rotation(3))[0], 2.3

    def force(at):
        moment = k * (bend_turns(at, ROW) - rest)
        return moment[:, None, None] * bend_gradients(at, ROW)

    moment = k * (bend_turns(nodes, ROW) - rest)
    found = bend_stiffness(nodes, ROW, moment, np.array([k]))[0]
    step = np.longdouble(1e-6 * sharpness(turn))
    scale = np.abs(found).max()
    for node, axis in np.ndindex(3, 3):
        shift = np.zeros((3, 3), np.longdouble)
        shift[node, axis] = step
        slope = (force(nodes + shift) - force(nodes - shift))[0] / (2 * step)
        np.testing.assert_allclose(found[node, axis], slope, rtol=0, atol=1e-10 * scale)
    np.testing.assert_allclose(found, found.transpose(2, 3, 0, 1), rtol=0, atol=1e-15 * scale)


def test_a_straight_bend_resists_both_ways_alike():
    """Its energy is that of the linear beam: ``k (w_i / a + w_k / b - ...)^2 / 2`` in y and z."""
    a, b = 1.3, 0.6
    nodes = corner(0.0)[0]
    found = bend_stiffness(nodes, ROW, np.zeros(1), np.ones(1))[0]
    row = np.array([1 / a, -1 / a - 1 / b, 1 / b])
    for axis in (1, 2):
        np.testing.assert_allclose(found[:, axis, :, axis], np.outer(row, row), rtol=1e-14)
    found[:, 1, :, 1] = found[:, 2, :, 2] = 0.0
    assert not found.any()


def test_stiffness_goes_on_smoothly_where_the_bend_becomes_straight():
    for turn in (1e-9, 1e-6):
        nodes = corner(turn)[0]
        found = bend_stiffness(nodes, ROW, bend_turns(nodes, ROW), np.ones(1))
        limit = bend_stiffness(corner(0.0)[0], ROW, np.zeros(1), np.ones(1))
        np.testing.assert_allclose(found, limit, rtol=0, atol=8.0 * turn)


def test_an_arm_without_length_has_no_gradient():
    nodes = np.array([[0.0, 0, 0], [0, 0, 0], [1, 0, 0]])
    assert not have_arms(nodes, ROW).any()
    with pytest.raises(NotConverged, match=r"an arm of bend 0 \[0, 1, 2\] has no length"):
        bend_gradients(nodes, ROW)
    with pytest.raises(NotConverged, match="an arm of bend 0"):
        bend_stiffness(nodes, ROW, np.zeros(1), np.ones(1))


def test_the_law_is_linear_in_the_angle():
    bends = Bends(indices=[[0, 1, 2]] * 2, stiffness=[2.0, 3.0], rest_angle=[np.pi, 2.0])
    laws, angles = BendLaws(bends), np.array([3.0, 2.5])
    turns = np.pi - angles
    np.testing.assert_allclose(
        laws.energy(turns), [(3.0 - np.pi) ** 2, 1.5 * 0.25], rtol=1e-14, atol=0
    )
    np.testing.assert_allclose(laws.force(turns), [2.0 * (np.pi - 3.0), -1.5], rtol=1e-14)
    np.testing.assert_array_equal(laws.tangent(turns), [2.0, 3.0])


# --- compiled forces ----------------------------------------------------------------------------


def field_of(geometry, *, vectors=False, **settings):
    return ForceField(experiment(geometry, step_check="warn", **settings), vectors=vectors)


@pytest.fixture(scope="module")
def straight():
    """One straight bend, damped, of stiffness 1."""
    return field_of(one_bend(corner(0.0)[0], damping=1.0))


@pytest.mark.parametrize("turn", TURNS)
def test_compiled_forces_are_exact_from_straight_to_folded_back(straight, turn):
    for turned in (None, rotation(4)):
        nodes, slope = corner(turn, rotation=turned)
        found = straight(nodes, np.zeros((3, 3)))
        # Nearly folded back, the plane of the bend is known to rounding over that angle.
        sharpness = max(np.pi - turn, 1e-9) if turned is not None else 1.0
        tolerance = 1e-14 / min(sharpness, 1.0)
        np.testing.assert_allclose(found, -turn * slope, rtol=0, atol=tolerance)


def test_folded_back_and_collapsed_arms_give_finite_forces(straight):
    rest = np.zeros((3, 3))
    assert np.isfinite(straight(corner(np.pi)[0], rest)).all()
    assert np.isfinite(straight(np.zeros((3, 3)), rest)).all()


@pytest.mark.parametrize("turned", [np.eye(3), rotation(5)])
def test_straight_arms_are_damped_whichever_way_they_begin_to_bend(straight, turned):
    nodes = corner(0.0, rotation=turned)[0]
    a, b = 1.3, 0.6
    row = np.array([1 / a, -1 / a - 1 / b, 1 / b])
    for sideways in np.array([[0, 1.0, 0], [0, 0, 1.0], [0, 0.6, -0.8]]) @ turned.T:
        for node in range(3):
            velocity = np.zeros((3, 3))
            velocity[node] = 2.0 * sideways
            expected = -2.0 * row[node] * row[:, None] * sideways
            np.testing.assert_allclose(straight(nodes, velocity), expected, rtol=0, atol=1e-14)
            assert straight.power[5] == pytest.approx((2.0 * row[node]) ** 2, rel=1e-14)
    # Along the arms, and turning as a whole, nothing is damped.
    spin = np.cross(np.array([0.3, -0.2, 0.9]), nodes)
    np.testing.assert_allclose(straight(nodes, nodes), 0.0, atol=1e-15)
    np.testing.assert_allclose(straight(nodes, spin), 0.0, atol=1e-15)


def test_a_bent_dashpot_acts_on_the_angle_alone(straight):
    nodes, slope = corner(0.8)
    across = np.array([[0, 0, 1.0], [0, 0, 0], [0, 0, 0]])
    still = straight(nodes, np.zeros((3, 3)))
    np.testing.assert_allclose(straight(nodes, across) - still, 0.0, atol=1e-15)
    within = np.array([[0, 0, 0], [0, 0, 0], [-np.sin(0.8), np.cos(0.8), 0.0]])
    np.testing.assert_allclose(straight(nodes, within) - still, -slope / 0.6, rtol=0, atol=1e-14)


def scrambled(n, *, seed=6, **settings):
    """Return a chain whose bends have no order that a vector could be loaded in."""
    geometry = crooked_chain(n, seed=seed, **settings)
    rng = np.random.default_rng(seed)
    rows = triples(n)
    rows = np.concatenate([rows, rng.permuted(rows, axis=1), rows[:, ::-1]])
    return replace(
        geometry,
        bends=Bends(
            indices=rng.permutation(rows),
            stiffness=rng.uniform(1, 2, len(rows)),
            rest_angle=rng.uniform(0.5, np.pi, len(rows)),
            damping=rng.uniform(0, 1, len(rows)),
        ),
    )


@pytest.fixture(scope="module", params=[False, True], ids=["numbers", "vectors"])
def field(request):
    return field_of(scrambled(30, damping=0.4), vectors=request.param)


def test_compiled_forces_are_those_of_numpy(field):
    geometry = field.experiment.geometry
    x, v, bends = geometry.positions, geometry.velocities, geometry.bends
    expected = numpy_forces(field.experiment, x, v)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(field(x, v), expected, rtol=0, atol=1e-13 * scale)
    frame = field.frames(1)
    field.observe(x, v, buffer=frame)
    turns = bend_turns(x, bends.indices)
    rates = np.einsum("bna,bna->b", bend_gradients(x, bends.indices), v[bends.indices])
    torque = bends.stiffness * (np.pi - turns - bends.rest_angle) - bends.damping * rates
    np.testing.assert_allclose(frame.bend_angle[0], np.pi - turns, rtol=0, atol=1e-14)
    np.testing.assert_allclose(frame.bend_moment[0], torque, rtol=0, atol=1e-12)
    energy = 0.5 * (bends.stiffness * (np.pi - turns - bends.rest_angle) ** 2).sum()
    assert frame.energy[0, 4] == pytest.approx(energy, rel=1e-13)
    assert field.power[5] == pytest.approx((bends.damping * rates**2).sum(), rel=1e-13)


def test_bends_push_and_turn_nothing_as_a_whole(field):
    geometry = field.experiment.geometry
    x, v = geometry.positions, geometry.velocities
    force = field(x, v)
    assert np.abs(force).max() > 1.0
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.cross(x, force).sum(axis=0), 0.0, atol=1e-10)
