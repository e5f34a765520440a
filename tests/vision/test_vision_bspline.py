"""An image between its pixels is the cubic spline through them."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import ConfigError
from openprc.vision.tracking.bspline import BORDER, NOISE_LEFT, PIXEL_DERIVATIVE, PreparedImage

SIZES = [(1, 1), (3, 40), (64, 128), (61, 125), (130, 300)]


def inner(image):
    image.require_all()
    return image.coefficients[BORDER:-BORDER, BORDER:-BORDER]


@pytest.mark.parametrize("shape", SIZES[1:], ids=str)
def test_coefficients_are_those_of_scipy(shape):
    ndimage = pytest.importorskip("scipy.ndimage")
    pixels = np.random.default_rng(0).normal(0.0, 1.0, shape)
    expected = ndimage.spline_filter(pixels, 3, mode="mirror")
    assert np.abs(inner(PreparedImage(pixels)) - expected).max() < 1e-5


@pytest.mark.parametrize("shape", SIZES, ids=str)
def test_the_spline_meets_the_pixels(shape):
    pixels = np.random.default_rng(1).integers(0, 256, shape).astype(np.uint8)
    y, x = np.mgrid[: shape[0], : shape[1]]
    found = PreparedImage(pixels).at(np.stack([x.ravel(), y.ravel()], axis=1))
    np.testing.assert_allclose(found, pixels.ravel(), atol=2e-3)


def test_cubic_polynomials_come_back_exactly():
    # Far enough from the edges, where the mirrored continuation is no polynomial.
    y, x = np.mgrid[:80, :90] / 40.0 - 1.0

    def surface(x, y):
        return 3.0 + x - 2.0 * y + x * y**2 - 0.5 * x**3 + y**3 - x**2 * y**3

    image = PreparedImage(surface(x, y))
    points = np.random.default_rng(2).uniform(25.0, 55.0, (200, 2))
    exact = surface(*(points.T / 40.0 - 1.0))
    np.testing.assert_allclose(image.at(points), exact, atol=5e-6)


def test_between_the_pixels_it_is_scipys_spline_up_to_the_edge():
    ndimage = pytest.importorskip("scipy.ndimage")
    pixels = np.random.default_rng(3).normal(size=(40, 50))
    points = np.random.default_rng(4).uniform(0.0, 1.0, (300, 2)) * (49.0, 39.0)
    points[:4] = [[0.0, 0.0], [49.0, 0.0], [0.0, 39.0], [49.0, 39.0]]
    expected = ndimage.map_coordinates(pixels, points.T[::-1], order=3, mode="mirror")
    np.testing.assert_allclose(PreparedImage(pixels).at(points), expected, atol=1e-5)
    assert np.isnan(PreparedImage(pixels).at([[-0.01, 3.0], [3.0, 39.01]])).all()


def test_a_part_computed_on_demand_is_the_same_to_the_last_bit():
    pixels = np.random.default_rng(5).integers(0, 65536, (300, 400)).astype(np.uint16)
    whole, part = PreparedImage(pixels), PreparedImage(pixels)
    whole.require_all()
    part.coefficients[:] = np.nan
    part.require(np.array([[200, 220, 100, 140], [5, -1, 5, -1]]))
    there = np.isfinite(part.coefficients)
    assert there[99 + BORDER : 144 + BORDER, 199 + BORDER : 224 + BORDER].all()
    assert there.mean() < 0.6
    assert np.array_equal(part.coefficients[there], whole.coefficients[there])


def test_pixels_without_a_value_spoil_their_surroundings_only():
    pixels = np.random.default_rng(6).normal(size=(90, 90))
    hole = pixels.copy()
    hole[45, 45] = np.nan
    spoilt, whole = inner(PreparedImage(hole)), inner(PreparedImage(pixels))
    assert np.isnan(spoilt[45, 45])
    far = np.ones(pixels.shape, bool)
    far[32:59, 32:59] = False
    assert np.array_equal(spoilt[far], whole[far])


def test_what_interpolation_leaves_of_noise():
    assert NOISE_LEFT[0] == pytest.approx(1.0, abs=1e-6)
    assert np.allclose(NOISE_LEFT, NOISE_LEFT[::-1])
    noise = PreparedImage(np.random.default_rng(7).normal(size=(500, 500)))
    y, x = np.mgrid[20:480, 20:480]
    values = noise.at(np.stack([x.ravel() + 0.25, y.ravel() + 0.5], axis=1))
    # 211 600 values: one standard deviation of the variance is 0.003 of it.
    assert values.var() == pytest.approx(NOISE_LEFT[16] * NOISE_LEFT[32], rel=0.02)


def test_the_derivative_weights_are_those_of_the_spline():
    line = np.random.default_rng(8).normal(size=60)
    half = len(PIXEL_DERIVATIVE) // 2
    found = PIXEL_DERIVATIVE @ line[30 - half : 30 + half + 1]
    step = 0.02
    image = PreparedImage(np.tile(line, (60, 1)))
    low, high = image.at([[30.0 - step, 30.0], [30.0 + step, 30.0]])
    assert found == pytest.approx((high - low) / (2 * step), abs=2e-3)


@pytest.mark.parametrize(
    ("pixels", "match"),
    [
        (np.zeros((4, 4, 3)), r"shape \(4, 4, 3\)"),
        (np.zeros((0, 4)), r"shape \(0, 4\)"),
        (np.zeros((4, 4), complex), "type complex128"),
    ],
    ids=["colour", "empty", "complex"],
)
def test_what_is_no_grey_image_is_refused(pixels, match):
    with pytest.raises(ConfigError, match=match):
        PreparedImage(pixels)


def test_other_whole_numbers_are_taken():
    pixels = np.arange(16, dtype=np.int32).reshape(4, 4)
    assert PreparedImage(pixels).at([[2.0, 1.0]]) == pytest.approx(6.0, abs=1e-4)
    assert PreparedImage(pixels > 7).at([[2.0, 3.0]]) == pytest.approx(1.0, abs=1e-4)
