"""Detectors: where they find marks, what they can be told, and images of every kind."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import ConfigError, NoFeaturesError, UnknownName, VideoError
from openprc.vision import FeatureMap, detect, get_detector
from openprc.vision.detection.detectors import LARGE
from openprc.vision.synth import cases

METHODS = ["sift", "orb", "akaze", "gftt"]


@pytest.fixture(scope="module")
def speckle():
    return next(cases.case("translation", n_frames=1, shape=(240, 320)).frames())


def blobs(places, *, shape=(200, 240), sigma=3.0):
    """Return Gaussian spots at sub-pixel places, (H, W) uint8."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    image = np.full(shape, 30.0)
    for u, v in places:
        image += 180.0 * np.exp(-((x - u) ** 2 + (y - v) ** 2) / (2 * sigma**2))
    return np.rint(image).astype(np.uint8)


@pytest.mark.parametrize("method", METHODS)
def test_every_detector_gives_a_whole_feature_map(speckle, method):
    found = detect(speckle, method, ref_frame_index=3)
    n = len(found)
    assert n > 100
    assert found.n_features == n
    assert found.keypoints.shape == (n, 2)
    assert found.keypoints.dtype == np.float64
    assert (found.keypoints >= 0).all()
    assert (found.keypoints <= [319, 239]).all()
    for column in (found.responses, found.sizes, found.angles, found.octaves, found.track_sigma):
        assert column.shape == (n,)
    assert (np.diff(found.responses) <= 0).all()
    assert found.responses[0] > 0
    assert (found.sizes > 0).all()
    width = {"sift": 128, "orb": 32, "akaze": 61, "gftt": None}[method]
    assert (found.descriptors is None) if width is None else found.descriptors.shape == (n, width)
    assert (found.detector_name, found.ref_frame_index) == (method, 3)
    assert found.frame_shape == (240, 320)


@pytest.mark.parametrize("downscale", [1, 2, 3])
def test_spots_are_found_where_they_were_drawn(downscale):
    places = np.array([(60.3, 50.8), (150.5, 90.25), (100.0, 150.0), (190.7, 40.4)])
    found = detect(blobs(places, sigma=6.0), "sift", downscale=downscale).unique(min_distance=6)
    near = np.linalg.norm(found.keypoints[:, None] - places, axis=2).min(axis=0)
    assert near.max() < 0.05 * downscale


@pytest.mark.parametrize("method", ["sift", "orb", "akaze", "gftt"])
def test_no_detector_leans_to_one_side(method):
    """Turned by half a turn, an image has its features at the same places of the pattern."""
    image = next(cases.case("translation", n_frames=1, noise=0, shape=(240, 330)).frames())
    settings = {"n_features": 2000, "fast_threshold": 5} if method == "orb" else {}
    there = detect(image, method, **settings)
    turned = detect(np.ascontiguousarray(image[::-1, ::-1]), method, **settings)
    back = np.array([329, 239]) - turned.keypoints
    for octave in np.unique(there.octaves)[:5] if method == "orb" else [None]:
        chosen = slice(None) if octave is None else there.octaves == octave
        others = slice(None) if octave is None else turned.octaves == octave
        gap = there.keypoints[chosen][:, None] - back[others]
        nearest = np.linalg.norm(gap, axis=2).argmin(axis=1)
        gap = gap[np.arange(len(gap)), nearest]
        lean = gap[np.linalg.norm(gap, axis=1) < 2].mean(axis=0) / 2
        assert np.abs(lean).max() < 0.03, octave


def test_large_images_are_searched_at_half_their_size(monkeypatch, speckle):
    monkeypatch.setattr("openprc.vision.detection.detectors.LARGE", speckle.size - 1)
    found = detect(speckle, "sift")
    assert found.notes == ("320 x 240 px are searched at 1/2 of their size (setting downscale)",)
    assert len(found) < len(detect(speckle, "sift", downscale=1)) / 2
    assert detect(speckle, "sift", downscale=2).notes == ()
    assert 1920 * 1080 < LARGE < 3840 * 2160


def test_the_number_of_sift_features_can_be_limited(speckle):
    few = detect(speckle, "sift", n_features=50)
    assert 50 <= len(few) <= 55  # OpenCV keeps ties with the last one
    assert few.detector_config["n_features"] == 50


