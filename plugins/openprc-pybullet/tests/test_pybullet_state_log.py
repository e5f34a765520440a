"""The container: records by length, bare marks, the cut tail, headers that lie."""

import struct

import numpy as np
import pytest
from openprc_pybullet.state_log import looks_like_log, peek_header, read_state_log

from openprc.errors import UnreadableFile

MARK = b"\xaa\xbb"


@pytest.mark.parametrize(
    ("name", "family", "records", "bare", "cut", "lost_by_splitting"),
    [
        ("kuka_ik_circle.log", "robot", 1200, 0, 0, 2),
        ("r2d2_drive_all.log", "robot", 2160, 0, 0, 5),
        ("minitaur_8motor.bin", "minitaur", 720, 0, 0, 3),
        ("kuka_block_grasp_vr_2017.bin", "robot", 6315, 0, 64, 11),
        ("minitaur_generic_default_dof12_OVERFLOW.log", "robot", 720, 720, 0, None),
        ("minitaur_generic_dof16.log", "robot", 720, 0, 0, 9),
        ("r2d2_drive_contacts.log", "contacts", 6693, 0, 0, None),
        ("pendulum5_chain.log", "robot", 4000, 0, 0, None),
        ("laikago_replay.log", "robot", 1000, 0, 0, None),
        ("cloth_generic.log", "robot", 960, 0, 0, None),
    ],
)
def test_real_logs_are_read_whole(data, name, family, records, bare, cut, lost_by_splitting):
    log = read_state_log(data / name)
    assert log.header.family == family
    assert (log.records.size, log.bare_after.size, log.cut_bytes) == (records, bare, cut)
    if lost_by_splitting is not None:
        body = (data / name).read_bytes()[log.header.offset :]
        whole = [
            part for part in body.split(MARK)[1:] if len(part) == log.header.dtype.itemsize - 2
        ]
        # The shortcut that example scripts use loses records; reading by length does not.
        assert records - len(whole) == lost_by_splitting


def test_letters_b_shifts_nothing(data):
    log = read_state_log(data / "minitaur_8motor.bin")
    assert log.header.dtype.itemsize == 87
    np.testing.assert_array_equal(log.records["t"], np.arange(720))
    assert set(log.records["mo"]) == {6}


def test_counter_48042_is_no_bare_mark(write_log, robot_header, robot_record):
    steps = range(48000, 48100)
    log = read_state_log(write_log(robot_header(), *(robot_record(s) for s in steps)))
    np.testing.assert_array_equal(log.records["stepCount"], steps)
    assert log.bare_after.size == 0


@pytest.mark.parametrize("first", [48042, 48041])
@pytest.mark.parametrize("dt", [0.01, 0.5])
def test_counter_48042_at_the_start(write_log, robot_header, robot_record, first, dt):
    steps = range(first, first + 5)
    log = read_state_log(write_log(robot_header(), *(robot_record(s, dt=dt) for s in steps)))
    np.testing.assert_array_equal(log.records["stepCount"], steps)


@pytest.mark.parametrize("layout", ["FB", "BF", "FBB", "BFF", "FBF", "FF"])
def test_counter_48042_among_bare_marks(write_log, robot_header, robot_record, layout):
    """Bodies with and without state, in every order, through the doubtful steps."""
    steps = range(48038, 48048)
    parts = [
        robot_record(s, body=i) if kind == "F" else MARK
        for s in steps
        for i, kind in enumerate(layout)
    ]
    log = read_state_log(write_log(robot_header(), *parts))
    full = [s for s in steps for kind in layout if kind == "F"]
    np.testing.assert_array_equal(log.records["stepCount"], full)
    assert log.bare_after.size == len(steps) * layout.count("B")
    np.testing.assert_array_equal(
        log.records["objectId"], [i for _ in steps for i, k in enumerate(layout) if k == "F"]
    )


@pytest.mark.parametrize("layout", ["BF", "FB"])
def test_bare_marks_from_step_zero(write_log, robot_header, robot_record, layout):
    parts = [robot_record(s) if kind == "F" else MARK for s in range(6) for kind in layout]
    log = read_state_log(write_log(robot_header(), *parts))
    np.testing.assert_array_equal(log.records["stepCount"], range(6))
    assert log.bare_after.size == 6


