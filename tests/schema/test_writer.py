"""The life of a file: partial, finished, failed; and how frames get into it."""

from __future__ import annotations

import json
import re

import h5py
import numpy as np
import pytest

from openprc.errors import IncompleteFile, SchemaError, UnreadableFile
from openprc.schema import Provenance, Trajectory, TrajectoryWriter, streams, validate_file

EYE = np.eye(2)


def begin(path, **options):
    writer = TrajectoryWriter(path, provenance=Provenance("test"), **options)
    writer.declare_nodes(2, 2, unit="m")
    return writer


# --- from the first frame to the final name ---------------------------------------------------


def test_file_has_its_name_only_once_it_is_complete(tmp_path):
    path = tmp_path / "deep" / "run.h5"
    writer = begin(path)
    assert writer.partial == tmp_path / "deep" / "run.h5.partial"
    assert writer.partial.exists()
    writer.append(0.0, positions=EYE)
    writer.append(0.1, positions=EYE + 1)
    writer.commit()
    assert not path.exists()
    writer.close()
    writer.close()
    assert path.exists()
    assert not writer.partial.exists()
    assert validate_file(path).ok


def test_single_frames_and_blocks_give_the_same_content(
    tmp_path, make_complete, frames_of, declare_everything, monkeypatch
):
    whole = make_complete(tmp_path / "whole.h5")
    single = tmp_path / "single.h5"
    monkeypatch.setattr(streams, "BLOCK_BYTES", 1)
    with TrajectoryWriter(single, provenance=Provenance("test")) as writer:
        declare_everything(writer)
        for i in range(12):
            frames = frames_of(i, i + 1)
            one = {
                key: {k: v[0] for k, v in value.items()} if isinstance(value, dict) else value[0]
                for key, value in frames.items()
            }
            writer.append(float(one.pop("time")), **one)
            assert writer.n_frames == i + 1
    with Trajectory(whole) as a, Trajectory(single) as b:
        assert a.content_digest() == b.content_digest()
        np.testing.assert_array_equal(a.positions(), b.positions())


def test_caller_may_reuse_its_buffer(tmp_path):
    buffer = np.zeros((2, 2))
    with begin(tmp_path / "run.h5") as writer:
        for i in range(5):
            buffer[:] = i
            writer.append(i, positions=buffer)
    with Trajectory(tmp_path / "run.h5") as trajectory:
        np.testing.assert_array_equal(trajectory.positions()[:, 0, 0], np.arange(5.0))


def test_chunks_hold_many_frames_of_every_node(tmp_path):
    path = tmp_path / "run.h5"
    with begin(path) as writer:
        for i in range(3):
            writer.append([2.0 * i, 2.0 * i + 1], positions=np.stack([EYE, EYE]) + i)
            writer.commit()
    with h5py.File(path) as file:
        positions = file["time_series/nodes/positions"]
        frames, nodes, dims = positions.chunks
        assert (nodes, dims) == (2, 2)
        assert frames * 32 > 100_000
        assert frames * 32 <= streams.CHUNK_BYTES
        assert positions.compression is None


def test_a_run_that_fits_in_one_block_wastes_no_chunk(small):
    with h5py.File(small) as file:
        assert file["time_series/nodes/positions"].chunks == (3, 2, 2)
    assert small.stat().st_size < 40_000


def test_block_goes_to_disk_when_it_is_full_or_late(tmp_path, monkeypatch):
    writer = begin(tmp_path / "run.h5")
    writer.append(0.0, positions=EYE)
    assert writer._live[1].committed == 0
    monkeypatch.setattr(streams, "BLOCK_SECONDS", -1.0)
    writer.append(1.0, positions=EYE)
    assert writer._live[1].committed == 2
    monkeypatch.setattr(streams, "BLOCK_SECONDS", 1e9)
    writer.append(2.0, positions=EYE)
    assert writer._live[1].committed == 2
    monkeypatch.setattr(streams, "BLOCK_BYTES", 50)
    writer.append(3.0, positions=EYE)
    assert writer._live[1].committed == 4
    writer.close()


# --- runs that do not finish ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "status"),
    [(RuntimeError("boom"), "failed"), (KeyboardInterrupt(), "interrupted"),
     (SystemExit(3), "failed")],
)  # fmt: skip
def test_exception_keeps_the_frames_and_says_how_it_ended(tmp_path, error, status):
    path = tmp_path / "run.h5"
    with pytest.raises(type(error)), begin(path) as writer:  # noqa: PT012
        writer.append([0.0, 1.0], positions=np.stack([EYE, EYE]))
        raise error
    assert not path.exists()
    with pytest.raises(IncompleteFile, match=f"status is '{status}': 2 frames are safe"):
        Trajectory(writer.partial)
    with Trajectory(writer.partial, allow_incomplete=True) as trajectory:
        assert trajectory.status == status
        np.testing.assert_array_equal(trajectory.positions(), np.stack([EYE, EYE]))


