"""What the importer of videos refuses, and in which words."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import (
    CalibrationError,
    ConfigError,
    MissingData,
    NoFeaturesError,
    OpenPRCError,
    UnknownName,
    VideoError,
)
from openprc.schema import Provenance, Trajectory, TrajectoryWriter
from openprc.vision.producer import VisionProducer
from openprc.vision.synth import cases

cv2 = pytest.importorskip("cv2")


def convert(path, out, **options):
    with TrajectoryWriter(out, provenance=Provenance("vision"), on_failure="discard") as writer:
        VisionProducer().import_run(path, writer, options=options)
    return Trajectory(out)


def notes(run):
    return "\n".join(run.provenance["notes"])


@pytest.fixture(scope="module")
def affine(tmp_path_factory):
    clip = cases.case("affine", noise=1.0, n_frames=12, shape=(120, 160))
    return clip, clip.write(tmp_path_factory.mktemp("affine") / "affine.avi", fps=25.0)


# --- options ---


@pytest.mark.parametrize(
    ("options", "kind", "words"),
    [
        ({"detector": "harris"}, UnknownName, "harris"),
        ({"max_points": 0}, ConfigError, "max_points is 0"),
        ({"win_size": 2}, ConfigError, "win_size is"),
        ({"levels": "many"}, ConfigError, "levels is 'many'"),
        ({"subset": 20}, ConfigError, "odd, 5 to 101"),
        ({"fb_threshold": float("nan")}, ConfigError, "fb_threshold is nan"),
        ({"fps": 0.0}, ConfigError, "fps is 0"),
        ({"rate": -1.0}, ConfigError, "rate is -1"),
        ({"min_ratio": 1.5}, ConfigError, "min_ratio is 1.5"),
        ({"max_gap": -1}, ConfigError, "max_gap is -1"),
        ({"smooth": 4}, ConfigError, "a window of 4 frames"),
        ({"reference_frame": 99}, ConfigError, "there is no frame 99"),
        ({"scale_bar": "1,2,3,50 mm"}, ConfigError, "x1,y1,x2,y2,LENGTH UNIT"),
        ({"scale_bar": "1,2,30,40,50"}, ConfigError, "the scale bar is"),
        ({"scale_bar": "1,2,300,40,50 mm"}, ConfigError, r"lies at \(300, 40\)"),
        ({"scale_bar": "1,2,30,40,5 kg"}, CalibrationError, "'kg' is a unit of mass"),
        ({"scale_bar": "1,2,1,2,5 mm"}, CalibrationError, "px apart"),
        ({"y_up": True}, ConfigError, "positions stay in px"),
        ({"drive_hold": 0.1}, ConfigError, "there is no drive"),
        ({"drive_marker": "here"}, ConfigError, "the marker is 'here'"),
        ({"drive_marker": "500,20"}, ConfigError, r"the marker lies at \(500, 20\)"),
        ({"drive_marker": 99}, ConfigError, "there are 5 points"),
        ({"value_range": "9,1"}, ConfigError, "value_range is '9,1'"),
        ({"moving": 1e9}, MissingData, "of 5 points none is left"),
    ],
)  # fmt: skip
def test_wrong_options_are_named(affine, tmp_path, options, kind, words):
    with pytest.raises(kind, match=words):
        convert(affine[1], tmp_path / "run.h5", **{"max_points": 5, **options})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("option", "text", "words"),
    [
        ("points", "x,y\n10,abc\n", "line 2 is '10,abc'"),
        ("points", "10,20\n500,20\n", "line 2 is '500,20'"),
        ("points", "10\n", "line 1 is '10'"),
        ("points", "x,y\n", "no point is listed"),
        ("bars", "a,b\n1,1\n", "line 2 is '1,1'"),
        ("bars", "0,7\n", "line 1 is '0,7'"),
        ("bars", "a,b\n", "no bar is listed"),
        ("mask", "no image", "this is not an image"),
    ],
)
def test_wrong_files_are_named(affine, tmp_path, option, text, words):
    path = tmp_path / "named.csv"
    path.write_text(text)
    with pytest.raises(OpenPRCError, match=words) as caught:
        convert(affine[1], tmp_path / "run.h5", **{"max_points": 5, option: path})
    assert caught.value.key == option


def test_mask_says_where_points_may_be(affine, tmp_path):
    mask = np.zeros((120, 160), np.uint8)
    mask[:, :80] = 255
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    with convert(affine[1], tmp_path / "run.h5", mask=tmp_path / "mask.png") as run:
        assert run.n_nodes >= 5
        assert run.positions()[0, :, 0].max() < 80
    for shape, fill, words in (((60, 60), 255, "60 x 60 px"), ((120, 160), 0, "black all over")):
        cv2.imwrite(str(tmp_path / "wrong.png"), np.full(shape, fill, np.uint8))
        with pytest.raises(ConfigError, match=words):
            convert(affine[1], tmp_path / "no.h5", mask=tmp_path / "wrong.png")


def test_image_without_texture(tmp_path):
    path = tmp_path / "blank.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 25.0, (64, 48), False)
    for _ in range(3):
        writer.write(np.full((48, 64), 128, "u1"))
    writer.release()
    with pytest.raises(NoFeaturesError, match="finds nothing in frame 0"):
        convert(path, tmp_path / "run.h5")


# --- what is not a video ---


@pytest.mark.parametrize("name", ["clip.avi", "clip.mp4", "clip.mkv"])
@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b"time,x,y\n0,1,2\n", "this is not a video: it begins with b'time,x"),
        (np.random.default_rng(0).bytes(5000), "this is not a video"),
    ],
    ids=["empty", "table", "noise"],
)
def test_other_files_are_refused(tmp_path, name, content, words):
    path = tmp_path / name
    path.write_bytes(content)
    assert VisionProducer().sniff(path) == 0.3
    with pytest.raises(OpenPRCError, match=words):
        convert(path, tmp_path / "run.h5")
    assert not (tmp_path / "run.h5").exists()


def test_truncated_videos(affine, tmp_path):
    raw = affine[1].read_bytes()
    half = tmp_path / "half.avi"
    half.write_bytes(raw[: len(raw) // 2])
    with convert(half, tmp_path / "half.h5", max_points=4) as run:
        assert 3 < run.n_frames < 9
        assert "declares 12 frames" in notes(run)
    with pytest.raises(VideoError, match="declares 12 frames"):
        convert(half, tmp_path / "strict.h5", max_points=4, strict=True)
