"""Every check is tripped by one change of a good file, and the good file trips none."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest

from openprc.errors import SchemaError
from openprc.schema import Finding, Provenance, TrajectoryWriter, validate_file
from openprc.schema.layout import CHECKSUM
from openprc.schema.validate import CHECKS, OPENING, PROFILES, all_checks, check

POSITIONS = "time_series/nodes/positions"
TIME = "time_series/time"


def replace(file, path, data, **options):
    """Put other data in place of a dataset, keeping its attributes but the checksum."""
    attrs = dict(file[path].attrs)
    attrs.pop(CHECKSUM, None)
    del file[path]
    new = file.create_dataset(path, data=data, **options)
    for key, value in attrs.items():
        new.attrs[key] = value
    return new


def put(path, index, value):
    def change(file):
        item = file[path]
        item[index] = value
        item.attrs.pop(CHECKSUM, None)

    return change


def attr(path, **values):
    return lambda file: file[path].attrs.update(values)


def drop_attr(path, name):
    return lambda file: file[path].attrs.pop(name)


def drop(path):
    return lambda file: file.__delitem__(path)


def sources(**row):
    def change(file):
        table = file["provenance/inputs"][()]
        for name, value in row.items():
            table[name] = value
        replace(file, "provenance/inputs", table, dtype=table.dtype)

    return change


def only_frame(file):
    for path in [TIME, POSITIONS, "time_series/nodes/velocities", "time_series/nodes/observed",
                 "time_series/elements/bars/length", "time_series/elements/bars/end_forces",
                 "time_series/elements/hinges/angle", "time_series/channels/strain",
                 "time_series/system/kinetic_energy", "inputs/drive/value"]:  # fmt: skip
        replace(file, path, file[path][:1])
    file["committed"][()] = 1
    file[TIME].attrs["uniform"] = 0


def no_recording(file):
    del file["time_series/nodes"]
    del file["time_series/channels"]
    file.attrs["dims"] = 0


def no_mask(file):
    del file["time_series/nodes/observed"]


#: code: (change of the good file, profile, part of the path, words in what was found)
MUTATIONS = {
    "OPS-R01": (drop_attr("/", "created"), "default", "/", "created is missing"),
    "OPS-R02": (attr("/", status="done"), "default", "/", "status is 'done'"),
    "OPS-R03": (attr("/", kind="readout"), "default", "/", "holds readout"),
    "OPS-R04": (attr("/", run_id="run 7"), "default", "/", "run_id is 'run 7'"),
    "OPS-R05": (attr("/", status="running"), "default", "/", "status is 'running'"),
    "OPS-R06": (attr("/", status="interrupted"), "default", "/", "was interrupted"),
    "OPS-R07": (attr("/", dims=2), "default", "/", "2"),
    "OPS-R08": (lambda f: f.create_group("results"), "default", "/results", "not part"),
    "OPS-R09": (put("committed", (), 11), "default", "/committed", "11 rows are committed"),
    "OPS-P01": (drop_attr("provenance", "python"), "default", "/provenance", "python is missing"),
    "OPS-P02": (sources(name=b"home/me/a.txt"), "default", "/provenance/inputs", "a path"),
    "OPS-X01": (drop_attr("extensions/openprc-test", "version"), "default",
                "/extensions/openprc-test", "version is missing"),
    "OPS-X04": (attr("extensions/openprc-test/camera", time_axis=0), "default",
                "/extensions/openprc-test/camera", "shape (3, 3)"),
    "OPS-L01": (drop("provenance/inputs"), "default", "/provenance/inputs", "missing"),
    "OPS-L02": (lambda f: f.create_dataset("time_series/extra", data=1.0), "default",
                "/time_series/extra", "not part"),
    "OPS-L03": (lambda f: replace(f, "topology/nodes/mass", np.ones(3)), "default",
                "/topology/nodes/mass", "N is 3"),
    "OPS-L04": (lambda f: replace(f, "topology/nodes/fixed", np.ones(4)), "default",
                "/topology/nodes/fixed", "type f8"),
    "OPS-L05": (drop_attr(POSITIONS, "frame"), "default", "/" + POSITIONS, "frame is missing"),
    "OPS-L06": (attr(POSITIONS, axes=["x", "y", "y"]), "default", "/" + POSITIONS, "axes"),
    "OPS-L07": (attr("time_series/channels/strain", unit="inch"), "default",
                "/time_series/channels/strain", "unknown unit 'inch'"),
    "OPS-L08": (attr(POSITIONS, si_factor=2.0), "default", "/" + POSITIONS, "si_factor 2.0"),
    "OPS-L09": (attr("topology/nodes/mass", unit="m"), "default", "/topology/nodes/mass",
                "a unit of length"),
    "OPS-L10": (no_recording, "default", "/time_series", "neither positions nor channels"),
    "OPS-L11": (drop("topology/hinges/indices"), "default", "/topology/hinges/indices",
                "no indices for hinges"),
    "OPS-T01": (put(TIME, 4, np.nan), "default", "/" + TIME, "nan at frame 4"),
    "OPS-T02": (put(TIME, 4, 0.0), "default", "/" + TIME, "frame 3 is at"),
    "OPS-T03": (put(TIME, 4, 0.401), "default", "/" + TIME, "away from t0"),
    "OPS-T04": (attr(TIME, uniform=0), "default", "/" + TIME, "0.1 apart"),
    "OPS-T05": (attr(TIME, unit="m"), "default", "/" + TIME, "physical time in 'm'"),
    "OPS-T06": (only_frame, "default", "/" + TIME, "a single frame"),
    "OPS-N01": (no_mask, "default", "/" + POSITIONS, "3 NaN"),
    "OPS-N02": (put(POSITIONS, (7, 2, 1), np.nan), "default", "/time_series/nodes/observed",
                "frame 7, node 2"),
    "OPS-N03": (put("time_series/nodes/observed", (1, 1), 3), "default",
                "/time_series/nodes/observed", "a code of 3"),
    "OPS-N04": (put(POSITIONS, (7, 2, 1), np.inf), "default", "/" + POSITIONS,
                "infinite at frame 7"),
    "OPS-N05": (lambda f: replace(f, POSITIONS, f[POSITIONS][()] * [1, 1, 0.0]), "default",
                "/" + POSITIONS, "axis 2 is 0 everywhere"),
    "OPS-N06": (put("topology/nodes/label", 1, "a"), "default", "/topology/nodes/label",
                "'a' twice"),
    "OPS-N07": (put("topology/nodes/mass", 1, -1.0), "default", "/topology/nodes/mass",
                "negative"),
    "OPS-N08": (put(POSITIONS, (7, 2, 1), 1e9), "default", "/" + POSITIONS, "covers 1e+09 later"),
    "OPS-V01": (lambda f: f[POSITIONS].__setitem__((7, 2, 1), 0.5), "default", "/" + POSITIONS,
                "the checksum of the values is"),
    "OPS-E01": (put("topology/bars/indices", (0, 1), 4), "default", "/topology/bars/indices",
                "node 4"),
    "OPS-E02": (put("topology/bars/indices", (0, 1), 0), "default", "/topology/bars/indices",
                "element 0 is [0, 0]"),
    "OPS-E03": (put("topology/bars/indices", 1, [1, 0]), "default", "/topology/bars/indices",
                "1 duplicates"),
    "OPS-C01": (put("time_series/channels/strain", (2, 0), np.nan), "default",
                "/time_series/channels/strain", "1 NaN"),
    "OPS-I01": (put("inputs/drive/value", (2, 0), np.nan), "default", "/inputs/drive/value",
                "NaN or infinite"),
    "OPS-I02": (attr("inputs/drive/sequence", hold=0.0), "default", "/inputs/drive/sequence",
                "hold is 0.0"),
    "OPS-I03": (put("inputs/drive/value", Ellipsis, 0.5), "default", "/inputs/drive/value",
                "constant"),
    "OPS-I04": (drop("inputs"), "default", "/inputs", "no input"),
    "OPS-B01": (attr(TIME, uniform=0), "benchmark", "/" + TIME, "not evenly spaced"),
    "OPS-B02": (attr(TIME, kind="pseudo", unit="1"), "benchmark", "/" + TIME, "load steps"),
    "OPS-B03": (drop("inputs"), "benchmark", "/inputs", "no input"),
    "OPS-A01": (lambda f: replace(f, "provenance/inputs", f["provenance/inputs"][:0]), "archive",
                "/provenance/inputs", "no source is listed"),
    "OPS-A02": (attr("time_series/channels/strain", unit="arb", si_factor=np.nan), "archive",
                "/time_series/channels/strain", "arbitrary unit"),
    "OPS-A03": (attr("provenance", plugin_version="unknown"), "archive", "/provenance",
                "plugin_version is unknown"),
}  # fmt: skip


def with_external_link(file):
    file["extensions/other"] = h5py.ExternalLink("elsewhere.h5", "/data")


OPENED = {
    "OPS-F02": (with_external_link, "/extensions/other", "external link"),
    "OPS-F03": (attr("/", openprc_schema="2.0"), "openprc_schema", "schema 2.0"),
    "OPS-F04": (drop_attr("/", "openprc_schema"), "openprc_schema", "not a file of this contract"),
}


def test_table_of_changes_covers_every_code():
    assert set(MUTATIONS) == set(all_checks())
    assert set(OPENED) | {"OPS-F01", "OPS-F05", "OPS-F06"} == set(OPENING)


@pytest.mark.parametrize("profile", ["default", "benchmark", "archive"])
def test_good_file_trips_no_check(complete, profile):
    report = validate_file(complete, profile=profile)
    assert report.findings == ()
    assert report.ok
    assert report.profile == profile


@pytest.mark.parametrize("code", MUTATIONS)
def test_change_trips_its_check(complete, edit, code):
    change, profile, path, words = MUTATIONS[code]
    with edit(complete) as file:
        change(file)
    report = validate_file(complete, profile=profile)
    found = [finding for finding in report.findings if finding.code == code]
    assert found, [finding.code for finding in report.findings]
    assert path in {finding.path for finding in found}
    assert any(words in finding.found for finding in found), found
    for finding in report.findings:
        assert finding.code != "OPS-F05", finding
        assert finding.found
        assert finding.expected
        assert finding.fix
    assert found[0].level == all_checks()[code].level
    assert report.ok == (not any(f.level == "error" for f in report.findings))


@pytest.mark.parametrize("code", [c for c, (_, p, _, _) in MUTATIONS.items() if p != "default"])
def test_checks_of_a_profile_run_in_that_profile_only(complete, edit, code):
    change = MUTATIONS[code][0]
    with edit(complete) as file:
        change(file)
    assert code not in {finding.code for finding in validate_file(complete).findings}


@pytest.mark.parametrize("code", OPENED)
def test_file_that_cannot_be_opened_has_one_finding(complete, edit, code):
    change, path, words = OPENED[code]
    with edit(complete) as file:
        change(file)
    (finding,) = validate_file(complete).findings
    assert (finding.code, finding.level, finding.path) == (code, "error", path)
    assert words in finding.found


@pytest.mark.parametrize("content", [None, b"", b"not HDF5 at all"])
def test_unreadable_file_is_reported(tmp_path, content):
    path = tmp_path / "x.h5"
    if content is not None:
        path.write_bytes(content)
    report = validate_file(path)
    assert [finding.code for finding in report.findings] == ["OPS-F01"]
    assert not report.ok


@pytest.mark.parametrize("filters", [{"fletcher32": True}, {"compression": "gzip"}])
def test_flipped_bytes_in_a_chunk_are_found_by_hdf5(complete, edit, filters):
    with edit(complete) as file:
        data = np.random.default_rng(1).normal(size=(12, 2))
        item = replace(file, "time_series/channels/strain", data, chunks=(12, 2), **filters)
        chunk = item.id.get_chunk_info(0)
    raw = bytearray(complete.read_bytes())
    raw[chunk.byte_offset + chunk.size // 2] ^= 0xFF
    complete.write_bytes(raw)
    report = validate_file(complete)
    assert not report.ok
    assert "OPS-F05" in {finding.code for finding in report.findings}


@pytest.mark.parametrize("byte", [0, 7, 150])
def test_flipped_bytes_in_a_plain_chunk_are_found_by_the_checksum(complete, byte):
    with h5py.File(complete) as file:
        names = ["time_series/system/kinetic_energy", "inputs/drive/value", POSITIONS]
        offsets = {name: file[name].id.get_chunk_info(0) for name in names}
    whole = complete.read_bytes()
    for name, chunk in offsets.items():
        raw = bytearray(whole)
        raw[chunk.byte_offset + byte % chunk.size] ^= 0x10
        complete.write_bytes(raw)
        found = {(f.code, f.path) for f in validate_file(complete).findings}
        assert ("OPS-V01", f"/{name}") in found


def test_unknown_profile_is_refused(complete):
    with pytest.raises(SchemaError, match=r"profile 'strict'[\s\S]*benchmark"):
        validate_file(complete, profile="strict")


def test_report_as_json(complete, edit):
    with edit(complete) as file:
        file.attrs["dims"] = 2
        del file["inputs"]
        file["topology/bars/indices"][1] = [1, 0]
    report = validate_file(complete)
    plain = json.loads(json.dumps(report.as_dict(), allow_nan=False))
    assert plain["counts"] == {"error": 1, "warning": 1, "hint": 1}
    assert (plain["ok"], plain["profile"], plain["path"]) == (False, "default", str(complete))
    assert [f["code"] for f in plain["findings"]] == ["OPS-R07", "OPS-E03", "OPS-I04"]
    assert set(plain["findings"][0]) == {"code", "level", "path", "found", "expected", "fix"}
    assert [len(report.at_least(level)) for level in ("error", "warning", "hint")] == [1, 2, 3]


def test_codes_are_unique_and_well_formed():
    for code, item in all_checks().items():
        assert code == item.code
        assert len(code) == 7
        assert item.demand
        assert item.function.__doc__
    with pytest.raises(ValueError, match="two checks share the code OPS-R01"):
        check("OPS-R01", "error", "again")(lambda _: iter(()))
    assert set(CHECKS) == set(all_checks())


#: Attributes and datasets of a type that no writer of ours makes: a report, not a crash.
STRANGE = {
    "unit is a list": attr(POSITIONS, unit=["m", "mm"]),
    "unit is a number": attr(POSITIONS, unit=3),
    "unit is empty": attr(POSITIONS, unit=h5py.Empty("f8")),
    "kind is a list": attr("/", kind=["trajectory"]),
    "status is a table": attr("/", status=np.eye(2)),
    "dims is text": attr("/", dims="3"),
    "created is a number": attr("/", created=7.5),
    "created without a zone": attr("/", created="2024-01-01T00:00:00"),
    "uniform is text": attr(TIME, uniform="yes"),
    "dt is text": attr(TIME, dt="0.1"),
    "dt is 0": attr(TIME, dt=0.0),
    "dt is NaN": attr(TIME, dt=np.nan),
    "si_factor is text": attr(POSITIONS, si_factor="one"),
    "axes are one text": attr(POSITIONS, axes="xyz"),
    "axes are numbers": attr(POSITIONS, axes=[1, 2, 3]),
    "crc32 is text": attr(POSITIONS, crc32="abc"),
    "hold is text": attr("inputs/drive/sequence", hold="long"),
    "time is text": lambda f: replace(f, TIME, ["a"] * 12),
    "time is a table": lambda f: replace(f, TIME, np.ones((12, 2))),
    "time is a scalar": lambda f: replace(f, TIME, 1.0),
    "time is empty": lambda f: replace(f, TIME, np.zeros(0)),
    "positions are text": lambda f: replace(f, POSITIONS, [["a"]] * 12),
    "positions are integers": lambda f: replace(f, POSITIONS, np.ones((12, 4, 3), int)),
    "positions are flat": lambda f: replace(f, POSITIONS, np.ones((12, 4))),
    "positions are a scalar": lambda f: replace(f, POSITIONS, 1.0),
    "positions have no frame": lambda f: replace(f, POSITIONS, np.ones((0, 4, 3))),
    "positions have no node": lambda f: replace(f, POSITIONS, np.ones((12, 0, 3))),
    "positions have one axis": lambda f: replace(f, POSITIONS, np.ones((12, 4, 1))),
    "positions are null": lambda f: replace(f, POSITIONS, h5py.Empty("f8")),
    "mask is text": lambda f: replace(f, "time_series/nodes/observed", ["a"] * 12),
    "mask is short": lambda f: replace(f, "time_series/nodes/observed", np.ones((5, 4), "u1")),
    "mass is text": lambda f: replace(f, "topology/nodes/mass", ["a"] * 4),
    "indices are floats": lambda f: replace(f, "topology/bars/indices", np.eye(3)[:, :2]),
    "indices are flat": lambda f: replace(f, "topology/bars/indices", np.arange(3)),
    "input is flat": lambda f: replace(f, "inputs/drive/value", np.ones(12)),
    "input is text": lambda f: replace(f, "inputs/drive/value", [["a"]] * 12),
    "sequence is a scalar": lambda f: replace(f, "inputs/drive/sequence", 1.0),
    "committed is text": lambda f: replace(f, "committed", "all"),
    "committed is a list": lambda f: replace(f, "committed", [12]),
    "inputs is a dataset": lambda f: (drop("inputs")(f), f.create_dataset("inputs", data=1.0)),
    "topology is a dataset": lambda f: (
        drop("topology")(f), f.create_dataset("topology", data=[1.0, 2.0]),
    ),
    "time_series is a dataset": lambda f: (
        drop("time_series")(f), f.create_dataset("time_series", data="x"),
    ),
    "provenance is a dataset": lambda f: (
        drop("provenance")(f), f.create_dataset("provenance", data=1),
    ),
    "extensions is a dataset": lambda f: (
        drop("extensions")(f), f.create_dataset("extensions", data=[1]),
    ),
    "sources are numbers": lambda f: replace(f, "provenance/inputs", np.ones(3)),
    "sources are a scalar": lambda f: replace(f, "provenance/inputs", 1.0),
    "time is a group": lambda f: (drop(TIME)(f), f.create_group(TIME)),
}  # fmt: skip


@pytest.mark.parametrize("case", STRANGE)
def test_strange_types_are_reported_and_never_crash(complete, edit, case):
    with edit(complete) as file:
        STRANGE[case](file)
    for profile in PROFILES:
        report = validate_file(complete, profile=profile)
        assert report.at_least("warning")
        json.dumps(report.as_dict(), allow_nan=False)


def test_point_missing_in_the_first_frame_is_no_trouble(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, provenance=Provenance("vision")) as writer:
        writer.declare_nodes(3, 2, unit="px", observed=True)
        for i in range(4):
            positions = np.array([[0.0, 0.0], [1.0, i], [2.0, 2 * i]])
            observed = np.ones(3, int)
            if i < 2:
                positions[2], observed[2] = np.nan, 0
            writer.append(i, positions=positions, observed=observed)
    assert [f.code for f in validate_file(path).findings] == ["OPS-I04"]


def test_node_that_was_never_seen_is_no_trouble(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, provenance=Provenance("vision")) as writer:
        writer.declare_nodes(2, 3, unit="px", observed=True)
        for i in range(4):
            positions = np.array([[np.nan] * 3, [2.0 * i, i, -i]])
            writer.append(i, positions=positions, observed=[0, 1])
    assert [f.code for f in validate_file(path).findings] == ["OPS-I04"]


def test_findings_are_plain_values():
    finding = Finding("OPS-T01", "error", "/x", "a", "b", "c")
    assert finding.as_dict() == {
        "code": "OPS-T01", "level": "error", "path": "/x", "found": "a", "expected": "b",
        "fix": "c",
    }  # fmt: skip
