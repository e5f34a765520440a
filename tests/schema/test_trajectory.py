"""Reading: what is there comes back as written, what is not is named."""

from __future__ import annotations

import hashlib

import h5py
import numpy as np
import pytest

from openprc.errors import (
    MissingData,
    MissingInputError,
    SchemaError,
    UnitError,
)
from openprc.schema import Provenance, Trajectory, TrajectoryWriter, validate_file


@pytest.fixture
def trajectory(complete):
    with Trajectory(complete) as opened:
        yield opened


@pytest.fixture
def bare(tmp_path):
    """A file with one channel and nothing else."""
    path = tmp_path / "bare.h5"
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_channel("voltage", ["a"], unit="mV")
        writer.append(np.arange(5) * 0.5, channels={"voltage": np.arange(5.0)[:, None]})
    with Trajectory(path) as opened:
        yield opened


# --- everything comes back --------------------------------------------------------------------


def test_every_array_comes_back(trajectory, frames_of):
    known = frames_of()
    assert (trajectory.n_frames, trajectory.n_nodes, trajectory.dims) == (12, 4, 3)
    assert (trajectory.kind, trajectory.status) == ("trajectory", "complete")
    for found, wanted in [
        (trajectory.time, known["time"]),
        (trajectory.positions(), known["positions"]),
        (trajectory.velocities(), known["velocities"]),
        (trajectory.observed(), known["observed"]),
        (trajectory.element("bars", "length"), known["elements"]["bars", "length"]),
        (trajectory.element("bars", "end_forces"), known["elements"]["bars", "end_forces"]),
        (trajectory.element("hinges", "angle"), known["elements"]["hinges", "angle"]),
        (trajectory.channel("strain"), known["channels"]["strain"]),
        (trajectory.system("kinetic_energy"), known["system"]["kinetic_energy"]),
        (trajectory.input("drive").value, known["inputs"]["drive"]),
    ]:
        np.testing.assert_array_equal(found, wanted)
        assert found.dtype == wanted.dtype
    assert trajectory.observed()[3, 1] == 0
    assert np.isnan(trajectory.positions()[3, 1]).all()


def test_names_and_constants_come_back(trajectory):
    assert trajectory.element_kinds == ("bars", "hinges")
    assert trajectory.element_series("bars") == ("end_forces", "length")
    assert trajectory.element_series("faces") == ()
    assert trajectory.indices("bars").tolist() == [[0, 1], [1, 2], [2, 3]]
    assert trajectory.indices("hinges").dtype == np.int32
    assert trajectory.element_static("bars", "stiffness").tolist() == [100.0, 200.0, 300.0]
    assert trajectory.element_static("bars", "stiffness", unit="N/mm").tolist() == [0.1, 0.2, 0.3]
    assert trajectory.element_static("bars", "material").tolist() == ["p", "q", "r"]
    assert trajectory.element_static("bars", "group").dtype == np.int32
    assert (trajectory.channels, trajectory.channel_columns("strain")) == (
        ("strain",), ("top", "bottom"),
    )  # fmt: skip
    assert trajectory.systems == ("kinetic_energy",)
    assert trajectory.node("label").tolist() == ["a", "b", "c", "d é"]
    assert trajectory.node("id").tolist() == [10, 20, 30, 40]
    assert trajectory.node("fixed").tolist() == [1, 0, 0, 0]
    assert trajectory.node("mass").tolist() == [0.1, 0.2, 0.3, 0.4]
    assert trajectory.node("rest").shape == (4, 3)
    assert trajectory.has("/extensions/openprc-test/camera")
    assert not trajectory.has("/extensions/other")


def test_input_comes_back(trajectory):
    signal = trajectory.input()
    assert signal.name == "drive"
    assert (signal.columns, signal.unit, signal.quantity) == (("u",), "N", "force")
    assert (signal.targets, signal.hold, signal.start) == (("a",), 0.4, 0.0)
    assert signal.sequence.tolist() == [[0.5], [-0.25], [1.0]]


@pytest.mark.parametrize(
    "frames", [slice(3, 7), slice(None, None, 5), slice(-2, None), slice(20, 30), slice(0, 0)]
)
def test_slices_of_frames(trajectory, frames_of, frames):
    known = frames_of()
    np.testing.assert_array_equal(trajectory.positions(frames), known["positions"][frames])
    np.testing.assert_array_equal(trajectory.observed(frames), known["observed"][frames])
    np.testing.assert_array_equal(
        trajectory.channel("strain", frames=frames), known["channels"]["strain"][frames]
    )


