"""Drives: what they contain, and what they refuse."""

import numpy as np
import pytest

from openprc.demlat import SimulationSetup
from openprc.demlat.drive import Drive, smooth_step
from openprc.demlat.signals import (
    HAUSER_FREQUENCIES,
    chirp,
    from_array,
    held_symbols,
    prbs,
    pulse,
    ramp,
    sine_product,
    sum_of_sines,
    white_noise,
)
from openprc.errors import ConfigError


def rng(seed=5):
    return np.random.default_rng(seed)


def spectrum(drive):
    column = drive.values[:, 0]
    return np.fft.rfftfreq(len(column), drive.dt), np.abs(np.fft.rfft(column))


# --- noise and symbols ------------------------------------------------------------------------


def test_white_noise_has_its_deviation_and_no_memory():
    drive = white_noise(20.0, 1e-3, rng(), std=0.3)
    values = drive.values[:, 0]
    n = len(values)
    assert n == 20_001
    assert values.std() == pytest.approx(0.3, rel=0.03)
    lags = [values[:-k] @ values[k:] / (values @ values) for k in (1, 2, 10)]
    assert np.abs(lags).max() < 4 / np.sqrt(n)
    assert np.array_equal(drive.sequence, drive.values)
    assert drive.hold == drive.dt


@pytest.mark.parametrize("duration", [19.999, 20.0])
def test_band_limited_noise_stays_in_its_band_with_its_deviation(duration):
    drive = white_noise(duration, 1e-3, rng(), std=0.3, band=(20.0, 60.0))
    f, size = spectrum(drive)
    outside = (f < 20.0) | (f > 60.0)
    assert size[outside].max() < 1e-9 * size.max()
    assert drive.values.std() == pytest.approx(0.3, rel=0.05)
    assert drive.sequence is None
    assert drive.hold is None


def test_the_same_generator_state_gives_the_same_drive():
    one, two = (white_noise(1.0, 0.01, rng(3)).values for _ in range(2))
    assert np.array_equal(one, two)
    assert not np.array_equal(one, white_noise(1.0, 0.01, rng(4)).values)


@pytest.mark.parametrize(
    ("kind", "mean", "std"), [("uniform", 2.0, 6 / 12**0.5), ("binary", 2.0, 3.0),
                              ("gaussian", 2.0, 3.0)],
)  # fmt: skip
def test_symbols_have_their_distribution(kind, mean, std):
    drive = held_symbols(20_000, 0.1, rng(), kind=kind, low=-1.0, high=5.0)
    assert drive.sequence.mean() == pytest.approx(mean, abs=0.08)
    assert drive.sequence.std() == pytest.approx(std, rel=0.03)
    assert (drive.interpolation, drive.dt, drive.hold) == ("hold", 0.1, 0.1)
    assert np.array_equal(drive.sequence, drive.values)
    assert drive.duration == pytest.approx(2000.0)
    if kind == "binary":
        assert set(drive.values.ravel().tolist()) == {-1.0, 5.0}


def test_symbols_with_a_rise_begin_at_zero_and_arrive():
    drive = held_symbols(50, 0.2, rng(), rise=0.1, dt=0.01)
    values = drive.values[:, 0]
    assert values[0] == 0.0
    assert np.allclose(values[10:-1].reshape(-1)[::20], drive.sequence[:, 0], atol=1e-15)
    # Halfway through its rise a symbol is halfway between its neighbours.
    middle = 0.5 * (drive.sequence[:-1, 0] + drive.sequence[1:, 0])
    assert np.allclose(values[25::20], middle, atol=1e-15)
    assert np.abs(np.diff(values)).max() < 2.0 * 1.875 * 0.01 / 0.1 + 1e-12
    assert drive.duration == pytest.approx(10.0)
    assert drive.hold == 0.2


@pytest.mark.parametrize("order", [2, 3, 5, 8, 11])
def test_a_prbs_has_its_period_balance_and_autocorrelation(order):
    drive = prbs(order, 0.5, periods=2)
    period = 2**order - 1
    bits = drive.values[:, 0]
    assert len(bits) == 2 * period
    assert np.array_equal(bits[:period], bits[period:])
    one = bits[:period]
    assert one.sum() == 1.0
    spectrum_ = np.fft.rfft(one)
    correlation = np.fft.irfft(spectrum_ * spectrum_.conj(), period) / period
    assert correlation[0] == pytest.approx(1.0)
    assert np.allclose(correlation[1:], -1.0 / period, atol=1e-12)


def test_a_prbs_takes_its_levels():
    assert set(prbs(4, 0.1, low=0.0, high=0.5).values.ravel().tolist()) == {0.0, 0.5}


# --- sines, chirps, pulses --------------------------------------------------------------------


