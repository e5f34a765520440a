"""Detectors of one's own: registered in a script, or brought by a plugin."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from openprc.errors import ConfigError, PluginError, UnknownName
from openprc.hooks.hookspecs import hookimpl
from openprc.hooks.registry import Registry
from openprc.hooks.specs import DetectorSpec
from openprc.vision import FeatureMap, detect, get_detector, register_detector
from openprc.vision.detection import registry

IMAGE = np.random.default_rng(0).integers(0, 255, (60, 80), dtype=np.uint8)


@dataclass
class Corners:
    """Points on a line, as many as asked."""

    count: int = 3
    offset: float = -2.0

    def detect(self, image):
        assert image.dtype == np.uint8
        assert image.ndim == 2
        return [(20.0 + 5 * i, 30.0) for i in range(self.count)]


@dataclass
class Broken:
    """A plugin's detector with a defect."""

    def detect(self, image):
        return image.no_such_thing


@pytest.fixture(autouse=True)
def _nothing_stays(monkeypatch):
    monkeypatch.setattr(registry, "_OWN", {})


def test_a_registered_detector_is_used_by_its_name():
    register_detector("corners", Corners)
    found = detect(IMAGE, "corners", count=4)
    assert isinstance(found, FeatureMap)
    assert len(found) == 4
    assert found.detector_name == "corners"
    assert found.frame_shape == (60, 80)
    assert np.isfinite(found.track_sigma).all()  # so that it can be ranked
    assert "corners" in registry.detector_names()
    assert get_detector("corners", offset=-5).offset == -5


def test_a_detector_may_give_a_feature_map_of_its_own():
    class Rich:
        def detect(self, image):
            return FeatureMap.from_points(
                [(30, 30), (40, 20)], frame_shape=image.shape, responses=[1, 7],
                descriptors=[[1], [2]], detector_name="rich",
            )  # fmt: skip

    register_detector("rich", Rich)
    found = detect(IMAGE[:, :, None], "rich", ref_frame_index=4)
    assert found.top_n(1).keypoints.tolist() == [[40, 20]]
    assert found.ref_frame_index == 4
    assert np.isfinite(found.track_sigma).all()


def test_a_mask_holds_for_every_detector():
    register_detector("corners", Corners)
    mask = np.zeros((60, 80), bool)
    mask[30, 25] = True
    assert detect(IMAGE, "corners", mask=mask).keypoints.tolist() == [[25, 30]]


@pytest.mark.parametrize(
    ("factory", "settings", "words"),
    [
        (Corners, {"cuont": 3}, "no setting 'cuont'(.|\n)*did you mean 'count'"),
        (lambda size=3: Corners(), {"sise": 1}, "some of size(.|\n)*did you mean 'size'"),
        (lambda: Corners(), {"size": 1}, "expected: no settings"),
    ],
    ids=["dataclass", "function", "none"],
)
def test_unknown_settings_are_named(factory, settings, words):
    register_detector("corners", factory)
    with pytest.raises(ConfigError, match=words):
        detect(IMAGE, "corners", **settings)


def test_a_factory_may_take_anything():
    register_detector("open", lambda **rest: Corners(count=rest["many"]))
    assert len(detect(IMAGE, "open", many=2)) == 2


def test_points_that_cannot_be_are_refused():
    register_detector("far", lambda: Corners(count=40))
    with pytest.raises(ConfigError, match=r"point 12 lies at \(80, 30\)"):
        detect(IMAGE, "far")


@pytest.mark.parametrize("name", ["sift", "gftt", "shi-tomasi"])
def test_names_that_are_there_are_not_taken(name):
    with pytest.raises(ConfigError, match=f"there is a detector '{name}' already"):
        register_detector(name, Corners, overwrite=True)


def test_a_name_is_registered_anew_only_on_demand():
    register_detector("corners", Corners)
    with pytest.raises(ConfigError, match="pass overwrite=True"):
        register_detector("corners", Corners)
    register_detector("corners", lambda: Corners(count=1), overwrite=True)
    assert len(detect(IMAGE, "corners")) == 1


def test_an_instance_is_no_factory():
    with pytest.raises(ConfigError, match=r"factory is Corners(.|\n)*the class instead"):
        register_detector("corners", Corners())


class Plugin:
    """A plugin with two detectors."""

    OPENPRC_PLUGIN_API = "1.0"

    @staticmethod
    @hookimpl
    def openprc_detectors():
        """Return them."""
        here = f"{__name__}:"
        return [
            DetectorSpec("line", "Points on a line", here + "Corners"),
            DetectorSpec("broken", "Nothing", here + "Broken"),
        ]


@pytest.fixture
def _plugin(monkeypatch):
    entry = SimpleNamespace(
        name="marks",
        value="openprc_marks",
        dist=SimpleNamespace(name="openprc-marks", version="0.1"),
        load=lambda: Plugin,
    )
    found = Registry([entry], wanted="marks")
    monkeypatch.setattr(registry, "default_registry", lambda: found)


@pytest.mark.usefixtures("_plugin")
def test_a_plugin_brings_detectors():
    assert "line" in registry.detector_names()
    assert len(detect(IMAGE, "line", count=2)) == 2
    assert len(detect(IMAGE, "openprc-marks/line")) == 3
    assert registry.identity("line").startswith("openprc-marks/line ")
    with pytest.raises(UnknownName, match="did you mean 'line'"):
        detect(IMAGE, "lines")


@pytest.mark.usefixtures("_plugin")
def test_a_plugin_that_fails_is_named():
    with pytest.raises(PluginError, match=r"openprc-marks/broken .* failed while detecting"):
        detect(IMAGE, "broken")
