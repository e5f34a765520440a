"""Every scene in the native engine meets its own probes; options do what they say."""

import numpy as np
import pytest

from openprc.scenes.catalog import SCENES, build_scene
from openprc.scenes.probes import path_of, places
from openprc.scenes.verification import verify_scene
from openprc.schema import Trajectory

#: Scenes whose defaults are made for tasks, in short.
SHORT = {
    "hauser-network": {"n_steps": 600},
    "spring-lattice": {"n_symbols": 12},
    "miura": {"n_symbols": 6},
}
MORE = [
    ("damped-oscillator", {"where": "medium", "ratio": 0.3}),
    ("damped-oscillator", {"ratio": 1.0}),
    ("damped-oscillator", {"ratio": 3.0, "where": "medium"}),
    ("pendulum", {"rigid": True, "angle": 2.8}),
    ("hanging-chain", {"n": 3, "mode": 2}),
    ("swinging-chain", {"rigid": True, "duration": 0.5, "n": 3}),
    ("cantilever", {"n": 5}),
    ("von-mises-truss", {"rise": 0.05}),
    ("von-mises-truss", {"loader": 0.3}),
    ("miura", {"variant": "folding"}),
    ("kresling", {"sides": 8, "twist": 60.0, "height": 0.15}),
    ("bouncing-body", {"restitution": 1.0, "bounces": 2}),
    ("hauser-network", {"n_steps": 600, "drive": "narma", "seed": 4}),
]


def assert_holds(scene, path):
    with Trajectory(path) as run:
        results = verify_scene(scene, run)
    assert results
    for result in results:
        assert result.ok, result.as_dict()


@pytest.mark.parametrize("name", list(SCENES))
def test_a_run_gives_what_is_known(run_scene, name):
    assert_holds(*run_scene(name, **SHORT.get(name, {})))


@pytest.mark.parametrize(("name", "options"), MORE)
def test_with_other_options_too(run_scene, name, options):
    assert_holds(*run_scene(name, **options))


def test_a_soft_spring_lets_the_truss_jump(run_scene):
    """Past the limit load the apex falls through within a second; a stiff spring holds it."""
    fastest = {}
    for loader in (0.3, 10.0):
        scene, path = run_scene("von-mises-truss", loader=loader)
        assert (scene.reference.exact is None) == (loader == 0.3)
        with Trajectory(path) as run:
            z = path_of(run, "apex")[:, 2]
            fastest[loader] = np.abs(np.diff(z)).max() / run.dt
    assert fastest[0.3] > 10.0 * fastest[10.0]


def test_the_tower_has_no_strain_in_its_second_state(run_scene):
    """A published pair of states: h 1.75 to 0.91423104 and 50 to 130 degrees for R = 1."""
    scene, path = run_scene("kresling")
    with Trajectory(path) as run:
        top = places(run, ["top0"])[-1, 0]
    assert top[2] == pytest.approx(0.091423104, abs=1e-9)
    assert np.hypot(*top[:2]) == pytest.approx(0.1, rel=1e-9)
    # The azimuth went from 50 - 30 degrees to 130 - 30.
    assert np.degrees(np.arctan2(top[1], top[0])) == pytest.approx(100.0, abs=1e-6)
    assert scene.reference.probes[0].value == pytest.approx(80.0)


def test_engine_and_kernels_for_many_hinges_give_finite_energies(run_scene):
    """Blocks of hinges with walls that are not full had an energy that was no number."""
    _, path = run_scene("miura", n_symbols=1)
    with Trajectory(path) as run:
        energy = run.system("elastic_energy_hinges")
        angle, torque = run.element("hinges", "angle"), run.element("hinges", "torque")
        rest = run.element_static("hinges", "rest_angle")
    assert np.isfinite(energy).all()
    np.testing.assert_allclose(
        energy, 0.5 * (torque * (angle - rest)).sum(axis=1), rtol=1e-9, atol=1e-18
    )


@pytest.mark.parametrize(
    ("name", "option", "value"),
    [
        ("hanging-chain", "mode", 2),
        ("oscillator", "frequency", 1.001),
        ("cantilever", "force", 0.00501),
        ("kresling", "height", 0.1753),
        ("bouncing-body", "restitution", 0.82),
        ("spring-lattice", "seed", 2),
        ("pendulum", "angle", 1.49),
    ],
)
def test_a_run_of_something_else_does_not_pass(run_scene, name, option, value):
    _, path = run_scene(name, **SHORT.get(name, {}), **{option: value})
    scene = build_scene(name, SHORT.get(name))
    with Trajectory(path) as run:
        assert not all(result.ok for result in verify_scene(scene, run))
