"""The echo state network: its recursion, its scalings, its seeds, its states."""

import numpy as np
import pytest
from scipy.sparse import issparse

from openprc.errors import TaskError
from openprc.reservoir.networks import EchoStateNetwork
from openprc.reservoir.networks.echo_state import largest_eigenvalue

SETTINGS = {"spectral_radius": 0.8, "input_scaling": 0.5, "bias_scaling": 0.3, "leak_rate": 0.6}


@pytest.mark.parametrize("n_inputs", [1, 3])
@pytest.mark.parametrize("density", [1.0, 0.08])
def test_states_follow_the_recursion(n_inputs, density):
    network = EchoStateNetwork(40, n_inputs=n_inputs, density=density, seed=1, **SETTINGS)
    u = np.random.default_rng(0).uniform(-1, 1, (25, n_inputs))
    expected, x = [], np.zeros(40)
    for symbol in u:
        bent = np.tanh(network.recurrent @ x + network.into @ symbol + network.bias)
        x = 0.4 * x + 0.6 * bent
        expected.append(x)
    np.testing.assert_allclose(network.drive(u), expected, atol=1e-14)


@pytest.mark.parametrize("density", [1.0, 0.3, 0.05])
@pytest.mark.parametrize("radius", [0.0, 0.5, 1.4])
def test_spectral_radius_is_the_one_asked_for(radius, density):
    network = EchoStateNetwork(60, spectral_radius=radius, density=density, seed=2)
    assert np.abs(np.linalg.eigvals(network.recurrent)).max() == pytest.approx(radius, abs=1e-10)


def test_a_large_network_is_scaled_without_all_its_eigenvalues(monkeypatch):
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(150, 150)))[0]
    matrix = turn * np.linspace(-3.0, 2.9, 150) @ turn.T
    monkeypatch.setattr("openprc.reservoir.networks.echo_state._DENSE_EIGENVALUES", 100)
    monkeypatch.setattr(np.linalg, "eigvals", None)
    assert largest_eigenvalue(matrix) == pytest.approx(3.0, rel=1e-9)


def test_density_is_the_share_of_connections():
    network = EchoStateNetwork(120, density=0.05, seed=4)
    assert np.mean(network.recurrent != 0.0) == pytest.approx(0.05, abs=0.008)
    assert issparse(network._product)


def test_weights_and_bias_lie_within_their_scalings():
    network = EchoStateNetwork(150, input_scaling=0.2, bias_scaling=3.0, seed=5)
    assert 0.19 < np.abs(network.into).max() <= 0.2
    assert 2.9 < np.abs(network.bias).max() <= 3.0
    assert not EchoStateNetwork(5, seed=5).bias.any()


def test_a_seed_makes_the_network_and_scalings_only_scale_it():
    first, again = (EchoStateNetwork(20, seed=6, **SETTINGS) for _ in range(2))
    np.testing.assert_array_equal(first.recurrent, again.recurrent)
    np.testing.assert_array_equal(first.into, again.into)
    scaled = EchoStateNetwork(20, seed=6, spectral_radius=0.4, input_scaling=1.0)
    np.testing.assert_allclose(scaled.recurrent, first.recurrent / 2, rtol=1e-12)
    np.testing.assert_allclose(scaled.into, 2 * first.into, rtol=1e-12)
    assert (EchoStateNetwork(20, seed=7).recurrent != scaled.recurrent).all()


def test_steps_and_drives_agree_and_go_on_from_where_they_are():
    network = EchoStateNetwork(20, seed=8, **SETTINGS)
    u = np.random.default_rng(1).uniform(-1, 1, 12)
    states = network.drive(u)
    np.testing.assert_array_equal(network.state, states[-1])
    network.reset()
    np.testing.assert_allclose([network.step(x) for x in u], states, atol=1e-15)
    np.testing.assert_allclose(network.drive(u[5:], initial=states[4]), states[5:], atol=1e-15)
    np.testing.assert_allclose(network.drive(u), states, atol=1e-15, err_msg="starts from rest")


def test_states_that_were_handed_out_do_not_change_later():
    network = EchoStateNetwork(5, seed=9)
    states = network.drive([0.1, 0.2])
    kept = states.copy()
    network.step(1.0)
    network.state = np.ones(5)
    states_later = network.step(0.5).copy()
    np.testing.assert_array_equal(states, kept)
    np.testing.assert_array_equal(network.state, states_later)


def test_jacobian_is_the_derivative_of_a_step():
    network = EchoStateNetwork(8, seed=10, **SETTINGS)
    state, h = np.random.default_rng(2).uniform(-0.5, 0.5, 8), 1e-6
    columns = []
    for direction in np.eye(8):
        ends = []
        for sign in (1, -1):
            network.state = state + sign * h * direction
            ends.append(network.step(0.4))
        columns.append((ends[0] - ends[1]) / (2 * h))
    network.state = state
    np.testing.assert_allclose(network.jacobian(0.4), np.transpose(columns), atol=1e-9)


def test_settings_are_told():
    network = EchoStateNetwork(20, seed=6, **SETTINGS)
    assert EchoStateNetwork(
        **{k: v for k, v in network.config().items() if k != "type"}
    ).recurrent == pytest.approx(network.recurrent)
    assert repr(network).startswith("EchoStateNetwork(n_nodes=20, spectral_radius=0.8")
    assert EchoStateNetwork(3, seed=np.random.default_rng(0)).config()["seed"] is None


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"n_nodes": 0}, "n_nodes is 0"),
        ({"spectral_radius": -0.1}, r"spectral_radius is -0\.1"),
        ({"leak_rate": 1.5}, r"leak_rate is 1\.5"),
        ({"density": 0.0}, r"density is 0\.0"),
        ({"input_scaling": np.nan}, "input_scaling is nan"),
        ({"density": 0.01, "n_nodes": 6}, "no closed loop, so W has no eigenvalue but zero"),
    ],
)
def test_settings_out_of_range_are_refused(settings, words):
    with pytest.raises(TaskError, match=words):
        EchoStateNetwork(**{"n_nodes": 10, "seed": 0, **settings})


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda n: n.drive(np.zeros((4, 2))), r"the input has shape \(4, 2\)"),
        (lambda n: n.drive([]), r"the input has shape \(0,\)"),
        (lambda n: n.drive([0.0, np.inf]), "1 of 2 symbols are NaN or infinite"),
        (lambda n: n.step([1.0, 2.0]), r"the symbol has shape \(2,\)"),
        (lambda n: n.drive([1.0], initial=np.zeros(3)), r"the state has shape \(3,\)"),
        (lambda n: setattr(n, "state", np.full(10, np.nan)), "and is not finite"),
    ],
)
def test_inputs_and_states_of_the_wrong_shape_are_refused(call, words):
    with pytest.raises(TaskError, match=words):
        call(EchoStateNetwork(10, seed=0))
