"""Blocks of any size give what the whole in memory gives; traces and real files."""

from pathlib import Path

import numpy as np
import pytest
from compared_files import REST, compared, motion, rms, rotation, write

from openprc.compare.deviations.example_traces import POINTS
from openprc.hooks.importing import import_file

DATA = Path(__file__).resolve().parents[2] / "../shared/data"
SEEN = np.random.default_rng(7).choice([0, 1, 2], p=[0.1, 0.85, 0.05], size=(901, 6))


def figures(pair):
    """Return every number of a comparison, in one array."""
    errors = pair.errors
    parts = [
        [errors.rms, errors.largest, errors.displacement, errors.largest_frame_rms],
        [errors.largest_node, errors.largest_sample, errors.n_compared],
        errors.node_rms, errors.node_max, errors.rms_over_time, errors.max_over_time,
        errors.displacement_over_time,
    ]  # fmt: skip
    if pair.transform is not None:
        parts += [pair.transform.rotation.ravel(), pair.transform.shift]
    if pair.spectra is not None:
        parts += [pair.spectra.reference, pair.spectra.other, pair.spectra.coherence]
    parts += [item for e in pair.elements for item in ([e.rms, e.largest],)]
    parts += [a.ravel() for trace in pair.traces for a in (trace.reference, trace.other)]
    return np.concatenate([np.asarray(part, dtype="f8") for part in parts])


@pytest.mark.parametrize("case", ["same clock", "gaps", "finer", "uneven", "planar"])
def test_the_size_of_blocks_changes_nothing(tmp_path, case):
    t = 0.01 * np.arange(901)
    x, v = motion(t)
    noise = 1e-3 * np.sin(40.0 * t)[:, None, None]
    reference = write(tmp_path / "a.h5", t, x, velocities=v, bars=[[0, 1], [2, 5]])
    settings = {"rigid_motion": "all", "elements": True, "velocities": True, "match": "index"}
    if case == "same clock":
        other = write(tmp_path / "b.h5", t, x @ rotation() + noise, velocities=v)
    elif case == "gaps":
        other = write(tmp_path / "b.h5", t, x + noise, seen=SEEN.astype("u1"))
        settings["spectra"] = False
    elif case == "finer":
        s = 0.001 + 0.0031 * np.arange(2800)
        other = write(tmp_path / "b.h5", s, motion(s)[0] + 1e-3, velocities=motion(s)[1])
    elif case == "uneven":
        s = np.cumsum(np.random.default_rng(1).uniform(0.001, 0.03, size=500))
        other = write(tmp_path / "b.h5", s, motion(s)[0] + 1e-3)
    else:
        other = write(tmp_path / "b.h5", t, x[..., 1:] + noise, axes="y,z")
    whole = figures(compared(reference, other, block_bytes=1 << 30, **settings))
    for block in (1, 1000, 30_000):
        part = figures(compared(reference, other, block_bytes=block, **settings))
        np.testing.assert_allclose(part, whole, rtol=1e-12, atol=1e-14)


def test_streamed_norms_are_those_of_arrays_in_memory(tmp_path):
    t = 0.01 * np.arange(901)
    x = motion(t)[0]
    y = (x + 1e-3 * np.cos(9 * t)[:, None, None]) @ rotation()
    files = write(tmp_path / "a.h5", t, x), write(tmp_path / "b.h5", t, y)
    pair = compared(*files, rigid_motion="all", match="index", block_bytes=5000)
    # Kabsch's rotation from all points at once.
    a, b = x.reshape(-1, 3), y.reshape(-1, 3)
    u, _, vt = np.linalg.svd((a - a.mean(0)).T @ (b - b.mean(0)))
    turn = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    apart = x - ((y - b.mean(0)) @ turn.T + a.mean(0))
    np.testing.assert_allclose(pair.rms, rms(apart), rtol=1e-12)
    np.testing.assert_allclose(pair.node_rms, np.sqrt((apart**2).sum(2).mean(0)), rtol=1e-12)


def test_long_runs_have_an_overview_and_a_detail(tmp_path):
    t = 0.001 * np.arange(5000)
    x = motion(t)[0]
    y = x.copy()
    y[4100, 3] += 0.5
    files = write(tmp_path / "a.h5", t, x), write(tmp_path / "b.h5", t, y)
    pair = compared(*files)
    assert pair.largest_at == ("3", t[4100])
    whole, detail = pair.traces
    assert (whole.kind, whole.every, detail.kind, detail.every) == ("whole", 3, "detail", 1)
    assert len(whole.times) <= POINTS
    assert len(detail.times) == POINTS
    k = int(np.argmin(abs(detail.times - t[4100])))
    np.testing.assert_allclose(detail.other[k] - detail.reference[k], 0.5)
    np.testing.assert_allclose(whole.reference, x[::3, 3] - x[0, 3])
    assert len(pair.times) <= 2000


