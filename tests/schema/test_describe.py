"""The outline that `openprc info` prints."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest

from openprc.errors import UnreadableFile, UnsafeFile
from openprc.schema import Provenance, TrajectoryWriter
from openprc.schema.describe import describe
from openprc.schema.results import write_result


def test_complete_trajectory(complete, frames_of):
    found = describe(complete)
    json.dumps(found, allow_nan=False)
    assert found["kind"] == "trajectory"
    assert (found["n_frames"], found["n_nodes"], found["dims"]) == (12, 4, 3)
    assert found["time"] == {
        "kind": "physical", "unit": "s", "start": 0.0, "end": frames_of()["time"][-1],
        "uniform": True, "dt": 0.1,
    }  # fmt: skip
    assert found["elements"] == {
        "bars": {"count": 3, "series": ["end_forces", "length"]},
        "hinges": {"count": 1, "series": ["angle"]},
    }
    assert found["channels"] == {"strain": ["top", "bottom"]}
    assert found["system"] == ["kinetic_energy"]
    assert found["inputs"]["drive"] == {
        "quantity": "force", "unit": "N", "columns": ["u"], "targets": ["a"],
        "symbols": 3, "hold": 0.4, "start": 0.0,
    }  # fmt: skip
    positions = frames_of()["positions"]
    assert found["positions"]["unit"] == "m"
    assert found["positions"]["missing"] == 1
    span = np.nanmax(positions, axis=(0, 1)) - np.nanmin(positions, axis=(0, 1))
    assert found["positions"]["extent"] == pytest.approx(list(span))
    assert found["positions"]["moving_nodes"] == 4


def test_nodes_that_stand_still_are_not_counted_as_moving(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_nodes(3, 2, unit="m")
        for i in range(4):
            writer.append(i, positions=[[0, 0], [1, i], [2, 0]])
    assert describe(path)["positions"]["moving_nodes"] == 1


def test_channels_alone(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_channel("a", ["x"], unit="V")
        writer.append([0.0, 1.0, 5.0], channels={"a": [[1.0], [2.0], [3.0]]})
    found = describe(path)
    assert "positions" not in found
    assert found["time"]["uniform"] is False
    assert "dt" not in found["time"]


def test_nothing_was_ever_seen(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_nodes(1, 2, unit="px", observed=True)
        writer.append([0.0, 1.0], positions=np.full((2, 1, 2), np.nan), observed=np.zeros((2, 1)))
    found = describe(path)["positions"]
    assert found["missing"] == 2
    assert "extent" not in found


def test_unfinished_run(unfinished):
    found = describe(unfinished(committed=8))
    assert (found["status"], found["n_frames"]) == ("running", 8)
    assert found["time"]["uniform"] is False
    json.dumps(found, allow_nan=False)


def test_results(tmp_path):
    path = write_result(
        tmp_path / "m.h5", kind="metrics", attrs={"narma2/order": 2},
        arrays={"narma2/scores": np.ones((3, 2))}, provenance=Provenance("test"),
    )  # fmt: skip
    found = describe(path)
    json.dumps(found, allow_nan=False)
    assert found["kind"] == "metrics"
    assert found["attributes"] == {"narma2/order": 2}
    assert found["arrays"] == {"narma2/scores": [3, 2]}


def test_foreign_hdf5_is_outlined(tmp_path):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["data/table"] = np.ones((3, 2))
        file.attrs["program"] = "another"
    found = describe(tmp_path / "x.h5")
    assert "openprc import" in found["kind"]
    assert found["attributes"] == {"program": "another"}
    assert list(found["datasets"]) == ["data/table"]
    assert "(3, 2)" in found["datasets"]["data/table"]


def test_what_cannot_be_opened(tmp_path):
    with pytest.raises(UnreadableFile, match="does not exist"):
        describe(tmp_path / "gone.h5")
    (tmp_path / "text.h5").write_text("text")
    with pytest.raises(UnreadableFile, match="this is not HDF5"):
        describe(tmp_path / "text.h5")
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["out"] = h5py.ExternalLink("y.h5", "/")
    with pytest.raises(UnsafeFile, match="external link"):
        describe(tmp_path / "x.h5")