def test_a_sum_of_sines_is_what_it_says():
    drive = sum_of_sines(2.0, 1e-2, [1.0, 3.5], amplitudes=[0.5, 2.0], phases=[0.0, 0.7])
    t = np.arange(201) * 1e-2
    wanted = 0.5 * np.sin(2 * np.pi * t) + 2.0 * np.sin(2 * np.pi * 3.5 * t + 0.7)
    assert np.allclose(drive.values[:, 0], wanted, atol=1e-14)
    assert np.allclose(drive.times, t)


def test_the_product_of_sines_has_the_four_combined_frequencies():
    f1, f2, f3 = HAUSER_FREQUENCIES
    drive = sine_product(100.0, 0.01, amplitude=0.2)
    t = drive.times
    combined = [f1 + f2 - f3, f1 - f2 + f3, -f1 + f2 + f3, f1 + f2 + f3]
    signs = [1, 1, 1, -1]
    wanted = 0.05 * sum(s * np.sin(2 * np.pi * f * t) for s, f in zip(signs, combined, strict=True))
    assert np.allclose(drive.values[:, 0], wanted, atol=1e-13)
    assert abs(drive.values[1, 0]) < 0.2 * (2 * np.pi * 0.01) ** 3 * f1 * f2 * f3


@pytest.mark.parametrize("kind", ["linear", "logarithmic"])
def test_a_chirp_runs_through_its_frequencies(kind):
    duration, start, end = 4.0, 2.0, 20.0
    drive = chirp(duration, 1e-3, start=start, end=end, kind=kind, amplitude=0.5)
    t = drive.times
    if kind == "linear":
        phase = start * t + (end - start) * t**2 / (2 * duration)
    else:
        growth = end / start
        phase = start * duration / np.log(growth) * (growth ** (t / duration) - 1)
    assert np.allclose(drive.values[:, 0], 0.5 * np.sin(2 * np.pi * phase), atol=1e-10)


def test_ramp_and_pulse_begin_and_end_at_rest():
    up = ramp(2.0, 0.01, to=3.0, rise=1.0, start=0.5).values[:, 0]
    assert np.array_equal(up[:51], np.zeros(51))
    assert np.allclose(up[150:], 3.0, atol=1e-14)
    assert up[100] == pytest.approx(1.5)
    bump = pulse(2.0, 0.01, height=2.0, width=0.5, start=1.0).values[:, 0]
    assert bump.max() == pytest.approx(2.0)
    assert bump.argmax() == 125
    assert np.allclose(bump[:101], 0.0)
    assert np.allclose(bump[150:], 0.0, atol=1e-15)
    assert bump.sum() * 0.01 == pytest.approx(0.5)


def test_the_smooth_step_has_no_slope_and_curvature_at_its_ends():
    h = 1e-4
    assert smooth_step(np.array([-1.0, 0.0, 0.5, 1.0, 2.0])).tolist() == [0.0, 0.0, 0.5, 1.0, 1.0]
    assert smooth_step(np.array([h]))[0] == pytest.approx(10 * h**3, rel=1e-3)
    assert 1.0 - smooth_step(np.array([1 - h]))[0] == pytest.approx(10 * h**3, rel=1e-3)


# --- the record -------------------------------------------------------------------------------


def test_a_ramp_in_begins_at_rest_and_ends_unchanged():
    drive = sum_of_sines(2.0, 1e-3, [5.0], phases=[1.0])
    soft = drive.ramped(0.5)
    assert soft.values[0, 0] == 0.0
    assert np.array_equal(soft.values[500:], drive.values[500:])
    assert drive.values[0, 0] == pytest.approx(np.sin(1.0))


def test_a_drive_in_space_begins_where_the_node_is():
    drive = from_array([0.0, 0.5, 1.0], 0.1).scaled(2.0).along([0, 0, 3.0], start=[1.0, 2.0, 3.0])
    assert drive.values.tolist() == [[1, 2, 3], [1, 2, 6], [1, 2, 9]]


def test_own_samples_and_own_symbols():
    samples = from_array([[1.0, 2.0, 3.0]] * 4, 0.1, interpolation="cubic")
    assert samples.values.shape == (4, 3)
    assert samples.sequence is None
    assert samples.duration == pytest.approx(0.3)
    symbols = from_array([1.0, -1.0], 0.1, symbols=True)
    assert symbols.sequence.tolist() == [[1.0], [-1.0]]
    assert symbols.interpolation == "hold"
    assert symbols.duration == pytest.approx(0.2)
    soft = from_array([1.0, -1.0], 0.1, symbols=True, rise=0.05, sample_dt=0.01)
    assert len(soft.values) == 21


