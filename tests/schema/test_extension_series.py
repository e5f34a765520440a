"""Series below /extensions grow, are committed, checked and copied like every other series."""

from __future__ import annotations

import json
import re

import h5py
import numpy as np
import pytest

from openprc.errors import MissingData, SchemaError, UnitError
from openprc.exporters.npz_arrays import NpzExporter
from openprc.schema import Provenance, Trajectory, TrajectoryWriter, validate_file
from openprc.schema.derive import attach_input, pack, repair
from openprc.schema.layout import CHECKSUM, TIME_AXIS
from openprc.schema.migrate import migrate

TRACKER = "openprc-vision"
QUALITY, SIGMA, STATUS = (f"extensions/{TRACKER}/{name}" for name in ("quality", "sigma", "status"))


def frames(start, stop):
    """Two nodes; the second is not seen in every third frame."""
    frame = np.arange(start, stop)
    quality = 0.5 + 0.01 * frame[:, None] + [0.0, 0.25]
    quality[frame % 3 == 2, 1] = np.nan
    sigma = np.stack([0.1 * quality, 0.2 * quality], axis=2)
    status = np.stack([0 * frame, frame % 3], axis=1)
    positions = np.stack([quality, 2 * quality], axis=2)
    return frame * 0.5, {
        "positions": positions,
        "observed": np.isfinite(quality).astype("u1"),
        "extensions": {
            (TRACKER, "quality"): quality, (TRACKER, "sigma"): sigma, (TRACKER, "status"): status,
        },
    }  # fmt: skip


def declare(writer):
    writer.declare_nodes(2, 2, unit="mm", observed=True)
    writer.declare_extension(TRACKER, "1.0")
    writer.put_extension(TRACKER, "matrix", np.eye(3))
    writer.declare_extension_series(TRACKER, "quality", (2,), comment="correlation")
    writer.declare_extension_series(TRACKER, "sigma", (2, 2), unit="mm", dtype="f8")
    writer.declare_extension_series(TRACKER, "status", (2,), dtype="u1")


def write(path, n_frames=9, block=4):
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        declare(writer)
        for start in range(0, n_frames, block):
            time, rest = frames(start, min(start + block, n_frames))
            writer.append(time, **rest)
    return path


@pytest.fixture
def tracked(tmp_path):
    return write(tmp_path / "tracked.h5")


def test_series_come_back_as_declared(tracked):
    _, wanted = frames(0, 9)
    with Trajectory(tracked) as run:
        assert run.extension_names(TRACKER) == ("matrix", "quality", "sigma", "status")
        quality = run.extension(TRACKER, "quality")
        assert quality.dtype == np.float32
        np.testing.assert_array_equal(
            quality, wanted["extensions"][TRACKER, "quality"].astype("f4")
        )
        sigma = run.extension(TRACKER, "sigma")
        np.testing.assert_array_equal(sigma, wanted["extensions"][TRACKER, "sigma"])
        assert run.unit(f"/extensions/{TRACKER}/sigma") == "mm"
        assert run.extension(TRACKER, "status").dtype == np.uint8
        np.testing.assert_array_equal(run.extension(TRACKER, "matrix"), np.eye(3))
    with h5py.File(tracked) as file:
        assert file[QUALITY].attrs["comment"] == "correlation"
        assert file[QUALITY].attrs[TIME_AXIS] == 0
        assert TIME_AXIS not in file[f"extensions/{TRACKER}/matrix"].attrs


def test_series_are_read_in_ranges(tracked):
    with Trajectory(tracked) as run:
        whole = run.extension(TRACKER, "sigma")
        for part in (slice(2, 5), slice(None, None, 3), slice(-2, None), slice(7, 99)):
            np.testing.assert_array_equal(run.extension(TRACKER, "sigma", frames=part), whole[part])
        series = run.series(f"/extensions/{TRACKER}/sigma")
        np.testing.assert_array_equal(series.read(slice(3, 6)), whole[3:6])
        with pytest.raises(SchemaError, match="9 rows, one a frame"):
            run.extension(TRACKER, "matrix", frames=slice(0, 2))
        with pytest.raises(MissingData, match="it is not in the file"):
            run.extension(TRACKER, "template")


