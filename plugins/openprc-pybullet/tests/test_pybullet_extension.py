"""The plugin's check of its own subtree."""

import numpy as np
import pytest
from openprc_pybullet.extension import check

from openprc.schema import Provenance, Trajectory, TrajectoryWriter


@pytest.mark.parametrize(
    ("owners", "codes"),
    [
        ([[1, -1], [1, 0]], []),
        (None, ["PYBULLET-01"]),
        ([[1, -1]], ["PYBULLET-02"]),
        ([[1, -1], [1, -1]], ["PYBULLET-02"]),
    ],
)
def test_every_node_is_a_link_of_a_body(tmp_path, owners, codes):
    with TrajectoryWriter(tmp_path / "run.h5", provenance=Provenance("pybullet")) as writer:
        writer.declare_nodes(2, 3, unit="m")
        writer.declare_extension("openprc-pybullet", "1")
        if owners is not None:
            writer.put_extension("openprc-pybullet", "node_body_link", np.array(owners, "i4"))
        writer.append([0.0, 0.1], positions=np.arange(12.0).reshape(2, 2, 3))
    with Trajectory(tmp_path / "run.h5") as run:
        assert [finding.code for finding in check(run)] == codes
