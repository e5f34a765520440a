"""A video becomes a trajectory: accuracy, clock, lost points, calibration, and what is refused."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from openprc.errors import CalibrationError, ConfigError
from openprc.schema import Provenance, Trajectory, TrajectoryWriter
from openprc.vision import samples
from openprc.vision.producer import VisionProducer
from openprc.vision.synth import cases

cv2 = pytest.importorskip("cv2")

DATA = Path(__file__).resolve().parents[2] / "../shared/data/vision"
real_data = pytest.mark.skipif(not DATA.exists(), reason="recorded videos are not here")


def convert(path, out, producer=None, **options):
    with TrajectoryWriter(out, provenance=Provenance("vision"), on_failure="discard") as writer:
        (producer or VisionProducer()).import_run(Path(path), writer, options=options)
    return Trajectory(out)


def write_points(path, points):
    path.write_text("x,y\n" + "".join(f"{x},{y}\n" for x, y in points))
    return path


def notes(run):
    return "\n".join(run.provenance["notes"])


def grid(clip, n=4, margin=25):
    height, width = clip.shape
    x, y = np.meshgrid(
        np.linspace(margin, width - margin, n), np.linspace(margin, height - margin, n)
    )
    return np.column_stack([x.ravel(), y.ravel()]).round(1)


@pytest.fixture(scope="module")
def affine(tmp_path_factory):
    clip = cases.case("affine", noise=1.0, n_frames=12, shape=(120, 160))
    return clip, clip.write(tmp_path_factory.mktemp("affine") / "affine.avi", fps=25.0)


@pytest.fixture(scope="module")
def occluded(tmp_path_factory):
    clip = cases.case("occlusion", noise=1.0, n_frames=24, shape=(160, 200))
    return clip, clip.write(tmp_path_factory.mktemp("occluded") / "occluded.avi")


@pytest.fixture
def points(affine, tmp_path):
    return write_points(tmp_path / "points.csv", grid(affine[0]))


def test_import_of_the_package_does_not_load_opencv():
    code = (
        "import sys, openprc.vision, openprc.vision.producer, openprc.vision.samples;"
        "sys.exit(bool({'cv2', 'numba', 'scipy'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# --- exact motion ---


def test_tracks_follow_the_closed_form_and_sigma_tells_how_well(affine, points, tmp_path):
    clip, path = affine
    with convert(path, tmp_path / "run.h5", points=points) as run:
        assert (run.n_frames, run.n_nodes, run.dims) == (12, 16, 2)
        assert run.position_unit == "px"
        assert run.dt == pytest.approx(1 / 25)
        error = run.positions() - clip.truth(grid(clip))
        sigma = run.extension("openprc-vision", "sigma")
        assert run.extension("openprc-vision", "quality").min() > 0.9
        status = run.extension("openprc-vision", "status")
        np.testing.assert_array_equal(run.node("rest"), grid(clip))
        assert list(run.node("label"))[:2] == ["p0", "p1"]
        record = json.loads(run.extension("openprc-vision", "record")[0])
    assert np.sqrt((error**2).mean()) < 0.02
    assert 0.5 < np.sqrt((error[1:] ** 2).mean() / (sigma[1:] ** 2).mean()) < 2.0
    assert (status[0] == 5).all()
    assert (status[1:] == 0).all()
    assert record["source"]["codec"].upper() == "FFV1"
    assert record["figures"]["alive_at_end"] == 16
    assert record["figures"]["noise_grey_levels"] == pytest.approx(1.0, rel=0.25)
    assert str(tmp_path) not in json.dumps(record)


@pytest.mark.parametrize("detector", ["shi-tomasi", "sift", "orb", "akaze"])
def test_points_of_every_detector_follow_the_closed_form(affine, tmp_path, detector):
    clip, path = affine
    with convert(path, tmp_path / "run.h5", detector=detector, max_points=30) as run:
        assert 8 <= run.n_nodes <= 30
        places = run.positions()
        gap = np.linalg.norm(places[0][:, None] - places[0][None], axis=2)
        error = places - clip.truth(places[0])
    assert gap[~np.eye(len(gap), dtype=bool)].min() >= 10.5
    assert np.sqrt(np.nanmean(error**2)) < 0.05


def test_plain_lucas_kanade_has_no_sigma(affine, points, tmp_path):
    clip, path = affine
    with convert(path, tmp_path / "run.h5", points=points, refine="none") as run:
        error = run.positions() - clip.truth(grid(clip))
        assert np.isnan(run.extension("openprc-vision", "sigma")).all()
    # What it loses to the refinement is the stretch of its windows.
    assert 0.03 < np.sqrt(np.nanmean(error**2)) < 0.5


def test_points_are_placed_in_the_reference_frame(affine, tmp_path):
    clip, path = affine
    start = clip.truth(grid(clip))[6]
    listed = write_points(tmp_path / "there.csv", start)
    with convert(path, tmp_path / "run.h5", points=listed, reference_frame=6) as run:
        error = run.positions() - clip.truth(grid(clip))
        np.testing.assert_array_equal(run.positions()[6], start)
    assert np.sqrt(np.nanmean(error**2)) < 0.02


def test_sample_names_the_symbols_that_drive_it():
    assert samples.symbols().shape == (500, 1)


@real_data
def test_mechanism_agrees_with_the_reference_correlation_code(tmp_path):
    table = np.genfromtxt(DATA / "mechanism_reference.csv", delimiter=",", names=True)
    part = table[table["subset"] == 0][:40]
    centre = np.array([part["x_ref_px"][0], part["y_ref_px"][0]])
    offsets = [(x, y) for x in (-10, 0, 10) for y in (-10, 0, 10)]
    listed = write_points(tmp_path / "points.csv", centre + np.array(offsets))
    with convert(DATA / "mechanism_ffv1.avi", tmp_path / "run.h5", points=listed) as run:
        places = run.positions() - centre
    assert np.isfinite(places).all(axis=2).mean() > 0.6
    error = []
    for row, found in enumerate(np.isfinite(places).all(axis=2)):
        z, z0 = places[row, found] @ [1, 1j], places[0, found] @ [1, 1j]
        # Best rigid motion z -> a + b z0 of the points, |b| = 1 (Kabsch in the plane).
        turn = np.exp(1j * np.angle(((z - z.mean()) * (z0 - z0.mean()).conj()).sum()))
        error.append(z.mean() - turn * z0.mean() - (part["u_px"] + 1j * part["v_px"])[row])
    # Each axis to the uncertainty of the reference itself (see the README of the data).
    assert np.sqrt(np.mean(np.abs(error) ** 2) / 2) < 0.05


# --- the clock ---


@real_data
@pytest.mark.parametrize("name", ["vfr_h264.mkv", "vfr_h264.mp4"])
def test_variable_rate_keeps_the_true_times_and_resamples(tmp_path, name):
    true = np.genfromtxt(DATA / "codec/vfr_times_ms.csv", delimiter=",", names=True)["t_ms"]
    options = {"max_points": 8, "refine": "none"}
    with convert(DATA / "codec" / name, tmp_path / "run.h5", **options) as run:
        assert run.n_frames == 120
        np.testing.assert_allclose(run.time, true / 1e3, atol=1e-9)
        assert not run.uniform
        assert "in the time stamps" in notes(run)
        if name.endswith("mkv"):
            assert "declares 138 frames and delivered 120" in notes(run)
    with convert(DATA / "codec" / name, tmp_path / "even.h5", rate=20.0, **options) as run:
        assert run.uniform
        assert run.dt == pytest.approx(0.05)
        np.testing.assert_array_equal(np.isnan(run.positions()).any(axis=2), run.observed() == 0)


def test_rate_of_the_camera_wins(affine, points, tmp_path):
    with convert(affine[1], tmp_path / "run.h5", points=points, fps=15000.0) as run:
        np.testing.assert_allclose(run.time, np.arange(12) / 15000, rtol=1e-12)
        assert "the rate that was asked for" in notes(run)


# --- lost points ---


def test_occluded_points_are_missing_and_come_back(occluded, tmp_path):
    clip, path = occluded
    listed = write_points(tmp_path / "points.csv", grid(clip))
    producer = VisionProducer()
    with convert(path, tmp_path / "run.h5", producer, points=listed) as run:
        places, seen = run.positions(), run.observed()
        np.testing.assert_array_equal(np.isnan(places).any(axis=2), seen == 0)
        np.testing.assert_allclose(run.channel("fraction_tracked")[:, 0], (seen == 1).mean(axis=1))
    error = places - clip.truth(grid(clip))
    assert (seen == 0).any()
    assert np.nanmax(np.abs(error)) < 1.0
    figures = producer.tracked.figures
    assert figures["recovered"] >= 4
    assert figures["fraction_by_status"]["lost"] + figures["fraction_by_status"]["drift"] > 0.02


def test_gaps_are_filled_where_asked_and_flagged(occluded, tmp_path):
    clip, path = occluded
    listed = write_points(tmp_path / "points.csv", grid(clip))
    with convert(path, tmp_path / "run.h5", points=listed) as run:
        before, seen = run.positions(), run.observed()
    with convert(path, tmp_path / "filled.h5", points=listed, max_gap=30) as run:
        after, filled = run.positions(), run.observed()
        assert "gaps of up to 30 frames were filled" in notes(run)
        assert (run.extension("openprc-vision", "status")[filled == 2] == 4).all()
    assert (filled == 2).any()
    np.testing.assert_array_equal(after[seen == 1], before[seen == 1])
    np.testing.assert_array_equal(filled == 1, seen == 1)


def test_points_seen_too_rarely_are_left_out(occluded, tmp_path):
    clip, path = occluded
    listed = write_points(tmp_path / "points.csv", grid(clip))
    with convert(path, tmp_path / "run.h5", points=listed, min_ratio=0.82) as run:
        assert 0 < run.n_nodes < 16
        assert (run.observed() == 1).mean(axis=0).min() >= 0.82
        assert "and left out (min_ratio)" in notes(run)
        assert len(run.node("id")) == run.n_nodes


def test_points_at_rest_are_left_out(tmp_path):
    clip = cases.case("translation", noise=1.0, n_frames=8, shape=(80, 160))
    images = [image.copy() for image in clip.frames()]
    rng = np.random.default_rng(3)
    path = tmp_path / "half.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 30, (160, 80), False)
    for image in images:
        still = images[0][:, :80] + rng.normal(0, 1.0, (80, 80))
        image[:, :80] = np.clip(np.rint(still), 0, 255)
        writer.write(image)
    writer.release()
    listed = write_points(tmp_path / "points.csv", [(30, 40), (50, 40), (110, 40), (130, 40)])
    with convert(path, tmp_path / "run.h5", points=listed, moving=3.0) as run:
        np.testing.assert_array_equal(run.node("id"), [2, 3])
        assert "2 of 4 points move by no more than 3 times" in notes(run)


# --- units ---


def test_scale_bar_gives_millimetres_with_y_up(affine, points, tmp_path):
    clip, path = affine
    options = {"points": points, "scale_bar": "10,10,110,10,50 mm", "y_up": True}
    with convert(path, tmp_path / "run.h5", **options) as run:
        assert run.position_unit == "mm"
        truth = clip.truth(grid(clip)) * [0.5, -0.5] + [0.0, 0.5 * 119]
        assert np.sqrt(((run.positions() - truth) ** 2).mean()) < 0.01
        sigma_mm = np.nanmedian(run.extension("openprc-vision", "sigma"))
        assert "0.5 mm a px, known to" in notes(run)
    with convert(path, tmp_path / "px.h5", points=points) as run:
        sigma_px = np.nanmedian(run.extension("openprc-vision", "sigma"))
    assert sigma_mm == pytest.approx(0.5 * sigma_px, rel=1e-3)


def test_calibration_from_a_file(affine, points, tmp_path):
    from openprc.vision.calibration.calibration_file import save_calibration
    from openprc.vision.calibration.scale_bar import ScaleBar

    bar = ScaleBar((10, 10), (110, 10), 2.0, "cm", frame_shape=(120, 160))
    file = save_calibration(tmp_path / "bar.json", bar)
    with convert(affine[1], tmp_path / "run.h5", points=points, calibration=file) as run:
        assert run.position_unit == "cm"
        roles = {entry["role"]: entry["name"] for entry in run.provenance["inputs"]}
        assert roles == {"points": "points.csv", "calibration": "bar.json"}
    other = save_calibration(
        tmp_path / "other.json", ScaleBar((10, 10), (110, 10), 2.0, "cm", frame_shape=(100, 100))
    )
    with pytest.raises(CalibrationError, match="made for images of 100x100"):
        convert(affine[1], tmp_path / "no.h5", points=points, calibration=other)


def test_bars_between_points(affine, points, tmp_path):
    bars = tmp_path / "bars.csv"
    bars.write_text("a,b\n0,1\n0,15\n")
    with convert(affine[1], tmp_path / "run.h5", points=points, bars=bars) as run:
        np.testing.assert_array_equal(run.indices("bars"), [[0, 1], [0, 15]])
        places = run.positions()
        np.testing.assert_allclose(
            run.element("bars", "length")[:, 1],
            np.linalg.norm(places[:, 15] - places[:, 0], axis=1),
        )
        np.testing.assert_allclose(run.element("bars", "strain")[0], 0.0, atol=1e-12)


# --- Ctrl-C ---


def test_ctrl_c_keeps_what_was_tracked(affine, points, tmp_path):
    def stop(done, total):
        assert total == 12
        if done == 7:
            raise KeyboardInterrupt

    producer = VisionProducer()
    producer.progress = stop
    with pytest.raises(KeyboardInterrupt):
        convert(affine[1], tmp_path / "run.h5", producer, points=points)
    left = sorted(item.name for item in tmp_path.iterdir())
    assert left == ["points.csv", "run.h5.partial"]
    with Trajectory(tmp_path / "run.h5.partial", allow_incomplete=True) as run:
        assert run.status == "interrupted"
        assert run.n_frames == 6
        assert "interrupted: the tracks end with frame 5" in notes(run)


# --- other recordings ---


def test_folders_of_images(affine, tmp_path):
    folder = tmp_path / "images"
    folder.mkdir()
    for k, image in enumerate(affine[0].frames()):
        cv2.imwrite(str(folder / f"img_{k:03d}.png"), image)
    assert VisionProducer().sniff(folder) == 0.7
    with pytest.raises(ConfigError, match="fps"):
        convert(folder, tmp_path / "run.h5")
    with convert(folder, tmp_path / "run.h5", fps=10.0, max_points=5) as run:
        assert (run.n_frames, run.dt) == (12, pytest.approx(0.1))


@real_data
@pytest.mark.parametrize(
    ("name", "sureness"),
    [
        ("mechanism_ffv1.avi", 0.7),
        ("mechanism_mp4v.mp4", 0.7),
        ("codec/vfr_h264.mkv", 0.7),
        ("codec/mpeg2_ps.mpg", 0.7),
        ("beam_highspeed.mraw", 0.7),
        ("beam_highspeed.cih", 0.7),
        ("mechanism_reference.csv", 0.0),
        ("dic_challenge_15/Reference.png", 0.0),
        ("codec", 0.0),
    ],
)
def test_sureness(name, sureness):
    assert VisionProducer().sniff(DATA / name) == sureness
