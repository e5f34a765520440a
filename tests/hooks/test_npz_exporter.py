"""The npz exporter: every array comes back from `numpy.load`, with its unit."""

from __future__ import annotations

import json

import numpy as np
import pytest

from openprc.errors import ConfigError
from openprc.hooks import export_file
from openprc.schema import Provenance, TrajectoryWriter

N_FRAMES = 2500  # more than two blocks


@pytest.fixture(scope="module")
def truth():
    rng = np.random.default_rng(3)
    observed = np.ones((N_FRAMES, 3), "u1")
    observed[7, 1] = 0
    positions = rng.normal(size=(N_FRAMES, 3, 2))
    positions[7, 1] = np.nan
    return {
        "time": 0.01 * np.arange(N_FRAMES),
        "positions": positions,
        "velocities": np.where(np.isnan(positions), np.nan, 2.0 * positions),
        "observed": observed,
        "bars/force": rng.normal(size=(N_FRAMES, 2)),
        "channels/gauge": rng.normal(size=(N_FRAMES, 2)),
        "system/energy": rng.normal(size=N_FRAMES),
        "inputs/u": rng.normal(size=(N_FRAMES, 1)),
    }


@pytest.fixture(scope="module")
def run(truth, tmp_path_factory):
    path = tmp_path_factory.mktemp("npz") / "run.h5"
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_nodes(
            3, 2, unit="mm", velocities=True, observed=True, mass=[1.0, 2.0, 3.0], mass_unit="g",
            labels=["a", "b", "c"], fixed=[True, False, False],
        )  # fmt: skip
        writer.declare_elements(
            "bars", [[0, 1], [1, 2]], series={"force": "mN"},
            static={"rest_length": ([1.0, 2.0], "mm")},
        )  # fmt: skip
        writer.declare_channel("gauge", ["left", "right"], unit="mV")
        writer.declare_system("energy", unit="J")
        writer.declare_input(
            "u", ["u"], quantity="force", unit="N", sequence=[[1.0], [2.0]], hold=0.5
        )
        writer.append(
            truth["time"],
            positions=truth["positions"],
            velocities=truth["velocities"],
            observed=truth["observed"],
            elements={("bars", "force"): truth["bars/force"]},
            channels={"gauge": truth["channels/gauge"]},
            system={"energy": truth["system/energy"]},
            inputs={"u": truth["inputs/u"]},
        )
    return path


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize("stride", [1, 7])
def test_everything_comes_back(run, truth, tmp_path, stride, compress):
    (made,) = export_file(
        run, tmp_path / "run.npz", options={"stride": stride, "compress": compress}
    )
    with np.load(made, allow_pickle=False) as found:
        for name, values in truth.items():
            np.testing.assert_array_equal(found[name], values[::stride], err_msg=name)
        assert found["nodes/mass"].tolist() == [1.0, 2.0, 3.0]
        assert found["nodes/label"].tolist() == ["a", "b", "c"]
        assert found["nodes/fixed"].tolist() == [1, 0, 0]
        assert found["bars/indices"].tolist() == [[0, 1], [1, 2]]
        assert found["bars/rest_length"].tolist() == [1.0, 2.0]
        assert found["inputs/u/sequence"].tolist() == [[1.0], [2.0]]
        told = json.loads(str(found["metadata"]))
    assert told["units"] == {
        "time": "s", "positions": "mm", "velocities": "mm/s", "nodes/mass": "g",
        "bars/force": "mN", "bars/rest_length": "mm", "channels/gauge": "mV",
        "system/energy": "J", "inputs/u": "N",
    }  # fmt: skip
    assert told["columns"] == {"channels/gauge": ["left", "right"], "inputs/u": ["u"]}
    assert told["inputs"]["u"] == {"quantity": "force", "targets": [], "hold": 0.5, "start": 0.0}
    assert told["stride"] == stride


def test_the_same_run_gives_the_same_bytes(run, tmp_path):
    (one,) = export_file(run, tmp_path / "one.npz")
    (two,) = export_file(run, tmp_path / "two.npz")
    assert one.read_bytes() == two.read_bytes()


def test_channels_alone(tmp_path):
    with TrajectoryWriter(tmp_path / "a.h5", provenance=Provenance("test")) as writer:
        writer.declare_channel("light", ["light"], unit="arb")
        writer.append([0.0, 1.0], channels={"light": [[1.0], [2.0]]})
    (made,) = export_file(tmp_path / "a.h5", tmp_path / "a.npz")
    with np.load(made, allow_pickle=False) as found:
        assert sorted(found.files) == ["channels/light", "metadata", "time"]


def test_a_stride_of_nothing_is_refused(run, tmp_path):
    with pytest.raises(ConfigError, match="stride is -2"):
        export_file(run, tmp_path / "a.npz", options={"stride": -2})
    assert not list(tmp_path.iterdir())
