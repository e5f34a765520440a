"""Bodies that hold delayed copies of the input: every capacity is known."""

import numpy as np
import pytest

from openprc.analysis.capacity import information_processing_capacity, memory_capacity


def taps(u, lags):
    """Return u(t - k) for each k, the first rows being of the end of u."""
    return np.stack([np.roll(u, k) for k in lags], axis=1)


@pytest.mark.parametrize(("n", "rows"), [(10, 3000), (20, 5000), (50, 20000)])
def test_a_delay_line_holds_each_of_its_taps(n, rows):
    rng = np.random.default_rng(n)
    most = 2 * n
    u = rng.uniform(-1, 1, rows + most)
    found = memory_capacity(taps(u, range(1, n + 1)), u, max_delay=most, washout=most)
    np.testing.assert_allclose(found.raw[1 : n + 1], 1.0, atol=1e-9)
    assert found.memory_capacity == pytest.approx(n, abs=1e-6)
    assert found.linear == found.memory_capacity
    assert found.rank == n
    # What chance adds: n states over the delays that are not held, 0 and n + 1 to 2 n.
    bias = n * (most + 1 - n) / rows
    assert found.raw_total == pytest.approx(n + bias, abs=4 * np.sqrt(2 * n * (n + 1)) / rows)
    assert found.corrected_total == pytest.approx(n, abs=5 * np.sqrt(2 * n * (n + 1)) / rows)


@pytest.mark.parametrize("ratio", [0.25, 1.0, 4.0])
def test_sensor_noise_divides_the_memory(ratio):
    """Taps with noise of variance ratio * var(u): C = 1 / (1 + ratio) each."""
    rng = np.random.default_rng(7)
    u = rng.uniform(-1, 1, 20100)
    states = taps(u, range(1, 11))
    states += rng.normal(size=states.shape) * np.sqrt(ratio / 3.0)
    found = memory_capacity(states, u, max_delay=30, washout=100)
    assert found.memory_capacity == pytest.approx(10 / (1 + ratio), abs=0.06)


def test_two_inputs_in_one_state():
    rng = np.random.default_rng(3)
    u = rng.uniform(-1, 1, 20010)
    found = memory_capacity(taps(u, [1, 2]).sum(axis=1)[:, None], u, max_delay=5, washout=10)
    np.testing.assert_allclose(found.raw[1:3], 0.5, atol=0.015)
    assert found.values[[0, 3, 4, 5]].max() == 0.0


def test_the_present_input_is_capacity_but_no_memory():
    rng = np.random.default_rng(4)
    u = rng.uniform(-1, 1, 3000)
    found = memory_capacity(taps(u, range(3)), u, max_delay=10, washout=10)
    assert found.linear == pytest.approx(3.0, abs=1e-9)
    assert found.memory_capacity == pytest.approx(2.0, abs=1e-9)
    assert found.sums()["mc_jaeger"] == found.memory_capacity


def test_a_product_of_two_inputs_is_one_target():
    rng = np.random.default_rng(5)
    u = rng.uniform(-1, 1, 5000)
    product = (np.roll(u, 1) * np.roll(u, 2))[:, None]
    found = information_processing_capacity(product, u, delays={1: 5, 2: 5}, washout=5)
    best = int(found.raw.argmax())
    assert found.terms.labels()[best] == "P1(u(t-1)) P1(u(t-2))"
    # The polynomial of degree 1 has the mean of the samples taken out, which is not quite 0.
    assert found.raw[best] == pytest.approx(1.0, abs=5e-3)
    assert found.n_significant == 1


def test_products_of_the_basis_itself_are_exact():
    rng = np.random.default_rng(6)
    u = rng.choice([-1.0, 1.0, 2.0], 5000)
    v = (u - u.mean()) / u.std()
    states = np.stack([np.roll(v, 1) * np.roll(v, 2), v], axis=1)
    found = information_processing_capacity(
        states, u, terms=[[(1, 1), (1, 2)], [(1, 0)], [(2, 0)]], washout=2
    )
    np.testing.assert_allclose(found.raw[:2], 1.0, atol=1e-9)
    assert found.values[2] == 0.0


def test_steps_between_delays():
    rng = np.random.default_rng(8)
    u = rng.uniform(-1, 1, 3000)
    states = taps(u, [0, 3, 6])
    found = memory_capacity(states, u, max_delay=4, delay_step=3, washout=12)
    assert found.delays.tolist() == [0, 3, 6, 9, 12]
    np.testing.assert_allclose(found.values, [1, 1, 1, 0, 0], atol=1e-9)


def test_offsets_duplicates_and_constants_do_no_harm():
    rng = np.random.default_rng(9)
    u = rng.uniform(-1, 1, 3000)
    clean = taps(u, range(8))
    found = memory_capacity(clean, u, max_delay=20, washout=20)
    spoilt = np.hstack([1e-6 * clean + 1.0, 2e-6 * clean[:, :3] + 1.0, np.full((3000, 2), 0.3)])
    other = memory_capacity(spoilt, u, max_delay=20, washout=20)
    assert found.rank == other.rank == 8
    assert (found.metadata["method"], other.metadata["method"]) == ("cholesky", "qr")
    assert other.metadata["n_constant_states"] == 2
    np.testing.assert_allclose(found.raw, other.raw, atol=1e-8)


def test_rows_with_missing_samples_are_left_out():
    rng = np.random.default_rng(10)
    u = rng.uniform(-1, 1, 2000)
    states = taps(u, range(5))
    usable = rng.uniform(size=2000) > 0.1
    states[~usable] = np.nan
    found = memory_capacity(states, u, max_delay=10, washout=10, usable=usable)
    assert found.n_rows == np.count_nonzero(usable[10:])
    assert found.linear == pytest.approx(5.0, abs=1e-9)
    # The same rows, counted by hand.
    rows = 10 + np.flatnonzero(usable[10:])
    x = states[rows] - states[rows].mean(axis=0)
    z = u[rows - 7] - u[rows - 7].mean()
    weights = np.linalg.lstsq(x, z, rcond=None)[0]
    assert found.raw[7] == pytest.approx(1 - ((z - x @ weights) ** 2).sum() / (z @ z), abs=1e-12)


def test_single_precision_is_measured():
    rng = np.random.default_rng(11)
    u = rng.uniform(-1, 1, 5000)
    states = taps(u, range(20)) + 0.3 * rng.normal(size=(5000, 20))
    budget = {"delays": {1: 40, 2: 15}, "washout": 40}
    exact = information_processing_capacity(states, u, **budget)
    single = information_processing_capacity(states, u, dtype=np.float32, **budget)
    error = np.abs(single.raw - exact.raw).max()
    assert 0 < error < 1e-5