def test_single_frames_and_a_number_a_frame(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_nodes(2, 2, unit="px")
        writer.declare_extension(TRACKER, "1.0")
        writer.declare_extension_series(TRACKER, "alive", (), dtype="i4")
        for i in range(4):
            writer.append(i, positions=np.full((2, 2), i), extensions={(TRACKER, "alive"): i - 2})
    with Trajectory(path) as run:
        np.testing.assert_array_equal(run.extension(TRACKER, "alive"), [-2, -1, 0, 1])


def test_file_is_valid(tracked):
    assert {finding.code for finding in validate_file(tracked).findings} == {"OPS-I04"}


@pytest.mark.parametrize(
    ("change", "code", "words"),
    [
        (lambda f: f[QUALITY].resize(7, axis=0), "OPS-X04", r"shape \(7, 2\)"),
        (lambda f: f[QUALITY].attrs.__setitem__(TIME_AXIS, 1), "OPS-X04", "time_axis is 1"),
        (lambda f: f[QUALITY].__setitem__((3, 0), np.inf), "OPS-N04", "infinite at frame 3"),
        (lambda f: f[SIGMA].__setitem__((3, 0, 0), 0.7), "OPS-V01", "the checksum of the values"),
        (lambda f: f[SIGMA].attrs.__setitem__("unit", "inch"), "OPS-L07", "unknown unit 'inch'"),
    ],
)
def test_validation_knows_series_of_extensions(tracked, change, code, words):
    with h5py.File(tracked, "r+") as file:
        change(file)
    found = [f for f in validate_file(tracked).findings if f.code == code]
    assert len(found) == 1
    assert found[0].path.startswith("/extensions/openprc-vision/")
    assert re.search(words, found[0].found)


def test_committed_frames_of_a_killed_run_are_kept(tmp_path):
    writer = TrajectoryWriter(tmp_path / "run.h5", provenance=Provenance("test"))
    declare(writer)
    time, rest = frames(0, 6)
    writer.append(time, **rest)
    writer.commit()
    writer._file.close()  # as a kill does, without close()
    with h5py.File(writer.partial, "r+") as file:  # rows of a block that was never committed
        for name in ("time_series/time", QUALITY, SIGMA):
            file[name].resize(8, axis=0)
    with Trajectory(writer.partial, allow_incomplete=True) as run:
        assert run.extension(TRACKER, "quality").shape == (6, 2)
    path = repair(writer.partial)
    with Trajectory(path) as run:
        np.testing.assert_array_equal(
            run.extension(TRACKER, "sigma"), rest["extensions"][TRACKER, "sigma"]
        )
        np.testing.assert_array_equal(run.extension(TRACKER, "matrix"), np.eye(3))
    with h5py.File(path) as file:
        assert file[STATUS].attrs[TIME_AXIS] == 0
        assert CHECKSUM in file[SIGMA].attrs
    assert validate_file(path).ok


def _attach(source, target):
    return attach_input(
        source, target, name="drive", signal=np.arange(9.0), unit="V", quantity="voltage"
    )


def _migrate(source, target):
    with h5py.File(source, "r+") as file:
        file.attrs["openprc_schema"] = "0.9"
    return migrate(source, target, steps={0: lambda file: None})


@pytest.mark.parametrize("derive", [pack, _attach, _migrate], ids=["pack", "attach", "migrate"])
def test_copies_keep_the_series(tracked, tmp_path, derive):
    with Trajectory(tracked) as run:
        wanted = run.extension(TRACKER, "sigma")
    path = derive(tracked, tmp_path / "copy.h5")
    with Trajectory(path) as run:
        np.testing.assert_array_equal(run.extension(TRACKER, "sigma"), wanted)
        np.testing.assert_array_equal(
            run.extension(TRACKER, "sigma", frames=slice(4, 6)), wanted[4:6]
        )
    assert validate_file(path).ok


def test_exported_arrays_hold_the_series(tracked, tmp_path):
    path = tmp_path / "run.npz"
    with Trajectory(tracked) as run:
        assert run.extension_series(TRACKER) == ("quality", "sigma", "status")
        assert run.extension_series("other") == ()
        NpzExporter().export(run, path, options={"stride": 2})
        with np.load(path) as arrays:
            np.testing.assert_array_equal(
                arrays[f"extensions/{TRACKER}/sigma"], run.extension(TRACKER, "sigma")[::2]
            )
            units = json.loads(str(arrays["metadata"]))["units"]
            assert units[f"extensions/{TRACKER}/sigma"] == "mm"
            assert f"extensions/{TRACKER}/matrix" not in arrays


def test_digest_sees_a_change_of_a_series(tracked):
    with Trajectory(tracked) as run:
        before = run.content_digest()
    with h5py.File(tracked, "r+") as file:
        file[SIGMA][0, 0, 0] = 0.123
    with Trajectory(tracked) as run:
        assert run.content_digest() != before


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda w: w.declare_extension_series("other", "q", (2,)), SchemaError, "not declared"),
        (lambda w: w.declare_extension_series(TRACKER, "a/b", (2,)), SchemaError, "the name 'a/b'"),
        (lambda w: w.declare_extension_series(TRACKER, "q", (0,)), SchemaError, r"shape \(0,\)"),
        (lambda w: w.declare_extension_series(TRACKER, "q", (2,), dtype="c16"), SchemaError,
         "dtype 'c16'"),
        (lambda w: w.declare_extension_series(TRACKER, "q", (2,), unit="inch"), UnitError, "inch"),
        (lambda w: w.declare_extension_series(TRACKER, "sigma", (2,)), SchemaError, "twice"),
        (lambda w: w.declare_extension_series(TRACKER, "matrix", (2,)), SchemaError, "twice"),
        (lambda w: w.put_extension(TRACKER, "sigma", np.eye(2)), SchemaError, "twice"),
    ],
)  # fmt: skip
def test_wrong_declarations_are_refused(tmp_path, call, error, words):
    writer = TrajectoryWriter(tmp_path / "run.h5", provenance=Provenance("test"))
    declare(writer)
    with pytest.raises(error, match=words):
        call(writer)


