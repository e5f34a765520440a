"""Rollouts that JAX differentiates: closed forms, then differences."""

import numpy as np
import pytest
from backend_scenes import scene_of_every_law, scene_of_linear_laws
from scipy.interpolate import CubicSpline

from openprc.demlat.backends import jax_rollout
from openprc.errors import ConfigError, MissingDependency, UnsupportedScene

jax = pytest.importorskip("jax", reason="JAX is not installed")


def test_the_slope_of_an_oscillation_with_respect_to_stiffness(body):
    # x = 1 + a cos(w t), so dx/dk = -a t sin(w t) dw/dk with dw/dk = w / (2 k).
    k, m, a, t = 4.0, 0.5, 1e-3, 0.7
    scene = body(
        [[0, 0, 0], [1 + a, 0, 0]],
        [1.0, m],
        bars=[(0, 1, k, 1.0, 0.0)],
        fixed=[True, False],
        duration=t,
        dt=2e-3,
        save_interval=t / 2,
    )
    rollout, parameters = jax_rollout(scene)

    def last(stiffness):
        bars = parameters["bars"] | {"stiffness": stiffness}
        return rollout(parameters | {"bars": bars}).positions[-1, 1, 0]

    with jax.enable_x64(True):
        place, slope = jax.jit(jax.value_and_grad(last))(parameters["bars"]["stiffness"])
    w = np.sqrt(k / m)
    assert float(place) == pytest.approx(1 + a * np.cos(w * t), abs=1e-12)
    assert float(slope[0]) == pytest.approx(-a * t * np.sin(w * t) * w / (2 * k), rel=1e-8)


@pytest.mark.slow
def test_all_gradients_against_differences():
    rollout, parameters = jax_rollout(scene_of_linear_laws(duration=0.06))
    rng = np.random.default_rng(1)
    weights = rng.normal(size=(2, 4, 5, 3))

    def score(p):
        return sum((w * frames).sum() for w, frames in zip(weights, rollout(p), strict=True))

    with jax.enable_x64(True):
        gradient = jax.jit(jax.grad(score))(parameters)
        compiled = jax.jit(score)
        slopes = dict(jax.tree_util.tree_flatten_with_path(gradient)[0])
        for path, leaf in jax.tree_util.tree_flatten_with_path(parameters)[0]:
            way = rng.normal(size=np.shape(leaf))

            def at(step, path=path, way=way):
                return compiled(
                    jax.tree_util.tree_map_with_path(
                        lambda p, value: value + step * way if p == path else value, parameters
                    )
                )

            difference = float(at(1e-5) - at(-1e-5)) / 2e-5
            assert float((slopes[path] * way).sum()) == pytest.approx(
                difference, rel=1e-6, abs=1e-9
            ), path


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 12])
def test_splines_through_any_number_of_samples(n):
    from openprc.demlat.backends.jax_signals import Track, polynomials

    values = np.random.default_rng(n).normal(size=(n, 2))
    with jax.enable_x64(True):
        rows = np.asarray(polynomials(Track("u", 0.1, "cubic", False, 0), values))
    expected = np.zeros((n, 4, 2))
    expected[:, 0] = values
    if n > 1:
        expected[:-1] = CubicSpline(np.arange(n), values).c[::-1].transpose(1, 0, 2)
    np.testing.assert_allclose(rows, expected, atol=1e-13)


def test_a_rollout_is_in_float64_or_not_at_all():
    rollout, parameters = jax_rollout(scene_of_linear_laws())
    with pytest.raises(ConfigError, match="rollout in float32, which is what JAX computes in"):
        rollout(parameters)


def test_a_rollout_of_what_jax_does_not_do_is_refused():
    with pytest.raises(UnsupportedScene, match="demlat with JAX cannot model it: the integrator"):
        jax_rollout(scene_of_every_law(integrator="verlet"))


def test_a_rollout_without_jax_says_what_to_install(monkeypatch):
    monkeypatch.setattr("openprc.demlat.backends.devices.find_spec", lambda name: None)
    with pytest.raises(MissingDependency, match="jax is not installed") as caught:
        jax_rollout(scene_of_linear_laws())
    assert "pip install 'openprc[jax]'" in caught.value.fix
