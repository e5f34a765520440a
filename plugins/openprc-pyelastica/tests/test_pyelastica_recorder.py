"""The recorder, seen through a simulator that has no physics."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from openprc.errors import ConfigError
from openprc.schema import Trajectory, validate_file


def expected(n_nodes, times, *, offset=0.0):
    index = np.arange(n_nodes)
    positions = np.zeros((len(times), n_nodes, 3))
    positions[:, :, 0] = offset + 0.1 * index
    positions[:, :, 1] = 0.01 * index * np.sin(times)[:, np.newaxis]
    return positions


def test_a_rod_and_its_clock(stub, recording):
    simulator = stub.Simulator(stub.Rod(6))
    with recording(simulator, every=3) as run:
        simulator.finalize()
        simulator.run(10)
        assert run.session.n_frames == 4
    with Trajectory(run.path) as result:
        times = 0.01 * np.array([0, 3, 6, 9])
        np.testing.assert_array_equal(result.time, times)
        np.testing.assert_array_equal(result.positions(), expected(6, times))
        speed = 0.01 * np.arange(6) * np.cos(times[1:])[:, np.newaxis]
        np.testing.assert_array_equal(result.velocities()[1:, :, 1], speed)
        np.testing.assert_array_equal(result.node("mass"), 0.5)
        assert result.node("label").tolist()[:2] == ["rod0:0", "rod0:1"]
        np.testing.assert_array_equal(result.indices("bars"), [[i, i + 1] for i in range(5)])
    report = validate_file(run.path)
    assert [finding for finding in report.findings if finding.level == "error"] == []


def test_lengths_are_those_of_the_positions(stub, recording):
    simulator = stub.Simulator(stub.Rod(5))
    with recording(simulator) as run:
        simulator.finalize()
        simulator.run(20, dt=0.1)
    with Trajectory(run.path) as result:
        arms = np.diff(result.positions(), axis=1)
        lengths = np.linalg.norm(arms, axis=2)
        np.testing.assert_allclose(result.element("bars", "length"), lengths, rtol=1e-15)
        np.testing.assert_allclose(result.element("bars", "strain"), lengths / 0.1 - 1, atol=1e-15)


def test_the_arrays_are_copied(stub, recording):
    """PyElastica's arrays are views that the next step overwrites."""
    simulator = stub.Simulator(stub.Rod(4))
    with recording(simulator) as run:
        simulator.finalize()
        simulator.run(2)
        simulator[0].position_collection[:] = np.nan
    with Trajectory(run.path) as result:
        np.testing.assert_array_equal(result.positions(), expected(4, 0.01 * np.arange(3)))


def test_an_instant_that_is_shown_twice_is_stored_once(stub, recording):
    simulator = stub.Simulator(stub.Rod(4))
    with recording(simulator) as run:
        simulator.finalize()
        simulator.fire(0.0)
        simulator.run(3)
    with Trajectory(run.path) as result:
        np.testing.assert_array_equal(result.time, 0.01 * np.arange(4))


def test_several_bodies_are_numbered_one_after_the_other(stub, recording):
    rods = stub.Rod(4), stub.Rod(3, offset=5.0)
    simulator = stub.Simulator(rods[0], stub.Plane(), stub.Sphere(9.0), rods[1])
    with recording(simulator) as run:
        simulator.finalize()
        simulator.run(5)
    with Trajectory(run.path) as result:
        assert [label.split(":")[0] for label in result.node("label")] == (
            ["rod0"] * 4 + ["sphere0"] + ["rod1"] * 3
        )
        times = result.time
        np.testing.assert_array_equal(result.positions()[:, :4], expected(4, times))
        np.testing.assert_array_equal(result.positions()[:, 5:], expected(3, times, offset=5.0))
        np.testing.assert_array_equal(result.positions()[:, 4, 2], times)
        assert result.indices("bars").tolist() == [[0, 1], [1, 2], [2, 3], [5, 6], [6, 7]]


def test_a_ring_is_closed(stub, recording):
    simulator = stub.Simulator(stub.Rod(5, ring=True))
    with recording(simulator, strains=True) as run:
        simulator.finalize()
    with Trajectory(run.path) as result:
        assert result.indices("bars")[-1].tolist() == [4, 0]
        assert result.element("bars", "length")[0, -1] == pytest.approx(0.4, rel=1e-14)
        assert result.indices("corners")[-2:].tolist() == [[3, 4, 0], [4, 0, 1]]


