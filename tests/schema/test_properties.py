"""What holds for every trajectory, found by drawing many."""

from __future__ import annotations

import itertools
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from openprc.errors import ConfigError
from openprc.schema import Provenance, Trajectory, TrajectoryWriter, validate_file
from openprc.schema.atomic import atomic_file
from openprc.schema.derive import pack, repair, sample_held
from openprc.schema.timebase import describe_time, max_deviation
from openprc.schema.units import UNITS, conversion_factor

COMMON = settings(max_examples=40, deadline=None, derandomize=True)
FLOATS = st.floats(-1e100, 1e100, allow_nan=False, width=64)
#: Any text that UTF-8 has, but NUL, which ends text in HDF5.
WORDS = st.text(
    st.characters(exclude_characters="\0", exclude_categories=["Cs"]), min_size=1, max_size=12
)


def arrays(shape, *, f4=False):
    if f4:
        return hnp.arrays(np.float32, shape, elements=st.floats(-(2.0**99), 2.0**99, width=32))
    return hnp.arrays(np.float64, shape, elements=FLOATS)


@st.composite
def clocks(draw, n):
    """Increasing instants: even, or with steps of very different size."""
    t0 = draw(st.sampled_from([0.0, -3.0, 0.1, 1e6]))
    if draw(st.booleans()):
        return t0 + np.arange(n) * draw(st.sampled_from([0.1, 1e-3, 1 / 240, 2.0]))
    steps = draw(st.lists(st.floats(1e-3, 1e3), min_size=n, max_size=n))
    time = t0 + np.cumsum(steps)
    assume((np.diff(time) > 0).all())
    return time


@st.composite
def cuts(draw, n):
    """Borders of blocks; a block of one row may be given as a single frame."""
    inner = draw(st.sets(st.integers(1, n - 1))) if n > 1 else set()
    return list(itertools.pairwise([0, *sorted(inner), n]))


@st.composite
def trajectories(draw):
    n = draw(st.integers(1, 9))
    nodes, dims = draw(st.integers(0, 4)), draw(st.sampled_from([2, 3]))
    found = {"n": n, "nodes": nodes, "dims": dims, "time": draw(clocks(n)), "cuts": draw(cuts(n))}
    found["f4"] = draw(st.booleans())
    if nodes:
        positions = draw(arrays((n, nodes, dims), f4=found["f4"])).astype("f8")
        if draw(st.booleans()):
            mask = draw(hnp.arrays(np.uint8, (n, nodes), elements=st.integers(0, 2)))
            positions[mask == 0] = np.nan
            found["observed"] = mask
        found["positions"] = positions
        found["labels"] = draw(st.lists(WORDS, min_size=nodes, max_size=nodes, unique=True))
        if nodes > 1:
            pairs = list(itertools.combinations(range(nodes), 2))
            found["bars"] = draw(st.lists(st.sampled_from(pairs), unique=True, max_size=4))
            found["lengths"] = draw(arrays((n, len(found["bars"]))))
    columns = draw(st.integers(0 if nodes else 1, 3))
    if columns:
        found["columns"] = draw(st.lists(WORDS, min_size=columns, max_size=columns, unique=True))
        found["channel"] = draw(arrays((n, columns)))
    return found


def write(path, run, *, split=True):
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        if run["nodes"]:
            writer.declare_nodes(
                run["nodes"], run["dims"], unit="mm", dtype="f4" if run["f4"] else "f8",
                observed="observed" in run, labels=run["labels"],
            )  # fmt: skip
        if "bars" in run:
            indices = np.array(run["bars"], dtype=int).reshape(-1, 2)
            writer.declare_elements("bars", indices, series={"length": "mm"})
        if "columns" in run:
            writer.declare_channel("gauge", run["columns"], unit="V")
        for start, stop in run["cuts"] if split else [(0, run["n"])]:
            rows = start if split and stop - start == 1 else slice(start, stop)
            writer.append(
                run["time"][rows],
                positions=run["positions"][rows] if run["nodes"] else None,
                observed=run["observed"][rows] if "observed" in run else None,
                elements={("bars", "length"): run["lengths"][rows]} if "bars" in run else None,
                channels={"gauge": run["channel"][rows]} if "columns" in run else None,
            )
    return path


@COMMON
@given(run=trajectories())
def test_what_is_written_is_valid_and_comes_back_bit_by_bit(run):
    with tempfile.TemporaryDirectory() as folder:
        path = write(Path(folder) / "a.h5", run)
        report = validate_file(path)
        assert report.at_least("error") == ()
        with Trajectory(path) as trajectory:
            assert (trajectory.n_frames, trajectory.n_nodes) == (run["n"], run["nodes"])
            assert trajectory.dims == (run["dims"] if run["nodes"] else 0)
            np.testing.assert_array_equal(trajectory.time, run["time"])
            if run["nodes"]:
                np.testing.assert_array_equal(trajectory.positions(), run["positions"])
                assert trajectory.node("label").tolist() == run["labels"]
            if "observed" in run:
                np.testing.assert_array_equal(trajectory.observed(), run["observed"])
            if "bars" in run:
                assert trajectory.indices("bars").tolist() == [list(b) for b in run["bars"]]
                np.testing.assert_array_equal(trajectory.element("bars", "length"), run["lengths"])
            if "columns" in run:
                np.testing.assert_array_equal(trajectory.channel("gauge"), run["channel"])
                assert trajectory.channel_columns("gauge") == tuple(run["columns"])
            digest = trajectory.content_digest()
        with Trajectory(write(Path(folder) / "b.h5", run, split=False)) as again:
            assert again.content_digest() == digest
        with Trajectory(pack(path, Path(folder) / "c.h5")) as packed:
            assert packed.content_digest() == digest


