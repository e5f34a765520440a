"""Warps of exact images come back, whatever the light does."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import ConfigError
from openprc.vision.synth import speckle
from openprc.vision.tracking.correlation import Correlator, Reason, RefineSettings, compose

SHAPE = (150, 190)
CENTRE = np.array([95.0, 75.0])
TEXTURE = speckle()
POINTS = np.stack(np.meshgrid(np.arange(40.0, 155.0, 19.0), np.arange(40.0, 115.0, 19.0)), -1)
POINTS = POINTS.reshape(-1, 2) + np.random.default_rng(0).uniform(-0.5, 0.5, (28, 2))
EXACT = {"max_znssd": 0.1, "tolerance": 1e-5}


def picture(matrix=None, shift=(0.0, 0.0)):
    """Return an image, nothing rounded, and what happened to points of the reference image."""
    matrix = np.eye(2) if matrix is None else np.asarray(matrix)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    back = np.linalg.inv(matrix)
    xy = np.stack([x, y], -1) - CENTRE - shift
    values = TEXTURE.sample(*np.moveaxis(xy @ back.T + CENTRE, -1, 0))[0]
    warps = np.zeros((len(POINTS), 6))
    warps[:, :2] = (POINTS - CENTRE) @ matrix.T + CENTRE + shift
    warps[:, 2:] = (matrix - np.eye(2)).ravel()
    return values, warps


def turned(degrees, stretch=(1.0, 1.0)):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s], [s, c]]) @ np.diag(stretch)


@pytest.fixture(scope="module")
def reference():
    return picture()[0]


def matched(reference, image, warps, *, near=None, **settings):
    correlator = Correlator(RefineSettings(**{**EXACT, **settings}))
    ids = correlator.add_templates(correlator.prepare(reference), POINTS)
    assert np.array_equal(ids, np.arange(len(POINTS)))
    guess = warps.copy() if near is None else near
    guess[:, :2] += np.random.default_rng(1).uniform(-0.4, 0.4, (len(guess), 2))
    return correlator.refine(correlator.prepare(image), ids, guess)


@pytest.mark.parametrize("model", ["translation", "affine", "quadratic", "auto"])
def test_a_shift_comes_back(reference, model):
    image, warps = picture(shift=(1.3, -0.6))
    found = matched(reference, image, warps, model=model)
    assert found.accepted.all()
    # Only the interpolation is not exact.
    assert np.sqrt(((found.positions - warps[:, :2]) ** 2).mean()) < 5e-3
    assert np.abs(found.warps[:, 2:]).max() < 5e-3
    assert (found.znssd < 1e-3).all()


@pytest.mark.parametrize("model", ["affine", "auto"])
@pytest.mark.parametrize(
    "matrix",
    [turned(5.0, (1.03, 0.98)), turned(20.0), turned(-12.0, (0.88, 1.0))],
    ids=["turned 5 and stretched", "turned 20", "turned 12 and folded"],
)
def test_a_deformation_comes_back(reference, model, matrix):
    image, warps = picture(matrix, (0.7, 0.2))
    near = warps.copy()
    near[:, 2:] *= 0.9
    found = matched(reference, image, warps, near=near, model=model)
    assert found.accepted.all()
    assert np.sqrt(((found.positions - warps[:, :2]) ** 2).mean()) < 5e-3
    assert np.abs(found.warps[:, 2:] - warps[:, 2:]).max() < 4e-3


@pytest.mark.parametrize("model", ["translation", "affine", "auto"])
def test_gain_and_offset_of_the_light_change_nothing(reference, model):
    image, warps = picture(turned(0.5), (0.4, 0.3))
    plain = matched(reference, image, warps, model=model)
    for gain, offset in [(0.5, 0.0), (1.3, -40.0), (0.8, 90.0)]:
        lit = matched(reference, gain * image + offset, warps, model=model)
        # What "auto" weighs against the noise is near the limit here, where nothing but the
        # interpolation is left of it.
        most = 1e-3 if model == "auto" else 1e-5
        assert np.abs(lit.positions - plain.positions).max() < most
        np.testing.assert_allclose(lit.zncc, plain.zncc, atol=1e-6)


@pytest.mark.parametrize("model", ["translation", "affine", "auto"])
def test_16_bit_is_scaled_8_bit(reference, model):
    image, warps = picture(turned(1.0), (0.4, 0.3))
    eight = [np.rint(i).clip(0, 255).astype(np.uint8) for i in (reference, image)]
    sixteen = [257 * i.astype(np.uint16) for i in eight]
    first = matched(*eight, warps, model=model)
    second = matched(*sixteen, warps, model=model)
    assert first.accepted.all()
    assert np.array_equal(first.reason, second.reason)
    assert np.abs(first.positions - second.positions).max() < 1e-5
    # What is said of the noise scales too, down to the least that rounding makes.
    high = first.sigma > 1.02 * second.sigma
    np.testing.assert_allclose(second.sigma[~high], first.sigma[~high], rtol=0.02)
    floats = matched(*(i.astype(np.float32) for i in eight), warps, model=model)
    assert np.array_equal(floats.positions, first.positions)


def test_two_or_three_iterations_are_enough(reference):
    image, warps = picture(turned(2.0), (0.4, 0.3))
    found = matched(reference, image, warps, model="affine", tolerance=1e-3)
    assert found.iterations.mean() < 3.5
    # Each iteration leaves a small part of the error: the end does not depend on the tolerance.
    fine = matched(reference, image, warps, model="affine", tolerance=1e-6)
    assert np.abs(found.positions - fine.positions).max() < 1e-3
    assert fine.iterations.max() <= 8


def test_guesses_three_pixels_off_are_near_enough(reference):
    image, warps = picture(turned(2.0))
    near = warps.copy()
    angle = np.random.default_rng(2).uniform(0, 2 * np.pi, len(near))
    near[:, :2] += 2.6 * np.stack([np.cos(angle), np.sin(angle)], 1)
    found = matched(reference, image, warps, near=near, model="auto")
    right = np.hypot(*(found.positions - warps[:, :2]).T) < 0.05
    assert (right & found.accepted).sum() >= 27
    assert not (found.accepted & ~right).any()


def test_the_tracked_point_keeps_its_place_between_the_pixels(reference):
    # The same pixels, two tracked points: they move as the deformation says.
    matrix = turned(10.0)
    image, _ = picture(matrix)
    correlator = Correlator(RefineSettings(model="affine", **EXACT))
    points = np.array([[80.4, 70.3], [79.6, 69.7]])
    ids = correlator.add_templates(correlator.prepare(reference), points)
    guess = np.zeros((2, 6))
    guess[:, :2] = (points - CENTRE) @ matrix.T + CENTRE
    guess[:, 2:] = (matrix - np.eye(2)).ravel()
    found = correlator.refine(correlator.prepare(image), ids, guess).positions
    np.testing.assert_allclose(found[0] - found[1], matrix @ (points[0] - points[1]), atol=2e-3)


def test_templates_of_a_later_frame_continue_the_first(reference):
    middle, half = picture(turned(8.0), (2.0, 1.0))
    last, whole = picture(turned(15.0, (1.02, 1.0)), (3.0, 2.0))
    correlator = Correlator(RefineSettings(model="affine", **EXACT))
    first = correlator.add_templates(correlator.prepare(reference), POINTS)
    there = correlator.prepare(middle)
    parents = correlator.refine(there, first, half).warps
    second = correlator.add_templates(there, parents[:, :2])
    assert np.array_equal(second, np.arange(28, 56))
    guess = np.zeros((28, 6))
    guess[:, :2] = whole[:, :2]
    found = correlator.refine(correlator.prepare(last), second, guess)
    assert found.accepted.all()
    both = compose(parents, found.warps)
    assert np.abs(both[:, :2] - whole[:, :2]).max() < 0.02
    assert np.abs(both[:, 2:] - whole[:, 2:]).max() < 0.01


def test_composed_warps_act_one_after_the_other():
    rng = np.random.default_rng(3)
    first, second = rng.normal(0.0, 0.2, (2, 5, 6))
    delta = rng.normal(size=(5, 2))

    def apply(warp, d):
        return warp[:, :2] + d + np.einsum("nij,nj->ni", warp[:, 2:].reshape(-1, 2, 2), d)

    between = apply(first, delta) - first[:, :2]
    np.testing.assert_allclose(apply(compose(first, second), delta), apply(second, between))


def test_nothing_is_answered_with_nothing(reference):
    correlator = Correlator()
    image = correlator.prepare(reference)
    assert correlator.add_templates(image, np.zeros((0, 2))).shape == (0,)
    found = correlator.refine(image, np.zeros(0, int), np.zeros((0, 6)))
    assert found.positions.shape == (0, 2)
    assert found.zncc.shape == found.reason.shape == (0,)


def test_a_guess_for_each_template(reference):
    correlator = Correlator()
    image = correlator.prepare(reference)
    ids = correlator.add_templates(image, POINTS)
    with pytest.raises(ConfigError, match=r"guesses of shape \(3, 6\) for 28 templates"):
        correlator.refine(image, ids, np.zeros((3, 6)))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("subset", 20),
        ("subset", 3),
        ("subset", 21.0),
        ("model", "cubic"),
        ("max_iterations", 0),
        ("tolerance", 0.0),
        ("max_znssd", 2.0),
        ("max_sigma", -1.0),
        ("max_shift", float("nan")),
    ],
)
def test_settings_that_make_no_sense(key, value):
    with pytest.raises(ConfigError, match=f"refinement.{key}: "):
        RefineSettings(**{key: value})


def test_settings_as_plain_values():
    settings = RefineSettings(subset=31)
    assert RefineSettings(**settings.as_dict()) == settings
    assert list(Reason) == [0, 1, 2, 3, 4, 5]
