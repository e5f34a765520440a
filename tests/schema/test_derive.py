"""Files made from finished ones: the source stays as it is, the parent is named."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from openprc.errors import (
    ConfigError,
    IncompleteFile,
    ResultExists,
    SchemaError,
    UnitError,
    UnreadableFile,
)
from openprc.schema import Provenance, Trajectory, TrajectoryWriter, validate_file
from openprc.schema.derive import attach_input, pack, repair

FORCE = {"unit": "N", "quantity": "force"}


@pytest.fixture
def plain(make_small):
    """Twelve frames, 0.1 s apart, no input."""
    return make_small("plain.h5", np.arange(12) * 0.1)


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out" / "new.h5"


def no_leftovers(*folders):
    for folder in folders:
        if folder.exists():
            names = [item.name for item in folder.iterdir()]
            assert not [name for name in names if name.startswith(".") or "raw" in name], names


# --- inputs ---------------------------------------------------------------------------------------


def test_attached_symbols_are_held(plain, out):
    before = plain.read_bytes()
    attach_input(plain, out, name="drive", signal=[1.0, 2.0, 3.0, 4.0], hold=0.3, **FORCE)
    assert plain.read_bytes() == before
    with Trajectory(plain) as old, Trajectory(out) as new:
        signal = new.input()
        assert signal.value.ravel().tolist() == [1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4]
        assert signal.sequence.ravel().tolist() == [1, 2, 3, 4]
        assert (signal.hold, signal.start, signal.columns) == (0.3, 0.0, ("drive",))
        assert (signal.unit, signal.quantity, signal.targets) == ("N", "force", ())
        assert new.run_id != old.run_id
        assert new.provenance["parents"] == [old.run_id]
        assert new.provenance["producer"] == "test"
        np.testing.assert_array_equal(new.positions(), old.positions())
    assert validate_file(out, profile="benchmark").at_least("warning") == ()


def test_attached_values_of_every_frame(plain, out, tmp_path):
    table = np.arange(24.0).reshape(12, 2)
    source = tmp_path / "signal.csv"
    source.write_text("the signal")
    attach_input(
        plain, out, name="drive", signal=table, targets=["a", "b"], signal_file=source, **FORCE
    )
    with Trajectory(out) as trajectory:
        signal = trajectory.input()
        np.testing.assert_array_equal(signal.value, table)
        assert (signal.columns, signal.targets) == (("drive0", "drive1"), ("a", "b"))
        assert (signal.sequence, signal.hold) == (None, None)
        (row,) = trajectory.provenance["inputs"]
        assert (row["role"], row["name"], row["bytes"]) == ("signal", "signal.csv", 10)
    assert validate_file(out, profile="archive").at_least("error") == ()


def test_second_input_and_generations(plain, out, tmp_path):
    attach_input(plain, out, name="left", signal=np.arange(12.0), **FORCE)
    attach_input(out, tmp_path / "third.h5", name="right", signal=np.arange(12.0), **FORCE)
    with (
        Trajectory(plain) as a,
        Trajectory(out) as b,
        Trajectory(tmp_path / "third.h5") as c,
    ):
        assert c.inputs == ("left", "right")
        assert c.provenance["parents"] == [b.run_id, a.run_id]


def test_signal_that_starts_earlier(plain, out):
    attach_input(plain, out, name="u", signal=[9.0, 1.0, 2.0], hold=1.0, start=-0.5, **FORCE)
    with Trajectory(out) as trajectory:
        assert trajectory.input().value.ravel().tolist() == [9.0] * 5 + [1.0] * 7


WRONG = {
    "NaN": ({"signal": [1.0, np.nan]}, ConfigError, "holds NaN"),
    "empty": ({"signal": []}, ConfigError, r"shape \(0,\)"),
    "cube": ({"signal": np.ones((2, 2, 2))}, ConfigError, r"shape \(2, 2, 2\)"),
    "length": ({"signal": np.ones(11)}, ConfigError, r"11 values, the file 12 frames[\s\S]*--hold"),
    "hold 0": ({"hold": 0.0}, ConfigError, r"hold is 0\.0"),
    "hold negative": ({"hold": -1.0}, ConfigError, r"hold is -1\.0"),
    "hold NaN": ({"hold": np.nan}, ConfigError, "hold is nan"),
    "hold inf": ({"hold": np.inf}, ConfigError, "hold is inf"),
    "start NaN": ({"hold": 0.3, "start": np.nan}, ConfigError, "start is nan"),
    "too short": ({"hold": 0.1, "signal": [1.0, 2.0]}, ConfigError, r"covers 0 to 0\.2"),
    "too late": ({"hold": 1.0, "start": 0.5}, ConfigError, r"covers 0\.5 to"),
    "unit": ({"unit": "lbf"}, UnitError, "unknown unit 'lbf'"),
    "name": ({"name": "a/b"}, ConfigError, "the name 'a/b'"),
    "no name": ({"name": ""}, ConfigError, "the name ''"),
    "columns": ({"columns": ["a", "b"]}, ConfigError, r"columns \['a', 'b'\] for a signal of 1"),
    "double": ({"signal": np.ones((12, 2)), "columns": ["a", "a"]}, ConfigError, "for a signal"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_signal_is_refused_and_nothing_written(plain, out, case):
    change, error, words = WRONG[case]
    arguments = {"name": "drive", "signal": np.arange(12.0), **FORCE, **change}
    with pytest.raises(error, match=words):
        attach_input(plain, out, **arguments)
    assert not out.exists()
    no_leftovers(out.parent, plain.parent)


def test_input_that_is_there_is_not_replaced(complete, out):
    with pytest.raises(ConfigError, match=r"an input 'drive' already"):
        attach_input(complete, out, name="drive", signal=np.arange(12.0), **FORCE)


@pytest.mark.parametrize("make", [
    lambda s, t, **k: attach_input(s, t, name="u", signal=np.arange(12.0), **FORCE, **k), pack,
])  # fmt: skip
def test_existing_target_is_refused_and_replaced_on_demand(plain, make_small, make):
    target = make_small("taken.h5")
    before = target.read_bytes()
    with pytest.raises(ResultExists, match="finished file of this name"):
        make(plain, target)
    assert target.read_bytes() == before
    make(plain, target, overwrite=True)
    with Trajectory(target) as trajectory:
        assert trajectory.n_frames == 12
    with pytest.raises(ResultExists):
        make(plain, plain)
    no_leftovers(plain.parent)


@pytest.mark.parametrize("make", [
    lambda s, t: attach_input(s, t, name="u", signal=np.arange(12.0), **FORCE), pack,
])  # fmt: skip
def test_unfinished_source_is_refused(unfinished, out, make):
    partial = unfinished()
    with pytest.raises(IncompleteFile, match="openprc repair"):
        make(partial, out)
    assert not out.exists()


# --- packing --------------------------------------------------------------------------------------


def test_packed_file_is_smaller_and_says_the_same(tmp_path, out):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_nodes(50, 3, unit="m", rest=np.zeros((50, 3)))
        writer.declare_channel("slow", ["a"], unit="V")
        for i in range(200):
            writer.append(i, positions=np.full((50, 3), i // 10), channels={"slow": [0.5]})
    before = path.read_bytes()
    pack(path, out)
    assert path.read_bytes() == before
    assert out.stat().st_size < 0.2 * len(before)
    with Trajectory(path) as a, Trajectory(out) as b:
        assert a.content_digest() == b.content_digest()
        assert b.provenance["parents"] == [a.run_id]
    with h5py.File(out) as file:
        assert file["time_series/nodes/positions"].compression == "gzip"
        assert file["time_series/nodes/positions"].fletcher32
    assert validate_file(out).ok
    no_leftovers(out.parent)


def test_complete_file_survives_packing(complete, out):
    pack(complete, out)
    for profile in ("default", "benchmark", "archive"):
        assert validate_file(out, profile=profile).findings == ()


def test_packed_copy_that_differs_is_not_kept(complete, out, monkeypatch):
    digests = iter(["one", "two"])
    monkeypatch.setattr(Trajectory, "content_digest", lambda self: next(digests))
    with pytest.raises(SchemaError, match="the packed copy differs from the original"):
        pack(complete, out)
    assert not out.exists()
    no_leftovers(out.parent)


# --- repair ---------------------------------------------------------------------------------------


def test_repair_keeps_what_was_committed(unfinished, frames_of):
    partial = unfinished(committed=8, lost=4)
    before = partial.read_bytes()
    saved = repair(partial)
    assert saved == partial.with_suffix("")
    assert partial.read_bytes() == before
    report = validate_file(saved)
    assert report.ok
    assert [f.code for f in report.findings] == ["OPS-R06"]
    known = frames_of(0, 8)
    with Trajectory(saved) as trajectory:
        assert (trajectory.status, trajectory.n_frames) == ("interrupted", 8)
        assert (trajectory.uniform, trajectory.dt) == (True, 0.1)
        np.testing.assert_array_equal(trajectory.positions(), known["positions"])
        np.testing.assert_array_equal(trajectory.input().value, known["inputs"]["drive"])
        np.testing.assert_array_equal(
            trajectory.element("bars", "end_forces"), known["elements"]["bars", "end_forces"]
        )
        assert trajectory.input().sequence.shape == (3, 1)


def test_repaired_file_can_be_used_like_a_finished_one(unfinished, out, tmp_path):
    saved = repair(unfinished())
    pack(saved, out)
    attach_input(saved, tmp_path / "c.h5", name="u", signal=np.arange(8.0), **FORCE)
    assert validate_file(out).ok
    assert validate_file(tmp_path / "c.h5").ok


def test_repair_to_another_name(unfinished, out):
    assert repair(unfinished(), out) == out
    assert validate_file(out).ok


def test_run_killed_between_its_last_frame_and_its_name_is_complete(tmp_path, make_small):
    path = make_small("run.h5")
    partial = path.rename(tmp_path / "run.h5.partial")
    saved = repair(partial)
    with Trajectory(saved) as trajectory:
        assert (trajectory.status, trajectory.n_frames) == ("complete", 3)
    assert validate_file(saved).ok


def test_complete_file_needs_no_repair(small):
    with pytest.raises(IncompleteFile, match="this file is complete"):
        repair(small)


def test_run_without_a_committed_frame_cannot_be_saved(unfinished, edit):
    partial = unfinished()
    with edit(partial) as file:
        file["committed"][()] = 0
    with pytest.raises(IncompleteFile, match="no frame was committed"):
        repair(partial)


def test_repair_does_not_replace_a_finished_file(unfinished, make_small):
    partial = unfinished("small.h5")
    finished = make_small("other.h5").rename(partial.with_suffix(""))
    before = finished.read_bytes()
    with pytest.raises(ResultExists):
        repair(partial)
    assert finished.read_bytes() == before


def test_repair_of_nothing(tmp_path):
    with pytest.raises(UnreadableFile, match="does not exist"):
        repair(tmp_path / "gone.h5.partial")
