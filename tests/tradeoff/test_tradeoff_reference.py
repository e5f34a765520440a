"""References that prove themselves, and say so where they cannot."""

from dataclasses import replace

import numpy as np
import pytest

from openprc.errors import ConfigError, NotConverged
from openprc.testing.closed_form_scenes import oscillator
from openprc.tradeoff import refinement
from openprc.tradeoff.outcome import relative_error
from openprc.tradeoff.reference import converged_reference

SCENE = oscillator(1.0, damping=0.2)
SHORT = replace(SCENE.experiment, duration=1.0)


def test_a_smooth_scene_is_known_as_well_as_is_said():
    found = converged_reference(SHORT, longest=2.0, exact=SCENE.exact)
    assert found.converged
    assert found.uncertainty < 1e-10
    # The closed form is the judge of both methods, and of what they say of themselves.
    assert found.closed_form_difference < found.floor
    assert found.check_difference < 10.0 * (found.check_uncertainty + found.uncertainty)
    assert found.horizon == SHORT.duration
    assert list(found.differences) == sorted(found.differences, reverse=True)


def test_a_reference_is_no_better_than_needed():
    found = converged_reference(SHORT, longest=2.0, needed=1e-7, exact=SCENE.exact)
    assert 1e-12 < found.uncertainty <= 1e-7
    assert found.closed_form_difference < found.floor


def test_steps_are_refined_at_the_order_of_the_scheme():
    found = refinement.by_step(
        SHORT, "rk4", 1, longest=1.0, needed=1e-9, progress=lambda fraction, message: None
    )
    assert found.converged
    assert found.rate == pytest.approx(4.0, abs=0.2)
    exact = SCENE.exact(SHORT.frame_times)
    assert relative_error(found.positions, exact) == pytest.approx(found.uncertainty, rel=0.3)


def test_a_second_method_that_disagrees_is_told():
    wrong = SCENE.exact(SHORT.frame_times) * 1.001
    check = refinement.second_opinion(wrong, SHORT, "rk4", stride=1, uncertainty=1e-12, longest=1.0)
    assert not check.agrees
    assert "another motion" in check.note


def test_solutions_that_part_shorten_the_scene(monkeypatch):
    # A tolerance that runs do not keep is what the onset of chaos looks like.
    run = refinement.run_in_memory
    late = SHORT.frame_times > 0.5
    kicks = iter(np.geomspace(1e-3, 1e-4, 6))

    def kicked(experiment, **kwargs):
        outcome = run(experiment, **kwargs)
        frames = outcome.positions.copy()
        frames[late] += next(kicks)
        return replace(outcome, positions=frames)

    monkeypatch.setattr(refinement, "run_in_memory", kicked)
    found = refinement.by_tolerance(
        SHORT, 1, longest=2.0, needed=1e-11, progress=lambda fraction, message: None
    )
    assert found.horizon == pytest.approx(0.5)
    assert len(found.positions) == np.count_nonzero(~late)
    assert found.uncertainty < 1e-6


def test_too_little_time_for_three_steps_is_said():
    with pytest.raises(NotConverged, match=r"steps of rk4 are stable and affordable"):
        refinement.by_step(
            SHORT, "rk4", 1, longest=0.0, needed=0.0, progress=lambda fraction, message: None
        )


def test_a_body_at_rest_has_no_errors_to_measure():
    still = replace(
        SHORT,
        geometry=replace(SHORT.geometry, positions=np.array([[0.0, 0, 0], [1.0, 0, 0]])),
    )
    with pytest.raises(ConfigError, match="nothing moves"):
        converged_reference(still, longest=1.0)
