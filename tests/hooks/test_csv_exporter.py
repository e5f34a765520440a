"""The CSV exporter: what goes out comes back, number for number."""

from __future__ import annotations

import hypothesis.extra.numpy as arrays
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from openprc_example import samples
from openprc_example.importer import CsvImporter

from openprc.errors import ConfigError, MissingData, ResultExists
from openprc.exporters.csv_table import CsvExporter
from openprc.hooks import export_file
from openprc.schema import Provenance, Trajectory, TrajectoryWriter

DEFAULTS = {"unit": None, "dt": None, "input": (), "hold": None}
ANY = st.floats(allow_nan=False, allow_infinity=False)
NAMES = st.from_regex(r"[A-Za-z][A-Za-z0-9_ ]{0,6}[A-Za-z0-9_]", fullmatch=True)


def import_csv(path, out, **options):
    with TrajectoryWriter(
        out, provenance=Provenance("csv"), on_failure="discard", overwrite=True
    ) as writer:
        CsvImporter().import_run(path, writer, options={**DEFAULTS, **options})


def round_trip(folder, **options):
    table = folder / "out.csv"
    table.unlink(missing_ok=True)
    with Trajectory(folder / "a.h5") as run:
        assert CsvExporter().export(run, table, options={}) == [table]
    import_csv(table, folder / "b.h5", **options)


def test_sample_comes_back_bit_for_bit(tmp_path):
    sample = samples.write_sample(tmp_path)
    import_csv(sample.path, tmp_path / "a.h5", **sample.options)
    round_trip(tmp_path, hold=samples.HOLD)
    with Trajectory(tmp_path / "a.h5") as a, Trajectory(tmp_path / "b.h5") as b:
        assert a.content_digest() == b.content_digest()


@st.composite
def runs(draw):
    """Draw (time, positions, observed, channel, drive, names) of a small run."""
    n_frames, n_nodes = draw(st.integers(1, 6)), draw(st.integers(1, 3))
    dims = draw(st.sampled_from([2, 3]))
    instants = st.floats(-1e150, 1e150)
    time = draw(arrays.arrays("f8", n_frames, elements=instants, unique=True))
    positions = draw(arrays.arrays("f8", (n_frames, n_nodes, dims), elements=ANY))
    observed = draw(arrays.arrays("u1", (n_frames, n_nodes), elements=st.integers(0, 2)))
    positions[observed == 0] = np.nan
    channel = draw(arrays.arrays("f8", (n_frames, 2), elements=ANY))
    drive = draw(arrays.arrays("f8", (n_frames, 1), elements=ANY))
    names = draw(st.lists(NAMES, min_size=3, max_size=3, unique=True))
    return np.sort(time), positions, observed, channel, drive, names


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(run=runs())
def test_any_run_comes_back(tmp_path, run):
    time, positions, observed, channel, drive, names = run
    if (np.diff(time) <= 0).any():  # 0.0 and -0.0 are two numbers and one time
        return
    gauge, column, motor = names
    with TrajectoryWriter(
        tmp_path / "a.h5", provenance=Provenance("test"), overwrite=True
    ) as writer:
        writer.declare_time(unit="ms")
        writer.declare_nodes(
            positions.shape[1], positions.shape[2], unit="um", observed=True,
            ids=[10 * (n + 1) for n in range(positions.shape[1])],
        )  # fmt: skip
        writer.declare_channel(gauge, [column, "other/one"], unit="mV")
        writer.declare_input(motor, ["a"], quantity="drive", unit="N")
        writer.append(
            time, positions=positions, observed=observed, channels={gauge: channel},
            inputs={motor: drive},
        )  # fmt: skip
    round_trip(tmp_path)
    with Trajectory(tmp_path / "b.h5") as b:
        np.testing.assert_array_equal(b.time, time)
        np.testing.assert_array_equal(b.positions(), positions)
        if (observed != 1).any():
            np.testing.assert_array_equal(b.observed(), observed)
        np.testing.assert_array_equal(b.channel(gauge), channel)
        np.testing.assert_array_equal(b.input(motor).value, drive)
        assert b.channel_columns(gauge) == (column, "other/one")
        assert (b.time_unit, b.position_unit, b.input(motor).unit) == ("ms", "um", "N")
        assert b.node("id").tolist() == [10 * (n + 1) for n in range(positions.shape[1])]


def test_channels_without_nodes(tmp_path):
    with TrajectoryWriter(tmp_path / "a.h5", provenance=Provenance("test")) as writer:
        writer.declare_time(unit="1", kind="pseudo")
        writer.declare_channel("light", ["light"], unit="arb")
        writer.append(np.arange(2000.0), channels={"light": np.arange(2000.0)[:, None] / 7})
    round_trip(tmp_path)
    with Trajectory(tmp_path / "b.h5") as b:
        assert (b.dims, b.time_kind, b.n_frames) == (0, "pseudo", 2000)
        np.testing.assert_array_equal(b.channel("light")[:, 0], np.arange(2000.0) / 7)


def test_existing_files_are_left_alone(tmp_path):
    import_csv(samples.write_sample(tmp_path).path, tmp_path / "a.h5")
    before = (tmp_path / "arms.csv").read_bytes()
    with pytest.raises(ResultExists, match="a finished file of this name"):
        export_file(tmp_path / "a.h5", tmp_path / "arms.csv")
    assert (tmp_path / "arms.csv").read_bytes() == before


def test_every_third_frame(tmp_path):
    import_csv(samples.write_sample(tmp_path).path, tmp_path / "a.h5")
    export_file(tmp_path / "a.h5", tmp_path / "third.csv", options={"stride": "3"})
    rows = (tmp_path / "third.csv").read_text().splitlines()[1:]
    times = [float(row.partition(",")[0]) for row in rows]
    assert times == samples.times()[::3].tolist()
    with pytest.raises(ConfigError, match="stride is 0"):
        export_file(tmp_path / "a.h5", tmp_path / "none.csv", options={"stride": 0})
    assert not list(tmp_path.glob("none*"))


def test_failed_export_leaves_nothing(tmp_path):
    import_csv(samples.write_sample(tmp_path).path, tmp_path / "a.h5")
    run = Trajectory(tmp_path / "a.h5")
    run.close()
    with pytest.raises(MissingData):
        CsvExporter().export(run, tmp_path / "new.csv", options={})
