"""One body on several simulators: they agree with each other, and with what is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from openprc.compare.load_steps import counts_increments, time_increments
from openprc.compare.producers import run_producers
from openprc.compare.requests import read_requests
from openprc.errors import ConfigError
from openprc.scenes.cantilever import AREA, LENGTH, MODULUS
from openprc.scenes.catalog import build_scene
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
    wrong = build_scene("miura", {"variant": "folding", "columns": 1, "rows": 1, "duration": 9.0})
    with pytest.raises(ConfigError, match="do not follow the drives of the experiment"):
        time_increments(run.path, wrong.experiment, tmp_path / "wrong.h5")
    assert not (tmp_path / "wrong.h5").exists()


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
