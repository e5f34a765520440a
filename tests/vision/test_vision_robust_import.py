"""Videos that say nothing true about themselves, and everything around them, to a run."""

from __future__ import annotations

import csv
import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from openprc.errors import MissingData, VideoError
from openprc.reservoir import StateLoader
from openprc.schema import Provenance, Trajectory, TrajectoryWriter
from openprc.vision import ArraySource, FeatureMapCache, VideoSource, detect
from openprc.vision import start_points as module
from openprc.vision.import_settings import ImportSettings
from openprc.vision.producer import VisionProducer
from openprc.vision.start_points import start_points
from openprc.vision.synth import cases
from openprc.vision.tracking.correlation import Correlator

cv2 = pytest.importorskip("cv2")

SHAPE = (120, 160)
CODEC = Path(__file__).resolve().parents[2] / "../shared/data/vision/codec"
TRAPS = ["av1.mp4", "h264_bframes.mp4", "mpeg2_ps.mpg", "vfr_h264.mkv", "vfr_h264.mp4"]


def convert(path, out, **options):
    with TrajectoryWriter(out, provenance=Provenance("vision"), on_failure="discard") as writer:
        VisionProducer().import_run(Path(path), writer, options=options)
    return Trajectory(out)


@pytest.fixture(scope="module")
def clip():
    return cases.case("translation", n_frames=14, shape=SHAPE, noise=1.0)


@pytest.fixture(scope="module")
def video(clip, tmp_path_factory):
    return clip.write(tmp_path_factory.mktemp("video") / "clip.avi", fps=25.0)


class Lying:
    """A capture that declares what it is told to."""

    real = cv2.VideoCapture
    declared: dict[int, float] = {}  # noqa: RUF012 - replaced by each test

    def __init__(self, path):
        self._inner = Lying.real(path)

    def get(self, key):
        return Lying.declared.get(key, self._inner.get(key))

    def __getattr__(self, name):
        return getattr(self._inner, name)


@pytest.mark.parametrize("count", [0.0, -9.2e18, 9.2e18, 3.0, 5000.0])
def test_declared_count_changes_nothing_in_the_run(video, tmp_path, monkeypatch, count):
    with convert(video, tmp_path / "true.h5", max_points=5) as run:
        expected = run.time, run.positions()
    monkeypatch.setattr(Lying, "declared", {cv2.CAP_PROP_FRAME_COUNT: count})
    monkeypatch.setattr(cv2, "VideoCapture", Lying)
    with convert(video, tmp_path / "run.h5", max_points=5) as run:
        np.testing.assert_array_equal(run.time, expected[0])
        np.testing.assert_array_equal(run.positions(), expected[1])
        said = "\n".join(run.provenance["notes"])
    assert ("delivered 14" in said) == (count in (3.0, 5000.0))
    assert ("which is no count" in said) == (count not in (3.0, 5000.0))


@pytest.mark.parametrize("rate", [0.0, float("nan"), 90000.0])
def test_declared_rate_is_not_believed_against_the_stamps(video, tmp_path, monkeypatch, rate):
    monkeypatch.setattr(Lying, "declared", {cv2.CAP_PROP_FPS: rate})
    monkeypatch.setattr(cv2, "VideoCapture", Lying)
    with convert(video, tmp_path / "run.h5", max_points=3) as run:
        np.testing.assert_allclose(run.time, np.arange(14) / 25, rtol=0, atol=1e-9)


@pytest.mark.skipif(not CODEC.exists(), reason="the codec clips are not here")
@pytest.mark.parametrize("name", TRAPS)
def test_clocks_and_motion_of_containers_that_mislead(name, tmp_path):
    capture = cv2.VideoCapture(str(CODEC / name))
    decodes = capture.read()[0]
    capture.release()
    listed = tmp_path / "points.csv"
    listed.write_text("200,120\n240,180\n280,90\n")
    if not decodes:
        with pytest.raises(VideoError, match=r"codec AV01\) opens but delivers no frame"):
            convert(CODEC / name, tmp_path / "run.h5", points=listed)
        assert not (tmp_path / "run.h5").exists()
        return
    with convert(CODEC / name, tmp_path / "run.h5", points=listed) as run:
        times, tracks = run.time, run.positions()
        assert run.n_frames == 120
    if name.startswith("vfr"):
        with (CODEC / "vfr_times_ms.csv").open(newline="") as stream:
            true = np.array([float(row["t_ms"]) / 1e3 for row in csv.DictReader(stream)])
    else:
        true = np.arange(120) / 30
    np.testing.assert_allclose(times, true - true[0], rtol=0, atol=1e-9)
    # The pattern moves by one pixel a frame to the left: a frame lost or twice would be seen.
    moved = tracks - tracks[0]
    np.testing.assert_allclose(moved[..., 0], -np.arange(120)[:, None] * np.ones(3), atol=0.5)
    np.testing.assert_allclose(moved[..., 1], 0, atol=0.5)


