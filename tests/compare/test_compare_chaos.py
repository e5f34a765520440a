"""Growth laws told apart on closed forms, and twins of bodies with and without chaos."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from openprc.compare.chaos.growth import measure_growth, time_of_share
from openprc.compare.chaos.judgement import judge_difference
from openprc.compare.chaos.twins import displacements, twin_study
from openprc.errors import ConfigError
from openprc.hooks import run_experiment
from openprc.scenes.catalog import build_scene, write_scene
from openprc.schema import Provenance, TrajectoryWriter
from openprc.testing import closed_form_scenes

TIMES = np.linspace(0.0, 20.0, 2001)


@pytest.mark.parametrize("rate", [0.5, 1.0, 4.0])
def test_the_rate_of_an_exponential_is_found(rate):
    noise = np.exp(0.3 * np.sin(17.0 * TIMES))
    growth = measure_growth(TIMES, 1e-12 * np.exp(rate * TIMES) * noise)
    assert growth.kind == "exponential"
    assert growth.rate == pytest.approx(rate, rel=0.05)
    assert abs(growth.rate - rate) < 4.0 * growth.uncertainty + 0.02


@pytest.mark.parametrize(
    ("differences", "kind"),
    [
        (1e-9 * (1.0 + 40.0 * TIMES), "algebraic"),
        (1e-9 * (1.0 + 40.0 * TIMES**2), "algebraic"),
        (1e-9 * (1.0 + 40.0 * TIMES) * np.abs(np.sin(9.0 * TIMES)) + 1e-12, "algebraic"),
        (1e-9 * (2.0 + np.cos(3.0 * TIMES)), "bounded"),
        (1e-9 * np.exp(-TIMES), "decaying"),
        (1e-9 * (1.0 + 1e5 / (1.0 + np.exp(-40.0 * (TIMES - 7.3)))), "algebraic"),  # one burst
    ],
    ids=["line", "parabola", "vibration that grows", "vibration", "decay", "snap"],
)
def test_other_growth_is_not_called_exponential(differences, kind):
    assert measure_growth(TIMES, differences).kind == kind


def test_saturation_does_not_count():
    grown = np.minimum(1e-9 * np.exp(3.0 * TIMES), 0.3)
    growth = measure_growth(TIMES, grown)
    assert growth.kind == "exponential"
    assert growth.rate == pytest.approx(3.0, rel=0.05)
    assert growth.window[1] == pytest.approx(np.log(1e7) / 3.0, abs=0.02)


def test_too_little_to_tell_is_none():
    assert measure_growth(TIMES, np.zeros_like(TIMES)) is None
    assert measure_growth(TIMES, np.full_like(TIMES, 0.5)) is None
    assert measure_growth(TIMES[:5], 1e-9 * np.ones(5)) is None


def test_the_time_of_a_share():
    assert time_of_share([0.0, 1.0, 2.0], [0.1, 0.5, 0.9], share=0.5) == 1.0
    assert time_of_share([0.0, 1.0], [0.1, 0.5], share=0.6) is None


@pytest.fixture(scope="module")
def chain_twins():
    """Twins of the chain that is let go aside: several decades of growth."""
    scene = build_scene("swinging-chain", {"duration": 4.5, "stiffness": 1e4})
    return scene, twin_study(scene.experiment, scale=scene.scale)


def test_the_swinging_chain_is_chaotic(chain_twins):
    _, twins = chain_twins
    assert twins.chaotic
    assert twins.growth.decades > 3.0
    assert twins.linearity == pytest.approx(1.0, abs=0.05)
    assert twins.separations[:, 0] == pytest.approx(twins.sizes, rel=1e-4)
    assert twins.amplification[0] == 1.0
    told = twins.as_dict()
    assert told["chaotic"] is True
    assert len(told["times_s"]) <= 500


@pytest.mark.parametrize("name", ["oscillator", "pendulum"])
def test_integrable_bodies_are_not_chaotic(name):
    scene = getattr(closed_form_scenes, name)(1.0)
    experiment = replace(scene.experiment, duration=60.0)  # 60 and 26 periods
    twins = twin_study(experiment, scale=scene.scale)
    assert not twins.chaotic
    assert twins.growth.kind == {"oscillator": "bounded", "pendulum": "algebraic"}[name]


def test_rigid_bars_take_a_displacement():
    scene = closed_form_scenes.pendulum(1.0, rigid=True)
    twins = twin_study(scene.experiment, scale=scene.scale)
    assert not twins.chaotic
    assert twins.linearity == pytest.approx(1.0, abs=1e-3)


def test_displacements_stay_in_the_plane_of_the_motion(tmp_path):
    scene = build_scene("swinging-chain", {"duration": 0.2, "stiffness": 1e3})
    write_scene(scene, tmp_path)
    pattern = displacements(scene.experiment, run_experiment(tmp_path).path)
    assert not pattern[0].any()  # the pivot
    assert np.abs(pattern[:, 1]).max() < 1e-9
    assert np.sqrt((pattern**2).sum(axis=1).mean()) == pytest.approx(1.0)


def test_a_body_at_rest_has_no_twins(tmp_path):
    experiment = closed_form_scenes.rest(1.0).experiment
    path = tmp_path / "still.h5"
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_nodes(4, 3, unit="m")
        writer.append([0.0, 1.0], positions=np.stack([experiment.geometry.positions] * 2))
    with pytest.raises(ConfigError, match="nothing moves in this run"):
        displacements(experiment, path)
    geometry = replace(experiment.geometry, fixed=np.ones(4, bool))
    with pytest.raises(ConfigError, match="no node is free to move"):
        displacements(replace(experiment, geometry=geometry), path)


# --- what a difference means --------------------------------------------------------------------


def test_a_difference_that_twins_explain_is_chaos(chain_twins):
    scene, twins = chain_twins
    rms = 1e-6 * scene.scale * np.interp(TIMES, twins.times, twins.amplification)
    judged = judge_difference(TIMES, rms, scale=scene.scale, twins=twins)
    assert judged.verdict == "chaos"
    assert judged.like_start == pytest.approx(1e-6, rel=0.5)
    assert "not a fault" in judged.text
    assert judged.rms_before < 0.01 * scene.scale
    assert 0.0 < judged.horizon < scene.experiment.duration


def test_a_wrong_model_in_a_chaotic_body_is_not_excused(chain_twins):
    scene, twins = chain_twins
    rms = 0.02 * scene.scale * TIMES  # a per cent within half a second
    judged = judge_difference(TIMES, rms, scale=scene.scale, twins=twins)
    assert judged.verdict == "differs"
    assert judged.horizon == pytest.approx(0.5)
    assert "chaos is not why: twins part only" in judged.text


def test_agreement_in_a_chaotic_body_has_an_end(chain_twins):
    scene, twins = chain_twins
    rms = 1e-8 * scene.scale * np.ones_like(TIMES)
    judged = judge_difference(TIMES, rms, scale=scene.scale, twins=twins)
    assert judged.verdict == "agrees"
    assert judged.horizon is None
    later = TIMES[-1] + np.log(1e6) / twins.growth.rate
    assert judged.expected_horizon == pytest.approx(later)


def test_without_twins_growth_is_only_warned_of():
    rms = 1e-9 * np.exp(2.0 * TIMES)
    judged = judge_difference(TIMES, np.minimum(rms, 0.5), scale=1.0)
    assert judged.verdict == "grows"
    assert "may be chaos" in judged.text
    steady = judge_difference(TIMES, 0.001 * TIMES, scale=1.0)
    assert steady.verdict == "differs"
    assert judge_difference(TIMES, 1e-5 * np.ones_like(TIMES), scale=1.0).verdict == "agrees"


def test_equilibria_beside_a_run_in_time_are_no_fault():
    times = np.linspace(0.0, 10.0, 101)
    apart = np.exp(-times) * np.abs(np.cos(3.0 * times))
    judged = judge_difference(times, apart, scale=1.0, equilibria=True)
    assert judged.verdict == "quasi-static"
    assert "no inertia" in judged.text
    assert judge_difference(times, apart, scale=1.0).verdict == "differs"


def test_gaps_are_left_out():
    rms = 0.001 * TIMES
    rms[::3] = np.nan
    judged = judge_difference(TIMES, rms, scale=1.0)
    assert judged.horizon == pytest.approx(10.0, abs=0.02)
    assert np.isfinite(judged.rms_before)
