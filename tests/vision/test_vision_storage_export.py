"""Runs for a reservoir: what is dropped, what is filled, and what stays missing."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from openprc.errors import ConfigError, MissingData, ResultExists
from openprc.reservoir import StateLoader
from openprc.schema import Provenance, Trajectory, TrajectoryWriter, validate_file
from openprc.vision import NormalizedCalibration, Status, TrackingResult, TrajectorySet
from openprc.vision.storage.export import to_simulation
from openprc.vision.storage.extension import NAME, check, declare_tracking, tracking_rows

T, N = 40, 5
TIME = np.arange(T) / 20


@pytest.fixture
def tracks():
    rest = np.array([[0.0, 0.0], [3.0, 4.0], [6.0, 0.0], [9.0, 4.0], [12.0, 0.0]])
    stretch = 1 + 0.1 * np.sin(2 * np.pi * TIME)
    positions = stretch[:, None, None] * rest[None] + [50.0, 40.0]
    positions[10:13, 1] = np.nan
    positions[20:32, 2] = np.nan
    positions[5:, 3] = np.nan
    sigma = np.where(np.isnan(positions), np.nan, 0.01)
    return TrajectorySet(positions, TIME, sigma=sigma, feature_ids=[7, 11, 13, 17, 19], units="mm")


def test_rare_points_go_short_gaps_are_filled_and_the_rest_stays_missing(tracks, tmp_path):
    path = tracks.to_simulation(tmp_path / "run.h5", min_ratio=0.6, max_gap=5)
    report = validate_file(path)
    assert report.ok
    assert [finding.code for finding in report.findings] == ["OPS-I04"]
    with Trajectory(path) as run:
        assert run.node("label").tolist() == ["p7", "p11", "p13", "p19"]
        marks = run.observed()
        assert (marks[10:13, 1] == 2).all()
        assert (marks[20:32, 2] == 0).all()
        assert np.isnan(run.positions()[20:32, 2]).all()
        assert int((marks == 0).sum()) == 12
        notes = "\n".join(run.provenance["notes"])
        assert "1 of 5 points were seen in less than 60% of the frames and left out: 17" in notes
        assert "1 gaps (3 positions) were filled, linear; 1 longer ones stay open" in notes
        assert "12 positions of 1 points are still missing" in notes
        status = run.extension(NAME, "status")
        assert (status[10:13, 1] == Status.INTERPOLATED).all()
        assert list(check(run)) == []
    loader = StateLoader(path)
    assert np.isfinite(loader.positions([0, 1, 3])).all()
    with pytest.raises(MissingData):
        loader.positions([2])


def test_nothing_is_filled_unless_asked(tracks, tmp_path):
    with Trajectory(tracks.to_simulation(tmp_path / "run.h5")) as run:
        np.testing.assert_array_equal(run.positions(), tracks.positions)
        np.testing.assert_array_equal(run.observed(), tracks.observed)


def test_only_complete_points(tracks, tmp_path):
    with Trajectory(tracks.to_simulation(tmp_path / "run.h5", min_ratio=1.0)) as run:
        assert run.node("label").tolist() == ["p7", "p19"]
        assert np.isfinite(run.positions()).all()


def test_bars_join_points_by_their_number_before_any_was_left_out(tracks, tmp_path):
    bars = [[0, 1], [1, 2], [4, 0]]
    path = to_simulation(
        tracks, tmp_path / "run.h5", min_ratio=0.6, max_gap=5, bars=bars, velocities=True
    )
    assert {f.code for f in validate_file(path).findings} == {"OPS-I04", "OPS-C01"}
    stretch = 1 + 0.1 * np.sin(2 * np.pi * TIME)
    with Trajectory(path) as run:
        np.testing.assert_array_equal(run.indices("bars"), [[0, 1], [1, 2], [3, 0]])
        lengths = run.element("bars", "length")
        np.testing.assert_allclose(lengths[:10, 0], 5 * stretch[:10])
        np.testing.assert_allclose(lengths[:, 2], 12 * stretch)
        np.testing.assert_allclose(run.element("bars", "strain")[:, 2], stretch - 1, atol=1e-12)
        np.testing.assert_allclose(run.element_static("bars", "rest_length"), [5, 5, 12])
        assert np.isnan(lengths[20:32, 1]).all()
        assert run.unit("/time_series/elements/bars/length") == "mm"
        assert run.unit("/time_series/nodes/velocities") == "mm/s"
        velocity = run.velocities()[5, 3, 0]
        assert velocity == pytest.approx(12 * 0.2 * np.pi * np.cos(2 * np.pi * TIME[5]), abs=0.2)
    np.testing.assert_allclose(StateLoader(path).bar_lengths([2])[:, 0], 12 * stretch)


@pytest.mark.parametrize(
    ("settings", "error", "words"),
    [
        ({"min_ratio": 1.5}, ConfigError, "min_ratio is 1.5"),
        ({"bars": [[0, 3]], "min_ratio": 0.6}, ConfigError,
         "bar 0 ends at point 3, seen in 12.5% of the frames and left out"),
        ({"bars": [[0, 9]]}, ConfigError, "bar 0 ends at point 9"),
        ({"bars": [[0, -1]]}, ConfigError, "bar 0 ends at point -1"),
        ({"bars": [0, 1]}, ConfigError, r"bars of shape \(2,\)"),
        ({"bars": [[0.0, 1.0]]}, ConfigError, "type float64"),
        ({"max_gap": -1}, ConfigError, "max_gap is -1"),
    ],
)  # fmt: skip
def test_settings_that_make_no_sense(tracks, tmp_path, settings, error, words):
    with pytest.raises(error, match=words):
        tracks.to_simulation(tmp_path / "run.h5", **settings)
    assert list(tmp_path.iterdir()) == []


def test_bars_need_two_points_that_are_seen_together(tmp_path):
    positions = np.random.default_rng(0).standard_normal((6, 3, 2))
    positions[:3, 0] = np.nan
    positions[3:, 1] = np.nan
    apart = TrajectorySet(positions, np.arange(6.0))
    with pytest.raises(ConfigError, match="points 0 and 1 of bar 0 are never seen in the same"):
        apart.to_simulation(tmp_path / "run.h5", bars=[[0, 1]])
    same = TrajectorySet(np.zeros((6, 2, 2)), np.arange(6.0))
    with pytest.raises(ConfigError, match="points 0 and 1 of bar 0 coincide"):
        same.to_simulation(tmp_path / "run.h5", bars=[[0, 1]])


def test_no_point_is_seen_often_enough(tracks, tmp_path):
    poor = tracks.select_features([1, 2, 3])
    with pytest.raises(MissingData, match=r"the best of 3 points is seen in 92.5% of the frames"):
        poor.to_simulation(tmp_path / "run.h5", min_ratio=0.99)


def test_an_existing_run_is_kept(tracks, tmp_path):
    path = tracks.to_simulation(tmp_path / "run.h5")
    with pytest.raises(ResultExists):
        tracks.to_simulation(path)
    tracks.to_simulation(path, overwrite=True, min_ratio=1.0)
    with Trajectory(path) as run:
        assert run.n_nodes == 2


def test_lengths_on_unequal_axes_are_warned_of(tmp_path):
    positions = np.random.default_rng(0).uniform(10, 90, (6, 3, 2))
    result = TrackingResult(
        positions=positions, status=np.zeros((6, 3), "u1"), timestamps=np.arange(6) / 10
    )
    for isotropic in (False, True):
        calibration = NormalizedCalibration((100, 200), isotropic=isotropic)
        tracks = TrajectorySet.from_tracking_result(result, calibration=calibration)
        if isotropic:
            tracks.to_simulation(tmp_path / "even.h5", bars=[[0, 1]], velocities=True)
        else:
            with pytest.warns(UserWarning, match="x and y have different scales"):
                tracks.to_simulation(tmp_path / "uneven.h5", bars=[[0, 1]])
    with Trajectory(tmp_path / "even.h5") as run:
        assert run.unit("/time_series/nodes/velocities") == "1/s"


def test_points_with_the_same_number_have_no_names(tmp_path):
    tracks = TrajectorySet(np.zeros((4, 2, 2)), np.arange(4.0), feature_ids=[3, 3])
    with Trajectory(tracks.to_simulation(tmp_path / "run.h5")) as run:
        assert not run.has("/topology/nodes/label")
        assert any("the same number" in note for note in run.provenance["notes"])


# --- the check of the extension -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "codes"),
    [
        (None, []),
        (("status", (39, 0), 6), ["VISION-01"]),
        (("status", (39, 0), Status.LOST), ["VISION-02"]),
        (("status", (39, 3), Status.OOB), []),
    ],
    ids=["good", "unknown code", "lost with a position", "lost without"],
)
def test_check_of_the_extension(tracks, tmp_path, monkeypatch, change, codes):
    monkeypatch.setattr("openprc.vision.storage.extension._BLOCK", 16)
    path = tracks.to_simulation(tmp_path / "run.h5")
    if change is not None:
        name, place, value = change
        with h5py.File(path, "r+") as file:
            file[f"extensions/{NAME}/{name}"][place] = value
    with Trajectory(path) as run:
        findings = list(check(run))
    assert [finding.code for finding in findings] == codes
    assert all("frame 39" in finding.found for finding in findings)


def test_a_file_without_status_passes(tmp_path):
    with TrajectoryWriter(tmp_path / "run.h5", provenance=Provenance("test")) as writer:
        writer.declare_nodes(1, 2, unit="px")
        declare_tracking(writer, 1, 2, unit="px", names=("quality",))
        rows = tracking_rows({"quality": [[1.0]]})
        writer.append([0.0], positions=[[[1.0, 2.0]]], extensions=rows)
    with Trajectory(tmp_path / "run.h5") as run:
        assert list(check(run)) == []
        assert run.extension_names(NAME) == ("quality",)