# --- what is missing reaches nobody as a number ---


def test_gaps_of_a_run_are_refused_by_the_loader_until_something_is_said(clip, tmp_path):
    images = list(clip.frames())
    images[6][30:80, 40:90] = 128
    folder = tmp_path / "images"
    folder.mkdir()
    for k, image in enumerate(images):
        cv2.imwrite(str(folder / f"f{k:02d}.png"), image)
    listed = tmp_path / "points.csv"
    listed.write_text("60,55\n110,80\n120,40\n")
    with convert(folder, tmp_path / "run.h5", points=listed, fps=20.0) as run:
        assert run.observed()[:, 0].tolist() == [1] * 6 + [0] + [1] * 7
        assert np.isnan(run.positions()[6, 0]).all()
        assert run.observed()[:, 1:].all()
    with pytest.raises(MissingData, match=r"1 of 42 samples \(1 of 3; worst: node 0"):
        StateLoader(tmp_path / "run.h5").positions()
    joined = StateLoader(tmp_path / "run.h5", missing="interpolate").positions()
    truth = clip.truth(np.array([[60.0, 55.0]]))[:, 0]
    np.testing.assert_allclose(joined[:, 0, :2], truth, atol=0.3)


# --- size ---


def peak_of(work):
    tracemalloc.start()
    try:
        result = work()
        return result, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.fixture(scope="module")
def grain():
    """Return a large image with very many features."""
    rng = np.random.default_rng(1)
    image = rng.integers(0, 256, (900, 1200)).astype(np.uint8)
    return cv2.GaussianBlur(image, (0, 0), 1.2)


def test_large_images_with_many_features_need_little_memory(grain):
    assert len(detect(grain, "gftt")) > 8000
    settings = ImportSettings.from_options({"detector": "gftt", "max_points": 60})
    found, peak = peak_of(lambda: start_points(grain, settings, file=Path("clip.avi")))
    assert len(found.places) == 60
    # The windows of all of them, and what belongs to these, would be 150 MB and more.
    assert peak < 110 * 2**20


def test_templates_are_cut_in_parts(grain):
    x, y = np.meshgrid(np.arange(20.0, 1180, 16), np.arange(20.0, 880, 16))
    points = np.column_stack([x.ravel(), y.ravel()])
    correlator = Correlator()
    image = correlator.prepare(grain)
    numbers, peak = peak_of(lambda: correlator.add_templates(image, points))
    assert sorted(numbers.tolist()) == list(range(len(points)))
    alone = Correlator()
    alone.add_templates(image, points[2000:2001])
    moved = np.hstack([points[2000:2001] + 0.3, np.zeros((1, 4))])
    whole = correlator.refine(image, numbers[2000:2001], moved)
    single = alone.refine(image, np.array([0]), moved)
    np.testing.assert_array_equal(whole.positions, single.positions)
    # Worked on all at once they would need four times as much.
    assert peak < 200 * 2**20


def test_features_that_cannot_be_matched_make_room_for_others(grain, monkeypatch):
    image = np.ascontiguousarray(grain[:200, :300])
    settings = ImportSettings.from_options({"detector": "gftt", "max_points": 30, "spacing": 12})

    def beginning():
        return start_points(image, settings, file=Path("clip.avi")).places

    whole = beginning()
    best = whole[whole[:, 0] > 150]
    assert 0 < len(best) < len(whole) == 30
    monkeypatch.setattr(module, "_AT_ONCE", 1)
    np.testing.assert_array_equal(beginning(), whole)
    monkeypatch.setattr(module, "_can_be_matched", lambda image, places, _: places[:, 0] > 150)
    places = beginning()
    assert len(places) == 30
    assert (places[:, 0] > 150).all()
    # The best stay, but for those next to the border, where refused ones were in their way.
    inner = best[best[:, 0] > 162]
    assert set(map(tuple, inner)) <= set(map(tuple, places))


