import numpy as np
import pytest
from sklearn.linear_model import Ridge as SklearnRidge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures

from openprc.errors import TaskError
from openprc.reservoir.features.bar_features import BarLengths
from openprc.reservoir.features.channel_features import Channels
from openprc.reservoir.features.node_features import NodeDisplacements, NodePositions
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.readout.ridge import Ridge
from openprc.reservoir.readout.saved import Readout
from openprc.reservoir.training.evaluation import evaluate
from openprc.reservoir.training.row_split import RowSplit
from openprc.reservoir.training.split import Split
from openprc.reservoir.training.trainer import Trainer
from openprc.schema import results

SPANS = {"washout": 1.0, "train_duration": 9.0, "test_duration": 4.0}


@pytest.fixture
def line(delay_line, tmp_path):
    """Return a function that makes a trainer on the tapped delay line, and its symbols."""
    loader = StateLoader(delay_line)

    def make(readout=None, **keywords):
        keywords = {**SPANS, "experiment_dir": tmp_path, **keywords}
        return Trainer(Channels(), Ridge(1e-9) if readout is None else readout, loader=loader,
                       **keywords)  # fmt: skip

    make.symbols = loader.symbols().sequence[:, 0]
    yield make
    loader.close()


def delayed(symbols, k):
    return np.concatenate([np.zeros(k), symbols[: len(symbols) - k]])


def test_rows_are_symbols_where_the_file_stores_them(line):
    trainer = line()
    assert trainer.rows.kind == "symbols"
    assert trainer.states.values.shape == (300, 8)
    assert (trainer.split.washout, trainer.split.train, trainer.split.test) == (20, 180, 80)


@pytest.mark.parametrize("k", range(8))
def test_a_delay_line_recalls_what_it_holds(line, k):
    result = line().train(delayed(line.symbols, k), f"recall{k}")
    assert result.nmse < 1e-12
    expected = np.zeros(8)
    expected[k] = 1.0
    weights = result.weights[:, 0] / result.evaluation.fitted.standardizer.scale
    np.testing.assert_allclose(weights, expected, atol=1e-6)


def test_a_delay_line_cannot_recall_more(line):
    assert line().train(delayed(line.symbols, 8), "recall8").nmse > 0.9


def test_row_k_pairs_with_symbol_k(line):
    """The states at the end of symbol k have seen u(k) and nothing of u(k+1)."""
    assert line().train(line.symbols, "now").nmse < 1e-12
    assert line().train(np.roll(line.symbols, -1), "next").nmse > 0.9


def test_closed_form_of_a_linear_system():
    """x(t) = a x(t-1) + u(t): two such states give u(t-1) exactly, by (x_a - x_b) / (a - b)."""
    rng = np.random.default_rng(5)
    u = rng.uniform(-1, 1, 500)
    a, b = 0.6, -0.3
    states = np.zeros((500, 2))
    for t in range(500):
        states[t] = np.array([a, b]) * states[t - 1] + u[t] if t else u[0]
    target = np.concatenate([[0.0], a * states[:-1, 0] - b * states[:-1, 1]])[:, None]
    split = RowSplit(washout=20, train=300, test=180)
    result = evaluate(Ridge(0.0), states, target, split=split)
    assert result.mean_nmse < 1e-24
    raw = result.fitted.weights[:, 0] / result.fitted.standardizer.scale
    np.testing.assert_allclose(raw, [1.0, -1.0], atol=1e-10)


def test_several_outputs_at_once(line, tmp_path):
    both = np.stack([delayed(line.symbols, 1), 2.0 + 3.0 * delayed(line.symbols, 5)], axis=1)
    result = line().train(both, "both")
    assert result.weights.shape == (8, 2)
    assert result.bias.shape == (2,)
    assert result.evaluation.nmse.max() < 1e-12
    assert result.cache["test"][1].shape == (80, 2)
    alone = line().train(both[:, 1], "alone")
    np.testing.assert_allclose(result.weights[:, 1], alone.weights[:, 0], atol=1e-12)
    stored = results.read_result(result.save())
    assert stored.array("validation/prediction").shape == (80, 2)


