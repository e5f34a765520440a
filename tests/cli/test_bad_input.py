"""Bad files, one case each: the words, the exit code, and nothing under a final name."""

from __future__ import annotations

import shutil

import h5py
import numpy as np
import pytest

OUT = "result.h5"


# --- files that are not what they should be ----------------------------------------------------


def missing(path, good):
    pass


def directory(path, good):
    path.mkdir()
    (path / "notes.txt").write_text("nothing to see")


def empty(path, good):
    path.touch()


def text(path, good):
    path.write_text("t,x\n0,1\n")


def truncated(path, good):
    data = good.read_bytes()
    path.write_bytes(data[: len(data) // 2])


def other_hdf5(path, good):
    with h5py.File(path, "w") as file:
        file["x"] = np.zeros(3)


def edited(change):
    def make(path, good):
        shutil.copy(good, path)
        with h5py.File(path, "r+") as file:
            change(file)

    return make


def newer(file):
    file.attrs["openprc_schema"] = "2.0"


def older(file):
    file.attrs["openprc_schema"] = "0.4"


def unversioned(file):
    file.attrs["openprc_schema"] = "latest"


def external_link(file):
    file["topology/mesh"] = h5py.ExternalLink("elsewhere.h5", "/secret")


def virtual(file):
    layout = h5py.VirtualLayout(shape=(40,), dtype="f8")
    layout[:] = h5py.VirtualSource("elsewhere.h5", "x", shape=(40,))
    file.create_virtual_dataset("time_series/system/energy", layout)


def external_storage(file):
    file.create_dataset(
        "time_series/system/energy", (40,), "f8", external=[("raw.bin", 0, h5py.h5f.UNLIMITED)]
    )


def claim(file):
    file.create_dataset("time_series/channels/big", (1 << 20, 1 << 20), "f8", chunks=(1024, 1))


OPENING = [
    (missing, "does not exist", "OPS-F01"),
    (directory, "this is a directory", "OPS-F01"),
    (empty, "the file is empty (0 bytes)", "OPS-F01"),
    (text, "this is not HDF5: it begins with", "OPS-F01"),
    (truncated, "cannot open it", "OPS-F01"),
    (edited(external_link), "an external link into 'elsewhere.h5'", "OPS-F02"),
    (edited(virtual), "a virtual dataset, which reads other files", "OPS-F02"),
    (edited(external_storage), "external raw storage in", "OPS-F02"),
    (edited(claim), "claims 8,796,093,022,208 bytes and holds", "OPS-F02"),
    (edited(newer), "the file follows schema 2.0", "OPS-F03"),
    (edited(older), "the file follows schema 0.4", "OPS-F03"),
    (edited(unversioned), "the version is 'latest'", "OPS-F04"),
    (other_hdf5, "openprc_schema is missing", "OPS-F04"),
]
NAMES = [
    "missing", "directory", "empty", "text", "truncated", "external-link", "virtual",
    "external-storage", "8-TB", "newer", "older", "unversioned", "other-hdf5",
]  # fmt: skip


@pytest.mark.parametrize(("make", "words", "code"), OPENING, ids=NAMES)
def test_validate_reports_what_cannot_be_opened(refused, tmp_path, make_file, make, words, code):
    path = tmp_path / "bad.h5"
    make(path, make_file())
    report = refused("validate", path, code=2, told=(code, words, "not valid"))
    assert report["ok"] is False
    assert [f["code"] for f in report["findings"]] == [code]


@pytest.mark.parametrize(("make", "words", "code"), OPENING, ids=NAMES)
@pytest.mark.parametrize(
    "words_of",
    [
        lambda path: ["pack", path],
        lambda path: ["repair", path, "--out", OUT],
        lambda path: ["attach-input", path, "--signal", "u.csv", "--out", OUT],
    ],
    ids=["pack", "repair", "attach-input"],
)
def test_commands_that_write_refuse_them(refused, tmp_path, make_file, make, words, code, words_of):
    path = tmp_path / "bad.h5"
    make(path, make_file())
    (tmp_path / "u.csv").write_text("u\n" + "1\n" * 40)
    refused(*words_of(path), told=words)


@pytest.mark.parametrize(
    ("make", "words", "code"),
    [case for case in OPENING if case[0] not in (directory, other_hdf5)],
    ids=[name for name in NAMES if name not in ("directory", "other-hdf5")],
)
def test_info_and_benchmark_refuse_them(refused, tmp_path, make_file, make, words, code):
    path = tmp_path / "bad.h5"
    make(path, make_file())
    if code != "OPS-F04":
        refused("benchmark", path, told=words)
    refused("info", path, told=words)


def test_info_on_a_folder_without_an_experiment(refused, tmp_path, make_file):
    directory(tmp_path / "folder", None)
    refused("info", tmp_path / "folder", told="there is no experiment here", kind="UnreadableFile")


# --- content that breaks the contract ----------------------------------------------------------


def backwards(file):
    file["time_series/time"][3] = 0.05


def nan_time(file):
    file["time_series/time"][3] = np.nan


def infinite(file):
    file["time_series/nodes/positions"][2, 1, 0] = np.inf


def gap(file):
    file["time_series/nodes/positions"][2, 1] = np.nan


def short(file):
    file["time_series/channels/gauge"].resize(30, axis=0)


def replace(path, data):
    def change(file):
        attrs = dict(file[path].attrs)
        del file[path]
        file.create_dataset(path, data=data).attrs.update(attrs)

    return change


def unit(file):
    file["time_series/channels/gauge"].attrs["unit"] = "furlong"


def unfinished(file):
    file.attrs["status"] = "running"


def without_time(file):
    del file["time_series/time"]


def without_provenance(file):
    del file["provenance"]


CONTENT = [
    (nan_time, "OPS-T01", "nan at frame 3"),
    (backwards, "OPS-T02", "frame 2 is at 0.2, frame 3 at 0.05"),
    (infinite, "OPS-N04", "infinite at frame 2"),
    (gap, "OPS-N01", "3 NaN, first at frame 2, node 1"),
    (short, "OPS-L03", "shape (30, 2): T is 30"),
    (replace("topology/nodes/id", np.array([1, 2, 2, 4])), "OPS-N06", "'2' twice"),
    (replace("topology/bars/indices", np.array([[0, 1], [1, 2], [2, 9]], dtype="i4")),
     "OPS-E01", "node 9"),
    (replace("topology/bars/indices", np.array([[0, 1], [1, 2], [2, -1]], dtype="i4")),
     "OPS-E01", "node -1"),
    (replace("topology/bars/indices", np.array([[0, 1], [1, 2], [2, 2]], dtype="i4")),
     "OPS-E02", "element 2 is [2, 2]"),
    (replace("topology/bars/indices", np.array([[0, 1, 2]], dtype="i4")), "OPS-L03", "k is 3"),
    (replace("time_series/nodes/positions", np.zeros((40, 4))), "OPS-L03", "shape (40, 4)"),
    (unit, "OPS-L07", "unknown unit 'furlong'"),
    (unfinished, "OPS-R05", "status is 'running'"),
    (without_time, "OPS-L01", "the dataset is missing"),
    (without_provenance, "OPS-P01", "the group is missing"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "code", "words"), CONTENT)
def test_validate_names_what_breaks_the_contract(refused, make_file, tmp_path, change, code, words):
    path = tmp_path / "bad.h5"
    edited(change)(path, make_file())
    report = refused("validate", path, code=1, told=(code, words, "not valid"))
    found = {f["code"]: f for f in report["findings"] if f["level"] == "error"}
    assert words in found[code]["found"]
    assert report["ok"] is False
    assert report["counts"]["error"] >= len(found)
