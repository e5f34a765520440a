"""Everything that declarations and append() refuse, with the words."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import SchemaError, UnitError
from openprc.schema import Provenance, TrajectoryWriter, validate_file

EYE = np.eye(2)


@pytest.fixture
def writer(tmp_path):
    return TrajectoryWriter(tmp_path / "run.h5", provenance=Provenance("test"))


DECLARATIONS = {
    "time: unknown unit": (lambda w: w.declare_time(unit="fortnight"), "unknown unit 'fortnight'"),
    "time: kind": (lambda w: w.declare_time(kind="dream"), "kind 'dream'"),
    "time: pseudo in s": (lambda w: w.declare_time(kind="pseudo"), "pseudo time in 's'"),
    "time: physical in 1": (lambda w: w.declare_time(unit="1"), "physical time in '1'"),
    "time: length": (lambda w: w.declare_time(unit="m"), "physical time in 'm'"),
    "dims 1": (lambda w: w.declare_nodes(2, 1, unit="m"), "1 dimensions"),
    "dims 4": (lambda w: w.declare_nodes(2, 4, unit="m"), "4 dimensions"),
    "no node": (lambda w: w.declare_nodes(0, 3, unit="m"), "0 nodes"),
    "half a node": (lambda w: w.declare_nodes(2.5, 3, unit="m"), "2.5 nodes"),
    "unit": (lambda w: w.declare_nodes(2, 3, unit="inch"), "unknown unit 'inch'"),
    "unit of mass": (lambda w: w.declare_nodes(2, 3, unit="kg"), "'kg', a unit of mass"),
    "dtype": (lambda w: w.declare_nodes(2, 3, unit="m", dtype="i4"), "dtype 'i4'"),
    "axes: number": (lambda w: w.declare_nodes(2, 3, unit="m", axes="x,y"), "3 different names"),
    "axes: twice": (lambda w: w.declare_nodes(2, 2, unit="m", axes="x,x"), "2 different names"),
    "frame": (lambda w: w.declare_nodes(2, 2, unit="m", frame="a\0"), "NUL character"),
    "velocity of 1": (
        lambda w: w.declare_nodes(2, 2, unit="1", velocities=True),
        "no unit of velocity belongs to '1'",
    ),
    "velocity in m": (
        lambda w: w.declare_nodes(2, 2, unit="m", velocities=True, velocity_unit="m"),
        "'m', a unit of length",
    ),
    "rest: shape": (lambda w: w.declare_nodes(2, 2, unit="m", rest=np.eye(3)), r"shape \(3, 3\)"),
    "rest: NaN": (
        lambda w: w.declare_nodes(2, 2, unit="m", rest=EYE * np.nan),
        "NaN or infinite",
    ),
    "mass: shape": (lambda w: w.declare_nodes(2, 2, unit="m", mass=[1]), r"shape \(1,\)"),
    "mass: negative": (lambda w: w.declare_nodes(2, 2, unit="m", mass=[1, -1]), "negative mass"),
    "mass: text": (lambda w: w.declare_nodes(2, 2, unit="m", mass=["a", "b"]), "not real numbers"),
    "mass: ragged": (lambda w: w.declare_nodes(2, 2, unit="m", mass=[[1], []]), "not real"),
    "mass: unit": (
        lambda w: w.declare_nodes(2, 2, unit="m", mass=[1, 2], mass_unit="m"),
        "'m', a unit of length",
    ),
    "fixed: shape": (lambda w: w.declare_nodes(2, 2, unit="m", fixed=[True]), r"shape \(1,\)"),
    "ids: twice": (lambda w: w.declare_nodes(2, 2, unit="m", ids=[4, 4]), "4 twice"),
    "ids: floats": (lambda w: w.declare_nodes(2, 2, unit="m", ids=[1.2, 1.4]), "ids of type"),
    "labels: twice": (lambda w: w.declare_nodes(2, 2, unit="m", labels=["a", "a"]), "'a' twice"),
    "labels: same text": (lambda w: w.declare_nodes(2, 2, unit="m", labels=[1, "1"]), "'1' twice"),
    "labels: number": (lambda w: w.declare_nodes(2, 2, unit="m", labels=["a"]), r"shape \(1,\)"),
    "labels: NUL": (lambda w: w.declare_nodes(2, 2, unit="m", labels=["a\0", "b"]), "NUL"),
    "nodes twice": (
        lambda w: (w.declare_nodes(2, 2, unit="m"), w.declare_nodes(2, 2, unit="m")),
        "declared twice",
    ),
    "channel: name": (lambda w: w.declare_channel("a/b", ["x"], unit="V"), "the name 'a/b'"),
    "channel: empty name": (lambda w: w.declare_channel("", ["x"], unit="V"), "the name ''"),
    "channel: dots": (lambda w: w.declare_channel("..", ["x"], unit="V"), r"the name '\.\.'"),
    "channel: no column": (lambda w: w.declare_channel("a", [], unit="V"), "unique names"),
    "channel: text": (lambda w: w.declare_channel("a", "xy", unit="V"), "unique names"),
    "channel: twice": (lambda w: w.declare_channel("a", ["x", "x"], unit="V"), "unique names"),
    "channel: unnamed": (lambda w: w.declare_channel("a", ["x", ""], unit="V"), "unique names"),
    "channel: unit": (lambda w: w.declare_channel("a", ["x"], unit="volt"), "unknown unit 'volt'"),
    "system: unit": (lambda w: w.declare_system("work_in", unit="eV"), "unknown unit 'eV'"),
    "system: twice": (
        lambda w: (w.declare_system("work_in"), w.declare_system("work_in")),
        "declared twice",
    ),
    "input: unit": (
        lambda w: w.declare_input("u", ["x"], quantity="force", unit="lbf"),
        "unknown unit 'lbf'",
    ),
    "input: targets": (
        lambda w: w.declare_input("u", ["x"], quantity="force", unit="N", targets="node 3"),
        "targets 'node 3'",
    ),
    "extension: not declared": (
        lambda w: w.put_extension("openprc-x", "a", [1.0]),
        "not declared",
    ),
    "extension: version": (lambda w: w.declare_extension("openprc-x", ""), "no version"),
    "extension: name": (lambda w: w.declare_extension("a/b", "1"), "the name 'a/b'"),
}  # fmt: skip


@pytest.mark.parametrize("case", DECLARATIONS)
def test_wrong_declaration_is_refused(writer, case):
    call, words = DECLARATIONS[case]
    with pytest.raises(SchemaError, match=words) as caught:
        call(writer)
    assert caught.value.expected
    assert caught.value.fix


ELEMENTS = {
    "shape": ([0, 1], {}, r"int64 of shape \(2,\)"),
    "floats": ([[0.0, 1.0]], {}, "float64 of shape"),
    "arity": ([[0, 1, 2]], {}, "3 nodes an element"),
    "range": ([[0, 3]], {}, "node 3"),
    "negative": ([[0, -1]], {}, "node -1"),
    "same node": ([[0, 1], [2, 2]], {}, r"element 1 is \[2, 2\]"),
    "unit": ([[0, 1]], {"series": {"length": "mile"}}, "unknown unit 'mile'"),
    "width of nothing": ([[0, 1]], {"widths": {"force": 2}}, "a width for 'force'"),
    "width 0": ([[0, 1]], {"series": {"f": "N"}, "widths": {"f": 0}}, "a width of 0"),
    "series name": ([[0, 1]], {"series": {"a/b": "N"}}, "the name 'a/b'"),
    "static length": ([[0, 1]], {"static": {"k": ([1.0, 2.0], "N/m")}}, r"shape \(2,\)"),
    "static shape": ([[0, 1]], {"static": {"k": ([[1.0, 2.0]], "N/m")}}, r"shape \(1, 2\)"),
    "static without unit": ([[0, 1]], {"static": {"k": ([1.0], None)}}, "no unit"),
    "static integer": ([[0, 1]], {"static": {"k": ([2**40], None)}}, "beyond 32 bits"),
    "static objects": ([[0, 1]], {"static": {"k": ([None], None)}}, "not real numbers"),
    "static takes indices": ([[0, 1]], {"static": {"indices": ([1], None)}}, "declared twice"),
}


@pytest.mark.parametrize("case", ELEMENTS)
def test_wrong_elements_are_refused(writer, case):
    indices, options, words = ELEMENTS[case]
    writer.declare_nodes(3, 3, unit="m")
    with pytest.raises(SchemaError, match=words):
        writer.declare_elements("bars", indices, **options)


@pytest.mark.parametrize(
    ("kind", "count"), [("bars", 3), ("bends", 4), ("faces", 4), ("hinges", 3)]
)
def test_kinds_of_the_contract_have_their_number_of_nodes(writer, kind, count):
    writer.declare_nodes(5, 3, unit="m")
    with pytest.raises(SchemaError, match=f"{count} nodes an element"):
        writer.declare_elements(kind, [list(range(count))])


def test_nodes_are_no_kind_of_element(writer):
    writer.declare_nodes(3, 3, unit="m")
    with pytest.raises(SchemaError, match="elements named 'nodes'"):
        writer.declare_elements("nodes", [[0, 1]])


def test_elements_need_nodes(writer):
    with pytest.raises(SchemaError, match=r"declare the nodes first"):
        writer.declare_elements("bars", [[0, 1]])


SEQUENCES = {
    "columns": ({"sequence": [[1.0, 2.0]], "hold": 1.0}, r"shape \(1, 2\)"),
    "empty": ({"sequence": np.zeros((0, 1)), "hold": 1.0}, r"shape \(0, 1\)"),
    "NaN": ({"sequence": [np.nan], "hold": 1.0}, "NaN or infinite symbols"),
    "text": ({"sequence": ["a"], "hold": 1.0}, "not real numbers"),
    "no hold": ({"sequence": [1.0]}, "hold None"),
    "hold 0": ({"sequence": [1.0], "hold": 0.0}, r"hold 0\.0"),
    "hold NaN": ({"sequence": [1.0], "hold": np.nan}, "hold nan"),
    "hold inf": ({"sequence": [1.0], "hold": np.inf}, "hold inf"),
    "start NaN": ({"sequence": [1.0], "hold": 1.0, "start": np.nan}, "start nan"),
}


@pytest.mark.parametrize("case", SEQUENCES)
def test_wrong_sequence_is_refused(writer, case):
    options, words = SEQUENCES[case]
    with pytest.raises(SchemaError, match=words):
        writer.declare_input("u", ["x"], quantity="force", unit="N", **options)


@pytest.mark.parametrize(
    "array",
    [np.array([None]), np.array(["2020-01-01"], "M8[D]"), np.array("scalar text")],
    ids=["objects", "dates", "scalar text"],
)
def test_extension_refuses_what_hdf5_cannot_hold(writer, array):
    writer.declare_extension("openprc-x", "1")
    with pytest.raises(SchemaError, match="numbers or text"):
        writer.put_extension("openprc-x", "a", array)


@pytest.mark.parametrize(
    "call",
    [
        lambda w: w.declare_time(),
        lambda w: w.declare_nodes(2, 2, unit="m"),
        lambda w: w.declare_elements("bars", [[0, 1]]),
        lambda w: w.declare_channel("a", ["x"], unit="V"),
        lambda w: w.declare_system("work_in"),
        lambda w: w.declare_input("u", ["x"], quantity="force", unit="N"),
        lambda w: w.declare_extension("openprc-x", "1"),
        lambda w: w.put_extension("openprc-x", "a", [1.0]),
    ],
)
def test_declaring_ends_with_the_first_frame(writer, call):
    writer.declare_nodes(2, 2, unit="m")
    writer.append(0.0, positions=EYE)
    with pytest.raises(SchemaError, match=r"\(\) after the first append\(\)"):
        call(writer)


def test_nothing_declared_is_refused(writer):
    with pytest.raises(SchemaError, match="neither nodes nor channels were declared"):
        writer.append(0.0)


@pytest.mark.parametrize(
    "what", ["system", "input"], ids=["a system quantity alone", "an input alone"]
)
def test_something_must_have_been_recorded(writer, what):
    if what == "system":
        writer.declare_system("work_in")
        given = {"system": {"work_in": 1.0}}
    else:
        writer.declare_input("u", ["x"], quantity="force", unit="N")
        given = {"inputs": {"u": [1.0]}}
    with pytest.raises(SchemaError, match="neither nodes nor channels"):
        writer.append(0.0, **given)


# --- frames -----------------------------------------------------------------------------------


def good():
    return {
        "positions": EYE, "velocities": EYE, "observed": [1, 1],
        "elements": {("bars", "length"): [1.0]}, "channels": {"gauge": [1.0, 2.0]},
        "system": {"work_in": 1.0}, "inputs": {"u": [1.0]},
    }  # fmt: skip


@pytest.fixture
def full(writer):
    writer.declare_nodes(2, 2, unit="m", velocities=True, observed=True)
    writer.declare_elements("bars", [[0, 1]], series={"length": "m"})
    writer.declare_channel("gauge", ["x", "y"], unit="V")
    writer.declare_system("work_in")
    writer.declare_input("u", ["x"], quantity="force", unit="N")
    writer.append(0.0, **good())
    return writer


NAN = np.array([[np.nan, np.nan], [0.0, 0.0]])
HALF_NAN = np.array([[np.nan, 1.0], [0.0, 0.0]])
FRAMES = {
    "time: backwards": ({"time": -1.0}, "time does not increase at frame 1: 0 is followed by -1"),
    "time: again": ({"time": 0.0}, "time does not increase at frame 1: 0 is followed by 0"),
    "time: NaN": ({"time": np.nan}, "time is nan at frame 1"),
    "time: inf": ({"time": np.inf}, "time is inf at frame 1"),
    "time: text": ({"time": "now"}, "not a real number array"),
    "time: complex": ({"time": 1j}, "not a real number array"),
    "time: table": ({"time": [[1.0]]}, r"time has shape \(1, 1\)"),
    "time: empty": ({"time": []}, r"time has shape \(0,\)"),
    "no positions": ({"positions": None}, "declared, but not given at frame 1: .*positions"),
    "no velocities": ({"velocities": None}, "declared, but not given.*velocities"),
    "no mask": ({"observed": None}, "declared, but not given.*observed"),
    "no elements": ({"elements": {}}, "declared, but not given.*bars/length"),
    "no channel": ({"channels": None}, "declared, but not given.*gauge"),
    "no system": ({"system": {}}, "declared, but not given.*work_in"),
    "no input": ({"inputs": {}}, "declared, but not given.*inputs/u/value"),
    "stray element": (
        {"elements": {("bars", "length"): [1.0], ("bars", "strain"): [1.0]}},
        "given, but not declared: .*bars/strain",
    ),
    "stray channel": (
        {"channels": {"gauge": [1.0, 2.0], "b": [1.0]}}, "given, but not declared: .*channels/b",
    ),
    "shape: nodes": ({"positions": np.eye(3)}, r"the shape is \(3, 3\)"),
    "shape: padded": ({"positions": np.zeros((2, 3))}, r"the shape is \(2, 3\)"),
    "shape: frames": ({"positions": np.zeros((2, 2, 2))}, r"the shape is \(2, 2, 2\)"),
    "shape: channel": ({"channels": {"gauge": [1.0]}}, r"the shape is \(1,\)"),
    "shape: system": ({"system": {"work_in": [1.0, 2.0]}}, r"the shape is \(2,\)"),
    "text": ({"positions": [["a", "b"], ["c", "d"]]}, "not a real number array"),
    "ragged": ({"positions": [[0.0], [0.0, 1.0]]}, "not a real number array"),
    "inf": ({"positions": EYE + np.inf}, "infinite at frame 1"),
    "inf velocity": ({"velocities": np.full((2, 2), -np.inf)}, "infinite at frame 1, node 0"),
    "inf channel": ({"channels": {"gauge": [1.0, np.inf]}}, "infinite at frame 1"),
    "NaN input": ({"inputs": {"u": [np.nan]}}, "NaN at frame 1"),
    "NaN system": ({"system": {"work_in": np.nan}}, "NaN at frame 1"),
    "NaN, mask says measured": ({"positions": NAN}, "NaN and the mask disagree at frame 1, node 0"),
    "NaN in one axis": (
        {"positions": HALF_NAN, "observed": [0, 1]}, "NaN and the mask disagree at frame 1, node 0",
    ),
    "missing, but there": ({"observed": [0, 1]}, "points marked missing have positions"),
    "missing elsewhere": ({"positions": NAN, "observed": [1, 0]}, "NaN and the mask disagree"),
    "mask: 3": ({"observed": [3, 1]}, "a code of 3"),
    "mask: 256": ({"observed": [256, 1]}, "no small whole numbers"),
    "mask: negative": ({"observed": [-1, 1]}, "no small whole numbers"),
    "mask: fraction": ({"observed": [0.5, 1]}, "no small whole numbers"),
    "mask: NaN": ({"observed": [np.nan, 1]}, "no small whole numbers"),
}  # fmt: skip


@pytest.mark.parametrize("case", FRAMES)
def test_wrong_frame_is_refused_and_nothing_of_it_kept(full, case):
    change, words = FRAMES[case]
    arguments = {"time": 1.0, **good(), **change}
    with pytest.raises(SchemaError, match=words) as caught:
        full.append(arguments.pop("time"), **arguments)
    assert caught.value.key
    assert full.n_frames == 1
    full.append(1.0, **good())
    full.close()
    assert validate_file(full.path).ok


def test_time_within_a_block_must_increase(full):
    block = {
        key: {k: np.repeat(np.asarray(v)[None], 3, 0) for k, v in value.items()}
        if isinstance(value, dict)
        else np.repeat(np.asarray(value)[None], 3, 0)
        for key, value in good().items()
    }
    with pytest.raises(SchemaError, match=r"at frame 3: 0\.5 is followed by 0\.4"):
        full.append([0.25, 0.5, 0.4], **block)


def test_nan_without_a_mask_is_refused(writer):
    writer.declare_nodes(2, 2, unit="m")
    with pytest.raises(SchemaError, match=r"NaN at frame 0, node 0[\s\S]*observed=True"):
        writer.append(0.0, positions=NAN)


def test_number_too_large_for_f4_is_refused(writer):
    writer.declare_nodes(2, 2, unit="m", dtype="f4")
    with pytest.raises(SchemaError, match="infinite at frame 0, node 0"):
        writer.append(0.0, positions=EYE * 1e300)


def test_gaps_in_a_channel_are_kept_as_nan(writer):
    writer.declare_channel("gauge", ["x"], unit="V")
    writer.append([0.0, 1.0], channels={"gauge": [[1.0], [np.nan]]})
    writer.close()
    report = validate_file(writer.path)
    assert report.ok
    assert "OPS-C01" in {finding.code for finding in report.findings}


def test_unit_errors_are_unit_errors(writer):
    with pytest.raises(UnitError, match="expected: one of 1 arb s"):
        writer.declare_channel("gauge", ["x"], unit="furlong")
