"""What an accuracy cannot be, who cannot be asked for one, and how a run is asked for it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from openprc.cli.info import command as info
from openprc.cli.run import command as run
from openprc.demlat import BarHingeModel, Engine, SimulationSetup, run_ensemble
from openprc.demlat.forces import ForceField
from openprc.demlat.planning.accuracy import choose_for_accuracy
from openprc.demlat.planning.accuracy_check import estimate_error
from openprc.demlat.planning.accuracy_growth import grown, judge_twin
from openprc.demlat.planning.accuracy_schemes import steps_unit
from openprc.demlat.producer import DemlatProducer
from openprc.demlat.stepping import SteppedExperiment
from openprc.errors import ConfigError, UnsupportedScene
from openprc.hooks.running import settle
from openprc.schema import Trajectory, load_experiment
from openprc.schema.experiment import AUTO, Actuator, Collision, Signal
from openprc.schema.geometry import Geometry
from openprc.testing.closed_form_scenes import oscillator


def asked(accuracy=1e-4, **changes):
    scene = oscillator(1.0).experiment
    return replace(
        scene, **{"accuracy": accuracy, "integrator": AUTO, "dt": 0.02, "dt_stated": False}
        | changes,
    )  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    setup = SimulationSetup(tmp_path / "spring", overwrite=True)
    ends = setup.add_node([0, 0, 0], fixed=True), setup.add_node([1.1, 0, 0], mass=0.5)
    setup.add_bar(*ends, stiffness=50.0, rest_length=1.0)
    setup.set_simulation_params(duration=1.0, save_interval=0.02, accuracy=1e-4)
    setup.save()
    return tmp_path / "spring"


# --- out of reach -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("accuracy", "changes"), [(1e-15, {}), (1e-9, {"precision": "float32", "integrator": "rk4"})]
)
def test_what_rounding_forbids_is_out_of_reach(accuracy, changes):
    with pytest.raises(ConfigError, match="out of reach") as caught:
        choose_for_accuracy(asked(accuracy, **changes))
    least = float(caught.value.expected.split()[2])
    assert accuracy < least < 1e-3
    # What the message says can be had can be had.
    assert choose_for_accuracy(asked(least, **changes)).error <= least


def test_old_runs_have_no_accuracy():
    with pytest.raises(ConfigError, match="with the integrator 'legacy'"):
        choose_for_accuracy(asked(integrator="legacy"))
    with pytest.raises(ConfigError, match="error estimate for the integrator 'legacy'"):
        estimate_error(replace(asked(), accuracy=None, dt_stated=True, integrator="legacy"))


def test_an_integrator_that_cannot_run_the_scene_is_refused():
    scene = asked(integrator="rk4")
    rigid = replace(scene.geometry.bars, rigid=np.array([True]))
    with pytest.raises(UnsupportedScene, match="1 rigid bars with the integrator 'rk4'"):
        choose_for_accuracy(replace(scene, geometry=replace(scene.geometry, bars=rigid)))


def test_without_an_accuracy_nothing_is_chosen():
    with pytest.raises(ConfigError, match="no accuracy"):
        choose_for_accuracy(oscillator(1.0).experiment)


def test_contact_is_estimated_and_not_promised():
    ball = asked(
        1e-2,
        integrator="rk4",  # every other one would be compiled with contact
        geometry=Geometry(
            positions=[[0, 0, 0.3], [-1, -1, 0], [1, -1, 0], [0, 1, 0]], masses=[0.1, 1, 1, 1],
            fixed=[0, 1, 1, 1], collidable=[1, 0, 0, 0], faces=[[1, 2, 3]],
        ),
        gravity=(0.0, 0.0, -9.81), duration=0.5,
        collision=Collision(enabled=True, radius=0.05, restitution=0.8, faces=True),
    )  # fmt: skip
    choice = choose_for_accuracy(ball)
    assert not choice.promised
    assert "contact" in choice.remarks[0]


# --- growth -----------------------------------------------------------------------------------

TIMES = np.linspace(0.0, 1.0, 65)


def test_errors_grow_as_the_motion_lets_them():
    assert grown(TIMES, 10.0, damped=False) == pytest.approx(10.0)
    assert grown(TIMES**2, 10.0, damped=False) == pytest.approx(100.0)
    assert grown(np.minimum(TIMES, 0.2), 10.0, damped=True) == pytest.approx(0.2)
    assert grown(TIMES**2, 10.0, damped=True) == pytest.approx(10.0)
    assert grown(TIMES, 1.0, damped=False) == 1.0


def test_exponential_growth_is_told_from_that_of_a_phase():
    assert not judge_twin(1e-7 * TIMES, TIMES).unstable
    assert not judge_twin(1e-7 * TIMES**2, TIMES).unstable
    chaotic = judge_twin(1e-9 * np.expm1(12.0 * TIMES), TIMES)
    assert chaotic.rate == pytest.approx(12.0, rel=0.05)


# --- steps ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("dt", "interpolation", "unit"),
    [(0.03, "hold", 2), (0.04, "hold", 1), (0.015, "linear", 4), (0.015, "cubic", 1)],
)
def test_how_many_steps_a_frame_has_to_be_divided_into(dt, interpolation, unit):
    signal = Signal(name="u", values=np.arange(8.0), dt=dt, interpolation=interpolation)
    push = Actuator(node=1, signal="u", type="force", axes=(True, False, False))
    assert steps_unit(asked(signals={"u": signal}, actuators=(push,))) == unit


# --- others -----------------------------------------------------------------------------------


def test_ensembles_and_stepped_bodies_want_a_step():
    with pytest.raises(UnsupportedScene, match=r"an accuracy of 0\.0001 in an ensemble"):
        run_ensemble([asked()])
    held = Signal(name="u", values=[0.0], dt=1.0)
    push = Actuator(node=1, signal="u", type="force", axes=(True, False, False))
    with pytest.raises(UnsupportedScene, match="in a body that is stepped"):
        SteppedExperiment(
            asked(signals={"u": held}, actuators=(push,)), hold=0.1, sensors=["bar_extensions"]
        )


def test_forces_do_not_need_a_step():
    open_, stated = ForceField(asked()), ForceField(oscillator(1.0).experiment)
    places = asked().geometry.positions + 0.01
    still = np.zeros_like(places)
    np.testing.assert_array_equal(open_(places, still), stated(places, still))


class Foreign:
    """A producer that takes the step that it is told."""


def test_other_producers_run_with_the_step_that_was_stated():
    settled = settle(asked(dt_stated=True), Foreign(), producer="foreign")
    assert (settled.accuracy, settled.dt, settled.integrator) == (None, 0.02, "rk4")
    assert "not foreign's to choose a step for" in settled.notes[0]
    with pytest.raises(UnsupportedScene, match="foreign does not choose one") as caught:
        settle(asked(), Foreign(), producer="foreign")
    assert "--producer demlat" in caught.value.fix
    with pytest.raises(UnsupportedScene, match="does not estimate the error"):
        settle(asked(dt_stated=True), Foreign(), producer="foreign", verify=True)


def test_the_engine_says_what_it_supports_before_it_has_chosen():
    assert DemlatProducer().supports(asked()) == []


# --- from file to file ------------------------------------------------------------------------


def test_a_run_notes_the_choice_and_keeps_what_was_asked(folder):
    result = Engine(BarHingeModel, backend="cpu").run(folder, verify=True)
    text = "\n".join(result.notes)
    assert "accuracy 0.0001" in text
    assert "verified: the error of the run is about" in text
    with Trajectory(result.path) as trajectory:
        assert trajectory.provenance["config"]["asked"] == {"accuracy": 1e-4}


def test_the_command_line_asks_plans_and_shows(folder):
    shown = CliRunner().invoke(info, [str(folder), "--json"])
    assert json.loads(shown.stdout)["accuracy"] == 1e-4
    plan = CliRunner().invoke(run, [str(folder), "--plan", "--json", "--accuracy", "1e-6"])
    choice = json.loads(plan.stdout)["accuracy"]
    assert choice["accuracy"] == 1e-6
    assert choice["error"] <= 1e-6
    table = CliRunner().invoke(run, [str(folder), "--plan", "--integrator", "verlet"])
    assert "verlet with steps of" in table.stdout
    done = CliRunner().invoke(
        run, [str(folder), "--accuracy", "1e-3", "--integrator", "verlet", "--json"]
    )
    assert "accuracy 0.001: verlet with steps of" in done.stdout


def test_a_setup_takes_an_accuracy_instead_of_a_step(folder, tmp_path):
    experiment = load_experiment(folder)
    assert (experiment.accuracy, experiment.integrator) == (1e-4, AUTO)
    again = SimulationSetup(folder)
    again.save(tmp_path / "copy")
    assert load_experiment(tmp_path / "copy").settings() == experiment.settings()
    with pytest.raises(ConfigError, match="no dt") as caught:
        again.set_simulation_params(duration=1.0, save_interval=0.1)
    assert "or an accuracy" in caught.value.expected
