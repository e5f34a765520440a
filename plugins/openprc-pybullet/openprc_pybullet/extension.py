"""The check of /extensions/openprc-pybullet."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from openprc.schema import Finding
from openprc_pybullet.robot_log import DISTRIBUTION

if TYPE_CHECKING:
    from openprc.schema import Trajectory


def check(trajectory: Trajectory) -> Iterator[Finding]:
    """Yield a finding unless ``node_body_link`` names body and link of every node once."""
    path = f"/extensions/{DISTRIBUTION}/node_body_link"
    if not trajectory.has(path):
        yield Finding("PYBULLET-01", "error", path, "missing", "(N, 2)", "import the log again")
        return
    owners = trajectory.extension(DISTRIBUTION, "node_body_link")
    pairs = {tuple(row) for row in owners.tolist()} if owners.ndim == 2 else set()
    if owners.shape != (trajectory.n_nodes, 2) or len(pairs) != trajectory.n_nodes:
        yield Finding(
            "PYBULLET-02",
            "error",
            path,
            f"shape {owners.shape}, {len(pairs)} different rows",
            f"body and link of {trajectory.n_nodes} nodes, each once",
            "import the log again",
        )