@pytest.mark.parametrize("count", [1, 2, 7, 100, 101])
def test_only_bare_marks(write_log, robot_header, count):
    path = write_log(robot_header(1), MARK * count)
    if count == 1:
        with pytest.raises(UnreadableFile, match="2 bytes of an unfinished record"):
            read_state_log(path)
        return
    log = read_state_log(path)
    assert (log.records.size, log.bare_after.size) == (0, count)


def test_every_cut_keeps_the_whole_records(write_log, robot_header, robot_record):
    header, records = (
        robot_header(2),
        [robot_record(s, q=(1, 2), u=(3, 4), dof=2) for s in range(5)],
    )
    size = len(records[0])
    for cut in range(1, size):
        log = read_state_log(write_log(header, *records[:4], records[4][:cut]))
        assert (log.records.size, log.cut_bytes) == (4, cut)


def test_marks_inside_fields_are_data(write_log, robot_header, robot_record):
    inside = struct.unpack("<f", MARK * 2)[0]
    records = [robot_record(s, pos=(inside,) * 3, vel=(inside,) * 3) for s in range(50)]
    log = read_state_log(write_log(robot_header(), *records))
    np.testing.assert_array_equal(log.records["stepCount"], range(50))
    assert log.bare_after.size == 0


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (
            b"stepCount,timeStamp\nId\n\xaa\xbb123456789012",
            "'timeStamp' the unknown type letter 'd'",
        ),
        (
            b"stepCount,timeStamp,objectId\nIf\n\xaa\xbb12345678",
            "3 columns and gives 2 type letters",
        ),
        (b"a,a\nff\n\xaa\xbb12345678", "names a twice"),
        (b"stepCount,timeStamp\nIf\n", "a header and no records"),
        (b"stepCount,timeStamp\nIf\n\xaa\xbb123", "5 bytes of an unfinished record"),
        (b"stepCount,timeStamp", "does not begin with two lines"),
        (b"stepCount,timeStamp\n\xff\xfe\nxx", "not plain text"),
        (b"stepCount,,x\nIfi\n\xaa\xbb12345678", "not column names and type letters"),
        (b"stepCount,timeStamp\nIf\nrubbish instead", "laid out differently"),
    ],
)
def test_damaged_headers_are_named(write_log, content, words):
    with pytest.raises(UnreadableFile, match=words):
        read_state_log(write_log(content))


def test_header_that_lies_about_the_length(write_log, robot_record):
    names = b"stepCount,timeStamp,objectId\nIfi\n"
    with pytest.raises(UnreadableFile, match=r"records of 14 bytes.*the next mark is 70 bytes on"):
        read_state_log(write_log(names, *(robot_record(s) for s in range(9))))


def test_damage_in_the_middle(write_log, robot_header, robot_record):
    records = [robot_record(s) for s in range(9)]
    records[5] = records[5][:-3]
    with pytest.raises(UnreadableFile, match="after record 5 there is no record of 70 bytes"):
        read_state_log(write_log(robot_header(), *records))


def test_counter_that_runs_backwards(write_log, robot_header, robot_record):
    records = [robot_record(s) for s in (0, 1, 2, 0, 1)]
    with pytest.raises(UnreadableFile, match="stepCount runs backwards at record 3: 0 after 2"):
        read_state_log(write_log(robot_header(), *records))


def test_windows_line_ends_and_blanks(write_log, robot_record):
    header = b"a, b\r\nIf\r\n"
    log = read_state_log(write_log(header, MARK, struct.pack("<If", 7, 0.5)))
    assert log.header.names == ("a", "b")
    assert log.records["b"][0] == 0.5


@pytest.mark.parametrize("content", [b"x", b"t,x\n0,1\n", b"\0" * 300, b"word\nword\n"])
def test_other_files_have_no_header(write_log, content):
    path = write_log(content)
    assert peek_header(path) is None or not looks_like_log(path)
