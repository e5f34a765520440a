"""Bodies in a loop with their readout: series with a closed form, and every refusal."""

import numpy as np
import pytest
from sklearn.linear_model import LinearRegression
from sklearn.neighbors import KNeighborsRegressor
from stepped_bodies import Taps

from openprc.errors import Diverged, TaskError
from openprc.reservoir import Readout, Ridge
from openprc.reservoir.training.closed_loop import (
    Feedback,
    SteppedBody,
    fit_generator,
    run_closed_loop,
    teacher_forced_states,
)

WAVE = np.cos(0.3 * np.arange(3000))


def test_rows_have_seen_their_symbol():
    body = Taps(3)
    assert isinstance(body, SteppedBody)
    states = teacher_forced_states(body, [1.0, 2.0, 3.0, 4.0])
    np.testing.assert_array_equal(states, [[1, 0, 0], [2, 1, 0], [3, 2, 1], [4, 3, 2]])
    on = teacher_forced_states(body, [5.0], reset=False)
    np.testing.assert_array_equal(on, [[5, 4, 3]])


def test_a_delay_line_generates_a_cosine():
    """cos(w (k + 1)) = 2 cos(w) cos(w k) - cos(w (k - 1)): two taps are all it takes."""
    body = Taps(2)
    readout = fit_generator(body, WAVE[:500], LinearRegression(), washout=2, standardize=False)
    np.testing.assert_allclose(readout.weights[:, 0], [2.0 * np.cos(0.3), -1.0], atol=1e-12)
    run = run_closed_loop(body, readout, n_steps=2000, warm_up=WAVE[:100])
    assert not run.diverged
    np.testing.assert_allclose(run.outputs[:, 0], WAVE[100:2100], atol=1e-8)
    np.testing.assert_allclose(run.states[1:, 0], run.outputs[:-1, 0], atol=0)
    np.testing.assert_allclose(run.warm_up_outputs[1:, 0], WAVE[2:100], atol=1e-10)


def test_two_outputs_and_a_feedback_matrix():
    """A turning vector, folded into one input: the loop has to undo what the gain did."""
    circle = np.stack([np.cos(0.3 * np.arange(800)), np.sin(0.3 * np.arange(800))], axis=1)
    feedback = Feedback(gain=[[2.0], [0.5]], offset=7.0)
    body = Taps(4)
    readout = fit_generator(body, circle[:400], LinearRegression(), washout=4, feedback=feedback)
    run = run_closed_loop(body, readout, n_steps=300, warm_up=circle[:100], feedback=feedback)
    np.testing.assert_allclose(run.outputs, circle[100:400], atol=1e-7)
    np.testing.assert_allclose(
        run.states[1:, 0], 7.0 + circle[100:399] @ [2.0, 0.5], rtol=0, atol=1e-6
    )


def test_a_limit_saturates_the_drive():
    feedback = Feedback(gain=2.0, offset=1.0, limit=3.0)
    np.testing.assert_allclose(feedback(np.array([[1.0], [9.0], [-9.0]]))[:, 0], [3, 4, -2])


@pytest.mark.parametrize("form", ["fitted", "saved", "whole", "estimator"])
def test_every_form_of_a_readout_says_the_same(form):
    body = Taps(2)
    fitted = fit_generator(body, WAVE[:500], LinearRegression(), washout=2)
    scaling = fitted.standardizer
    forms = {
        "fitted": fitted,
        "saved": Readout(
            weights=fitted.weights,
            bias=fitted.bias,
            mean=scaling.mean,
            scale=scaling.scale,
            feature_names=("newest", "oldest"),
            attrs={},
        ),
        "whole": Readout(
            weights=None,
            bias=None,
            mean=scaling.mean,
            scale=scaling.scale,
            feature_names=("newest", "oldest"),
            attrs={},
            estimator=fitted.estimator,
        ),
        "estimator": LinearRegression().fit(
            teacher_forced_states(body, WAVE[:500])[2:-1], WAVE[3:500]
        ),
    }
    run = run_closed_loop(body, forms[form], n_steps=200, warm_up=WAVE[:50])
    np.testing.assert_allclose(run.outputs[:, 0], WAVE[50:250], atol=1e-8)


def test_a_readout_that_is_no_linear_map():
    triangle = np.tile([0.0, 1.0, 2.0, 1.0], 50)
    body = Taps(2)
    readout = fit_generator(body, triangle, KNeighborsRegressor(1), washout=2)
    assert readout.weights is None
    run = run_closed_loop(body, readout, n_steps=40, warm_up=triangle[:8])
    np.testing.assert_array_equal(run.outputs[:, 0], triangle[8:48])


