"""readout.h5, metrics.h5 and optimization.h5."""

from __future__ import annotations

import warnings

import h5py
import numpy as np
import pytest

from openprc.errors import MissingData, ResultExists, SchemaError, SchemaTooNew, UnsafeFile
from openprc.schema import Provenance, Trajectory, results
from openprc.schema.results import add_group, read_result, write_result
from openprc.schema.version import NewerSchemaWarning

MADE = Provenance("test", seed=3)
ATTRS = {
    "washout": 20, "ridge": 1e-6, "task": "narma2", "model/fitted": True, "note": None,
    "model/weights/unit": "V", "columns": ["a", "é"], "empty": [], "numbers": [1.0, 2.5],
}  # fmt: skip
ARRAYS = {
    "model/weights": np.arange(6.0).reshape(3, 2), "names": np.array(["x", "naïve"]),
    "counts": np.arange(3), "flags": np.array([True, False]), "scalar": 2.5, "none": np.zeros(0),
}  # fmt: skip


@pytest.fixture
def readout(tmp_path):
    return write_result(
        tmp_path / "out" / "readout.h5", kind="readout", attrs=ATTRS, arrays=ARRAYS,
        provenance=MADE,
    )  # fmt: skip


def test_result_comes_back(readout):
    found = read_result(readout)
    assert (found.kind, found.path) == ("readout", readout)
    assert len(found.run_id) == 36
    assert dict(found.attrs) == {k: v for k, v in ATTRS.items() if v is not None}
    assert set(found.arrays) == set(ARRAYS)
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(found.array(name), array)
    assert (found.provenance["producer"], found.provenance["seed"]) == ("test", 3)


def test_array_that_is_not_there_is_named(readout):
    with pytest.raises(MissingData, match=r"no such array[\s\S]*one of .*model/weights"):
        read_result(readout).array("model/bias")


@pytest.mark.parametrize("kind", ["trajectory", "table", ""])
def test_kind_must_be_one_of_results(tmp_path, kind):
    with pytest.raises(SchemaError, match=r"readout or metrics or optimization"):
        write_result(tmp_path / "x.h5", kind=kind, attrs={}, arrays={}, provenance=MADE)
    assert list(tmp_path.iterdir()) == []


def test_existing_result_is_refused_unless_overwritten(readout):
    before = readout.read_bytes()
    arguments = {"kind": "readout", "attrs": {}, "arrays": {"a": [1]}, "provenance": MADE}
    with pytest.raises(ResultExists, match="finished file"):
        write_result(readout, **arguments)
    assert readout.read_bytes() == before
    write_result(readout, overwrite=True, **arguments)
    assert set(read_result(readout).arrays) == {"a"}


@pytest.mark.parametrize(
    ("arrays", "key"),
    [
        ({"a": np.array([{}], object)}, "a"),
        ({"a": [1.0], "a/b": [2.0]}, "a/b"),
        ({"a": np.array(["2020-01-01"], "M8[D]")}, "a"),
    ],
)
def test_failed_write_leaves_the_old_file(readout, arrays, key):
    before = readout.read_bytes()
    with pytest.raises(SchemaError, match="cannot store it") as caught:
        write_result(
            readout, kind="readout", attrs={}, arrays=arrays, provenance=MADE, overwrite=True
        )
    assert caught.value.key == key
    assert readout.read_bytes() == before
    assert [item.name for item in readout.parent.iterdir()] == ["readout.h5"]


def test_readers_of_the_other_kind_say_so(readout, small):
    with pytest.raises(SchemaError, match=r"holds kind 'readout'[\s\S]*openprc info"):
        Trajectory(readout)
    with pytest.raises(SchemaError, match=r"kind is 'trajectory'[\s\S]*opened with Trajectory"):
        read_result(small)


def test_other_versions(readout):
    with h5py.File(readout, "r+") as file:
        file.attrs["openprc_schema"] = "1.7"
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read_result(readout)
    assert [w.category for w in caught] == [NewerSchemaWarning]
    with h5py.File(readout, "r+") as file:
        file.attrs["openprc_schema"] = "3.0"
    with pytest.raises(SchemaTooNew):
        read_result(readout)


def test_foreign_danger_is_refused_here_too(readout):
    with h5py.File(readout, "r+") as file:
        file["out"] = h5py.ExternalLink("x.h5", "/")
    with pytest.raises(UnsafeFile, match="external link"):
        read_result(readout)


# --- groups -----------------------------------------------------------------------------------


def test_groups_are_added_and_replaced_one_by_one(tmp_path):
    path = tmp_path / "metrics.h5"
    add_group(path, "narma2", attrs={"order": 2}, arrays={"scores": [0.1, 0.2]}, provenance=MADE)
    add_group(path, "narma20", attrs={"order": 20}, arrays={"s": [1.0]}, provenance=MADE)
    add_group(path, "memory", attrs={"delays": ["1", "2"]}, arrays={"c": [3.0]}, provenance=MADE)
    add_group(path, "narma2", attrs={"order": 3}, arrays={"other": [5]}, provenance=MADE)
    found = read_result(path)
    assert found.kind == "metrics"
    assert dict(found.attrs) == {
        "narma2/order": 3, "narma20/order": 20, "memory/delays": ["1", "2"],
    }  # fmt: skip
    assert set(found.arrays) == {"narma2/other", "narma20/s", "memory/c"}


def test_group_of_another_kind_is_refused(readout):
    before = readout.read_bytes()
    with pytest.raises(SchemaError, match="this file holds readout"):
        add_group(readout, "memory", attrs={}, arrays={}, provenance=MADE)
    assert readout.read_bytes() == before


def test_failure_while_adding_leaves_the_groups_that_were_there(tmp_path, monkeypatch):
    path = tmp_path / "metrics.h5"
    add_group(path, "a", attrs={"x": 1}, arrays={}, provenance=MADE)
    before = path.read_bytes()

    def fail(*_):
        raise RuntimeError("cut off")

    monkeypatch.setattr(results, "write_provenance", fail)
    with pytest.raises(RuntimeError, match="cut off"):
        add_group(path, "b", attrs={"x": 2}, arrays={}, provenance=MADE)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
