"""Studies of an oscillator, of which theory says what they have to find."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from openprc.errors import ConfigError, TaskError
from openprc.hooks import run_experiment
from openprc.schema import Trajectory
from openprc.testing.closed_form_scenes import oscillator
from openprc.tradeoff import workbench
from openprc.tradeoff.choices import Choices
from openprc.tradeoff.outcome import relative_error
from openprc.tradeoff.recommendation import recommend
from openprc.tradeoff.study import run_study
from openprc.tradeoff.study_files import save_study
from openprc.tradeoff.subject import as_scene, find_subject

CLOSED = oscillator(1.0, damping=0.2)
#: Frames are so far apart that steps of a whole frame are unstable: w h = 4.
SCENE = as_scene(
    replace(CLOSED.experiment, duration=4.0, save_interval=0.4, dt=0.01), name="oscillator"
)


def choices(folder=None, **more):
    given = {"groups": ("integrator",), "integrators": ("rk4",), "rounds": 1, "folder": folder}
    return Choices(**given | more)


@pytest.fixture(scope="module")
def study():
    return run_study(SCENE, choices())


def test_errors_fall_by_the_order_of_the_scheme(study):
    good = [p for p in study.points if p.status == "ok" and p.trajectory_error < 1e-2]
    assert len(good) >= 4
    counts = np.log([p.evaluations for p in good])
    slope = np.polyfit(counts, np.log([p.trajectory_error for p in good]), 1)[0]
    assert slope == pytest.approx(-4.0, abs=0.2)


def test_a_step_costs_what_it_evaluates(study):
    frames = SCENE.experiment.n_frames - 1
    for p in study.points:
        if p.evaluations is not None:
            assert p.evaluations == 4 * frames * p.setting["steps_per_frame"]


def test_errors_are_those_of_the_closed_form(study):
    point = study.front[-1]
    # Twice the steps: 16 times the accuracy; the formula is the judge.
    from openprc.tradeoff.outcome import run_in_memory
    from openprc.tradeoff.settings import configured

    outcome = run_in_memory(configured(SCENE.experiment, point.setting))
    exact = CLOSED.exact(SCENE.experiment.frame_times)
    assert relative_error(outcome.positions, exact) == pytest.approx(
        point.trajectory_error, rel=0.05
    )


def test_what_blows_up_is_recorded_and_advised_to_nobody(study):
    first = study.points[0]
    assert first.setting["step_check"] == "warn"
    # With w h = 4 rk4 multiplies the amplitude by some 5 every step.
    assert first.status == "diverged" or "above the stability limit" in first.note
    assert first not in study.advisable
    assert all("step_check" not in p.setting for p in study.front)


def test_a_divergence_is_a_point_and_no_exception():
    long = as_scene(replace(SCENE.experiment, duration=40.0), name="long")
    found = run_study(long, choices(longest=0.5, target=1e-2))
    blown = [p for p in found.points if p.status == "diverged"]
    assert blown
    assert all(p.trajectory_error is None and p.note for p in blown)
    json.dumps(found.as_dict(), allow_nan=False)


def test_the_cheapest_setting_meets_the_target_in_a_run_of_its_config(tmp_path):
    target = 1e-4
    found = run_study(SCENE, choices(tmp_path, target=target))
    advice = recommend(found, target, folder=tmp_path)
    assert advice.reached
    assert advice.verified_error <= target
    run = run_experiment(advice.folder)
    with Trajectory(run.path) as trajectory:
        positions = np.zeros((trajectory.n_frames, trajectory.n_nodes, 3))
        positions[..., : trajectory.dims] = trajectory.positions()
    wrong = relative_error(positions, CLOSED.exact(SCENE.experiment.frame_times))
    assert wrong <= target * 1.001


def test_refinement_is_closer_to_the_target_than_doubling():
    target = 1e-4
    found = run_study(SCENE, choices(target=target))
    # A rung of twice the steps could be 16 times too exact.
    reaching = [e for e in (p.trajectory_error for p in found.advisable) if e and e <= target]
    assert max(reaching) > target / 2.0


def test_an_unreachable_target_says_what_limits(study):
    below = recommend(study, study.reference.floor / 2.0)
    assert not below.reached
    assert "the reference is good to" in below.limit
    coarse = replace(study, points=study.points[:3])
    missed = recommend(coarse, study.points[3].trajectory_error / 2.0)
    assert not missed.reached
    assert missed.point.trajectory_error == min(
        p.trajectory_error for p in coarse.advisable if p.trajectory_error is not None
    )
    assert missed.limit


def test_a_run_that_does_not_hold_what_was_measured_is_rejected(study):
    liar = replace(study.front[0], trajectory_error=1e-7, cpu_seconds=1e-9)
    advice = recommend(replace(study, points=(liar, *study.points)), 1e-6)
    assert advice.reached
    assert advice.point != liar
    assert "its run is wrong by" in advice.rejected[0]


class StoppedError(Exception):
    """Stands for Ctrl-C."""


def test_after_an_interruption_finished_points_are_not_run_again(tmp_path, monkeypatch):
    run, calls = workbench.run_in_memory, []

    def interrupted(experiment, **kwargs):
        if experiment.duration == SCENE.experiment.duration:
            if len(calls) == 12:
                raise StoppedError
            calls.append(experiment.steps_per_frame)
        return run(experiment, **kwargs)

    monkeypatch.setattr(workbench, "run_in_memory", interrupted)
    with pytest.raises(StoppedError):
        run_study(SCENE, choices(tmp_path))
    kept = (tmp_path / "points.jsonl").read_text().splitlines()
    assert len(kept) >= 4
    finished = set(calls[:-3])
    calls.clear()
    monkeypatch.setattr(
        workbench, "run_in_memory", lambda e, **k: (calls.append(e.steps_per_frame), run(e, **k))[1]
    )
    resumed = run_study(SCENE, choices(tmp_path))
    assert not finished & set(calls[1:])
    settings = [json.dumps(dict(p.setting)) for p in resumed.points]
    assert len(settings) == len(set(settings))
    assert resumed.n_measured == len(settings) - (len(kept) - 1)
    calls.clear()
    assert run_study(SCENE, choices(tmp_path)).n_measured == 0
    assert calls == []


def test_a_folder_of_another_scene_is_refused(tmp_path):
    run_study(SCENE, choices(tmp_path, longest=0.01))
    other = as_scene(replace(SCENE.experiment, damping=0.5), name="other")
    with pytest.raises(ConfigError, match="the reference is of another scene"):
        run_study(other, choices(tmp_path))
    (tmp_path / "reference.npz").unlink()
    with pytest.raises(ConfigError, match="the points are of another scene"):
        run_study(other, choices(tmp_path))
    (tmp_path / "reference.npz").write_bytes(b"PK no archive")
    with pytest.raises(ConfigError, match="this is no reference of a trade-off study"):
        run_study(SCENE, choices(tmp_path))


def test_a_spent_budget_keeps_what_was_measured(tmp_path):
    found = run_study(SCENE, choices(tmp_path, budget=1e-9))
    assert "the budget of 1e-09 s was spent" in found.left_out[0]
    assert run_study(SCENE, choices(tmp_path)).left_out == ()


def test_what_was_measured_is_saved_whole(tmp_path):
    found = run_study(SCENE, choices(tmp_path, target=1e-4))
    advice = recommend(found, 1e-4, folder=tmp_path)
    written = save_study(found, advice, tmp_path)
    told = json.loads(written[0].read_text())
    assert told["recommendation"]["reached"] is True
    assert all(
        p["trajectory_error"] is None or math.isfinite(p["trajectory_error"])
        for p in told["points"]
    )
    assert sum(p["on_front"] for p in told["points"]) == len(found.front)
    assert written[1].read_bytes().startswith(b"\x89PNG")
    assert not list(tmp_path.glob("**/*.partial"))


def test_names_are_checked():
    with pytest.raises(ConfigError, match="the group 'speed'"):
        choices(groups=("speed",))
    with pytest.raises(ConfigError, match="the integrator 'euler'"):
        choices(integrators=("euler",))
    with pytest.raises(ConfigError, match="the scene 'oscilator'"):
        find_subject("oscilator")
    with pytest.raises(TaskError, match="with the metric 'ipc'"):
        run_study(SCENE, choices(metric="ipc"))


@pytest.mark.slow
def test_a_device_that_is_not_there_is_a_refused_point(monkeypatch):
    from openprc.demlat.backends import devices

    absent = devices.probe_cuda()
    if absent.usable:
        pytest.skip("this machine has a CUDA device")
    found = run_study(SCENE, choices(groups=("backend",), longest=0.05))
    status = {p.label: p for p in found.points}
    assert status["rk4 on cpu"].status == "ok"
    assert status["rk4 on cuda"].status == "refused"
    assert status["rk4 on cuda"].note
