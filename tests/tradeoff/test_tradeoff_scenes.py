"""The advice holds on bodies of the library: a run of the config meets the target."""

import numpy as np
import pytest

from openprc.hooks import run_experiment
from openprc.schema import Trajectory
from openprc.tradeoff.choices import Choices
from openprc.tradeoff.outcome import relative_error
from openprc.tradeoff.recommendation import recommend
from openprc.tradeoff.study import run_study
from openprc.tradeoff.subject import find_subject

SCENES = {
    "damped-oscillator": ("rk4", "verlet", "dop853"),
    "swinging-chain": ("rk4", "verlet", "dop853"),
    "von-mises-truss": ("rk4", "verlet", "dop853"),
    "bouncing-body": ("rk4", "verlet"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("target", [1e-2, 1e-4])
def test_the_advice_is_verified(name, target, tmp_path):
    scene = find_subject(name)
    choices = Choices(
        groups=("integrator",),
        integrators=SCENES[name],
        target=target,
        rounds=1,
        longest=2.0,
        folder=tmp_path,
    )
    study = run_study(scene, choices)
    assert study.reference.converged, study.reference.sentence()
    advice = recommend(study, target, folder=tmp_path)
    assert advice.reached, advice.limit
    assert advice.verified_error <= target
    # Once more, by another hand: the files as they lie there.
    run = run_experiment(advice.folder)
    with Trajectory(run.path) as trajectory:
        frames = trajectory.positions()[:: study.reference.stride]
    positions = np.zeros((*frames.shape[:2], 3))
    positions[..., : frames.shape[2]] = frames
    known = study.reference.positions
    assert relative_error(positions[: len(known)], known) <= target
