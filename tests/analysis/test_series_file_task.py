"""Series from files of text and numbers."""

import numpy as np
import pytest

from openprc.analysis.tasks import load_series
from openprc.errors import TaskError, UnreadableFile, UnsafeFile


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.txt", "1 2\n3 4\n"),
        ("a.csv", "t,x\n1,2\n3,4\n"),
        ("a.tsv", "# laser\n1\t2\n\n3\t4  # last\n"),
        ("a.dat", "\ufeff1; 2\r\n3; 4"),
    ],
)
def test_text(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    assert load_series(path).tolist() == [[1, 2], [3, 4]]
    assert load_series(str(path), column=-1).tolist() == [[2], [4]]


def test_numpy_file(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, np.arange(3, dtype=np.int16))
    values = load_series(path)
    assert values.dtype == np.float64
    assert values.tolist() == [[0], [1], [2]]


def test_objects_are_not_unpickled(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(UnsafeFile, match=r"a\.npy: the file holds pickled objects"):
        load_series(path)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.txt", b"", "there are no numbers in it"),
        ("a.txt", b"names only\n", "there are no numbers"),
        ("a.txt", b"1\n2\nthree\n", "line 3 is 'three'"),
        ("a.txt", b"a\nb\n1\n", "line 2 is 'b'"),
        ("a.txt", b"1,5\n2\n", "line 2 has 1 columns\n.*2, as the lines"),
        ("a.txt", b"\xff\xfe\x00", "the file is not text"),
        ("a.npy", b"", "expected: an array of numbers"),
        ("a.npy", b"\x93NUMPY\x01\x00", "expected: an array of numbers"),
    ],
)
def test_unreadable(tmp_path, name, content, words):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(UnreadableFile, match=words):
        load_series(path)


@pytest.mark.parametrize("array", [np.zeros((2, 2, 2)), np.array(["a"]), np.zeros(0)])
def test_arrays_that_are_no_series(tmp_path, array):
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(UnreadableFile, match="one or two dimensions"):
        load_series(tmp_path / "a.npy")


def test_missing_file_values_and_columns(tmp_path):
    with pytest.raises(UnreadableFile, match="no such file"):
        load_series(tmp_path / "b.txt")
    path = tmp_path / "a.csv"
    path.write_text("1,2\n3,\n")
    with pytest.raises(TaskError, match="1 of 2 rows are NaN or infinite, the first is row 1"):
        load_series(path)
    assert load_series(path, column=0).tolist() == [[1], [3]]
    with pytest.raises(TaskError, match="column 2 of 2"):
        load_series(path, column=2)