def test_an_overview_that_does_not_fit_is_read_again(tmp_path, monkeypatch):
    from openprc.compare.deviations import example_traces

    t = 0.001 * np.arange(2500)
    files = [write(tmp_path / f"{k}.h5", t, motion(t)[0] + 1e-3 * k) for k in (0, 1)]
    kept = compared(*files).traces[0]
    monkeypatch.setattr(example_traces, "HELD", 10)
    again = compared(*files).traces[0]
    np.testing.assert_array_equal(again.other, kept.other)
    np.testing.assert_array_equal(again.times, kept.times)


def test_files_in_single_precision_are_compared_in_double(tmp_path):
    t = 0.01 * np.arange(100)
    a = write(tmp_path / "a.h5", t, motion(t)[0])
    b = write(tmp_path / "b.h5", t, motion(t)[0], dtype="f4")
    pair = compared(a, b)
    assert 0 < pair.rms < np.finfo("f4").eps * np.abs(REST).max()


# --- recorded files ------------------------------------------------------------------------------


@pytest.fixture
def recorded(tmp_path):
    if not DATA.exists():
        pytest.skip("recorded files are not beside this checkout")

    def load(name):
        out = tmp_path / (name.replace("/", "_") + ".h5")
        return import_file(DATA / name, out, trust=True).path

    return load


def test_two_exports_of_one_analysis_agree(recorded):
    states = recorded("merlin/merlin2_gmiura_n5b8_disp.mat")
    meshes = recorded("merlin/gmiura_obj")
    pair = compared(states, meshes, elements=True)
    # Twelve of the states were exported as text with about nine digits.
    assert (pair.n_samples, pair.matched_by, pair.interpolant) == (12, "label", "none")
    assert pair.relative_rms < 1e-9
    assert {item.kind for item in pair.elements} == {"bars", "hinges"}
    assert compared(states, meshes, match="assignment").rms == pair.rms


def test_one_workspace_in_two_formats_is_the_same(recorded):
    pair = compared(
        recorded("merlin/merlin2_kresling_n4b5_disp.mat"),
        recorded("merlin/merlin2_kresling_n4b5_disp_octave.h5"),
    )
    assert (pair.rms, pair.drive.verdict) == (0.0, "same")


def test_an_excerpt_of_a_recording_is_found_in_it(recorded):
    whole, part = recorded("upstream/lab/tracking_data.h5"), recorded("upstream/lab/experiment.h5")
    pair = compared(whole, part, time_shift="estimate")
    assert pair.rms == 0.0
    # Frame 374 of the whole is the first of the part.
    assert pair.shift.shift == pytest.approx(374 * 0.0333666667, abs=1e-6)
    assert compared(whole, part).rms > 10.0


def test_lattices_of_two_sizes_share_nodes_by_place(recorded):
    small = recorded("upstream/lattice_3x3_gen0/output/simulation.h5")
    large = recorded("upstream/lattice_4x4_gen0/output/simulation.h5")
    pair = compared(small, large)
    assert (pair.n_nodes, pair.matched_by, len(pair.match.unmatched_other)) == (9, "assignment", 7)
    assert pair.spectra is not None
    assert {item.name for item in pair.energy.differences} >= {"kinetic_energy", "total_energy"}


def test_every_second_frame_of_a_recorded_pendulum_predicts_the_rest(recorded, tmp_path):
    from openprc.schema import Trajectory

    path = recorded("pybullet/pendulum5_chain_truth.npz")
    with Trajectory(path) as run:
        x, v, t = run.positions(), run.velocities(), run.time
    even = write(tmp_path / "even.h5", t[::2], x[::2], velocities=v[::2])
    odd = write(tmp_path / "odd.h5", t[1::2], x[1::2])
    pair = compared(odd, even, onto="reference")
    truth = compared(path, odd)
    assert truth.rms == 0.0
    assert pair.interpolated == "other"
    # The estimate of the error of interpolation is what there is.
    assert 0.5 < pair.rms / pair.interpolation.rms < 2.0
