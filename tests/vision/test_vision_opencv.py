"""OpenCV itself: absent, without a part, of two versions, or installed twice.

One environment holds one version. To run the tests of video under the other one::

    pip uninstall -y opencv-python-headless
    pip install --no-deps "opencv-contrib-python-headless>=5,<6"
    pytest tests/vision
"""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from openprc.errors import MissingDependency
from openprc.vision import detect, opencv

IMAGE = np.random.default_rng(0).integers(0, 255, (60, 80), dtype=np.uint8)


def test_the_major_version_is_one_that_is_supported():
    assert opencv.major_version() in (4, 5)


def test_without_opencv_there_is_a_line_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(
        MissingDependency, match=r"cannot be imported(.|\n)*pip install 'opencv-python-headless<5'"
    ):
        opencv.load_cv2()


@pytest.mark.parametrize("place", ["cv2", "xfeatures2d"])
def test_akaze_is_found_where_either_version_has_it(monkeypatch, place):
    def make(**settings):
        return settings

    part = SimpleNamespace(AKAZE_create=make)
    made = part if place == "cv2" else SimpleNamespace(xfeatures2d=part)
    monkeypatch.setattr(opencv, "load_cv2", lambda: made)
    assert opencv.make_akaze(threshold=0.1) == {"threshold": 0.1}


@pytest.mark.parametrize("extra", [{}, {"xfeatures2d": SimpleNamespace()}], ids=["plain", "empty"])
def test_a_build_without_akaze_names_the_wheel_that_has_it(monkeypatch, extra):
    monkeypatch.setattr(opencv, "load_cv2", lambda: SimpleNamespace(__version__="5.0.0", **extra))
    with pytest.raises(
        MissingDependency, match=r"5\.0\.0(.|\n)*no AKAZE(.|\n)*opencv-contrib-python-headless"
    ):
        detect(IMAGE, "akaze")


def installed(monkeypatch, *names):
    found = [SimpleNamespace(metadata={"Name": name}) for name in names]
    monkeypatch.setattr(opencv, "distributions", lambda: found)
    opencv.wheels.cache_clear()


@pytest.fixture(autouse=True)
def _forget():
    yield
    opencv.wheels.cache_clear()


def test_one_wheel_is_as_it_should_be(monkeypatch):
    installed(monkeypatch, "numpy", "opencv-python-headless", None)
    assert opencv.wheels() == ("opencv-python-headless",)
    assert opencv.conflict_note() is None
    assert detect(IMAGE, "gftt").notes == ()


def test_two_wheels_in_one_environment_are_told(monkeypatch):
    installed(monkeypatch, "opencv-python", "opencv_contrib_python")
    words = "over each other: opencv-contrib-python, opencv-python; uninstall all of them"
    assert words in opencv.conflict_note()
    assert detect(IMAGE, "gftt").notes == (opencv.conflict_note(),)


def test_the_names_of_detection_come_without_opencv():
    code = (
        "import sys; from openprc.vision import FeatureMap, FeatureMapCache, detect, get_detector;"
        "FeatureMap.from_points([(1, 2)], frame_shape=(5, 5)).top_n(1).unique();"
        "get_detector('sift', contrast_threshold=0.1);"
        "sys.exit(', '.join({'cv2', 'numba', 'scipy', 'matplotlib'} & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
