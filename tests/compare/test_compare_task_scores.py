"""Task scores of runs whose scores are known in closed form, and of runs that have none."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import pytest

from openprc.analysis.benchmarks.choices import Choices
from openprc.analysis.tasks.narma import NarmaTask
from openprc.compare.task_scores import FIGURES, capacities, state_nmse, task_scores
from openprc.errors import TaskError, UnreadableFile
from openprc.reservoir import LeastSquares, NodeDisplacements, Split
from openprc.reservoir.training.row_split import RowSplit
from openprc.scenes.scene import Reference, Scene
from openprc.schema import Provenance, TrajectoryWriter

HOLD = 0.1
N_TAPS = 10


@dataclass(frozen=True)
class InputTask:
    """The input itself as target."""

    name: str = "copy"

    def target(self, u):
        from openprc.analysis.tasks.series import TargetSeries

        return TargetSeries(np.asarray(u)[:, None], n_warmup=0)


def write_run(path, states, u, *, kind="physical", with_input=True, symbols=True):
    """Write channels (K, F) and the symbols (K,) that drove them, one frame a symbol."""
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        if kind == "pseudo":
            writer.declare_time(unit="1", kind=kind)
        writer.declare_channel("state", [f"s{k}" for k in range(states.shape[1])], unit="1")
        inputs = None
        if with_input:
            given = {"sequence": u[:, None], "hold": HOLD} if symbols else {}
            writer.declare_input("drive", ["u"], quantity="force", unit="N", **given)
            inputs = {"drive": u[:, None]}
        # A frame in the middle of each symbol.
        number = np.arange(len(u))
        times = number * 1.0 if kind == "pseudo" else (number + 0.5) * HOLD
        writer.append(times, channels={"state": states}, inputs=inputs)
    return path


def delay_line(u, n_taps):
    """Return (K, n_taps): column k is the input k + 1 symbols ago."""
    return np.stack(
        [np.concatenate([np.zeros(k), u[: len(u) - k]]) for k in range(1, n_taps + 1)], axis=1
    )


def symbols_of(n, seed=5):
    return np.random.default_rng(seed).uniform(0.0, 0.5, n)


def scene_of(**fields):
    return Scene(
        name="made-up",
        experiment=None,
        reference=Reference(kind="closed form", text="", source=""),
        scale=1.0,
        **fields,
    )


@pytest.fixture(scope="module")
def line_run(tmp_path_factory):
    u = symbols_of(4000)
    return write_run(tmp_path_factory.mktemp("line") / "run.h5", delay_line(u, N_TAPS), u)


def test_the_memory_of_a_delay_line_is_its_number_of_taps(line_run):
    found = task_scores(line_run)
    assert found.figures["memory_capacity"] == pytest.approx(N_TAPS, abs=1e-6)
    # It computes nothing else, and does not hold the present symbol.
    assert found.figures["ipc"] == pytest.approx(N_TAPS, abs=1e-6)
    assert set(found.figures) | set(found.skipped) == set(FIGURES)
    assert found.settings["clock"] == "symbols"
    assert found.settings["n_states"] == N_TAPS


def test_a_register_with_the_present_symbol_scores_what_ten_taps_score(tmp_path):
    # Of infinitely many symbols, ten taps leave an NRMSE of 0.402 of NARMA2 and 0.587 of NARMA10.
    u = symbols_of(12_000)
    states = np.column_stack([u, delay_line(u, 9)])
    figures = task_scores(write_run(tmp_path / "run.h5", states, u)).figures
    assert figures["narma2_nrmse"] == pytest.approx(0.402, abs=0.02)
    assert figures["narma10_nrmse"] == pytest.approx(0.587, abs=0.03)


def test_scores_do_not_change_from_call_to_call(line_run):
    assert task_scores(line_run).as_dict() == task_scores(line_run).as_dict()


def test_a_volterra_target_among_the_states_is_read_out_without_error(tmp_path):
    from openprc.analysis.benchmarks.standard_suite import volterra_task

    u = symbols_of(900)
    target = np.nan_to_num(volterra_task(HOLD).target(u).values)
    figures = task_scores(write_run(tmp_path / "run.h5", target, u)).figures
    # What is left is the pull of the default penalty, p / n of the weight.
    assert figures["volterra2_nrmse"] < 1e-7


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        ({"with_input": False}, "does not say what drove"),
        ({"kind": "pseudo", "symbols": False}, "load step"),
        ({"n": 40}, "24 rows to train on and 12 to test on"),
        ({"still": True}, "no channels|none of the 3 states changes"),
        ({"slow": True}, "count as about .* independent ones"),
        ({"constant": True}, "does not vary"),
    ],
)
def test_a_run_that_admits_no_task_says_why(tmp_path, make, reason):
    make = dict(make)
    n, still, slow = make.pop("n", 400), make.pop("still", False), make.pop("slow", False)
    u = np.linspace(0.0, 0.5, n) if slow else symbols_of(n)
    if make.pop("constant", False):
        u = np.full(n, 0.25)
    states = np.ones((n, 3)) if still else delay_line(u, 3) + symbols_of(n, 1)[:, None]
    found = task_scores(write_run(tmp_path / "run.h5", states, u, **make))
    assert not found.figures
    assert set(found.skipped) == set(FIGURES)
    assert all(re.search(reason, text) for text in found.skipped.values()), found.skipped


def test_capacities_of_an_input_that_remembers_are_left_out_and_errors_are_not(tmp_path):
    rng = np.random.default_rng(2)
    u = np.convolve(rng.uniform(0.0, 0.5, 3005), np.full(6, 1.0 / 6.0), mode="valid")
    found = task_scores(write_run(tmp_path / "run.h5", delay_line(u, 4), u))
    assert "narma2_nrmse" in found.figures
    assert "autocorrelation" in found.skipped["ipc"]
    assert set(found.skipped) >= {"memory_capacity", "ipc"}


def test_a_narma_system_that_blows_up_is_left_out_alone(tmp_path):
    u = np.where(symbols_of(600) > 0.05, 0.5, 0.0)
    found = task_scores(write_run(tmp_path / "run.h5", delay_line(u, 4), u))
    assert "diverged" in found.skipped["narma10_nrmse"]
    assert "narma2_nrmse" in found.figures


def test_more_states_than_rows_can_tell_apart_have_no_capacity(tmp_path):
    u = symbols_of(200)
    states = np.random.default_rng(0).normal(size=(200, 120))
    found = task_scores(write_run(tmp_path / "run.h5", states, u))
    assert re.search("180 rows for 120 independent states|rows", found.skipped["ipc"])


def test_frames_instead_of_symbols_are_remarked_on(tmp_path):
    u = symbols_of(600)
    path = write_run(tmp_path / "run.h5", delay_line(u, 4), u, symbols=False)
    assert any("rows are frames" in note for note in task_scores(path).notes)


def test_a_scene_that_nothing_drives_is_not_scored(line_run):
    found = task_scores(line_run, scene=scene_of())
    assert set(found.skipped.values()) == {"nothing drives the scene made-up at random"}


def test_a_scene_names_input_and_features(line_run):
    found = task_scores(line_run, scene=scene_of(input_name="drive", features="channels"))
    assert found.settings["features"].startswith("Channels(")
    wrong = task_scores(line_run, scene=scene_of(input_name="wind", features="channels"))
    assert "wind" in wrong.skipped["ipc"]


def test_choices_come_before_the_scene(line_run):
    scene = scene_of(input_name="wind", features="bar-lengths")
    choices = Choices(split=Split(input_name="drive"), features=NodeDisplacements())
    found = task_scores(line_run, scene=scene, choices=choices)
    assert "nodes/positions: it is not in the file" in found.skipped["ipc"]


def test_a_file_that_is_none_is_an_error(tmp_path):
    path = tmp_path / "run.h5"
    path.write_bytes(b"no run")
    with pytest.raises(UnreadableFile):
        task_scores(path)


def test_states_in_memory_score_as_a_file_does(line_run):
    u = symbols_of(4000)
    split = RowSplit(400, 2400, 1200)
    choices = Choices(readout=LeastSquares())
    figures = task_scores(line_run, choices=choices).figures
    scaled = 0.5 * (u - u.min()) / (u.max() - u.min())
    nmse = state_nmse(
        delay_line(u, N_TAPS), scaled, task=NarmaTask(2), split=split, readout=LeastSquares()
    )
    assert np.sqrt(nmse) == pytest.approx(figures["narma2_nrmse"], rel=1e-9)


def test_capacities_take_an_estimator():
    u = symbols_of(3000)
    split = RowSplit(300, 1800, 900)
    held_out = capacities(delay_line(u, 5), u, split=split, estimator="heldout")
    assert held_out.memory_capacity == pytest.approx(5.0, abs=1e-4)
    states = np.random.default_rng(0).normal(size=(60, 40))
    with pytest.raises(TaskError, match="45 rows for 40 independent states"):
        capacities(states, u[:60], split=RowSplit(15, 30, 15), delays={1: 3})
