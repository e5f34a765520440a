"""The recorder on PyElastica itself, 1.0 and 0.3; slow, since its kernels are compiled first."""

from __future__ import annotations

import importlib.util
import math

import numpy as np
import pytest

from openprc.errors import ConfigError, Diverged
from openprc.hooks import record_run
from openprc.schema import Trajectory, validate_file

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(importlib.util.find_spec("elastica") is None, reason="needs pyelastica"),
    pytest.mark.filterwarnings("default"),  # the simulator's own warnings are not ours
]


@pytest.fixture
def ea():
    """Return PyElastica."""
    return importlib.import_module("elastica")


@pytest.fixture
def make(ea):
    """Return a simulator with rods of 10 elements, 1 m long, beside each other."""

    class Simulator(
        ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Connections, ea.Damping,
        ea.CallBacks,
    ):  # fmt: skip
        pass

    def build(rods=1):
        simulator = Simulator()
        for number in range(rods):
            simulator.append(
                ea.CosseratRod.straight_rod(
                    10,
                    np.array([0.5 * number, 0.0, 0.0]),
                    np.array([0.0, 0.0, 1.0]),
                    np.array([0.0, 1.0, 0.0]),
                    1.0,
                    0.02,
                    1000.0,
                    youngs_modulus=1e6,
                    shear_modulus=1e6 / 3.0,
                )
            )
        return simulator

    return build


@pytest.fixture
def loop(ea):
    """Step a simulator; the states of a rod after each step are returned."""

    def steps(simulator, count, *, dt=5e-4, rod=None):
        stepper = ea.PositionVerlet()
        time = np.float64(0.0)
        states = []
        for _ in range(count):
            time = stepper.step(simulator, time, np.float64(dt))
            if rod is not None:
                states.append((float(time), rod.position_collection.T.copy()))
        return states

    return steps


def clamp(ea, simulator, rod):
    simulator.constrain(rod).using(
        ea.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
    )


def test_frames_are_the_states_between_steps(ea, make, loop, tmp_path):
    simulator = make()
    rod = simulator[0]
    clamp(ea, simulator, rod)
    simulator.add_forcing_to(rod).using(
        ea.EndpointForces, np.zeros(3), np.array([0.01, 0.0, 0.0]), ramp_up_time=1e-3
    )
    with record_run(
        simulator, tmp_path / "run.h5", producer="pyelastica", every=7, directors=True, strains=True
    ):
        simulator.finalize()
        states = loop(simulator, 100, rod=rod)
    with Trajectory(tmp_path / "run.h5") as run:
        kept = states[6::7]
        assert run.n_frames == 15
        assert run.time[0] == 0.0
        assert run.uniform
        np.testing.assert_array_equal(run.time[1:], [time for time, _ in kept])
        np.testing.assert_array_equal(run.positions()[1:], [place for _, place in kept])
        mass = 1000 * math.pi * 0.02**2 / 10
        np.testing.assert_allclose(run.node("mass"), [mass / 2, *[mass] * 9, mass / 2], rtol=1e-12)
        # Directors are of the frame, and sigma = e Q t - d3 of half a step before: close to it.
        turned = run.element("segments", "directors").reshape(15, 10, 3, 3)
        arms = np.diff(run.positions(), axis=1) / 0.1
        sigma = np.einsum("tnij,tnj->tni", turned, arms) - [0.0, 0.0, 1.0]
        stored = run.element("segments", "sigma")
        assert 0.0 < np.abs(stored - sigma)[1:].max() < 0.1 * np.abs(sigma).max()
        assert run.element("corners", "kappa").shape == (15, 9, 3)
    report = validate_file(tmp_path / "run.h5")
    assert [finding for finding in report.findings if finding.level == "error"] == []


