"""``openprc track``: what it prints and writes, and what it refuses without a trace."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.schema import Trajectory, validate_file
from openprc.vision.synth import cases

cv2 = pytest.importorskip("cv2")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    clip = cases.case("affine", noise=1.0, n_frames=8, shape=(100, 140))
    return clip.write(tmp_path_factory.mktemp("clip") / "clip.avi", fps=20.0)


@pytest.fixture
def clip(made, tmp_path):
    path = tmp_path / "clip.avi"
    path.write_bytes(made.read_bytes())
    return path


def test_the_table_and_the_file(openprc, clip, tmp_path):
    told = openprc("track", clip, "--out", "run.h5", "--max-points", 12, "--detector", "gftt")
    assert told.code == 0, told.text
    for words in (
        "clip.avi", "8 in 0.35 s", "index / 20 Hz", "0, 0", "12, of which 12 are nodes",
        "alive at the end", "found again after a loss", "median sigma", "px", "template updates",
        "grey levels", "moving (motion over 3 sigma)", "none: see", "note: AVI, codec",
    ):  # fmt: skip
        assert words in told.out, words
    assert "Traceback" not in told.text
    report = validate_file(tmp_path / "run.h5")
    assert report.ok
    with Trajectory(tmp_path / "run.h5") as run:
        assert (run.n_frames, run.n_nodes, run.dims) == (8, 12, 2)
        assert run.provenance["producer"] == "vision"
        assert run.provenance["config"]["detector"] == "gftt"
        assert str(tmp_path) not in str(run.provenance)


def test_the_default_name_and_json(openprc, clip, tmp_path):
    told = openprc("track", clip, "--max-points", 5, "--scale-bar", "10,10,110,10,50 mm", "--json")
    assert told.code == 0, told.text
    assert told.err == ""
    figures = told.data["figures"]
    assert told.data["path"] == "clip.simulation.h5"
    assert (figures["frames"], figures["points"], figures["dropped_frames"]) == (8, 5, 0)
    assert figures["unit_per_px"] == pytest.approx(0.5)
    assert figures["median_sigma"] == pytest.approx(0.5 * figures["median_sigma_px"])
    assert figures["uniform"] is True
    assert (tmp_path / "clip.simulation.h5").exists()


def test_import_takes_the_same_options(openprc, clip, tmp_path):
    words = ("-o", "max_points=6", "-o", "scale_bar=10,10,110,10,5 cm", "-o", "smooth=5")
    assert openprc("import", clip, "--out", "a.h5", *words).code == 0
    assert openprc("track", clip, "--out", "b.h5", *words).code == 0
    with Trajectory(tmp_path / "a.h5") as one, Trajectory(tmp_path / "b.h5") as other:
        assert one.position_unit == "cm"
        np.testing.assert_array_equal(one.positions(), other.positions())
        assert "smoothed by polynomials" in str(one.provenance["notes"])


def test_drive_mask_bars_and_marker(openprc, clip, tmp_path):
    (tmp_path / "points.csv").write_text("x,y\n40,40\n70,50\n100,60\n")
    (tmp_path / "bars.csv").write_text("0,1\n")
    (tmp_path / "u.csv").write_text("u [N]\n1\n2\n")
    named = ("--points", "points.csv", "--bars", "bars.csv")
    told = openprc("track", clip, "--out", "a.h5", *named, "--drive", "u.csv", "--drive-hold", 0.2)
    assert told.code == 0, told.text
    with Trajectory(tmp_path / "a.h5") as run:
        assert run.input("drive").unit == "N"
        assert run.element("bars", "length").shape == (8, 1)
    told = openprc("track", clip, "--out", "b.h5", *named, "--drive-marker", 2)
    assert told.code == 0, told.text
    assert "│ drive" in told.out


def test_pictures_and_annotated_video(openprc, clip, tmp_path):
    words = ("--max-points", 8, "--qc", "quality.png", "--annotate", "seen.mp4")
    told = openprc("track", clip, "--out", "run.h5", *words)
    assert told.code == 0, told.text
    assert cv2.imread(str(tmp_path / "quality.png")).shape[0] > 500
    capture = cv2.VideoCapture(str(tmp_path / "seen.mp4"))
    assert sum(1 for _ in iter(capture.grab, False)) == 8
    assert sorted(item.name for item in tmp_path.iterdir()) == [
        "clip.avi", "quality.png", "run.h5", "seen.mp4",
    ]  # fmt: skip


def test_results_are_kept_without_force(refused, openprc, clip, tmp_path):
    assert openprc("track", clip, "--out", "run.h5", "--max-points", 4).code == 0
    refused("track", clip, "--out", "run.h5", told="--force", kind="ResultExists")
    (tmp_path / "quality.png").write_text("mine")
    refused(
        "track", clip, "--out", "new.h5", "--qc", "quality.png", told="quality.png",
        kind="ResultExists",
    )  # fmt: skip
    words = ("--max-points", 4, "--qc", "quality.png", "--force")
    assert openprc("track", clip, "--out", "run.h5", *words).code == 0


@pytest.mark.parametrize(
    ("words", "told", "kind"),
    [
        (("-o", "max_pionts=3"), "did you mean 'max_points'?", "ConfigError"),
        (("-o", "detector=shi-tomsai"), "shi-tomasi", "UnknownName"),
        (("--max-points", "0"), "max_points is 0", "ConfigError"),
        (("--max-points", "many"), "is not a valid integer", "UsageError"),
        (("--refine", "more"), "'icgn', 'none'", "UsageError"),
        (("--max-points", "3", "-o", "max_points=3"), "--max-points and -o", "UsageError"),
        (("--scale-bar", "1,2,3"), "x1,y1,x2,y2,LENGTH UNIT", "ConfigError"),
        (("--points", "none.csv"), "none.csv", "UnreadableFile"),
        (("--mask", "none.png"), "none.png", "UnreadableFile"),
        (("--calibration", "none.json"), "none.json", "UnreadableFile"),
        (("--drive", "none.csv"), "none.csv", "UnreadableFile"),
        (("--annotate", "seen.gif"), "seen.gif", "ConfigError"),
        (("--annotate", "run.h5"), "ends in", "ConfigError"),
        (("--qc", "quality.txt"), "quality.txt", "ConfigError"),
        (("--annotate", "clip.avi", "--force"), "the same name", "ConfigError"),
    ],
    ids=lambda value: "_".join(value) if isinstance(value, tuple) else None,
)
def test_wrong_calls(refused, clip, words, told, kind):
    refused("track", clip, "--out", "run.h5", *words, told=told, kind=kind)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (None, "does not exist"),
        (b"", "empty"),
        (b"time,x\n0,1\n", "not a video"),
        (b"\x00\x00\x00\x18ftypmp42" + bytes(200), "'moov') is missing"),
    ],
    ids=["missing", "empty", "text", "cut off"],
)
def test_what_is_no_video(refused, tmp_path, content, told):
    if content is not None:
        (tmp_path / "clip.mp4").write_bytes(content)
    refused("track", tmp_path / "clip.mp4", told=told)


def test_a_clip_without_texture(refused, tmp_path):
    path = tmp_path / "blank.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 25.0, (64, 48), False)
    for _ in range(3):
        writer.write(np.full((48, 64), 128, "u1"))
    writer.release()
    refused("track", path, told="blank", kind="NoFeaturesError")


def test_a_folder_that_cannot_be(refused, clip):
    refused("track", clip, "--out", f"{clip}/run.h5", code=1, told="clip.avi")


def test_ctrl_c_tells_how_to_keep_what_is_there(openprc, clip, tmp_path, monkeypatch):
    from openprc.vision.tracks_spool import TracksSpool

    append = TracksSpool.append

    def stopping(self, step):
        if len(self) == 5:
            raise KeyboardInterrupt
        append(self, step)

    monkeypatch.setattr(TracksSpool, "append", stopping)
    told = openprc("track", clip, "--out", "run.h5", "--max-points", 4)
    assert told.code == 130
    assert "run.h5.partial" in told.err
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    saved = openprc("repair", "run.h5.partial")
    assert saved.code == 0, saved.text
    assert "5 frames saved, status interrupted" in saved.out
