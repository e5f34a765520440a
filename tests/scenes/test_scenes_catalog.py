"""Records, builders and options."""

import inspect
from importlib import import_module

import numpy as np
import pytest

from openprc.errors import ConfigError
from openprc.hooks.specs import ELEMENTS
from openprc.scenes.catalog import SCENES, build_scene, find_scene, scene_options, write_scene
from openprc.scenes.requirements import elements_of
from openprc.schema import load_experiment
from openprc.schema.experiment_checks import check_experiment

SHORT = {"hauser-network": {"n_steps": 50}}


@pytest.fixture(scope="module")
def scenes():
    return {name: build_scene(name, SHORT.get(name)) for name in SCENES}


@pytest.mark.parametrize("name", list(SCENES))
def test_a_record_and_its_builder_agree(scenes, name):
    spec, scene = SCENES[name], scenes[name]
    module, _, function = spec.load.partition(":")
    builder = getattr(import_module(module), function)
    assert list(inspect.signature(builder).parameters) == [o.name for o in spec.options]
    assert scene.name == spec.name == name
    assert scene.reference.kind == spec.reference
    assert set(spec.needs) <= set(ELEMENTS)
    # The body uses what the record says; drag besides only brings slow bodies to rest.
    used = set(elements_of(scene.experiment))
    assert set(spec.needs) <= used
    assert used - set(spec.needs) <= ({"damping"} if scene.quasi_static else set())


@pytest.mark.parametrize("name", list(SCENES))
def test_a_scene_is_whole(scenes, name):
    scene = scenes[name]
    experiment, geometry = scene.experiment, scene.experiment.geometry
    check_experiment(experiment)
    assert len(set(geometry.labels)) == geometry.n_nodes
    assert scene.scale > 0.0
    assert scene.reference.probes
    assert scene.reference.text
    assert scene.reference.source
    for probe in scene.reference.probes:
        assert np.isfinite(probe.value)
        assert 0.0 < probe.tolerance < 0.2
    if scene.input_name is not None:
        signal = experiment.signals[scene.input_name]
        assert signal.sequence is not None
        assert scene.input_name in {actuator.signal for actuator in experiment.actuators}
        assert signal.hold * len(signal.sequence) == pytest.approx(experiment.duration)


@pytest.mark.parametrize("name", list(SCENES))
def test_the_exact_motion_begins_where_the_body_is(scenes, name):
    scene = scenes[name]
    if scene.reference.exact is None:
        assert name == "cantilever"
        return
    start = scene.reference.exact(np.zeros(1))
    assert start.shape == (1, *scene.experiment.geometry.positions.shape)
    np.testing.assert_allclose(start[0], scene.experiment.geometry.positions, atol=1e-12)


@pytest.mark.parametrize("name", list(SCENES))
def test_what_is_written_is_read_again(scenes, name, tmp_path):
    write_scene(scenes[name], tmp_path)
    again, made = load_experiment(tmp_path), scenes[name].experiment
    assert again.settings() == made.settings()
    assert again.geometry.labels == made.geometry.labels
    np.testing.assert_array_equal(again.geometry.positions, made.geometry.positions)
    for key, signal in made.signals.items():
        np.testing.assert_array_equal(again.signals[key].values, signal.values)
        if signal.sequence is not None:
            np.testing.assert_array_equal(again.signals[key].sequence, signal.sequence)


