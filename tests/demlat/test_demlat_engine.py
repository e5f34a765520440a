"""From an experiment folder to simulation.h5."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from openprc import demlat
from openprc.demlat import BarHingeModel, Engine, Simulation, SimulationSetup
from openprc.demlat.producer import DemlatProducer
from openprc.demlat.samples import FRAMES_PER_SYMBOL, HOLD, N_SYMBOLS, symbols, write_sample
from openprc.errors import (
    MissingData,
    ResultExists,
)
from openprc.hooks.protocols import Runner
from openprc.schema import Provenance, Trajectory, TrajectoryWriter, validate_file
from openprc.schema.experiment import load_experiment, save_experiment

UPSTREAM = Path(__file__).resolve().parents[2] / "../shared/data/upstream"
X, Y, Z = np.eye(3)


def test_the_file_says_all_that_happened(folder):
    result = Engine(BarHingeModel, backend="cpu").run(Simulation(folder))
    assert result.path == folder / "output" / "simulation.h5"
    assert result.n_frames == 101
    assert result.notes == ()
    with Trajectory(result.path) as run:
        assert (run.n_frames, run.n_nodes, run.dims, run.status) == (101, 9, 3, "complete")
        assert run.uniform
        assert (run.t0, run.dt) == (0.0, 0.01)
        np.testing.assert_array_equal(run.time, 0.01 * np.arange(101))
        assert run.position_unit == "m"
        assert run.node("label").tolist() == list("abcdefghi")
        scene = load_experiment(folder)
        np.testing.assert_array_equal(run.node("rest"), scene.geometry.positions)
        np.testing.assert_array_equal(run.node("mass"), scene.geometry.masses)
        np.testing.assert_array_equal(run.node("fixed"), scene.geometry.fixed)
        np.testing.assert_array_equal(run.indices("bars"), scene.geometry.bars.indices)
        for name in ("rest_length", "stiffness", "damping", "prestress"):
            np.testing.assert_array_equal(
                run.element_static("bars", name), getattr(scene.geometry.bars, name)
            )
        assert set(run.element_series("bars")) == {"length", "strain", "force"}
        assert set(run.systems) == {
            "kinetic_energy",
            "potential_energy",
            "total_energy",
            "work_in",
            "elastic_energy_bars",
            "elastic_energy_hinges",
            "gravity_energy",
            "dissipated_drag",
            "dissipated_bars",
            "dissipated_hinges",
            "dissipated_contact",
            "dissipated",
        }
        x, v = run.positions(), run.velocities()
        kinetic = 0.5 * np.einsum("n,tna->t", run.node("mass"), v**2)
        np.testing.assert_allclose(run.system("kinetic_energy"), kinetic, rtol=1e-13)
        total = run.system("kinetic_energy") + run.system("potential_energy")
        np.testing.assert_array_equal(run.system("total_energy"), total)
        length = run.element("bars", "length")
        i, j = run.indices("bars").T
        np.testing.assert_allclose(length, np.linalg.norm(x[:, j] - x[:, i], axis=2), rtol=1e-14)
        assert run.provenance["producer"] == "demlat"


def test_the_inputs_are_on_the_files_clock_and_keep_their_symbols(folder):
    result = Engine(BarHingeModel).run(folder)
    with Trajectory(result.path) as run:
        assert set(run.inputs) == {"u", "move"}
        push, move = run.input("u"), run.input("move")
        assert (push.quantity, push.unit, push.columns) == ("force", "N", ("x", "y", "z"))
        assert push.targets == ("node 8 xyz",)
        np.testing.assert_array_equal(push.sequence, [[0.1, 0, 0], [0, 0.2, 0]])
        assert (push.hold, push.start) == (0.5, 0.0)
        np.testing.assert_array_equal(push.value[49], [0.1, 0, 0])
        np.testing.assert_array_equal(push.value[50], [0, 0.2, 0])
        assert (move.quantity, move.unit) == ("position", "m")
        assert move.targets == ("node 7 yz",)
        assert move.sequence is None
        driven = run.positions(nodes=[7])[:, 0, 1:]
        np.testing.assert_allclose(driven, move.value[:, 1:], atol=1e-15)


def test_the_producer_and_the_engine_are_one_way(folder):
    producer = DemlatProducer()
    assert isinstance(producer, Runner)
    seen = []
    with TrajectoryWriter(folder / "direct.h5", provenance=Provenance("demlat")) as writer:
        producer.run(
            load_experiment(folder),
            writer,
            seed=3,
            progress=lambda fraction, message: seen.append((fraction, message)),
        )
    result = Engine(BarHingeModel).run(folder)
    with Trajectory(folder / "direct.h5") as one, Trajectory(result.path) as two:
        assert one.content_digest() == two.content_digest()
    fractions = [fraction for fraction, _ in seen]
    assert fractions == sorted(fractions)
    assert (fractions[0], fractions[-1]) == (0.0, 1.0)
    assert seen[-1][1] == "t = 1 s of 1 s"


def test_blocks_do_not_change_the_result(folder, monkeypatch):
    from openprc.demlat.models.barhinge import model

    digests = set()
    for name, size in (("whole", model.BLOCK_WORK), ("pieces", 50_000), ("single", 1)):
        monkeypatch.setattr(model, "BLOCK_WORK", size)
        with TrajectoryWriter(folder / name, provenance=Provenance("demlat")) as writer:
            DemlatProducer().run(load_experiment(folder), writer)
        with Trajectory(folder / name) as run:
            digests.add(run.content_digest())
    assert len(digests) == 1


def test_planar_scenes_are_stored_in_two_dimensions(tmp_path, body, drive):
    signal, actuator = drive([0.1], dt=1.0, node=1, axes=(1, 1, 0), interpolation="hold")
    scene = body(
        [0 * X, X],
        [1, 1],
        bars=[(0, 1, 10, 1, 0)],
        fixed=[True, False],
        signals=[signal],
        actuators=[actuator],
    )
    save_experiment(scene, tmp_path)
    with Trajectory(Engine(BarHingeModel).run(tmp_path).path) as run:
        assert run.dims == 2
        assert run.positions().shape == (101, 2, 2)
        assert run.velocities().shape == (101, 2, 2)
        assert run.input("u").columns == ("value",)
        assert run.input("u").sequence.shape == (1, 1)


def test_hinges_and_faces_are_stored(tmp_path, body):
    scene = body(
        [0 * X, X, [0.4, -0.7, 0.3], [0.6, 0.9, 0.2]],
        [0.1] * 4,
        hinges=[(0, 1, 2, 3, 0.5, 2.5, 0.01)],
    )
    scene = replace(scene, geometry=replace(scene.geometry, faces=[[0, 1, 2], [0, 3, 1]]))
    save_experiment(scene, tmp_path)
    with Trajectory(Engine(BarHingeModel).run(tmp_path).path) as run:
        assert set(run.element_kinds) >= {"hinges", "faces"}
        angle, torque = run.element("hinges", "angle"), run.element("hinges", "torque")
        rate = np.gradient(angle[:, 0], run.dt)
        expected = 0.5 * (angle[:, 0] - 2.5) + 0.01 * rate
        np.testing.assert_allclose(torque[5:-5, 0], expected[5:-5], atol=2e-3)


def test_bars_of_rest_length_zero_have_no_strain(tmp_path, body):
    # A spring of rest length 0 pulls like F = -k x, through the point where its ends meet too.
    scene = body([0 * X, X], [1, 1], bars=[(0, 1, 4.0, 0, 0)], fixed=[True, False], duration=3.0)
    save_experiment(scene, tmp_path)
    result = Engine(BarHingeModel, backend="cpu").run(tmp_path)
    assert result.notes == ("no strain is stored: a bar has the rest length 0",)
    with Trajectory(result.path) as run:
        np.testing.assert_allclose(run.positions()[:, 1, 0], np.cos(2 * run.time), atol=1e-9)
        with pytest.raises(MissingData):
            run.element("bars", "strain")


def test_one_signal_may_push_and_move(tmp_path, body, drive):
    signal, pusher = drive([0.5], dt=1.0, node=0, interpolation="hold")
    _, mover = drive([0.5], dt=1.0, node=1, type="position")
    scene = body([0 * X, [0.5] * 3], [1, 1], signals=[signal], actuators=[pusher, mover])
    save_experiment(scene, tmp_path)
    with Trajectory(Engine(BarHingeModel).run(tmp_path).path) as run:
        assert set(run.inputs) == {"u force", "u position"}


# --- results in the way ------------------------------------------------------------------------


def test_results_are_replaced_only_when_asked(folder):
    engine = Engine(BarHingeModel)
    first = engine.run(folder)
    with pytest.raises(ResultExists, match="finished file"):
        engine.run(folder)
    engine.run(folder, overwrite=True)
    with Trajectory(first.path) as run:
        assert run.n_frames == 101


def test_a_setup_that_overwrites_lets_the_engine_overwrite(tmp_path):
    for _ in range(2):
        setup = SimulationSetup(tmp_path, overwrite=True)
        setup.add_node([0, 0, 1.0], mass=0.1)
        setup.set_physics(gravity=-9.81)
        setup.set_simulation_params(duration=0.1, dt=1e-3, save_interval=1e-2)
        setup.save()
        Engine(BarHingeModel).run(tmp_path)


def test_a_run_without_duration_is_one_frame(tmp_path, body):
    save_experiment(body([0 * X], [1.0], duration=0.0), tmp_path)
    with Trajectory(Engine(BarHingeModel).run(tmp_path).path) as run:
        assert run.n_frames == 1


def test_what_is_written_passes_the_validator(folder):
    report = validate_file(Engine(BarHingeModel).run(folder).path)
    assert [finding for finding in report.findings if finding.level != "hint"] == []


# --- the paper's listing, the sample, and real files ----------------------------------------------


def test_the_listing_of_the_paper_runs_as_printed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    position = [0.0, 0.0, 0.0]
    others = [[1.0, 0.0, 0.0], [0.5, -0.8, 0.1], [0.5, 0.8, 0.1]]
    theta = 2.9
    length = 1.0
    signal_array = np.stack([1e-2 * np.sin(np.arange(20_001) * 5e-4), *np.zeros((2, 20_001))], 1)

    setup = SimulationSetup("./experiments/miura_ori_4x8", overwrite=True)
    setup.set_simulation_params(duration=10.0, dt=0.001, save_interval=0.01)
    setup.set_physics(gravity=0, damping=0.8, enable_collision=True)

    setup.add_node(position, mass=0.01)
    n0, n1, n2, n3 = 0, *(setup.add_node(other, mass=0.01) for other in others)
    node_i, node_j, node_idx = n0, n1, n0
    setup.add_bar(node_i, node_j, stiffness=222.15, rest_length=length, damping=0.01)
    setup.add_hinge([n0, n1, n2, n3], stiffness=0.01, rest_angle=theta)

    setup.add_signal("sig_base", signal_array, dt=0.0005)
    setup.add_actuator(node_idx, "sig_base", type="position")

    setup.save()

    engine = demlat.Engine(BarHingeModel, backend="cuda")
    engine.run(demlat.Simulation("./experiments/miura_ori_4x8"))

    with Trajectory("experiments/miura_ori_4x8/output/simulation.h5") as run:
        assert run.n_frames == 1001
        np.testing.assert_allclose(
            run.positions(nodes=[0])[:, 0, 0], signal_array[::20, 0], atol=1e-15
        )


def ridge_error(states, target, washout=50, train=400):
    """NRMSE of a ridge readout on the rows after `train`."""
    mean = states[washout : washout + train].mean(axis=0)
    scale = states[washout : washout + train].std(axis=0)
    z = (states - mean) / scale
    fit, test = z[washout : washout + train], z[washout + train :]
    y = target[washout : washout + train]
    gram = fit.T @ fit + 1e-6 * len(fit) * np.eye(fit.shape[1])
    weights = np.linalg.solve(gram, fit.T @ (y - y.mean()))
    error = test @ weights + y.mean() - target[washout + train :]
    return np.sqrt(np.mean(error**2)) / target[washout + train :].std()


def test_the_sample_remembers_and_is_nonlinear(tmp_path):
    sample = write_sample(tmp_path)
    assert sample.path == tmp_path
    result = Engine(BarHingeModel, backend="cpu").run(sample.path)
    assert result.notes == ()
    with Trajectory(result.path) as run:
        assert run.dims == 2
        drive = run.input("force")
        np.testing.assert_array_equal(drive.sequence[:, 0], symbols())
        assert drive.hold == HOLD
        # The state at the end of symbol k, before symbol k + 1 acts.
        states = run.positions()[FRAMES_PER_SYMBOL::FRAMES_PER_SYMBOL, 4:].reshape(N_SYMBOLS, -1)
        work, energy = run.system("work_in"), run.system("total_energy")
        balance = energy - energy[0] - work + run.system("dissipated")
        assert np.abs(balance).max() < 1e-5 * work[-1]
    u = symbols()
    target = np.zeros(N_SYMBOLS + 1)
    for k in range(N_SYMBOLS):
        before = target[k - 1] if k else 0.0
        target[k + 1] = 0.4 * target[k] + 0.4 * target[k] * before + 0.6 * u[k] ** 3 + 0.1
    taps = np.stack([np.concatenate([np.zeros(n), u[: N_SYMBOLS - n]]) for n in range(15)], 1)
    body, register = (ridge_error(matrix, target[1:]) for matrix in (states, taps))
    assert register == pytest.approx(0.40, abs=0.05)
    assert body < 0.2


@pytest.mark.skipif(not UPSTREAM.exists(), reason="recorded files are not at hand")
@pytest.mark.parametrize("name", ["lattice_3x3_gen0", "lattice_4x4_gen0"])
def test_stored_runs_are_met_within_the_error_of_their_integrator(name):
    scene = load_experiment(UPSTREAM / name)
    with h5py.File(UPSTREAM / name / "output/simulation.h5") as file:
        stored = file["time_series/nodes/positions"][()].astype("f8")

    def positions(scene):
        return np.concatenate([block.x.copy() for _, block in BarHingeModel(scene).blocks()])

    ours, finer = positions(scene), positions(replace(scene, dt=scene.dt / 2))
    motion = np.std(stored - stored.mean(axis=0))
    assert np.std(finer - ours) < 1e-4 * motion
    # Theirs is of first order and labels its frames one step early.
    assert 0.005 < np.std(ours - stored) / motion < 0.02


@pytest.mark.skipif(not UPSTREAM.exists(), reason="recorded files are not at hand")
def test_a_real_folder_runs_to_a_valid_file(tmp_path):
    save_experiment(load_experiment(UPSTREAM / "yoshimura"), tmp_path)
    result = Engine(BarHingeModel).run(tmp_path)
    assert any("m away from where node 12 is" in note for note in result.notes)
    with Trajectory(result.path) as run:
        assert run.n_frames == 2001
        assert np.abs(run.positions()).max() < 1.0
