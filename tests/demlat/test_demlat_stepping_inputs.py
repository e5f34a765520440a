"""What a stepped body refuses, what its sensors are called, and readouts that fit them."""

from dataclasses import replace

import numpy as np
import pytest

from openprc.demlat import BarHingeModel, Engine
from openprc.demlat.sensors import QUANTITIES, Sensors
from openprc.demlat.stepping import SteppedExperiment
from openprc.errors import ConfigError, UnsupportedScene
from openprc.reservoir import (
    BarExtensions,
    BarStrains,
    NodeDisplacements,
    NodeVelocities,
    Readout,
    Ridge,
    StateLoader,
    Trainer,
)
from openprc.reservoir.training.closed_loop import SteppedBody
from openprc.schema.experiment import Actuator, Collision, Signal, save_experiment

HOLD = 0.05


@pytest.fixture
def experiment(lattice):
    push = Signal(name="push", values=[0.0], dt=HOLD, interpolation="hold", unit="N")
    return lattice(
        3,
        damping=0.05,
        signals=[push],
        actuators=[Actuator(node=8, signal="push", type="force", axes=(1, 1, 0))],
        duration=1.0,
        dt=1e-3,
        save_interval=HOLD,
    )


def stepped(experiment, **settings):
    arguments = {"hold": HOLD, "sensors": ["displacements"]} | settings
    return SteppedExperiment(experiment, **arguments)


@pytest.mark.parametrize(
    ("frames", "samples", "readings"), [(1, 1, 1), (5, 1, [0.8]), (5, 2, [0.4, 0.8])]
)
def test_a_readout_of_a_recording_fits(experiment, tmp_path, frames, samples, readings):
    """States of the stepped body are those that features read from the file of a whole run."""
    symbols = np.random.default_rng(0).uniform(-0.3, 0.3, 60)
    signal = replace(experiment.signals["push"], values=symbols, sequence=None, hold=None)
    recorded = replace(experiment, signals={"push": signal}, duration=len(symbols) * HOLD)
    recorded = replace(recorded, save_interval=HOLD / frames)
    save_experiment(recorded, tmp_path)
    run = Engine(BarHingeModel, backend="cpu").run(tmp_path)
    trainer = Trainer(
        [
            NodeDisplacements([3, 5, 8], dims=[0, 1]),
            NodeVelocities([4], dims=[0, 1]),
            BarExtensions(),
            BarStrains([2]),
        ],
        Ridge(1e-8),
        loader=StateLoader(run.path),
        washout=10 * HOLD,
        train_duration=40 * HOLD,
        test_duration=10 * HOLD,
        experiment_dir=tmp_path,
        samples_per_symbol=samples,
    )
    readout = Readout.load(trainer.train(np.roll(symbols, 1), "recall").save())
    sensors = [
        Sensors("displacements", ids=[3, 5, 8], axes="xy"),
        Sensors("velocities", ids=[4], axes="xy"),
        "bar_extensions",
        Sensors("bar_strains", ids=[2]),
    ]
    body = stepped(experiment, sensors=sensors, readings=readings)
    assert isinstance(body, SteppedBody)
    assert body.names == readout.feature_names
    states = body.run(symbols)
    np.testing.assert_allclose(states, trainer.states.values, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        readout.predict(states), readout.predict(trainer.states.values), rtol=0, atol=1e-6
    )


def test_every_quantity_has_its_columns(experiment):
    widths = {"bar_lengths": len(experiment.geometry.bars)}
    widths["bar_extensions"] = widths["bar_strains"] = widths["bar_lengths"]
    for quantity in QUANTITIES:
        if quantity in ("hinge_angles", "bend_angles"):
            continue
        body = stepped(experiment, sensors=[quantity])
        assert body.n_states == widths.get(quantity, 27)
        assert body.step([0.1]).shape == (body.n_states,)
    assert stepped(experiment).names[:3] == ("node0.x", "node0.y", "node0.z")


