"""A readout that the older package trained, and stored with its states and targets."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from openprc.reservoir.features.node_features import NodePositions
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.readout.ridge import Ridge
from openprc.reservoir.training.trainer import Trainer
from openprc.schema import Provenance, TrajectoryWriter
from openprc.schema.legacy import LegacyImporter

RUN = Path(__file__).resolve().parents[2] / "../shared/data/upstream/lattice_3x3_gen0"


@pytest.mark.skipif(not RUN.exists(), reason="recorded upstream runs are not at hand")
def test_the_recorded_prediction_is_reproduced(tmp_path):
    """Same file, same spans, same penalty: 5 s washout, 20 s training, 5 s test, 1e-5.

    That package scaled by all rows, training or not, so weights differ while predictions agree
    as far as the penalty is weak.
    """
    with h5py.File(RUN / "readout" / "readout_narma2.h5") as file:
        target = np.zeros(3001)
        target[500:2500] = file["training/target"][()]
        target[2500:3000] = file["validation/target"][()]
        recorded = file["validation/prediction"][()]
        mean, scale = file["preprocessing/X_mean"][()], file["preprocessing/X_scale"][()]
        states = file["validation/input"][:, 1:] * scale + mean
    path = tmp_path / "lattice.h5"
    with TrajectoryWriter(path, provenance=Provenance("legacy"), on_failure="discard") as writer:
        source = RUN / "output" / "simulation.h5"
        LegacyImporter().import_run(source, writer, options={"unit": None})
    with StateLoader(path) as loader:
        trainer = Trainer(NodePositions(), Ridge(1e-5), loader=loader, washout=5.0,
                          train_duration=20.0, test_duration=5.0)  # fmt: skip
        result = trainer.train(target, "narma2")
        np.testing.assert_allclose(trainer.states.values[2500:3000], states, atol=1e-8)
    _, wanted, prediction = result.cache["test"]
    spread = wanted.std()
    np.testing.assert_allclose(prediction, recorded, atol=1e-4 * spread)
    assert result.nrmse == pytest.approx(
        np.sqrt(np.mean((wanted - recorded) ** 2)) / spread, abs=1e-5
    )
