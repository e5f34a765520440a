"""One body on several simulators: they agree with each other, and with what is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from openprc.analysis.tasks.narma import NarmaTask
from openprc.analysis.tasks.volterra import VolterraTask
from openprc.compare.runs.load_steps import counts_increments, time_increments
from openprc.compare.runs.producers import run_producers
from openprc.compare.runs.requests import read_requests
from openprc.compare.task_scores import state_nmse
from openprc.errors import ConfigError
from openprc.reservoir import Ridge
from openprc.reservoir.training.row_split import RowSplit
from openprc.scenes.cantilever import AREA, LENGTH, MODULUS
from openprc.scenes.catalog import build_scene
from openprc.scenes.hauser_network import network_input
from openprc.schema.experiment import Actuator, Experiment, Signal
from openprc.schema.geometry import Bars, Geometry
from openprc.schema.trajectory import Trajectory

SAVED = Path(__file__).resolve().parents[3] / "shared" / "data" / "merlin"


def first_probe(name, options, producers, folder):
    """Return the first known figure of a scene, and what producers say of it."""
    scene = build_scene(name, options)
    probe = scene.reference.probes[0]
    found = {}
    for run in run_producers(scene.experiment, read_requests(producers), folder, warm_up=False):
        assert run.status == "ok", run.reason
        with Trajectory(run.path) as trajectory:
            found[run.producer] = probe.measure(trajectory)
    return probe.value, found


def test_a_cantilever_bends_alike(tmp_path):
    pytest.importorskip("pybullet", reason="PyBullet is not installed")
    formula, found = first_probe("cantilever", {"n": 5}, "demlat,pybullet", tmp_path)
    assert found["pybullet"] == pytest.approx(found["demlat"], rel=1e-9)
    assert found["demlat"] == pytest.approx(formula, rel=2e-4)
    # Below the formula of small deflections, by about the square of the slope.
    assert found["demlat"] < formula * (1.0 - 5e-5)


@pytest.mark.slow
@pytest.mark.parametrize("n", [5, 10, 20])
def test_a_rod_less_its_shear_is_a_chain(n, tmp_path):
    pytest.importorskip("elastica", reason="PyElastica is not installed")
    force = 0.005
    producers = "demlat,pyelastica:substeps=auto"
    formula, found = first_probe("cantilever", {"n": n, "force": force}, producers, tmp_path)
    shear = force * LENGTH / (27.0 / 28.0 * MODULUS / 3.0 * AREA)
    assert found["pyelastica"] - shear == pytest.approx(found["demlat"], rel=1e-5)
    assert found["pyelastica"] - shear == pytest.approx(formula, rel=2e-4)
    assert found["pyelastica"] != pytest.approx(found["demlat"], rel=5e-4)


@pytest.mark.parametrize("n", [1, 2, 5, 10])
def test_hanging_chains_swing_at_laguerres_roots(n, tmp_path):
    options = {"n": n, "stiffness": 1e5, "periods": 2}
    known, found = first_probe("hanging-chain", options, "demlat", tmp_path)
    roots = np.polynomial.laguerre.lagroots([0.0] * n + [1.0])
    assert known == pytest.approx(np.sqrt(9.81 * n * roots.min()) / (2.0 * np.pi), rel=1e-6)
    assert found["demlat"] == pytest.approx(known, rel=1e-5)


def test_a_chain_in_bullet_swings_alike(tmp_path):
    pytest.importorskip("pybullet", reason="PyBullet is not installed")
    options = {"n": 2, "stiffness": 1e4, "periods": 2}
    known, found = first_probe("hanging-chain", options, "pybullet", tmp_path)
    assert found["pybullet"] == pytest.approx(known, rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("drive", "order"), [("volterra", None), ("narma", 10)])
def test_networks_compute_alike(drive, order, tmp_path):
    pytest.importorskip("pybullet", reason="PyBullet is not installed")
    steps = 3000
    scene = build_scene("hauser-network", {"drive": drive, "n_steps": steps})
    requests = read_requests("demlat:verlet:dt=1.25e-4,pybullet:dt=1.25e-4")
    places, states = [], []
    for run in run_producers(scene.experiment, requests, tmp_path, warm_up=False):
        assert run.status == "ok", run.reason
        with Trajectory(run.path) as trajectory:
            places.append(trajectory.positions())
            ends = trajectory.indices("bars")
        between = places[-1][:, ends[:, 1]] - places[-1][:, ends[:, 0]]
        states.append(np.linalg.norm(between, axis=2)[:steps])
    # Both take the same steps; what they differ by is rounding.
    assert np.linalg.norm(places[0] - places[0][0], axis=2).max() > 1e-4
    assert np.linalg.norm(places[1] - places[0], axis=2).max() < 1e-12
    task = VolterraTask() if order is None else NarmaTask(order, any_range=True)
    u = network_input(steps, amplitude=0.1)
    split = RowSplit(600, 1800, 600)
    for penalty in (1e-10, 1e-8):
        readout = Ridge(penalty, alpha_scaling="n")
        ours, bullet = (
            state_nmse(one, u, task=task, split=split, readout=readout) for one in states
        )
        assert bullet == pytest.approx(ours, rel=1e-4)


def test_equilibria_are_put_in_time(tmp_path):
    scene = build_scene("miura", {"variant": "folding", "columns": 1, "rows": 1})
    (run,) = run_producers(scene.experiment, read_requests("merlin"), tmp_path, warm_up=False)
    assert counts_increments(run.path)
    how = time_increments(run.path, scene.experiment, tmp_path / "in-time.h5")
    assert "every increment stands for the frame" in how
    with Trajectory(tmp_path / "in-time.h5") as timed:
        assert timed.time_kind == "physical"
        assert timed.time == pytest.approx(scene.experiment.frame_times)
        exact = scene.reference.exact(timed.time)
        apart = np.linalg.norm(timed.positions() - exact, axis=2).max()
    assert apart < 1e-3 * np.linalg.norm(exact - exact[0], axis=2).max()
    wrong = replace(scene.experiment, save_interval=2.0 * scene.experiment.save_interval)
    with pytest.raises(ConfigError, match="do not follow the drives of the experiment"):
        time_increments(run.path, wrong, tmp_path / "wrong.h5")
    assert not (tmp_path / "wrong.h5").exists()


def pulled_bar(values):
    """Return a bar of 10 N/m and 1 m along x that a force [N] pulls at its end, for 1 s."""
    still = Signal(name="still", values=np.zeros(2), dt=1.0)
    pull = Signal(name="pull", values=values, dt=1.0 / (len(values) - 1))
    geometry = Geometry(
        positions=[[0, 0, 0], [1, 0, 0]], masses=[1, 1], fixed=[1, 0],
        bars=Bars(indices=[[0, 1]], stiffness=[10.0], rest_length=[1.0]),
    )  # fmt: skip
    return Experiment(
        geometry=geometry,
        signals={"still": still, "pull": pull},
        actuators=(
            Actuator(node=1, signal="still", axes=(False, True, True)),
            Actuator(node=1, signal="pull", type="force", axes=(True, False, False)),
        ),
        duration=1.0, dt=0.05, save_interval=0.05,
    )  # fmt: skip


def test_load_factors_are_put_in_time(tmp_path):
    # The force grows with the square of time.
    experiment = pulled_bar(2.0 * np.linspace(0.0, 1.0, 201) ** 2)
    (run,) = run_producers(
        experiment, read_requests("merlin:control=arc-length:max-load=1"), tmp_path, warm_up=False
    )
    assert run.status == "ok", run.reason
    how = time_increments(run.path, experiment, tmp_path / "in-time.h5")
    assert "have their load factor" in how
    with Trajectory(tmp_path / "in-time.h5") as timed:
        assert timed.n_frames > 3
        reached = timed.positions()[:, 1, 0]
        assert reached == pytest.approx(1.0 + 0.2 * timed.time**2, abs=2e-5)
    back = pulled_bar(2.0 * np.sin(np.linspace(0.0, 3.0, 201)))
    with pytest.raises(ConfigError, match="do not all grow steadily, in one proportion"):
        time_increments(run.path, back, tmp_path / "wrong.h5")


@pytest.mark.skipif(not SAVED.is_dir(), reason="the runs of MERLIN are not here")
@pytest.mark.parametrize("name", ["merlin1_miura_folding"])
def test_states_that_merlin_saved_are_found_again(name, tmp_path):
    from openprc_merlin.workspace_experiment import workspace_experiment

    from openprc.hooks.importing import import_file

    path = SAVED / f"{name}.mat"
    saved = import_file(path, tmp_path / "saved.h5", options={"unit": "m"}).path
    (run,) = run_producers(
        workspace_experiment(path), read_requests("merlin"), tmp_path, warm_up=False
    )
    with Trajectory(saved) as known, Trajectory(run.path) as ours:
        there, here = known.positions(), ours.positions()
    count = min(len(there), len(here))
    assert count > 20
    apart = np.linalg.norm(here[:count] - there[:count], axis=2).max()
    assert apart < 1e-3 * np.linalg.norm(there - there[0], axis=2).max()
