"""A body that is stepped symbol by symbol is the body of the whole run."""

from dataclasses import replace

import numpy as np
import pytest

from openprc.demlat.sensors import Sensors
from openprc.demlat.stepping import SteppedExperiment
from openprc.errors import Diverged
from openprc.schema.experiment import Actuator, Signal

HOLD = 0.05


def held(name, values, *, unit="N"):
    return Signal(name=name, values=values, dt=HOLD, interpolation="hold", unit=unit)


_COMPILED_LONG = ("pefrl", "respa", "midpoint")


@pytest.fixture(scope="module")
def symbols():
    return np.random.default_rng(3).uniform(-0.4, 0.4, 24)


@pytest.fixture(scope="module")
def pushed(lattice, symbols):
    """A pinned lattice with a force at a corner, held symbol by symbol."""

    def make(n=3, **settings):
        base = {
            "signals": [held("push", symbols)],
            "actuators": [Actuator(node=n * n - 1, signal="push", type="force", axes=(1, 1, 0))],
            "duration": len(symbols) * HOLD,
            "dt": 1e-3,
            "save_interval": HOLD,
        }
        return lattice(n, damping=0.05, **(base | settings))

    return make


# Every integrator compiles anew, for up to 20 s.
@pytest.mark.parametrize(
    "integrator",
    ["rk4", "verlet", *(pytest.param(n, marks=pytest.mark.slow) for n in _COMPILED_LONG)],
)
def test_it_is_the_whole_run(pushed, simulate, symbols, integrator):
    experiment = replace(pushed(), integrator=integrator)
    whole = simulate(experiment)
    body = SteppedExperiment(
        experiment, hold=HOLD, sensors=["positions", "velocities", "bar_lengths"]
    )
    states = body.run(symbols)
    assert body.time == pytest.approx(len(symbols) * HOLD)
    count, dims = experiment.geometry.n_nodes, whole.x.shape[2]
    for column, expected in ((0, whole.x), (1, whole.v)):
        got = states[:, 3 * count * column : 3 * count * (column + 1)].reshape(-1, count, 3)
        np.testing.assert_allclose(got[:, :, :dims], expected[1:], rtol=0, atol=1e-12)
    np.testing.assert_allclose(states[:, 6 * count :], whole.length[1:], rtol=0, atol=1e-12)
    assert np.ptp(whole.x, axis=0).max() > 1e-3


@pytest.mark.parametrize("integrator", ["rk4", "verlet"])
def test_prescribed_positions(pushed, simulate, symbols, integrator):
    """They jump when a symbol begins: the frames of free nodes agree, the driven one is before."""
    start = np.array([0.2, 0.2, 0.0])
    places = start + 0.02 * symbols[:, np.newaxis] * [1.0, -1.0, 0.0]
    experiment = replace(
        pushed(
            signals=[held("place", places, unit="m")],
            actuators=[Actuator(node=8, signal="place", type="position")],
        ),
        integrator=integrator,
    )
    whole = simulate(experiment)
    body = SteppedExperiment(experiment, hold=HOLD, sensors=["positions"])
    assert body.n_inputs == 3
    got = body.run(places).reshape(len(symbols), 9, 3)
    dims = whole.x.shape[2]
    free = np.arange(8)
    np.testing.assert_allclose(got[:, free, :dims], whole.x[1:, free], rtol=0, atol=1e-12)
    np.testing.assert_allclose(got[:, 8], places, rtol=0, atol=1e-15)
    assert np.ptp(whole.x[:, 4], axis=0).max() > 1e-4


@pytest.mark.slow
def test_many_elements_and_single_precision(pushed, simulate, symbols):
    """Enough elements to be stepped as vectors, in displacement form."""
    for precision, tolerance in (("float64", 1e-12), ("float32", 1e-7)):
        experiment = replace(pushed(6), precision=precision)
        whole = simulate(experiment)
        assert len(experiment.geometry.bars) > 64
        body = SteppedExperiment(experiment, hold=HOLD, sensors=["displacements"])
        got = body.run(symbols).reshape(len(symbols), 36, 3)
        moved = whole.x[1:] - experiment.geometry.positions[:, : whole.x.shape[2]]
        np.testing.assert_allclose(got[:, :, : moved.shape[2]], moved, rtol=0, atol=tolerance)
        assert np.abs(moved).max() > 1e-3


