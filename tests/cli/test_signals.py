"""Reading a signal, and attaching it to a copy of a file."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.cli.signal_file import read_signal
from openprc.errors import ConfigError, OpenPRCError, UnreadableFile, UnsafeFile
from openprc.schema import Trajectory, validate_file

VALUES = np.array([[0.5, 10.0], [-1.5, 20.0], [2.0, 30.0]])


@pytest.fixture
def write(tmp_path):
    """Return a function that writes a signal file, by its suffix."""

    def make(name, content):
        path = tmp_path / name
        if path.suffix == ".npy":
            np.save(path, content)
        elif path.suffix == ".npz":
            np.savez(path, **content)
        elif isinstance(content, bytes):
            path.write_bytes(content)
        else:
            path.write_text(content)
        return path

    return make


@pytest.mark.parametrize(
    ("name", "content", "columns", "names"),
    [
        ("u.csv", "a,b\n0.5,10\n-1.5,20\n2,30\n", (), ("a", "b")),
        ("u.csv", '\ufeff"a" ; "b"\n0.5;10\n-1.5;20\n2;30\n', (), ("a", "b")),
        ("u.txt", "# a comment\n\n0.5 10\n-1.5  20\n 2.0\t30\n", (), ()),
        ("u.tsv", "0.5\t10\n-1.5\t20\n2\t30", (), ()),
        ("u.csv", "a,a\n0.5,10\n-1.5,20\n2,30\n", (), ()),
        ("u.csv", "b,t,a\n10,0,0.5\n20,1,-1.5\n30,2,2\n", ("a", "b"), ("a", "b")),
        ("u.npy", VALUES, (), ()),
        ("u.npy", VALUES.astype("f4"), (), ()),
        ("u.npz", {"u": VALUES}, (), ()),
        ("u.npz", {"t": np.zeros(9), "u": VALUES}, ("u",), ()),
    ],
)
def test_values_and_names(write, name, content, columns, names):
    data, found = read_signal(write(name, content), columns=columns)
    assert data.dtype == np.float64
    np.testing.assert_array_equal(data, VALUES)
    assert found == names


@pytest.mark.parametrize(
    ("name", "content"),
    [("u.csv", "1\n2\n3\n"), ("u.npy", np.array([1, 2, 3])), ("u.npz", {"x": np.arange(1, 4)}),
     ("u.csv", "u\n1\n2\n3")],
)  # fmt: skip
def test_one_column_stays_a_column(write, name, content):
    data, _ = read_signal(write(name, content))
    np.testing.assert_array_equal(data, [[1.0], [2.0], [3.0]])


@pytest.mark.parametrize(
    ("name", "content", "columns", "kind", "words"),
    [
        ("u.csv", "", (), UnreadableFile, "the file is empty"),
        ("u.csv", "# nothing\n\n", (), UnreadableFile, "holds no line of data"),
        ("u.csv", "a,b\n", (), UnreadableFile, "with shape"),
        ("u.csv", "a,b\n1,2\n3\n", (), UnreadableFile, "data line 3 is '3'"),
        ("u.csv", "a,b\n1,x\n", (), UnreadableFile, "data line 2 is '1,x'"),
        ("u.csv", "1,2\n3,\n", (), UnreadableFile, "data line 2 is '3,'"),
        ("u.csv", "u\n1\nnan\n", (), UnreadableFile, "value 1 is not finite"),
        ("u.csv", "u\n1\n2\ninf\n", (), UnreadableFile, "value 2 is not finite"),
        ("u.csv", b"\xff\xfe\x00\x01", (), UnreadableFile, "it is not text"),
        ("u.csv", "a,b\n1,2\n", ("c",), ConfigError, "no column 'c'"),
        ("u.csv", "1,2\n3,4\n", ("a",), ConfigError, "there is no header"),
        ("u.csv", "a,b,a\n1,2,3\n", ("a",), ConfigError, "2 columns 'a'"),
        ("u.csv", "a,b\n1,2\n", ("a", "a"), ConfigError, "1 column 'a' asked for twice"),
        ("u.npy", np.array(["a", "b"]), (), UnreadableFile, "an array of <U1"),
        ("u.npy", np.array([1 + 2j]), (), UnreadableFile, "an array of complex128"),
        ("u.npy", np.zeros((2, 2, 2)), (), UnreadableFile, r"with shape \(2, 2, 2\)"),
        ("u.npy", np.array(1.0), (), UnreadableFile, r"with shape \(\)"),
        ("u.npy", np.zeros((0, 2)), (), UnreadableFile, "empty|shape"),
        ("u.npy", np.array([{}], dtype=object), (), UnreadableFile, r"not a readable \.npy array"),
        ("u.npy", np.array([1.0, np.nan]), (), UnreadableFile, "value 1 is not finite"),
        ("u.npy", VALUES, ("a",), ConfigError, "column 'a' of an array without names"),
        ("u.npz", {"a": VALUES, "b": VALUES}, (), ConfigError, "arrays a, b; asked for none"),
        ("u.npz", {"a": VALUES}, ("b",), ConfigError, "arrays a; asked for b"),
        ("u.npz", {"a": VALUES, "b": VALUES}, ("a", "b"), ConfigError, "asked for a, b"),
        ("u.npz", {"a": np.array([{}], dtype=object)}, (), UnsafeFile, "holds Python objects"),
    ],
)
def test_what_is_no_signal(write, name, content, columns, kind, words):
    path = write(name, content)
    with pytest.raises(kind, match=words) as caught:
        read_signal(path, columns=columns)
    assert caught.value.file == str(path)
    assert caught.value.expected
    assert caught.value.fix


@pytest.mark.parametrize("name", ["u.npy", "u.npz"])
@pytest.mark.parametrize(
    "content",
    [b"not an array", b"\x93NUMPY", b"PK\x03\x04 and then nothing", b"\x93NUMPY\x01\x00v\x00{"],
)
def test_damaged_arrays(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(UnreadableFile, match="not a readable"):
        read_signal(path)


def test_an_archive_under_the_name_of_an_array(tmp_path, write):
    path = write("u.npz", {"a": VALUES}).rename(tmp_path / "u.npy")
    with pytest.raises(UnreadableFile, match=r"not a readable \.npy array"):
        read_signal(path)


def test_an_array_that_claims_8_terabytes(tmp_path):
    path = tmp_path / "u.npy"
    with path.open("wb") as stream:
        header = {"descr": "<f8", "fortran_order": False, "shape": (1 << 40,)}
        np.lib.format.write_array_header_1_0(stream, header)
    with pytest.raises(UnreadableFile, match=r"not a readable \.npy array"):
        read_signal(path)


def test_a_missing_signal(tmp_path):
    with pytest.raises(UnreadableFile, match="does not exist"):
        read_signal(tmp_path / "none.csv")


# --- attach-input ------------------------------------------------------------------------------


@pytest.fixture
def attach(openprc, make_file, tmp_path):
    """Return a function that attaches a signal file to a run of 40 frames, 0.1 s apart."""
    make_file()

    def call(signal, *words):
        return openprc("attach-input", "run.h5", "--signal", signal, "--out", "driven.h5", *words)

    return call


@pytest.mark.parametrize("suffix", [".csv", ".npy", ".npz"])
def test_one_value_a_frame(attach, write, tmp_path, suffix):
    u = np.linspace(-1.0, 1.0, 40)
    content = {
        ".csv": "u\n" + "\n".join(map(repr, u.tolist())), ".npy": u, ".npz": {"x": u},
    }[suffix]  # fmt: skip
    path = write(f"u{suffix}", content)
    before = (tmp_path / "run.h5").read_bytes()
    outcome = attach(path, "--name", "drive", "--unit", "N", "--target", "tip")
    assert outcome.code == 0
    assert "driven.h5: input drive attached, 40 values" in outcome.text
    assert (tmp_path / "run.h5").read_bytes() == before
    with Trajectory(tmp_path / "run.h5") as run, Trajectory(tmp_path / "driven.h5") as driven:
        signal = driven.input("drive")
        np.testing.assert_array_equal(signal.value[:, 0], u)
        assert (signal.unit, signal.quantity, tuple(signal.targets)) == ("N", "force", ("tip",))
        assert signal.sequence is None
        np.testing.assert_array_equal(driven.positions(), run.positions())
        assert driven.provenance["parents"] == [run.run_id]
        assert driven.run_id != run.run_id
        (row,) = driven.provenance["inputs"]
        assert (row["role"], row["name"]) == ("signal", path.name)
    assert validate_file(tmp_path / "driven.h5").ok


def test_symbols_that_are_held(attach, write, tmp_path):
    symbols = np.arange(10.0)
    outcome = attach(write("u.npy", symbols), "--hold", "0.4", "--json")
    assert outcome.data == {"path": "driven.h5", "input": "u", "length": 10, "hold": 0.4}
    with Trajectory(tmp_path / "driven.h5") as driven:
        signal = driven.input("u")
        np.testing.assert_array_equal(signal.value[:, 0], np.repeat(symbols, 4))
        np.testing.assert_array_equal(signal.sequence[:, 0], symbols)
        assert (signal.hold, signal.start) == (0.4, 0.0)
    assert validate_file(tmp_path / "driven.h5").ok


def test_columns_of_a_table(attach, write, tmp_path):
    rows = "".join(f"{i},{2 * i},{3 * i}\n" for i in range(40))
    signal = write("u.csv", "a,b,c\n" + rows)
    assert attach(signal, "--column", "c", "--column", "a").code == 0
    with Trajectory(tmp_path / "driven.h5") as driven:
        found = driven.input("u")
        assert tuple(found.columns) == ("c", "a")
        np.testing.assert_array_equal(found.value, np.arange(40.0)[:, None] * [3.0, 1.0])


@pytest.mark.parametrize(
    ("content", "words", "told"),
    [
        (np.arange(39.0), (), "the signal has 39 values, the file 40 frames"),
        (np.arange(9.0), ("--hold", "0.4"), "the signal covers 0 to 3.6, the frames 0 to 3.9"),
        (np.arange(10.0), ("--hold", "0.4", "--start", "0.2"), "covers 0.2 to 4.2"),
        (np.arange(10.0), ("--hold", "0"), "hold is 0"),
        (np.arange(10.0), ("--hold", "-1"), "hold is -1"),
        (np.arange(40.0), ("--unit", "furlong"), "unknown unit 'furlong'"),
        (np.arange(40.0), ("--column", "u"), "column 'u' of an array without names"),
        (np.arange(40.0), ("--name", "a/b"), "the name 'a/b'"),
        (np.arange(40.0), ("--name", ""), "the name ''"),
        (np.arange(40.0), ("--name", ".."), "the name '..'"),
        (np.array([np.nan] * 40), (), "value 0 is not finite"),
    ],
)
def test_signals_that_do_not_fit(attach, write, tmp_path, content, words, told):
    outcome = attach(write("u.npy", content), *words)
    assert (outcome.code, outcome.out) == (2, "")
    assert told in outcome.text
    assert not (tmp_path / "driven.h5").exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run.h5", "u.npy"]


def test_a_name_that_is_taken(openprc, make_file, write, tmp_path):
    make_file("driven-already.h5", inputs=True)
    signal = write("u.npy", np.arange(40.0))
    outcome = openprc(
        "attach-input", "driven-already.h5", "--signal", signal, "--name", "drive", "--out", "x.h5"
    )
    assert outcome.code == 2
    assert "there is an input 'drive' already" in outcome.text


def test_an_existing_file_is_replaced_only_when_asked(attach, write, tmp_path):
    signal = write("u.npy", np.arange(40.0))
    target = tmp_path / "driven.h5"
    target.write_text("something of the user's")
    outcome = attach(signal)
    assert outcome.code == 2
    assert "--force" in outcome.text
    assert target.read_text() == "something of the user's"
    assert attach(signal, "--force").code == 0
    assert validate_file(target).ok


def test_errors_are_of_the_family(tmp_path):
    with pytest.raises(OpenPRCError):
        read_signal(tmp_path)