@pytest.mark.parametrize(
    ("method", "more", "fewer"),
    [
        ("sift", {"contrast_threshold": 0.01}, {"contrast_threshold": 0.1}),
        ("sift", {"edge_threshold": 20}, {"edge_threshold": 3}),
        ("sift", {"n_octave_layers": 4}, {"n_octave_layers": 1}),
        ("orb", {"n_features": 400}, {"n_features": 100}),
        ("orb", {"fast_threshold": 5, "n_features": 9999}, {"fast_threshold": 40}),
        ("akaze", {"threshold": 1e-4}, {"threshold": 1e-2}),
        ("gftt", {"min_distance": 4}, {"min_distance": 12}),
        ("gftt", {"quality_level": 0.01}, {"quality_level": 0.4}),
        ("gftt", {"max_corners": 90}, {"max_corners": 20}),
        ("gftt", {"use_harris": False}, {"use_harris": True, "quality_level": 0.1}),
    ],
    ids=lambda value: value if isinstance(value, str) else "-".join(value),
)
def test_settings_do_what_their_names_say(speckle, method, more, fewer):
    assert len(detect(speckle, method, **more)) > len(detect(speckle, method, **fewer))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"contrast_treshold": 0.01}, "has no setting 'contrast_treshold'(.|\n)*did you mean "
         "'contrast_threshold'"),
        ({"contrastThreshold": 0.01}, "some of n_features, n_octave_layers, contrast_threshold, "
         "edge_threshold, sigma, precise_upscale, downscale"),
        ({"contrast_threshold": "low"}, "is 'low'(.|\n)*a number from 0(.|\n)*default is 0.04"),
        ({"contrast_threshold": np.nan}, "is nan(.|\n)*a number from 0"),
        ({"n_features": 1.5}, "n_features of the detector 'sift' is 1.5(.|\n)*whole number"),
        ({"n_features": -1}, "is -1"),
        ({"n_features": True}, "is True"),
    ],
    ids=["near", "other", "words", "nan", "half", "negative", "bool"],
)  # fmt: skip
def test_a_wrong_setting_is_named(speckle, settings, words):
    with pytest.raises(ConfigError, match=words):
        detect(speckle, "sift", **settings)


def test_a_switch_is_true_or_false(speckle):
    with pytest.raises(ConfigError, match=r"use_harris .* is 'yes'(.|\n)*True or False"):
        detect(speckle, "gftt", use_harris="yes")


def test_numbers_of_numpy_are_settings_like_others(speckle):
    same = get_detector("sift", n_features=np.int64(50), contrast_threshold=np.float32(0.25))
    assert same == get_detector("sift", n_features=50, contrast_threshold=0.25)
    assert type(same.n_features) is int
    assert len(detect(speckle, "orb", n_features=50.0)) <= 50


def test_what_opencv_refuses_is_told(speckle):
    with pytest.raises(ConfigError, match=r"OpenCV's orb refuses its settings"):
        detect(speckle, "orb", wta_k=9)


@pytest.mark.parametrize("name", ["shi-tomasi", "good-features-to-track"])
def test_other_names_mean_the_same_detector(speckle, name):
    assert get_detector(name, max_corners=5) == get_detector("gftt", max_corners=5)
    assert detect(speckle, name, max_corners=5).detector_name == "gftt"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("harris", "there is no detector 'harris'(.|\n)*sift"),
        ("SIFT", "did you mean 'sift'"),
        ("Shi_Tomasi", "did you mean 'shi-tomasi'"),
        ("shift", "did you mean 'sift'"),
    ],
)
def test_an_unknown_detector_is_named(speckle, name, words):
    with pytest.raises(UnknownName, match=words):
        detect(speckle, name)


def colour(image):
    return np.repeat(image[:, :, None], 3, axis=2)


@pytest.mark.parametrize(
    "kind",
    [
        lambda i: colour(i),
        lambda i: np.dstack([colour(i), np.full(i.shape, 7, np.uint8)]),
        lambda i: i[:, :, None],
        lambda i: i.astype(np.uint16) * 257,
        lambda i: i.astype(np.float64) / 255,
        lambda i: i.astype(np.float32),
        lambda i: np.asfortranarray(i),
        lambda i: i.astype(np.int64),
    ],
    ids=["bgr", "bgra", "one-channel", "uint16", "unit", "float", "fortran", "int"],
)
def test_images_of_every_kind_give_the_same_features(speckle, kind):
    image = speckle.copy()
    image[0, :2] = 0, 255  # so that what is scaled spans the whole range
    found, same = detect(image, "gftt"), detect(kind(image), "gftt")
    np.testing.assert_array_equal(same.keypoints, found.keypoints)


