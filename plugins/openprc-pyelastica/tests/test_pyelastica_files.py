"""Recordings of PyElastica 1.0.0, against what is known about the runs."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from openprc_pyelastica.importer import Importer

from openprc.errors import Diverged, NotATrajectory, UntrustedPickle

DATA = Path(__file__).resolve().parents[3] / "../shared/data/pyelastica"
pytestmark = pytest.mark.skipif(not DATA.exists(), reason="recorded runs are not here")

READABLE = [
    ("axial_stretching_full.npz", 761, 20, True),
    ("butterfly_data.dat", 54, 5, False),
    ("flexible_swinging_pendulum.dat", 202, 11, False),
    ("continuum_snake.dat", 443, 51, True),
    ("snake_export", 551, 51, True),
    ("timoshenko_two_rods.npz", 120, 102, True),
]


@pytest.mark.parametrize(("name", "frames", "nodes", "velocities"), READABLE)
def test_counts(run_import, name, frames, nodes, velocities):
    run = run_import(DATA / name)
    assert (run.n_frames, run.n_nodes, run.dims) == (frames, nodes, 3)
    assert run.has("/time_series/nodes/velocities") is velocities
    assert run.position_unit == "m"
    assert run.uniform
    assert run.time[0] == 0.0


@pytest.mark.parametrize("name", [entry[0] for entry in READABLE])
def test_recognised_but_never_with_certainty(name):
    assert 0.7 <= Importer().sniff(DATA / name) < 1.0


@pytest.mark.parametrize(("name", "_frames", "nodes", "_velocities"), READABLE)
def test_bars_follow_from_the_positions(run_import, name, _frames, nodes, _velocities):
    run = run_import(DATA / name)
    bars = run.indices("bars")
    positions = run.positions()
    lengths = np.linalg.norm(positions[:, bars[:, 1]] - positions[:, bars[:, 0]], axis=2)
    rest = run.element_static("bars", "rest_length")
    np.testing.assert_allclose(run.element("bars", "length"), lengths, rtol=1e-14)
    np.testing.assert_allclose(run.element("bars", "strain"), lengths / rest - 1, atol=1e-14)
    n_rods = 2 if "two_rods" in name else 1
    assert len(bars) == nodes - n_rods


def test_axial_stretching_reaches_its_equilibrium(run_import, extension, notes):
    run = run_import(DATA / "axial_stretching_full.npz")
    tip = run.positions()[-1, -1]
    np.testing.assert_allclose(tip, [1.053660, 0, 0], atol=5e-7)
    # Linear elastic rod of constant volume: extension F L / (A E - F).
    assert tip[0] - 1.0 == pytest.approx(0.053663, rel=1e-4)
    np.testing.assert_allclose(run.element("bars", "strain")[-1], 0.05366, atol=1e-5)
    np.testing.assert_allclose(run.element_static("bars", "rest_length"), 1 / 19, rtol=1e-12)
    assert "stored lengths over stored dilatations" in notes(run)
    stored, unit, comment = extension(run, "rod0.lengths")
    assert unit == "m"
    assert "half a simulation step" in comment
    # Half a step old: close to what the positions say, and not the same.
    gap = np.abs(stored - run.element("bars", "length")).max()
    assert 1e-9 < gap < 1e-3


def test_sigma_is_kept_with_components_last(run_import, extension):
    run = run_import(DATA / "axial_stretching_full.npz")
    sigma, unit, _ = extension(run, "rod0.sigma")
    assert (sigma.shape, unit) == ((761, 19, 3), "1")
    # The third component is the stretch, dilatation - 1 for a rod that is not sheared.
    dilatation = extension(run, "rod0.dilatation")[0]
    np.testing.assert_allclose(sigma[:, :, 2], dilatation - 1, atol=1e-12)
    assert np.abs(sigma[:, :, :2]).max() < 1e-12


def test_butterfly_loses_its_second_sample_at_zero(run_import, notes):
    run = run_import(DATA / "butterfly_data.dat")
    with (DATA / "butterfly_data.dat").open("rb") as stream:
        raw = pickle.load(stream)
    assert "dropped 1 repeated sample(s), first at t = 0 s, identical" in notes(run)
    np.testing.assert_array_equal(run.time, raw["time"][1:])
    np.testing.assert_array_equal(run.positions(), np.array(raw["position"])[1:].transpose(0, 2, 1))
    assert run.channels == ("be", "re", "se", "te")
    np.testing.assert_array_equal(run.channel("te", unit="J")[:, 0], raw["te"][1:])


def test_pendulum_keys_that_begin_one_sample_late(run_import, extension, notes):
    run = run_import(DATA / "flexible_swinging_pendulum.dat")
    with (DATA / "flexible_swinging_pendulum.dat").open("rb") as stream:
        raw = pickle.load(stream)
    stress, unit, comment = extension(run, "rod0.internal_stress")
    assert (stress.shape, unit) == ((201, 10, 3), "N")
    assert comment.startswith("row 0 is frame 1; ")
    np.testing.assert_array_equal(stress[-1], raw["internal_stress"][-1].T)
    assert extension(run, "rod0.internal_couple")[0].shape == (201, 9, 3)
    assert "internal_couple, internal_stress: one sample fewer" in notes(run)
    # Node 0 is pinned, the rod starts along +z, gravity along -x.
    np.testing.assert_allclose(run.positions()[:, 0], 0.0, atol=1e-12)
    np.testing.assert_allclose(run.positions()[0, -1], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(run.positions()[-1, -1], [-0.13536, 0, -0.93315], atol=2e-2)


def test_pendulum_directors_are_rows_of_a_rotation(run_import, extension):
    run = run_import(DATA / "flexible_swinging_pendulum.dat")
    directors, _, comment = extension(run, "rod0.directors")
    assert directors.shape == (202, 10, 3, 3)
    assert comment == ""  # directors belong to the time of the frame
    product = directors @ directors.transpose(0, 1, 3, 2)
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(3), product.shape), atol=1e-9)
    # The third row points along the element.
    along = np.diff(run.positions(), axis=1)
    along /= np.linalg.norm(along, axis=2, keepdims=True)
    assert np.sum(along * directors[:, :, 2], axis=2).min() > 0.99


def test_snake_saved_in_two_ways_is_one_run(run_import):
    one, parts = run_import(DATA / "continuum_snake.dat"), run_import(DATA / "snake_export")
    common, first, second = np.intersect1d(
        np.round(one.time, 6), np.round(parts.time, 6), return_indices=True
    )
    assert len(common) == 3  # steps 0, 99600 and 199200
    np.testing.assert_array_equal(one.positions()[first], parts.positions()[second])
    np.testing.assert_array_equal(one.velocities()[first], parts.velocities()[second])


def test_snake_crawls(run_import):
    run = run_import(DATA / "continuum_snake.dat")
    centre = run.channel("center_of_mass", unit="m")
    assert run.channel_columns("center_of_mass") == ("x", "y", "z")
    after = run.time >= 2.0
    speed = (centre[-1, 2] - centre[after][0, 2]) / (run.time[-1] - run.time[after][0])
    assert speed == pytest.approx(0.0278, abs=2e-3)
    np.testing.assert_allclose(run.element_static("bars", "rest_length").sum(), 0.35, rtol=1e-9)


@pytest.mark.parametrize("part", ["snake_00.npz", "snake_01.npz", "snake_02.npz"])
def test_any_part_stands_for_the_whole(run_import, notes, part):
    run = run_import(DATA / "snake_export" / part)
    assert run.n_frames == 551
    assert "joined 3 parts of snake" in notes(run)
    names = {row["name"] for row in run.provenance["inputs"]}
    assert names == {f"snake_{i:02d}.npz" for i in range(3)} - {part}


def test_one_part_alone_when_asked(run_import):
    run = run_import(DATA / "snake_export" / "snake_01.npz", parts="one")
    assert run.n_frames == 187
    assert run.time[0] == pytest.approx(7.48, abs=1e-3)


def test_two_rods(run_import):
    run = run_import(DATA / "timoshenko_two_rods.npz")
    labels = list(run.node("label"))
    assert labels[0] == "shearable:0"
    assert labels[51] == "unshearable:0"
    assert labels[-1] == "unshearable:50"
    with np.load(DATA / "timoshenko_two_rods.npz") as raw:
        np.testing.assert_array_equal(
            run.positions()[:, 51:], raw["unshearable_position"].transpose(0, 2, 1)
        )
        np.testing.assert_array_equal(
            run.velocities()[:, :51], raw["shearable_velocity"].transpose(0, 2, 1)
        )
    np.testing.assert_allclose(run.positions()[0, 51] - run.positions()[0, 0], [0, -1, 0])
    bars = run.indices("bars")
    assert [50, 51] not in bars.tolist()  # no bar from one rod to the other
    np.testing.assert_allclose(run.element_static("bars", "rest_length"), 3 / 50, rtol=1e-9)


def test_one_of_two_rods(run_import):
    run = run_import(DATA / "timoshenko_two_rods.npz", rods=("unshearable",))
    assert run.n_nodes == 51
    assert run.node("label")[0] == "unshearable:0"


def test_strains_as_channels_when_asked(run_import):
    run = run_import(DATA / "timoshenko_two_rods.npz", channels=("shearable.sigma",))
    assert run.channels == ("shearable.sigma",)
    assert run.channel("shearable.sigma").shape == (120, 150)


def test_divergence_is_noticed(refuses):
    error = refuses(
        DATA / "timoshenko_unshearable_DIVERGED.npz",
        Diverged,
        r"(?s)rod0 diverged at frame 1, t = 16\.8 s: an element .* times as long",
    )
    assert "shorter time step" in error.fix
    assert "diverged=trim" in error.fix
    assert "diverged=keep" in error.fix


def test_divergence_can_be_cut_off_or_kept(run_import, notes):
    path = DATA / "timoshenko_unshearable_DIVERGED.npz"
    cut = run_import(path, diverged="trim")
    assert cut.n_frames == 1
    assert "deserve suspicion" in notes(cut)
    whole = run_import(path, diverged="keep")
    assert whole.n_frames == 30
    assert np.abs(whole.positions()).max() > 1e3
    assert "kept because diverged=keep" in notes(whole)


@pytest.mark.parametrize("trust", [True, False])
def test_a_pickled_rod_is_refused_by_name(refuses, trust):
    path = DATA / "timoshenko_shearable_rod.dat"
    assert Importer().sniff(path) == 0.9
    refuses(path, NotATrajectory, r"elastica\.rod\.cosserat_rod\.CosseratRod", trust=trust)


def test_a_scalar_position_is_refused(refuses):
    path = DATA / "axial_stretching_data.dat"
    assert Importer().sniff(path) >= 0.5
    refuses(path, NotATrajectory, "position: one number a sample")


def test_pickles_need_trust(refuses):
    refuses(DATA / "butterfly_data.dat", UntrustedPickle, "pickle", trust=False)
