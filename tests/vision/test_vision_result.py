"""`TrackingResult`: shapes, ratios, summary."""

from __future__ import annotations

import json

import numpy as np
import pytest

from openprc.errors import ConfigError
from openprc.vision import Status, TrackingResult


@pytest.fixture
def result():
    status = np.array([[5, 5, 2], [0, 1, 2], [0, 0, 2], [3, 0, 2]], np.uint8)
    positions = np.where(np.isin(status, (0, 5))[..., None], 1.0, np.nan) * np.ones(2)
    template = np.array([[0, 0, 0], [0, 3, 0], [1, 1, 0], [2, 0, 0]], np.int32)
    return TrackingResult(
        positions=positions, status=status, timestamps=np.arange(4) / 10.0, template=template
    )


def test_ratios_count_the_reference_frame(result):
    np.testing.assert_allclose(result.track_ratios(), [0.75, 0.75, 0.0])
    np.testing.assert_allclose(result.alive(), [2 / 3, 1 / 3, 2 / 3, 1 / 3])
    assert (result.n_frames, result.n_features, result.fps) == (4, 3, pytest.approx(10.0))


def test_renewals_count_where_the_point_was_seen(result):
    assert result.template_updates().tolist() == [1, 1, 0]


def test_what_is_not_known_is_nan(result):
    assert np.isnan(result.quality).all()
    assert np.isnan(result.sigma).all()
    assert np.isnan(result.deformation).all()


def test_filter_keeps_the_names_of_the_points(result):
    kept = result.filter(result.track_ratios() >= 0.6)
    assert kept.feature_ids.tolist() == [0, 1]
    assert kept.positions.shape == (4, 2, 2)
    assert result.n_features == 3


@pytest.mark.parametrize("mask", [np.array([0, 1]), np.array([True, False]), [1, 0, 1]])
def test_a_mask_is_one_bool_for_each_point(result, mask):
    with pytest.raises(ConfigError, match="the mask is"):
        result.filter(mask)


def test_the_summary_is_plain_and_adds_up(result):
    summary = json.loads(json.dumps(result.summary()))
    assert summary["found_fraction"] == pytest.approx(0.5)
    assert summary["fraction_by_status"]["oob"] == pytest.approx(1 / 3)
    assert sum(summary["fraction_by_status"].values()) == pytest.approx(1.0)
    assert summary["median_quality"] is None
    assert summary["points_never_lost"] == 0
    assert set(summary["fraction_by_status"]) == {code.name.lower() for code in Status}


def test_arrays_of_different_runs_are_refused(result):
    with pytest.raises(ConfigError, match=r"status has the shape \(3, 3\)"):
        TrackingResult(
            positions=result.positions, status=result.status[1:], timestamps=result.timestamps
        )
    with pytest.raises(ConfigError, match=r"positions have the shape \(4, 3\)"):
        TrackingResult(
            positions=result.positions[..., 0],
            status=result.status,
            timestamps=result.timestamps,
        )