def test_a_rod_that_is_appended_later_is_recorded_too(stub, recording):
    simulator = stub.Simulator(stub.Rod(4))
    with recording(simulator) as run:
        simulator.append(stub.Rod(3))
        simulator.finalize()
    with Trajectory(run.path) as result:
        assert result.n_nodes == 7


def test_joints_are_bars_of_rest_length_zero(stub, recording, notes):
    simulator = stub.Simulator(stub.Rod(4), stub.Plane(), stub.Sphere(0.45))
    with recording(simulator) as run:
        # Joints are often made after the recorder is attached.
        simulator._connections.append(stub.Connection(0, 2, -1, 0))
        simulator.finalize()
        simulator.run(3)
    with Trajectory(run.path) as result:
        assert result.indices("bars")[-1].tolist() == [3, 4]
        assert result.element_static("bars", "rest_length")[-1] == 0.0
        assert list(result.element_static("bars", "kind"))[-2:] == ["element", "FreeJoint"]
        gap = np.linalg.norm(np.diff(result.positions()[:, 3:], axis=1)[:, 0], axis=1)
        np.testing.assert_allclose(result.element("bars", "length")[:, -1], gap, rtol=1e-15)
        assert not result.has("/time_series/elements/bars/strain")
        assert "1 joint(s) are bars of rest length 0" in notes(result)


def test_joints_that_are_lists_of_nodes(stub, recording):
    simulator = stub.Simulator(stub.Rod(4), stub.Rod(4))
    with recording(simulator) as run:
        simulator._connections.append(stub.Connection(0, 1, [0, 2], [1, 3]))
        simulator.finalize()
    with Trajectory(run.path) as result:
        assert result.indices("bars")[-2:].tolist() == [[0, 5], [2, 7]]


def test_a_joint_to_what_is_not_recorded_is_left_out_in_words(stub, recording, notes):
    simulator = stub.Simulator(stub.Rod(4), stub.Rod(4))
    with recording(simulator, systems=[simulator[0]]) as run:
        simulator._connections.append(stub.Connection(0, 1, 3, 0))
        simulator.finalize()
    with Trajectory(run.path) as result:
        assert len(result.indices("bars")) == 3
        assert "a FreeJoint to a system that is not recorded was left out" in notes(result)


def test_systems_may_be_named(stub, recording):
    simulator = stub.Simulator(stub.Rod(4), stub.Rod(3))
    with recording(simulator, systems={"left arm": simulator[1]}) as run:
        simulator.finalize()
    with Trajectory(run.path) as result:
        assert result.node("label").tolist() == ["left.arm:0", "left.arm:1", "left.arm:2"]


def test_directors_and_strains(stub, recording, notes):
    rod, sphere = stub.Rod(4), stub.Sphere()
    simulator = stub.Simulator(rod, sphere)
    with recording(simulator, directors=True, strains=True) as run:
        simulator.finalize()
        simulator.run(2)
    with Trajectory(run.path) as result:
        directors = result.element("segments", "directors")
        assert directors.shape == (3, 3, 9)
        # Row by row: d1 of the element, then d2, then d3.
        np.testing.assert_array_equal(
            directors[1, 2].reshape(3, 3), rod.director_collection[:, :, 2]
        )
        np.testing.assert_array_equal(result.element("segments", "sigma")[2], rod.sigma.T)
        np.testing.assert_array_equal(result.element("corners", "kappa")[0], rod.kappa.T)
        assert result.indices("corners").tolist() == [[0, 1, 2], [1, 2, 3]]
        np.testing.assert_array_equal(
            result.element("rigid-bodies", "directors")[0, 0], np.eye(3).ravel()
        )
        assert "half a simulation step before" in notes(result)


def test_the_radius_is_kept(stub, recording, extension):
    simulator = stub.Simulator(stub.Rod(4))
    with recording(simulator) as run:
        simulator.finalize()
    with Trajectory(run.path) as result:
        values, unit, comment = extension(result, "rod0.radius")
        np.testing.assert_array_equal(values, [0.01] * 3)
        assert (unit, comment) == ("m", "at t = 0")


