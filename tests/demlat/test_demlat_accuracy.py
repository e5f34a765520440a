"""An accuracy is met, on scenes whose motion is known, at a cost that is not absurd."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from openprc.demlat import BarHingeModel
from openprc.demlat.planning.accuracy import choose_for_accuracy, settled
from openprc.demlat.planning.accuracy_check import estimate_error
from openprc.demlat.planning.accuracy_pilot import error_curve
from openprc.schema import Experiment
from openprc.schema.experiment import AUTO, Actuator, Signal
from openprc.schema.geometry import Bars, Geometry
from openprc.testing.closed_form_scenes import oscillator

ACCURACIES = (1e-2, 1e-4, 1e-6, 1e-8)


def open_to(accuracy, experiment, integrator=AUTO):
    return replace(
        experiment,
        accuracy=accuracy,
        integrator=integrator,
        dt=experiment.save_interval,
        dt_stated=False,
    )


def frames(experiment):
    model = BarHingeModel(experiment, backend="cpu")
    return np.concatenate([block.x.copy() for _, block in model.blocks()])


def error_against(positions, truth):
    return error_curve(positions, truth[..., : positions.shape[2]]).max()


def achieved(experiment, truth):
    return error_against(frames(settled(experiment)), truth)


def driven(interpolation, *, type="force", drag=0.4):
    """A mass on a spring under a signal of 12 samples, which no step was chosen for."""
    values = np.random.default_rng(3).uniform(-1.0, 1.0, 12)
    place = 1.0 + 0.05 * values if type == "position" else values
    bars = Bars(indices=[[0, 1], [1, 2]], stiffness=[50.0, 50.0], rest_length=[1.0, 1.0])
    return Experiment(
        geometry=Geometry(
            positions=[[0, 0, 0], [1, 0, 0], [2, 0, 0]],
            masses=[1, 1, 1],
            fixed=[type == "force", False, False],
            bars=bars,
        ),
        signals={"u": Signal(name="u", values=place - (type == "position"), dt=0.25,
                             interpolation=interpolation)},
        actuators=(Actuator(node=0 if type == "position" else 2, signal="u", type=type,
                            axes=(True, type == "position", type == "position")),),
        duration=3.0, dt=0.01, save_interval=0.05, damping=drag,
    )  # fmt: skip


@pytest.mark.parametrize("accuracy", ACCURACIES)
@pytest.mark.parametrize("damping", [0.0, 0.5])
def test_an_oscillator_is_as_exact_as_asked_for(accuracy, damping):
    scene = oscillator(1.0, damping=damping)
    error = achieved(open_to(accuracy, scene.experiment), scene.exact(scene.experiment.frame_times))
    assert accuracy / 1000.0 < error <= accuracy


@pytest.mark.parametrize("accuracy", [1e-2, 1e-6])
def test_the_error_at_the_end_of_a_long_run_is_extrapolated(accuracy):
    scene = oscillator(1.0)
    experiment = open_to(accuracy, replace(scene.experiment, duration=60.0))
    choice = choose_for_accuracy(experiment, seconds=1e-4)
    assert choice.pilot_duration < 0.6 * choice.duration
    chosen = replace(
        experiment, accuracy=None, dt_stated=True, integrator=choice.integrator, dt=choice.dt,
        tolerance=choice.tolerance,
    )  # fmt: skip
    error = error_against(frames(chosen), scene.exact(experiment.frame_times))
    assert accuracy / 1000.0 < error <= accuracy


@pytest.mark.parametrize("kind", ["hold", "linear", "cubic", "position"])
@pytest.mark.parametrize("accuracy", [1e-3, 1e-7])
def test_driven_scenes_are_as_exact_as_asked_for(kind, accuracy):
    scene = driven("linear", type="position") if kind == "position" else driven(kind)
    truth = frames(replace(scene, integrator="dop853", tolerance=1e-13))
    assert achieved(open_to(accuracy, scene), truth) <= accuracy


@pytest.mark.parametrize("integrator", ["verlet", "rk4", "rk45", "pefrl"])
def test_an_integrator_that_is_named_is_kept(integrator):
    scene = oscillator(1.0)
    experiment = open_to(1e-3, scene.experiment, integrator)
    choice = choose_for_accuracy(experiment)
    assert choice.integrator == integrator
    assert [one.name for one in choice.candidates] == [integrator]
    truth = scene.exact(scene.experiment.frame_times)
    assert 1e-6 < achieved(experiment, truth) <= 1e-3


def test_the_same_experiment_gets_the_same_choice_and_bits():
    one, two = (open_to(1e-4, driven("hold")) for _ in range(2))
    assert choose_for_accuracy(one) == choose_for_accuracy(two)
    np.testing.assert_array_equal(frames(settled(one)), frames(settled(two)))


def test_the_note_says_what_was_chosen_and_why():
    experiment = open_to(1e-4, oscillator(1.0).experiment)
    choice = choose_for_accuracy(experiment)
    (note,) = settled(experiment).notes
    assert note == choice.note
    for words in ("accuracy 0.0001", choice.integrator, "estimated error", "times as much"):
        assert words in note
    assert choice.as_dict()["note"] == note
    assert choice.promised


def test_steps_fall_on_the_samples_of_signals():
    chosen = settled(open_to(1e-5, driven("hold"), "rk4"))
    assert (0.25 / chosen.dt) == pytest.approx(round(0.25 / chosen.dt), abs=1e-9)


def test_rigid_bars_get_a_scheme_for_constraints():
    rigid = Bars(indices=[[0, 1], [1, 2]], stiffness=[1, 1], rest_length=[1, 1], rigid=[1, 1])
    chain = Experiment(
        geometry=Geometry(
            positions=[[0, 0, 0], [1, 0, 0], [2, 0, 0]], masses=[1, 1, 1], fixed=[1, 0, 0],
            bars=rigid,
        ),
        duration=1.0, dt=0.01, save_interval=0.05, gravity=(0.0, 0.0, -9.81),
    )  # fmt: skip
    truth = frames(replace(chain, integrator="rk4-dae", dt=0.05 / 400))
    for accuracy in (1e-2, 1e-5):
        experiment = open_to(accuracy, chain)
        assert choose_for_accuracy(experiment).integrator in ("rattle", "rk4-dae")
        assert achieved(experiment, truth) <= accuracy


def test_an_estimate_of_its_own_is_close_to_the_error():
    scene = oscillator(1.0)
    for integrator, dt in (("verlet", 0.02), ("rk4", 0.02)):
        run = replace(scene.experiment, integrator=integrator, dt=dt)
        error = error_against(frames(run), scene.exact(run.frame_times))
        assert estimate_error(run).error == pytest.approx(error, rel=0.2)


def test_a_body_at_rest_has_no_error():
    bars = Bars(indices=[[0, 1]], stiffness=[50.0], rest_length=[1.0])
    body = Geometry(positions=[[0, 0, 0], [1, 0, 0]], masses=[1, 1], fixed=[1, 0], bars=bars)
    still = Experiment(geometry=body, duration=1.0, dt=0.1, save_interval=0.1)
    assert choose_for_accuracy(open_to(1e-8, still)).error == 0.0
