"""Opening files that are unfinished, foreign or damaged."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from openprc.errors import IncompleteFile, MissingData, SchemaError, UnreadableFile
from openprc.schema import Provenance, Trajectory, TrajectoryWriter


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        (lambda f: f.attrs.pop("openprc_schema"), SchemaError, "not a file of this contract"),
        (lambda f: f.attrs.update(kind="readout"), SchemaError, "holds kind 'readout'"),
        (lambda f: f.attrs.pop("kind"), SchemaError, "holds kind ''"),
        (lambda f: f.attrs.pop("run_id"), MissingData, "run_id: it is not in the file"),
        (lambda f: f.attrs.pop("dims"), MissingData, "dims: it is not in the file"),
        (lambda f: f.attrs.update(dims="three"), UnreadableFile, "the data cannot be read"),
        (lambda f: f.attrs.update(dims=[2, 3]), UnreadableFile, "the data cannot be read"),
        (lambda f: f.__delitem__("committed"), MissingData, "/committed: it is not in the file"),
        (lambda f: f.__delitem__("time_series/time"), MissingData, "time: it is not in the file"),
        (lambda f: f.attrs.update(status="running"), IncompleteFile, "status is 'running'"),
        (lambda f: f.attrs.update(status="failed"), IncompleteFile, "status is 'failed'"),
    ],
)
def test_what_is_no_finished_trajectory_is_refused(small, edit, change, error, words):
    with edit(small) as file:
        change(file)
    with pytest.raises(error, match=words):
        Trajectory(small)
    small.unlink()  # and it was closed, so this works everywhere


def test_run_without_a_frame(tmp_path):
    writer = TrajectoryWriter(tmp_path / "run.h5", provenance=Provenance("test"))
    writer.declare_nodes(2, 2, unit="m")
    writer._file.close()
    with pytest.raises(IncompleteFile, match="the run is running and holds no frame"):
        Trajectory(writer.partial, allow_incomplete=True)


def test_file_that_is_being_written_is_refused_elsewhere_and_survives(tmp_path):
    code = (
        "import sys\nfrom openprc.errors import UnreadableFile\n"
        "from openprc.schema import Trajectory\n"
        "try:\n    Trajectory(sys.argv[1], allow_incomplete=True)\n"
        "except UnreadableFile as error:\n    print(error.found)\n"
    )
    with TrajectoryWriter(tmp_path / "run.h5", provenance=Provenance("test")) as writer:
        writer.declare_nodes(2, 2, unit="m")
        writer.append(0.0, positions=np.eye(2))
        writer.commit()
        done = subprocess.run(
            [sys.executable, "-c", code, str(writer.partial)],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        assert done.stdout.strip() == "another process is writing this file"
        writer.append(1.0, positions=np.eye(2))
    with Trajectory(tmp_path / "run.h5") as trajectory:
        assert trajectory.n_frames == 2


def test_committed_frames_of_a_killed_run(unfinished, frames_of):
    partial = unfinished(committed=8, lost=4)
    with pytest.raises(IncompleteFile, match=r"8 frames are safe to read[\s\S]*openprc repair"):
        Trajectory(partial)
    with Trajectory(partial, allow_incomplete=True) as trajectory:
        assert trajectory.n_frames == 8
        np.testing.assert_array_equal(trajectory.positions(), frames_of(0, 8)["positions"])
        np.testing.assert_array_equal(trajectory.input().value, frames_of(0, 8)["inputs"]["drive"])
        assert len(trajectory.positions(slice(6, 12))) == 2


def test_damaged_data_say_so(complete, edit, tmp_path):
    with edit(complete) as file:
        data = file["time_series/nodes/positions"]
        del file["time_series/nodes/positions"]
        new = file.create_dataset(
            "time_series/nodes/positions", data=np.ones(data.shape), fletcher32=True
        )
        new.attrs.update(dict(data.attrs))
        offset = new.id.get_chunk_info(0).byte_offset
    raw = bytearray(complete.read_bytes())
    raw[offset + 100] ^= 0xFF
    complete.write_bytes(raw)
    with (
        Trajectory(complete) as trajectory,
        pytest.raises(UnreadableFile, match="the data cannot be read") as caught,
    ):
        trajectory.positions()
    assert caught.value.key == "/time_series/nodes/positions"
