"""FORCE: learning inside the loop."""

import numpy as np
import pytest
from sklearn.linear_model import SGDRegressor
from stepped_bodies import Taps, zero_crossings

from openprc.errors import Diverged, TaskError
from openprc.reservoir import Ridge
from openprc.reservoir.networks.echo_state import EchoStateNetwork
from openprc.reservoir.readout.rls import RLS
from openprc.reservoir.training.closed_loop import Feedback, run_closed_loop, teacher_forced_states
from openprc.reservoir.training.force import force_train

WAVE = np.sin(2.0 * np.pi * np.arange(3000) / 40.0)


def network():
    """Chaotic when left alone, and slow against a symbol."""
    return EchoStateNetwork(100, spectral_radius=1.5, leak_rate=0.3, bias_scaling=0.2, seed=1)


def test_it_tracks_while_it_learns_and_goes_on_alone():
    body, wave = network(), WAVE + 0.5 * np.sin(4.0 * np.pi * np.arange(3000) / 40.0)
    training = force_train(body, wave, washout=100, forced=50)
    assert training.outputs.shape == (2850, 1)
    error = training.outputs[:, 0] - wave[150:]
    assert np.sqrt(np.mean(error**2)) < 0.02 * wave.std()
    change = training.weight_change
    assert change[-500:].mean() < 0.2 * change[:100].mean()
    run = run_closed_loop(body, training.readout, n_steps=1500, warm_up=wave[:200])
    assert np.diff(zero_crossings(run.outputs[:, 0])).mean() == pytest.approx(40.0, rel=0.02)
    assert run.outputs[-200:].max() == pytest.approx(wave.max(), rel=0.05)


def test_lessons_can_be_rarer():
    training = force_train(network(), WAVE, washout=100, forced=50, every=4)
    taught = np.flatnonzero(training.weight_change)
    assert (taught % 4 == 0).all()
    assert np.std(training.outputs[1000:, 0] - WAVE[1150:]) < 0.05


def test_the_first_lessons_are_those_of_the_forced_rows():
    """Before the loop closes, the readout is ridge regression on the forced rows."""
    body = Taps(3)
    training = force_train(body, WAVE[:60], washout=10, forced=40, readout=RLS(0.5), every=100)
    states = teacher_forced_states(body, WAVE[:50])[10:]
    x = (states - states.mean(axis=0)) / states.std(axis=0)
    expected = Ridge(0.5).fit(x[:-1], WAVE[11:50]).predict(x[-1:])
    np.testing.assert_allclose(training.outputs[0], expected, rtol=1e-9)


def test_any_estimator_that_learns_row_by_row():
    learner = SGDRegressor(alpha=1e-9, eta0=1e-2, learning_rate="constant", random_state=0)
    training = force_train(network(), WAVE, washout=100, forced=1500, readout=learner)
    assert not hasattr(learner, "coef_")
    assert np.isfinite(training.outputs).all()
    assert training.readout.weights.shape == (100, 1)


def test_two_outputs_through_one_input():
    circle = np.stack([WAVE, np.cos(2.0 * np.pi * np.arange(3000) / 40.0)], axis=1)
    feedback = Feedback(gain=[[1.0], [0.5]])
    training = force_train(network(), circle[:1500], washout=100, forced=100, feedback=feedback)
    assert np.std(training.outputs - circle[200:1500]) < 0.05


class Exploding(Taps):
    def step(self, u):
        return 1e6 * super().step(u)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"washout": -1, "forced": 10}, "washout=-1"),
        ({"washout": 0, "forced": 1}, "forced=1"),
        ({"washout": 0, "forced": 5, "every": 0}, "every=0"),
        ({"washout": 2998, "forced": 5}, "K of at least 3005"),
        ({"washout": 0, "forced": 5, "readout": Ridge()}, "Ridge cannot learn row by row"),
        ({"washout": 0, "forced": 5, "readout": RLS}, "the readout RLS cannot learn"),
    ],
)
def test_refusals(settings, words):
    with pytest.raises(TaskError, match=words):
        force_train(Taps(2), WAVE, **settings)


def test_a_loop_that_runs_away():
    noise = np.random.default_rng(0).normal(size=500)
    with pytest.raises(Diverged, match="while learning"):
        force_train(
            Exploding(1), np.exp(0.01 * np.arange(500)) * noise, washout=0, forced=20, limit=1e-3
        )
