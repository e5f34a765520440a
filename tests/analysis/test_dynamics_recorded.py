"""Replica tests on files."""

import numpy as np
import pytest

from openprc.analysis.dynamics import consistency_of_files, convergence_of_files, read_replicas
from openprc.errors import MissingInputError, TaskError
from openprc.reservoir import Channels, StateLoader
from openprc.reservoir.networks import LinearNetwork, write_network_run
from openprc.schema import Provenance, TrajectoryWriter

N, HOLD = 8, 0.05
U = np.random.default_rng(0).uniform(-1, 1, 500)


@pytest.fixture
def record(tmp_path):
    """Return a function that records a linear network and returns the path."""

    def make(name, *, u=U, n=N, **settings):
        network = LinearNetwork(n, spectral_radius=0.8, seed=1)
        return write_network_run(tmp_path / f"{name}.h5", network, u, hold=HOLD, **settings)

    return make


def test_convergence_of_two_files_is_that_of_the_network(record):
    paths = [record("rest"), record("moved", initial=np.full(N, 2.0))]
    found = convergence_of_files(paths, Channels())
    assert found.unit == "s"
    assert found.rate == pytest.approx(np.log(0.8) / HOLD, rel=0.01)
    assert found.r_squared > 0.999
    per_symbol = convergence_of_files(paths, Channels(), per_second=False)
    assert per_symbol.unit == "symbols"
    assert per_symbol.rate == pytest.approx(np.log(0.8), rel=0.01)
    assert per_symbol.time_to(0.01) * HOLD == pytest.approx(found.time_to(0.01))


def test_consistency_of_noisy_files(record):
    paths = [record(f"run{k}", noise=0.0 if k == 0 else 0.05, seed=k) for k in range(3)]
    assert consistency_of_files(paths[:1] * 2, Channels(), washout=50).capacity == pytest.approx(N)
    found = consistency_of_files(paths[1:], Channels(), washout=50)
    assert 0.5 * N < found.capacity < 0.999 * N
    assert found.n_rows == 450


def test_rows_are_symbols_where_the_file_has_them(record):
    paths = [record("a", frames_per_symbol=3), record("b", frames_per_symbol=3)]
    found = read_replicas(paths, Channels())
    assert (found.kind, len(found.states[0]), found.step) == ("symbols", 500, HOLD)
    assert found.names[0] == "state.x0"
    frames = read_replicas(paths, Channels(), clock="frames", washout=10)
    assert (frames.kind, len(frames.states[0])) == ("frames", 1490)


def test_a_longer_recording_is_cut_to_the_shorter_one(record):
    paths = [record("a"), record("b", u=U[:300])]
    assert [len(rows) for rows in read_replicas(paths, Channels()).states] == [300, 300]


def test_a_loader_that_was_passed_stays_open(record):
    with StateLoader(record("a")) as first:
        read_replicas([first, record("b")], Channels())
        assert first.n_frames == 500


def test_different_drives_are_refused(record):
    paths = [record("a"), record("b", u=U + 1e-3)]
    with pytest.raises(TaskError, match=r"b\.h5: /inputs: the drive differs from that of a\.h5"):
        read_replicas(paths, Channels())
    assert len(read_replicas(paths, Channels(), same_drive=0.01).states) == 2
    assert len(read_replicas(paths, Channels(), same_drive=None).states) == 2


def test_what_does_not_match_is_refused(record):
    with pytest.raises(TaskError, match="features give 5 columns here and 8 in a"):
        read_replicas([record("a"), record("b", n=5)], Channels())
    with pytest.raises(TaskError, match="1 recordings are given"):
        read_replicas([record("c")], Channels())
    with pytest.raises(TaskError, match="3 recordings are given"):
        convergence_of_files([record("d")] * 3, Channels())
    with pytest.raises(TaskError, match="washout is 500 and there are 500 rows"):
        read_replicas([record("e"), record("f")], Channels(), washout=500)
    slow = record("g", frames_per_symbol=2)
    with pytest.raises(TaskError, match=r"a row is one of frames, 0\.025 s long"):
        read_replicas([record("h"), slow], Channels(), clock="frames")


def test_files_that_do_not_say_what_drove_them(tmp_path):
    paths = []
    for name in ("a", "b"):
        paths.append(tmp_path / f"{name}.h5")
        with TrajectoryWriter(paths[-1], provenance=Provenance("test")) as writer:
            writer.declare_channel("gauge", ["g0"], unit="V")
            writer.append(np.arange(50) * 0.1, channels={"gauge": U[:50, None]})
    with pytest.raises(MissingInputError, match="same_drive=None if you know that they agree"):
        read_replicas(paths, Channels())
    assert read_replicas(paths, Channels(), same_drive=None).kind == "frames"
