"""Time steps of runs with PyElastica, and the files that come of them; slow."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest

from openprc.errors import Diverged, UnsupportedScene
from openprc.schema import Trajectory, validate_file
from openprc.schema.experiment import Actuator, Signal

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(importlib.util.find_spec("elastica") is None, reason="needs pyelastica"),
    pytest.mark.filterwarnings("default"),  # the simulator's own warnings are not ours
]

GRAVITY = 9.81


@pytest.fixture
def load():
    """Return a constant force on the tip of a cantilever of five elements."""
    return {
        "signals": {"F": Signal(name="F", values=np.array([-0.005]), dt=1.0)},
        "actuators": (Actuator(node=5, signal="F", type="force", axes=(False, True, False)),),
    }


def test_a_step_that_is_too_long(make_chain, make_experiment, run_rods, load, tmp_path):
    geometry = make_chain(5, fixed=(0, 1))
    settings = {"duration": 1.9, "dt": 1.9e-3, "save_interval": 0.019}
    with pytest.raises(UnsupportedScene, match=r"steps of 0.0019 s would blow up") as caught:
        run_rods(make_experiment(geometry, **settings, **load))
    assert "at most 0.001096 s" in caught.value.expected
    assert list(tmp_path.glob("*.h5*")) == []

    blows_up = make_experiment(geometry, **settings, **load, step_check="warn")
    with pytest.raises(Diverged, match="times its rest length at t = "):
        run_rods(blows_up)
    partial = next(tmp_path.glob("*.partial"))
    with Trajectory(partial, allow_incomplete=True) as kept:
        assert 1 < kept.n_frames < 101
        assert np.isfinite(kept.positions()).all()


def test_substeps(make_chain, make_experiment, run_rods, load, notes):
    geometry = make_chain(5, fixed=(0, 1))
    coarse = {"duration": 0.19, "dt": 1.9e-3, "save_interval": 0.019}
    run = run_rods(make_experiment(geometry, **coarse, **load), substeps="auto")
    assert "in steps of 0.000633333 s" in notes(run)
    assert "forces of signals act as they are in the middle of a step" in notes(run)
    told = run_rods(make_experiment(geometry, **coarse, **load), substeps="3")
    np.testing.assert_array_equal(run.positions(), told.positions())


@pytest.mark.parametrize("share", [0.995, 1.02])
def test_the_limit_is_the_limit(make_chain, make_experiment, run_rods, share):
    """Stable just below, unstable just above; a thin rod whose rotation sets it."""
    limit = 0.0010960
    noise = 1e-6 * np.random.default_rng(1).normal(size=(6, 3))
    experiment = make_experiment(
        make_chain(5, fixed=(0, 1), velocities=noise),
        duration=3000 * share * limit,
        dt=share * limit,
        save_interval=300 * share * limit,
        step_check="warn",
    )
    if share < 1.0:
        assert np.abs(run_rods(experiment).velocities()).max() < 1e-4
    else:
        with pytest.raises(Diverged, match="rest length"):
            run_rods(experiment)


def test_the_file_is_valid_and_says_what_it_is(make_chain, make_experiment, run_rods, notes):
    two = make_chain(9, fixed=(0, 1, 9))
    keep = [0, 1, 2, 3, 5, 6, 7, 8]  # without the bar between nodes 4 and 5
    bars, bends = two.bars, two.bends
    cut = type(two)(
        positions=two.positions,
        masses=two.masses,
        fixed=two.fixed,
        labels=tuple(f"n{i}" for i in range(10)),
        bars=type(bars)(
            indices=bars.indices[keep],
            stiffness=bars.stiffness[keep],
            rest_length=bars.rest_length[keep],
        ),
        bends=type(bends)(
            indices=bends.indices[[0, 1, 2, 5, 6, 7]], stiffness=bends.stiffness[[0, 1, 2, 5, 6, 7]]
        ),
    )
    run = run_rods(make_experiment(cut, gravity=(0.0, 0.0, -GRAVITY)))
    assert run.indices("bars").tolist() == bars.indices[keep].tolist()
    assert run.element("bends", "angle").shape == (11, 6)
    assert run.node("label").tolist()[3] == "n3"
    assert "integrated 2 rod(s) of 4, 4 elements by position Verlet" in notes(run)
    assert "node(s) 1 are fixed in the experiment; here they are carried" in notes(run)
    assert "the largest strain of a frame" in notes(run)
    assert "forces of signals" not in notes(run)  # there are none
    report = validate_file(run.path)
    assert [finding for finding in report.findings if finding.level == "error"] == []
    np.testing.assert_array_equal(run.positions()[:, 9], np.tile(two.positions[9], (11, 1)))
