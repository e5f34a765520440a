"""Distance correlation against closed forms and against sums over all pairs."""

import tracemalloc
from collections import namedtuple

import numpy as np
import pytest

from openprc.analysis.correlation import Nonparametric
from openprc.analysis.correlation.distance import (
    DistanceSeries,
    chi2_p_value,
    distance_correlations,
    reordered,
)

N_LARGE = 100_000
Pair = namedtuple("Pair", ["biased", "unbiased"])


def dcor(x, y):
    y = np.asarray(y, float)
    found = distance_correlations(DistanceSeries.of(np.asarray(x, float)), y[None] - y.mean())
    return Pair(found.biased[0], found.unbiased[0])


def direct(x, y):
    """dCor and the unbiased dCor^2 from matrices of all distances."""
    a, b = (np.abs(np.subtract.outer(v, v)) for v in (x, y))
    n = len(x)

    def centred(d):
        return d - d.mean(0) - d.mean(1)[:, None] + d.mean()

    def u_centred(d):
        rows = d.sum(0) / (n - 2)
        found = d - rows - rows[:, None] + d.sum() / ((n - 1) * (n - 2))
        np.fill_diagonal(found, 0.0)
        return found

    found = []
    for centre in (centred, u_centred):
        p, q = centre(a), centre(b)
        found.append(np.sum(p * q) / np.sqrt(np.sum(p * p) * np.sum(q * q)))
    return np.sqrt(found[0]), found[1]


def normal_dcor(rho):
    """Distance correlation of a bivariate normal pair; Szekely et al. 2007, theorem 7."""
    covariance = rho * np.arcsin(rho) + np.sqrt(1 - rho**2)
    covariance -= rho * np.arcsin(rho / 2) + np.sqrt(4 - rho**2) - 1
    return np.sqrt(covariance / (1 + np.pi / 3 - np.sqrt(3)))


@pytest.mark.parametrize("n", [8, 9, 16, 17, 33, 100, 500])
@pytest.mark.parametrize("kind", ["smooth", "ties", "offset", "binary", "tiny"])
def test_the_sums_over_all_pairs(n, kind):
    rng = np.random.default_rng(n)
    x = rng.normal(size=n)
    y = x**2 + rng.normal(size=n)
    if kind == "ties":
        x, y = np.round(x, 0), np.round(y, 0)
    elif kind == "offset":
        x, y = x + 1e5, y - 1e6
    elif kind == "binary":
        x = np.where(np.arange(n) % 3 == 1, -1.0, 1.0)
    elif kind == "tiny":
        x, y = 1e-200 * x, 1e150 * y
    found = dcor(x, y)
    a, b = x / np.abs(x).max(), y / np.abs(y).max()
    expected = direct(a, b)
    tolerance = 1e-8 if kind == "offset" else 1e-11
    assert found.biased == pytest.approx(expected[0], abs=tolerance)
    assert found.unbiased == pytest.approx(expected[1], abs=tolerance)


def test_long_skewed_series():
    # One far sample fills up the last run; the value is the small rest of large sums.
    rng = np.random.default_rng(2)
    x, y = rng.exponential(size=(2, 2500)) ** 3
    found, expected = dcor(x, y), direct(x, y)
    assert found.biased == pytest.approx(expected[0], abs=1e-11)
    assert found.unbiased == pytest.approx(expected[1], abs=1e-11)


@pytest.mark.parametrize(
    ("rho", "expected", "tolerance"),
    [
        (0.1, 0.089131, 0.006),
        (0.3, 0.269001, 0.005),
        (0.5, 0.454127, 0.004),
        (0.8, 0.754897, 0.002),
        (0.95, 0.930113, 0.001),
    ],
)
def test_normal_pairs(rho, expected, tolerance):
    assert normal_dcor(rho) == pytest.approx(expected, abs=1e-6)
    rng = np.random.default_rng(3)
    x, noise = rng.normal(size=(2, N_LARGE))
    found = dcor(x, rho * x + np.sqrt(1 - rho**2) * noise)
    assert found.biased == pytest.approx(expected, abs=tolerance)