def test_missing_file_points_at_the_partial_one(tmp_path):
    with pytest.raises(RuntimeError), begin(tmp_path / "run.h5") as writer:  # noqa: PT012
        writer.append(0.0, positions=EYE)
        raise RuntimeError
    with pytest.raises(UnreadableFile, match=r"run\.h5\.partial is there.*openprc repair"):
        Trajectory(tmp_path / "run.h5")


@pytest.mark.parametrize("frames", [0, 1])
def test_discard_leaves_nothing(tmp_path, frames):
    with pytest.raises(RuntimeError), begin(tmp_path / "run.h5", on_failure="discard") as writer:  # noqa: PT012
        for i in range(frames):
            writer.append(i, positions=EYE)
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def test_no_frame_no_file(tmp_path):
    with (
        pytest.raises(SchemaError, match="no frame was appended"),
        begin(tmp_path / "run.h5"),
    ):
        pass
    assert list(tmp_path.iterdir()) == []


def test_wrong_block_leaves_the_frames_before_it(tmp_path):
    with begin(tmp_path / "run.h5") as writer:
        writer.append([0.0, 1.0], positions=np.stack([EYE, EYE]))
        bad = np.stack([EYE, EYE])
        bad[1, 1, 0] = np.inf
        with pytest.raises(SchemaError, match=r"infinite at frame 3, node 1"):
            writer.append([2.0, 3.0], positions=bad)
        assert writer.n_frames == 2
        writer.append(2.0, positions=EYE * 5)
    with Trajectory(tmp_path / "run.h5") as trajectory:
        np.testing.assert_array_equal(trajectory.time, [0.0, 1.0, 2.0])


@pytest.mark.parametrize("at", range(6))
@pytest.mark.parametrize("kind", [KeyboardInterrupt, OSError])
def test_interruption_within_a_commit_loses_and_repeats_nothing(
    tmp_path, monkeypatch, frames_of, declare_everything, at, kind
):
    calls = {"left": at}
    original = h5py.Dataset.__setitem__

    def break_off(self, *arguments):
        if self.name.startswith(("/time_series", "/inputs")) or self.name == "/committed":
            calls["left"] -= 1
            if calls["left"] == -1:
                raise kind("broken off")
        original(self, *arguments)

    writer = TrajectoryWriter(tmp_path / "run.h5", provenance=Provenance("test"))
    with pytest.raises(kind), writer:  # noqa: PT012
        declare_everything(writer)
        frames = frames_of(0, 6)
        writer.append(frames.pop("time"), **frames)
        writer.commit()
        frames = frames_of(6, 12)
        writer.append(frames.pop("time"), **frames)
        monkeypatch.setattr(h5py.Dataset, "__setitem__", break_off)
        writer.commit()
    monkeypatch.undo()
    with Trajectory(writer.partial, allow_incomplete=True) as trajectory:
        assert trajectory.status == ("interrupted" if kind is KeyboardInterrupt else "failed")
        assert trajectory.n_frames == 12
        np.testing.assert_array_equal(trajectory.positions(), frames_of()["positions"])


def test_interruption_while_copying_a_block_leaves_equal_lengths(
    tmp_path, monkeypatch, frames_of, declare_everything
):
    writer = TrajectoryWriter(tmp_path / "run.h5", provenance=Provenance("test"))
    original, calls = np.array, {"left": 4}

    def break_off(*arguments, **options):
        if "order" in options:
            calls["left"] -= 1
            if calls["left"] == 0:
                raise KeyboardInterrupt
        return original(*arguments, **options)

    with pytest.raises(KeyboardInterrupt), writer:  # noqa: PT012
        declare_everything(writer)
        frames = frames_of(0, 6)
        writer.append(frames.pop("time"), **frames)
        frames = frames_of(6, 12)
        monkeypatch.setattr(np, "array", break_off)
        writer.append(frames.pop("time"), **frames)
    monkeypatch.undo()
    with Trajectory(writer.partial, allow_incomplete=True) as trajectory:
        assert trajectory.n_frames == 6
        np.testing.assert_array_equal(trajectory.time, frames_of(0, 6)["time"])


def test_full_disk_still_closes_the_file_and_says_failed(tmp_path, monkeypatch):
    writer = begin(tmp_path / "run.h5")

    def full(self, *_, **__):
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"), writer:  # noqa: PT012
        writer.append(0.0, positions=EYE)
        writer.commit()
        writer.append(1.0, positions=EYE)
        monkeypatch.setattr(h5py.Dataset, "resize", full)
        writer.commit()
    monkeypatch.undo()
    with Trajectory(writer.partial, allow_incomplete=True) as trajectory:
        assert (trajectory.status, trajectory.n_frames) == ("failed", 1)


def test_ctrl_c_while_closing_is_an_interruption(tmp_path):
    def stop(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), begin(tmp_path / "run.h5", verify=stop) as writer:
        writer.append(0.0, positions=EYE)
    with Trajectory(writer.partial, allow_incomplete=True) as trajectory:
        assert trajectory.status == "interrupted"


