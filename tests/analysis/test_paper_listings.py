"""The listings of the paper from the reservoir on, as printed, on a run of the native engine."""

from __future__ import annotations

import contextlib
import io
import shutil

import numpy as np
import pytest
from miura_run import write_miura_run

from openprc.schema import results

RESERVOIR = """
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.features.node_features import NodeDisplacements
from openprc.reservoir.readout.ridge import Ridge
from openprc.reservoir.training.trainer import Trainer

loader  = StateLoader("./experiments/miura_ori_8x4/output/simulation.h5")
trainer = Trainer(
    loader=loader,
    features=NodeDisplacements(reference_node=0, dims=[2]),
    readout=Ridge(1e-5),
    experiment_dir="./experiments/miura_ori_8x4",
    washout=5.0, train_duration=10.0, test_duration=10.0,
)
"""

CORRELATION = """
from openprc.analysis import correlation as corr
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.features.node_features import NodePositions

loader = StateLoader("./experiments/miura_ori_8x4/output/simulation.h5")
Y = NodePositions(dims=[2]).transform(loader)        # (T, N)
x = loader.get_actuation_signal(actuator_idx=0, dof=2)

# --- linear structure ---
lin = corr.Linear(x, Y, lag_sweep=True)
lin.pearson.plot()                   # per-channel Pearson r
lin.ccf.plot(kind="lag_profile")     # CCF with peak markers
lin.partial.plot()                   # N x N partial correlation heatmap
lin.cca()                            # best linear reconstruction of x

# --- nonlinear dependencies ---
corr.Nonparametric(x, Y).dcor.plot() # flag Pearson-blind channels

# --- redundancy ---
red = corr.Redundancy(Y)
print(f"Effective rank:  {red.rank:.1f} / {Y.shape[1]}")
print(f"Condition number: {red.condition:.2e}")
for g in red.groups_named(threshold=0.85):
    if len(g) > 1: print(f"  Redundant cluster: {g}")
"""

NARMA = """
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.features.node_features import NodePositions
from openprc.reservoir.readout.ridge import Ridge
from openprc.reservoir.training.trainer import Trainer
from openprc.analysis.benchmarks.narma_benchmark import NARMABenchmark
from openprc.analysis.visualization.time_series import TimeSeriesComparison

loader  = StateLoader("./experiments/miura_ori_8x4/output/simulation.h5")
u_raw   = loader.get_actuation_signal(actuator_idx=0, dof=2)
u_input = 0.5 * (u_raw - u_raw.min()) / (u_raw.max() - u_raw.min())

trainer = Trainer(loader=loader, features=NodePositions(dims=[2]),
                  readout=Ridge(1e-5), experiment_dir="./experiments/miura_ori_8x4",
                  washout=5.0, train_duration=10.0, test_duration=10.0)

score = NARMABenchmark(group_name="narma_benchmark").run(
            trainer, u_input, order=2)
score.save()
TimeSeriesComparison().plot(score.readout_path, start_frame=0, end_frame=500).save()
"""

MEMORY = """
from scipy.stats import chi2
from sklearn.preprocessing import StandardScaler
from openprc.analysis.benchmarks.memory_benchmark import MemoryBenchmark

# --- effective rank and epsilon (reuse loader, features, trainer from above) ---
X   = StandardScaler().fit_transform(features.transform(loader))
s   = np.linalg.svd(X, compute_uv=False)
N   = float(np.exp(-np.sum((s/s.sum()) * np.log(s/s.sum() + 1e-12))))
eps = float(2 * chi2.isf(1e-4, df=N) / int(10.0 / loader.dt))

score = MemoryBenchmark(group_name="memory_benchmark").run(
            trainer, u_input,
            tau_s=30, n_s=2, k_delay=1, eps=eps, ridge=1e-6)
score.save()
"""

CUSTOM = """
from openprc.analysis.benchmarks.custom_benchmark import CustomBenchmark
from openprc.analysis.tasks.imitation import NARMA_task

def custom_narma_logic(benchmark, trainer, u_input, **kwargs):
    order  = kwargs.get("order", 2)
    result = trainer.train(NARMA_task(u_input, order=order),
                           task_name=f"CustomNARMA{order}")
    result.save()
    _, target, pred = result.cache["test"]
    nrmse = np.sqrt(np.mean((target - pred)**2)) / (np.std(target) or 1.0)
    return {f"custom_narma{order}_nrmse": nrmse}, {"narma_order": order}

score = CustomBenchmark(
            group_name="custom_narma_benchmark",
            benchmark_logic=custom_narma_logic,
        ).run(trainer, u_input, order=2)
score.save()
"""


@pytest.fixture(scope="module", params=["symbols", "smooth"])
def executed(request, tmp_path_factory):
    """Return the names that the listings leave behind, what they print, and their folder."""
    folder = tmp_path_factory.mktemp(request.param)
    experiment = folder / "experiments" / "miura_ori_8x4"
    write_miura_run(experiment, smooth=request.param == "smooth")
    names: dict[str, object] = {"np": np}
    printed = io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(printed):
        for listing in (RESERVOIR, CORRELATION, NARMA):
            exec(listing, names)
        names["narma_score"] = names["score"]
        names["features"] = names["NodePositions"](dims=[2])
        exec(MEMORY, names)
        names["memory_score"] = names["score"]
        exec(CUSTOM, names)
    yield request.param, names, printed.getvalue(), experiment
    names["loader"].close()
    shutil.rmtree(folder)


def test_files_are_where_the_paper_puts_them(executed):
    _, _, _, experiment = executed
    stored = results.read_result(experiment / "metrics" / "metrics.h5")
    groups = {name.split("/")[0] for name in stored.arrays}
    assert groups == {"narma_benchmark", "memory_benchmark", "custom_narma_benchmark"}
    assert sorted(path.name for path in (experiment / "readout").iterdir()) == [
        "readout_CustomNARMA2.h5",
        "readout_narma2.h5",
        "readout_narma2_validation.png",
    ]


def test_diagnosis(executed):
    drive, names, printed, _ = executed
    assert "Effective rank:" in printed
    assert "Redundant cluster: [" in printed
    n_states = names["Y"].shape[1]
    assert 1.0 < names["red"].rank < n_states
    # The driven edge moves as one: its columns are copies of each other.
    assert names["red"].condition > 1e6
    assert np.nanmax(names["lin"].pearson.values) > 0.999
    assert drive in ("symbols", "smooth")


def test_scores(executed):
    drive, names, _, _ = executed
    narma, memory = names["narma_score"], names["memory_score"]
    assert narma.metadata["clock"] == ("symbols" if drive == "symbols" else "frames")
    assert 0 < narma.metrics["narma2_nrmse"] < 1
    assert 0 < names["score"].metrics["custom_narma2_nrmse"] < 1
    # The threshold of the listing belongs to held-out capacities; the others stand beside them.
    assert memory.metadata["estimator"] == "heldout"
    assert 0 < memory.metrics["insample_ipc_total"] <= names["Y"].shape[1]
    warned = " ".join(memory.metadata.get("warnings", ()))
    for words in ("autocorrelation 0.9", "no more than"):
        assert (words in warned) == (drive == "smooth")
