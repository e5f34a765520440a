"""Pipelines on the rows of a clock: what learns, learns from the training rows only."""

import numpy as np
import pytest
from sklearn.cross_decomposition import PLSRegression
from sklearn.decomposition import PCA
from sklearn.feature_selection import SelectKBest
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import FeatureUnion, Pipeline, make_pipeline
from sklearn.preprocessing import FunctionTransformer, StandardScaler

from openprc.errors import TaskError
from openprc.reservoir.features.base import Stacked, feature_config
from openprc.reservoir.features.channel_features import Channels
from openprc.reservoir.features.delay_taps import DelayTaps
from openprc.reservoir.features.input_features import Inputs
from openprc.reservoir.features.node_features import NodePositions
from openprc.reservoir.features.polynomial_expansion import PolynomialExpansion
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.training.row_clock import row_clock
from openprc.reservoir.training.row_split import RowSplit
from openprc.reservoir.training.states import build_states

SPLIT = RowSplit(washout=20, train=180, test=80)


@pytest.fixture
def build(delay_line):
    """Return a function from features to states on the symbols of the delay line."""
    with StateLoader(delay_line) as loader:

        def states(features, *, split=SPLIT, **clock):
            return build_states(features, loader, rows=row_clock(loader, **clock), split=split)

        states.symbols = loader.symbols().sequence[:, 0]
        yield states


def test_a_feature_alone(build):
    states = build(Channels())
    assert states.values.shape == (300, 8)
    assert states.usable.all()
    np.testing.assert_array_equal(states.values[:, 0], build.symbols)


def test_taps_count_rows_and_not_frames(build):
    states = build(make_pipeline(Inputs(), DelayTaps(3)))
    assert states.names == ("drive.u", "drive.u[k-1]", "drive.u[k-2]")
    u = build.symbols
    np.testing.assert_array_equal(states.values[2:], np.stack([u[2:], u[1:-1], u[:-2]], axis=1))
    assert states.usable.tolist() == [False] * 2 + [True] * 298


def test_taps_of_the_input_are_the_delay_line(build):
    """Eight taps of the input in software and in the body are the same states."""
    tapped = build(make_pipeline(Inputs(), DelayTaps(8)))
    np.testing.assert_array_equal(tapped.values[8:], build(Channels()).values[8:])


def test_the_washout_has_to_cover_the_history(build):
    pipeline = make_pipeline(Inputs(), DelayTaps(4, spacing=7))
    with pytest.raises(TaskError) as caught:
        build(pipeline)
    text = str(caught.value)
    assert "with DelayTaps(n_taps=4, spacing=7) states need 21 rows of history" in text
    assert "the washout is 20 rows" in text
    assert build(pipeline, split=RowSplit(washout=21, train=100, test=100)).usable[21:].all()


def test_histories_add_up(build):
    pipeline = make_pipeline(Inputs(), DelayTaps(12), StandardScaler(), DelayTaps(12))
    with pytest.raises(TaskError, match="need 22 rows of history"):
        build(pipeline)


def test_the_pipeline_of_the_guide(build):
    pipeline = Pipeline(
        [
            ("states", Channels()),
            ("taps", DelayTaps(3)),
            ("poly", PolynomialExpansion(2)),
            ("pca", PCA(5)),
        ]
    )
    states = build(pipeline)
    assert states.values.shape == (300, 5)
    assert states.names == ("pca0", "pca1", "pca2", "pca3", "pca4")
    taps = DelayTaps(3).fit_transform(build(Channels()).values)
    expanded = PolynomialExpansion(2).fit_transform(taps[2:])
    by_hand = PCA(5).fit(expanded[18:198]).transform(expanded)
    np.testing.assert_allclose(states.values[2:], by_hand, atol=1e-10)
    # The user's own objects stay as they were.
    assert not hasattr(pipeline.named_steps["pca"], "components_")
    assert not hasattr(pipeline.named_steps["states"], "feature_names_out_")


