"""Formulas against other ways to the same numbers: integration, matrices, published values."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

from openprc.scenes import closed_forms as forms


def integrated(slope, start, times):
    found = solve_ivp(slope, (0.0, times[-1]), start, "DOP853", times, rtol=1e-12, atol=1e-13)
    return found.y


@pytest.mark.parametrize("decay", [0.0, 0.3, 6.999999999, 7.0, 7.1, 40.0])
def test_a_released_spring(decay):
    times = np.linspace(0.0, 3.0, 31)
    path = integrated(lambda _, y: [y[1], -49.0 * y[0] - 2.0 * decay * y[1]], [1.0, 0.0], times)
    found = forms.released(times, omega=7.0, decay=decay)
    np.testing.assert_allclose(found, path[0], atol=1e-9)


@pytest.mark.parametrize("start", [0.1, 1.5, 3.0])
def test_a_pendulum(start):
    times = np.linspace(0.0, 8.0, 41)
    path = integrated(lambda _, y: [y[1], -9.0 * np.sin(y[0])], [start, 0.0], times)
    np.testing.assert_allclose(
        forms.pendulum_angle(times, start=start, rate=3.0), path[0], atol=2e-10
    )
    period = forms.pendulum_period(start=start, rate=3.0)
    turned = forms.pendulum_angle(np.array([period / 2.0, period]), start=start, rate=3.0)
    np.testing.assert_allclose(turned, [-start, start], rtol=1e-9)


@pytest.mark.parametrize(("n", "known"), [(5, 0.572242), (10, 0.585152)])
def test_a_hanging_chain(n, known):
    """Frequencies measured with two other simulators, and the modes by linear algebra."""
    roots, shapes = forms.hanging_chain_modes(n)
    link = 1.0 / n
    frequency = np.sqrt(9.81 / link * roots[0]) / (2.0 * np.pi)
    assert frequency == pytest.approx(known, abs=5e-7)
    # Tensions over lengths tie neighbours: n, n - 1, ..., 1 weights of a mass.
    tension = np.arange(n, 0, -1.0)
    stiffness = np.diag(tension + np.append(tension[1:], 0.0))
    stiffness -= np.diag(tension[1:], 1) + np.diag(tension[1:], -1)
    squares, modes = eigh(stiffness)
    np.testing.assert_allclose(roots, squares, rtol=1e-9)
    modes = modes / modes[-1]
    np.testing.assert_allclose(shapes[:, 1:], modes.T, atol=1e-8)
    assert not shapes[:, 0].any()


def test_swinging_links_are_where_they_are_known_to_be():
    """The tip of five links of 0.2 m let go level, to the digits that were noted elsewhere."""
    known = {
        0.25: (0.89026677, -0.30656040),
        0.5: (-0.05666454, -0.97580233),
        0.75: (-0.89730040, -0.42869610),
        1.0: (-0.94249151, -0.12903326),
        2.0: (0.8377153, -0.16765932),
    }
    angles = forms.swinging_links(np.array(list(known)), n=5, link=0.2, start=np.pi / 2)
    tips = forms.chain_of_links(angles, link=0.2)[:, -1]
    np.testing.assert_allclose(tips[:4, [0, 2]], list(known.values())[:4], atol=1e-8)
    # By then rounding has grown: chaos.
    np.testing.assert_allclose(tips[4, [0, 2]], known[2.0], atol=1e-6)


def test_one_swinging_link_is_a_pendulum():
    times = np.linspace(0.0, 3.0, 16)
    angle = forms.swinging_links(times, n=1, link=0.4, start=1.2)[:, 0]
    exact = forms.pendulum_angle(times, start=1.2, rate=np.sqrt(9.81 / 0.4))
    np.testing.assert_allclose(angle, exact, atol=1e-9)


@pytest.mark.parametrize("n", [2, 5, 10])
def test_a_cantilever_of_segments(n):
    """The same by the stiffness matrix of its bends."""
    length, rigidity, force = 1.3, 0.7, 0.01
    link = length / n
    turn = np.zeros((n - 1, n + 1))
    for row in range(n - 1):
        turn[row, row : row + 3] = np.array([1.0, -2.0, 1.0]) / link
    stiffness = (rigidity / link * turn.T @ turn)[2:, 2:]
    load = np.zeros(n - 1)
    load[-1] = force
    tip = np.linalg.solve(stiffness, load)[-1]
    found = forms.cantilever_deflection(force=force, length=length, rigidity=rigidity, segments=n)
    assert found == pytest.approx(tip, rel=1e-9)


def test_a_von_mises_truss():
    """Numbers noted elsewhere for b = 1, h = 0.3, k = 100, and the largest of the curve."""
    limit, height = forms.von_mises_limit(span=1.0, rise=0.3, stiffness=100.0)
    assert limit == pytest.approx(0.99499170, abs=5e-9)
    assert 0.3 - height == pytest.approx(0.129288, abs=5e-7)
    z = np.linspace(-0.3, 0.3, 60001)
    force = forms.von_mises_force(z, span=1.0, rise=0.3, stiffness=100.0)
    assert force.max() == pytest.approx(limit, rel=1e-8)
    assert z[force.argmax()] == pytest.approx(height, abs=2e-5)
    # The area below the curve up to the flat state is the barrier k (L0 - b)^2.
    assert np.trapezoid(force[30000:], z[30000:]) == pytest.approx(0.19386982, abs=5e-8)


@pytest.mark.parametrize("rise", [1e-1, 1e-3, 1e-5])
def test_a_shallow_truss_keeps_its_digits(rise):
    """``P = 2 k h^3 / (3 sqrt(3) b^2)`` at ``h / sqrt(3)``, to lowest order in the rise."""
    limit, height = forms.von_mises_limit(span=1.0, rise=rise, stiffness=100.0)
    assert limit == pytest.approx(200.0 * rise**3 / (3.0 * np.sqrt(3.0)), rel=2.0 * rise**2 + 1e-9)
    assert height == pytest.approx(rise / np.sqrt(3.0), rel=2.0 * rise**2 + 1e-9)


@pytest.mark.parametrize(
    ("tilt", "h", "s", "l", "v"),
    [
        (15.0, 0.44828774, 1.71671253, 1.94911213, 1.02610823),
        (45.0, 1.22474487, 1.54919334, 1.58113883, 1.26491106),
        (75.0, 1.67303261, 0.81812985, 1.09588407, 1.82501056),
    ],
)
def test_a_miura_cell(tilt, h, s, l, v):  # noqa: E741
    size = {"columns": 1, "rows": 1, "a": 2.0, "b": 2.0, "sector": np.pi / 3}
    x = forms.miura_places(np.radians([tilt]), **size)[0]
    np.testing.assert_allclose(x[1], [0.0, l, h], atol=1e-8)
    np.testing.assert_allclose(x[3], [s, v, 0.0], atol=1e-8)
    back = forms.miura_tilt(np.array([x[3, 0]]), b=2.0, sector=np.pi / 3)
    np.testing.assert_allclose(np.degrees(back), [tilt], rtol=1e-12)
    # Panels keep their edges, and their diagonals.
    edges = np.linalg.norm(x[[1, 3, 4, 4]] - x[[0, 0, 1, 3]], axis=1)
    np.testing.assert_allclose(edges, 2.0, rtol=1e-12)


def test_the_energy_of_miura_folds_has_the_slope_of_the_force():
    """Force in a run of MERLIN at two widths (11 nodes share it), within 0.1 per cent."""
    size = {"columns": 5, "rows": 5, "a": 2.0, "b": 2.0, "sector": np.pi / 3}
    relaxed = np.radians(15.0)

    def at_width(width):
        tilt = forms.miura_tilt(np.array([width / 10.0]), b=2.0, sector=np.pi / 3)[0]
        return forms.miura_fold_energy(tilt, relaxed, stiffness=0.1, **size)

    tilt = np.radians(45.0)
    width = forms.miura_places(np.array([tilt]), **size)[0, -1, 0]
    # By hand: 90 creases of 2 m are bent by 2 tilt, 90 by 2 atan(cos(sector) tan(tilt)).
    bent = (
        2.0 * (tilt - relaxed),
        2.0 * (np.arctan(0.5 * np.tan(tilt)) - np.arctan(0.5 * np.tan(relaxed))),
    )
    assert at_width(width) == pytest.approx(0.05 * 180.0 * (bent[0] ** 2 + bent[1] ** 2))
    force = (at_width(width - 1e-4) - at_width(width + 1e-4)) / 2e-4
    assert 5.0 < force < 10.0


@pytest.mark.parametrize("restitution", [0.5, 0.8, 1.0])
def test_a_bouncing_ball(restitution):
    """Flight by flight."""
    height = 0.7
    times = np.linspace(0.0, 2.5, 2501)
    z, v, t, last = height, 0.0, 0.0, 0
    expected = np.empty_like(times)
    while last < len(times):
        ahead = times[last:] - t
        path = z + v * ahead - 0.5 * 9.81 * ahead**2
        below = np.flatnonzero(path < -1e-12)
        stop = last + (below[0] if len(below) else len(ahead))
        expected[last:stop] = path[: stop - last]
        impact = (v + np.sqrt(v * v + 2.0 * 9.81 * z)) / 9.81
        t, v, z = t + impact, restitution * (9.81 * impact - v), 0.0
        last = stop
        if v < 1e-6:
            expected[last:] = 0.0
            break
    found = forms.bounce_heights(times, height=height, restitution=restitution)
    np.testing.assert_allclose(found, expected, atol=1e-9)
