import numpy as np
import pytest

from openprc.errors import MissingData, MissingInputError, NonUniformTime, TaskError
from openprc.reservoir.io.state_loader import StateLoader
from openprc.schema import Trajectory

DT = 0.01


def test_clock_and_sizes(make_body):
    with StateLoader(make_body(n_frames=40)) as loader:
        assert (loader.n_frames, loader.n_nodes, loader.n_bars, loader.dims) == (40, 3, 2, 3)
        assert loader.dt == pytest.approx(DT, rel=1e-12)
        np.testing.assert_allclose(loader.time, np.arange(40) * DT, atol=1e-15)
        assert loader.time_kind == "physical"


def test_milliseconds_are_read_as_seconds(make_body):
    path = make_body(time=np.arange(40) * 10.0, time_unit="ms", sequence=range(8), hold=50.0)
    with StateLoader(path) as loader:
        assert loader.dt == pytest.approx(0.01, rel=1e-12)
        assert loader.time[-1] == pytest.approx(0.39, rel=1e-12)
        assert loader.symbols().hold == pytest.approx(0.05, rel=1e-12)
        assert loader.symbols().n_symbols == 8


def test_accepts_an_open_trajectory(make_body):
    with Trajectory(make_body()) as trajectory:
        assert StateLoader(trajectory).n_frames == 40


def test_positions_and_displacements(make_body):
    with StateLoader(make_body()) as loader:
        positions = loader.positions([2, 1])
        assert positions.shape == (40, 2, 3)
        assert positions.dtype == np.float64
        np.testing.assert_allclose(positions[0, 0], [2.0, 0.0, 0.2], atol=1e-15)
        # From rest: node 2 starts displaced by 0.2. From the first frame: by nothing.
        np.testing.assert_allclose(loader.displacements([2])[0, 0], [0.0, 0.0, 0.2], atol=1e-15)
        assert not loader.displacements([2], origin="first")[0].any()


def test_displacements_without_rest_start_at_zero(make_body):
    with StateLoader(make_body(rest=False)) as loader:
        assert loader.resolve_origin("auto") == "first"
        assert not loader.displacements()[0].any()
        with pytest.raises(MissingData, match="/topology/nodes/rest"):
            loader.displacements(origin="rest")


@pytest.mark.parametrize("stored", [True, False])
def test_bar_lengths_stored_or_from_the_ends(make_body, stored):
    with StateLoader(make_body(stored_lengths=stored)) as loader:
        phase = 2 * np.pi * np.arange(40) / 20
        expected = np.hypot(1.0, 0.1 * np.sin(phase))
        np.testing.assert_allclose(loader.bar_lengths()[:, 0], expected, rtol=1e-14)
        np.testing.assert_allclose(loader.bar_extensions([0])[:, 0], expected - 1.0, atol=1e-14)
        assert loader.bar_lengths([1]).shape == (40, 1)


def test_bar_extensions_without_rest_lengths(make_body):
    with StateLoader(make_body(rest_lengths=False)) as loader:
        assert loader.resolve_bar_origin("auto") == "first"
        assert not loader.bar_extensions()[0].any()
        with pytest.raises(MissingData, match="rest_length"):
            loader.bar_extensions(origin="rest")


def test_actuation_signal_by_position_name_and_axis(make_body):
    with StateLoader(make_body()) as loader:
        expected = np.sin(2 * np.pi * np.arange(40) / 20)
        # The columns are the axes x and z: axis 2 is the second column.
        for which, dof in ((0, 2), ("base", "z"), ("base", 2), (0, "2")):
            np.testing.assert_allclose(loader.get_actuation_signal(which, dof), expected)
        assert not loader.get_actuation_signal(actuator_idx=0, dof=0).any()


def test_actuation_signal_of_plain_columns(make_body):
    with StateLoader(make_body(sequence=range(8), hold=0.05)) as loader:
        held = np.repeat(np.arange(8.0), 5)
        np.testing.assert_array_equal(loader.get_actuation_signal("symbols", 0), held)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((1, 0), "there is no input 1"),
        ((-1, 0), "there is no input -1"),
        (("top", 0), "there is no input 'top'"),
        ((0, 1), "no column 1"),
        ((0, 3), "no column 3"),
        ((0, "w"), "no column 'w'"),
    ],
)
def test_unknown_input_is_refused(make_body, arguments, words):
    with StateLoader(make_body()) as loader, pytest.raises(MissingInputError, match=words):
        loader.get_actuation_signal(*arguments)