def test_a_plane_leaves_an_axis_out(stub, recording):
    simulator = stub.Simulator(stub.Rod(4))
    with recording(simulator, plane="xy") as run:
        simulator.finalize()
        simulator.run(4)
    with Trajectory(run.path) as result:
        assert result.dims == 2
        np.testing.assert_array_equal(result.positions(), expected(4, result.time)[..., :2])


def test_a_plane_that_the_rod_leaves_is_refused(stub, recording):
    simulator = stub.Simulator(stub.Rod(4))
    with (  # noqa: PT012
        pytest.raises(ConfigError, match=r"not in the plane xz: positions spread over .* along y"),
        recording(simulator, plane="xz"),
    ):
        simulator.finalize()
        simulator.run(4)


def test_many_blocks_are_one_recording(stub, recording, monkeypatch):
    monkeypatch.setattr("openprc_pyelastica.track.MOST_ROWS", 16)
    simulator = stub.Simulator(stub.Rod(4), stub.Rod(5))
    u = np.arange(101.0)
    with recording(simulator, signals={"u": u}) as run:
        simulator.finalize()
        simulator.run(37)
        simulator.close()  # in the middle of a block
        simulator.run(63)
    with Trajectory(run.path) as result:
        np.testing.assert_array_equal(result.time, 0.01 * np.arange(101))
        np.testing.assert_array_equal(result.positions()[:, 4:], expected(5, result.time))
        np.testing.assert_array_equal(result.input("u").value[:, 0], u)


def test_a_container_of_systems_is_understood(stub, recording):
    """PyElastica 1.0 hands a callback the list or dict that it was registered with."""
    simulator = stub.Simulator(stub.Rod(4), stub.Plane(), stub.Rod(3))
    with recording(simulator) as run:
        simulator.finalize()
        simulator.calls.clear()
        for take in (list(simulator), dict(enumerate(simulator))):
            simulator.run(1)
            run.session.take(take, simulator.step_number * 0.01)
    with Trajectory(run.path) as result:
        assert result.n_frames == 3
        np.testing.assert_array_equal(result.positions()[:, :4], expected(4, result.time))


def test_close_makes_what_there_is_safe(stub, recording):
    simulator = stub.Simulator(stub.Rod(4))
    with recording(simulator) as run:
        simulator.finalize()
        simulator.run(5)
        assert run.writer.n_frames == 0
        simulator.close()
        assert run.writer.n_frames == 6


@pytest.mark.parametrize(("installed", "told"), [("0.3.3", True), ("1.0.0", False)])
def test_a_version_that_never_damps(stub, recording, notes, monkeypatch, installed, told):
    monkeypatch.setattr("openprc_pyelastica.callback.version", lambda name: installed)
    simulator = stub.Simulator(stub.Rod(4))
    simulator._damping_list = ["a damper"]
    with recording(simulator) as run:
        simulator.finalize()
    with Trajectory(run.path) as result:
        assert f"recorded from PyElastica {installed}" in notes(result)
        assert ("registers dampers and never calls them" in notes(result)) is told


FORGETFUL = """
import importlib.util, sys, types
spec = importlib.util.spec_from_file_location("conftest", {conftest!r})
conftest = importlib.util.module_from_spec(spec)
spec.loader.exec_module(conftest)
functions = types.ModuleType("elastica.callback_functions")
functions.CallBackBaseClass = type("CallBackBaseClass", (), {{}})
sys.modules["elastica"] = package = types.ModuleType("elastica")
package.__spec__ = importlib.util.spec_from_loader("elastica", None)
sys.modules["elastica.callback_functions"] = functions
from openprc.hooks import record_run
simulator = conftest.StubSimulator(conftest.StubRod(4))
recording = record_run(simulator, {path!r}, producer="pyelastica", every=2)
simulator.finalize()
simulator.run(7)
{end}
"""


@pytest.mark.parametrize(
    ("end", "complete"), [("", True), ("raise RuntimeError('died')", False)], ids=["ends", "dies"]
)
def test_a_script_that_never_closes(stub, tmp_path, end, complete):
    path = tmp_path / "run.h5"
    conftest = str(tmp_path.joinpath(__file__).parent / "conftest.py")
    script = FORGETFUL.format(conftest=conftest, path=str(path), end=end)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert path.exists() is complete, done.stderr
    assert path.with_name("run.h5.partial").exists() is not complete
    if complete:
        with Trajectory(path) as result:
            np.testing.assert_array_equal(result.time, [0.0, 0.02, 0.04, 0.06])