@COMMON
@given(run=trajectories(), keep=st.integers(0, 9))
def test_committed_prefix_survives_a_writer_that_is_dropped(run, keep):
    keep = min(keep, run["n"])
    with tempfile.TemporaryDirectory() as folder:
        run["cuts"] = [(i, i + 1) for i in range(run["n"])]
        partial = {**run, "n": keep, "cuts": run["cuts"][:keep]}
        path = Path(folder) / "a.h5"
        try:
            with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
                if run["nodes"]:
                    writer.declare_nodes(run["nodes"], run["dims"], unit="m",
                                         observed="observed" in run)  # fmt: skip
                writer.declare_channel("index", ["i"], unit="1")
                for i, _ in partial["cuts"]:
                    writer.append(
                        run["time"][i],
                        positions=run["positions"][i] if run["nodes"] else None,
                        observed=run["observed"][i] if "observed" in run else None,
                        channels={"index": [float(i)]},
                    )
                raise ZeroDivisionError
        except ZeroDivisionError:
            pass
        assert not path.exists()
        assert writer.partial.exists() == (keep > 0)
        if keep:
            with Trajectory(repair(writer.partial)) as trajectory:
                assert trajectory.n_frames == keep
                assert trajectory.status == "interrupted"
                np.testing.assert_array_equal(trajectory.time, run["time"][:keep])
                if run["nodes"]:
                    np.testing.assert_array_equal(trajectory.positions(), run["positions"][:keep])
            assert validate_file(path).ok


@COMMON
@given(
    values=arrays((5,)),
    pair=st.sampled_from(
        [(a.symbol, b.symbol) for a in UNITS.values() for b in UNITS.values()
         if a.dimension == b.dimension and a.si_factor == a.si_factor]
    ),
)  # fmt: skip
def test_conversion_there_and_back(values, pair):
    there, back = conversion_factor(*pair), conversion_factor(*reversed(pair))
    np.testing.assert_allclose(values * there * back, values, rtol=1e-15)


@settings(COMMON, max_examples=200)
@given(
    digits=st.integers(1, 999_999), exponent=st.integers(-9, 3), n=st.integers(2, 400),
    start=st.integers(-50, 50),
)  # fmt: skip
def test_decimal_clocks_are_uniform_with_that_decimal(digits, exponent, n, start):
    dt = float(f"{digits}e{exponent - 6}")
    time = start * dt + np.arange(n) * dt
    claim = describe_time(time)
    assert claim["uniform"] == 1
    assert claim["t0"] == time[0]
    assert abs(claim["dt"] - dt) <= 1e-12 * dt
    assert max_deviation(time, claim["t0"], claim["dt"]) <= 1e-6
    assert len(time) - 1 == round((time[-1] - time[0]) / claim["dt"])


@COMMON
@given(
    n=st.integers(3, 60), dt=st.floats(1e-4, 10), late=st.floats(1e-5, 0.4), data=st.data()
)  # fmt: skip
def test_one_late_frame_is_not_uniform(n, dt, late, data):
    time = np.arange(n) * dt
    frame = data.draw(st.integers(1, n - 2))
    time[frame] += late * dt
    assert describe_time(time)["uniform"] == 0


# --- held symbols ---------------------------------------------------------------------------------


def held_one_by_one(sequence, time, hold, start):
    """The definition, in exact arithmetic on multiples of a tick."""
    rows = []
    for t in time:
        k = 0
        while k + 1 < len(sequence) and start + (k + 1) * hold <= t:
            k += 1
        rows.append(sequence[k])
    return np.array(rows)


@settings(COMMON, max_examples=150)
@given(
    symbols=st.integers(1, 12), columns=st.integers(1, 3), ticks=st.integers(1, 7),
    start=st.integers(-20, 20), data=st.data(),
)  # fmt: skip
def test_held_symbols_agree_with_the_definition(symbols, columns, ticks, start, data):
    sequence = np.arange(symbols * columns, dtype="f8").reshape(symbols, columns)
    frames = data.draw(st.lists(st.integers(0, symbols * ticks), min_size=1, unique=True))
    whole = np.sort(frames) + start
    wanted = held_one_by_one(sequence, whole, ticks, start)
    for dt in (0.1, 0.001, 1 / 3, 7.0):
        # Borders fall between floats here: the integers above say which symbol is meant.
        found = sample_held(sequence, whole * dt, hold=ticks * dt, start=start * dt)
        np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize("time", [[-0.1, 0.5], [0.0, 3.1], [3.5, 4.0]])
def test_held_symbols_are_not_extrapolated(time):
    with pytest.raises(ConfigError, match=r"the signal covers 0 to 3, the frames"):
        sample_held(np.ones((3, 1)), np.array(time), hold=1.0, start=0.0)


def test_last_symbol_holds_at_the_very_end():
    found = sample_held(np.array([[1.0], [2.0]]), np.array([0.0, 0.3, 0.6]), hold=0.3, start=0.0)
    assert found.ravel().tolist() == [1.0, 2.0, 2.0]


# --- atomic files -----------------------------------------------------------------------------


@pytest.mark.parametrize("fails", [False, True])
def test_atomic_file_is_whole_or_absent(tmp_path, fails):
    path = tmp_path / "deep" / "x.bin"
    try:
        with atomic_file(path, overwrite=False) as temporary:
            temporary.write_text("half")
            assert not path.exists()
            if fails:
                raise ZeroDivisionError
            temporary.write_text("whole")
    except ZeroDivisionError:
        pass
    assert [item.name for item in path.parent.iterdir()] == ([] if fails else ["x.bin"])
