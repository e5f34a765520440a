"""Other simulators meet the probes of the scenes that they can express."""

import numpy as np
import pytest

from openprc.errors import MissingData
from openprc.scenes.catalog import SCENES
from openprc.scenes.probes import path_of, places
from openprc.scenes.verification import verify_scene
from openprc.schema import Trajectory

SHORT = {
    "hauser-network": {"n_steps": 300},
    "spring-lattice": {"n_symbols": 12},
    "miura": {"n_symbols": 6},
}


def results_of(scene, path):
    with Trajectory(path) as run:
        results = {result.probe.name: result for result in verify_scene(scene, run)}
    assert results
    return results


def assert_holds(scene, path):
    for result in results_of(scene, path).values():
        assert result.ok, result.as_dict()


#: Many steps, each of which calls PyBullet for every node.
LONG = ("cantilever", "hauser-network", "miura")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if name in LONG else ())
        for name in SCENES
        if name != "bouncing-body"
    ],
)
def test_pybullet(run_scene, name):
    pytest.importorskip("pybullet")
    pytest.importorskip("openprc_pybullet")
    assert_holds(*run_scene(name, producer="pybullet", **SHORT.get(name, {})))


@pytest.mark.slow
def test_pybullet_folds_the_miura_sheet(run_scene):
    pytest.importorskip("pybullet")
    pytest.importorskip("openprc_pybullet")
    assert_holds(*run_scene("miura", producer="pybullet", variant="folding"))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hanging-chain", "swinging-chain", "cantilever"])
def test_pyelastica(run_scene, name):
    pytest.importorskip("elastica")
    pytest.importorskip("openprc_pyelastica")
    options = SCENES[name].run_options["pyelastica"]
    short = {"swinging-chain": {"duration": 0.5}}.get(name, {})
    assert_holds(*run_scene(name, producer="pyelastica", run_options=options, **short))


@pytest.mark.slow
def test_a_rod_sinks_more_by_its_shear(run_scene):
    """By ``F L / (a G A)`` = 1.23787e-5 m, G = E / 3 and a = 27 / 28."""
    pytest.importorskip("elastica")
    pytest.importorskip("openprc_pyelastica")
    scene, path = run_scene("cantilever", producer="pyelastica")
    tip = results_of(scene, path)["deflection of the tip"]
    assert not tip.ok
    shear = 0.005 / (27.0 / 28.0 * 1e6 / 3.0 * np.pi * 0.02**2)
    assert tip.measured - shear == pytest.approx(0.01133811, rel=1e-5)


@pytest.mark.parametrize(
    ("name", "options", "largest"),
    [
        # The press moves slowly, so the path in time lags a little; equilibria do not.
        ("von-mises-truss", {}, 1e-8),
        ("von-mises-truss", {"rise": 0.05}, 1e-8),
        ("kresling", {}, 1e-12),
        ("kresling", {"sides": 8, "twist": 60.0, "height": 0.15}, 1e-12),
        ("miura", {"variant": "folding"}, 2e-4),
    ],
)
def test_paths_of_equilibria(run_scene, name, options, largest):
    """An independent solver of the whole body against formulas for its symmetric motion."""
    pytest.importorskip("openprc_merlin")
    scene, path = run_scene(name, producer="merlin", **options)
    results = results_of(scene, path)
    assert all(result.ok for result in results.values())
    assert results["largest deviation"].measured < largest


def test_the_cantilever_in_one_step(run_scene):
    pytest.importorskip("openprc_merlin")
    options = SCENES["cantilever"].run_options["merlin"]
    assert_holds(*run_scene("cantilever", producer="merlin", run_options=options))


def test_the_tower_stays_stable_all_the_way(run_scene):
    """Held by its height, so that the path between the states can be followed."""
    pytest.importorskip("openprc_merlin")
    _, path = run_scene("kresling", producer="merlin")
    with Trajectory(path) as run:
        assert not run.system("negative_eigenvalues").any()
        assert run.system("elastic_energy_bars").max() > 1e-3
        assert run.system("elastic_energy_bars")[-1] < 1e-15


def test_a_path_of_equilibria_is_no_motion(run_scene):
    pytest.importorskip("openprc_merlin")
    scene, path = run_scene(
        "spring-lattice", producer="merlin", run_options={"increments": 10}, n_symbols=2
    )
    with Trajectory(path) as run, pytest.raises(MissingData, match="which has no time"):
        verify_scene(scene, run)


def test_pybullet_steps_as_verlet_does(run_scene):
    """Both step as leapfrog does: the same numbers to rounding."""
    pytest.importorskip("pybullet")
    pytest.importorskip("openprc_pybullet")
    paths = []
    for producer in ("demlat", "pybullet"):
        scene, path = run_scene("hanging-chain", producer=producer)
        with Trajectory(path) as run:
            paths.append(places(run, scene.experiment.geometry.labels))
            assert path_of(run, "pivot").any() == np.False_
    assert np.abs(paths[1] - paths[0]).max() < 1e-11
