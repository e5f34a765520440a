"""``openprc calibrate``: each sub-command on rendered pictures, and every call that is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
from rendered_boards import VIEWS, Rays, chessboard, poses, render
from stereo_rigs import converging

pytest.importorskip("cv2", reason="OpenCV is not installed")

from openprc.vision.calibration.boards import Chessboard
from openprc.vision.calibration.calibration_file import load_calibration
from openprc.vision.opencv import load_cv2

BOARD = Chessboard(8, 5, 20.0, "mm")
RIG = converging(25.0, f=620.0, shape=(360, 480), distance=420.0, dist=[-0.2, 0.08, 0.0005, -0.001])
WORDS = ("--chessboard", "8x5", "--square", "20mm", "--model", "k1k2p1p2")


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Folders L and R with five pairs of pictures."""
    root = tmp_path_factory.mktemp("pictures")
    cv2, rays = load_cv2(), Rays(RIG.left)
    nearer = [dict(view, at=(0.4 * view["at"][0], 0.8 * view["at"][1])) for view in VIEWS[:4]]
    for side in "LR":
        (root / side).mkdir()
        for i, (turn, shift) in enumerate(poses(BOARD, 420.0, nearer)):
            pose = (turn, shift)
            if side == "R":
                pose = RIG.rotation @ turn, RIG.rotation @ shift + RIG.translation
            image = render(rays, chessboard(BOARD), *pose, samples=2)
            cv2.imwrite(str(root / side / f"{i}.png"), image)
    return root


def test_scale(openprc, tmp_path):
    call = ("calibrate", "scale", "--from", "10,20", "--to", "410,20", "--length", "5cm")
    outcome = openprc(*call, "--out", "scale.json", "--y-up", "--origin", "10,470")
    assert outcome.code == 0, outcome.text
    for words in ("0.0125", "cm/px", "one-sigma of the scale", "written: scale.json"):
        assert words in outcome.text
    bar = load_calibration(tmp_path / "scale.json")
    assert bar.to_physical([90.0, 390.0]) == pytest.approx([1.0, 1.0])
    data = openprc(*call, "--out", "other.json", "--sigma-length", "0.5mm", "--json").data
    assert data["scale"] == pytest.approx(0.0125)
    assert data["relative_sigma"] == pytest.approx(np.hypot(0.01, np.sqrt(2) * 0.5 / 400))
    assert data["written"] == ["other.json"]


