"""Equilibria of rigid origami against its kinematics."""

import numpy as np
import pytest

from openprc.demlat.geometry_builder import GeometryBuilder
from openprc.demlat.statics import StaticProblem, find_equilibrium

SPAN, RISE, STIFFNESS = 1.0, 0.3, 100.0
# --- rigid origami ------------------------------------------------------------------------------

PANEL = np.radians(60)
EDGE = 2.0


def miura(tilt):
    """Return half width, half length, offset, height of a Miura cell (Schenk & Guest)."""
    q = np.sqrt(1 + np.cos(tilt) ** 2 * np.tan(PANEL) ** 2)
    s = EDGE * np.cos(tilt) * np.tan(PANEL) / q
    length = EDGE * np.sqrt(1 - np.sin(tilt) ** 2 * np.sin(PANEL) ** 2)
    return s, length, EDGE / q, EDGE * np.sin(PANEL) * np.sin(tilt)


def miura_energy(tilt, rest, stiffness):
    """Return the energy of two creases of each kind, with fold angles of the closed form."""
    major, minor = 2 * tilt, 2 * np.arctan(np.cos(PANEL) * np.tan(tilt))
    major0, minor0 = 2 * rest, 2 * np.arctan(np.cos(PANEL) * np.tan(rest))
    return stiffness * ((major - major0) ** 2 + (minor - minor0) ** 2)


def miura_vertex(rest):
    """Return one vertex of a Miura sheet with rigid panels, at its rest tilt."""
    s, length, offset, height = miura(rest)
    build = GeometryBuilder()
    node = {}
    for i in range(3):
        for j in range(3):
            node[i, j] = build.add_node([i * s, j * length + (i % 2) * offset, (j % 2) * height])
    rigid = {"stiffness": 0.0, "rigid": True}
    for i in range(3):
        for j in range(3):
            if i < 2:
                build.add_bar(node[i, j], node[i + 1, j], **rigid)
            if j < 2:
                build.add_bar(node[i, j], node[i, j + 1], **rigid)
            if i < 2 and j < 2:
                a, b = node[i, j], node[i + 1, j + 1]
                build.add_bar(a, b, **rigid)
                build.add_hinge([a, b, node[i + 1, j], node[i, j + 1]], rest_angle=np.pi, **rigid)
    folds = [((0, 1), (1, 1), (0, 0), (0, 2)), ((1, 1), (2, 1), (2, 0), (2, 2))]
    folds += [((1, 0), (1, 1), (0, 0), (2, 0)), ((1, 1), (1, 2), (0, 2), (2, 2))]
    for row in folds:
        build.add_hinge([node[key] for key in row], stiffness=0.3)
    return build.geometry(), [node[0, j] for j in range(3)], [node[2, j] for j in range(3)]


@pytest.mark.parametrize("degrees", [25, 40, 58])
def test_rigid_miura_vertex_resists_as_its_kinematics_say(degrees):
    rest, tilt = np.radians(45), np.radians(degrees)
    geometry, left, right = miura_vertex(rest)
    held = np.zeros((9, 3), dtype=bool)
    held[left + right, 0] = True
    positions = geometry.positions.copy()
    width = 2 * miura(tilt)[0]
    positions[right, 0] = width
    problem = StaticProblem(geometry=geometry, held=held, positions=positions)
    found = find_equilibrium(problem, geometry.positions, load_steps=4)
    assert np.abs(problem.constraints(found.positions)).max() < 1e-13
    assert found.energy == pytest.approx(miura_energy(tilt, rest, 0.3), rel=1e-11)
    step = 1e-30j
    slope = miura_energy(tilt + step, rest, 0.3).imag / (2 * miura(tilt + step)[0]).imag
    assert found.reactions[right, 0].sum() == pytest.approx(slope, rel=1e-9)
    assert found.reactions[left, 0].sum() == pytest.approx(-slope, rel=1e-9)
    assert np.ptp(found.positions[:, 0]) == pytest.approx(width)
    # Two shifts and a turn about the width are left.
    assert (found.stability.kind, found.stability.n_rigid) == ("stable", 3)


def test_miura_of_the_reference_table():
    s, length, offset, height = miura(np.radians(15))
    found = [height, s, length, offset]
    np.testing.assert_allclose(found, [0.44828774, 1.71671253, 1.94911213, 1.02610823], atol=5e-9)
