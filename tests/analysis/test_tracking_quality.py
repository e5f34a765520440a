"""The picture of tracking quality: what is drawn, with which units."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.analysis.visualization.tracking_quality import plot_tracking_quality
from openprc.errors import MissingData
from openprc.vision.tracking.result import TrackingResult
from openprc.vision.tracking.status import Status

pytest.importorskip("matplotlib")


def tracks(n_frames=20, n_points=4, *, refined=True, dtype=np.float64):
    rng = np.random.default_rng(0)
    positions = (
        20.0 + 15.0 * np.arange(n_points)[None, :, None] + rng.normal(size=(n_frames, n_points, 2))
    )
    status = np.zeros((n_frames, n_points), np.uint8)
    status[0] = Status.REFERENCE
    status[n_frames // 2 :, 0] = Status.LOST
    positions[n_frames // 2 :, 0] = np.nan
    extra = {}
    if refined:
        extra["quality"] = np.full((n_frames, n_points), 0.97, np.float32)
        extra["sigma"] = np.full((n_frames, n_points, 2), 0.02, np.float32)
        extra["sigma"][..., 1] = 0.04
    return TrackingResult(
        positions=positions, status=status, timestamps=np.arange(n_frames) / 10.0, **extra
    )


IMAGE = np.random.default_rng(1).integers(0, 255, (100, 120)).astype(np.uint8)


def panels(plot):
    return {axes.get_xlabel(): axes for axes in plot.figure.axes}


def test_all_panels_have_units_and_figures(tmp_path):
    plot = plot_tracking_quality(IMAGE, tracks(), title="clip.avi", unit_per_px=0.5, unit="mm")
    found = panels(plot)
    assert set(found) == {
        "x [px]", "time [s]", "correlation with the template (ZNCC)",
        "one-sigma of the position, worse axis [px]", "time along the tracks [s]",
    }  # fmt: skip
    assert found["time [s]"].get_ylabel() == "points [%]"
    assert found["time [s]"].get_title() == "found at the end: 75 % of 4"
    assert found["correlation with the template (ZNCC)"].get_title() == "quality: median 0.9700"
    words = "sigma: median 0.04 px = 0.02 mm"
    assert found["one-sigma of the position, worse axis [px]"].get_title() == words
    path = plot.save(tmp_path / "quality.png")
    assert path.stat().st_size > 10_000


def test_curves_are_the_fractions():
    axes = panels(plot_tracking_quality(IMAGE, tracks()))["time [s]"]
    curves = {line.get_label(): line.get_ydata() for line in axes.lines}
    np.testing.assert_allclose(curves["found"], [100.0] * 10 + [75.0] * 10)
    np.testing.assert_allclose(curves["lost"], [0.0] * 10 + [25.0] * 10)
    assert set(curves) == {"found", "lost"}


def test_plain_tracks_say_that_nothing_is_known():
    found = panels(plot_tracking_quality(IMAGE, tracks(refined=False)))
    for name in (
        "correlation with the template (ZNCC)", "one-sigma of the position, worse axis [px]",
    ):  # fmt: skip
        assert "refine is none" in found[name].texts[0].get_text()


@pytest.mark.parametrize("shape", [(40, 640), (300, 80), (100, 120, 3)])
def test_strips_towers_and_colour(shape, tmp_path):
    image = np.random.default_rng(1).integers(0, 255, shape).astype(np.uint8)
    plot_tracking_quality(image, tracks()).save(tmp_path / "quality.png", dpi=60)


def test_one_frame_and_no_frame(tmp_path):
    plot_tracking_quality(IMAGE, tracks(n_frames=1)).save(tmp_path / "one.png", dpi=60)
    none = TrackingResult(
        positions=np.zeros((3, 0, 2)), status=np.zeros((3, 0), np.uint8), timestamps=np.arange(3.0)
    )
    with pytest.raises(MissingData, match="there are no tracks"):
        plot_tracking_quality(IMAGE, none)