def test_without_input_the_way_to_attach_one_is_told(make_body):
    with StateLoader(make_body(inputs=False)) as loader:
        with pytest.raises(MissingInputError, match="openprc attach-input"):
            loader.get_actuation_signal()
        with pytest.raises(MissingInputError, match="openprc attach-input"):
            loader.symbols()
        assert not loader.has_symbols()


def test_symbols_that_are_not_stored(make_body):
    with StateLoader(make_body()) as loader:
        with pytest.raises(MissingInputError, match="no input stores the symbols"):
            loader.symbols()
        with pytest.raises(MissingInputError, match="input 'base' stores the symbols"):
            loader.symbols("base")


def test_missing_samples_are_an_error_that_names_the_worst(make_body):
    path = make_body(gaps={1: slice(3, 6), 2: [10]})
    with StateLoader(path) as loader:
        with pytest.raises(MissingData) as caught:
            loader.positions()
        text = str(caught.value)
        assert "4 of 120 samples (2 of 3; worst: node 1 in 3 of 40 frames" in text
        assert "node 2 in 1 of 40 frames" in text
        assert 'missing="drop"' in text
        # What was measured can still be read.
        assert loader.positions([0]).shape == (40, 1, 3)


def test_missing_samples_interpolated_between_neighbours(make_body):
    path = make_body(gaps={1: slice(3, 6)})
    with StateLoader(path, missing="interpolate") as loader:
        y = loader.positions([1])[:, 0, 1]
    expected = np.interp([3, 4, 5], [2, 6], [y[2], y[6]])
    np.testing.assert_allclose(y[3:6], expected, atol=1e-15)


@pytest.mark.parametrize("frames", [slice(0, 2), slice(38, 40), slice(0, 40)])
def test_nothing_is_extrapolated(make_body, frames):
    path = make_body(gaps={1: frames})
    with (
        StateLoader(path, missing="interpolate") as loader,
        pytest.raises(MissingData, match="before the first or after the last"),
    ):
        loader.positions()


def test_missing_samples_dropped_stay_nan(make_body):
    path = make_body(gaps={1: slice(3, 6)}, rest=False)
    with StateLoader(path, missing="drop") as loader:
        positions = loader.positions()
        assert np.isnan(positions[3:6, 1]).all()
        assert np.count_nonzero(np.isnan(positions)) == 9
        assert np.isnan(loader.bar_lengths()[3:6]).all()


def test_displacements_need_a_complete_first_frame(make_body):
    path = make_body(gaps={1: [0]}, rest=False, rest_lengths=False)
    with StateLoader(path, missing="drop") as loader:
        with pytest.raises(MissingData, match="displacements have no origin"):
            loader.displacements()
        with pytest.raises(MissingData, match="extensions have no origin"):
            loader.bar_extensions()


@pytest.mark.parametrize(
    ("ids", "words"),
    [
        ([3], "of which \\[3\\] do not exist"),
        ([-1], "of which \\[-1\\] do not exist"),
        ([0, 0], "with repetitions"),
        ([], "empty"),
        ([0.5], "do not exist"),
        ([True], "do not exist"),
    ],
)
def test_wrong_node_numbers(make_body, ids, words):
    with StateLoader(make_body()) as loader, pytest.raises(TaskError, match=words):
        loader.positions(ids)


def test_absent_quantities_are_not_made_up(delay_line):
    with StateLoader(delay_line) as loader:
        with pytest.raises(MissingData, match="positions"):
            loader.positions()
        with pytest.raises(MissingData, match="velocities"):
            loader.velocities()
        with pytest.raises(MissingData, match="no bars"):
            loader.bar_lengths()
        with pytest.raises(MissingData, match="channels"):
            loader.channel("nothing")


def test_channel(delay_line):
    with StateLoader(delay_line) as loader:
        assert loader.channels == ("taps",)
        assert loader.channel("taps").shape == (1500, 8)


def test_unknown_policy(delay_line):
    with pytest.raises(TaskError, match="missing is 'zero'"):
        StateLoader(delay_line, missing="zero")


def test_uneven_time_has_no_step(make_body):
    with StateLoader(make_body(time=[0.0, 0.1, 0.3, 0.4])) as loader:
        with pytest.raises(NonUniformTime):
            _ = loader.dt
        assert loader.time[2] == 0.3


def test_load_steps_are_refused_for_memory(make_body):
    path = make_body(time=np.arange(40.0), time_unit="1", time_kind="pseudo")
    with StateLoader(path) as loader:
        assert loader.dt == 1.0
        with pytest.raises(TaskError, match="load steps of a quasi-static analysis"):
            loader.require_physical_time("NARMA2")
