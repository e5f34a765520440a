"""Foreign HDF5: nothing is followed out of the file, nothing is believed, nothing crashes."""

from __future__ import annotations

import faulthandler
import os
import shutil
import signal
import traceback
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from openprc.errors import OpenPRCError, UnreadableFile, UnsafeFile
from openprc.schema import Trajectory, safety, validate_file
from openprc.schema.describe import describe

# --- what cannot be read ----------------------------------------------------------------------


def test_missing_file_names_itself(tmp_path):
    with pytest.raises(UnreadableFile, match="does not exist") as caught:
        safety.open_hdf5(tmp_path / "gone.h5")
    assert caught.value.file == str(tmp_path / "gone.h5")


def test_missing_folder_is_named(tmp_path):
    with pytest.raises(UnreadableFile, match=r"folder .*nowhere does not exist either"):
        safety.check_readable(tmp_path / "nowhere" / "gone.h5")


def test_directory_is_refused(tmp_path):
    with pytest.raises(UnreadableFile, match="this is a directory"):
        safety.open_hdf5(tmp_path)


def test_empty_file_is_refused(tmp_path):
    (tmp_path / "empty.h5").touch()
    with pytest.raises(UnreadableFile, match="empty"):
        safety.open_hdf5(tmp_path / "empty.h5")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root reads all")
def test_file_without_permission_is_refused(small):
    small.chmod(0)
    with pytest.raises(UnreadableFile, match="the system does not open it"):
        safety.open_hdf5(small)


def test_name_that_the_system_refuses():
    with pytest.raises(UnreadableFile, match="the system does not open it"):
        safety.open_hdf5("x" * 5000)


@pytest.mark.parametrize(
    "content", [b"time,x\n0,1\n", b"\x89PNG\r\n\x1a\n" + bytes(600), bytes(4096), b"PK\x03\x04"]
)
def test_other_formats_under_the_name_are_refused(tmp_path, content):
    path = tmp_path / "renamed.h5"
    path.write_bytes(content)
    with pytest.raises(UnreadableFile, match=r"this is not HDF5: it begins with"):
        safety.open_hdf5(path)


def test_user_block_is_read(tmp_path):
    with h5py.File(tmp_path / "block.h5", "w", userblock_size=1024) as file:
        file["x"] = 1
    assert safety.is_hdf5(tmp_path / "block.h5")
    with safety.open_hdf5(tmp_path / "block.h5") as file:
        assert file["x"][()] == 1


