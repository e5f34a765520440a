"""A knock against the camera: everything jumps at once, further than any pyramid reaches."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.vision import Tracker, detect
from openprc.vision.synth import Photometry, Scene, speckle, translation
from openprc.vision.tracking.wide_search import whole_shift

pytest.importorskip("cv2")

SHAPE = (200, 260)


def jumping(jump):
    def shift(k):
        return np.array([0.5 * k, 0.3 * k]) + (np.asarray(jump) if k >= 3 else 0.0)

    return Scene(
        motion=translation(shift), n_frames=6, shape=SHAPE, photometry=Photometry(noise=2.0)
    )


@pytest.mark.parametrize("jump", [(45.0, -15.0), (-80.0, 20.0)], ids=["45", "80"])
def test_points_are_followed_over_a_jump_of_the_whole_image(jump):
    clip = jumping(jump)
    points = detect(clip.frame(0), "gftt").filter_by_roi(15, 15, 230, 170).top_n(60).keypoints
    result = Tracker(clip.source(), points).run()
    seen = clip.visible(points, margin=12)
    found = np.isfinite(result.positions[..., 0])
    assert seen[-1].sum() >= 20
    assert found[seen].mean() > 0.98
    error = np.linalg.norm(result.positions - clip.truth(points), axis=2)
    assert np.nanmax(error) < 0.15


def test_the_shift_of_an_image_has_its_direction():
    clip = jumping((30.0, -12.0))
    np.testing.assert_allclose(whole_shift(clip.frame(2), clip.frame(3)), [30.5, -11.7], atol=1.0)


def still(texture):
    return Scene(
        texture=texture, motion=translation(lambda _k: np.zeros(2)), n_frames=1, shape=SHAPE
    ).frame(0)


@pytest.mark.parametrize("kind", ["black", "another", "nothing", "tiny"])
def test_images_that_have_nothing_in_common_have_no_shift(kind):
    nothing = np.zeros(SHAPE, np.uint8)
    before, after = {
        "black": (still(speckle()), nothing),
        "another": (still(speckle()), still(speckle(seed=5))),
        "nothing": (nothing, nothing),
        "tiny": (nothing[:4, :4], nothing[:4, :4]),
    }[kind]
    np.testing.assert_array_equal(whole_shift(before, after), [0.0, 0.0])