def test_several_series_begin_at_the_start():
    parts = [WAVE[:200], WAVE[300:450]]
    body = Taps(2)
    both = fit_generator(body, parts, Ridge(1e-3), washout=5)
    states = np.concatenate([teacher_forced_states(body, part)[5:-1] for part in parts])
    targets = np.concatenate([part[6:] for part in parts])
    x = (states - states.mean(axis=0)) / states.std(axis=0)
    np.testing.assert_allclose(both.weights[:, 0], Ridge(1e-3).fit(x, targets).coef_, rtol=1e-8)


def test_noise_is_on_what_is_fed_in():
    body = Taps(1)
    clean = teacher_forced_states(body, WAVE)[:, 0]
    noisy = teacher_forced_states(body, WAVE, noise=0.1, seed=3)[:, 0]
    assert np.std(noisy - clean) == pytest.approx(0.1 * WAVE.std(), rel=0.05)
    np.testing.assert_array_equal(noisy, teacher_forced_states(body, WAVE, noise=0.1, seed=3)[:, 0])
    # Errors in the regressor shrink its weight by 1 / (1 + noise^2).
    wave = np.random.default_rng(0).normal(size=20_000)
    fitted = fit_generator(Taps(2), wave, LinearRegression(), washout=2, noise=0.5)
    direct = fit_generator(Taps(2), wave, LinearRegression(), washout=2)
    assert np.abs(fitted.bias - direct.bias).max() < 0.05


class Doubling(Taps):
    """A body that fails by itself once its state is large."""

    def step(self, u):
        if abs(u[0]) > 50.0:
            raise Diverged("node 3 left the range of plausible positions")
        return super().step(u)


def growing():
    return Readout(
        weights=np.array([[2.0]]),
        bias=np.zeros(1),
        mean=np.zeros(1),
        scale=np.ones(1),
        feature_names=("x",),
        attrs={},
    )


def test_the_guard_stops_a_run_that_grows():
    arguments = {"n_steps": 100, "warm_up": [-1.0, 1.0], "limit": 10.0}
    with pytest.raises(Diverged, match=r"at step 4 of 100: output 0 is 16") as failure:
        run_closed_loop(Taps(1), growing(), **arguments)
    assert "noise" in failure.value.fix
    run = run_closed_loop(Taps(1), growing(), **arguments, on_divergence="mark")
    assert run.diverged
    assert run.diverged_at == 4
    np.testing.assert_array_equal(run.outputs[:, 0], [2, 4, 8, 16])


def test_a_body_that_blows_up():
    arguments = {"n_steps": 100, "warm_up": [-1.0, 1.0], "limit": 1e9}
    with pytest.raises(Diverged, match="node 3 left the range"):
        run_closed_loop(Doubling(1), growing(), **arguments)
    run = run_closed_loop(Doubling(1), growing(), **arguments, on_divergence="mark")
    np.testing.assert_array_equal(run.outputs[:, 0], [2, 4, 8, 16, 32, 64])
    assert run.diverged_at == 6
    assert "node 3" in run.reason


class Unfitted:
    """Neither estimator nor readout."""


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: teacher_forced_states(Taps(2), np.zeros((5, 2))), r"symbols of shape \(5, 2\)"),
        (lambda: teacher_forced_states(Taps(2), [1.0, np.nan]), "NaN or infinity in row 1"),
        (lambda: teacher_forced_states(Taps(2), 3.0), r"teacher of shape \(\)"),
        (lambda: teacher_forced_states(Taps(2), WAVE, noise=-1.0), "noise of -1"),
        (lambda: fit_generator(Taps(2), WAVE[:10], Ridge(), washout=9), "K of at least 12"),
        (lambda: fit_generator(Taps(2), WAVE, Ridge(), washout=-1), "a washout of -1"),
        (lambda: run_closed_loop(Taps(1), growing(), n_steps=0, warm_up=WAVE), "0 steps"),
        (
            lambda: run_closed_loop(Taps(1), Unfitted(), n_steps=1, warm_up=WAVE),
            "a Unfitted without predict",
        ),
        (
            lambda: run_closed_loop(Taps(2), growing(), n_steps=1, warm_up=WAVE),
            "maps 1 states to 1 outputs",
        ),
        (
            lambda: run_closed_loop(Taps(1), growing(), n_steps=1, warm_up=WAVE, limit=0.0),
            "a limit of 0",
        ),
        (
            lambda: run_closed_loop(
                Taps(1), growing(), n_steps=1, warm_up=WAVE, on_divergence="ignore"
            ),
            "'raise' or 'mark'",
        ),
    ],
)
def test_refusals(call, words):
    with pytest.raises(TaskError, match=words):
        call()
