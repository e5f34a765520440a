"""Drive a spring lattice with random symbols, run it natively, and score it on NARMA-2.

python examples/02_run_and_score.py
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from openprc.analysis.benchmarks.report import score_file
from openprc.demlat.samples import write_sample
from openprc.hooks import run_experiment


def main(folder: Path) -> None:
    """Build, run and score the lattice of the demo."""
    experiment = write_sample(folder).path
    run = run_experiment(experiment, folder / "simulation.h5")
    print(f"{run.n_nodes} nodes, {run.n_frames} frames")
    score = score_file(run.path)
    print(f"NARMA-2 NRMSE {score.nrmse:.3f}, shift register {score.baseline:.3f}")
    print(f"skill {score.skill:.2f} with {score.n_states} states on the {score.clock} clock")
    assert score.n_test > 50
    assert 0 < score.nrmse < 1


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        main(Path(name))
