import tracemalloc

import numpy as np
import pytest
from sklearn.ensemble import RandomForestRegressor
from sklearn.linear_model import Ridge as SklearnRidge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from openprc.errors import TaskError
from openprc.reservoir.features.bar_features import BarExtensions
from openprc.reservoir.features.base import Feature
from openprc.reservoir.features.channel_features import Channels
from openprc.reservoir.features.node_features import NodeDisplacements, NodePositions
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.readout.ridge import Ridge
from openprc.reservoir.readout.temporal_ridge import TemporalRidgeCV
from openprc.reservoir.training.streamed import train_streamed
from openprc.reservoir.training.trainer import Trainer
from openprc.schema import Provenance, TrajectoryWriter

N_NODES, N_FRAMES = 40, 12_000


def write_body(path, *, n_frames, gaps=()):
    """Write nodes that move by a millimetre about places metres apart."""
    rng = np.random.default_rng(0)
    places = rng.normal(size=(N_NODES, 3))
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_nodes(N_NODES, 3, unit="m", observed=bool(gaps))
        for start in range(0, n_frames, 1000):
            frames = np.arange(start, min(start + 1000, n_frames))
            positions = places + 1e-3 * rng.normal(size=(len(frames), N_NODES, 3))
            observed = np.ones((len(frames), N_NODES), dtype="u1")
            observed[np.isin(frames, gaps), 3] = 0
            positions[observed == 0] = np.nan
            masks = {"observed": observed} if gaps else {}
            writer.append(frames * 0.01, positions=positions, **masks)
    return path


def same(trainer, target, *, unique=True, **keywords):
    """Check that both ways of training agree, and return the streamed one.

    Where states are copies of each other, weights may be shared out in many ways.
    """
    whole, streamed = trainer.train(target, "task"), train_streamed(trainer, target, **keywords)
    for name in ("train_rows", "test_rows"):
        np.testing.assert_array_equal(
            getattr(streamed.evaluation, name), getattr(whole.evaluation, name)
        )
    size = np.abs(whole.weights).max()
    if unique:
        np.testing.assert_allclose(streamed.weights, whole.weights, rtol=0, atol=1e-12 * size)
    np.testing.assert_allclose(streamed.evaluation.prediction, whole.evaluation.prediction,
                               rtol=0, atol=1e-12 * np.abs(target).max())  # fmt: skip
    assert streamed.nmse == pytest.approx(whole.nmse, rel=1e-11)
    assert streamed.feature_names == whole.feature_names
    assert streamed.warnings == whole.warnings
    return streamed


def test_memory_stays_that_of_a_few_blocks(tmp_path):
    """States of 11.5 MB: blocks of 500 frames are 0.5 MB, what has a value per row 0.1 MB."""
    path = write_body(tmp_path / "long.h5", n_frames=N_FRAMES)
    target = np.random.default_rng(1).normal(size=N_FRAMES)
    with StateLoader(path) as loader:
        trainer = Trainer(NodeDisplacements(), Ridge(1e-3), loader=loader, washout=10.0,
                          train_duration=80.0, test_duration=25.0)  # fmt: skip
        train_streamed(trainer, target, block_frames=500)
        peaks = []
        for train in (lambda: train_streamed(trainer, target, block_frames=500),
                      lambda: trainer.train(target)):  # fmt: skip
            tracemalloc.start()
            train()
            peaks.append(tracemalloc.get_traced_memory()[1] / 1e6)
            tracemalloc.stop()
        states_mb = N_FRAMES * N_NODES * 3 * 8 / 1e6
        assert peaks[0] < 4.0 < states_mb < peaks[1]
        same(trainer, target, block_frames=500)


@pytest.mark.parametrize("block_frames", [7, 64, 10_000])
@pytest.mark.parametrize(
    "features", [NodePositions(dims=[2]), NodeDisplacements(origin="first")], ids=repr
)
def test_blocks_of_any_length(tmp_path, features, block_frames):
    path = write_body(tmp_path / "short.h5", n_frames=300)
    target = np.random.default_rng(2).normal(size=(300, 2))
    with StateLoader(path) as loader:
        trainer = Trainer(features, Ridge(1e-3), loader=loader, washout=0.1, train_duration=2.0,
                          test_duration=0.8)  # fmt: skip
        same(trainer, target, block_frames=block_frames)


def test_rows_that_were_not_measured_are_left_out(tmp_path):
    path = write_body(tmp_path / "gaps.h5", n_frames=600, gaps=(0, 17, 128, 129, 550))
    target = np.random.default_rng(3).normal(size=600)
    with StateLoader(path, missing="drop") as loader:
        trainer = Trainer(NodePositions(), Ridge(1e-3), loader=loader, washout=0.0,
                          train_duration=5.0, test_duration=1.0)  # fmt: skip
        result = same(trainer, target, block_frames=64)
        assert "5 rows have missing samples and were left out" in result.warnings


def test_symbols_with_several_samples(delay_line):
    with StateLoader(delay_line) as loader:
        u = loader.symbols().sequence[:, 0]
        for readout in (Ridge(1e-3), SklearnRidge(1e-3), TemporalRidgeCV([1e-3, 1.0], gap=8)):
            trainer = Trainer(Channels(), readout, loader=loader, washout=1.0, train_duration=9.0,
                              test_duration=4.0, samples_per_symbol=2)  # fmt: skip
            same(trainer, np.roll(u, 3) + u**2, unique=False, block_frames=33)


def test_bars_of_the_body(make_body):
    with StateLoader(make_body(n_frames=200, rest_lengths=False, stored_lengths=True)) as loader:
        trainer = Trainer([BarExtensions(), NodePositions(dims=[2])], Ridge(1e-3), loader=loader,
                          washout=0.1, train_duration=1.0, test_duration=0.8)  # fmt: skip
        same(trainer, loader.positions()[:, 2, 2] ** 3, unique=False, block_frames=16)


class Delayed(Feature):
    """Looks five frames back."""

    def config(self):
        return {"type": "Delayed"}

    def _transform(self, loader):
        return np.roll(loader.positions()[:, 1:, 1], 5, axis=0)

    def _names(self, loader):
        return [f"node{k}.y[k-5]" for k in range(1, 3)]


def test_features_that_look_further_are_found_out(make_body):
    with StateLoader(make_body(n_frames=200)) as loader:
        trainer = Trainer(Delayed(), Ridge(1e-3), loader=loader, washout=0.1, train_duration=1.0,
                          test_duration=0.8)  # fmt: skip
        target = np.roll(loader.positions()[:, 1, 1], 3)
        with pytest.raises(TaskError, match="gives other states when it reads other blocks"):
            train_streamed(trainer, target, block_frames=32)
        same(trainer, target, block_frames=32, context=5)


@pytest.mark.parametrize(
    ("keywords", "words"),
    [
        ({"readout": RandomForestRegressor()}, "RandomForestRegressor, needs all states at once"),
        ({"features": make_pipeline(NodePositions(), StandardScaler())}, "learns from the states"),
        ({"block_frames": 0}, "block_frames is 0 and context is 1"),
        ({"context": -1}, "block_frames is 4096 and context is -1"),
    ],
)
def test_what_cannot_be_streamed(make_body, keywords, words):
    features = keywords.pop("features", NodePositions())
    readout = keywords.pop("readout", Ridge())
    with StateLoader(make_body()) as loader:
        trainer = Trainer(features, readout, loader=loader, washout=0.0, train_duration=0.2,
                          test_duration=0.2)  # fmt: skip
        with pytest.raises(TaskError, match=words):
            train_streamed(trainer, np.arange(40.0), **keywords)
