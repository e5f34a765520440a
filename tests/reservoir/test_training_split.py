import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from openprc.errors import TaskError
from openprc.reservoir.training.split import Split

SECONDS = st.floats(0.0, 50.0, allow_nan=False)


def test_rows_of_the_paper_listing():
    split = Split.from_seconds(2501, 0.01, washout=5.0, train=10.0, test=10.0)
    assert (split.washout, split.train, split.test) == (500, 1000, 1000)
    assert (split.train_rows, split.test_rows) == (slice(500, 1500), slice(1500, 2500))


@pytest.mark.parametrize(("duration", "step", "rows"), [(0.3, 0.1, 3), (8.2, 0.01, 820)])
def test_truncation_would_lose_a_row(duration, step, rows):
    assert int(duration / step) == rows - 1
    assert Split.from_seconds(10_000, step, washout=0, train=duration, test=1).train == rows


@settings(max_examples=300, deadline=None)
@given(
    washout=SECONDS,
    train=SECONDS,
    gap=SECONDS,
    test=SECONDS,
    step=st.sampled_from([0.001, 0.01, 0.1, 1 / 30, 1 / 29.97, 0.033, 0.7]),
)
def test_spans_follow_each_other_and_never_overlap(washout, train, gap, test, step):
    total = washout + train + gap + test
    n_rows = int(np.ceil(total / step)) + 1
    try:
        split = Split.from_seconds(n_rows, step, washout=washout, train=train, gap=gap, test=test)
    except TaskError as error:
        assert error.key in ("train", "test")  # noqa: PT017 - a span too short for one row
        assert min(train, test) < step
        return
    first, second = split.train_rows, split.test_rows
    assert 0 <= first.start < first.stop <= second.start < second.stop <= n_rows
    assert first.start == split.washout
    assert second.start - first.stop == split.gap
    for seconds, rows in ((washout, split.washout), (train, split.train), (test, split.test)):
        assert abs(seconds / step - rows) <= 1.0 + 1e-9
    assert abs(total / step - split.n_rows) <= 0.5 + 1e-6


@settings(max_examples=200, deadline=None)
@given(
    rows=st.tuples(*[st.integers(1, 3000)] * 3),
    step=st.sampled_from([0.001, 0.01, 0.1, 0.3, 1 / 30, 1 / 29.97, 0.033]),
)
def test_whole_rows_survive_the_way_through_seconds(rows, step):
    washout, train, test = rows
    split = Split.from_seconds(
        sum(rows), step, washout=washout * step, train=train * step, test=test * step
    )
    assert (split.washout, split.train, split.test) == rows


def test_too_short_a_file_says_what_there_is_and_what_is_asked():
    with pytest.raises(TaskError) as caught:
        Split.from_seconds(1001, 0.01, washout=5.0, train=10.0, test=10.0, file="run.h5")
    text = str(caught.value)
    assert "run.h5" in text
    assert "there are 10.01 s of states (1001 rows of 0.01 s)" in text
    assert "25 s = washout 5 + train 10 + test 10 (2500 rows)" in text


@pytest.mark.parametrize(
    ("keywords", "words"),
    [
        ({"washout": -1.0}, "washout duration is -1.0"),
        ({"train": float("nan")}, "train duration is nan"),
        ({"test": float("inf")}, "test duration is inf"),
        ({"train": 0.0}, "train span is 0 rows"),
        ({"test": 0.001}, "test span is 0 rows"),
    ],
)
def test_impossible_durations(keywords, words):
    spans = {"washout": 1.0, "train": 1.0, "test": 1.0, **keywords}
    with pytest.raises(TaskError, match=words):
        Split.from_seconds(1000, 0.01, **spans)


@pytest.mark.parametrize("rows", [{"washout": -1}, {"train": 0}, {"test": 1.5}, {"gap": True}])
def test_impossible_rows(rows):
    with pytest.raises(TaskError, match=f"the {next(iter(rows))} span is"):
        Split(**{"washout": 1, "train": 5, "test": 5, **rows})


def test_only_measured_rows_are_used():
    split = Split(washout=2, train=4, test=3, gap=1)
    usable = np.ones(12, dtype=bool)
    usable[[0, 3, 8]] = False
    train, test = split.masks(usable)
    assert train.tolist() == [2, 4, 5]
    assert test.tolist() == [7, 9]


@pytest.mark.parametrize(("lost", "name"), [(slice(2, 6), "training"), (slice(7, 10), "test")])
def test_no_measured_row_in_a_span(lost, name):
    usable = np.ones(12, dtype=bool)
    usable[lost] = False
    with pytest.raises(TaskError, match=f"none of the . {name} rows was measured"):
        Split(washout=2, train=4, test=3, gap=1).masks(usable)
