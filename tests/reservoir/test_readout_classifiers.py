import numpy as np
import pytest
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import RandomForestClassifier
from sklearn.linear_model import LogisticRegression, Perceptron, RidgeClassifier, SGDClassifier
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler
from sklearn.svm import SVC, LinearSVC

from openprc.errors import TaskError
from openprc.reservoir.features.channel_features import Channels
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.readout.classifier import sequence_states
from openprc.reservoir.readout.fitting import fit_readout
from openprc.reservoir.readout.ridge import Ridge
from openprc.reservoir.readout.saved import Readout
from openprc.reservoir.training.evaluation import evaluate
from openprc.reservoir.training.row_split import RowSplit
from openprc.reservoir.training.trainer import Trainer
from openprc.schema import results

LINEAR = [
    LogisticRegression(),
    RidgeClassifier(),
    LinearDiscriminantAnalysis(),
    LinearSVC(random_state=0),
    SGDClassifier(random_state=0),
    Perceptron(random_state=0),
    make_pipeline(StandardScaler(), LogisticRegression()),
]
OTHERS = [
    GaussianNB(),
    KNeighborsClassifier(3),
    RandomForestClassifier(20, random_state=0),
    SVC(),
    make_pipeline(PolynomialFeatures(2), LogisticRegression()),
]


def clouds(n_classes, n=240, *, seed=0):
    """Return states (n, 3), a cloud for each class, and their numbers (n,)."""
    rng = np.random.default_rng(seed)
    labels = rng.integers(n_classes, size=n)
    centres = 6.0 * np.eye(3)[:n_classes] + 100.0
    return centres[labels] + rng.normal(size=(n, 3)), labels


@pytest.mark.parametrize("n_classes", [2, 3])
@pytest.mark.parametrize("estimator", [*LINEAR, *OTHERS], ids=lambda e: type(e).__name__)
def test_labels_in_labels_out(estimator, n_classes):
    states, numbers = clouds(n_classes)
    names = np.array(["walk", "rest", "jump"])[numbers]
    for labels in (names, numbers * 10 - 10, names.astype(object), numbers.astype(float)):
        result = evaluate(
            estimator, states, labels, split=RowSplit(washout=0, train=160, test=80)
        ) if labels.dtype.kind != "O" and labels.dtype.kind != "f" else None  # fmt: skip
        if result is None:
            fitted = fit_readout(estimator, states, labels)
            assert (fitted.train_prediction.astype(labels.dtype) == labels).mean() > 0.95
            continue
        assert result.classification.accuracy > 0.95
        assert result.classification.confusion.sum() == 80
        assert result.classification.majority < 0.8
        assert result.prediction.dtype.kind == labels.dtype.kind
        assert (result.fitted.weights is not None) == (estimator in LINEAR)
        if estimator in LINEAR:
            assert result.fitted.weights.shape == (3, 1 if n_classes == 2 else 3)


@pytest.mark.parametrize("estimator", LINEAR, ids=lambda e: type(e).__name__)
def test_weights_name_the_classes_that_the_estimator_names(estimator):
    states, numbers = clouds(3, 600, seed=1)
    states += np.random.default_rng(2).normal(size=states.shape) * 3.0
    fitted = fit_readout(estimator, states[:300], numbers[:300])
    own = fitted.estimator.predict(fitted.standardizer.transform(states[300:]))
    assert 0.5 < (own == numbers[300:]).mean() < 1.0
    np.testing.assert_array_equal(fitted.predict(states[300:]), own)


@pytest.fixture
def trainer(delay_line, tmp_path):
    """Return a function that makes a trainer with a given readout on eight delay taps."""
    loader = StateLoader(delay_line)

    def make(readout):
        return Trainer(Channels(), readout, loader=loader, experiment_dir=tmp_path, washout=1.0,
                       train_duration=9.0, test_duration=4.0)  # fmt: skip

    yield make
    loader.close()