def test_a_series_is_read_in_ranges(trajectory, frames_of):
    known = frames_of()["positions"]
    series = trajectory.series("/time_series/nodes/positions")
    for frames in (slice(0, 5), slice(5, 12), slice(-2, None), slice(None, None, 5), slice(20, 30)):
        np.testing.assert_array_equal(series.read(frames), known[frames])
    np.testing.assert_array_equal(series.read(), known)
    with pytest.raises(MissingData, match=r"a step of -1 frames\n.*a step of 1 or more"):
        series.read(slice(None, None, -1))
    with pytest.raises(MissingData, match="/time_series/nodes/accelerations"):
        trajectory.series("/time_series/nodes/accelerations")


def test_a_series_ends_with_the_committed_frames(complete):
    with h5py.File(complete, "r+") as file:
        file["committed"][...] = 7
        file.attrs["status"] = "running"
    with Trajectory(complete, allow_incomplete=True) as trajectory:
        series = trajectory.series("/time_series/nodes/positions")
        assert series.read().shape == (7, 4, 3)
        assert series.read(slice(5, 12)).shape == (2, 4, 3)


def test_a_series_that_is_too_short_is_refused(complete):
    with h5py.File(complete, "r+") as file:
        rows = file["time_series/nodes/velocities"]
        attrs, short = dict(rows.attrs), rows[:5]
        del file["time_series/nodes/velocities"]
        file["time_series/nodes/velocities"] = short
        file["time_series/nodes/velocities"].attrs.update(attrs)
    with (
        Trajectory(complete) as trajectory,
        pytest.raises(SchemaError, match=r"shape \(5, 4, 3\)\n.*12 rows, one a frame"),
    ):
        trajectory.series("/time_series/nodes/velocities")


def test_axes_and_frame_of_reference(trajectory, bare):
    assert (trajectory.axes, trajectory.frame) == (("x", "y", "z"), "world")
    with pytest.raises(MissingData, match="/time_series/nodes/positions"):
        assert bare.axes
    with pytest.raises(MissingData, match="/time_series/nodes/positions"):
        assert bare.frame


def test_nodes_in_any_order(trajectory, frames_of):
    known = frames_of()["positions"]
    np.testing.assert_array_equal(trajectory.positions(nodes=[3, 0, 3]), known[:, [3, 0, 3]])
    assert trajectory.positions(slice(2, 4), [1]).shape == (2, 1, 3)
    assert trajectory.positions(nodes=[]).shape == (12, 0, 3)


def test_channels_without_nodes(bare):
    assert (bare.dims, bare.n_nodes, bare.element_kinds, bare.inputs) == (0, 0, (), ())
    assert bare.channel("voltage", unit="V")[4, 0] == pytest.approx(4e-3, rel=1e-15)


def test_planar_nodes_have_two_columns(small):
    with Trajectory(small) as trajectory:
        assert (trajectory.dims, trajectory.positions().shape) == (2, (3, 2, 2))


def test_f4_is_read_as_f8(tmp_path):
    path = tmp_path / "f4.h5"
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_nodes(1, 2, unit="px", dtype="f4", velocities=True)
        writer.append(0.0, positions=[[0.1, 0.2]], velocities=[[0.3, 0.4]])
    with Trajectory(path) as trajectory, h5py.File(path) as file:
        assert file["time_series/nodes/positions"].dtype == np.float32
        assert trajectory.positions().dtype == np.float64
        assert trajectory.positions()[0, 0, 0] == np.float32(0.1)
        assert file["time_series/nodes/velocities"].attrs["unit"] == "px/s"


# --- units ------------------------------------------------------------------------------------


def test_units_are_converted_on_demand(trajectory, frames_of):
    known = frames_of()
    assert trajectory.position_unit == "m"
    np.testing.assert_allclose(trajectory.positions(unit="mm"), known["positions"] * 1e3)
    np.testing.assert_allclose(trajectory.velocities(unit="mm/s"), known["velocities"] * 1e3)
    np.testing.assert_allclose(
        trajectory.element("hinges", "angle", unit="deg"),
        np.degrees(known["elements"]["hinges", "angle"]),
    )
    np.testing.assert_allclose(
        trajectory.system("kinetic_energy", unit="mJ"), known["system"]["kinetic_energy"] * 1e3
    )


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda t: t.positions(unit="kg"), "cannot convert 'm' .* to 'kg'"),
        (lambda t: t.positions(unit="px"), "cannot convert 'm' .* to 'px'"),
        (lambda t: t.positions(unit="inch"), "unknown unit 'inch'"),
        (lambda t: t.channel("strain", unit="m"), "cannot convert '1'"),
    ],
)
def test_units_that_do_not_fit_are_refused(trajectory, call, words):
    with pytest.raises(UnitError, match=words) as caught:
        call(trajectory)
    assert caught.value.file == str(trajectory.path)
    assert caught.value.key.startswith("/time_series/")


# --- what is absent ---------------------------------------------------------------------------

