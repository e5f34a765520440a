"""What accuracy costs on a damped oscillator, and the cheapest setting for an error of 1e-4.

python examples/08_tradeoff.py
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from openprc.hooks import run_experiment
from openprc.scenes.catalog import build_scene
from openprc.tradeoff.choices import Choices
from openprc.tradeoff.recommendation import recommend
from openprc.tradeoff.study import run_study

TARGET = 1e-4


def main(folder: Path) -> None:
    """Study two integrators, take the advice, and follow it."""
    scene = build_scene("damped-oscillator")
    choices = Choices(
        groups=("integrator",), integrators=("rk4", "verlet"), target=TARGET, folder=folder
    )
    study = run_study(scene, choices)
    print(f"{scene.name}: {study.reference.sentence()}")
    for point in study.front:
        print(
            f"{point.label:8s} {point.setting['steps_per_frame']:4d} steps a frame: "
            f"error {point.trajectory_error:.1e} for {point.evaluations} evaluations"
        )
    advice = recommend(study, TARGET, folder=folder)
    assert advice.reached
    assert advice.verified_error <= TARGET
    print(f"for {TARGET:g}: {dict(advice.point.setting)}, verified {advice.verified_error:.1e}")
    # The config that was written is an experiment like any other.
    assert run_experiment(advice.folder).n_frames == scene.experiment.n_frames
    # Nothing is measured twice: all of it is in the folder.
    assert run_study(scene, choices).n_measured == 0
    # Of second and of fourth order: what a tenth of the error costs differs by as much.
    costs = {point.label: point.evaluations for point in study.points}
    assert costs["rk4"] < costs["verlet"]


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        main(Path(name))