def test_memory_of_a_run_does_not_grow_with_its_length(clip, tmp_path):
    images = list(clip.frames())

    def peak(repeats):
        path = tmp_path / f"clip{repeats}.avi"
        writer = cv2.VideoWriter(
            str(path), cv2.VideoWriter.fourcc(*"FFV1"), 25.0, SHAPE[::-1], isColor=False
        )
        for k in range(repeats):
            for image in images[:: 1 if k % 2 == 0 else -1]:
                writer.write(image)
        writer.release()
        tracemalloc.start()
        try:
            convert(path, tmp_path / f"run{repeats}.h5", max_points=40).close()
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    peak(1)
    # The rows of 40 points alone would be 160 kB more.
    assert peak(8) < peak(2) + 60_000


# --- surroundings ---


def test_no_window_is_opened_and_no_display_needed(video, tmp_path):
    code = (
        "import sys, cv2\n"
        "def shown(*a): raise SystemExit('a window')\n"
        "for name in ('imshow', 'namedWindow', 'waitKey'): setattr(cv2, name, shown)\n"
        "from openprc.cli.main import main\n"
        "sys.argv = ['openprc', *sys.argv[1:]]\n"
        "main()\n"
    )
    words = ["track", str(video), "--out", "läuf.h5", "--max-points", "4", "--refine", "none",
             "--qc", "güte.png", "--annotate", "日本.avi"]  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-c", code, *words],
        cwd=tmp_path,
        env={"PATH": "", "PYTHONIOENCODING": "utf-8", "HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )
    assert done.returncode == 0, done.stderr
    names = {item.name for item in tmp_path.iterdir()}
    assert {"läuf.h5", "güte.png", "日本.avi"} <= names
    assert not {name for name in names if "partial" in name}


def test_signal_in_the_middle_keeps_what_is_finished(video, tmp_path):
    code = (
        "import os, signal, sys\n"
        "from openprc.vision.tracks_spool import TracksSpool\n"
        "append = TracksSpool.append\n"
        "def counted(self, step):\n"
        "    append(self, step)\n"
        "    if len(self) == 6: os.kill(os.getpid(), signal.SIGINT)\n"
        "TracksSpool.append = counted\n"
        "from openprc.cli.main import main\n"
        "main()\n"
    )
    words = ["track", str(video), "--out", "run.h5", "--max-points", "4", "--refine", "none",
             "--fps", "500"]  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-c", code, *words],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 130, done.stderr
    assert "`openprc repair run.h5.partial`" in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr
    assert [item.name for item in tmp_path.iterdir()] == ["run.h5.partial"]
    with Trajectory(tmp_path / "run.h5.partial", allow_incomplete=True) as run:
        assert run.status == "interrupted"
        assert 5 <= run.n_frames <= 7
        np.testing.assert_allclose(run.time, np.arange(run.n_frames) / 500, atol=1e-12)


def test_folders_with_letters_of_many_alphabets(video, tmp_path):
    folder = tmp_path / "Übung 日本 Ж"
    folder.mkdir()
    path = folder / "клип ü.avi"
    path.write_bytes(video.read_bytes())
    (folder / "pünkte.csv").write_text("60,55\n110,80\n")
    mask = np.full(SHAPE, 255, np.uint8)
    (folder / "máscara.png").write_bytes(cv2.imencode(".png", mask)[1].tobytes())
    with convert(path, folder / "läuf.h5", points=folder / "pünkte.csv") as run:
        assert run.n_nodes == 2
        assert "Übung" not in str(run.provenance)
    convert(path, folder / "zwei.h5", mask=folder / "máscara.png", max_points=3).close()
    source = VideoSource(path)
    FeatureMapCache(source).get_or_detect(source.read_frame(0), "gftt")
    assert (folder / "клип ü.avi.fmap.h5").exists()


def test_clip_of_one_frame_is_a_run_of_one_frame(clip):
    from openprc.vision import Tracker

    result = Tracker(ArraySource([next(iter(clip.frames()))], fps=30.0), [(60.0, 55.0)]).run()
    assert result.n_frames == 1
    np.testing.assert_allclose(result.positions[0], [[60.0, 55.0]])
    assert result.timestamps.tolist() == [0.0]
