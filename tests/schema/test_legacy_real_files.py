"""The legacy importer on files that users of the older packages have."""

from __future__ import annotations

import hashlib
from pathlib import Path

import h5py
import numpy as np
import pytest

from openprc.errors import NotATrajectory
from openprc.schema import Provenance, Trajectory, TrajectoryWriter
from openprc.schema.legacy import LegacyImporter

DATA = Path(__file__).resolve().parents[2] / "../shared/data/upstream"
pytestmark = pytest.mark.skipif(not DATA.exists(), reason="recorded files are not here")


def convert(path, out, **options):
    with TrajectoryWriter(out, provenance=Provenance("legacy"), on_failure="discard") as writer:
        LegacyImporter().import_run(path, writer, options={"unit": None, **options})
    return out


def tree_digest(folder):
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        digest.update(str(path.relative_to(folder)).encode())
        digest.update(path.read_bytes() if path.is_file() else b"")
    return digest.hexdigest()


@pytest.fixture(scope="module")
def lattice(tmp_path_factory):
    source = DATA / "lattice_4x4_gen0"
    before = tree_digest(source)
    out = convert(source, tmp_path_factory.mktemp("lattice") / "run.h5")
    assert tree_digest(source) == before
    return out


def test_positions_velocities_and_energies_are_those_of_the_file(lattice):
    source = DATA / "lattice_4x4_gen0/output/simulation.h5"
    with Trajectory(lattice) as run, h5py.File(source) as old:
        assert (run.n_frames, run.n_nodes, run.dims) == (3001, 16, 3)
        np.testing.assert_array_equal(run.positions(), old["time_series/nodes/positions"][()])
        np.testing.assert_array_equal(run.velocities(), old["time_series/nodes/velocities"][()])
        assert run.position_unit == "m"
        for name in ("kinetic_energy", "potential_energy"):
            np.testing.assert_array_equal(run.system(name), old[f"time_series/system/{name}"][:, 0])


def test_single_precision_clock_becomes_exact(lattice):
    with Trajectory(lattice) as run:
        np.testing.assert_array_equal(run.time, np.arange(3001) * 0.01)
        assert run.dt == 0.01
        assert any("rebuilt as 0 + i * 0.01 s" in note for note in run.provenance["notes"])


def test_topology_comes_from_the_sibling(lattice):
    with Trajectory(lattice) as run, h5py.File(DATA / "lattice_4x4_gen0/input/geometry.h5") as old:
        np.testing.assert_array_equal(run.indices("bars"), old["elements/bars/indices"][()])
        np.testing.assert_array_equal(run.node("rest"), old["nodes/positions"][()])
        np.testing.assert_array_equal(run.node("mass"), old["nodes/masses"][()])
        assert not run.node("fixed").any()
        for name in ("rest_length", "stiffness", "damping", "prestress"):
            np.testing.assert_array_equal(
                run.element_static("bars", name), old[f"elements/bars/{name}"][()]
            )
        names = {entry["name"]: entry["role"] for entry in run.provenance["inputs"]}
        assert names == {
            "simulation.h5": "trajectory",
            "geometry.h5": "geometry",
            "config.json": "settings",
        }


def test_bar_series_agree_with_the_stored_ones(lattice):
    source = DATA / "lattice_4x4_gen0/output/simulation.h5"
    with Trajectory(lattice) as run, h5py.File(source) as old:
        stored = old["time_series/elements/bars"]
        np.testing.assert_allclose(run.element("bars", "length"), stored["lengths"], atol=2e-8)
        np.testing.assert_allclose(run.element("bars", "strain"), stored["strain"], atol=5e-7)
        assert run.element_series("bars") == ("length", "strain")


def test_drive_is_what_the_driven_nodes_did(lattice):
    with Trajectory(lattice) as run:
        assert run.inputs == tuple(f"sig_actuator_{i}" for i in range(4))
        rest, places = run.node("rest"), run.positions()
        for name, node in zip(run.inputs, (0, 3, 12, 15), strict=True):
            drive = run.input(name)
            assert drive.targets == (f"node {node}",)
            assert (drive.quantity, drive.unit) == ("displacement", "m")
            error = np.abs(places[:, node] - rest[node] - drive.value)
            assert error[:-1].max() < 2e-8
            # That program extrapolated the drive to a frame after its last sample.
            assert 4e-4 < error[-1].max() < 6e-4
        notes = " ".join(run.provenance["notes"])
        assert "extrapolated the drive" in notes
        assert "one integration step (0.001 s) early" in notes


