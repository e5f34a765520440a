"""Detectors by name: what they find, and what is refused."""

from __future__ import annotations

import re
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from openprc.errors import ConfigError, MissingDependency, NoFeaturesError, UnknownName
from openprc.hooks.registry import default_registry
from openprc.vision import detect, get_detector, opencv, register_detector
from openprc.vision.detection import detectors, registry
from openprc.vision.synth import cases

cv2 = pytest.importorskip("cv2")

BUILT_IN = ("sift", "orb", "akaze", "gftt")


@pytest.fixture(scope="module")
def image():
    return cases.case("translation", shape=(200, 260)).frame(0)


@pytest.fixture
def own_detectors(monkeypatch):
    monkeypatch.setattr(registry, "_OWN", {})


def spot(x, y, shape=(121, 161)):
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    light = np.exp(-((rows - y) ** 2 + (columns - x) ** 2) / (2 * 3.0**2))
    return (40 + 180 * light).astype(np.uint8)


def test_the_package_loads_opencv_only_when_it_is_used():
    code = (
        "import sys, openprc.vision, openprc.vision.detection.feature_map;"
        "sys.exit('cv2' in sys.modules or 'numba' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("name", BUILT_IN)
def test_every_detector_finds_texture_strongest_first(image, name):
    found = detect(image, name, ref_frame_index=3)
    assert len(found) > 20
    assert (np.diff(found.responses) <= 0).all()
    assert (found.keypoints >= 0).all()
    assert (found.keypoints <= [259, 199]).all()
    assert (found.detector_name, found.ref_frame_index, found.frame_shape) == (name, 3, (200, 260))
    assert found.track_sigma.shape == found.sizes.shape == found.angles.shape == (len(found),)
    if name == "gftt":
        assert found.descriptors is None
    else:
        assert len(found.descriptors) == len(found)


@pytest.mark.parametrize(("name", "off"), [("sift", 0.1), ("akaze", 0.6)])
def test_a_round_spot_is_found_at_its_centre(name, off):
    best = detect(spot(70.0, 60.0), name).top_n(1)
    np.testing.assert_allclose(best.keypoints, [[70.0, 60.0]], atol=off)


def test_a_large_image_is_searched_at_half_its_size_to_the_same_places(image, monkeypatch):
    monkeypatch.setattr(detectors, "LARGE", 1000)
    best = detect(spot(70.3, 60.8, shape=(122, 162)), "sift").top_n(1)
    np.testing.assert_allclose(best.keypoints, [[70.3, 60.8]], atol=0.15)
    assert "searched at half their size" in detect(image, "sift").notes[0]
    assert detect(image, "sift", downscale=1).notes == ()


def test_sift_doubles_are_one_place_after_top_n(image):
    found = detect(image, "sift")
    assert len(found.unique()) < len(found)
    best = found.top_n(100).keypoints
    gaps = np.hypot(*(best[:, None] - best[None]).T) + 1e9 * np.eye(100)
    assert gaps.min() >= 1.0


def test_settings_reach_the_detector(image):
    many, few = (len(detect(image, "sift", contrast_threshold=c)) for c in (0.01, 0.12))
    assert many > 2 * few
    assert len(detect(image, "gftt", max_corners=7)) == 7
    assert detect(image, "orb", n_features=50).detector_config["n_features"] == 50


@pytest.mark.parametrize(
    "change",
    [
        lambda i: np.dstack([i, i, i]),
        lambda i: np.dstack([i, i, i, np.full_like(i, 255)]),
        lambda i: i.astype(np.float32) / 255,
    ],
    ids=["colour", "alpha", "real"],
)
def test_other_kinds_of_image_give_the_same(image, change):
    usual = detect(image, "gftt")
    np.testing.assert_allclose(detect(change(image), "gftt").keypoints, usual.keypoints)


@pytest.mark.parametrize("name", BUILT_IN)
def test_nothing_is_found_outside_the_mask(image, name):
    mask = np.zeros(image.shape, bool)
    mask[60:150, 60:200] = True
    found = detect(image, name, mask=mask)
    assert 0 < len(found) < len(detect(image, name))
    assert (found.keypoints >= 59).all()
    assert (found.keypoints <= [201, 151]).all()


# --- the user's own ---


def test_an_own_detector_gives_a_feature_map(own_detectors, image):
    class Grid:
        def __init__(self, step=50):
            self.step = step

        def detect(self, grey):
            x, y = np.meshgrid(*(np.arange(20, edge - 20, self.step) for edge in grey.shape[::-1]))
            return np.column_stack([x.ravel(), y.ravel()])

    register_detector("grid", Grid)
    found = detect(image, "grid", step=40)
    assert len(found) == 24
    assert np.isfinite(found.track_sigma).all()
    mask = np.zeros(image.shape, np.uint8)
    mask[:, :100] = 1
    assert (detect(image, "grid", mask=mask).keypoints[:, 0] < 100).all()
    with pytest.raises(ConfigError, match="does not take size"):
        detect(image, "grid", size=3)
    with pytest.raises(ConfigError, match="there is a detector 'grid' already"):
        register_detector("grid", Grid)
    register_detector("grid", Grid, overwrite=True)


@pytest.mark.parametrize("name", ["sift", "shi-tomasi"])
def test_built_in_names_are_not_taken(own_detectors, name):
    with pytest.raises(ConfigError, match=f"there is a detector '{name}' already"):
        register_detector(name, object)


def test_an_instance_is_no_factory(own_detectors):
    with pytest.raises(ConfigError, match="the factory is int, which cannot be called"):
        register_detector("one", 1)


def test_detectors_of_the_hook_give_plain_points(image):
    for item in default_registry().records("openprc_detectors"):
        if item.distribution == "openprc":
            points = default_registry().load(item).detect(image)
            assert points.ndim == 2
            assert points.shape[1] == 2


# --- refusals ---


@pytest.mark.parametrize(
    ("grey", "words"),
    [
        (np.zeros((60, 80), np.uint8), "the image is black, grey level 0 everywhere"),
        (np.full((60, 80), 255, np.uint8), "the image is white, grey level 255 everywhere"),
        (np.full((60, 80), 90, np.uint8), "the image is blank, grey level 90 everywhere"),
        (np.tile(np.arange(80, dtype=np.uint8), (60, 1)), "grey levels go from 0 to 79"),
    ],
    ids=["black", "white", "blank", "ramp"],
)
def test_an_image_without_texture_is_refused_with_what_it_shows(grey, words):
    with pytest.raises(NoFeaturesError, match=words) as caught:
        detect(grey, "sift")
    assert "try gftt" in caught.value.fix


def test_saturation_is_told():
    grey = np.zeros((60, 80), np.uint8)
    grey[:, 70:] = 200
    with pytest.raises(NoFeaturesError, match=re.escape("black or white (saturated)")):
        detect(grey, "sift", contrast_threshold=1e3)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"contrast_treshold": 0.1}, "has no setting 'contrast_treshold'"),
        ({"n_features": 2.5}, "n_features of the detector 'sift' is 2.5"),
        ({"sigma": "wide"}, "sigma of the detector 'sift' is 'wide'"),
        ({"sigma": np.nan}, "sigma of the detector 'sift' is nan"),
        ({"edge_threshold": -1}, "edge_threshold of the detector 'sift' is -1"),
    ],
    ids=["name", "half", "text", "nan", "negative"],
)
def test_wrong_settings_are_named(image, settings, words):
    with pytest.raises(ConfigError, match=words):
        detect(image, "sift", **settings)