# --- verification -----------------------------------------------------------------------------


def test_verify_sees_the_finished_file_before_it_has_its_name(tmp_path):
    seen = []

    def verify(path):
        with Trajectory(path) as trajectory:
            seen.append((path.name, trajectory.status, trajectory.n_frames))
        assert not (tmp_path / "run.h5").exists()

    with begin(tmp_path / "run.h5", verify=verify) as writer:
        writer.append(0.0, positions=EYE)
    assert seen == [("run.h5.partial", "complete", 1)]


@pytest.mark.parametrize("on_failure", ["keep", "discard"])
def test_what_verify_raises_keeps_the_name_free(tmp_path, on_failure):
    def verify(_):
        raise SchemaError("differs from the source")

    with (
        pytest.raises(SchemaError, match="differs from the source"),
        begin(tmp_path / "run.h5", verify=verify, on_failure=on_failure) as writer,
    ):
        writer.append(0.0, positions=EYE)
    assert not (tmp_path / "run.h5").exists()
    assert writer.partial.exists() == (on_failure == "keep")
    if on_failure == "keep":
        with Trajectory(writer.partial, allow_incomplete=True) as trajectory:
            assert trajectory.status == "failed"


def test_append_after_close_is_refused(tmp_path):
    writer = begin(tmp_path / "run.h5")
    writer.append(0.0, positions=EYE)
    writer.close()
    with pytest.raises(SchemaError, match=re.escape("append() after the file was closed")):
        writer.append(1.0, positions=EYE)
    writer.commit()
    with Trajectory(tmp_path / "run.h5") as trajectory:
        assert trajectory.n_frames == 1


# --- provenance -------------------------------------------------------------------------------


def test_provenance_is_read_back(complete):
    with Trajectory(complete) as trajectory:
        found = trajectory.provenance
    wanted = {
        "producer": "test", "producer_version": "3.1", "plugin": "openprc",
        "plugin_version": "0.1", "command": "make it", "seed": 7, "deterministic": 1,
        "config": {"a": [1.5, None], "b": 2}, "notes": ["one remark"], "parents": [],
    }  # fmt: skip
    assert {key: found[key] for key in wanted} == wanted
    assert found["python"].count(".") == 2
    (source,) = found["inputs"]
    assert (source["role"], source["name"], source["bytes"]) == ("source", "source.txt", 21)
    assert len(source["sha256"]) == 64
    json.dumps(found, allow_nan=False)


def test_no_path_of_this_machine_is_stored(complete, tmp_path):
    assert str(tmp_path).encode() not in complete.read_bytes()


def test_folder_is_hashed_as_a_whole_and_names_are_made_storable(tmp_path, make_small):
    folder = tmp_path / "run folder"
    folder.mkdir()
    (folder / "a.txt").write_text("abc")
    (folder / "b.txt").write_text("de")
    odd = tmp_path / "back\\slash"
    odd.write_text("x")
    path = tmp_path / "run.h5"
    with begin(path) as writer:
        writer.add_source(folder, role="experiment")
        writer.add_source(odd)
        writer.append([0.0, 1.0], positions=np.stack([EYE, EYE]))
    with Trajectory(path) as trajectory:
        rows = trajectory.provenance["inputs"]
    assert [(r["role"], r["name"], r["bytes"]) for r in rows] == [
        ("experiment", "run folder", 5),
        ("source", "back_slash", 1),
    ]
    assert validate_file(path, profile="archive").at_least("error") == ()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda w: w.add_source("nowhere.bin"), "source does not exist"),
        (lambda w: w.note("a\0b"), "NUL character"),
    ],
)
def test_wrong_remark_or_source_is_refused(tmp_path, make, words):
    with pytest.raises((SchemaError, UnreadableFile), match=words):
        make(begin(tmp_path / "run.h5"))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"provenance": Provenance("a\0b")}, "NUL character"),
        ({"provenance": Provenance("x", command="\ud800")}, "UTF-8 does not have"),
        ({"provenance": Provenance("x", config={"a": float("nan")})}, "cannot be stored as JSON"),
        ({"provenance": Provenance("x", config={"a": 1, 2: 3})}, "cannot be stored as JSON"),
        ({"provenance": Provenance("x"), "title": "a\0"}, "NUL character"),
        ({"provenance": Provenance("x"), "comment": "\udfff"}, "UTF-8 does not have"),
    ],
)
def test_what_cannot_be_stored_is_refused_before_anything_is_left(tmp_path, options, words):
    with pytest.raises(SchemaError, match=words):
        TrajectoryWriter(tmp_path / "run.h5", **options)
    assert list(tmp_path.iterdir()) == []


def test_empty_title_is_absent(tmp_path):
    with begin(tmp_path / "run.h5", title="", comment="") as writer:
        writer.append(0.0, positions=EYE)
    with h5py.File(tmp_path / "run.h5") as file:
        assert "title" not in file.attrs
        assert "comment" not in file.attrs