ABSENT = {
    "positions": (lambda t: t.positions(), "/time_series/nodes/positions: it is not in the file"),
    "velocities": (lambda t: t.velocities(), "velocities: it is not in the file"),
    "observed": (lambda t: t.observed(), "observed: it is not in the file"),
    "position unit": (lambda t: t.position_unit, "positions: it is not in the file"),
    "indices": (lambda t: t.indices("bars"), "/topology/bars/indices: it is not in the file"),
    "element": (lambda t: t.element("bars", "length"), "bars/length: it is not in the file"),
    "static": (lambda t: t.element_static("bars", "stiffness"), "bars/stiffness"),
    "channel": (lambda t: t.channel("current"), r"current: it is not[\s\S]*one of voltage"),
    "columns": (lambda t: t.channel_columns("current"), "it is not in the file"),
    "system": (lambda t: t.system("work_in"), "work_in: it is not in the file"),
    "label": (lambda t: t.node("label"), "/topology/nodes/label: it is not in the file"),
}


@pytest.mark.parametrize("case", ABSENT)
def test_absent_data_are_named_and_not_made_up(bare, case):
    call, words = ABSENT[case]
    with pytest.raises(MissingData, match=words) as caught:
        call(bare)
    assert caught.value.fix


@pytest.mark.parametrize(
    ("nodes", "words"),
    [
        ([4], "there is no node 4"),
        ([-1], "there is no node -1"),
        ([0.5], "nodes of type float64"),
        ([True, False, True, False], r"nodes of type bool[\s\S]*flatnonzero"),
        (["a"], "nodes of type"),
    ],
)
def test_nodes_that_are_not_there(trajectory, nodes, words):
    with pytest.raises(MissingData, match=words):
        trajectory.positions(nodes=nodes)


def test_negative_step_is_refused(trajectory):
    with pytest.raises(MissingData, match=r"a step of 1 or more"):
        trajectory.positions(slice(None, None, -1))


def test_no_input_says_how_to_add_one(bare):
    with pytest.raises(MissingInputError, match=r"what drove the body[\s\S]*attach-input"):
        bare.input()
    with pytest.raises(MissingInputError, match="what drove the body"):
        bare.input("drive")


def test_wrong_name_of_an_input(trajectory):
    with pytest.raises(MissingInputError, match=r"no input 'wind'[\s\S]*one of drive"):
        trajectory.input("wind")


def test_several_inputs_have_to_be_named(tmp_path):
    path = tmp_path / "two.h5"
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_channel("a", ["a"], unit="V")
        for name in ("left", "right"):
            writer.declare_input(name, ["u"], quantity="voltage", unit="V")
        writer.append(0.0, channels={"a": [1.0]}, inputs={"left": [1.0], "right": [2.0]})
    with Trajectory(path) as trajectory:
        assert trajectory.input("right").value.tolist() == [[2.0]]
        assert trajectory.input("right").sequence is None
        with pytest.raises(MissingInputError, match=r"several inputs.*\n.*left, right"):
            trajectory.input()


# --- digests ------------------------------------------------------------------------------------


def test_repeat_has_another_identity_and_the_same_digest(tmp_path, make_complete):
    a, b = make_complete(tmp_path / "a.h5"), make_complete(tmp_path / "b.h5")
    with Trajectory(a) as first, Trajectory(b) as second:
        assert first.run_id != second.run_id
        assert first.content_digest() == second.content_digest()


@pytest.mark.parametrize(
    "change",
    [
        lambda f: f["time_series/nodes/positions"].__setitem__((0, 0, 0), 5.0),
        lambda f: f["time_series/nodes/positions"].attrs.update(unit="mm"),
        lambda f: f["topology/nodes/label"].__setitem__(0, "z"),
        lambda f: f["extensions/openprc-test/camera"].__setitem__((0, 1), 1.0),
        lambda f: f["inputs/drive/sequence"].attrs.update(start=0.1),
        lambda f: f.move("time_series/system/kinetic_energy", "time_series/system/work_in"),
    ],
)
def test_digest_sees_every_change(complete, edit, change):
    with Trajectory(complete) as trajectory:
        before = trajectory.content_digest()
    with edit(complete) as file:
        change(file)
    with Trajectory(complete) as trajectory:
        assert trajectory.content_digest() != before


def test_reading_leaves_the_file_alone(complete):
    before = hashlib.sha256(complete.read_bytes()).hexdigest()
    with Trajectory(complete) as trajectory:
        trajectory.positions()
        trajectory.content_digest()
    validate_file(complete)
    assert hashlib.sha256(complete.read_bytes()).hexdigest() == before


def test_repr_says_what_it_is(trajectory):
    assert repr(trajectory) == "<Trajectory complete.h5: 12 frames, 4 nodes, 3 dimensions>"