def test_the_nearest_setting_and_name_are_offered(image):
    with pytest.raises(ConfigError) as caught:
        detect(image, "sift", contrast_treshold=0.1)
    assert caught.value.fix == "did you mean 'contrast_threshold'?"
    with pytest.raises(UnknownName, match="there is no detector 'sfit'") as unknown:
        get_detector("sfit")
    assert unknown.value.fix == "did you mean 'sift'?"


def test_what_opencv_refuses_is_told(image):
    with pytest.raises(ConfigError, match="OpenCV's orb refuses its settings"):
        detect(image, "orb", scale_factor=0.0, n_levels=0)


@pytest.mark.parametrize(
    ("mask", "words"),
    [(np.ones((5, 6)), "a mask of 6 x 5 px"), (np.zeros((200, 260)), "the mask is 0 everywhere")],
    ids=["size", "empty"],
)
def test_wrong_masks_are_refused(image, mask, words):
    with pytest.raises(ConfigError, match=words):
        detect(image, "gftt", mask=mask)


# --- versions of OpenCV ---


def test_akaze_is_found_among_the_contributed_modules(monkeypatch):
    extra = SimpleNamespace(AKAZE_create=lambda **settings: settings)
    newer = SimpleNamespace(__version__="5.0.0", xfeatures2d=extra)
    monkeypatch.setattr(opencv, "load_cv2", lambda: newer)
    assert opencv.make_akaze(threshold=0.1) == {"threshold": 0.1}
    assert opencv.major_version() == 5


def test_a_build_without_akaze_says_what_to_install(monkeypatch):
    monkeypatch.setattr(opencv, "load_cv2", lambda: SimpleNamespace(__version__="5.0.0"))
    with pytest.raises(
        MissingDependency, match="OpenCV 5.0.0 as it is installed has no AKAZE"
    ) as e:
        opencv.make_akaze()
    assert "opencv-contrib-python-headless" in e.value.fix


@pytest.mark.parametrize(
    ("installed", "told"),
    [(["numpy", "opencv-python"], False), (["opencv-python", "opencv-contrib-python"], True)],
    ids=["one", "two"],
)
def test_two_wheels_of_opencv_are_told(monkeypatch, installed, told):
    made = [SimpleNamespace(metadata={"Name": name}) for name in installed]
    monkeypatch.setattr(opencv, "distributions", lambda: made)
    opencv.wheels.cache_clear()
    note = opencv.conflict_note()
    opencv.wheels.cache_clear()
    assert (note is not None) == told
    assert note is None or "opencv-contrib-python, opencv-python" in note
