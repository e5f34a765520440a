"""Write a trajectory from your own loop, validate it, and read it back.

python examples/01_write_and_read.py
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from openprc.schema import Provenance, Trajectory, TrajectoryWriter, validate_file


def main(folder: Path) -> None:
    """Record a double mass-spring chain in closed form and check what comes back."""
    path = folder / "chain.h5"
    dt, frequencies = 0.01, np.sqrt([1.0, 3.0])  # normal modes of two masses and three springs
    with TrajectoryWriter(path, provenance=Provenance("example")) as writer:
        writer.declare_nodes(2, 2, unit="mm", rest=[[0, 0], [10, 0]], labels=["left", "right"])
        for i in range(500):
            modes = np.cos(frequencies * i * dt)
            left, right = (modes[0] + modes[1]) / 2, (modes[0] - modes[1]) / 2
            writer.append(i * dt, positions=[[left, 0.0], [10 + right, 0.0]])

    report = validate_file(path)
    print("valid:", report.ok)
    for finding in report.findings:
        print(f"  {finding.level} {finding.code} {finding.path}: {finding.found}")

    with Trajectory(path) as run:
        print(run)
        metres = run.positions(unit="m")
        assert run.dt == dt
        assert metres.shape == (500, 2, 2)
        assert np.isclose(metres[0, 0, 0], 1e-3)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        main(Path(name))
