"""States of files that other programs made, through their importers."""

from pathlib import Path

import numpy as np
import pytest
from sklearn.base import clone

from openprc.errors import MissingData, TaskError
from openprc.hooks.importing import import_file
from openprc.hooks.registry import default_registry
from openprc.reservoir.features.bar_features import BarExtensions, BarStrains
from openprc.reservoir.features.channel_features import Channels
from openprc.reservoir.features.element_features import HingeAngles
from openprc.reservoir.features.node_features import (
    NodeDisplacements,
    NodePositions,
    NodeVelocities,
)
from openprc.reservoir.io.state_loader import StateLoader
from openprc.schema.dihedral import dihedral_angles

DATA = Path(__file__).resolve().parents[2] / "../shared/data"


@pytest.fixture
def imported(tmp_path):
    """Return a function that imports a recorded file and opens it."""
    opened = []

    def load(producer, name, **options):
        path = DATA / producer / name
        if not path.exists():
            pytest.skip(f"the recorded {producer} runs are not beside this checkout")
        if producer not in {item.name for item in default_registry().producers}:
            pytest.skip(f"the plugin for {producer} is not installed")
        missing = options.pop("missing", "error")
        run = import_file(path, tmp_path / "simulation.h5", as_name=producer, options=options)
        loader = StateLoader(run.path, missing=missing)
        opened.append(loader)
        return loader

    yield load
    for loader in opened:
        loader.close()


def check(feature, loader):
    """A feature gives finite states, one named column each, and a clone gives the same."""
    states = feature.transform(loader)
    assert states.shape == (loader.n_frames, len(feature.names(loader)))
    assert np.isfinite(states).all()
    copy = clone(feature).fit(loader)
    np.testing.assert_array_equal(copy.transform(loader), states)
    return states


def test_origami_of_merlin(imported):
    """Stored angles are those of the positions, on the same side of the paper."""
    loader = imported("merlin", "merlin2_kresling_n4b5_disp.mat")
    angles = check(HingeAngles(), loader)
    positions = loader.positions()
    computed = dihedral_angles(positions, loader.trajectory.indices("hinges"))
    np.testing.assert_allclose(np.cos(angles), np.cos(computed), atol=1e-6)
    strains = check(BarStrains(), loader)
    extensions = check(BarExtensions(), loader)
    assert np.sign(strains[-1]).tolist() == np.sign(extensions[-1]).tolist()
    assert np.abs(strains).max() < 0.05
    moved = check(NodeDisplacements(dims=[2]), loader)
    assert not moved[0].any()
    np.testing.assert_allclose(np.abs(moved).max(), np.abs(loader.input_values()).max(), rtol=0.5)
    with pytest.raises(MissingData, match="stores no velocities"):
        loader.velocities()
    with pytest.raises(TaskError, match="velocity depends on how the body remembers"):
        loader.velocities(derive=True)


@pytest.mark.parametrize(
    ("name", "agreement"),
    # The rod that is pulled rings at a period of few frames, which differences flatten.
    [("snake_export", 0.98), ("axial_stretching_full.npz", 0.85)],
)
def test_rods_of_pyelastica(imported, name, agreement):
    loader = imported("pyelastica", name)
    check(NodePositions(dims=[0, 2]) + BarStrains(), loader)
    stored = check(NodeVelocities(), loader)
    derived = np.gradient(loader.positions(), loader.dt, axis=0).reshape(loader.n_frames, -1)
    # Differences over one saved frame follow the velocities that the simulator stored.
    moving = np.abs(stored).max(axis=0) > 1e-3 * np.abs(stored).max()
    r = [np.corrcoef(stored[1:-1, c], derived[1:-1, c])[0, 1] for c in np.flatnonzero(moving)]
    assert np.median(r) > agreement


def test_joints_of_pybullet(imported):
    loader = imported("pybullet", "pendulum5_chain.log")
    states = check(Channels("body0.q") + NodePositions(), loader)
    assert np.ptp(states, axis=0).max() > 0.1
    with pytest.raises(MissingData, match="the file has no bars"):
        BarStrains().transform(loader)


def test_points_of_a_video(imported):
    loader = imported("vision", "mechanism_ffv1.avi", missing="drop")
    assert loader.dims == 2
    feature = NodeDisplacements(origin="first")
    states = feature.transform(loader)
    assert states.shape == (loader.n_frames, len(feature.names(loader)))
    assert feature.names(loader)[:2] == ["node0.x", "node0.y"]
    speeds = NodeVelocities(derive=True).transform(loader)
    inner = (states[2:] - states[:-2]) / (2 * loader.dt)
    np.testing.assert_allclose(speeds[1:-1], inner, atol=1e-9)