@pytest.mark.parametrize(
    ("draw", "function", "expected"),
    [
        ("normal", np.square, 0.538238),
        ("uniform", np.square, 0.491450),
        ("uniform", np.abs, 0.5),
        ("uniform", lambda x: np.sin(np.pi * x), 0.860566),
    ],
    ids=["normal square", "uniform square", "uniform magnitude", "uniform sine"],
)
def test_dependence_without_correlation(draw, function, expected):
    rng = np.random.default_rng(12)
    x = rng.normal(size=N_LARGE) if draw == "normal" else rng.uniform(-1, 1, N_LARGE)
    assert dcor(x, function(x)).biased == pytest.approx(expected, abs=0.003)


def test_five_points():
    x = np.arange(1.0, 6.0)
    assert dcor(x, x**2).biased == pytest.approx(0.9869, abs=1e-4)
    assert dcor(x, [0, 1, 4, 1, 0]).biased == pytest.approx(0.5040, abs=1e-4)
    assert dcor(x, np.abs(x - 3)).biased == pytest.approx(0.5301, abs=1e-4)
    assert dcor(x, 7 - 2 * x).biased == pytest.approx(1.0, abs=1e-12)


def test_unbiased_is_centred_on_zero():
    rng = np.random.default_rng(13)
    n, runs = 200, 400
    found = [dcor(*rng.normal(size=(2, n))) for _ in range(runs)]
    unbiased = np.array([f.unbiased for f in found])
    assert abs(unbiased.mean()) < 3 * unbiased.std() / np.sqrt(runs)
    assert 1.0 / n < unbiased.std() < 1.8 / n
    # The biased one is not: 1.78/sqrt(n) is where the remark of `dcor` has it.
    assert np.mean([f.biased for f in found]) == pytest.approx(1.78 / np.sqrt(n), rel=0.1)


def test_chi_squared_limit():
    rng = np.random.default_rng(14)
    p = np.array([chi2_p_value(dcor(*rng.normal(size=(2, 200))).unbiased, 200) for _ in range(800)])
    # Nominal 5 %: three binomial standard deviations of 800 runs are 2.3 %.
    assert 0.027 < np.mean(p <= 0.05) < 0.073
    assert chi2_p_value(-1.0, 200) == 1.0


def test_other_orders_of_the_rows():
    rng = np.random.default_rng(15)
    x, y = rng.normal(size=(2, 60))
    orders = [rng.permutation(60) for _ in range(3)]
    found = reordered(DistanceSeries.of(x), y, orders)
    np.testing.assert_allclose(found, [direct(x, y[order])[0] for order in orders], atol=1e-11)


def test_memory_is_linear():
    rng = np.random.default_rng(16)
    x, y = rng.normal(size=(2, 10_000))
    dcor(x, y)  # compiles
    tracemalloc.start()
    dcor(x, y)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # One matrix of distances is 800 MB. What the compiled part takes are six more series.
    assert peak < 20 * 8 * len(x)


def test_channels_and_constant_ones():
    rng = np.random.default_rng(17)
    x = rng.uniform(-1, 1, 300)
    Y = np.stack([x**2, np.full(300, 4.0), rng.normal(size=300)], axis=1)
    found = Nonparametric(x, Y, names=["square", "clamped", "noise"])
    assert found.dropped == found.dcor.dropped == ("clamped",)
    assert np.isnan(found.dcor["clamped"])
    assert found.dcor["square"] == pytest.approx(direct(x, x**2)[0], abs=1e-11)
    assert found.dcor_unbiased["noise"] == pytest.approx(direct(x, Y[:, 2])[1], abs=1e-11)
    np.testing.assert_array_equal(found.dcor.significant(), [True, False, False])
    assert "1.78/sqrt(T) = 0.1" in str(found.dcor)


def test_a_single_spike_has_no_unbiased_value():
    spike = np.zeros(50)
    spike[7] = 1.0
    found = Nonparametric(np.arange(50.0), spike, names=["spike"])
    assert np.isnan(found.dcor_unbiased["spike"])
    assert "a single row differs: spike" in found.dcor_unbiased.notes[0]
    expected = direct(np.arange(50.0), spike)[0]
    assert found.dcor["spike"] == pytest.approx(expected, abs=1e-11)
