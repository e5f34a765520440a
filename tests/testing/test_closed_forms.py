"""The kit's own numbers: scenes start as they say, and mistakes are recognised."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.schema.experiment import Signal
from openprc.schema.validate import validate_file
from openprc.testing.checks_phys import _SCENES
from openprc.testing.closed_form_trajectories import KINDS, trajectory
from openprc.testing.diagnosis import explain
from openprc.testing.simulations import commanded

MAKES = [
    pytest.param(make, id=f"{number}-{place}")
    for number, (_, makes) in _SCENES.items()
    for place, make in enumerate(makes)
]


@pytest.mark.parametrize("make", MAKES)
def test_a_scene_starts_where_and_as_fast_as_it_says(make):
    scene = make(1.0)
    body = scene.experiment.geometry
    h = 1e-4
    start = scene.exact(np.array([0.0, h, 2 * h]))
    if scene.centre_only:
        weights = body.masses / body.masses.sum()
        found = start[0].mean(axis=0)
        np.testing.assert_allclose(found, weights @ body.positions, atol=1e-12)
        return
    np.testing.assert_allclose(start[0], body.positions, atol=1e-12)
    velocity = (4 * start[1] - 3 * start[0] - start[2]) / (2 * h)
    np.testing.assert_allclose(velocity, body.velocities, atol=1e-5)
    assert scene.experiment.n_frames * scene.experiment.steps_per_frame < 20_000


T = np.linspace(0.0, 3.0, 40)
MOTION = np.stack(
    [np.stack([np.sin(T + n), np.cos(2 * T - n), 0.3 * T * n], axis=1) for n in range(4)], axis=1
)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda x: x * 1e3, "mm taken for m|m taken for mm"),
        (lambda x: x * 1e-3, "mm taken for m|m taken for mm"),
        (lambda x: np.degrees(x), "radians taken for degrees|degrees taken for radians"),
        (lambda x: -x, "the sign"),
        (lambda x: np.concatenate([x[:1], x[:-1]]), "1 frame late: off by one"),
        (lambda x: np.concatenate([x[1:], x[-1:]]), "1 frame early: off by one"),
        (lambda x: x[1:], r"the first 1 frame\(s\) are lost"),
        (lambda x: x[:-2], r"the last 2 frame\(s\) are lost"),
        (lambda x: x.swapaxes(1, 2), "axes in the order"),
        (lambda x: x[..., [1, 0, 2]], "coordinates in the order"),
        (lambda x: x.swapaxes(1, 2).reshape(x.shape), "axes of a sample are swapped"),
        (lambda x: x.reshape(len(x), 3, 4).swapaxes(1, 2), "axes of a sample are swapped"),
        (lambda x: x - x[:1], "displacements taken for positions"),
        (lambda x: x[:, ::-1], "columns in reverse order"),
        (lambda x: x[::-1], "backwards in time"),
        (lambda x: x[..., :2], "a coordinate is lost"),
    ],
)
def test_the_usual_mistakes_are_recognised(spoil, words):
    import re

    assert re.search(words, explain(spoil(MOTION), MOTION, tolerance=1e-9))


def test_what_is_no_usual_mistake_is_not_explained():
    rng = np.random.default_rng(0)
    assert explain(rng.standard_normal(MOTION.shape), MOTION, tolerance=1e-9) == ""


@pytest.mark.parametrize("kind", KINDS)
def test_trajectories_to_export_are_valid(kind):
    report = validate_file(trajectory(kind))
    assert [f for f in report.findings if f.level == "error"] == []


def test_commanded_values_of_held_and_linear_signals():
    times = np.array([0.0, 0.1, 0.15, 0.3, 0.9])
    held = Signal(name="u", values=[1.0, 2.0, 3.0], dt=0.1, interpolation="hold")
    np.testing.assert_array_equal(commanded(held, times)[:, 0], [1, 2, 2, 3, 3])
    line = Signal(name="u", values=[1.0, 2.0, 4.0], dt=0.1)
    np.testing.assert_allclose(commanded(line, times)[:, 0], [1, 2, 3, 4, 4])
