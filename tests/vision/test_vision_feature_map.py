"""Feature maps: one feature for each place, ranked, chosen, and foretold how well tracked."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import ConfigError
from openprc.vision import FeatureMap, KLTConfig, Tracker, detect
from openprc.vision.detection.trackability import predicted_sigma
from openprc.vision.synth import cases, cramer_rao


def made(points, **columns):
    return FeatureMap.from_points(points, frame_shape=(100, 200), **columns)


@pytest.fixture(scope="module")
def scene():
    return cases.case("translation", n_frames=2, noise=0.0, shape=(240, 320))


@pytest.fixture(scope="module")
def image(scene):
    return next(scene.frames())


def distances(found):
    gaps = np.linalg.norm(found.keypoints[:, None] - found.keypoints, axis=2)
    return gaps[~np.eye(len(found), dtype=bool)]


def test_the_best_of_sift_lie_at_different_places(image):
    found = detect(image, "sift")
    assert distances(found).min() == 0.0  # one for each orientation
    best = found.top_n(200)
    assert len(best) == 200
    assert distances(best).min() >= 1.0
    assert best.descriptors.shape == (200, 128)
    assert (np.diff(best.responses) <= 0).all()


def test_of_features_too_near_the_better_one_stays():
    found = made([(10, 10), (10.5, 10), (50, 50), (11.2, 10), (50, 50)], responses=[5, 9, 1, 4, 2])
    # Ranked 9, 5, 4, 2, 1: the one at 10 goes, and then nothing is near enough to 11.2 - 10.5.
    assert found.top_n(9, min_distance=0.6).responses.tolist() == [9, 4, 2]
    assert found.top_n(9, min_distance=0.8).responses.tolist() == [9, 2]
    assert found.top_n(9, min_distance=0).responses.tolist() == [9, 5, 4, 2, 1]
    # In the order that they have, not by response.
    assert found.unique().responses.tolist() == [5, 1, 4]


@pytest.mark.parametrize("distance", [0.3, 1.0, 4.0, 37.0])
def test_places_apart_agree_with_comparing_all_pairs(distance):
    points = np.random.default_rng(3).uniform(0, [199, 99], (300, 2)).round(1)
    expected = []
    for i, point in enumerate(points):
        if all(np.hypot(*(point - points[j])) >= distance for j in expected):
            expected.append(i)
    np.testing.assert_array_equal(
        made(points).unique(min_distance=distance).keypoints, points[expected]
    )


def test_fewer_than_asked_come_with_a_note():
    best = made([(10, 10), (10, 10), (30, 30)]).top_n(5)
    assert len(best) == 2
    assert best.notes == (
        "5 features were asked for and 2 are there, 1 more lie within 1 px of a better one",
    )
    assert made([(10, 10)]).top_n(1).notes == ()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"n": 0}, "n is 0(.|\n)*whole number from 1"),
        ({"n": 2.5}, "n is 2.5"),
        ({"n": 2, "min_distance": -1}, "min_distance is -1"),
        ({"n": 2, "min_distance": float("nan")}, "min_distance is nan"),
        ({"n": 2, "by": "size"}, "by is 'size'(.|\n)*'response' or 'trackability'"),
        ({"n": 2, "by": "trackability"}, r"no feature has a trackability(.|\n)*rated\(image\)"),
    ],
    ids=["none", "half", "negative", "nan", "by", "unrated"],
)
def test_a_wrong_choice_is_refused(settings, words):
    with pytest.raises(ConfigError, match=words):
        made([(10, 10)]).top_n(settings.pop("n"), **settings)


def test_select_takes_masks_and_indices():
    found = made([(1, 1), (2, 2), (3, 3)], descriptors=np.arange(6).reshape(3, 2))
    picked = found.select([True, False, True])
    assert picked.keypoints.tolist() == [[1, 1], [3, 3]]
    assert picked.descriptors.tolist() == [[0, 1], [4, 5]]
    assert found.select([2, 0]).keypoints.tolist() == [[3, 3], [1, 1]]
    assert len(found.select([])) == 0
    with pytest.raises(ConfigError, match=r"mask of shape \(2,\)(.|\n)*\(3,\)"):
        found.select([True, False])
    for wrong in ([0.5], [3], [[0, 1]]):
        with pytest.raises(ConfigError, match="whole numbers below 3"):
            found.select(wrong)


def test_regions_and_masks_choose_by_place():
    found = made([(10, 10), (20, 10), (20.4, 30.6), (199, 99)])
    assert found.filter_by_roi(15, 5, 10, 30).keypoints.tolist() == [[20, 10], [20.4, 30.6]]
    mask = np.zeros((100, 200), np.uint8)
    mask[31, 20] = mask[99, 199] = 255
    assert found.filter_by_mask(mask).keypoints.tolist() == [[20.4, 30.6], [199, 99]]
    with pytest.raises(ConfigError, match=r"a mask of 100 x 200 px(.|\n)*200 x 100"):
        found.filter_by_mask(mask.T)


@pytest.mark.parametrize(
    ("points", "words"),
    [
        ([(200, 5)], r"point 0 lies at \(200, 5\)(.|\n)*x from 0 to 199 and y from 0 to 99"),
        ([(5, 5), (np.nan, 5)], "point 1 lies at"),
        ([(-1, 5)], "y points down"),
        ([(1, 2, 3)], r"\(1, 3\)(.|\n)*\(N, 2\)"),
    ],
    ids=["right", "nan", "left", "three"],
)
def test_points_outside_the_frame_are_refused(points, words):
    with pytest.raises(ConfigError, match=words):
        made(points)


def test_columns_of_different_length_are_refused():
    with pytest.raises(ConfigError, match="responses has 2 rows for 1 keypoints"):
        made([(1, 1)], responses=[1, 2])


def test_no_points_make_an_empty_map():
    empty = made([])
    assert len(empty) == 0
    assert empty.keypoints.shape == (0, 2)
    assert len(empty.unique()) == len(empty.top_n(3, by="trackability")) == 0


@pytest.mark.parametrize("noise", [0.0, 1.0, 5.0])
def test_the_foretold_sigma_is_the_cramer_rao_bound(image, noise):
    grid = np.array([(x, y) for x in range(20, 300, 35) for y in range(20, 220, 35)], float)
    bound = np.linalg.norm(cramer_rao(image, grid, noise=noise), axis=1)
    sigma = predicted_sigma(image, grid, noise=noise)
    # The worst direction lies between the larger coordinate and both together.
    assert (sigma < 1.02 * bound).all()
    assert (sigma > 0.98 * bound / np.sqrt(2)).all()


def test_noise_in_the_frame_can_be_taken_off_the_prediction(image):
    grid = np.array([(x, y) for x in range(20, 300, 35) for y in range(20, 220, 35)], float)
    noisy = image + np.random.default_rng(0).normal(0, 10.0, image.shape)
    found = FeatureMap.from_points(grid, frame_shape=image.shape, image=image)
    noisy = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    shaken = FeatureMap.from_points(grid, frame_shape=image.shape, image=noisy)
    true = found.trackability(noise=10.0)
    assert np.median(shaken.trackability(noise=10.0) / true) < 0.85
    mended = shaken.trackability(noise=10.0, image_noise=10.0) / true
    assert np.median(mended) == pytest.approx(1.0, abs=0.03)


def test_windows_beyond_the_frame_and_edges_without_slope_are_flagged():
    edge = np.full((60, 80), 50, np.uint8)
    edge[:, 40:] = 200
    found = FeatureMap.from_points([(40, 30), (9, 30), (20, 30)], frame_shape=(60, 80), image=edge)
    # Along the edge, and where nothing is: no precision at all. At x = 9 the window leaves.
    assert found.track_sigma[0] == np.inf
    assert found.track_sigma[2] == np.inf
    assert np.isnan(found.track_sigma[1])
    assert np.isnan(found.trackability()[1])


def test_features_that_cannot_be_tracked_rank_last(image):
    points = [(3, 3), (100, 100), (160, 120)]
    found = FeatureMap.from_points(points, frame_shape=image.shape, image=image)
    best = found.top_n(3, by="trackability")
    assert best.keypoints[2].tolist() == [3, 3]
    assert best.track_sigma[0] <= best.track_sigma[1]
    assert np.isnan(best.track_sigma[2])


def test_a_map_is_rated_by_its_own_frame(image):
    found = made([(50, 50)])
    with pytest.raises(ConfigError, match=r"320 x 240 px(.|\n)*200 x 100 px"):
        found.rated(image)
    with pytest.raises(ConfigError, match=r"window is 20 px(.|\n)*odd"):
        found.rated(image[:100, :200], window=20)
    wide = found.rated(image[:100, :200], window=31)
    assert wide.track_sigma < found.rated(image[:100, :200]).track_sigma


@pytest.mark.parametrize("seed", [1, 2])
def test_ranking_by_trackability_makes_better_tracks_than_responses_of_sift(seed):
    """On weak texture: Miura facets, noise of 5 grey levels, plain Lucas-Kanade."""
    scene = cases.case("miura", noise=5.0, n_frames=5, shape=(240, 320), seed=seed)
    first = next(scene.frames())
    sift, gftt = detect(first, "sift"), detect(first, "gftt")
    chosen = {
        "sift": sift.top_n(60),
        "sift-ranked": sift.top_n(60, by="trackability", min_distance=10),
        "gftt-ranked": gftt.top_n(60, by="trackability", min_distance=10),
    }
    rms = {}
    for name, found in chosen.items():
        inner = found.filter_by_roi(15, 15, 289, 209)
        result = Tracker(scene.source(fps=30.0), inner, config=KLTConfig(refine="none")).run()
        error = np.linalg.norm(result.positions - scene.truth(inner.keypoints), axis=2)
        rms[name] = np.sqrt(np.nanmean(error**2))
    assert 1.5 * rms["sift-ranked"] < rms["sift"]
    assert 1.5 * rms["gftt-ranked"] < rms["sift"]
