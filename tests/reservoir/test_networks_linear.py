"""Linear networks and delay lines: memory capacity in closed form."""

import numpy as np
import pytest

from openprc.errors import TaskError
from openprc.reservoir.networks import DelayLine, LinearNetwork


@pytest.mark.parametrize(
    ("n", "rho", "first"), [(20, 0.9, 0.98522), (50, 0.95, 0.99408), (100, 0.98, 0.98241)]
)
def test_capacities_of_an_orthogonal_network_add_up_to_its_size(n, rho, first):
    profile = LinearNetwork(n, spectral_radius=rho, seed=1).capacity_profile(1500)
    assert profile[0] == pytest.approx(1.0 - rho ** (2 * n), abs=1e-6)
    assert profile[0] == pytest.approx(first, abs=1e-5)
    assert profile.sum() == pytest.approx(n, abs=1e-6)
    assert (profile >= -1e-12).all()


@pytest.mark.parametrize(("n", "rho"), [(5, 0.5), (20, 0.9), (30, 0.2), (100, 0.5)])
def test_capacities_of_a_ring_fall_in_steps(n, rho):
    delays = np.arange(3 * n)
    q = rho ** (2 * n)
    found = LinearNetwork(n, spectral_radius=rho, coupling="cyclic").capacity_profile(3 * n - 1)
    np.testing.assert_allclose(found, q ** (delays // n) * (1.0 - q), atol=1e-10)


def test_both_routes_to_the_profile_agree():
    """Radii on either side of the one at which the covariance becomes too thin to invert."""
    sums = []
    for rho in (0.79, 0.80):
        profile = LinearNetwork(20, spectral_radius=rho, seed=2).capacity_profile(200)
        assert profile[0] == pytest.approx(1.0 - rho**40, abs=1e-9)
        sums.append(profile[:30])
    np.testing.assert_allclose(sums[0], sums[1], atol=0.02)
    assert abs(sums[0] - sums[1]).max() > 1e-4


@pytest.mark.parametrize("coupling", ["orthogonal", "cyclic"])
def test_capacities_are_what_driven_states_show(coupling):
    network = LinearNetwork(10, spectral_radius=0.9, coupling=coupling, seed=3)
    u = np.random.default_rng(4).uniform(-1, 1, 20_300)
    states = network.drive(u)[300:]
    basis = np.linalg.qr(states - states.mean(axis=0))[0]
    expected = network.capacity_profile(14)
    for k in range(15):
        target = u[300 - k : len(u) - k] - u[300 - k : len(u) - k].mean()
        found = np.sum((basis.T @ target) ** 2) / np.sum(target**2)
        assert found == pytest.approx(expected[k], abs=0.01), f"delay {k}"


def test_a_ring_hands_its_states_on():
    states = LinearNetwork(3, spectral_radius=0.5, coupling="cyclic").drive([1.0, 0, 0, 0])
    np.testing.assert_allclose(states, [[1, 0, 0], [0, 0.5, 0], [0, 0, 0.25], [0.125, 0, 0]])


def test_an_orthogonal_network_only_turns_and_shrinks():
    network = LinearNetwork(30, spectral_radius=0.7, seed=5)
    np.testing.assert_allclose(
        network.recurrent @ network.recurrent.T, 0.49 * np.eye(30), atol=1e-12
    )
    assert np.linalg.norm(network.into) == pytest.approx(1.0)


def test_a_delay_line_holds_the_last_inputs_newest_first():
    line = DelayLine(3)
    np.testing.assert_array_equal(
        line.drive([1.0, 2.0, 3.0, 4.0]), [[1, 0, 0], [2, 1, 0], [3, 2, 1], [4, 3, 2]]
    )
    np.testing.assert_array_equal(line.step(5.0), [5, 4, 3])
    np.testing.assert_array_equal(line.capacity_profile(4), [1, 1, 1, 0, 0])


@pytest.mark.parametrize("network", [DelayLine(4), LinearNetwork(4, seed=0)], ids=repr)
def test_jacobian_is_the_response_to_a_small_change(network):
    state, u = np.random.default_rng(6).normal(size=4), 0.3
    moved = []
    for column in range(4):
        network.state = state + np.eye(4)[column]
        moved.append(network.step(u))
    network.state = state
    np.testing.assert_allclose(
        network.jacobian(u), np.transpose(np.array(moved) - network.step(u)), atol=1e-12
    )


def test_a_network_without_recurrence_recalls_the_present_only():
    np.testing.assert_array_equal(
        LinearNetwork(4, spectral_radius=0.0, seed=0).capacity_profile(2), [1, 0, 0]
    )


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: LinearNetwork(4), "no seed is given for a random matrix"),
        (lambda: LinearNetwork(4, coupling="star"), "coupling is 'star'"),
        (lambda: LinearNetwork(4, spectral_radius=1.0, seed=0).capacity_profile(3), "radius is 1"),
        (lambda: LinearNetwork(0, seed=0), "n_nodes is 0"),
        (lambda: DelayLine(2).capacity_profile(-1), r"max_delay \+ 1 is 0"),
    ],
)
def test_what_makes_no_sense_is_refused(call, words):
    with pytest.raises(TaskError, match=words):
        call()
