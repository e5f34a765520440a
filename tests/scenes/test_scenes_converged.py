"""The solver of references: against formulas, its own tolerance, and at jumps of a drive."""

from types import SimpleNamespace

import numpy as np
import pytest

from openprc.errors import NotConverged
from openprc.scenes.catalog import build_scene
from openprc.scenes.converged import converged_motion
from openprc.schema.experiment import Actuator, Experiment, Signal
from openprc.schema.geometry import Geometry


@pytest.mark.parametrize("name", ["oscillator", "damped-oscillator"])
def test_it_agrees_with_a_formula(name):
    scene = build_scene(name)
    times = np.array([0.0, 0.3, 0.30001, 1.7, 5.0])
    found = converged_motion(scene.experiment)(times)
    np.testing.assert_allclose(found, scene.reference.exact(times), atol=1e-9)


def test_it_agrees_with_rigid_links_as_links_become_stiff():
    """The difference goes as one over the stiffness."""
    times, apart = np.array([0.2]), []
    rigid = build_scene("swinging-chain", {"n": 2, "rigid": True}).reference.exact(times)
    for stiffness in (1e4, 4e4):
        soft = build_scene("swinging-chain", {"n": 2, "stiffness": stiffness})
        apart.append(np.abs(soft.reference.exact(times) - rigid).max())
    assert apart[0] / apart[1] == pytest.approx(4.0, rel=0.25)


@pytest.mark.parametrize(
    ("name", "options", "end"),
    [
        ("spring-lattice", {"n_symbols": 4}, 0.6),
        ("hauser-network", {"n_steps": 100}, 0.1),
        ("miura", {"n_symbols": 2, "columns": 1, "rows": 1}, 0.2),
        ("swinging-chain", {"stiffness": 1e3}, 0.3),
    ],
)
def test_it_converges(name, options, end):
    """A hundredth of the tolerance is nearer to the finest by about as much."""
    scene = build_scene(name, options)
    times = np.linspace(0.0, end, 5)
    paths = [
        converged_motion(scene.experiment, tolerance=tolerance)(times)
        for tolerance in (1e-5, 1e-7, 1e-9, 1e-12)
    ]
    errors = [np.abs(path - paths[-1]).max() / scene.scale for path in paths[:-1]]
    assert errors[0] < 1e-2
    assert errors[1] < 0.2 * errors[0]
    assert errors[2] < 0.2 * errors[1]
    assert errors[2] < 1e-5


def free_mass(signals, *, kind="force", duration=1.0):
    body = Geometry(positions=[[0, 0, 0]], masses=[0.5], fixed=[0])
    actuators = tuple(
        Actuator(node=0, signal=name, type=kind, axes=(True, False, False)) for name in signals
    )
    return Experiment(
        geometry=body, signals=signals, actuators=actuators, duration=duration, dt=0.01,
        save_interval=0.1,
    )  # fmt: skip


def test_a_held_force_jumps_where_it_says():
    """``x = F t^2 / 2 m`` up to 0.3 s, then with the next force."""
    push = Signal(name="push", values=[1.0, -3.0, 0.5], dt=0.3, interpolation="hold")
    found = converged_motion(free_mass({"push": push}))(np.array([0.1, 0.3, 0.45, 0.6, 0.9, 1.2]))
    x, v, expected = 0.0, 0.0, []
    for force, marks in ((2.0, (0.1, 0.3)), (-6.0, (0.15, 0.3)), (1.0, (0.3, 0.6))):
        expected += [x + v * t + 0.5 * force * t**2 for t in marks]
        # The last value stays.
        t = 0.3
        x, v = x + v * t + 0.5 * force * t**2, v + force * t
    np.testing.assert_allclose(found[:, 0, 0], expected, rtol=1e-10, atol=1e-14)


def test_a_driven_node_is_where_its_signal_says():
    move = Signal(name="move", values=[0.0, 0.2, 0.1], dt=0.5)
    found = converged_motion(free_mass({"move": move}, kind="position"))(
        np.array([0.0, 0.25, 0.5, 0.75, 1.0])
    )
    np.testing.assert_allclose(found[:, 0, 0], [0.0, 0.1, 0.2, 0.15, 0.1], atol=1e-12)


def test_nothing_has_moved_at_the_start():
    scene = build_scene("spring-lattice", {"n_symbols": 1})
    found = scene.reference.exact(np.zeros(1))
    np.testing.assert_array_equal(found[0], scene.experiment.geometry.positions)


def test_a_solver_that_fails_says_how_far_it_came(monkeypatch):
    def give_up(slope, span, start, *_, **__):
        return SimpleNamespace(status=-1, t=np.array([0.25]), message="the step became too small")

    monkeypatch.setattr("scipy.integrate.solve_ivp", give_up)
    with pytest.raises(NotConverged, match=r"stops at 0\.25 s: the step became too small"):
        build_scene("spring-lattice").reference.exact(np.array([0.1]))