def test_sign_of_an_earlier_symbol(trainer):
    """A linear classifier of delay taps tells signs apart; stored, it still does."""
    machine = trainer(LogisticRegression(C=1e4))
    u = machine.loader.symbols().sequence[:, 0]
    labels = np.where(np.roll(u, 3) > 0, "up", "down")
    result = machine.train(labels, "sign")
    assert result.accuracy > 0.95
    assert result.symbol_error_rate == pytest.approx(1.0 - result.accuracy)
    time, target, named = result.cache["test"]
    assert time.shape == target.shape == named.shape == (80,)
    assert (target == named).mean() == result.accuracy
    assert result.confusion.sum() == 80
    path = result.save()
    stored = results.read_result(path)
    assert stored.attrs["accuracy"] == result.accuracy
    assert stored.attrs["majority_accuracy"] < 0.7
    assert "NMSE" not in stored.attrs
    assert list(stored.array("model/classes")) == ["down", "up"]
    np.testing.assert_array_equal(stored.array("validation/confusion"), result.confusion)
    readout = Readout.load(path)
    states = machine.states.values[result.evaluation.test_rows]
    np.testing.assert_array_equal(readout.predict(states), named)


def test_numbers_and_labels_are_asked_for_differently(trainer):
    machine = trainer(LogisticRegression())
    u = machine.loader.symbols().sequence[:, 0]
    result = machine.train(np.sign(u), "sign")
    with pytest.raises(TaskError, match="labels have no mean squared error"):
        _ = result.nmse
    with pytest.raises(TaskError, match="labels have no mean squared error"):
        _ = result.nrmse
    with pytest.raises(TaskError, match="the readout is a regressor"):
        _ = trainer(Ridge()).train(u, "now").accuracy


@pytest.mark.parametrize(
    ("readout", "target", "words"),
    [
        (Ridge(), np.full(300, "a"), "the target is text and the readout, Ridge, is no classifier"),
        (RidgeClassifier(), np.linspace(0, 1, 300), "numbers that are not whole"),
        (RidgeClassifier(), np.full(300, np.nan), "numbers that are not whole"),
        (RidgeClassifier(), np.zeros((300, 2), int), r"the labels have shape \(300, 2\)"),
        (RidgeClassifier(), np.zeros(7, int), "the length is 7"),
        (RidgeClassifier(), np.zeros(300, complex), "the labels are of type complex128"),
    ],
)
def test_targets_that_are_no_labels(trainer, readout, target, words):
    with pytest.raises(TaskError, match=words):
        trainer(readout).train(target, "task")


def test_one_row_for_each_sequence():
    rng = np.random.default_rng(3)
    sequences = [rng.normal(size=(n, 2)) for n in (5, 7, 4)]
    np.testing.assert_allclose(
        sequence_states(sequences, washout=2), [s[2:].mean(axis=0) for s in sequences]
    )
    np.testing.assert_array_equal(
        sequence_states(sequences, summary="last"), [s[-1] for s in sequences]
    )
    equal = rng.normal(size=(6, 5, 2))
    np.testing.assert_array_equal(
        sequence_states(equal, summary="flatten", washout=1), equal[:, 1:].reshape(6, 8)
    )


def test_sequences_are_told_apart_by_their_mean():
    """Slow and fast sines through a leaky integrator: one row per sequence, any classifier."""
    rng = np.random.default_rng(4)
    fast = rng.random(120) < 0.5
    phases = rng.uniform(0, 2 * np.pi, 120)
    u = np.sin(np.where(fast, 1.2, 0.2)[:, None] * np.arange(60) + phases[:, None])
    states = np.zeros((120, 60, 1))
    for k in range(1, 60):
        states[:, k, 0] = 0.7 * states[:, k - 1, 0] + 0.3 * u[:, k]
    rows = sequence_states(states**2, washout=10)
    split = RowSplit(washout=0, train=80, test=40)
    labels = np.where(fast, "fast", "slow")
    assert evaluate(LogisticRegression(), rows, labels, split=split).classification.accuracy == 1.0


@pytest.mark.parametrize(
    ("keywords", "words"),
    [
        ({"summary": "median"}, "summary is 'median'"),
        ({"washout": 5}, r"sequence 1 has states of shape \(0, 2\)"),
        ({"summary": "flatten"}, "sequences have 5 to 6 rows"),
    ],
)
def test_sequences_that_cannot_be_rows(keywords, words):
    with pytest.raises(TaskError, match=words):
        sequence_states([np.zeros((6, 2)), np.zeros((5, 2))], **keywords)
