"""Convergence of replicas and echo-state time: linear bodies in closed form."""

import numpy as np
import pytest

from openprc.analysis.dynamics import convergence, memory_time, replica_test
from openprc.errors import TaskError
from openprc.reservoir.networks import DelayLine, EchoStateNetwork, LinearNetwork

U = np.random.default_rng(0).uniform(-1.0, 1.0, 600)


def replicas(network, *, u=U, start=1.0):
    """Return states under one drive from rest and from elsewhere, the initial one first."""
    initial = start * np.random.default_rng(1).normal(size=network.n_states)
    return [
        np.vstack([begin, network.drive(u, initial=begin)])
        for begin in (np.zeros(network.n_states), initial)
    ]


@pytest.mark.parametrize("rho", [0.5, 0.9, 0.97])
def test_an_orthogonal_network_forgets_by_its_radius(rho):
    a, b = replicas(LinearNetwork(15, spectral_radius=rho, seed=2), u=np.tile(U, 3))
    found = convergence(a, b, scale=np.ones(15))
    assert found.rate == pytest.approx(np.log(rho), rel=1e-3)
    assert found.r_squared > 0.999999
    assert found.time_to() == pytest.approx(-1.0 / np.log(rho), rel=1e-6)
    assert found.time_to(1e-3) == pytest.approx(np.log(1e-3) / np.log(rho), rel=1e-6)
    assert found.converged
    assert found.unit == "symbols"
    assert found.remark == ""
    assert found.distance[0] == pytest.approx(np.linalg.norm(b[0]) / np.sqrt(30))


def test_times_are_in_the_unit_of_the_step():
    a, b = replicas(LinearNetwork(15, spectral_radius=0.9, seed=2))
    found = convergence(a, b, scale=np.ones(15), step=0.02, unit="s")
    assert found.rate == pytest.approx(np.log(0.9) / 0.02, rel=1e-4)
    assert found.time_to() == pytest.approx(-0.02 / np.log(0.9), rel=1e-6)


def test_independent_responses_are_one_apart():
    rng = np.random.default_rng(3)
    a, b = rng.normal(size=(2, 1000, 100)) * 10.0 ** np.linspace(0, 9, 100) + 5.0
    found = convergence(a, b)
    assert found.floor == pytest.approx(1.0, abs=0.05)
    assert not found.converged
    assert found.time_to() == np.inf
    assert "the replicas do not converge" in found.remark


def test_sensor_noise_ends_the_fit_and_does_not_bend_it():
    a, b = replicas(LinearNetwork(15, spectral_radius=0.9, seed=2), start=3.0)
    rng = np.random.default_rng(4)
    a, b = (rows + 1e-4 * rng.normal(size=rows.shape) for rows in (a, b))
    found = convergence(a, b)
    assert found.rate == pytest.approx(np.log(0.9), rel=0.02)
    assert found.fit[0] == 0
    assert 50 < found.fit[1] < 110
    assert found.r_squared > 0.99
    assert found.floor == pytest.approx(1e-4 / a[300:].std(axis=0).mean(), rel=0.3)


def test_a_chaotic_network_diverges_at_its_exponent():
    network = EchoStateNetwork(80, spectral_radius=2.5, input_scaling=0.1, seed=5)
    start = network.drive(U)[-1]
    near = start + 1e-9 * np.random.default_rng(6).normal(size=80)
    a, b = network.drive(U, initial=start), network.drive(U, initial=near)
    found = convergence(a, b)
    assert found.rate > 0.1
    assert found.r_squared > 0.9
    assert "the replicas diverge" in found.remark
    assert found.time_to() == np.inf


def test_a_delay_line_agrees_exactly_after_its_length():
    a, b = replicas(DelayLine(8))
    found = convergence(a, b)
    assert found.floor == 0.0
    assert found.converged
    assert found.time_to(1e-9) == pytest.approx(8.0)


def test_agreement_from_one_row_to_the_next_has_no_rate():
    a, b = replicas(DelayLine(1))
    found = convergence(a, b)
    assert found.rate == -np.inf
    assert "within 2 rows: the rate is rough" in found.remark


