"""Trajectory features as scikit-learn transformers, with a loader as X."""

import subprocess
import sys

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.decomposition import PCA
from sklearn.pipeline import FeatureUnion, Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler

from openprc.errors import TaskError
from openprc.reservoir.features.bar_features import BarExtensions, BarLengths, BarStrains
from openprc.reservoir.features.base import Stacked
from openprc.reservoir.features.channel_features import Channels
from openprc.reservoir.features.element_features import ElementSeries, HingeAngles
from openprc.reservoir.features.input_features import Inputs
from openprc.reservoir.features.node_features import (
    NodeDisplacements,
    NodePositions,
    NodeVelocities,
)
from openprc.reservoir.io.state_loader import StateLoader

FEATURES = [
    NodePositions(dims=[2]),
    NodeDisplacements(reference_node=0, dims=[2]),
    NodeVelocities(np.array([1, 2]), derive=True),
    BarLengths([1]),
    BarExtensions(origin="first"),
    BarStrains(),
    HingeAngles([0, 3]),
    ElementSeries("bars", "length", element_ids=[0]),
    Channels("taps"),
    Inputs(0, dof="z"),
    Stacked([NodePositions(), BarLengths()]),
]
READABLE = [f for f in FEATURES if not isinstance(f, HingeAngles | Channels)]


@pytest.fixture
def loader(make_body):
    with StateLoader(make_body(stored_lengths=True)) as opened:
        yield opened


@pytest.mark.parametrize("feature", FEATURES, ids=repr)
def test_settings_go_round(feature):
    copy = clone(feature)
    assert copy is not feature
    assert copy.config() == feature.config()
    assert repr(copy) == repr(feature)
    params = feature.get_params()
    assert copy.set_params(**params) is copy
    for name, value in params.items():
        assert getattr(feature, name) is value
    with pytest.raises(TaskError, match=f"{type(feature).__name__} has no setting 'colour'"):
        copy.set_params(colour=1)


@pytest.mark.parametrize("feature", READABLE, ids=repr)
def test_fit_and_transform(feature, loader):
    fresh = clone(feature)
    with pytest.raises(TaskError, match="was not fitted, so its columns are not known"):
        fresh.get_feature_names_out()
    assert fresh.fit(loader) is fresh
    names = fresh.get_feature_names_out()
    assert names.dtype == object
    assert names.tolist() == feature.names(loader)
    together = clone(feature).fit_transform(loader)
    np.testing.assert_array_equal(together, feature.transform(loader))
    assert together.shape == (loader.n_frames, len(names))
    # Settings are what the constructor was given; what was learned stays behind.
    assert not hasattr(clone(fresh), "feature_names_out_")


def test_first_in_a_pipeline(loader):
    pipeline = Pipeline([("nodes", NodePositions([1, 2])), ("scale", StandardScaler())])
    states = pipeline.fit_transform(loader)
    expected = StandardScaler().fit_transform(NodePositions([1, 2]).transform(loader))
    np.testing.assert_allclose(states, expected, atol=1e-14)
    np.testing.assert_array_equal(pipeline.transform(loader), states)
    assert pipeline.get_feature_names_out().tolist() == NodePositions([1, 2]).names(loader)
    assert clone(pipeline).set_params(nodes__dims=[1]).fit_transform(loader).shape == (40, 2)


def test_side_by_side_in_a_union(loader):
    union = FeatureUnion([("nodes", NodePositions(dims=[1])), ("bars", BarLengths())])
    states = union.fit_transform(loader)
    by_hand = (NodePositions(dims=[1]) + BarLengths()).transform(loader)
    np.testing.assert_array_equal(states, by_hand)
    assert union.get_feature_names_out().tolist() == [
        "nodes__node0.y", "nodes__node1.y", "nodes__node2.y", "bars__bar0", "bars__bar1",
    ]  # fmt: skip
    reduced = make_pipeline(union, PCA(1)).fit_transform(loader)
    assert reduced.shape == (40, 1)


def test_features_add_up():
    total = NodePositions() + BarLengths() + (Inputs() + BarStrains())
    assert [type(f).__name__ for f in total.features] == [
        "NodePositions", "BarLengths", "Inputs", "BarStrains",
    ]  # fmt: skip
    with pytest.raises(TypeError):
        NodePositions() + 1


def test_tables_are_refused_clearly(loader):
    feature = NodePositions()
    assert feature.set_output(transform="default") is feature
    assert make_pipeline(feature, StandardScaler()).set_output(transform="default")
    with pytest.raises(TaskError, match="set_output asks for 'pandas'"):
        make_pipeline(feature, StandardScaler()).set_output(transform="pandas")


def test_a_matrix_is_no_file():
    with pytest.raises(TaskError, match="BarLengths was given ndarray"):
        BarLengths().transform(np.zeros((3, 2)))


def test_a_pipeline_inside_a_stack_needs_a_trainer(loader):
    stack = Stacked([NodePositions(), make_pipeline(BarLengths(), PCA(1))])
    with pytest.raises(TaskError, match="Pipeline is no feature: it has no names"):
        stack.transform(loader)


def test_settings_are_plain_values():
    config = NodePositions(np.array([1, 2]), (0,)).config()
    assert config == {
        "type": "NodePositions", "node_ids": [1, 2], "dims": [0], "reference_node": None,
    }  # fmt: skip


def test_features_do_not_import_scikit_learn():
    code = (
        "import sys\n"
        "import openprc.reservoir.features.node_features as n\n"
        "import openprc.reservoir.features.bar_features, openprc.reservoir.features.base\n"
        "import openprc.reservoir.features.element_features as e\n"
        "import openprc.reservoir.features.input_features, openprc.reservoir.training.states\n"
        "(n.NodePositions() + e.HingeAngles()).get_params()\n"
        "print([m for m in ('sklearn', 'scipy', 'matplotlib') if m in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
