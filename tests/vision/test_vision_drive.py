"""What drove the body: tables with and without times, symbols, and a marker in the video."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import ConfigError, MissingData, OpenPRCError, UnreadableFile
from openprc.schema import Provenance, Trajectory, TrajectoryWriter
from openprc.vision.drive import marker_drive, read_drive
from openprc.vision.producer import VisionProducer
from openprc.vision.synth import cases

FRAMES = np.arange(10) / 10.0


@pytest.fixture
def write(tmp_path):
    def make(text):
        path = tmp_path / "drive.csv"
        path.write_text(text)
        return path

    return make


@pytest.mark.parametrize(
    ("text", "columns", "unit", "values"),
    [
        ("1\n2\n3\n", ("u",), "1", [[1], [2], [3]]),
        ("u\n1\n2\n", ("u",), "1", [[1], [2]]),
        ("force [N]\n1\n2\n", ("force",), "N", [[1], [2]]),
        ("a [mm];b [mm]\n1;2\n3;4\n", ("a", "b"), "mm", [[1, 2], [3, 4]]),
        ("# made by a bench\n1\t2\n\n3\t4\n", ("u0", "u1"), "1", [[1, 2], [3, 4]]),
        ('\ufeff"u (V)"\n1e0\n-2\n', ("u",), "V", [[1], [-2]]),
    ],
)
def test_one_value_a_frame(write, text, columns, unit, values):
    drive = read_drive(write(text))
    assert (drive.columns, drive.unit, drive.per_frame) == (columns, unit, True)
    np.testing.assert_array_equal(drive.values, values)
    frames = np.arange(len(values)) / 30.0
    np.testing.assert_array_equal(drive.on_clock(frames, frames), values)


def test_values_are_held_on_a_finer_clock(write):
    drive = read_drive(write("".join(f"{k}\n" for k in range(10))))
    held = drive.on_clock(np.array([0.0, 0.05, 0.1, 0.8999, 0.9]), FRAMES)
    np.testing.assert_array_equal(held[:, 0], [0, 0, 1, 8, 9])


@pytest.mark.parametrize(
    ("header", "factor"), [("t", 1.0), ("time [ms]", 1e3), ("t_ms", 1e3), ("Time (s)", 1.0)]
)
def test_evenly_spaced_times_make_symbols(write, header, factor):
    rows = "".join(f"{factor * (0.1 + 0.25 * k)},{k}\n" for k in range(4))
    drive = read_drive(write(f"{header},u\n{rows}"))
    assert drive.columns == ("u",)
    assert drive.hold == pytest.approx(0.25)
    assert drive.start == pytest.approx(0.1)
    held = drive.on_clock(np.array([0.1, 0.34, 0.36, 1.1]), FRAMES)
    np.testing.assert_array_equal(held[:, 0], [0, 0, 1, 3])


def test_uneven_times_are_held_from_row_to_row(write):
    drive = read_drive(write("t,u\n0,5\n0.3,6\n0.4,7\n"), start=0.1)
    assert drive.hold is None
    held = drive.on_clock(np.array([0.1, 0.39, 0.4, 0.49, 0.55]), FRAMES)
    np.testing.assert_array_equal(held[:, 0], [5, 5, 6, 6, 7])


def test_symbols_of_a_stated_duration(write):
    drive = read_drive(write("4\n5\n"), hold=0.5, unit="N", quantity="force")
    assert (drive.unit, drive.quantity) == ("N", "force")
    np.testing.assert_array_equal(drive.on_clock(FRAMES, FRAMES)[:, 0], [4] * 5 + [5] * 5)


@pytest.mark.parametrize(
    ("text", "words", "found"),
    [
        ("1\n2\n", {"hold": 0.2}, "covers 0 to 0.4 s, the video 0 to 0.9 s"),
        ("1\n2\n", {"hold": 0.6, "start": 0.2}, "covers 0.2 to 1.4 s"),
        ("t,u\n0,1\n0.1,2\n0.5,3\n", {"start": -0.2}, "covers -0.2 to 0.7 s"),
        ("t,u\n0.2,1\n0.3,2\n2,3\n", {}, "covers 0.2 to"),
    ],
)
def test_nothing_is_extrapolated(write, text, words, found):
    drive = read_drive(write(text), **words)
    with pytest.raises(ConfigError, match=found) as caught:
        drive.on_clock(FRAMES, FRAMES)
    assert caught.value.file.endswith("drive.csv")


@pytest.mark.parametrize(
    ("text", "words", "kind", "found"),
    [
        ("", {}, UnreadableFile, "empty"),
        ("u\n", {}, UnreadableFile, "a header and no data"),
        ("# nothing\n", {}, UnreadableFile, "no line of data"),
        ("1\nx\n", {}, UnreadableFile, "line 2 is 'x'"),
        ("1,2\n3\n", {}, UnreadableFile, "line 2 is '3'"),
        ("1\nnan\n", {}, UnreadableFile, "line 2 is 'nan'"),
        ("u,u\n1,2\n", {}, UnreadableFile, "a name empty or twice"),
        ("t\n1\n2\n", {}, UnreadableFile, "times and none of values"),
        ("t,u\n1,1\n1,2\n", {}, ConfigError, "time does not increase at row 1"),
        ("t [kg],u\n1,1\n2,2\n", {}, ConfigError, "the column 't \\[kg\\]' is in kg"),
        ("u [N],v [mm]\n1,1\n2,2\n", {}, ConfigError, "have the units N, mm"),
        ("u [furlong]\n1\n", {}, OpenPRCError, "unknown unit 'furlong'"),
        ("t,u\n1,1\n2,2\n", {"hold": 1.0}, ConfigError, "and drive_hold is 1 s"),
        ("1\n2\n", {"start": 1.0}, ConfigError, "nothing of how long a value holds"),
        ("1\n2\n", {"hold": -1.0}, ConfigError, "drive_hold is -1"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_table_is_told(write, text, words, kind, found):
    with pytest.raises(kind, match=found):
        read_drive(write(text), **words)


def test_tables_that_are_no_text(tmp_path):
    (tmp_path / "drive.csv").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(UnreadableFile, match="it is not text"):
        read_drive(tmp_path / "drive.csv")
    with pytest.raises(UnreadableFile, match="does not exist"):
        read_drive(tmp_path / "none.csv")


def test_marker_counts_from_the_first_frame():
    path = np.array([[5.0, 1.0], [6.0, 3.0], [5.0, 1.5]])
    drive = marker_drive(path, unit="mm", axes=("x", "y"), label="point 3")
    np.testing.assert_array_equal(drive.values, [[0, 0], [1, 2], [0, 0.5]])
    assert (drive.columns, drive.unit, drive.quantity) == (("dx", "dy"), "mm", "displacement")
    path[1] = np.nan
    with pytest.raises(MissingData, match=r"the marker \(point 3\) was not seen in 1 of 3 frames"):
        marker_drive(path, unit="mm", axes=("x", "y"), label="point 3")


# --- in a file ---


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    pytest.importorskip("cv2")
    made = cases.case("translation", noise=1.0, n_frames=10, shape=(80, 120))
    return made, made.write(tmp_path_factory.mktemp("clip") / "clip.avi", fps=10.0)


POINTS = [(30, 30), (60, 40), (90, 50)]


@pytest.fixture
def convert(clip, tmp_path):
    (tmp_path / "points.csv").write_text("".join(f"{x},{y}\n" for x, y in POINTS))

    def run(**options):
        out = tmp_path / "run.h5"
        with TrajectoryWriter(
            out, provenance=Provenance("vision"), overwrite=True, on_failure="discard"
        ) as writer:
            VisionProducer().import_run(
                clip[1], writer, options={"points": tmp_path / "points.csv", **options}
            )
        return Trajectory(out)

    return run


def test_symbols_in_the_file(write, convert):
    with convert(drive=write("t [s],u [V]\n0,1\n0.5,-1\n"), drive_quantity="voltage") as run:
        signal = run.input("drive")
        np.testing.assert_array_equal(signal.value[:, 0], [1] * 5 + [-1] * 5)
        np.testing.assert_array_equal(signal.sequence[:, 0], [1, -1])
        assert (signal.hold, signal.start, signal.unit) == (pytest.approx(0.5), 0.0, "V")
        assert signal.quantity == "voltage"
        assert {entry["role"] for entry in run.provenance["inputs"]} == {"points", "drive"}


def test_a_drive_of_another_length_is_refused_before_tracking(write, convert):
    with pytest.raises(ConfigError, match="the drive has 9 values, the video 10 frames"):
        convert(drive=write("1\n" * 9))


@pytest.mark.parametrize("marker", [2, "90,50"])
def test_marker_is_the_input_and_no_node(clip, convert, marker):
    with convert(drive_marker=marker) as run:
        truth = clip[0].truth(np.array(POINTS, float))
        moved = run.input("drive").value
        np.testing.assert_allclose(moved, truth[:, 2] - truth[0, 2], atol=0.05)
        assert run.n_nodes == 2 + (marker != 2)
        assert "it is not a node" in "\n".join(run.provenance["notes"])


def test_marker_may_stay_a_node_and_is_resampled(clip, convert):
    with convert(drive_marker=0, keep_marker=True, rate=20.0) as run:
        assert run.n_nodes == 3
        assert run.n_frames == 19
        np.testing.assert_allclose(
            run.input("drive").value, run.positions()[:, 0] - run.positions()[0, 0]
        )


def test_drive_and_marker_exclude_each_other(write, convert):
    with pytest.raises(ConfigError, match="both drive and drive_marker are given"):
        convert(drive=write("1\n" * 10), drive_marker=0)


def test_the_only_point_cannot_be_the_marker(convert, tmp_path):
    (tmp_path / "points.csv").write_text("60,40\n")
    with pytest.raises(ConfigError, match="the marker is the only point"):
        convert(drive_marker=0)
