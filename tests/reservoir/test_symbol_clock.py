import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from openprc.errors import TaskError
from openprc.reservoir.io.symbol_clock import symbol_clock


def clock(n_frames, n_symbols, *, dt=0.01, hold=0.05, start=0.0, t0=0.0):
    return symbol_clock(
        name="drive",
        sequence=np.arange(n_symbols, dtype=float)[:, None],
        hold=hold,
        start=start,
        time=t0 + np.arange(n_frames) * dt,
        columns=("u",),
    )


def test_last_frame_of_each_symbol():
    symbols = clock(20, 4)
    assert symbols.frames.tolist() == [4, 9, 14, 19]
    assert (symbols.n_symbols, symbols.n_total, symbols.first) == (4, 4, 0)


def test_the_frame_on_the_edge_belongs_to_the_next_symbol():
    # 21 frames: the last one is at the very end of symbol 3, where symbol 4 would begin.
    assert clock(21, 4).frames.tolist() == [4, 9, 14, 19]


def test_frames_on_the_borders_are_read_at_the_end_of_each_symbol():
    # The frame at 0.01 is the first that symbol 0 has acted on; symbol 5 is never seen to act.
    symbols = clock(6, 6, hold=0.01)
    assert symbols.on_borders
    assert symbols.frames.tolist() == [1, 2, 3, 4, 5]
    assert (symbols.n_symbols, symbols.first) == (5, 0)
    assert symbols.frames_within(1)[:, 0].tolist() == [1, 2, 3, 4, 5]


def test_frames_on_the_borders_without_the_initial_state():
    symbols = clock(6, 6, hold=0.01, t0=0.01)
    assert symbols.frames.tolist() == [0, 1, 2, 3, 4, 5]
    with pytest.raises(TaskError, match="does not tell its value"):
        symbols.sample(np.arange(6.0))


def test_signal_given_per_frame_on_the_borders():
    values, where = clock(6, 6, hold=0.01).sample(np.array([3.0, 1.0, 4.0, 1.0, 5.0, 9.0]))
    assert values.tolist() == [3.0, 1.0, 4.0, 1.0, 5.0]
    assert "first frame of each symbol" in where


def test_hold_that_is_no_multiple_of_the_frame_step():
    symbols = clock(40, 8, hold=0.033)
    starts = np.arange(8) * 0.033
    times = np.arange(40) * 0.01
    for k, frame in enumerate(symbols.frames):
        assert starts[k] <= times[frame] < starts[k] + 0.033 <= times[frame] + 0.01 + 1e-12


def test_start_after_the_first_frame():
    assert clock(20, 2, start=0.1).frames.tolist() == [14, 19]


def test_symbols_without_a_recorded_end_are_left_out():
    symbols = clock(18, 4)
    assert symbols.frames.tolist() == [4, 9, 14]
    assert symbols.sequence[:, 0].tolist() == [0.0, 1.0, 2.0]
    assert symbols.n_total == 4


def test_symbols_before_the_recording_are_left_out():
    symbols = clock(10, 4, t0=0.1)
    assert symbols.first == 2
    assert symbols.frames.tolist() == [4, 9]
    assert symbols.start == pytest.approx(0.1)


def test_virtual_nodes_end_with_the_symbol():
    symbols = clock(40, 4, hold=0.1)
    within = symbols.frames_within(5)
    assert within.shape == (4, 5)
    assert within[0].tolist() == [1, 3, 5, 7, 9]
    np.testing.assert_array_equal(within[:, -1], symbols.frames)


@settings(max_examples=60, deadline=None)
@given(
    hold_frames=st.integers(2, 50),
    n_symbols=st.integers(2, 60),
    dt=st.sampled_from([0.001, 0.01, 1 / 30, 0.1, 1 / 29.97, 0.0333]),
    extra=st.integers(0, 3),
)
def test_frames_of_a_whole_number_of_steps_are_exact(hold_frames, n_symbols, dt, extra):
    """hold = h dt in floating point gives frames h - 1, 2h - 1, ... for any h and dt."""
    n_frames = hold_frames * n_symbols + extra
    symbols = clock(n_frames, n_symbols, dt=dt, hold=hold_frames * dt)
    expected = hold_frames * np.arange(1, n_symbols + 1) - 1
    np.testing.assert_array_equal(symbols.frames, expected)


def test_held_signal_is_read_at_the_end_of_each_symbol():
    symbols = clock(20, 4)
    values, where = symbols.sample(np.repeat([3.0, 1.0, 4.0, 1.0], 5))
    assert values.tolist() == [3.0, 1.0, 4.0, 1.0]
    assert where == "last frame of each symbol"


def test_interpolated_signal_is_read_where_the_symbol_begins():
    symbols = clock(20, 4)
    knots = np.array([3.0, 1.0, 4.0, 1.0, 5.0])
    values, where = symbols.sample(np.interp(np.arange(20) / 5, np.arange(5), knots))
    assert values.tolist() == [3.0, 1.0, 4.0, 1.0]
    assert "the signal moves within symbols" in where


@pytest.mark.parametrize(
    ("keywords", "words"),
    [
        ({"start": 5.0}, "cover none of the 4 symbols"),
        ({"t0": 9.0}, "cover none of the 4 symbols"),
        ({"hold": 0.004}, "symbols have no frame"),
    ],
)
def test_states_that_do_not_cover_the_symbols(keywords, words):
    with pytest.raises(TaskError, match=words):
        clock(20, 4, **keywords)


@pytest.mark.parametrize(
    ("n", "words"), [(0, "samples_per_symbol is 0"), (6, "a symbol has 5 frames")]
)
def test_impossible_virtual_nodes(n, words):
    with pytest.raises(TaskError, match=words):
        clock(20, 4).frames_within(n)
