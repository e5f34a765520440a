"""The recorded run that is shipped with the plugin."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import runpy
from pathlib import Path

import numpy as np
import pytest
from openprc_pyelastica.importer import Importer
from openprc_pyelastica.samples import RECORDED, write_sample

from openprc.schema import validate_file

SCRIPT = Path(__file__).resolve().parents[1] / "record_sample.py"


@pytest.fixture
def sample(tmp_path):
    return write_sample(tmp_path)


@pytest.fixture
def run(sample, run_import):
    return run_import(sample.path, **sample.options)


def test_it_is_small_and_recognised(sample):
    assert RECORDED.stat().st_size < 250_000
    assert Importer().sniff(sample.path) >= 0.7


def test_frame_k_is_the_end_of_symbol_k(sample, run):
    drive = sample.inputs["u"]
    hold, step = drive["hold"], 5e-4
    assert drive["sequence"].shape == (600, 1)
    assert run.n_frames == 600
    assert run.uniform
    assert run.dt == pytest.approx(hold, rel=1e-9)
    ends = drive["start"] + hold * np.arange(1, 601)
    np.testing.assert_allclose(ends - run.time, step, rtol=1e-5)
    assert run.inputs == ()  # the symbols are attached afterwards


def test_the_symbols_are_the_drive_that_the_file_holds(sample, run_import):
    run = run_import(sample.path, input="u", input_unit="1")
    np.testing.assert_array_equal(run.input("u").value, sample.inputs["u"]["sequence"])


def test_the_body(run):
    assert run.n_nodes == 11
    positions = run.positions()
    assert run.dims == 2
    np.testing.assert_array_equal(positions[:, 0], 0.0)  # the clamp
    np.testing.assert_allclose(run.element_static("bars", "rest_length"), 0.03, rtol=1e-12)
    # Volume times density, half an element's mass at either end.
    mass = 1000 * np.pi * 0.01**2 * 0.3
    np.testing.assert_allclose(run.node("mass")[[0, 5]], [mass / 20, mass / 10], rtol=1e-9)
    # It hangs: the uppermost elements carry rho A g (L - s) and are stretched by up to 3 %.
    assert 0.02 < run.element("bars", "strain")[100:].mean(axis=0)[0] < 0.04
    assert np.ptp(positions[:, -1, 0]) > 0.05


def test_the_result_is_valid_without_a_warning(run):
    report = validate_file(run.path)
    assert [f.code for f in report.findings if f.level != "hint"] == []


def test_the_symbol_of_a_frame_has_moved_the_rod(sample, run):
    symbols = sample.inputs["u"]["sequence"][:, 0]
    middle = run.positions()[:, 5, 0]
    seen = [
        abs(np.corrcoef(symbols[100 : 600 - lag], middle[100 + lag :])[0, 1]) for lag in range(4)
    ]
    assert seen[0] > 0.8
    assert seen[0] == max(seen)
    assert abs(np.corrcoef(symbols[101:], middle[100:-1])[0, 1]) < 0.15  # not the next one


def narma2(u):
    """Return y[k+1] = 0.4 y[k] + 0.4 y[k] y[k-1] + 0.6 u[k]^3 + 0.1 after every symbol."""
    y = np.zeros(len(u) + 1)
    for k in range(1, len(u)):
        y[k + 1] = 0.4 * y[k] + 0.4 * y[k] * y[k - 1] + 0.6 * u[k] ** 3 + 0.1
    return y[1:]


def nrmse(states, target, *, washout=100, train=350, ridge=1e-8):
    fit, test = slice(washout, washout + train), slice(washout + train, None)
    mean, spread = states[fit].mean(axis=0), states[fit].std(axis=0)
    moving = spread > 1e-12
    scaled = (states[:, moving] - mean[moving]) / spread[moving]
    offset = target[fit].mean()
    gram = scaled[fit].T @ scaled[fit] + ridge * train * np.eye(moving.sum())
    weights = np.linalg.solve(gram, scaled[fit].T @ (target[fit] - offset))
    error = scaled[test] @ weights + offset - target[test]
    return np.sqrt(np.mean(error**2) / np.var(target[test]))


def test_it_is_a_reservoir(sample, run):
    symbols = sample.inputs["u"]["sequence"][:, 0]
    target = narma2(symbols)
    states = run.positions().reshape(600, -1)
    rod = nrmse(states, target)
    shifts = [np.concatenate([np.zeros(lag), symbols[: 600 - lag]]) for lag in range(20)]
    shift_register = nrmse(np.column_stack(shifts), target)
    assert rod < 0.25
    assert rod < 0.6 * shift_register
    assert nrmse(states[:, ::2], target) > 0.35  # without z there is no nonlinearity


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("elastica") is None, reason="needs pyelastica")
@pytest.mark.filterwarnings("default")  # the simulator's own warnings are not ours
def test_the_script_makes_the_first_samples_again():
    if importlib.metadata.version("pyelastica") == "0.3.3":
        pytest.skip("PyElastica 0.3.3 never calls its dampers, so that the rod swings on")
    script = runpy.run_path(str(SCRIPT))
    again = script["simulate"](script["Setting"](), n_symbols=5)
    with np.load(RECORDED) as recorded:
        assert set(recorded) == set(again)
        for key in recorded:
            expected = recorded[key] if key in ("rest_lengths", "mass") else recorded[key][:5]
            np.testing.assert_allclose(again[key], expected, rtol=1e-9, atol=1e-12)