def test_nothing_is_learned_outside_the_training_rows(build):
    """A scaler and PCA see the training rows and no others, bit for bit."""
    seen = []

    class Witness(StandardScaler):
        def fit(self, X, y=None):
            seen.append(X.copy())
            return super().fit(X, y)

    states = build(make_pipeline(Channels(), Witness(), PCA(2)))
    np.testing.assert_array_equal(seen, build(Channels()).values[None, 20:200])
    scaled = StandardScaler().fit(seen[0])
    plane = PCA(2).fit(scaled.transform(seen[0]))
    expected = plane.transform(scaled.transform(build(Channels()).values))
    np.testing.assert_allclose(states.values, expected, atol=1e-12)


def test_rows_that_were_not_measured_are_neither_learned_from_nor_filled(make_body):
    path = make_body(n_frames=80, gaps={1: [5, 30, 70]}, rest=False)
    pipeline = make_pipeline(NodePositions([1, 2]), StandardScaler(), DelayTaps(2))
    with StateLoader(path, missing="drop") as loader:
        states = build_states(
            pipeline, loader, rows=row_clock(loader), split=RowSplit(washout=1, train=40, test=39)
        )
        raw = NodePositions([1, 2]).transform(loader)
    assert np.flatnonzero(~states.usable).tolist() == [0, 5, 6, 30, 31, 70, 71]
    measured = np.delete(np.arange(1, 41), [4, 29])
    np.testing.assert_allclose(states.values[7, 5], (raw[7, 5] - raw[measured, 5].mean())
                               / raw[measured, 5].std())  # fmt: skip


def test_branches(build):
    union = FeatureUnion(
        [
            ("now", Channels()),
            ("input", make_pipeline(Inputs(), DelayTaps(2))),
            ("off", "drop"),
        ],
        transformer_weights={"input": 3.0},
    )
    states = build(union)
    assert states.values.shape == (300, 10)
    assert states.names[-2:] == ("input__drive.u", "input__drive.u[k-1]")
    np.testing.assert_array_equal(states.values[1:, -1], 3.0 * build.symbols[:-1])
    inner = FeatureUnion(
        [("same", "passthrough"), ("squared", make_pipeline(PolynomialExpansion(2), PCA(1)))],
        verbose_feature_names_out=False,
    )
    states = build(make_pipeline(Channels(), "passthrough", inner))
    assert states.names[-2:] == ("taps.d7", "pca0")
    stacked = build(Stacked([Channels(), make_pipeline(Inputs(), DelayTaps(2))]))
    assert stacked.names[-2:] == ("drive.u", "drive.u[k-1]")


def test_virtual_nodes_go_through_the_pipeline(build):
    states = build(make_pipeline(Channels(), StandardScaler()), samples_per_symbol=5)
    assert states.values.shape == (300, 40)
    assert states.names[0] == "taps.d0@1/5"
    assert np.abs(states.values[20:200].mean(axis=0)).max() < 1e-12


def test_steps_without_names_are_numbered(build):
    states = build(Pipeline([("c", Channels()), ("half", FunctionTransformer(lambda x: x / 2))]))
    assert states.names == tuple(f"half{i}" for i in range(8))


@pytest.mark.parametrize(
    ("features", "words"),
    [
        (make_pipeline(StandardScaler(), PCA(2)), "StandardScaler does not read a file"),
        (make_pipeline(Channels(), LinearRegression()), "LinearRegression, has no transform"),
        (make_pipeline(Channels(), SelectKBest(k=2)), "SelectKBest, learns from the target"),
        (make_pipeline(Channels(), PLSRegression()), "PLSRegression, learns from the target"),
        (FeatureUnion([("a", "drop")]), "every part is dropped"),
        (
            make_pipeline(Channels(), FunctionTransformer(lambda x: x + np.inf)),
            "state 'functiontransformer0' is infinite",
        ),
        (
            make_pipeline(Channels(), FunctionTransformer(lambda x: x + np.nan)),
            "'functiontransformer', FunctionTransformer, makes NaN of states that were measured",
        ),
    ],
    ids=["no feature", "predictor", "supervised", "regression", "empty", "infinite", "nan"],
)
def test_what_is_no_pipeline_of_states(build, features, words):
    with pytest.raises(TaskError, match=words):
        build(features)


def test_settings_of_a_pipeline_are_plain_values():
    config = feature_config(Pipeline([("n", NodePositions(dims=[2])), ("p", PCA(3))]))
    assert config["type"] == "Pipeline"
    assert config["steps"][0]["dims"] == [2]
    assert config["steps"][1]["settings"]["n_components"] == 3
