"""What is done with features once they are found."""

from __future__ import annotations

import re

import numpy as np
import pytest

from openprc.errors import ConfigError, NoFeaturesError
from openprc.vision import FeatureMap, detect
from openprc.vision.detection.trackability import predicted_sigma
from openprc.vision.synth import cases, cramer_rao

pytest.importorskip("cv2")

SHAPE = (120, 160)


def some(points, *, responses=None, sigma=None):
    made = FeatureMap.from_points(points, frame_shape=SHAPE)
    n = len(made)
    return FeatureMap(
        keypoints=made.keypoints,
        descriptors=np.arange(n)[:, None] * np.ones((1, 3)),
        responses=np.asarray(range(n, 0, -1) if responses is None else responses, float),
        sizes=made.sizes, angles=made.angles, octaves=made.octaves,
        track_sigma=np.asarray(made.track_sigma if sigma is None else sigma, float),
        detector_name="made up", frame_shape=SHAPE,
    )  # fmt: skip


def test_the_best_come_first_and_nothing_comes_twice():
    found = some([[10, 10], [10, 10], [50, 50], [10.6, 10], [90, 90]], responses=[5, 4, 9, 8, 1])
    best = found.top_n(3)
    np.testing.assert_array_equal(best.keypoints, [[50, 50], [10.6, 10], [90, 90]])
    np.testing.assert_array_equal(best.descriptors[:, 0], [2, 3, 4])
    np.testing.assert_array_equal(best.responses, [9, 8, 1])
    assert best.notes == ()


def test_fewer_than_asked_for_is_told():
    found = some([[10, 10], [10, 10.5], [50, 50]])
    best = found.top_n(5)
    assert len(best) == 2
    assert best.notes == (
        "5 features were asked for and 2 are there, 1 more lie within 1 px of a better one",
    )


def test_every_keypoint_is_kept_where_no_distance_is_asked():
    assert len(some([[10, 10], [10, 10]]).top_n(2, min_distance=0)) == 2


def test_distance_is_kept_to_better_features_only():
    # The middle one is dropped for the first, so the third has nothing near it.
    found = some([[10, 10], [16, 10], [22, 10]])
    np.testing.assert_array_equal(found.unique(min_distance=8).keypoints[:, 0], [10, 22])
    np.testing.assert_array_equal(found.unique(min_distance=6).keypoints[:, 0], [10, 16, 22])


def test_unique_does_what_the_plain_loop_does():
    rng = np.random.default_rng(0)
    found = some(rng.uniform(0, 100, (300, 2)))
    kept: list[np.ndarray] = []
    for point in found.keypoints:
        if all(np.hypot(*(point - other)) >= 7 for other in kept):
            kept.append(point)
    np.testing.assert_array_equal(found.unique(min_distance=7).keypoints, kept)


def test_by_trackability_the_unknown_come_last():
    found = some([[10, 10], [40, 10], [70, 10]], sigma=[np.nan, 0.5, 0.1])
    best = found.top_n(3, by="trackability")
    np.testing.assert_array_equal(best.keypoints[:, 0], [70, 40, 10])


def test_rectangles_and_masks_choose():
    found = some([[10, 10], [40, 10], [70, 90]])
    np.testing.assert_array_equal(found.filter_by_roi(5, 5, 40, 20).keypoints[:, 0], [10, 40])
    mask = np.zeros(SHAPE, bool)
    mask[80:100, 60:80] = True
    np.testing.assert_array_equal(found.filter_by_mask(mask).keypoints, [[70, 90]])


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda f: f.top_n(0), "n is 0"),
        (lambda f: f.top_n(2, by="size"), "by is 'size'"),
        (lambda f: f.select(np.ones(3, bool)), "a mask of shape (3,)"),
        (lambda f: f.filter_by_mask(np.ones((3, 4))), "a mask of shape (3, 4)"),
        (lambda f: FeatureMap.from_points([[1, 2, 3]], frame_shape=SHAPE), "shape (1, 3)"),
        (
            lambda f: FeatureMap.from_points([[1, 130]], frame_shape=SHAPE),
            "point 0 lies at (1, 130",
        ),
        (
            lambda f: FeatureMap.from_points([[np.nan, 1]], frame_shape=SHAPE),
            "point 0 lies at (nan",
        ),
    ],
    ids=["n", "by", "mask-length", "mask-shape", "columns", "outside", "nan"],
)
def test_what_cannot_be_done_is_told(call, words):
    with pytest.raises(ConfigError, match=re.escape(words)):
        call(some([[10, 10], [50, 50]]))


def test_an_empty_map_is_refused_where_points_are_needed():
    with pytest.raises(NoFeaturesError, match="the detector 'points' finds nothing in frame 3"):
        FeatureMap.from_points([], frame_shape=SHAPE, ref_frame_index=3).require()


# --- trackability ---


def test_predicted_sigma_is_the_bound_of_the_worst_direction():
    clip = cases.case("translation", noise=0.0, shape=(200, 260))
    image = clip.clean(0)
    points = np.random.default_rng(1).uniform(20, 180, (40, 2))
    bound = cramer_rao(image, points, noise=np.sqrt(1 - 1 / 12))
    sigma = predicted_sigma(image.astype(np.float32), points, noise=1.0)
    # The bound is along x and y, the prediction along the worst direction: no smaller, and
    # no larger than both together.
    assert (sigma >= 0.98 * bound.max(axis=1)).all()
    assert (sigma <= 1.02 * np.hypot(*bound.T)).all()


def test_predicted_sigma_of_stripes_is_infinite_and_of_the_edge_unknown():
    stripes = np.tile((100 + 50 * np.sin(np.arange(120.0)))[:, None], (1, 160)).astype(np.uint8)
    sigma = predicted_sigma(stripes, [[60, 60], [5, 60], [60, 114]])
    assert np.isinf(sigma[0])
    assert np.isnan(sigma[1:]).all()


def test_ranking_by_trackability_gives_better_tracks_than_the_response_of_sift():
    image = cases.case("miura", noise=0.0, seed=4).frame(0)
    found = detect(image, "sift").filter_by_roi(15, 15, 450, 330)
    by_response = found.top_n(60, min_distance=10)
    by_sigma = found.top_n(60, by="trackability", min_distance=10)
    corners = detect(image, "gftt").filter_by_roi(15, 15, 450, 330).top_n(60, min_distance=10)
    # Foretold errors; the benchmark of tracking accuracy measures them.
    assert np.mean(by_sigma.track_sigma) < 0.8 * np.mean(by_response.track_sigma)
    assert np.mean(corners.track_sigma) < 0.8 * np.mean(by_response.track_sigma)
