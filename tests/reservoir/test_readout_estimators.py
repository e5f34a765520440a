"""Any estimator is a readout: what it predicts, what is stored, and what it is left as."""

import numpy as np
import pytest
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.compose import TransformedTargetRegressor
from sklearn.cross_decomposition import PLSRegression
from sklearn.decomposition import PCA
from sklearn.ensemble import RandomForestRegressor
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.kernel_ridge import KernelRidge
from sklearn.linear_model import (
    BayesianRidge,
    ElasticNet,
    HuberRegressor,
    Lasso,
    LinearRegression,
    MultiTaskLasso,
    RidgeCV,
    SGDRegressor,
)
from sklearn.linear_model import Ridge as SklearnRidge
from sklearn.model_selection import GridSearchCV, TimeSeriesSplit
from sklearn.neighbors import KNeighborsRegressor
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler
from sklearn.svm import SVR, LinearSVR

from openprc.reservoir.readout.fitting import fit_readout
from openprc.reservoir.readout.ridge import Ridge
from openprc.reservoir.readout.rls import RLS
from openprc.reservoir.readout.temporal_ridge import TemporalRidgeCV

N_STATES = 5
AFFINE = [
    Ridge(1e-6),
    TemporalRidgeCV(gap=2),
    RLS(1e-6),
    SklearnRidge(1e-6),
    SklearnRidge(1e-6, solver="svd"),
    SklearnRidge(1e-6, fit_intercept=False),
    LinearRegression(),
    Lasso(1e-4),
    ElasticNet(1e-4),
    BayesianRidge(),
    HuberRegressor(),
    RidgeCV([1e-3, 1.0]),
    PLSRegression(4),
    SGDRegressor(random_state=0),
    LinearSVR(random_state=0),
    SVR(kernel="linear"),
    KernelRidge(alpha=1e-3, kernel="linear"),
    make_pipeline(StandardScaler(), PCA(5), SklearnRidge(1e-6)),
    TransformedTargetRegressor(LinearRegression(), transformer=StandardScaler()),
    GridSearchCV(SklearnRidge(), {"alpha": [1e-6, 1e6]}, cv=TimeSeriesSplit(3, gap=2)),
    MLPRegressor(
        hidden_layer_sizes=(4,), activation="identity", random_state=0, solver="lbfgs", max_iter=500
    ),
]
OTHERS = [
    MLPRegressor(hidden_layer_sizes=(8,), random_state=0, solver="lbfgs", max_iter=500),
    make_pipeline(PolynomialFeatures(2), SklearnRidge(1e-6)),
    TransformedTargetRegressor(LinearRegression(), func=np.cbrt, inverse_func=lambda y: y**3),
    RandomForestRegressor(5, random_state=0),
    KNeighborsRegressor(3),
    SVR(),
    GaussianProcessRegressor(alpha=1e-4),
]


def name_of(estimator):
    return type(estimator).__name__


@pytest.fixture(scope="module")
def data():
    """States about 5 with different scales, and two targets, the first rather linear."""
    rng = np.random.default_rng(0)
    states = rng.normal(size=(240, N_STATES)) * [1.0, 0.1, 10.0, 1.0, 1.0] + 5.0
    z = (states - states.mean(axis=0)) / states.std(axis=0)
    linear = z @ [1.0, -2.0, 0.5, 0.0, 1.5] + 3.0
    targets = np.stack([linear + 0.05 * z[:, 0] ** 2, 1.0 - z[:, 3]], axis=1)
    return states, targets + 0.01 * rng.normal(size=targets.shape)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("n_outputs", [1, 2])