def test_other_signals_go_on(pushed, simulate, symbols):
    """A smooth force that is not decided at run time keeps its own time."""
    shake = Signal(name="shake", values=np.sin(np.arange(200.0)), dt=0.01, unit="N")
    experiment = pushed(
        signals=[shake, held("push", symbols)],
        actuators=[
            Actuator(node=7, signal="shake", type="force", axes=(1, 0, 0)),
            Actuator(node=8, signal="push", type="force", axes=(0, 1, 0)),
        ],
    )
    whole = simulate(experiment)
    body = SteppedExperiment(experiment, hold=HOLD, sensors=["positions"], inputs=["push"])
    got = body.run(symbols).reshape(len(symbols), 9, 3)
    np.testing.assert_allclose(got[:, :, : whole.x.shape[2]], whole.x[1:], rtol=0, atol=1e-12)


def test_columns_of_the_symbol(pushed, simulate, symbols):
    """Two signals, one with three columns and two uses: each column finds its place."""
    vectors = np.random.default_rng(5).uniform(-0.2, 0.2, (len(symbols), 3)) * [1, 1, 0]
    experiment = pushed(
        signals=[held("one", symbols), held("three", vectors)],
        actuators=[
            Actuator(node=8, signal="three", type="force", axes=(1, 1, 0)),
            Actuator(node=7, signal="one", type="force", axes=(0, 1, 0)),
            Actuator(node=5, signal="three", type="force", axes=(0, 1, 0)),
        ],
    )
    whole = simulate(experiment)
    body = SteppedExperiment(experiment, hold=HOLD, sensors=["positions"], inputs=["one", "three"])
    assert (body.inputs, body.n_inputs) == (("one", "three"), 4)
    got = body.run(np.column_stack([symbols, vectors])).reshape(len(symbols), 9, 3)
    np.testing.assert_allclose(got[:, :, : whole.x.shape[2]], whole.x[1:], rtol=0, atol=1e-12)


def test_readings_within_a_symbol(pushed, simulate, symbols):
    experiment = replace(pushed(), save_interval=HOLD / 5)
    whole = simulate(experiment)
    body = SteppedExperiment(experiment, hold=HOLD, sensors=["bar_extensions"], readings=5)
    got = body.run(symbols).reshape(5 * len(symbols), -1)
    expected = whole.length[1:] - experiment.geometry.bars.rest_length
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12)
    assert body.names[0] == "bar0.extension@1/5"
    assert len(body.names) == body.n_states


def test_a_planar_body_is_driven_out_of_its_plane(pushed, symbols):
    """The signal is 0 at the start; it must not be taken for always 0."""
    experiment = pushed(
        signals=[held("lift", np.zeros(1))],
        actuators=[Actuator(node=8, signal="lift", type="force", axes=(0, 0, 1))],
    )
    body = SteppedExperiment(
        experiment, hold=HOLD, sensors=[Sensors("displacements", ids=[8], axes="z")]
    )
    assert np.abs(body.run(symbols)).max() > 1e-3


def test_reset_begins_anew(pushed, symbols):
    body = SteppedExperiment(
        replace(pushed(), integrator="verlet"), hold=HOLD, sensors=["displacements"]
    )
    first = body.run(symbols)
    assert np.array_equal(body.run(symbols), first)
    body.reset()
    assert body.time == 0.0
    assert np.array_equal(body.step(symbols[:1]), first[0])


def test_readings_are_not_overwritten_later(pushed):
    body = SteppedExperiment(pushed(), hold=HOLD, sensors=["displacements"])
    one = body.step([0.3])
    kept = one.copy()
    body.step([-0.3])
    assert np.array_equal(one, kept)


def test_a_body_that_blows_up_and_begins_anew(pushed, symbols):
    experiment = replace(pushed(), dt=HOLD / 2, step_check="warn")
    body = SteppedExperiment(experiment, hold=HOLD, sensors=["displacements"])
    with pytest.raises(Diverged, match=r"node \d left the range .* by t = ") as failure:
        body.run(np.tile(symbols, 50))
    assert "stability limit" in failure.value.fix
    body.reset()
    assert np.isfinite(body.step([0.0])).all()
