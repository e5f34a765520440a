"""Conditional Lyapunov exponents: linear bodies in closed form, networks on either side."""

import numpy as np
import pytest

from openprc.analysis.dynamics import lyapunov_exponent, lyapunov_spectrum
from openprc.errors import Diverged, TaskError
from openprc.reservoir.networks import DelayLine, EchoStateNetwork, LinearNetwork

U = np.random.default_rng(0).uniform(-1.0, 1.0, 400)


class Unsettable:
    n_states = 2
    state = property(lambda self: np.zeros(2))

    def reset(self):
        pass

    def step(self, u):
        return np.zeros(2)


class Exploding:
    n_states = 1

    def reset(self):
        self.state = np.ones(1)

    def step(self, u):
        self.state = self.state * 1e60
        return self.state


class WithJacobian(Exploding):
    def jacobian(self, u):
        return np.array([[1e60]])


@pytest.mark.parametrize("rho", [0.3, 0.9, 1.2])
def test_an_orthogonal_network_has_the_logarithm_of_its_radius(rho):
    network = LinearNetwork(12, spectral_radius=rho, seed=1)
    found = lyapunov_exponent(network, U[:40], washout=0)
    assert found.largest == pytest.approx(np.log(rho), abs=1e-6)
    assert found.forgets == (rho < 1.0)
    tangent = lyapunov_spectrum(network, U[:40], washout=0, n_exponents=12)
    np.testing.assert_allclose(tangent.per_symbol, np.log(rho), atol=1e-12)


def test_a_one_node_network_is_an_integral_over_its_states():
    """``ln |rho (1 - x^2)|`` averaged along the trajectory."""
    network = EchoStateNetwork(1, spectral_radius=0.9, input_scaling=0.8, seed=3)
    states = network.drive(U)[:, 0]
    expected = np.mean(np.log(0.9 * (1.0 - states[50:] ** 2)))
    assert lyapunov_spectrum(network, U, washout=50).largest == pytest.approx(expected, abs=1e-12)
    found = lyapunov_exponent(network, U, washout=50, perturbation=1e-7)
    assert found.largest == pytest.approx(expected, abs=1e-5)


def test_leaky_jacobian_agrees_with_two_trajectories():
    network = EchoStateNetwork(
        30, spectral_radius=0.9, leak_rate=0.3, input_scaling=0.5, bias_scaling=0.2, seed=4
    )
    pair = lyapunov_exponent(network, U, washout=100)
    tangent = lyapunov_spectrum(network, U, washout=100)
    assert pair.largest == pytest.approx(tangent.largest, abs=1e-5)
    assert tangent.method == "tangent vectors"
    assert pair.method == "two trajectories"


def test_networks_on_either_side_of_chaos():
    calm = EchoStateNetwork(60, spectral_radius=0.8, input_scaling=0.1, seed=5)
    wild = EchoStateNetwork(60, spectral_radius=2.5, input_scaling=0.1, seed=5)
    below = lyapunov_exponent(calm, U, washout=100)
    above = lyapunov_exponent(wild, U, washout=100)
    assert below.forgets
    assert -0.4 < below.largest < -0.1
    assert not above.forgets
    assert above.largest - 2 * above.standard_error[0] > 0.1


def test_a_strong_drive_calms_a_chaotic_network():
    exponents = [
        lyapunov_exponent(
            EchoStateNetwork(60, spectral_radius=2.0, input_scaling=scaling, seed=5),
            U,
            washout=100,
        ).largest
        for scaling in (0.05, 5.0)
    ]
    assert exponents[0] > 0.0 > exponents[1]


def test_spectrum_sums_to_the_mean_volume_change():
    network = EchoStateNetwork(6, spectral_radius=0.9, input_scaling=0.5, seed=7)
    found = lyapunov_spectrum(network, U, washout=0, n_exponents=6)
    network.reset()
    volume = []
    for symbol in U:
        volume.append(np.linalg.slogdet(network.jacobian(symbol))[1])
        network.step(symbol)
    assert found.per_symbol.sum() == pytest.approx(np.mean(volume), abs=1e-9)
    assert (np.diff(found.per_symbol) <= 0).all()


@pytest.mark.parametrize("measure", [lyapunov_exponent, lyapunov_spectrum])
def test_a_finite_memory_has_no_rate(measure):
    found = measure(DelayLine(5), U, washout=20)
    assert found.largest == -np.inf
    assert found.forgets
    assert found.remark == (
        "the perturbation vanished exactly 5 symbols after it was made: the body has a finite "
        "memory, and no rate"
    )


def test_figures_per_second():
    found = lyapunov_exponent(LinearNetwork(4, seed=1), U, washout=0, hold=0.02)
    assert found.per_second[0] == pytest.approx(np.log(0.9) / 0.02, rel=1e-6)
    with pytest.raises(TaskError, match="duration of a symbol is not known"):
        _ = lyapunov_exponent(LinearNetwork(4, seed=1), U, washout=0).per_second


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (
            lambda: lyapunov_exponent(Unsettable(), U, washout=0),
            TaskError,
            "the state of Unsettable cannot be set",
        ),
        (
            lambda: lyapunov_spectrum(Exploding(), U, washout=0),
            TaskError,
            r"Exploding offers no jacobian\(u\)",
        ),
        (
            lambda: lyapunov_spectrum(DelayLine(2), U, washout=0, n_exponents=3),
            TaskError,
            "n_exponents is 3 and the body has 2 states",
        ),
        (
            lambda: lyapunov_exponent(DelayLine(2), U, washout=395),
            TaskError,
            "the washout is 395 symbols",
        ),
        (
            lambda: lyapunov_exponent(DelayLine(2), U, washout=0, perturbation=0.0),
            TaskError,
            r"perturbation is 0\.0",
        ),
    ],
)
def test_what_cannot_be_measured_is_refused(call, error, words):
    with pytest.raises(error, match=words):
        call()


def test_a_body_that_explodes_is_reported():
    with (
        np.errstate(over="ignore"),
        pytest.raises(Diverged, match="no longer finite after symbol 5"),
    ):
        lyapunov_spectrum(WithJacobian(), U, washout=0)
    with pytest.raises(TaskError, match=r"lost in the rounding of states of size 1e\+60"):
        lyapunov_exponent(Exploding(), U, washout=0)
