"""Files in the way of a writer, and writers in the way of each other."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from openprc.errors import ResultExists, UnreadableFile
from openprc.schema import Provenance, Trajectory, TrajectoryWriter

EYE = np.eye(2)


def begin(path, **options):
    writer = TrajectoryWriter(path, provenance=Provenance("test"), **options)
    writer.declare_nodes(2, 2, unit="m")
    return writer


# --- files in the way -------------------------------------------------------------------------


def test_finished_file_is_refused_and_untouched(small):
    before = small.read_bytes()
    with pytest.raises(ResultExists, match=r"finished file of this name[\s\S]*overwrite=True"):
        begin(small)
    assert small.read_bytes() == before
    assert list(small.parent.iterdir()) == [small]


def test_overwrite_replaces_only_on_success(small):
    before = small.read_bytes()
    failing = begin(small, overwrite=True, on_failure="discard")
    with pytest.raises(RuntimeError), failing as writer:  # noqa: PT012
        writer.append(0.0, positions=EYE)
        raise RuntimeError
    assert small.read_bytes() == before
    with begin(small, overwrite=True) as writer:
        writer.append(0.0, positions=EYE)
        writer.append(1.0, positions=EYE)
        assert small.read_bytes() == before
    with Trajectory(small) as trajectory:
        assert trajectory.n_frames == 2


def test_leftover_of_a_dead_run_is_refused_unless_overwritten(unfinished):
    partial = unfinished()
    path = partial.with_suffix("")
    before = partial.read_bytes()
    with pytest.raises(ResultExists, match=r"unfinished file[\s\S]*openprc repair"):
        begin(path)
    assert partial.read_bytes() == before
    with begin(path, overwrite=True) as writer:
        writer.append(0.0, positions=EYE)
    with Trajectory(path) as trajectory:
        assert trajectory.n_frames == 1


@pytest.mark.parametrize("overwrite", [False, True])
def test_second_writer_of_this_process_is_refused(tmp_path, overwrite):
    with begin(tmp_path / "run.h5") as first:
        first.append(0.0, positions=EYE)
        with pytest.raises(ResultExists, match="unfinished file of this name is in the way"):
            begin(tmp_path / "run.h5", overwrite=overwrite)
        first.append(1.0, positions=EYE)
    with Trajectory(tmp_path / "run.h5") as trajectory:
        assert trajectory.n_frames == 2


@pytest.mark.parametrize("overwrite", [False, True])
def test_second_writer_of_another_process_is_refused(tmp_path, overwrite):
    code = (
        "import sys\nfrom openprc.schema import Provenance, TrajectoryWriter\n"
        "from openprc.errors import ResultExists\n"
        "try:\n    TrajectoryWriter(sys.argv[1], provenance=Provenance('x'), "
        f"overwrite={overwrite})\n"
        "except ResultExists as error:\n    print(error.found)\n"
    )
    with begin(tmp_path / "run.h5") as first:
        first.append(0.0, positions=EYE)
        done = subprocess.run(
            [sys.executable, "-c", code, str(tmp_path / "run.h5")],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        assert "unfinished file of this name is in the way" in done.stdout
        first.append(1.0, positions=EYE)
    assert (tmp_path / "run.h5").exists()


def test_writer_that_was_dropped_does_not_block_the_name(tmp_path):
    begin(tmp_path / "run.h5")
    with begin(tmp_path / "run.h5", overwrite=True) as writer:
        writer.append(0.0, positions=EYE)
    assert (tmp_path / "run.h5").exists()


def test_file_that_appeared_meanwhile_is_not_replaced(tmp_path):
    path = tmp_path / "run.h5"
    with pytest.raises(ResultExists, match="finished file"), begin(path) as writer:  # noqa: PT012
        writer.append(0.0, positions=EYE)
        path.write_text("somebody was faster")
    assert path.read_text() == "somebody was faster"
    assert writer.partial.exists()


def test_directory_as_a_name_is_refused(tmp_path):
    with pytest.raises(UnreadableFile, match="this is a directory"):
        begin(tmp_path)
