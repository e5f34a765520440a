"""Scenes side by side: each is what it is alone, wherever it stands."""

from dataclasses import replace

import numpy as np
import pytest

from openprc.demlat import run_ensemble
from openprc.errors import ConfigError, Diverged, UnsupportedScene
from openprc.schema.experiment import Actuator, Collision, Signal
from openprc.schema.geometry import Bars, Geometry, Hinges

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0.5, 0.9, 0.1], [0.5, -0.9, 0.2]], dtype=float)
PAIRS = [[0, 1], [0, 2], [1, 2], [0, 3], [1, 3]]


@pytest.fixture(scope="module")
def make():
    from openprc.schema.experiment import Experiment

    def scene(number, **settings):
        rng = np.random.default_rng(number)
        lengths = np.linalg.norm(
            CORNERS[[j for _, j in PAIRS]] - CORNERS[[i for i, _ in PAIRS]], axis=1
        )
        geometry = Geometry(
            positions=CORNERS,
            masses=rng.uniform(0.5, 2.0, 4),
            fixed=[True, False, False, False],
            bars=Bars(
                indices=PAIRS,
                stiffness=rng.uniform(50, 150, 5),
                rest_length=lengths * rng.uniform(0.95, 1.05, 5),
                damping=rng.uniform(0, 1, 5),
            ),
            hinges=Hinges(
                indices=[[0, 1, 2, 3]],
                stiffness=rng.uniform(1, 3, 1),
                rest_angle=rng.uniform(2.8, 3.5, 1),
                damping=[0.01],
            ),
        )
        symbols = Signal(
            name="u", values=rng.uniform(-1, 1, 8), dt=0.05, interpolation="hold", unit="N"
        )
        drive = Actuator(node=2, signal="u", type="force", axes=(False, False, True))
        base = {
            "geometry": geometry,
            "signals": {"u": symbols},
            "actuators": (drive,),
            "gravity": (0.0, 0.0, -1.0),
            "damping": 0.1,
            "duration": 0.4,
            "dt": 2e-3,
            "save_interval": 0.02,
        }
        return Experiment(**(base | settings))

    return scene


def test_every_scene_is_what_it_is_alone(make, simulate):
    scenes = [make(number) for number in range(11)]
    result = run_ensemble(scenes)
    assert result.positions.shape == (11, 21, 4, 3)
    assert np.isnan(result.diverged).all()
    for number in (0, 7, 10):
        alone = simulate(scenes[number])
        np.testing.assert_allclose(result.positions[number], alone.x, rtol=0, atol=1e-13)
        np.testing.assert_allclose(result.velocities[number], alone.v, rtol=0, atol=1e-12)


def test_lane_block_and_thread_do_not_matter(make):
    scenes = [make(number) for number in range(9)]
    one = run_ensemble(scenes, threads=1)
    other = run_ensemble(scenes[::-1] + scenes[:4], threads=3)
    assert np.array_equal(other.positions[:9], one.positions[::-1])
    assert np.array_equal(other.positions[9:], one.positions[:4])
    assert np.array_equal(other.velocities[:9], one.velocities[::-1])


def test_single_precision_keeps_the_displacements(make):
    # A millimetre of motion ten metres from the origin: coordinates in float32 would leave
    # some three digits of it.
    def far(number):
        scene = make(number, gravity=(0.0, 0.0, -1e-3))
        geometry = replace(
            scene.geometry,
            positions=CORNERS + 10.0,
            bars=replace(scene.geometry.bars, prestress=np.zeros(5)),
        )
        lengths = np.linalg.norm(np.diff(CORNERS[PAIRS], axis=1)[:, 0], axis=1)
        bars = replace(geometry.bars, rest_length=lengths)
        return replace(scene, geometry=replace(geometry, bars=bars), actuators=(), signals={})

    scenes = [far(number) for number in range(3)]
    fine, coarse = run_ensemble(scenes), run_ensemble(scenes, precision="float32")
    motion = np.abs(fine.positions - fine.positions[:, :1]).max()
    assert 1e-6 < motion < 0.5
    assert np.abs(coarse.positions - fine.positions).max() < 3e-5 * motion


def test_a_scene_that_diverges_leaves_the_others(make):
    scenes = [make(0), make(1), make(2)]
    bars = replace(scenes[1].geometry.bars, stiffness=np.full(5, 1e9))
    scenes[1] = replace(
        scenes[1], geometry=replace(scenes[1].geometry, bars=bars), step_check="warn"
    )
    scenes = [replace(scene, step_check="warn") for scene in scenes]
    with pytest.raises(Diverged, match=r"1 of 3 scenes .* scene 1 by t = "):
        run_ensemble(scenes)
    result = run_ensemble(scenes, on_divergence="mark")
    assert list(np.isnan(result.diverged)) == [True, False, True]
    assert np.isnan(result.positions[1, -1]).all()
    assert np.isfinite(result.positions[[0, 2]]).all()
    assert np.array_equal(result.positions[2], run_ensemble([scenes[2]]).positions[0])


def test_progress_is_reported(make):
    seen = []
    run_ensemble([make(n) for n in range(9)], progress=lambda *args: seen.append(args))
    assert seen[-1] == (1.0, "9 of 9 scenes")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"dt": 1e-3}, "scene 1 has another dt"),
        ({"precision": "float32"}, "scene 1 has another precision"),
    ],
)
def test_scenes_must_share_times(make, change, words):
    with pytest.raises(ConfigError, match=words):
        run_ensemble([make(0), make(1, **change)])


def test_scenes_must_share_elements(make):
    other = make(1)
    bars = replace(other.geometry.bars, law=np.array(["cable"] * 5))
    other = replace(other, geometry=replace(other.geometry, bars=bars))
    with pytest.raises(ConfigError, match=r"scene 1 has other bars \(law\)"):
        run_ensemble([make(0), other])


def test_rigid_elements_of_any_scene_are_seen(make):
    soft, other = make(0, integrator="rattle"), make(1, integrator="rattle")
    bars = replace(other.geometry.bars, rigid=[True, *[False] * 4])
    stiff = replace(other, geometry=replace(other.geometry, bars=bars))
    with pytest.raises(ConfigError, match=r"scene 1 has other bars \(rigid\)"):
        run_ensemble([soft, stiff])
    with pytest.raises(UnsupportedScene, match="rigid elements"):
        run_ensemble([stiff, stiff])


def test_what_an_ensemble_cannot_do_is_refused(make):
    scene = make(0)
    with pytest.raises(ConfigError, match="0 threads"):
        run_ensemble([scene], threads=0)
    with pytest.raises(ConfigError, match="no experiments"):
        run_ensemble([])
    with pytest.raises(ConfigError, match="'raise' or 'mark'"):
        run_ensemble([scene], on_divergence="ignore")
    touching = replace(
        scene,
        geometry=replace(scene.geometry, collidable=np.ones(4, dtype=bool)),
        collision=Collision(enabled=True, radius=0.01),
    )
    with pytest.raises(UnsupportedScene, match="scene 0 has contact"):
        run_ensemble([touching])