def test_the_scaling_of_deep_images_is_told_and_can_be_chosen(speckle):
    deep = speckle.astype(np.uint16) * 4
    assert "(10 bit)" in detect(deep, "gftt").notes[0]
    chosen = detect(deep, "gftt", value_range=(0, 1020))
    np.testing.assert_array_equal(chosen.keypoints, detect(speckle, "gftt").keypoints)


@pytest.mark.parametrize(
    ("image", "error", "words"),
    [
        (np.zeros((4, 5, 6, 3)), VideoError, r"\(4, 5, 6, 3\)(.|\n)*\(H, W, 3\)"),
        (np.zeros((30, 30, 2), np.uint8), VideoError, r"\(30, 30, 2\)"),
        (np.zeros((0, 30), np.uint8), VideoError, "pixels of whole or real numbers"),
        (np.zeros((30, 30), complex), VideoError, "complex"),
        (np.full((30, 30), np.nan), VideoError, "not finite"),
        (np.linspace(-5, 900, 900).reshape(30, 30), ConfigError, "value_range"),
        (np.arange(9), VideoError, r"\(9,\)"),
    ],
    ids=["volume", "two-channels", "empty", "complex", "nan", "range", "line"],
)
def test_what_is_no_image_is_refused(image, error, words):
    with pytest.raises(error, match=words):
        detect(image)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("level", "words"), [(0, "the image is black"), (255, "is white"), (90, "grey level 90")]
)
def test_a_blank_image_says_what_to_do(method, level, words):
    hints = (
        rf"{method}' finds nothing in frame 0; .*{words}(.|\n)*contrast_threshold(.|\n)*try gftt"
        r"(.|\n)*mask(.|\n)*another reference"
    )
    with pytest.raises(NoFeaturesError, match=hints):
        detect(np.full((120, 160), level, np.uint8), method)


def test_a_saturated_image_says_so():
    image = np.full((120, 160), 255, np.uint8)
    image[:, 80:] = 254
    with pytest.raises(NoFeaturesError, match=r"50% .*|\(saturated\)|grey levels go from 254"):
        detect(image, "sift")
    image[:, 70:] = 0
    image[:, 71:80] = 128
    with pytest.raises(NoFeaturesError, match=r"9\d% of the pixels are black or white"):
        detect(image, "sift", contrast_threshold=0.9)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("size", [(1, 1), (2, 2), (3, 40), (7, 7)], ids=str)
def test_a_tiny_image_never_leads_to_an_error_of_opencv(method, size):
    image = np.random.default_rng(0).integers(0, 255, size, dtype=np.uint8)
    try:
        found = detect(image, method)
    except NoFeaturesError:
        return
    assert isinstance(found, FeatureMap)
    assert (found.keypoints <= [size[1] - 1, size[0] - 1]).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "paint",
    [
        lambda m: m,
        lambda m: m.astype(np.uint8) * 255,
        lambda m: m.astype(np.uint8),
        lambda m: np.dstack([m * 255] * 3 + [np.full(m.shape, 255)]),
    ],
    ids=["bool", "255", "1", "bgra"],
)
def test_a_mask_says_where_features_may_be(speckle, method, paint):
    wanted = np.zeros(speckle.shape, bool)
    wanted[60:180, 100:260] = True
    found = detect(speckle, method, mask=paint(wanted))
    x, y = np.rint(found.keypoints).astype(int).T
    assert len(found) > 20
    assert wanted[y, x].all()


@pytest.mark.parametrize(
    ("mask", "words"),
    [
        (np.ones((320, 240)), "a mask of 240 x 320 px(.|\n)*320 x 240 px"),
        (np.zeros((240, 320)), "the mask is 0 everywhere(.|\n)*invert it"),
        (1, "a single number"),
    ],
    ids=["turned", "black", "number"],
)
def test_a_wrong_mask_is_refused(speckle, mask, words):
    with pytest.raises(ConfigError, match=words):
        detect(speckle, "gftt", mask=mask)