@pytest.mark.parametrize("name", ["hauser-network", "spring-lattice", "miura"])
def test_a_seed_decides_everything(name):
    one, same, other = (
        build_scene(name, {**SHORT.get(name, {}), "seed": seed}).experiment for seed in (3, 3, 4)
    )
    bodies = [(e.geometry.positions, e.geometry.bars.stiffness) for e in (one, same, other)]
    drives = [next(iter(e.signals.values())).values for e in (one, same, other)]
    for a, b in zip(bodies[0], bodies[1], strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(drives[0], drives[1])
    assert drives[0].shape != drives[2].shape or (drives[0] != drives[2]).any()


@pytest.mark.parametrize(("drive", "amplitude"), [("volterra", 0.2), ("narma", 8.0**0.5)])
def test_hausers_network_is_what_was_published(drive, amplitude):
    """30 masses in 10 m x 10 m, about 78 springs, two fixed nodes, input on a fifth."""
    scene = build_scene("hauser-network", {"drive": drive, "n_steps": 2000})
    geometry, bars = scene.experiment.geometry, scene.experiment.geometry.bars
    assert geometry.n_nodes == 30
    assert 70 <= len(bars) <= 85
    # Euler: edges of a triangulation, with as many of them on the hull as there are corners.
    assert len(np.unique(np.sort(bars.indices, axis=1), axis=0)) == len(bars)
    x = geometry.positions[:, 0]
    assert set(np.flatnonzero(geometry.fixed)) == {x.argmin(), x.argmax()}
    highest, lowest = (200.0, 1.0) if drive == "volterra" else (100.0, 10.0)
    assert lowest <= bars.stiffness.min() < bars.stiffness.max() <= highest
    assert lowest <= bars.damping.min() < bars.damping.max() <= highest
    for column in (bars.stiffness_cubic, bars.damping_cubic):
        assert 1.0 <= column.min() < column.max() <= 100.0
    assert len(scene.experiment.actuators) == 6
    u = scene.experiment.signals[scene.input_name].sequence[:, 0]
    t = 1e-3 * np.arange(2000)
    turns = [np.sin(2.0 * np.pi * f * t) for f in (2.11, 3.73, 4.33)]
    np.testing.assert_allclose(u, amplitude * turns[0] * turns[1] * turns[2], atol=1e-15)
    for actuator in scene.experiment.actuators:
        weight = scene.experiment.signals[actuator.signal].values[:-1, 0] @ u / (u @ u)
        assert abs(weight) <= 1.0
        assert actuator.axes == (True, False, False)
        assert not geometry.fixed[actuator.node]


def test_options_are_filled_in_and_typed():
    assert scene_options("kresling", {"sides": "8"}) == {
        "sides": 8, "twist": 50.0, "height": 0.175, "duration": 20.0,
    }  # fmt: skip
    assert build_scene("kresling", {"sides": "8"}).experiment.geometry.n_nodes == 16


@pytest.mark.parametrize(
    ("name", "options", "says"),
    [
        ("oscillator", {"amplitude": 1.0}, "amplitude .* is 1\n  expected: above 0, below 1"),
        ("oscillator", {"periods": 0}, "periods .* is 0\n  expected: at least 1"),
        ("damped-oscillator", {"ratio": -0.1}, "ratio .* is -0.1"),
        ("damped-oscillator", {"where": "air"}, "one of bar, medium"),
        ("pendulum", {"angle": 3.2}, "angle .* is 3.2"),
        ("hanging-chain", {"mode": 6}, "mode 6 of a chain of 5 masses"),
        ("hanging-chain", {"amplitude": 0.1}, "amplitude .* is 0.1"),
        ("swinging-chain", {"n": 0}, "n .* is 0"),
        ("cantilever", {"n": 1}, "n .* is 1\n  expected: at least 2"),
        ("cantilever", {"duration": 5}, "duration .* at least 20"),
        ("von-mises-truss", {"rise": 1.5}, "rise .* is 1.5"),
        ("spring-lattice", {"side": 1}, "side .* is 1"),
        ("hauser-network", {"n": 4}, "n .* is 4"),
        ("hauser-network", {"seed": -1}, "seed .* is -1"),
        ("miura", {"columns": 0}, "columns .* is 0"),
        ("kresling", {"twist": 180}, "twist .* is 180"),
        ("kresling", {"height": 0.1}, "one state without strain only"),
        ("bouncing-body", {"restitution": 1.1}, "restitution .* is 1.1"),
    ],
)
def test_options_out_of_range(name, options, says):
    with pytest.raises(ConfigError, match=f"(?s){says}"):
        build_scene(name, options)


def test_unknown_names():
    with pytest.raises(ConfigError, match="did you mean 'kresling'"):
        find_scene("kressling")
    with pytest.raises(ConfigError, match="did you mean 'n_steps'"):
        build_scene("hauser-network", {"nsteps": 3})