def test_hinge_angles(body):
    corners = [[0, 0, 0], [1, 0, 0], [0.5, 0.9, 0.1], [0.5, -0.9, 0.2]]
    push = Signal(name="push", values=[0.0], dt=1.0, interpolation="hold")
    experiment = body(
        corners,
        [1.0] * 4,
        hinges=[(0, 1, 2, 3, 1.0, 3.0, 0.1)],
        fixed=[True, True, True, False],
        signals=[push],
        actuators=[Actuator(node=3, signal="push", type="force", axes=(0, 0, 1))],
        integrator="rk4",
    )
    folded = stepped(experiment, hold=0.2, sensors=["hinge_angles"])
    assert folded.names == ("hinge0",)
    at_rest, lifted = folded.run([0.0, 5.0])
    assert abs(lifted[0] - at_rest[0]) > 0.05


def contact(experiment):
    geometry = replace(experiment.geometry, collidable=np.ones(9, dtype=bool))
    return replace(experiment, geometry=geometry, collision=Collision(enabled=True, radius=1e-3))


def rigid(experiment):
    stiff = np.zeros(len(experiment.geometry.bars), dtype=bool)
    stiff[0] = True
    bars = replace(experiment.geometry.bars, rigid=stiff)
    return replace(
        experiment, geometry=replace(experiment.geometry, bars=bars), integrator="rattle"
    )


def prescribed_velocity(experiment):
    actuator = replace(experiment.actuators[0], type="velocity")
    return replace(experiment, actuators=(actuator,))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (contact, "contact in a body that is stepped"),
        (rigid, "rigid elements in a body that is stepped"),
        (prescribed_velocity, "prescribes a velocity"),
        (lambda e: replace(e, integrator="rk45"), "the integrator 'rk45' in a body"),
        (lambda e: replace(e, integrator="dop853"), "expected: one of rk4, verlet"),
        (lambda e: replace(e, integrator="legacy"), "the integrator 'legacy'"),
        (lambda e: replace(e, integrator="euler"), "the integrator 'euler'"),
        (lambda e: replace(e, dt=HOLD / 2), "stability limit"),
    ],
)
def test_scenes_that_cannot_be_stepped(experiment, change, words):
    with pytest.raises(UnsupportedScene, match=words):
        stepped(change(experiment))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"hold": 0.0}, "hold=0.0"),
        ({"hold": 0.0505}, "a whole number of steps in a frame"),
        ({"readings": 7}, "symbols of 0.05 s with 7 frame"),
        ({"readings": 0}, "readings=0"),
        ({"readings": [0.0, 0.5]}, r"rising shares of a symbol in \(0, 1\]"),
        ({"readings": [0.8, 0.4]}, "rising shares"),
        ({"readings": [np.pi / 4]}, "a denominator of at most 1000"),
        ({"sensors": []}, "no sensors"),
        ({"sensors": ["colours"]}, "sensors of 'colours'"),
        ({"sensors": [Sensors("positions", axes="w")]}, "the axes 'w'"),
        ({"sensors": [Sensors("positions", ids=[9])]}, "node 9 of 9"),
        ({"sensors": [Sensors("bar_lengths", ids=[0.5])]}, "sensors on no bar"),
        ({"sensors": ["hinge_angles"]}, "sensors on no hinge"),
        ({"inputs": ["pull"]}, r"the inputs \['pull'\]"),
        ({"inputs": []}, "each once: push"),
    ],
)
def test_settings_that_make_no_body(experiment, settings, words):
    with pytest.raises(ConfigError, match=words):
        stepped(experiment, **settings)


def test_a_body_without_actuators(experiment):
    with pytest.raises(ConfigError, match="there is none"):
        stepped(replace(experiment, actuators=()))


@pytest.mark.parametrize("symbol", [[0.1, 0.2], [np.nan], np.zeros((1, 1))])
def test_symbols_that_do_not_fit(experiment, symbol):
    with pytest.raises(ConfigError, match=r"expected: 1 finite number\(s\), for push"):
        stepped(experiment).step(symbol)
