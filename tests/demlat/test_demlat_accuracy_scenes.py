"""An accuracy is met on larger scenes: lattices, folded sheets, networks, chains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from openprc.demlat import BarHingeModel
from openprc.demlat.planning.accuracy import choose_for_accuracy, settled
from openprc.demlat.planning.accuracy_pilot import error_curve
from openprc.scenes.catalog import build_scene
from openprc.schema.experiment import AUTO

pytestmark = pytest.mark.slow

#: Scenes whose motion does not lose its start, with as much of it as is run.
SCENES = {
    "pendulum": 6.0,
    "hanging-chain": None,
    "swinging-chain": 1.0,
    "cantilever": 6.0,
    "spring-lattice": 15.0,
    "hauser-network": 2.0,
    "miura": 2.0,
    "kresling": 4.0,
}


def frames(experiment):
    model = BarHingeModel(experiment, backend="cpu")
    return np.concatenate([block.x.copy() for _, block in model.blocks()])


def cut(name):
    experiment = build_scene(name, {}).experiment
    if SCENES[name] is None:
        return experiment
    wanted = round(SCENES[name] / experiment.save_interval) * experiment.save_interval
    return replace(experiment, duration=min(wanted, experiment.duration))


def undamped(experiment):
    bars = experiment.geometry.bars
    still = replace(bars, damping=np.zeros(len(bars)))
    return replace(experiment, damping=0.0, geometry=replace(experiment.geometry, bars=still))


def check(experiment, accuracy):
    truth = frames(replace(experiment, integrator="dop853", tolerance=1e-13))
    asked = replace(
        experiment, accuracy=accuracy, integrator=AUTO, dt=experiment.save_interval,
        dt_stated=False,
    )  # fmt: skip
    choice = choose_for_accuracy(asked)
    error = float(error_curve(frames(settled(asked)), truth).max())
    assert error <= accuracy
    # A step at the stability limit may be more exact than anybody asked for.
    assert choice.at_limit or error > accuracy / 1000.0


@pytest.mark.parametrize("accuracy", [1e-2, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("name", list(SCENES))
def test_scenes_of_the_library_are_as_exact_as_asked_for(name, accuracy):
    check(cut(name), accuracy)


@pytest.mark.parametrize("accuracy", [1e-2, 1e-5])
@pytest.mark.parametrize("name", ["spring-lattice", "miura"])
def test_so_they_are_without_dampers(name, accuracy):
    experiment = undamped(cut(name))
    check(replace(experiment, duration=20 * experiment.save_interval), accuracy)