def test_cache_is_time_target_prediction(line):
    result = line().train(line.symbols, "now")
    time, target, prediction = result.cache["test"]
    assert time.shape == target.shape == prediction.shape == (80,)
    np.testing.assert_array_equal(target, line.symbols[200:280])
    assert time[0] == pytest.approx(201 * 0.05 - 0.01)
    assert result.cache["train"][0].shape == (180,)


def test_nothing_is_learned_from_the_test_rows():
    """Weights, mean and scale stay bit for bit when the test states are shifted and stretched."""
    rng = np.random.default_rng(11)
    states, target = rng.normal(size=(400, 6)), rng.normal(size=(400, 1))
    split = RowSplit(washout=50, train=200, test=100, gap=10)
    before = evaluate(Ridge(1e-3), states, target, split=split)
    other = states.copy()
    other[:50] = -1e6
    other[250:] = 1e3 * other[250:] + 1e5
    after = evaluate(Ridge(1e-3), other, target, split=split)
    for name in ("weights", "bias"):
        np.testing.assert_array_equal(getattr(before.fitted, name), getattr(after.fitted, name))
    # Centred first, so that the mean is right to the last digits of what varies.
    mean = states[50:250].mean(axis=0)
    np.testing.assert_allclose(before.fitted.standardizer.mean, mean, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(before.fitted.standardizer.scale, after.fitted.standardizer.scale)
    assert not np.allclose(before.prediction, after.prediction)


def test_readout_file_predicts_the_same(line):
    result = line().train(delayed(line.symbols, 3), "recall3")
    path = result.save()
    assert path == result.readout_path
    assert path.name == "readout_recall3.h5"
    readout = Readout.load(path)
    rows = result.evaluation.test_rows
    predicted = readout.predict(line().states.values[rows])
    np.testing.assert_allclose(predicted, result.evaluation.prediction, rtol=0, atol=1e-12)
    assert readout.feature_names == tuple(f"taps.d{k}" for k in range(8))
    stored = results.read_result(path)
    assert stored.kind == "readout"
    assert stored.attrs["NRMSE"] == pytest.approx(result.nrmse, rel=1e-15)
    assert stored.attrs["NMSE_definition"].startswith("mean((y - p)^2) / var(y), ddof 0")
    assert stored.attrs["source_run_id"] == line().loader.run_id
    assert stored.provenance["parents"] == [line().loader.run_id]
    assert stored.provenance["config"]["features"]["type"] == "Channels"
    for span, n in (("training", 180), ("validation", 80)):
        for name in ("target", "prediction"):
            assert stored.array(f"{span}/{name}").shape == (n, 1)
        assert stored.array(f"{span}/time").shape == (n,)
    assert stored.array("preprocessing/X_mean").shape == (8,)
    # Saving again replaces the file in one step and leaves nothing else behind.
    result.save()
    assert [item.name for item in path.parent.iterdir()] == [path.name]


def test_readout_of_other_states_is_refused(line):
    readout = Readout.load(line().train(line.symbols, "now").save())
    with pytest.raises(TaskError, match="the states have 3 columns"):
        readout.predict(np.zeros((2, 3)))


def test_a_quadratic_readout_sees_what_a_linear_one_cannot(line):
    product = delayed(line.symbols, 1) * delayed(line.symbols, 4)
    quadratic = make_pipeline(PolynomialFeatures(2), SklearnRidge(1e-9))
    assert line().train(product, "product").nmse > 0.9
    assert line(quadratic).train(product, "product").nmse < 1e-12


def test_virtual_nodes_come_from_within_the_symbol(line):
    trainer = line(samples_per_symbol=5)
    assert trainer.states.values.shape == (300, 40)
    assert trainer.states.names[0] == "taps.d0@1/5"
    assert trainer.states.names[-1] == "taps.d7@5/5"
    np.testing.assert_array_equal(trainer.states.values[:, 32:], line().states.values)


def test_frames_and_a_held_drive_are_remarked(line):
    trainer = line(clock="frames")
    drive = trainer.loader.get_actuation_signal()
    result = trainer.train(drive, "frames")
    assert trainer.rows.kind == "frames"
    (remark,) = [w for w in result.warnings if w.startswith("frame clock")]
    assert "drive autocorrelation 0.8" in remark
    assert "nearly memoryless" in remark


def test_symbols_of_a_white_drive_are_not_remarked(line):
    assert line().train(line.symbols, "now").warnings == ()


def test_target_per_frame_is_read_at_the_rows(line):
    trainer = line()
    per_frame = trainer.loader.channel("taps")[:, 3]
    result = trainer.train(per_frame, "frames")
    np.testing.assert_array_equal(result.target[:, 0], delayed(line.symbols, 3))
    assert "target given per frame" in result.warnings[0]


def test_states_that_do_not_change_are_told(make_body):
    with StateLoader(make_body()) as loader:
        trainer = Trainer(NodePositions(), Ridge(), loader=loader, washout=0.0,
                          train_duration=0.25, test_duration=0.15)  # fmt: skip
        result = trainer.train(loader.positions()[:, 1, 1], "echo")
    assert result.constant_columns == (
        "node0.x", "node0.y", "node0.z", "node1.x", "node1.z", "node2.x", "node2.y",
    )  # fmt: skip
    assert any(w.startswith("7 of 9 states do not change: node0.x") for w in result.warnings)
    assert result.nmse < 1e-10


def test_too_few_rows_for_the_states_are_told(line):
    spans = {"train_duration": 0.75, "test_duration": 1.0}
    result = line(Ridge(1.0), **spans).train(line.symbols, "short")
    assert any("15 training rows for 8 states" in w for w in result.warnings)


def test_spans_that_are_no_whole_rows_are_told(line):
    result = line(washout=1.01).train(line.symbols, "odd")
    assert any(
        w.startswith("washout 1.01 s is not a whole number of rows") for w in result.warnings
    )


def test_rows_with_missing_samples_are_left_out(make_body):
    path = make_body(n_frames=80, gaps={1: [5, 30, 70]}, rest=False)
    with StateLoader(path, missing="drop") as loader:
        trainer = Trainer(NodeDisplacements(), Ridge(1e-9), loader=loader, washout=0.0,
                          train_duration=0.5, test_duration=0.3)  # fmt: skip
        assert trainer.states.usable.sum() == 77
        target = np.cos(2 * np.pi * np.arange(80) / 20)
        result = trainer.train(target, "cosine")
    assert (len(result.evaluation.train_rows), len(result.evaluation.test_rows)) == (48, 29)
    assert result.nmse < 1e-12
    assert "3 rows have missing samples and were left out" in result.warnings


def test_several_features_side_by_side(make_body):
    with StateLoader(make_body()) as loader:
        trainer = Trainer([NodePositions(dims=[2]), BarLengths()], Ridge(), loader=loader,
                          washout=0.0, train_duration=0.2, test_duration=0.2)  # fmt: skip
        assert trainer.states.names == ("node0.z", "node1.z", "node2.z", "bar0", "bar1")


def test_load_steps_serve_static_targets(make_body):
    path = make_body(time=np.arange(40.0), time_unit="1", time_kind="pseudo", inputs=False)
    with StateLoader(path) as loader:
        trainer = Trainer(NodePositions(), Ridge(1e-9), loader=loader, washout=0, train_duration=20,
                          test_duration=20)  # fmt: skip
        assert trainer.train(loader.positions()[:, 2, 2], "static").nmse < 1e-12
        assert trainer.rows.unit == "load steps"


def test_without_standardising(line):
    result = line(standardize=False).train(delayed(line.symbols, 2), "raw")
    np.testing.assert_array_equal(result.evaluation.fitted.standardizer.scale, np.ones(8))
    assert result.nmse < 1e-12


class _Wrong:
    """A feature whose names do not match its columns."""

    def transform(self, loader):
        return np.zeros((loader.n_frames, 2))

    def names(self, loader):
        return ["only one"]


class _Infinite(_Wrong):
    def transform(self, loader):
        return np.full((loader.n_frames, 1), np.inf)


class _Still(_Wrong):
    def transform(self, loader):
        return np.ones((loader.n_frames, 1))


@pytest.mark.parametrize(
    ("keywords", "words"),
    [
        ({"clock": "seconds"}, "clock is 'seconds'"),
        ({"clock": "frames", "samples_per_symbol": 2}, "samples_per_symbol is 2 and the rows"),
        ({"train_duration": 90.0}, "there are 15 s of states"),
    ],
)
def test_impossible_settings(line, keywords, words):
    with pytest.raises(TaskError, match=words):
        line(**keywords).train(line.symbols, "task")


@pytest.mark.parametrize(
    ("feature", "words"),
    [
        (_Wrong(), "gave a matrix of shape \\(1500, 2\\) and 1 names"),
        (_Infinite(), "state 'only one' is infinite"),
        (_Still(), "none of the 1 states changes"),
    ],
)
def test_features_that_break_their_word(delay_line, feature, words):
    with StateLoader(delay_line) as loader:
        trainer = Trainer(feature, Ridge(), loader=loader, **SPANS)
        with pytest.raises(TaskError, match=words):
            trainer.train(loader.symbols().sequence[:, 0], "task")


@pytest.mark.parametrize(
    ("readout", "words"),
    [(Ridge, "the readout is the class Ridge"), (object(), "without fit and predict")],
)
def test_what_is_no_readout(line, readout, words):
    with pytest.raises(TaskError, match=words):
        line(readout)


@pytest.mark.parametrize(
    ("target", "words"),
    [
        (np.zeros(7), "the length is 7\n.*300 \\(rows on the clock of symbols\\) or 300"),
        (np.full(300, np.nan), "300 of 300 target rows are NaN"),
        (np.zeros((300, 0)), "the target has shape \\(300, 0\\)"),
        (np.ones(300), "output 0 of the target is constant"),
    ],
)
def test_impossible_targets(line, target, words):
    with pytest.raises(TaskError, match=words):
        line().train(target, "task")


@pytest.mark.parametrize("name", ["", "../up", "a/b", "a b", ".hidden"])
def test_task_names_stay_within_the_folder(line, name):
    with pytest.raises(TaskError, match="the task name is"):
        line().train(line.symbols, name)


def test_nowhere_to_save(line):
    result = line(experiment_dir=None).train(line.symbols, "now")
    with pytest.raises(TaskError, match="no experiment_dir"):
        result.save()


def test_spans_in_one_object_are_the_same(line):
    given = Split(washout=20, train=180, test=80, unit="symbols")
    trainer = line(washout=None, train_duration=None, test_duration=None, split=given)
    assert trainer.split == line().split
    target = delayed(line.symbols, 3)
    np.testing.assert_array_equal(
        trainer.train(target).evaluation.prediction, line().train(target).evaluation.prediction
    )


def test_spans_are_given_once(line):
    with pytest.raises(TaskError, match="both split and washout, train_duration, test_duration"):
        line(split=Split())
    with pytest.raises(TaskError, match="both split and gap"):
        line(washout=None, train_duration=None, test_duration=None, gap=0.1, split=Split())
    with pytest.raises(TaskError, match="train_duration not given"):
        line(train_duration=None)


def test_scikit_learns_ridge_is_solved_without_copies(line):
    """The same minimum as its own fit on the standardised training rows."""
    target = delayed(line.symbols, 2) + 0.1 * line.symbols**2
    result = line(SklearnRidge(0.3)).train(target, "task")
    fitted = result.evaluation.fitted
    x = fitted.standardizer.transform(line().states.values[20:200])
    own = SklearnRidge(0.3).fit(x, target[20:200])
    np.testing.assert_allclose(fitted.estimator.coef_, own.coef_, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(fitted.estimator.predict(x), own.predict(x), rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(fitted.train_prediction[:, 0], own.predict(x), atol=1e-14)