def test_no_series_after_the_first_frame(tmp_path):
    writer = TrajectoryWriter(tmp_path / "run.h5", provenance=Provenance("test"))
    declare(writer)
    time, rest = frames(0, 2)
    writer.append(time, **rest)
    with pytest.raises(SchemaError, match=r"declare_extension_series\(\) after the first append"):
        writer.declare_extension_series(TRACKER, "late", (2,))


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("quality", None, "declared, but not given at frame 2: /extensions/openprc-vision/quality"),
        ("extra", np.zeros((2, 2)), "given, but not declared"),
        ("quality", np.zeros((2, 3)), r"the shape is \(2, 3\)"),
        ("quality", np.full((2, 2), np.inf), "infinite at frame 2"),
        ("status", np.full((2, 2), 0.5), "no small whole numbers"),
        ("status", np.full((2, 2), 300), "no small whole numbers"),
    ],
)
def test_wrong_blocks_are_refused_and_leave_nothing(tmp_path, name, value, words):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        declare(writer)
        time, rest = frames(0, 2)
        writer.append(time, **rest)
        time, rest = frames(2, 4)
        wrong = dict(rest["extensions"])
        if value is None:
            del wrong[TRACKER, name]
        else:
            wrong[TRACKER, name] = value
        with pytest.raises(SchemaError, match=words):
            writer.append(time, **{**rest, "extensions": wrong})
    with Trajectory(path) as run:
        assert (run.n_frames, len(run.extension(TRACKER, "quality"))) == (2, 2)
