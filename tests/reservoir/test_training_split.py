import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from openprc.errors import MissingInputError, TaskError
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.training.row_clock import RowClock
from openprc.reservoir.training.split import Split

SECONDS = st.floats(0.0, 50.0, allow_nan=False)
MAYBE = st.none() | SECONDS


def rows(n_rows, step):
    """Return a clock of frames."""
    time = np.arange(n_rows) * step
    frames = np.arange(n_rows)[:, None]
    return RowClock("frames", frames, time, step, unit="s", n_frames=n_rows, symbols=None)


def test_rows_of_the_paper_listing():
    split = Split(washout=5.0, train=10.0, test=10.0).over(rows(2501, 0.01)).rows
    assert (split.washout, split.train, split.test) == (500, 1000, 1000)
    assert (split.train_rows, split.test_rows) == (slice(500, 1500), slice(1500, 2500))


@pytest.mark.parametrize(("duration", "step", "expected"), [(0.3, 0.1, 3), (8.2, 0.01, 820)])
def test_truncation_would_lose_a_row(duration, step, expected):
    assert int(duration / step) == expected - 1
    split = Split(washout=0, train=duration, test=1).over(rows(10_000, step))
    assert split.rows.train == expected


@settings(max_examples=300)
@given(
    washout=MAYBE,
    train=MAYBE,
    gap=SECONDS,
    test=MAYBE,
    n_rows=st.integers(2, 100_000),
    step=st.sampled_from([0.001, 0.01, 0.1, 1 / 30, 1 / 29.97, 0.033, 0.7]),
)
def test_spans_follow_each_other_and_never_overlap(washout, train, gap, test, n_rows, step):
    split = Split(washout=washout, train=train, gap=gap, test=test)
    clock = rows(n_rows, step)
    given_ = {"washout": washout, "train": train, "gap": gap, "test": test}
    asked = sum(v for v in given_.values() if v is not None)
    try:
        found = split.over(clock).rows
    except TaskError as error:
        # A span too short for one row, or too few rows for the spans.
        assert error.key in ("train", "test", "/time_series/time")  # noqa: PT017
        too_brief = any(v is not None and v <= step for v in (train, test))
        left = n_rows - asked / step - (0.1 * n_rows if washout is None else 0.0)
        assert too_brief or left < (4 if None in (washout, train, test) else 0)
        return
    first, second = found.train_rows, found.test_rows
    assert 0 <= first.start < first.stop <= second.start < second.stop <= n_rows
    assert first.start == found.washout
    assert second.start - first.stop == found.gap
    for name, seconds in given_.items():
        if seconds is not None:
            assert abs(seconds / step - found.spans[name]) <= 1.0 + 1e-6
    if train is None or test is None:
        assert found.n_rows == n_rows


@settings(max_examples=200)
@given(
    counts=st.tuples(*[st.integers(1, 3000)] * 3),
    step=st.sampled_from([0.001, 0.01, 0.1, 0.3, 1 / 30, 1 / 29.97, 0.033]),
)
def test_whole_rows_survive_the_way_through_seconds(counts, step):
    washout, train, test = counts
    split = Split(washout=washout * step, train=train * step, test=test * step)
    found = split.over(rows(sum(counts), step)).rows
    assert (found.washout, found.train, found.test) == counts


def test_spans_that_are_not_given_share_what_is_left():
    found = Split().over(rows(1000, 0.01)).rows
    assert (found.washout, found.train, found.gap, found.test) == (100, 600, 0, 300)
    found = Split(washout=0.0, gap=1.0).over(rows(1000, 0.01)).rows
    assert (found.washout, found.train, found.gap, found.test) == (0, 600, 100, 300)
    found = Split(washout=1.0, test=2.0).over(rows(1000, 0.01)).rows
    assert (found.washout, found.train, found.test) == (100, 700, 200)
    found = Split(washout=1.0, train=2.0, gap=0.5).over(rows(1000, 0.01)).rows
    assert (found.train, found.gap, found.test) == (200, 50, 650)


@pytest.mark.parametrize(
    ("unit", "spans"),
    [("s", (0.5, 1.0, 0.5)), ("frames", (50, 100, 50)), ("rows", (10, 20, 10)),
     ("symbols", (10, 20, 10))],
)  # fmt: skip
def test_every_unit_counts_the_same_rows_of_symbols(make_body, unit, spans):
    path = make_body(n_frames=200, sequence=np.arange(40.0), hold=0.05)
    washout, train, test = spans
    with StateLoader(path) as loader:
        found = Split(washout=washout, train=train, test=test, unit=unit).resolve(loader)
    assert found.clock.kind == "symbols"
    assert (found.rows.washout, found.rows.train, found.rows.test) == (10, 20, 10)
    assert list(found.remarks()) == []


def test_frames_that_end_within_a_symbol_are_rounded_once_and_told(make_body):
    path = make_body(n_frames=200, sequence=np.arange(40.0), hold=0.05)
    with StateLoader(path) as loader:
        found = Split(washout=52, train=100, test=48, unit="frames").resolve(loader)
    assert (found.rows.washout, found.rows.train, found.rows.test) == (10, 20, 10)
    assert next(found.remarks()) == (
        "washout 52 frames is not a whole number of rows of 5 frames; 10 rows were used"
    )


