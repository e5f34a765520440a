"""What noise does to normal equations, and how much of it there is."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.vision.synth import speckle
from openprc.vision.tracking.bspline import PreparedImage
from openprc.vision.tracking.noise import estimate_noise, local_noise
from openprc.vision.tracking.templates import _NOISE_GAIN, TemplateStore, _gradients
from openprc.vision.tracking.uncertainty import GradientNoise, normal_equations

SIDE = 21


def normal_of(f, gradients, noise=0.0, gain=None):
    n = len(f)
    mean = f.mean(axis=(1, 2))
    return normal_equations(
        f - mean[:, None, None],
        mean=mean,
        smooth=gradients,
        exact=gradients,
        offset=np.full((n, 2), -10.3),
        noise=np.full(n, noise),
        gain=gain or GradientNoise(0.0, 0.0),
    )


def random_windows(n=3):
    rng = np.random.default_rng(0)
    f, gx, gy = rng.normal(0.0, 10.0, (3, n, SIDE, SIDE))
    return f, (gx, gy)


def test_the_covariance_is_that_of_least_squares_with_gain_and_offset():
    f, (gx, gy) = random_windows()
    normal = normal_of(f, (gx, gy))
    d = np.arange(SIDE) - 10.3
    for k in range(len(f)):
        dx, dy = (a.ravel() for a in np.meshgrid(d, d))
        u, v = gx[k].ravel(), gy[k].ravel()
        bent = [g * s for g in (u, v) for s in (dx * dx, dx * dy, dy * dy)]
        columns = [u, v, u * dx, u * dy, v * dx, v * dy, *bent]
        light = [np.ones(SIDE * SIDE), f[k].ravel()]
        for place, free in enumerate((2, 6, 12)):
            design = np.stack(columns[:free] + light, axis=1)
            covariance = np.linalg.inv(design.T @ design)[:free, :free]
            np.testing.assert_allclose(
                normal.variance[k, place], np.diag(covariance)[:2], rtol=1e-8
            )
            if free == 6:
                inner = np.linalg.inv(covariance[2:, 2:])
                np.testing.assert_allclose(normal.weight_a[k], inner, rtol=1e-6, atol=1e-3)
                pull = -covariance[:2, 2:] @ inner
                np.testing.assert_allclose(normal.pull_a[k], pull, rtol=1e-6, atol=1e-8)


def test_parameters_taken_off_leave_the_smaller_solution():
    f, gradients = random_windows()
    normal = normal_of(f, gradients)
    b = np.random.default_rng(1).normal(size=12)
    for k in range(len(f)):
        two, six = normal.to_translation[k] @ b[:2], normal.to_affine[k] @ b[:6]
        twelve = normal.to_quadratic[k] @ b
        np.testing.assert_allclose(six[:2] + normal.pull_a[k] @ six[2:], two, rtol=1e-7)
        np.testing.assert_allclose(twelve[:6] + normal.pull_q[k] @ twelve[6:], six, rtol=1e-6)


def test_noise_of_the_gradient_is_what_the_filters_make_of_it():
    pixels = np.random.default_rng(2).normal(size=(420, 420))
    image = PreparedImage(pixels)
    smooth, exact = _gradients(image, np.array([[10, 10]]), 400)
    squares = [(s**2).mean() for s in smooth]
    products = [(s * e).mean() for s, e in zip(smooth, exact, strict=True)]
    # 160 000 values, correlated over a few: one standard deviation is about 1 %.
    np.testing.assert_allclose(squares, _NOISE_GAIN.smooth, rtol=0.04)
    np.testing.assert_allclose(products, _NOISE_GAIN.mixed, rtol=0.04)


def test_the_gradient_of_a_plane_is_its_slope():
    y, x = np.mgrid[:60, :60].astype(float)
    smooth, exact = _gradients(PreparedImage(3.0 * x - 2.0 * y), np.array([[20, 20]]), SIDE)
    for gradient in (smooth, exact):
        np.testing.assert_allclose(gradient[0], 3.0, atol=1e-4)
        np.testing.assert_allclose(gradient[1], -2.0, atol=1e-4)


@pytest.mark.parametrize("noise", [1.0, 4.0, 10.0])
def test_noise_in_the_template_does_not_make_it_look_better(noise):
    """On average, steps and deviations are those of the template without noise."""
    y, x = np.mgrid[:200, :240].astype(float)
    clean = speckle().sample(x, y)[0]
    points = np.stack(np.meshgrid(np.arange(20.0, 225.0, 22.0), np.arange(20.0, 185.0, 22.0)), -1)
    points = points.reshape(-1, 2)
    stores = []
    for added in (0.0, np.random.default_rng(3).normal(0.0, noise, clean.shape)):
        store = TemplateStore(SIDE)
        assert (store.add(PreparedImage(clean + added), points) >= 0).all()
        stores.append(store.arrays)
    exact, noisy = stores
    n = len(points)
    ratio = np.einsum("nii->n", noisy.to_translation[:n]) / np.einsum(
        "nii->n", exact.to_translation[:n]
    )
    assert np.median(ratio) == pytest.approx(1.0, abs=0.02 + 0.006 * noise)
    # Less certain with a noisy gradient, never more.
    worse = np.median(noisy.variance[:n, 0] / exact.variance[:n, 0])
    assert 0.99 < worse < 1.0 + 0.02 * noise + 0.001 * noise**2


@pytest.mark.parametrize("noise", [0.5, 3.0, 20.0])
def test_noise_is_estimated(noise):
    pixels = np.random.default_rng(4).normal(100.0, noise, (300, 300))
    y, x = np.mgrid[:300, :300]
    assert estimate_noise(pixels + 0.7 * x - 0.2 * y) == pytest.approx(noise, rel=0.15)
    windows = pixels.reshape(10, 30, 10, 30).swapaxes(1, 2).reshape(-1, 30, 30)
    assert local_noise(windows).mean() == pytest.approx(noise, rel=0.02)


def test_noise_of_an_image_that_is_too_small():
    assert np.isnan(estimate_noise(np.zeros((10, 300))))


def test_a_part_without_values_does_not_hide_the_noise():
    pixels = np.random.default_rng(5).normal(100.0, 2.0, (150, 150))
    pixels[:40] = np.nan
    assert estimate_noise(pixels) == pytest.approx(2.0, rel=0.15)
