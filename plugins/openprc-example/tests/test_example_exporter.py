"""The XYZ exporter, the feature, and the code of the README."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from openprc_example.features import NodeSpeeds

from openprc.errors import ConfigError, MissingData
from openprc.hooks import export_file
from openprc.schema import Provenance, Trajectory, TrajectoryWriter


def write_run(path, positions, *, observed=None):
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_nodes(
            positions.shape[1], positions.shape[2], unit="mm", observed=observed is not None
        )
        writer.append(0.1 * np.arange(len(positions)), positions=positions, observed=observed)
    return path


def read_xyz(path):
    """Return times and positions of an extended XYZ file, by the description of the format."""
    lines, times, frames = path.read_text().splitlines(), [], []
    while lines:
        count = int(lines[0])
        times.append(float(re.search(r"Time=(\S+)", lines[1])[1]))
        assert "Properties=species:S:1:pos:R:3" in lines[1]
        frames.append([[float(cell) for cell in line.split()[1:]] for line in lines[2 : count + 2]])
        lines = lines[count + 2 :]
    return np.array(times), np.array(frames)


@pytest.mark.parametrize(("dims", "stride"), [(3, 1), (3, 4), (2, 1)])
def test_every_number_comes_back(tmp_path, dims, stride):
    positions = np.random.default_rng(1).normal(size=(9, 5, dims))
    run = write_run(tmp_path / "a.h5", positions)
    (made,) = export_file(run, tmp_path / "a.xyz", options={"stride": stride, "species": "C"})
    times, found = read_xyz(made)
    np.testing.assert_array_equal(times, 0.1 * np.arange(9)[::stride])
    np.testing.assert_array_equal(found[:, :, :dims], positions[::stride])
    assert not found[:, :, dims:].any()
    assert made.read_text().splitlines()[2].startswith("C ")


def test_what_the_format_cannot_say_is_refused(tmp_path):
    positions = np.zeros((3, 2, 2))
    observed = np.ones((3, 2), "u1")
    positions[1, 1], observed[1, 1] = np.nan, 0
    run = write_run(tmp_path / "a.h5", positions, observed=observed)
    with pytest.raises(MissingData, match="node 1 is missing in frame 1"):
        export_file(run, tmp_path / "a.xyz")
    with pytest.raises(ConfigError, match="species is 'two words'"):
        export_file(run, tmp_path / "a.xyz", options={"species": "two words"})
    with pytest.raises(ConfigError, match="stride is 0"):
        export_file(run, tmp_path / "a.xyz", options={"stride": 0})
    with TrajectoryWriter(tmp_path / "c.h5", provenance=Provenance("test")) as writer:
        writer.declare_channel("light", ["light"], unit="arb")
        writer.append([0.0, 1.0], channels={"light": [[1.0], [2.0]]})
    with pytest.raises(MissingData, match="no positions"):
        export_file(tmp_path / "c.h5", tmp_path / "a.xyz")
    assert sorted(item.name for item in tmp_path.iterdir()) == ["a.h5", "c.h5"]


def test_node_speeds(tmp_path):
    """On circular motion of radius r and rate w the speed is r w, up to (w h)^2 / 6."""
    t = np.arange(200) * 0.01
    radius = np.array([1.0, 2.0])
    phase = 3.0 * t[:, None]
    positions = radius[:, None] * np.stack([np.cos(phase), np.sin(phase)], axis=-1)
    with TrajectoryWriter(tmp_path / "a.h5", provenance=Provenance("test")) as writer:
        writer.declare_nodes(2, 2, unit="m", observed=True)
        observed = np.ones((200, 2), "u1")
        observed[50, 1], positions[50, 1] = 0, np.nan
        writer.append(t, positions=positions, observed=observed)
    with Trajectory(tmp_path / "a.h5") as run:
        speeds = NodeSpeeds().transform(run)
        assert NodeSpeeds().names(run) == ["speed of node 0", "speed of node 1"]
    np.testing.assert_allclose(speeds[1:-1, 0], 3.0, rtol=2e-4)
    # One missing place takes its own frame and the two beside it, and no more.
    assert np.flatnonzero(np.isnan(speeds[:, 1])).tolist() == [49, 50, 51]
    np.testing.assert_allclose(speeds[[10, 60], 1], 6.0, rtol=2e-4)


def test_code_of_the_readme_runs(tmp_path, monkeypatch):
    text = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, flags=re.S)
    assert len(blocks) == 4
    monkeypatch.chdir(tmp_path)
    scope: dict[str, object] = {"__name__": "readme"}
    for block in blocks:
        exec(compile(block, "README.md", "exec"), scope)