def test_a_drive_is_added_to_a_setup(tmp_path):
    setup = SimulationSetup(tmp_path, overwrite=True)
    node = setup.add_node([0, 0, 0])
    drive = held_symbols(5, 0.1, rng())
    setup.add_actuator(node, drive.add_to(setup, "u", unit="N"), type="force")
    setup.set_simulation_params(duration=0.5, dt=0.01, save_interval=0.1)
    signal = setup.experiment().signals["u"]
    assert np.array_equal(signal.values, drive.values)
    assert (signal.dt, signal.interpolation, signal.unit) == (0.1, "hold", "N")


def test_a_drive_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        from_array([1.0], 0.1).values[0] = 2.0


# --- refusals ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: sum_of_sines(1.0, 1e-3, [10.0, 500.0]),
         r"frequencies: a frequency of 500 Hz in samples 0.001 s apart(.|\n)*less than 500 Hz"
         r"(.|\n)*dt below 0.001 s"),
        (lambda: sine_product(1.0, 0.1), "a frequency of 10.17 Hz"),
        (lambda: chirp(1.0, 0.01, start=1.0, end=60.0), "a frequency of 60 Hz"),
        (lambda: chirp(1.0, 0.01, start=0.0, end=6.0, kind="logarithmic"), "frequencies above 0"),
        (lambda: chirp(1.0, 0.01, start=0.0, end=6.0, kind="square"), "chirp of the kind 'square'"),
        (lambda: white_noise(1.0, 0.01, rng(), band=(1.0, 60.0)), "band: a frequency of 60 Hz"),
        (lambda: white_noise(1.0, 0.01, rng(), band=(5.0, 1.0)), r"the band \(5.0, 1.0\)"),
        (lambda: white_noise(1.0, 0.01, rng(), band=(1.1, 1.2)), "no line of the spectrum"),
        (lambda: white_noise(1.0, 0.03, rng()), "a duration of 1 s, sampled every 0.03 s"),
        (lambda: white_noise(1.0, 0.0, rng()), "dt: found 0.0"),
        (lambda: white_noise(1.0, 1e-9, rng()), "1000000000 samples"),
        (lambda: white_noise(1.0, 0.01, rng(), std=-1.0), "std: found -1.0"),
        (lambda: sum_of_sines(1.0, 0.01, [-1.0]), "0 Hz or more"),
        (lambda: sum_of_sines(1.0, 0.01, [1.0, 2.0], phases=[1, 2, 3]), "2 frequencies"),
        (lambda: held_symbols(0, 0.1, rng()), "n_symbols: found 0"),
        (lambda: held_symbols(5, 0.1, rng(), kind="ternary"), "symbols of the kind 'ternary'"),
        (lambda: held_symbols(5, 0.1, rng(), low=1.0, high=1.0), "low < high"),
        (lambda: held_symbols(5, 0.1, rng(), dt=0.01), "dt without rise"),
        (lambda: held_symbols(5, 0.1, rng(), rise=0.2, dt=0.01), "a rise of 0.2 s in symbols"),
        (lambda: held_symbols(5, 0.1, rng(), rise=0.05, dt=0.03), "hold a multiple of dt"),
        (lambda: prbs(25, 0.1), "order 25"),
        (lambda: prbs(24, 0.1, periods=10), "10 periods of 16777215 symbols"),
        (lambda: prbs(3, 0.1, low=2.0), "low 2.0, high 1.0"),
        (lambda: pulse(1.0, 0.01, height=1.0, width=0.02), "at least four samples"),
        (lambda: from_array([], 0.1), r"values: shape \(0,\)"),
        (lambda: from_array([[1, 2]], 0.1), r"shape \(1, 2\)"),
        (lambda: from_array([[1], [2, 3]], 0.1), "no table of numbers"),
        (lambda: from_array([0.0, np.nan], 0.1), "NaN or infinity at sample 1"),
        (lambda: from_array([1.0], 0.1, interpolation="spline"), "interpolation 'spline'"),
        (lambda: from_array([1.0], 0.1, rise=0.05), "a rise time for samples"),
        (lambda: from_array([1.0], 0.1, symbols=True, interpolation="cubic"), "symbols with"),
        (lambda: Drive(values=[1.0], dt=0.1, hold=0.1), "hold without a sequence"),
        (lambda: held_symbols(5, 0.1, rng()).ramped(0.1), "a ramp on a held drive"),
        (lambda: from_array([1.0, 2.0], 0.1).ramped(0.2), "a ramp of 0.2 s in a drive of 0.1 s"),
        (lambda: from_array([[1, 2, 3]], 0.1).along([1, 0, 0]), "drive of 3 column"),
    ],
)  # fmt: skip
def test_what_cannot_be_made_is_refused(make, words):
    with pytest.raises(ConfigError, match=words):
        make()
