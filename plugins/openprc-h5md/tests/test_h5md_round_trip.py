"""What goes out as H5MD comes back, and other programs read it."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from openprc.errors import ConfigError, MissingData
from openprc.hooks import export_file, import_file
from openprc.schema import Provenance, Trajectory, TrajectoryWriter

N_FRAMES = 40


@pytest.fixture
def truth():
    rng = np.random.default_rng(5)
    return {
        "positions": rng.normal(size=(N_FRAMES, 4, 2)),
        "velocities": rng.normal(size=(N_FRAMES, 4, 2)),
        "gauge": rng.normal(size=(N_FRAMES, 2)),
        "u": rng.normal(size=(N_FRAMES, 1)),
        "energy": rng.normal(size=N_FRAMES),
    }


@pytest.fixture
def run(truth, tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_time(unit="ms")
        writer.declare_nodes(
            4, 2, unit="mm", velocities=True, mass=[1.0, 2.0, 3.0, 4.0], mass_unit="g",
            labels=["a", "b", "c", "d"], fixed=[True, False, False, True], ids=[3, 5, 7, 9],
        )  # fmt: skip
        writer.declare_elements("bars", [[0, 1], [1, 2], [2, 3]])
        writer.declare_channel("gauge", ["left", "right"], unit="mN")
        writer.declare_system("energy", unit="J")
        writer.declare_input("u", ["u"], quantity="force", unit="N")
        writer.append(
            10.0 * np.arange(N_FRAMES),
            positions=truth["positions"],
            velocities=truth["velocities"],
            channels={"gauge": truth["gauge"]},
            system={"energy": truth["energy"]},
            inputs={"u": truth["u"]},
        )
    return path


@pytest.mark.parametrize("unit", ["Angstrom", "nm", "stored"])
@pytest.mark.parametrize("stride", [1, 3])
def test_there_and_back(run, truth, tmp_path, unit, stride):
    (made,) = export_file(run, tmp_path / "run.h5md", options={"unit": unit, "stride": stride})
    import_file(made, tmp_path / "back.h5")
    with Trajectory(tmp_path / "back.h5") as back:
        np.testing.assert_allclose(back.time, 0.01 * np.arange(N_FRAMES)[::stride], rtol=1e-15)
        np.testing.assert_allclose(
            back.positions(unit="mm"), truth["positions"][::stride], rtol=1e-15
        )
        np.testing.assert_allclose(
            back.velocities(unit="mm/s"), truth["velocities"][::stride], rtol=1e-15
        )
        assert back.indices("bars").tolist() == [[0, 1], [1, 2], [2, 3]]
        assert back.node("mass").tolist() == [1.0, 2.0, 3.0, 4.0]
        assert back.node("id").tolist() == [3, 5, 7, 9]
        assert [str(name) for name in back.node("label")] == ["a", "b", "c", "d"]
        assert back.node("fixed").tolist() == [1, 0, 0, 1]
        np.testing.assert_array_equal(back.channel("gauge"), truth["gauge"][::stride])
        assert back.channel_columns("gauge") == ("left", "right")
        assert back.unit("/time_series/channels/gauge") == "mN"
        np.testing.assert_array_equal(back.channel("energy")[:, 0], truth["energy"][::stride])
        np.testing.assert_array_equal(back.input("u").value, truth["u"][::stride])


def test_missing_points_stay_missing(tmp_path):
    positions, observed = np.ones((4, 2, 3)), np.ones((4, 2), "u1")
    positions[2, 1], observed[2, 1] = np.nan, 0
    with TrajectoryWriter(tmp_path / "a.h5", provenance=Provenance("test")) as writer:
        writer.declare_nodes(2, 3, unit="px", observed=True)
        writer.append(np.arange(4.0), positions=positions, observed=observed)
    export_file(tmp_path / "a.h5", tmp_path / "a.h5md")
    import_file(tmp_path / "a.h5md", tmp_path / "b.h5")
    with Trajectory(tmp_path / "b.h5") as back:
        assert back.position_unit == "px"
        np.testing.assert_array_equal(back.positions(), positions)
        np.testing.assert_array_equal(back.observed(), observed)


def test_load_steps_are_no_seconds(tmp_path):
    with TrajectoryWriter(tmp_path / "a.h5", provenance=Provenance("test")) as writer:
        writer.declare_time(unit="1", kind="pseudo")
        writer.declare_nodes(1, 3, unit="arb")
        writer.append(np.arange(3.0), positions=np.ones((3, 1, 3)))
    export_file(tmp_path / "a.h5", tmp_path / "a.h5md")
    with h5py.File(tmp_path / "a.h5md") as file:
        assert "unit" not in file["particles/trajectory/position/time"].attrs
    import_file(tmp_path / "a.h5md", tmp_path / "b.h5")
    with Trajectory(tmp_path / "b.h5") as back:
        assert (back.time_kind, back.position_unit) == ("pseudo", "arb")


def test_mdanalysis_reads_it(run, truth, tmp_path):
    mda = pytest.importorskip("MDAnalysis", reason="MDAnalysis is not installed")
    (made,) = export_file(run, tmp_path / "run.h5md")
    universe = mda.Universe(str(made), to_guess=())
    assert len(universe.trajectory) == N_FRAMES
    assert len(universe.atoms) == 4
    for frame in (0, 17, N_FRAMES - 1):
        step = universe.trajectory[frame]
        # MDAnalysis keeps single precision, in Angstrom and ps.
        np.testing.assert_allclose(
            step.positions[:, :2] * 1e-7, truth["positions"][frame], rtol=3e-7
        )
        assert not step.positions[:, 2].any()
        np.testing.assert_allclose(
            step.velocities[:, :2] * 1e5, truth["velocities"][frame], rtol=3e-7
        )
        assert step.time == pytest.approx(0.01 * frame * 1e12)
        np.testing.assert_array_equal(step.data["channels/gauge"], truth["gauge"][frame])
    universe.trajectory.close()


@pytest.mark.parametrize(("unit", "kind"), [("arb", "pseudo"), ("px", "physical")])
def test_mdanalysis_reads_what_has_no_length_or_duration(tmp_path, unit, kind):
    """As the README says: without conversion, over a topology of so many nodes."""
    mda = pytest.importorskip("MDAnalysis", reason="MDAnalysis is not installed")
    places = np.random.default_rng(2).normal(size=(3, 4, 3)).astype("f4")
    with TrajectoryWriter(tmp_path / "a.h5", provenance=Provenance("test")) as writer:
        writer.declare_time(unit="1" if kind == "pseudo" else "s", kind=kind)
        writer.declare_nodes(4, 3, unit=unit)
        writer.append(np.arange(3.0), positions=places)
    (made,) = export_file(tmp_path / "a.h5", tmp_path / "a.h5md")
    universe = mda.Universe.empty(4, trajectory=True)
    universe.load_new(str(made), convert_units=False)
    assert len(universe.trajectory) == 3
    assert universe.trajectory[2].time == 2.0
    np.testing.assert_array_equal(universe.atoms.positions, places[2])
    universe.trajectory.close()


def test_pyh5md_reads_it(run, truth, tmp_path):
    """The authors of the format publish this reader."""
    pyh5md = pytest.importorskip("pyh5md", reason="pyh5md is not installed")
    (made,) = export_file(run, tmp_path / "run.h5md", options={"unit": "stored"})
    with pyh5md.File(str(made), "r") as file:
        particles = file.particles_group("trajectory")
        place = pyh5md.element(particles, "position")
        np.testing.assert_array_equal(place.value[:, :, :2], truth["positions"])
        np.testing.assert_allclose(place.time[()], 0.01 * np.arange(N_FRAMES), rtol=1e-15)


def test_what_cannot_be_exported(run, tmp_path):
    with pytest.raises(MissingData, match="no two-node elements named 'hinges'"):
        export_file(run, tmp_path / "a.h5md", options={"bonds": "hinges"})
    with pytest.raises(ConfigError, match="stride is 0"):
        export_file(run, tmp_path / "a.h5md", options={"stride": 0})
    with TrajectoryWriter(tmp_path / "c.h5", provenance=Provenance("test")) as writer:
        writer.declare_channel("light", ["light"], unit="arb")
        writer.append([0.0, 1.0], channels={"light": [[1.0], [2.0]]})
    with pytest.raises(MissingData, match="no positions"):
        export_file(tmp_path / "c.h5", tmp_path / "a.h5md")
    assert not list(tmp_path.glob("a.h5md*"))