def test_every_truncation_is_an_error_of_ours(complete, tmp_path):
    whole = complete.read_bytes()
    path = tmp_path / "cut.h5"
    lengths = {*range(1, 64, 9), *range(64, len(whole), len(whole) // 60), len(whole) - 1}
    for length in sorted(lengths):
        path.write_bytes(whole[:length])
        with pytest.raises(UnreadableFile):
            Trajectory(path)
        assert [f.code for f in validate_file(path).findings] == ["OPS-F01"]


# --- what leads out of the file -----------------------------------------------------------------


@pytest.fixture
def secret(tmp_path):
    path = tmp_path / "secret.h5"
    with h5py.File(path, "w") as file:
        file["data"] = np.arange(5.0)
    (tmp_path / "secret.bin").write_bytes(bytes(80))
    return path


@pytest.fixture
def foreign(tmp_path):
    path = tmp_path / "foreign.h5"
    with h5py.File(path, "w") as file:
        file["fine"] = np.arange(3.0)
    return path


def refuse(path, words, **options):
    with pytest.raises(UnsafeFile, match=words) as caught:
        safety.open_hdf5(path, **options)
    assert caught.value.key
    with h5py.File(path, "r+"):
        pass  # nothing holds it open


@pytest.mark.parametrize("depth", [0, 3])
def test_external_link(foreign, secret, depth):
    with h5py.File(foreign, "r+") as file:
        group = file.require_group("/".join("abc"[:depth])) if depth else file
        group["out"] = h5py.ExternalLink(secret.name, "/data")
    refuse(foreign, "an external link into 'secret.h5'")
    refuse(foreign, "an external link", allow_soft_links=True)


@pytest.mark.parametrize("target", ["/fine", "/nothing", "/"])
def test_soft_link(foreign, target):
    with h5py.File(foreign, "r+") as file:
        file["alias"] = h5py.SoftLink(target)
    refuse(foreign, "a soft link to")
    with safety.open_hdf5(foreign, allow_soft_links=True) as file:
        assert "fine" in file


def test_external_raw_storage(foreign, secret):
    with h5py.File(foreign, "r+") as file:
        raw = [(str(secret.with_suffix(".bin")), 0, 80)]
        file.create_dataset("raw", shape=(10,), dtype="f8", external=raw)
    refuse(foreign, "external raw storage in")


def test_virtual_dataset(foreign, secret):
    layout = h5py.VirtualLayout(shape=(5,), dtype="f8")
    layout[:] = h5py.VirtualSource(secret.name, "data", shape=(5,))
    with h5py.File(foreign, "r+") as file:
        file.create_virtual_dataset("view", layout)
    refuse(foreign, "a virtual dataset")


@pytest.mark.parametrize("options", [{}, {"compression": "gzip"}, {"fletcher32": True}])
def test_terabytes_that_are_not_there(foreign, options):
    with h5py.File(foreign, "r+") as file:
        file.create_dataset("huge", shape=(10**12,), dtype="f8", chunks=(10**6,), **options)
    assert foreign.stat().st_size < 20_000
    refuse(foreign, r"claims 8,000,000,000,000 bytes and holds 0")


def test_data_that_were_written_in_part(foreign):
    with h5py.File(foreign, "r+") as file:
        data = file.create_dataset("part", shape=(10**6,), dtype="f8", chunks=(10**4,))
        data[:10_000] = 1.0
    refuse(foreign, "the rest would read as zeros")


@pytest.mark.parametrize(("written", "fine"), [(10_000, False), (40_000, True)])
def test_unfinished_file_needs_its_committed_rows_only(foreign, written, fine):
    with h5py.File(foreign, "r+") as file:
        data = file.create_dataset(
            "rows", shape=(10**12, 2), dtype="f8", chunks=(10**4, 2), maxshape=(None, 2)
        )
        data[:written] = 1.0
        file["committed"] = np.int64(35_000)
    refuse(foreign, "the rest would read as zeros")
    if fine:
        with safety.open_hdf5(foreign, unfinished=True) as file:
            assert file["rows"][34_999].tolist() == [1.0, 1.0]
    else:
        refuse(foreign, "row 10000 is committed and was never written", unfinished=True)


def test_counter_that_leads_elsewhere_is_not_followed(foreign, secret):
    with h5py.File(foreign, "r+") as file:
        file["committed"] = h5py.ExternalLink(secret.name, "/data")
    refuse(foreign, "an external link", unfinished=True)
    layout = h5py.VirtualLayout(shape=(), dtype="i8")
    layout[()] = h5py.VirtualSource(secret.name, "data", shape=())
    with h5py.File(foreign, "r+") as file:
        del file["committed"]
        file.create_virtual_dataset("committed", layout)
    refuse(foreign, "a virtual dataset", unfinished=True)


def test_compressed_zeros_are_no_bomb(foreign):
    with h5py.File(foreign, "r+") as file:
        file.create_dataset("zeros", data=np.zeros(10**6), compression="gzip", chunks=(10**5,))
    with safety.open_hdf5(foreign) as file:
        assert file["zeros"].shape == (10**6,)


def test_object_reference(foreign):
    with h5py.File(foreign, "r+") as file:
        file.create_dataset("refs", data=[file["fine"].ref], dtype=h5py.ref_dtype)
    refuse(foreign, "object references")
    with safety.open_hdf5(foreign, allow_references=True) as file:
        assert file["refs"].shape == (1,)


def test_reference_within_a_record(foreign):
    dtype = np.dtype([("a", "f8"), ("b", h5py.ref_dtype)])
    with h5py.File(foreign, "r+") as file:
        file.create_dataset("records", shape=(2,), dtype=dtype)
    refuse(foreign, "object references")


def test_variable_length_arrays(foreign):
    with h5py.File(foreign, "r+") as file:
        data = file.create_dataset("ragged", shape=(2,), dtype=h5py.vlen_dtype("f8"))
        data[0] = [1.0, 2.0]
    refuse(foreign, "variable-length arrays")
    with safety.open_hdf5(foreign, allow_vlen=True) as file:
        assert file["ragged"][0].tolist() == [1.0, 2.0]


def test_groups_that_contain_themselves_end(foreign):
    with h5py.File(foreign, "r+") as file:
        group = file.create_group("a/b")
        group["again"] = file["a"]
        file["root"] = file["/"]
    with safety.open_hdf5(foreign) as file:
        assert "again" in file["a/b"]


def test_deep_nesting(foreign):
    with h5py.File(foreign, "r+") as file:
        file.create_group("/".join("x" * 60))
    refuse(foreign, "groups are nested deeper than 32")


def test_too_many_objects(foreign, monkeypatch):
    monkeypatch.setattr(safety, "MAX_OBJECTS", 20)
    with h5py.File(foreign, "r+") as file:
        for i in range(30):
            file.create_group(f"g{i}")
    refuse(foreign, "more than 20 objects")


def test_named_type_and_null_dataset_are_harmless(foreign):
    with h5py.File(foreign, "r+") as file:
        file["type"] = np.dtype("f8")
        file["null"] = h5py.Empty("f8")
    with safety.open_hdf5(foreign) as file:
        assert len(file) == 3


def test_filter_that_is_not_installed(foreign, monkeypatch):
    with h5py.File(foreign, "r+") as file:
        file.create_dataset("packed", data=np.arange(100.0), compression="gzip")
    monkeypatch.setattr(h5py.h5z, "filter_avail", lambda _: False)
    with pytest.raises(UnreadableFile, match=r"stored with filter 1 \(deflate\), not installed"):
        safety.open_hdf5(foreign)
    with h5py.File(foreign, "r+"):
        pass  # nothing holds it open


# --- damage of every kind -------------------------------------------------------------------------


def exercise(path: Path) -> None:
    """Open, read and describe: only errors of ours may come out."""
    try:
        with Trajectory(path) as trajectory:
            for read in (
                lambda: trajectory.time,
                trajectory.positions,
                trajectory.velocities,
                trajectory.observed,
                lambda: [trajectory.element(k, q) for k in trajectory.element_kinds
                         for q in trajectory.element_series(k)],
                lambda: [trajectory.indices(k) for k in trajectory.element_kinds],
                lambda: [trajectory.channel(name) for name in trajectory.channels],
                lambda: [trajectory.system(name) for name in trajectory.systems],
                lambda: [trajectory.input(name) for name in trajectory.inputs],
                lambda: [trajectory.node(n) for n in ("rest", "mass", "fixed", "id", "label")],
                lambda: trajectory.dt,
                lambda: trajectory.provenance,
                trajectory.content_digest,
            ):  # fmt: skip
                with suppress(OpenPRCError):
                    read()
    except OpenPRCError:
        pass
    with suppress(OpenPRCError):
        describe(path)
    validate_file(path).as_dict()


def fault_of(path: Path) -> str:
    """Exercise a file in a process of its own and return the traceback of what came out.

    The HDF5 library itself crashes or never returns on about one damaged file in a thousand;
    nothing in this process could prevent that, so a child that dies of it counts as no fault.
    """
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        faulthandler.disable()
        signal.alarm(20)
        try:
            exercise(path)
        except BaseException:
            os.write(writer, traceback.format_exc().encode(errors="replace"))
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as stream:
        said = stream.read().decode(errors="replace")
    os.waitpid(child, 0)
    return said


@pytest.fixture(scope="module")
def victim(complete_template, tmp_path_factory):
    folder = tmp_path_factory.mktemp("fuzz")
    return Path(shutil.copyfile(complete_template, folder / "victim.h5")), folder / "hit.h5"


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs a process of its own")
@pytest.mark.filterwarnings("ignore")
@settings(
    max_examples=80, deadline=None, derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)  # fmt: skip
@given(data=st.data())
def test_flipped_bytes_never_give_another_error(victim, data):
    source, path = victim
    raw = bytearray(source.read_bytes())
    places = st.one_of(st.integers(0, len(raw) - 1), st.integers(0, min(4000, len(raw) - 1)))
    for place, value in data.draw(
        st.lists(st.tuples(places, st.integers(0, 255)), min_size=1, max_size=8)
    ):
        raw[place] = value
    path.write_bytes(raw)
    fault = fault_of(path)
    assert not fault, fault


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs a process of its own")
@pytest.mark.filterwarnings("ignore")
@settings(max_examples=30, deadline=None, derandomize=True)
@given(cut=st.floats(0, 1), tail=st.binary(max_size=200))
def test_cut_and_continued_never_gives_another_error(victim, cut, tail):
    source, path = victim
    raw = source.read_bytes()
    path.write_bytes(raw[: int(cut * len(raw))] + tail)
    fault = fault_of(path)
    assert not fault, fault


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs a process of its own")
def test_fault_is_noticed(complete, monkeypatch):
    monkeypatch.setattr(Trajectory, "positions", lambda self: 1 / 0)
    assert "ZeroDivisionError" in fault_of(complete)
    monkeypatch.undo()
    assert fault_of(complete) == ""