def test_board(openprc, folders, tmp_path):
    outcome = openprc(
        "calibrate", "board", folders / "L", *WORDS, "--distance", "420mm",
        "--out", "camera.json", "--picture", "camera.png",
    )  # fmt: skip
    assert outcome.code == 0, outcome.text
    for words in ("reprojection error, rms", "fx", "±", "rms [px]", "tilt [deg]", "views used"):
        assert words in outcome.text
    camera = load_calibration(tmp_path / "camera.json")
    assert camera.matrix[0, 0] == pytest.approx(620.0, abs=1.0)
    assert (camera.scale_factor, camera.units) == (420.0, "mm")
    assert (tmp_path / "camera.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["camera.json", "camera.png"]
    shown = openprc("calibrate", "show", "camera.json")
    assert "camera" in shown.text
    assert openprc("calibrate", "show", "camera.json", "--json").data["units"] == "mm"


def test_plane(openprc, folders, tmp_path):
    from openprc.vision.calibration.calibration_file import save_calibration

    save_calibration(tmp_path / "camera.json", RIG.left)
    call = ("calibrate", "plane", folders / "L" / "0.png", *WORDS[:4], "--camera", "camera.json")
    outcome = openprc(*call, "--out", "plane.json", "--picture", "plane.png")
    assert outcome.code == 0, outcome.text
    assert "tilt of the plane" in outcome.text
    data = openprc(*call, "--out", "again.json", "--json").data
    assert data["tilt_deg"] == pytest.approx(25.5, abs=0.3)
    assert data["rms_px"] < 0.05
    assert load_calibration(tmp_path / "plane.json").camera == RIG.left


def test_plane_from_points(openprc, tmp_path):
    lines = [f"{100 + 4 * x},{50 + 4 * y},{x},{y}" for x in (0, 50, 100) for y in (0, 80)]
    (tmp_path / "pairs.csv").write_text("\n".join(["u,v,x,y", *lines]))
    call = (
        "calibrate",
        "plane",
        "--points",
        "pairs.csv",
        "--units",
        "um",
        "--frame-size",
        "640x480",
    )
    data = openprc(*call, "--out", "plane.json", "--json").data
    assert data["scale"] == pytest.approx(0.25)
    plane = load_calibration(tmp_path / "plane.json")
    assert (plane.units, plane.frame_shape) == ("um", (480, 640))


def test_stereo(openprc, folders, tmp_path):
    outcome = openprc(
        "calibrate", "stereo", folders / "L", folders / "R", *WORDS,
        "--out", "rig.json", "--picture", "rig.png",
    )  # fmt: skip
    assert outcome.code == 0, outcome.text
    for words in ("baseline", "angle between the axes", "board in space, rms", "left: fx", "pairs"):
        assert words in outcome.text
    rig = load_calibration(tmp_path / "rig.json")
    assert rig.baseline == pytest.approx(RIG.baseline, rel=0.005)
    assert (tmp_path / "rig.png").stat().st_size > 10_000


# --- calls that are refused -------------------------------------------------------------------


SCALE = ("calibrate", "scale", "--from", "10,20", "--to", "410,20", "--length", "50mm")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("scale", "--from", "1;2;3"), "'1;2;3' is no point"),
        ((*SCALE[1:-1], "50", "--out", "a"), "with its unit, as in 25mm"),
        ((*SCALE[1:-1], "-5mm", "--out", "a"), "is no length"),
        ((*SCALE[1:-1], "50kg", "--out", "a"), "is no length"),
        (SCALE[1:], "--out"),
        (("board", "x", "--out", "a"), "say which board"),
        (("board", "x", "--chessboard", "9", "--out", "a"), "write them as 9x6"),
        (("board", "x", "--chessboard", "9x6", "--out", "a"), "needs --square"),
        (("board", "x", "--charuco", "9x6", "--square", "20mm", "--out", "a"), "needs --marker"),
        (
            (
                "board",
                "x",
                "--chessboard",
                "9x6",
                "--circles",
                "9x6",
                "--square",
                "1mm",
                "--out",
                "a",
            ),
            "two boards",
        ),
        (("board", "x", *WORDS, "--out", "a", "--picture", "a.gif"), "not 'a.gif'"),
        (("board", "x", *WORDS, "--out", "."), "is a folder"),
        (("plane", "--out", "a"), "an image and its board, or --points alone"),
        (("plane", "x.png", "--points", "y.csv", "--out", "a"), "or --points alone"),
        (("plane", "--points", "y.csv", "--y-up", "--out", "a"), "--y-up is for boards"),
    ],
    ids=lambda value: value if isinstance(value, str) else value[0],
)
def test_calls_that_make_no_sense(refused, words, told):
    refused("calibrate", *words, told=told, kind="UsageError")


def test_inputs_that_are_none(refused, tmp_path, folders):
    refused("calibrate", "board", "none.png", *WORDS, "--out", "a.json", told="no such file")
    (tmp_path / "text.png").write_text("hello")
    refused(
        "calibrate", "board", "text.png", *WORDS, "--out", "a.json",
        told="no picture", kind="UnreadableFile",
    )  # fmt: skip
    refused(
        "calibrate", "board", folders / "L" / "0.png", *WORDS, "--out", "a.json",
        told=("found in 1 of 1", "at least 3 views"), kind="CalibrationError",
    )  # fmt: skip
    refused("calibrate", "show", "text.png", told="not JSON", kind="UnreadableFile")
    (tmp_path / "pairs.csv").write_text("1,2,3,4\n")
    refused(
        "calibrate", "plane", "--points", "pairs.csv", "--out", "a.json",
        told="there are 1 pairs", kind="CalibrationError",
    )  # fmt: skip


def test_a_finished_file_is_kept(refused, openprc, tmp_path):
    assert openprc(*SCALE, "--out", "scale.json").code == 0
    before = (tmp_path / "scale.json").read_bytes()
    refused(*SCALE, "--out", "scale.json", told="finished file", kind="ResultExists")
    assert (tmp_path / "scale.json").read_bytes() == before
    assert openprc(*SCALE[:-1], "60mm", "--out", "scale.json", "--force").code == 0
    assert json.loads((tmp_path / "scale.json").read_text())["length"] == 60.0


def test_a_camera_that_is_none(refused, openprc, folders):
    assert openprc(*SCALE, "--out", "scale.json").code == 0
    refused(
        "calibrate", "plane", folders / "L" / "0.png", *WORDS[:4], "--camera", "scale.json",
        "--out", "a.json", told="kind 'scale-bar'", kind="CalibrationError",
    )  # fmt: skip


def test_help_says_where_to_begin(openprc):
    text = openprc("calibrate", "--help").text
    for words in ("scale", "board", "plane", "stereo", "show", "openprc track"):
        assert words in text