def test_the_clock_is_part_of_the_split(make_body):
    path = make_body(n_frames=200, sequence=np.arange(40.0), hold=0.05)
    with StateLoader(path) as loader:
        on_frames = Split(clock="frames").resolve(loader)
        assert (on_frames.clock.n_rows, on_frames.rows.n_rows) == (200, 200)
        virtual = Split(samples_per_symbol=5, input_name="symbols").resolve(loader)
        assert virtual.clock.frames.shape == (40, 5)


def test_one_row_every_few_frames(make_body):
    with StateLoader(make_body(n_frames=42)) as loader:
        found = Split(clock="frames", frames_per_row=5, unit="frames", washout=10).resolve(loader)
        clock = found.clock
        assert clock.frames[:, 0].tolist() == [4, 9, 14, 19, 24, 29, 34, 39]
        assert clock.step == pytest.approx(0.05)
        np.testing.assert_allclose(clock.time, loader.time[4::5])
        assert (found.rows.washout, found.rows.n_rows) == (2, 8)
        u, note = clock.align_input(np.arange(42.0))
        assert u.tolist() == [4, 9, 14, 19, 24, 29, 34, 39]
        assert note == "input given per frame; read at the frame of each row"
        y, note = clock.align_target(np.arange(42.0))
        assert y[:, 0].tolist() == u.tolist()
        assert "target given per frame" in note
        with pytest.raises(TaskError, match=r"the length is 7\n.*8 \(rows.* or 42 \(frames\)"):
            clock.align_input(np.zeros(7))


def test_load_steps_are_counted(make_body):
    path = make_body(time=np.arange(40.0), time_unit="1", time_kind="pseudo")
    with StateLoader(path) as loader:
        found = Split(washout=0, train=30, test=10).resolve(loader)
        assert (found.unit, found.rows.train) == ("load steps", 30)


def test_too_short_a_file_says_what_there_is_and_what_is_asked():
    with pytest.raises(TaskError) as caught:
        Split(washout=5.0, train=10.0, test=10.0).over(rows(1001, 0.01), file="run.h5")
    text = str(caught.value)
    assert "run.h5" in text
    assert "there are 10.01 s of states (1001 rows of 0.01 s)" in text
    assert "25 s = washout 5 + train 10 + test 10 (2500 rows)" in text


@pytest.mark.parametrize("spans", [{"test": 20.0}, {"washout": 11.0}, {"gap": 30.0, "train": 1.0}])
def test_spans_that_leave_nothing(spans):
    with pytest.raises(TaskError, match=r"there are 10 s of states|span is 0 rows"):
        Split(**spans).over(rows(1000, 0.01))


@pytest.mark.parametrize(
    ("keywords", "words"),
    [
        ({"washout": -1.0}, "the washout duration is -1.0"),
        ({"train": float("nan")}, "the train duration is nan"),
        ({"test": float("inf")}, "the test duration is inf"),
        ({"gap": "1"}, "the gap duration is '1'"),
        ({"gap": True}, "the gap duration is True"),
        ({"unit": "minutes"}, "unit is 'minutes'"),
    ],
)
def test_impossible_durations(keywords, words):
    with pytest.raises(TaskError, match=words):
        Split(**{"washout": 1.0, "train": 1.0, "test": 1.0, **keywords})


@pytest.mark.parametrize(
    ("keywords", "words"),
    [
        ({"train": 0.0}, "train span is 0 rows"),
        ({"test": 0.001}, "test span is 0 rows"),
        ({"clock": "seconds"}, "clock is 'seconds'"),
        ({"samples_per_symbol": 2}, "samples_per_symbol is 2 and the rows are frames"),
        ({"samples_per_symbol": 0}, "samples_per_symbol is 0"),
        ({"frames_per_row": 1.5}, "frames_per_row is 1.5"),
        ({"frames_per_row": 500}, "frames_per_row is 500 and the file has 40 frames"),
        ({"unit": "symbols", "clock": "frames"}, "the spans count symbols and the rows are frames"),
    ],
)
def test_impossible_clocks(make_body, keywords, words):
    spans = {"washout": 0.1, "train": 0.1, "test": 0.1, **keywords}
    with StateLoader(make_body()) as loader, pytest.raises(TaskError, match=words):
        Split(**spans).resolve(loader)


def test_symbols_that_are_not_there(make_body):
    with StateLoader(make_body()) as loader, pytest.raises(MissingInputError, match="no input"):
        Split(unit="symbols").resolve(loader)


def test_symbols_are_not_thinned(make_body):
    path = make_body(sequence=np.arange(8.0), hold=0.05)
    with (
        StateLoader(path) as loader,
        pytest.raises(TaskError, match="frames_per_row is 2 and the rows are symbols"),
    ):
        Split(frames_per_row=2).resolve(loader)