def test_drive_from_the_signals_agrees_with_the_stored_one(tmp_path, lattice):
    source = DATA / "lattice_4x4_gen0"
    folder = tmp_path / "experiment"
    (folder / "output").mkdir(parents=True)
    (folder / "input").mkdir()
    for name in ("config.json", "geometry.h5", "signals.h5"):
        (folder / "input" / name).write_bytes((source / "input" / name).read_bytes())
    run_file = folder / "output/simulation.h5"
    run_file.write_bytes((source / "output/simulation.h5").read_bytes())
    with h5py.File(run_file, "r+") as file:
        del file["time_series/actuation_signals"]  # as the newer engine writes it
    out = convert(run_file, tmp_path / "run.h5")
    with Trajectory(out) as run, Trajectory(lattice) as stored:
        assert run.inputs == stored.inputs
        for name, node in zip(run.inputs, (0, 3, 12, 15), strict=True):
            ours, theirs = run.input(name), stored.input(name)
            assert (ours.quantity, ours.unit) == ("position", "m")
            displacement = ours.value - stored.node("rest")[node]
            np.testing.assert_allclose(displacement[:-1], theirs.value[:-1], atol=2e-8)
            # The last frame keeps the last sample, which is what the body was given.
            np.testing.assert_allclose(ours.value, run.positions()[:, node], atol=6e-7)
        notes = " ".join(run.provenance["notes"])
        assert "linear interpolation" in notes
        assert "the last sample stays" in notes
        roles = {entry["role"] for entry in run.provenance["inputs"]}
        assert roles == {"geometry", "settings", "signals"}


def test_run_without_its_folder_has_no_topology(tmp_path):
    copy = tmp_path / "alone.h5"
    copy.write_bytes((DATA / "lattice_3x3_gen0/output/simulation.h5").read_bytes())
    with Trajectory(convert(copy, tmp_path / "run.h5")) as run:
        assert run.element_kinds == ()
        assert run.channels == ("bar_length", "bar_strain")
        assert run.channel("bar_length").shape == (3001, 12)
        assert run.inputs == tuple(f"actuation_{node}" for node in (0, 2, 6, 8))
        assert not run.has("/topology/nodes/rest")
        assert any("no topology" in note for note in run.provenance["notes"])


def test_laboratory_recording(tmp_path):
    with (
        Trajectory(convert(DATA / "lab/experiment.h5", tmp_path / "lab.h5")) as run,
        h5py.File(DATA / "lab/experiment.h5") as old,
    ):
        assert (run.n_frames, run.n_nodes, run.dims) == (899, 16, 2)
        assert run.position_unit == "px"
        np.testing.assert_array_equal(run.positions(), old["time_series/nodes/positions"][..., :2])
        assert run.uniform
        assert run.dt == pytest.approx(1001 / 30000, rel=1e-12)
        np.testing.assert_array_equal(
            run.channel("bar_length"), old["time_series/elements/bars/lengths"]
        )
        drive = run.input()
        assert (drive.name, drive.unit, drive.targets) == ("actuation_0", "px", ("node 0",))
        np.testing.assert_array_equal(drive.value, old["time_series/actuation_signals/0"])
        # The drive was measured as the motion of node 0: whoever reads node 0 reads the input.
        assert np.ptp(drive.value[:, 0] + run.positions()[:, 0, 0]) < 1e-9
        assert any("minus the x of node 0" in note for note in run.provenance["notes"])


def test_whole_recording_starts_at_zero(tmp_path):
    with (
        Trajectory(convert(DATA / "lab/tracking_data.h5", tmp_path / "all.h5")) as run,
        h5py.File(DATA / "lab/tracking_data.h5") as old,
    ):
        assert (run.n_frames, run.dims) == (6645, 2)
        assert run.time[0] == 0.0
        np.testing.assert_allclose(run.time, old["time"][()] - old["time"][0], atol=2.4e-7)
        assert run.uniform
        np.testing.assert_array_equal(run.positions(), old["trajectories"][..., :2])
        assert any("1773931716.0 s" in note for note in run.provenance["notes"])
        assert run.inputs == ()


@pytest.mark.parametrize(
    ("name", "words", "advice"),
    [
        ("yoshimura", "holds inputs and no finished run", "openprc run"),
        ("yoshimura/input/geometry.h5", "the geometry of an experiment", "openprc run"),
        ("yoshimura/input/signals.h5", "the signals file", "openprc run"),
        ("yoshimura/input/config.json", "the settings file", "openprc run"),
        ("yoshimura/input/visualization.h5", "faces for display", "openprc run"),
        ("lattice_3x3_gen0/readout/readout_narma2.h5", "a trained readout", "openprc info"),
        ("metrics_ga.h5", "benchmark results", "openprc info"),
    ],
)
def test_other_files_are_known_and_refused(name, words, advice, tmp_path):
    assert LegacyImporter().sniff(DATA / name) >= 0.5
    out = tmp_path / "run.h5"
    with pytest.raises(NotATrajectory, match=words) as caught:
        convert(DATA / name, out)
    assert advice in caught.value.fix
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "sureness"),
    [
        ("lattice_4x4_gen0", 1.0),
        ("lattice_4x4_gen0/output/simulation.h5", 1.0),
        ("lab/experiment.h5", 0.7),
        ("lab/tracking_data.h5", 0.7),
        ("README.md", 0.0),
    ],
)
def test_sureness(name, sureness):
    assert LegacyImporter().sniff(DATA / name) == sureness
