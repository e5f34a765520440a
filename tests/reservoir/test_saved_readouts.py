import numpy as np
import pytest
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.ensemble import RandomForestRegressor
from sklearn.linear_model import Ridge as SklearnRidge
from sklearn.naive_bayes import GaussianNB
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures

from openprc.errors import MissingDependency, ResultExists, TaskError, UnsafeFile
from openprc.reservoir.features.channel_features import Channels
from openprc.reservoir.features.node_features import NodePositions
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.readout import stored_estimator
from openprc.reservoir.readout.ridge import Ridge
from openprc.reservoir.readout.saved import Readout
from openprc.reservoir.training.trainer import Trainer
from openprc.schema import results

QUADRATIC = make_pipeline(PolynomialFeatures(2), SklearnRidge(1e-6))


@pytest.fixture
def trained(delay_line, tmp_path):
    """Return a function that trains a readout on a product of two symbols."""
    loader = StateLoader(delay_line)
    u = loader.symbols().sequence[:, 0]

    def train(readout, *, features=None, target=None, **keywords):
        trainer = Trainer(features or Channels(), readout, loader=loader, experiment_dir=tmp_path,
                          washout=1.0, train_duration=9.0, test_duration=4.0,
                          **keywords)  # fmt: skip
        product = np.roll(u, 1) * np.roll(u, 2)
        return trainer, trainer.train(product if target is None else target, "task")

    yield train
    loader.close()


@pytest.fixture
def no_skops(monkeypatch):
    monkeypatch.setattr(stored_estimator, "find_spec", lambda name: None)


def test_a_file_without_an_estimator_says_what_is_missing(trained, no_skops):
    _, result = trained(QUADRATIC)
    path = result.save()
    assert results.read_result(path).attrs["linear"] == 0
    with pytest.raises(TaskError, match=r"(?s)holds no linear weights .* and no estimator"):
        Readout.load(path)
    with pytest.raises(MissingDependency, match="skops is needed to keep the estimator"):
        result.save(estimator=True)


class TestWithSkops:
    """Estimators that are no tables of weights."""

    @pytest.fixture(autouse=True)
    def _skops(self):
        pytest.importorskip("skops.io", reason="skops, an extra, is not installed")

    def test_an_estimator_is_stored_and_read(self, trained):
        trainer, result = trained(QUADRATIC)
        readout = Readout.load(result.save())
        assert readout.weights is None
        assert readout.remarks == ()
        rows = result.evaluation.test_rows
        np.testing.assert_array_equal(
            readout.predict(trainer.states.values[rows]), result.evaluation.prediction
        )
        stamps = results.read_result(result.readout_path).attrs["estimator_versions"]
        assert [stamp.split()[0] for stamp in stamps] == ["scikit-learn", "skops", "numpy"]
        with pytest.raises(TaskError, match="the readout is an estimator, not a table of weights"):
            readout.save(result.readout_path)

    def test_no_estimator_where_none_is_wanted(self, trained):
        _, result = trained(QUADRATIC)
        assert "model/estimator" not in results.read_result(result.save(estimator=False)).arrays

    def test_a_classifier_is_stored_with_its_labels(self, trained):
        rng = np.random.default_rng(0)
        labels = np.where(rng.random(300) < 0.5, "left", "right")
        trainer, result = trained(GaussianNB(), target=labels)
        readout = Readout.load(result.save())
        predicted = readout.predict(trainer.states.values[result.evaluation.test_rows])
        np.testing.assert_array_equal(predicted, result.evaluation.prediction)

    def test_types_that_nobody_vouched_for_are_refused_by_name(self, trained):
        trainer, result = trained(RandomForestRegressor(3, random_state=0))
        path = result.save()
        with pytest.raises(UnsafeFile, match=r"vouched for: sklearn\.tree\._tree\.Tree"):
            Readout.load(path)
        readout = Readout.load(path, trusted=["sklearn.tree._tree.Tree"])
        rows = result.evaluation.test_rows
        np.testing.assert_array_equal(
            readout.predict(trainer.states.values[rows]), result.evaluation.prediction
        )

    def test_an_estimator_cannot_be_read_without_skops(self, trained, monkeypatch):
        path = trained(QUADRATIC)[1].save()
        monkeypatch.setattr(stored_estimator, "find_spec", lambda name: None)
        with pytest.raises(MissingDependency, match="skops is needed to read the estimator"):
            Readout.load(path)

    def test_another_version_is_remarked(self, trained, monkeypatch):
        path = trained(QUADRATIC)[1].save()
        stamps = [
            s if "numpy" in s else s.split()[0] + " 99.0" for s in stored_estimator.versions()
        ]
        monkeypatch.setattr(stored_estimator, "versions", lambda: stamps)
        (remark,) = Readout.load(path).remarks
        assert "scikit-learn" in remark
        assert "(now skops 99.0)" in remark
        assert "numpy" not in remark

    def test_what_skops_cannot_store(self, trained):
        _, result = trained(Closure())
        with pytest.raises(TaskError, match="skops cannot store Closure"):
            result.save()


class Closure(RegressorMixin, BaseEstimator):
    """Learns a generator, which nothing can store."""

    def fit(self, X, y):
        self.steps_ = (k for k in range(3))
        return self

    def predict(self, X):
        return np.abs(X).sum(axis=1)


def test_weights_need_no_skops(trained, no_skops):
    trainer, result = trained(make_pipeline(SklearnRidge(1e-6)))
    readout = Readout.load(result.save(estimator=True))
    rows = result.evaluation.test_rows
    np.testing.assert_allclose(
        readout.predict(trainer.states.values[rows]), result.evaluation.prediction, atol=1e-12
    )


def test_saving_what_was_loaded(trained, tmp_path):
    trainer, result = trained(Ridge(1e-6))
    readout = Readout.load(result.save())
    copy = Readout.load(readout.save(tmp_path / "copy.h5"))
    np.testing.assert_array_equal(copy.weights, readout.weights)
    assert copy.feature_names == readout.feature_names
    assert copy.attrs["NRMSE"] == readout.attrs["NRMSE"]
    states = trainer.states.values
    np.testing.assert_array_equal(copy.predict(states), readout.predict(states))
    with pytest.raises(ResultExists):
        readout.save(tmp_path / "copy.h5")


def test_predicting_another_file(trained, delay_line):
    trainer, result = trained(Ridge(1e-6), samples_per_symbol=2)
    readout = Readout.load(result.save())
    with StateLoader(delay_line) as other:
        time, predicted = readout.predict_file(other, [Channels()])
    np.testing.assert_array_equal(time, trainer.rows.time)
    rows = result.evaluation.test_rows
    np.testing.assert_allclose(predicted[rows], result.evaluation.prediction, atol=1e-12)


def test_a_file_of_other_states_is_refused(trained, make_body, delay_line):
    _, result = trained(Ridge(1e-6))
    readout = Readout.load(result.save())
    with (
        StateLoader(make_body()) as other,
        pytest.raises(TaskError, match=r"the features give 9 columns: node0\.x"),
    ):
        readout.predict_file(other, NodePositions(), clock="frames")
    with (
        StateLoader(delay_line) as same,
        pytest.raises(TaskError, match="Pipeline is no feature"),
    ):
        readout.predict_file(same, make_pipeline(Channels()))
