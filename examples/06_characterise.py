"""Drive a spring lattice with random symbols and measure what it computes, and for whom.

The sum of all capacities cannot exceed the number of independent states. Here it is compared for
two sets of sensors on one body: all strains, and the strains of five springs.

python examples/06_characterise.py
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from openprc.analysis.benchmarks.memory_benchmark import MemoryBenchmark
from openprc.analysis.correlation import Redundancy
from openprc.analysis.visualization.capacity_plots import CapacityPlots
from openprc.demlat.samples import write_sample
from openprc.hooks import run_experiment
from openprc.reservoir import BarExtensions, Ridge, Split, StateLoader, Trainer


def main(folder: Path) -> None:
    """Run the lattice of the demo and print its capacities."""
    run = run_experiment(write_sample(folder).path, folder / "simulation.h5")
    totals = []
    with StateLoader(run.path) as loader:
        symbols = loader.symbols().sequence
        drive = symbols[:, symbols.std(axis=0).argmax()]
        for features in (BarExtensions(), BarExtensions([0, 7, 14, 21, 28])):
            trainer = Trainer(
                features, Ridge(), loader=loader, split=Split(), experiment_dir=folder
            )
            score = MemoryBenchmark("memory").run(trainer, drive, delays={1: 20, 2: 10, 3: 4})
            m = score.metrics
            independent = Redundancy(trainer.states.values).representatives(threshold=0.95)
            print(
                f"{len(trainer.states.names):3d} springs ({len(independent)} below |r| 0.95): rank "
                f"{m['rank']}, capacity {m['ipc_total']:.1f} = {m['mc_linear']:.1f} linear + "
                f"{m['mc_nonlinear']:.1f} nonlinear; memory {m['mc_jaeger']:.1f} symbols"
            )
            totals.append((m["ipc_total"], m["rank"]))
        picture = CapacityPlots.of(score).heat_map().save(folder / "capacities.png")
    (total, rank), (few_total, few_rank) = totals
    assert few_rank <= 5 < rank
    assert few_total <= few_rank * 1.1
    assert few_total < total <= rank
    assert picture.is_file()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        main(Path(name))
