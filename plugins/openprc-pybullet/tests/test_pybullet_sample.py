"""The sample: alignment of symbols and frames, size, and what it can compute."""

import subprocess
import sys

import numpy as np
import pytest
from openprc_pybullet import client, samples
from openprc_pybullet.samples import PENDULUM, pendulum_urdf, write_sample

from openprc.errors import MissingDependency

HOLD = PENDULUM.hold_steps


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    """The sample, recorded once."""
    pytest.importorskip("pybullet")
    return write_sample(tmp_path_factory.mktemp("sample"))


def test_layout(sample, pb_import):
    run = pb_import(sample.path, **sample.options)
    assert (run.n_frames, run.n_nodes, run.dims) == (600 * HOLD, 6, 3)
    assert sample.path.stat().st_size < 3e6
    assert (run.t0, run.dt) == pytest.approx((1 / 240, 1 / 240), rel=1e-14)
    drive = sample.inputs["u"]
    assert drive["sequence"].shape == (600, 1)
    # The last frame is the end of the last symbol.
    assert run.time[-1] == pytest.approx(drive["start"] + 600 * drive["hold"], abs=1e-9)
    np.testing.assert_array_equal(run.node("fixed"), [1, 0, 0, 0, 0, 0])


def rotation(axis, angle):
    """Rodrigues' rotation formula for many angles: (T, 3, 3)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sine, versine = np.sin(angle)[:, None, None], (1 - np.cos(angle))[:, None, None]
    return np.eye(3) + sine * cross + versine * (cross @ cross)


def test_links_follow_from_the_angles(sample, pb_import):
    """Centres of mass of hanging rods, computed without PyBullet."""
    run = pb_import(sample.path, **sample.options)
    q = run.channel("body0.q", unit="rad")
    frames, ends = [], []
    for i, (parent, length) in enumerate(zip(PENDULUM.parents, PENDULUM.lengths, strict=True)):
        turn = rotation(PENDULUM.axes[i], q[:, i])
        frames.append(turn if parent < 0 else frames[parent] @ turn)
        down = -frames[i][:, :, 2]
        top = 0.0 if parent < 0 else ends[parent]
        ends.append(top + length * down)
        np.testing.assert_allclose(run.positions()[:, i + 1], top + length / 2 * down, atol=1e-12)
    assert np.ptp(run.positions(), axis=0)[[3, 5]].min() > 1e-3  # these move in all directions


def test_symbols_and_frames_are_aligned(sample, pb_import):
    """The crank's acceleration jumps with the torque, between the right two frames."""
    run = pb_import(sample.path, **sample.options)
    rate = run.channel("body0.u", unit="rad/s")[:, 0]
    kick = np.diff(rate, 2)
    u = sample.inputs["u"]["sequence"][:, 0]
    jump = np.diff(u)
    # Row 24 k is the first that symbol k acts on: u[row] - 2 u[row-1] + u[row-2] holds the jump.
    by_shift = [
        abs(np.corrcoef(kick[HOLD * np.arange(1, 600) - 2 + shift], jump)[0, 1])
        for shift in (-1, 0, 1)
    ]
    assert int(np.argmax(by_shift)) == 1
    assert by_shift[1] > 0.9


def narma2(u):
    """Second-order NARMA task, Atiya and Parlos 2000, doi:10.1109/72.846741."""
    y = np.zeros(len(u) + 1)
    for k in range(1, len(u)):
        y[k + 1] = 0.4 * y[k] + 0.4 * y[k] * y[k - 1] + 0.6 * u[k] ** 3 + 0.1
    return y[1:]


def nrmse(states, target, *, washout=50, split=400):
    """Error of a linear readout, in standard deviations of the target."""
    mean, scale = states[washout:split].mean(0), states[washout:split].std(0)
    kept = scale > 1e-9
    z = np.hstack(
        [((states - mean) / np.where(kept, scale, 1))[:, kept], np.ones((len(states), 1))]
    )
    a = z[washout:split]
    weights = np.linalg.solve(
        a.T @ a + 1e-8 * len(a) * np.eye(a.shape[1]), a.T @ target[washout:split]
    )
    error = z[split:] @ weights - target[split:]
    return np.sqrt(np.mean(error**2) / np.var(target[split:]))


def test_narma2_beats_the_linear_shift_register(sample, pb_import):
    run = pb_import(sample.path, **sample.options)
    u = sample.inputs["u"]["sequence"][:, 0]
    ends = HOLD * np.arange(1, 601) - 1
    states = run.positions()[ends, 1:].reshape(600, -1)
    register = np.stack([np.roll(u, lag) for lag in range(10)], axis=1)
    body, linear = nrmse(states, narma2(u)), nrmse(register, narma2(u))
    assert body < 0.30
    assert linear > 0.39


def test_sample_is_reproducible(sample, tmp_path):
    again = write_sample(tmp_path)
    assert again.path.read_bytes() == sample.path.read_bytes()


def test_sample_needs_pybullet(tmp_path, monkeypatch):
    def absent(name):
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    monkeypatch.setattr(client, "import_module", absent)
    with pytest.raises(MissingDependency, match="recording the PyBullet sample needs PyBullet"):
        write_sample(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_the_model_is_the_one_described():
    text = pendulum_urdf(PENDULUM)
    assert text.count("<joint") == len(PENDULUM.lengths)
    assert samples.N_SYMBOLS == 600


def test_entry_module_is_light():
    code = (
        "import sys, openprc_pybullet; openprc_pybullet.openprc_producers();"
        "print(sorted({'numpy','scipy','pybullet','h5py'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
