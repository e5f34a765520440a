"""A recorded network reads back as a body does."""

import numpy as np
import pytest

from openprc.errors import ResultExists, TaskError
from openprc.reservoir import Channels, StateLoader
from openprc.reservoir.networks import (
    DelayLine,
    EchoStateNetwork,
    reference_network,
    write_network_run,
)
from openprc.schema.validate import validate_file

U = np.random.default_rng(0).uniform(0.0, 0.5, 40)


@pytest.mark.parametrize("frames", [1, 3])
def test_states_and_symbols_come_back(tmp_path, frames):
    network = EchoStateNetwork(6, input_scaling=0.5, seed=1)
    path = write_network_run(
        tmp_path / "simulation.h5", network, U, hold=0.2, frames_per_symbol=frames
    )
    assert validate_file(path).ok
    with StateLoader(path) as loader:
        clock = loader.symbols()
        assert clock.n_symbols == 40
        np.testing.assert_array_equal(clock.sequence[:, 0], U)
        assert clock.hold == pytest.approx(0.2)
        states = Channels().transform(loader)
        assert states.shape == (40 * frames, 6)
        np.testing.assert_array_equal(states[clock.frames], network.drive(U))
        np.testing.assert_array_equal(
            loader.get_actuation_signal("drive", "u0"), np.repeat(U, frames)
        )
        assert Channels().names(loader)[:2] == ["state.x0", "state.x1"]


def test_several_inputs_and_sensor_noise(tmp_path):
    network = EchoStateNetwork(4, n_inputs=2, seed=1)
    u = np.random.default_rng(1).normal(size=(500, 2))
    path = write_network_run(tmp_path / "simulation.h5", network, u, noise=0.01, seed=2)
    with StateLoader(path) as loader:
        assert loader.symbols().columns == ("u0", "u1")
        added = Channels().transform(loader) - network.drive(u)
    assert added.std() == pytest.approx(0.01, rel=0.1)


def test_another_initial_state(tmp_path):
    start = np.ones(3)
    path = write_network_run(tmp_path / "simulation.h5", DelayLine(3), U, initial=start)
    with StateLoader(path) as loader:
        np.testing.assert_array_equal(Channels().transform(loader)[0], [U[0], 1, 1])


def test_a_run_is_not_replaced_unless_asked(tmp_path):
    path = write_network_run(tmp_path / "simulation.h5", DelayLine(3), U)
    with pytest.raises(ResultExists, match=r"simulation\.h5"):
        write_network_run(path, DelayLine(3), U)
    write_network_run(path, DelayLine(3), U, overwrite=True)
    with pytest.raises(TaskError, match=r"hold is 0\.0"):
        write_network_run(path, DelayLine(3), U, hold=0.0)
    with pytest.raises(TaskError, match="frames_per_symbol is 0"):
        write_network_run(path, DelayLine(3), U, frames_per_symbol=0)


def test_the_reference_does_not_depend_on_the_unit_of_the_drive():
    states = reference_network(30, U, seed=4)
    assert states.shape == (40, 30)
    np.testing.assert_allclose(reference_network(30, 1e-3 * U - 7.0, seed=4), states, atol=1e-9)
    assert (reference_network(30, U, seed=5) != states).any()
    both = reference_network(30, np.column_stack([U, np.ones(40)]), seed=4)
    np.testing.assert_allclose(both, states, err_msg="a column that never changes drives nothing")


@pytest.mark.parametrize(
    ("u", "words"),
    [
        (np.full(5, 0.3), "no column of the input changes"),
        ([0.1, np.nan], "and is not finite"),
        (np.zeros((2, 2, 2)), r"the input has shape \(2, 2, 2\)"),
    ],
)
def test_the_reference_needs_an_input(u, words):
    with pytest.raises(TaskError, match=words):
        reference_network(5, u)