@pytest.mark.parametrize("estimator", AFFINE, ids=name_of)
def test_affine_maps_are_found_whatever_they_are_built_of(data, estimator, n_outputs):
    states, targets = data[0], data[1][:, :n_outputs]
    before = repr(estimator.get_params())
    fitted = fit_readout(estimator, states, targets[:200], rows=np.arange(200))
    assert fitted.weights.shape == (N_STATES, n_outputs)
    assert fitted.bias.shape == (n_outputs,)
    assert fitted.train_prediction.shape == (200, n_outputs)
    # What is stored predicts as the estimator itself does, on rows that it has not seen.
    x = fitted.standardizer.transform(states[200:])
    own = np.asarray(fitted.estimator.predict(x)).reshape(40, n_outputs)
    np.testing.assert_allclose(fitted.predict(states[200:]), own, rtol=1e-8, atol=1e-8)
    # Two of them have no intercept, and these targets need one.
    if getattr(estimator, "fit_intercept", True) and not isinstance(estimator, KernelRidge):
        error = np.mean((own - targets[200:]) ** 2, axis=0) / targets[200:].var(axis=0)
        assert error.max() < 0.05
    assert repr(estimator.get_params()) == before
    assert not hasattr(estimator, "coef_")
    assert not hasattr(estimator, "n_features_in_")


@pytest.mark.parametrize("n_outputs", [1, 2])
@pytest.mark.parametrize("estimator", OTHERS, ids=name_of)
def test_other_maps_are_not_taken_for_affine_ones(data, estimator, n_outputs):
    states, targets = data[0], data[1][:, :n_outputs]
    fitted = fit_readout(estimator, states[:200], targets[:200])
    assert fitted.weights is None
    assert fitted.bias is None
    assert fitted.train_prediction.shape == (200, n_outputs)
    predicted = fitted.predict(states[200:])
    assert predicted.shape == (40, n_outputs)
    error = np.mean((predicted - targets[200:]) ** 2, axis=0) / targets[200:].var(axis=0)
    assert error.max() < 0.6


def test_models_for_several_outputs_only(data):
    fitted = fit_readout(MultiTaskLasso(1e-4), *data)
    assert fitted.weights.shape == (N_STATES, 2)


def test_a_network_with_two_outputs_is_one_network(data):
    """Its tag denies that it takes several columns; a network for each would be another model."""
    network = MLPRegressor(hidden_layer_sizes=(8,), random_state=0, solver="lbfgs", max_iter=50)
    assert type(fit_readout(network, *data).estimator) is MLPRegressor


class Misleading(RegressorMixin, BaseEstimator):
    """Has weights, and does something else."""

    def fit(self, X, y):
        self.coef_, self.intercept_ = np.ones(X.shape[1]), 0.0
        return self

    def predict(self, X):
        return np.abs(X).sum(axis=1)


def test_stated_weights_are_not_believed(data):
    assert fit_readout(Misleading(), data[0], data[1][:, :1]).weights is None


class Minimal:
    """Neither tags nor parameters: fit and predict are all that is asked for."""

    def fit(self, X, y):
        self.mean = y.mean(axis=0)
        return self

    def predict(self, X):
        return np.broadcast_to(self.mean, (len(X), *np.shape(self.mean)))


def test_fit_and_predict_are_all_that_is_needed(data):
    model = Minimal()
    fitted = fit_readout(model, *data)
    np.testing.assert_allclose(fitted.bias, data[1].mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(fitted.weights, np.zeros((N_STATES, 2)), atol=1e-12)
    assert not hasattr(model, "mean")


def test_a_large_bias_does_not_drown_small_weights(data):
    """The map is probed with steps that make the weights show beside the bias."""
    states = data[0]
    target = 1e6 + 1e-3 * (states[:, :1] - states[:, :1].mean())
    pipeline = make_pipeline(StandardScaler(), LinearRegression())
    fitted = fit_readout(pipeline, states, target)
    assert fitted.weights[0, 0] == pytest.approx(1e-3 * states[:, 0].std(), rel=1e-6)


def test_what_an_estimator_warns_of_is_passed_on(data):
    unfinished = SGDRegressor(max_iter=1, random_state=0)
    (remark,) = fit_readout(unfinished, data[0], data[1][:, :1]).warnings
    assert remark.startswith("readout: ConvergenceWarning: Maximum number of iteration")
