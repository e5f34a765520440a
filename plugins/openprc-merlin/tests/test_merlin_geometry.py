"""Angles, gradients and lengths against closed forms and differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from openprc_merlin import geometry

HINGE = np.array([[0, 1, 2, 3]])


def folded(angle, *, scale=1.0, skew=0.3):
    """Return a hinge whose MERLIN angle is `angle`: crease along y, wing i on the left."""
    a = angle - np.pi
    points = np.array(
        [
            [0.0, 1.0, 0.0],
            [0.0, -1.0, 0.0],
            [-1.0, skew, 0.0],
            [1.2 * np.cos(a), -skew, 1.2 * np.sin(a)],
        ]
    )
    return scale * points[None]


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e3])
@pytest.mark.parametrize("angle", [0.05, 1.0, np.pi - 1e-9, np.pi, np.pi + 1e-9, 4.0, 6.2])
def test_angle_is_exact_at_every_scale_and_near_flat(angle, scale):
    found = geometry.dihedral_angles(folded(angle, scale=scale), HINGE)[0, 0]
    assert found == pytest.approx(angle, abs=2e-15 * 8)


def test_wing_on_the_crease_has_no_angle():
    points = folded(2.0)
    points[0, 2] = [0.0, 0.4, 0.0]
    assert np.isnan(geometry.dihedral_angles(points, HINGE)[0, 0])


@settings(max_examples=60, deadline=None)
@given(st.floats(0.05, 2 * np.pi - 0.05), st.integers(0, 2**31))
def test_angle_ignores_rigid_motion_and_mirrors_with_the_wings(angle, seed):
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.linalg.det(q))
    points = folded(angle) @ q.T + rng.normal(size=3)
    assert geometry.dihedral_angles(points, HINGE)[0, 0] == pytest.approx(angle, abs=1e-12)
    both = geometry.dihedral_angles(points, np.array([[1, 0, 3, 2]]))[0, 0]
    one = geometry.dihedral_angles(points, np.array([[1, 0, 2, 3]]))[0, 0]
    assert both == pytest.approx(angle, abs=1e-12)
    assert one == pytest.approx(2 * np.pi - angle, abs=1e-12)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e2])
@pytest.mark.parametrize("angle", [0.05, 1.3, np.pi, 3.5, 2 * np.pi - 0.05])
def test_gradient_agrees_with_differences_and_exerts_no_net_force_or_torque(angle, scale):
    points = folded(angle, scale=scale)
    gradient = geometry.dihedral_gradients(points, HINGE)[0, 0]
    step = 1e-6 * scale
    for node in range(4):
        for axis in range(3):
            moved = np.repeat(points, 2, axis=0)
            moved[0, node, axis] += step
            moved[1, node, axis] -= step
            high, low = geometry.dihedral_angles(moved, HINGE)[:, 0]
            difference = (high - low) / (2 * step)
            assert gradient[node, axis] == pytest.approx(difference, abs=1e-7 / scale)
    assert np.abs(gradient.sum(axis=0)).max() < 1e-13 / scale
    assert np.abs(np.cross(points[0], gradient).sum(axis=0)).max() < 1e-13


@pytest.mark.parametrize("block", [1, 7, 100])
def test_unwrapping_does_not_depend_on_the_blocks(block):
    turns = np.linspace(3.0, 40.0, 100)[:, None] * np.array([1.0, -0.7])
    unwrap = geometry.Unwrapper()
    wrapped = np.mod(turns, 2 * np.pi)
    found = np.concatenate([unwrap(wrapped[i : i + block]) for i in range(0, 100, block)])
    np.testing.assert_allclose(found - found[0], turns - turns[0], atol=1e-12)
    assert unwrap.crossings == np.count_nonzero(np.abs(np.diff(wrapped, axis=0)) > np.pi)


def test_strip_of_triangles_is_turned_alike():
    faces = np.array([[0, 1, 2], [1, 2, 3], [2, 3, 4], [3, 4, 5]])
    turned = geometry.orient(faces)
    edges = [tuple(edge) for row in turned.tolist() for edge in geometry.sides(row)]
    assert len(set(edges)) == len(edges)
    assert turned[0].tolist() == [0, 1, 2]
    assert geometry.triangles_to_hinges(turned)[:, :2].tolist() == [[1, 2], [2, 3], [3, 4]]


def test_hinges_of_a_sheet_folded_to_a_tube_have_one_sense():
    n = 12
    ring = np.array([[np.cos(t), np.sin(t), 0] for t in 2 * np.pi * np.arange(n) / n])
    points = np.concatenate([ring, ring + np.array([0, 0, 1])])[None]
    faces = [[i, (i + 1) % n, n + (i + 1) % n] for i in range(n)]
    faces += [[i, n + (i + 1) % n, n + i] for i in range(n)]
    rng = np.random.default_rng(1)
    mixed = np.array([row[:: rng.choice([-1, 1])] for row in faces])
    hinges = geometry.triangles_to_hinges(geometry.orient(mixed))
    bend = geometry.dihedral_angles(points, hinges)[0] - np.pi
    folds = np.abs(bend) > 1e-9
    assert folds.sum() == n
    assert len(set(np.sign(bend[folds]))) == 1
    np.testing.assert_allclose(np.abs(bend[folds]), 2 * np.pi / n, atol=1e-12)
