"""A flat-foldable vertex of four rigid panels moves as its closed form says.

Sector angles alpha, beta, pi - alpha, pi - beta between the creases 1-2, 2-3, 3-4, 4-1. Of the two
ways to fold, this is the one with rho3 = rho1, rho4 = -rho2 and
``tan(rho2 / 2) = -p tan(rho1 / 2)``, ``p = cos((alpha + beta) / 2) / cos((alpha - beta) / 2)``.
"""

import numpy as np
import pytest

from openprc.demlat.observables import hinge_angles
from openprc.schema.experiment import Experiment
from openprc.schema.geometry import Bars, Geometry, Hinges


def turned(point, axis, angle):
    """Rodrigues' rotation about a unit axis through the origin."""
    return (
        point * np.cos(angle)
        + np.cross(axis, point) * np.sin(angle)
        + axis * (axis @ point) * (1 - np.cos(angle))
    )


def vertex(alpha, beta, rho1):
    """Nodes: the vertex, then the ends of creases 1 to 4; panel 1-2 lies in the plane."""
    p = np.cos((alpha + beta) / 2) / np.cos((alpha - beta) / 2)
    rho2 = 2 * np.arctan(-p * np.tan(rho1 / 2))
    at = np.cumsum([0, alpha, beta, np.pi - alpha])
    flat = np.column_stack([np.cos(at), np.sin(at), 0 * at])
    third = turned(flat[2], flat[1], rho2)
    fourth = turned(flat[3], flat[0], -rho1)
    return np.vstack([np.zeros(3), flat[:2], third, fourth]), flat


@pytest.mark.parametrize(
    ("sectors", "p"), [((70, 50), 0.507713), ((60, 60), 0.5), ((100, 35), 0.453744)]
)
def test_a_degree_four_vertex_keeps_its_closed_form(simulate, sectors, p):
    alpha, beta = np.radians(sectors)
    x, flat = vertex(alpha, beta, 0.4)
    pairs = np.array([[0, 1], [0, 2], [0, 3], [0, 4], [1, 2], [2, 3], [3, 4], [4, 1]])
    plane = np.vstack([np.zeros(3), flat])
    lengths = np.linalg.norm(plane[pairs[:, 1]] - plane[pairs[:, 0]], axis=1)
    # The closed form closes the loop: the panel 3-4 has its length.
    assert np.linalg.norm(x[4] - x[3]) == pytest.approx(lengths[6], rel=1e-12)
    # Crease first, then the panel before it and the one after it.
    creases = [[0, 1, 4, 2], [0, 2, 1, 3], [0, 3, 2, 4], [0, 4, 3, 1]]
    geometry = Geometry(
        positions=x,
        masses=[1.0] * 5,
        fixed=[True, True, True, False, False],
        bars=Bars(
            indices=pairs, stiffness=np.zeros(8), rest_length=lengths, rigid=np.ones(8, dtype=bool)
        ),
        hinges=Hinges(
            indices=creases, stiffness=[0.5, 0, 0, 0], rest_angle=[np.pi + 1.8, np.pi, np.pi, np.pi]
        ),
    )
    start = hinge_angles(x[None], geometry.hinges)[0, 0] - np.pi
    assert abs(start) == pytest.approx(0.4, abs=1e-12)
    geometry = Geometry(
        **{name: getattr(geometry, name) for name in ("positions", "masses", "fixed", "bars")},
        hinges=Hinges(
            indices=creases,
            stiffness=[0.5, 0, 0, 0],
            rest_angle=[np.pi + np.sign(start) * 1.8, np.pi, np.pi, np.pi],
        ),
    )
    run = simulate(
        Experiment(
            geometry=geometry, duration=3.0, dt=5e-3, save_interval=0.05, integrator="rk4-dae"
        )
    )
    rho = run.angle - np.pi
    assert np.ptp(rho[:, 0]) > 1.0
    np.testing.assert_allclose(rho[:, 2], rho[:, 0], atol=1e-11)
    np.testing.assert_allclose(rho[:, 3], -rho[:, 1], atol=1e-11)
    ratio = np.abs(np.tan(rho[:, 1] / 2) / np.tan(rho[:, 0] / 2))
    np.testing.assert_allclose(ratio, np.cos((alpha + beta) / 2) / np.cos((alpha - beta) / 2))
    assert ratio[0] == pytest.approx(p, abs=1e-6)
    assert np.abs(run.length / lengths - 1).max() < 1e-12
