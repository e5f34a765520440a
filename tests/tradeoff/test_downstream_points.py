"""The downstream side of a run: what storage, readouts and estimators cost, by theory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from openprc.analysis.benchmarks.choices import Choices
from openprc.errors import ConfigError, MissingInputError
from openprc.reservoir import LeastSquares, Split
from openprc.reservoir.training.evaluation import evaluate
from openprc.reservoir.training.row_split import RowSplit
from openprc.schema import Provenance, TrajectoryWriter
from openprc.tradeoff.downstream import GROUPS, downstream_points
from openprc.tradeoff.downstream_estimators import estimator_points, shortened
from openprc.tradeoff.downstream_readouts import (
    PENALTIES,
    DenseSolve,
    _worse_than_nothing,
    readouts,
)
from openprc.tradeoff.downstream_rows import downstream_rows
from openprc.tradeoff.downstream_storage import rounded, series_size

HOLD, N_NODES, N_SYMBOLS = 0.1, 7, 900
#: How far nodes move, on coordinates of some metres.
MOTION = 3e-6


def write_body(path, *, precision="f8", with_input=True):
    """Write nodes on a line whose positions are filtered symbols, and bars between them."""
    rng = np.random.default_rng(3)
    u = rng.uniform(0.0, 0.5, N_SYMBOLS)
    rest = np.zeros((N_NODES, 2))
    rest[:, 0] = 3.0 + 1.7 * np.arange(N_NODES)
    positions = np.tile(rest, (N_SYMBOLS, 1, 1))
    memory = np.zeros(N_NODES)
    for k, symbol in enumerate(u):
        memory = 0.8 * np.roll(memory, 1) + 0.2 * memory**2
        memory[0] += symbol
        positions[k, :, 0] += MOTION * memory
    positions[:, 0] = rest[0]
    bars = np.column_stack([np.arange(N_NODES - 1), np.arange(1, N_NODES)])
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_nodes(N_NODES, 2, unit="m", rest=rest, dtype=precision)
        writer.declare_elements(
            "bars", bars, static={"rest_length": (np.full(N_NODES - 1, 1.7), "m")}
        )
        inputs = None
        if with_input:
            writer.declare_input(
                "push", ["x"], quantity="force", unit="N", sequence=u[:, None], hold=HOLD
            )
            inputs = {"push": u[:, None]}
        times = (np.arange(N_SYMBOLS) + 0.5) * HOLD
        writer.append(times, positions=positions, inputs=inputs)
    return path


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return write_body(tmp_path_factory.mktemp("body") / "run.h5")


@pytest.fixture(scope="module")
def points(run):
    return list(downstream_points(run, None))


def of_group(points, group):
    return [point for point in points if point.group == group]


def test_rounding_to_float32_is_noise_of_a_unit_in_the_last_place_over_sqrt_12():
    rng = np.random.default_rng(0)
    for place in (0.3, 1.7, 5.1):
        values = place + 1e-3 * rng.normal(size=100_000)
        unit = 2.0 ** (np.floor(np.log2(place)) - 23)
        noise = rounded(values) - values
        assert noise.std() == pytest.approx(unit / np.sqrt(12.0), rel=0.01)
        assert abs(noise.mean()) < 0.02 * unit


def test_the_error_of_a_readout_of_rounded_lengths_is_that_of_the_noise():
    # One state l + a s with white s as target: noise of variance q^2 leaves q^2 / (a^2 + q^2).
    rng = np.random.default_rng(1)
    s = rng.normal(size=(60_000, 1))
    amplitude = 1e-7
    noise = 2.0**-23 / np.sqrt(12.0)
    found = evaluate(
        LeastSquares(), rounded(1.7 + amplitude * s), s, split=RowSplit(0, 30_000, 30_000)
    )
    assert found.nmse[0] == pytest.approx(noise**2 / (amplitude**2 + noise**2), rel=0.05)


def test_storage_keeps_motion_in_float64_and_as_float32_extensions_only(points):
    found = {point.label: point for point in of_group(points, "storage")}
    assert set(found) == {
        "float64 lengths", "float32 lengths", "float32 extensions",
        "float64 positions", "float32 positions", "float32 displacements",
    }  # fmt: skip
    for whole, moved in (("lengths", "extensions"), ("positions", "displacements")):
        exact, coarse, fine = (
            found[f"float64 {whole}"],
            found[f"float32 {whole}"],
            found[f"float32 {moved}"],
        )
        assert set(exact.score_errors.values()) == {0.0}
        for figure in ("narma2_nrmse", "ipc"):
            assert fine.score_errors[figure] < 1e-2 * coarse.score_errors[figure]
        assert coarse.scores["ipc"] < exact.scores["ipc"] - 0.1
        assert exact.file_size - fine.file_size == pytest.approx(exact.file_size - coarse.file_size)


def test_a_series_takes_its_values_and_its_times():
    assert series_size((1000, 10), "float64") == 1000 * 88
    assert series_size((1000, 10), "float32") == 1000 * 48


def test_a_run_in_float32_has_nothing_to_compare_with(tmp_path):
    path = write_body(tmp_path / "run.h5", precision="f4")
    (point,) = downstream_points(path, None, groups=("storage",))
    assert point.status == "refused"
    assert "stored in float32 itself" in point.note


def test_readouts_are_compared_with_qr(points):
    found = of_group(points, "readout")
    assert found[0].label == "QR"
    assert set(found[0].score_errors.values()) == {0.0}
    assert len(found) == len(list(readouts())) == 2 * (len(PENALTIES) + 3)
    assert all(point.cpu_seconds >= 0.0 for point in found if point.status == "ok")
    ladder = [p for p in found if p.label == "ridge"]
    assert [p.setting["regularization"] for p in ladder] == list(PENALTIES)
    errors = [p.score_errors["narma2_nrmse"] for p in ladder]
    assert errors[0] < 1e-9
    # A penalty of 0.1 on some hundred rows pulls far more than one of 1e-6.
    assert errors[-1] > 1e3 * errors[PENALTIES.index(1e-6)] > 0.0


def test_a_penalty_means_more_on_raw_states(points):
    by_setting = {(p.label, p.setting["regularization"]): p for p in of_group(points, "readout")}
    standardised = by_setting["ridge", 1e-6].score_errors["narma2_nrmse"]
    # Weights on states of 1e-5 are 1e5 times as large, and all of them are pulled to zero.
    raw = by_setting["ridge, raw states", 1e-6]
    assert raw.score_errors["narma2_nrmse"] > 100 * standardised
    assert by_setting["QR, raw states", 0.0].score_errors["narma2_nrmse"] < 1e-6


def test_what_is_written_by_hand_solves_least_squares():
    rng = np.random.default_rng(0)
    states, target = rng.normal(size=(50, 3)), rng.normal(size=(50, 2))
    expected = LeastSquares().fit(states, target).predict(states)
    for method in ("lstsq", "normal"):
        predicted = DenseSolve(method).fit(states, target).predict(states)
        np.testing.assert_allclose(predicted, expected, atol=1e-12)


def test_a_singular_matrix_fails_with_a_note(monkeypatch, run):
    from openprc.tradeoff import downstream_readouts

    class Singular(DenseSolve):
        def fit(self, X, y):
            np.linalg.solve(np.zeros((2, 2)), np.ones(2))

    only = [("by hand", Singular("normal"), {"regularization": 0.0, "standardize": True})]
    monkeypatch.setattr(downstream_readouts, "readouts", lambda: iter(only))
    (point,) = downstream_points(run, None, groups=("readout",))
    assert (point.status, point.note) == ("failed", "Singular matrix")


def test_estimators_agree_on_many_rows_and_chance_adds_k_r_over_t(points):
    found = {(p.label, p.setting["fraction"]): p for p in of_group(points, "estimator")}
    truth = found["insample, above threshold", 1.0]
    assert set(truth.score_errors.values()) == {0.0}
    measured = found["insample, as measured", 1.0]
    rank, n_targets = (int(part.split()[k]) for part, k in zip(
        measured.note.split(", "), (1, 0), strict=True))  # fmt: skip
    n_rows = measured.setting["rows"]
    excess = measured.scores["ipc"] - found["insample, without chance", 1.0].scores["ipc"]
    chance = rank / (n_rows - 1)
    # Each of K capacities is raised by chance to C + (1 - C) r / (T - 1).
    assert excess == pytest.approx(chance * (n_targets - measured.scores["ipc"]), rel=0.05)
    errors = [
        found["insample, as measured", fraction].score_errors["ipc"]
        for fraction in (1.0, 0.5, 0.25)
    ]
    assert errors[0] < errors[1] < errors[2]


def test_shortened_spans_keep_the_washout():
    assert shortened(RowSplit(7, 600, 300, 5), 0.25) == RowSplit(7, 150, 75, 5)


def test_points_come_one_by_one_and_progress_is_told(run):
    told = []
    points = downstream_points(
        run, None, groups=("storage",), progress=lambda share, what: told.append((share, what))
    )
    next(points)
    points.close()
    assert told == [(0.0, "storage: float64 lengths")]


def test_an_unknown_group_is_refused(run):
    with pytest.raises(ConfigError, match="the group 'integrator'\n  expected: one of storage"):
        next(downstream_points(run, None, groups=("integrator",)))
    assert tuple(GROUPS) == ("storage", "readout", "estimator")


def test_a_run_without_input_has_no_downstream_side(tmp_path):
    path = write_body(tmp_path / "run.h5", with_input=False)
    with pytest.raises(MissingInputError, match="does not say what drove"):
        next(downstream_points(path, None))


def test_spans_are_a_fifth_and_a_tenth_unless_they_are_chosen(run):
    with downstream_rows(run, None) as rows:
        assert rows.split == RowSplit(180, 630, 90)
    chosen = Choices(split=Split(washout=100, train=500, test=200, unit="rows"))
    with downstream_rows(run, None, chosen) as rows:
        assert rows.split == RowSplit(100, 500, 200)


def test_errors_above_that_of_the_mean_are_remarked_on():
    assert not _worse_than_nothing({"narma2_nrmse": 0.9})
    assert "narma2_nrmse above 1" in _worse_than_nothing({"narma2_nrmse": 7.6, "ipc": 0.5})


def test_an_input_that_remembers_has_no_estimators(run):
    with downstream_rows(run, None) as rows:
        u = np.convolve(rows.u, np.ones(9), mode="same")
        (point,) = estimator_points(replace(rows, u=u))
    assert point.status == "refused"
    assert "autocorrelation" in point.note


def test_points_survive_json(points):
    for point in points:
        assert type(point).from_dict(point.as_dict()) == point
