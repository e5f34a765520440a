"""Every reason for which a match is refused, and what has no template."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.vision.synth import speckle
from openprc.vision.tracking.correlation import Correlator, Reason, RefineSettings

HERE = np.array([[60.0, 50.0, 0.0, 0.0, 0.0, 0.0]])


@pytest.fixture(scope="module")
def pixels():
    y, x = np.mgrid[:120, :140].astype(float)
    return speckle().sample(x, y)[0]


def with_template(pixels, **settings):
    correlator = Correlator(RefineSettings(**settings))
    ids = correlator.add_templates(correlator.prepare(pixels), HERE[:, :2])
    assert ids == 0
    return correlator


def reason_of(correlator, image, warp=HERE, template=0):
    found = correlator.refine(correlator.prepare(image), [template], np.atleast_2d(warp))
    assert found.accepted[0] == (found.reason[0] == Reason.ACCEPTED)
    return Reason(int(found.reason[0]))


def test_accepted(pixels):
    assert reason_of(with_template(pixels), pixels) is Reason.ACCEPTED


@pytest.mark.parametrize("template", [-1, 1, 10**9])
def test_numbers_that_were_never_given_out(pixels, template):
    assert reason_of(with_template(pixels), pixels, template=template) is Reason.NO_TEMPLATE


def test_a_correlator_without_templates(pixels):
    assert reason_of(Correlator(), pixels) is Reason.NO_TEMPLATE


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", range(6))
def test_guesses_that_are_no_numbers(pixels, value, place):
    warp = HERE.copy()
    warp[0, place] = value
    found = with_template(pixels).refine(Correlator().prepare(pixels), [0], warp)
    assert found.reason[0] == Reason.NO_TEMPLATE
    assert np.isnan(found.zncc[0])
    assert np.isnan(found.sigma).all()


@pytest.mark.parametrize("at", [(9.0, 50.0), (131.0, 50.0), (60.0, 1e9), (-1e300, 5.0)], ids=str)
@pytest.mark.parametrize("model", ["translation", "affine", "auto"])
def test_windows_that_leave_the_image(pixels, at, model):
    warp = HERE.copy()
    warp[0, :2] = at
    assert reason_of(with_template(pixels, model=model), pixels, warp) is Reason.LEFT_IMAGE


@pytest.mark.parametrize("at", [(10.0, 10.0), (129.0, 109.0), (10.0, 60.0)], ids=str)
def test_windows_that_touch_the_edge(pixels, at):
    correlator = Correlator()
    image = correlator.prepare(pixels)
    ids = correlator.add_templates(image, np.array([at]))
    found = correlator.refine(image, ids, [[*at, 0.0, 0.0, 0.0, 0.0]])
    assert found.accepted.all()
    np.testing.assert_allclose(found.positions[0], at, atol=1e-4)


@pytest.mark.parametrize("model", ["translation", "affine", "quadratic"])
def test_one_iteration_is_not_enough(pixels, model):
    warp = HERE + np.array([0.8, 0.8, 0.0, 0.0, 0.0, 0.0])
    correlator = with_template(pixels, model=model, max_iterations=1)
    assert reason_of(correlator, pixels, warp) is Reason.NOT_CONVERGED


def test_too_far_from_the_guess(pixels):
    warp = HERE + np.array([1.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert reason_of(with_template(pixels), pixels, warp) is Reason.ACCEPTED
    correlator = with_template(pixels, max_shift=0.5)
    assert reason_of(correlator, pixels, warp) is Reason.NOT_CONVERGED


def test_a_match_that_is_too_different(pixels):
    rng = np.random.default_rng(0)
    blurred = pixels + rng.normal(0.0, 25.0, pixels.shape)
    assert reason_of(with_template(pixels), blurred) is Reason.BELOW_GATE
    assert reason_of(with_template(pixels, max_znssd=1.2), blurred) is Reason.ACCEPTED


def test_noise_in_the_template_opens_the_gate():
    y, x = np.mgrid[:120, :140].astype(float)
    clean = speckle().sample(x, y)[0]
    noisy = [clean + np.random.default_rng(k).normal(0.0, 12.0, clean.shape) for k in (0, 1)]
    correlator = with_template(noisy[0], model="translation")
    found = correlator.refine(correlator.prepare(noisy[1]), [0], HERE)
    assert found.accepted[0]
    assert found.znssd[0] > 0.15


def test_a_match_that_is_too_uncertain(pixels):
    correlator = with_template(pixels, max_sigma=1e-6)
    noisy = pixels + np.random.default_rng(1).normal(0.0, 2.0, pixels.shape)
    assert reason_of(correlator, noisy) is Reason.BELOW_GATE


@pytest.mark.parametrize("value", [0.0, 255.0])
def test_images_without_texture(pixels, value):
    assert reason_of(with_template(pixels), np.full(pixels.shape, value)) is Reason.BELOW_GATE


def test_the_negative_of_an_image_is_no_match(pixels):
    assert reason_of(with_template(pixels), 255.0 - pixels) is not Reason.ACCEPTED


def test_pixels_without_a_value(pixels):
    hole = pixels.copy()
    hole[52, 63] = np.nan
    assert reason_of(with_template(pixels), hole) is Reason.BELOW_GATE
    correlator = Correlator()
    ids = correlator.add_templates(
        correlator.prepare(hole), np.array([[60.0, 50.0], [100.0, 80.0]])
    )
    assert ids.tolist() == [-1, 0]


@pytest.mark.parametrize("model", ["affine", "quadratic"])
@pytest.mark.parametrize(
    "shape", [(-1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 1.0, 0.0), (-0.8, 0.0, 0.0, -0.8)], ids=str
)
def test_folded_windows(pixels, model, shape):
    warp = np.array([[60.0, 50.0, *shape]])
    assert reason_of(with_template(pixels, model=model), pixels, warp) is Reason.SINGULAR


def test_a_window_of_one_grey_level_has_no_template(pixels):
    flat = np.rint(pixels).astype(np.uint8)
    flat[30:75, 40:85] = 77
    correlator = Correlator()
    points = np.array([[60.0, 50.0], [110.0, 90.0], [np.nan, 3.0], [3.0, 60.0], [np.inf, 50.0]])
    assert correlator.add_templates(correlator.prepare(flat), points).tolist() == [
        -1,
        0,
        -1,
        -1,
        -1,
    ]


def test_a_straight_edge_has_no_template():
    x = np.arange(120.0)
    edge = np.tile(100.0 + 50.0 * np.tanh((x - 60.0) / 2.0), (100, 1))
    correlator = Correlator()
    points = np.array([[60.0, 50.0]])
    assert correlator.add_templates(correlator.prepare(edge), points).tolist() == [-1]