def test_joints_bodies_and_a_watched_force(ea, make, loop, tmp_path):
    simulator = make(2)
    one, two = simulator
    sphere = ea.Sphere(np.array([0.0, 0.0, 1.1]), 0.05, 1000.0)
    simulator.append(sphere)
    clamp(ea, simulator, one)
    with record_run(simulator, tmp_path / "run.h5", producer="pyelastica", every=10) as session:
        simulator.connect(one, sphere, first_connect_idx=-1, second_connect_idx=0).using(
            ea.FreeJoint, k=1e3, nu=0.1
        )
        pull = session.watch(ea.EndpointForces, name="pull", targets=("rod1:10",))
        simulator.add_forcing_to(two).using(
            pull, np.zeros(3), np.array([0.0, 0.02, 0.0]), ramp_up_time=0.05
        )
        simulator.add_forcing_to(two).using(ea.GravityForces, np.array([0.0, 0.0, -9.81]))
        simulator.finalize()
        loop(simulator, 200)
    with Trajectory(tmp_path / "run.h5") as run:
        assert run.n_nodes == 23
        assert [*run.node("label")][10:12] == ["rod0:10", "rod1:0"]
        assert run.indices("bars")[-1].tolist() == [10, 22]
        assert run.element("bars", "length")[0, -1] == pytest.approx(0.1)
        # What the forcing does in the middle of the step that ended at the frame.
        middle = np.maximum(run.time - 2.5e-4, 2.5e-4)
        expected = 0.02 * np.minimum(middle / 0.05, 1.0)
        np.testing.assert_allclose(run.input("pull").value[:, 1], expected, atol=1e-12)
        np.testing.assert_array_equal(run.input("pull").value[:, [0, 2]], 0.0)
        assert run.node("mass")[-1] == pytest.approx(1000 * 4 / 3 * math.pi * 0.05**3)
        fall = run.positions()[:, 11:22, 2].mean(axis=1)
        np.testing.assert_allclose(fall[0] - fall, 9.81 / 2 * run.time**2, rtol=2e-2, atol=1e-4)


def test_a_run_that_blows_up(ea, make, loop, tmp_path):
    simulator = make()
    clamp(ea, simulator, simulator[0])
    simulator.add_forcing_to(simulator[0]).using(
        ea.EndpointForces, np.zeros(3), np.array([0.01, 0.0, 0.0]), ramp_up_time=1e-3
    )
    recording = record_run(simulator, tmp_path / "run.h5", producer="pyelastica", every=2)
    simulator.finalize()
    with (
        pytest.raises(Diverged, match="rod0 diverged by t = ") as caught,
        np.errstate(all="ignore"),
        recording,
    ):
        loop(simulator, 2000, dt=2.5e-3)
    # R / c_s = 0.02 m / sqrt(27/28 G / rho)
    assert "R/c of shear 0.00112 s" in caught.value.fix
    partial = tmp_path / "run.h5.partial"
    with Trajectory(partial, allow_incomplete=True) as run:
        assert 2 < run.n_frames < 1000
        assert np.isfinite(run.positions()).all()
        assert (run.element("bars", "strain") < 9.0).all()


def test_refusals(ea, make, tmp_path):
    simulator = make()
    simulator.finalize()
    with pytest.raises(ConfigError, match="is finalized and takes no more callbacks"):
        record_run(simulator, tmp_path / "run.h5", producer="pyelastica")
    mute = type("Mute", (ea.BaseSystemCollection,), {})()
    with pytest.raises(ConfigError, match="Mute has no callbacks"):
        record_run(mute, tmp_path / "run.h5", producer="pyelastica")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("closes", [False, True])
def test_without_a_block_and_with_the_simulators_own_close(make, loop, tmp_path, closes):
    simulator = make()
    recording = record_run(simulator, tmp_path / "run.h5", producer="pyelastica")
    simulator.finalize()
    loop(simulator, 5)
    if closes and hasattr(simulator, "close"):  # new in 1.0
        simulator.close()
        assert recording.writer.n_frames == 6
    loop_more = recording.close()
    assert loop_more.n_frames == 6
    with Trajectory(tmp_path / "run.h5") as run:
        np.testing.assert_allclose(run.time, 5e-4 * np.arange(6), rtol=1e-12)


def test_all_systems_at_once(ea, make, loop, tmp_path):
    """What a user may write in 1.0: one callback for the whole collection."""
    simulator = make(2)
    simulator.append(ea.Plane(np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])))
    with record_run(simulator, tmp_path / "run.h5", producer="pyelastica", systems=...):
        simulator.finalize()
        loop(simulator, 3)
    with Trajectory(tmp_path / "run.h5") as run:
        assert (run.n_frames, run.n_nodes) == (4, 22)