def test_rows_of_the_fit_can_be_chosen():
    a, b = replicas(LinearNetwork(15, spectral_radius=0.9, seed=2))
    found = convergence(a, b, scale=np.ones(15), fit=(5, 25))
    assert found.fit == (5, 25)
    assert found.rate == pytest.approx(np.log(0.9), rel=1e-9)
    with pytest.raises(TaskError, match="the fit runs from row 5 to 6 of 601"):
        convergence(a, b, fit=(5, 6))


def test_a_body_is_tried_from_several_initial_states():
    network = LinearNetwork(15, spectral_radius=0.8, seed=2)
    found = replica_test(network, U, spread=1.0, n_replicas=4, scale=np.ones(15))
    assert len(found.pairs) == 4
    assert found.converged
    assert found.rate == pytest.approx(np.log(0.8), rel=1e-3)
    assert found.time_to(0.01) == pytest.approx(np.log(0.01) / np.log(0.8), rel=1e-6)
    assert found.remarks == ()
    assert found.unit == "symbols"
    timed = replica_test(network, U, spread=1.0, hold=0.5, scale=np.ones(15))
    assert timed.time_to() == pytest.approx(-0.5 / np.log(0.8), rel=1e-6)
    assert timed.unit == "s"


def test_a_body_without_the_echo_state_property_says_so():
    network = EchoStateNetwork(60, spectral_radius=2.5, input_scaling=0.1, seed=5)
    found = replica_test(network, U, spread=1.0)
    assert not found.converged
    assert found.time_to() == np.inf
    assert "do not converge" in found.remarks[0]


def test_memory_of_a_ring_in_closed_form():
    """``C_k = rho^(2 N floor(k / N)) (1 - rho^(2 N))``: the mean delay is a sum of blocks."""
    n, rho = 10, 0.9
    profile = LinearNetwork(n, spectral_radius=rho, coupling="cyclic").capacity_profile(2000)
    found = memory_time(profile)
    q = rho ** (2 * n)
    assert found.mean_delay == pytest.approx((n - 1) / 2 + n * q / (1 - q), rel=1e-9)
    assert n - 1 < found.decay <= n
    assert memory_time(profile, hold=0.1).mean_delay == pytest.approx(0.1 * found.mean_delay)
    assert memory_time(profile, threshold=profile[n] * 1.01).last_delay == n - 1


def test_memory_of_a_delay_line():
    found = memory_time(DelayLine(7).capacity_profile(30))
    assert (found.decay, found.mean_delay, found.last_delay) == (7.0, 3.0, 6.0)
    assert found.remark == ""
    later = memory_time(DelayLine(7).capacity_profile(30)[1:], first_delay=1)
    assert (later.decay, later.last_delay) == (7.0, 6.0)


def test_a_profile_that_ends_too_soon_gives_bounds():
    found = memory_time(DelayLine(7).capacity_profile(4))
    assert found.decay == np.inf
    assert "memory reaches further than the profile" in found.remark
    none = memory_time([0.01, 0.02], threshold=0.05)
    assert (none.last_delay, none.decay) == (-1.0, 0.0)
    assert "no memory" in none.remark


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: convergence(U[:4, None], U[1:5, None]), "there are 4 rows"),
        (lambda: convergence(U[:, None], U[:, None]), "begin in the same state"),
        (lambda: convergence(np.eye(9), np.zeros((9, 9)), scale=[1.0]), r"scale has shape \(1,\)"),
        (
            lambda: convergence(np.eye(12)[:, :3] + 1, np.ones((12, 3))),
            "no column changes in the second half",
        ),
        (lambda: memory_time(np.eye(2)), r"the profile has shape \(2, 2\)"),
        (lambda: memory_time([np.nan]), "and is not finite"),
        (lambda: replica_test(DelayLine(2), U, spread=0.0), r"spread is 0\.0"),
        (
            lambda: convergence(U[:50, None], U[50:100, None]).time_to(1.0),
            r"the tolerance is 1\.0",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(call, words):
    with pytest.raises(TaskError, match=words):
        call()
