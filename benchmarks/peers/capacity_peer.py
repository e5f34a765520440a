"""One way to measure capacities, as a process of its own: ``NAME PROBLEM.npz OUT.npy``.

For every line on standard input it measures all targets once and answers with the CPU seconds;
the capacities are left in OUT.npy. Ways with a loop fit one readout per target. Those of other
packages are given the targets; ours and upstream's make them, which is timed.
"""

from __future__ import annotations

import json
import os
import sys
import time
import types
from collections.abc import Callable, Mapping

import numpy as np

Problem = Mapping[str, np.ndarray]
Measure = Callable[[], np.ndarray]


def ours(problem: Problem, *, dtype: type, estimator: str) -> Measure:
    """The functions of this package, whole: checks of the drive, thresholds and all."""
    from openprc.analysis.capacity import information_processing_capacity  # noqa: PLC0415 - one way, one import
    from openprc.reservoir.training.row_split import RowSplit  # noqa: PLC0415 - one way, one import

    first, n_train, n_test = (int(problem[name]) for name in ("first", "n_train", "n_test"))
    split = RowSplit(washout=first, train=n_train, test=n_test)
    budget = dict.fromkeys(range(1, int(problem["degree"]) + 1), int(problem["tau"]))

    def measure() -> np.ndarray:
        found = information_processing_capacity(
            problem["states"], problem["u"], delays=budget, split=split, basis="legendre",
            estimator=estimator, ridge=float(problem["ridge"]), dtype=dtype, excess="report",
        )  # fmt: skip
        return found.raw

    return measure


def upstream(problem: Problem) -> Measure:
    """The function of the paper authors' package, 0.1.1; its targets come in another order."""
    # It imports torch for a variant that is not used here.
    sys.modules.setdefault("torch", types.ModuleType("torch"))
    from openprc.analysis.utils.training_utils import compute_ipc_components  # noqa: PLC0415 - one way, one import

    first, n_train, n_test = (int(problem[name]) for name in ("first", "n_train", "n_test"))
    states = standardised(problem).astype(np.float32)
    order = problem["upstream_order"]

    def measure() -> np.ndarray:
        _, capacities, _ = compute_ipc_components(
            states, problem["u"], tau_s=int(problem["tau"]), n_s=int(problem["degree"]),
            washout=first, train_stop=first + n_train, test_duration=n_test, k_delay=1,
            epsilon=-np.inf, ridge=float(problem["ridge"]), return_names=False,
        )  # fmt: skip
        return capacities[order]

    return measure


def standardised(problem: Problem) -> np.ndarray:
    """Return states at zero mean and unit variance over the training rows; never timed."""
    rows = slice(int(problem["first"]), int(problem["first"]) + int(problem["n_train"]))
    states = problem["states"]
    return (states - states[rows].mean(axis=0)) / states[rows].std(axis=0)


def split_of(problem: Problem) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return training and test states, and training and test targets (rows, K)."""
    first, n_train = int(problem["first"]), int(problem["n_train"])
    states, targets = standardised(problem)[first:], problem["targets"]
    return (
        np.ascontiguousarray(states[:n_train]),
        np.ascontiguousarray(states[n_train:]),
        np.ascontiguousarray(targets[:, :n_train].T),
        np.ascontiguousarray(targets[:, n_train:].T),
    )


def score(prediction: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return 1 - NMSE of each column."""
    return 1.0 - np.square(target - prediction).sum(axis=0) / np.square(
        target - target.mean(axis=0)
    ).sum(axis=0)


def sklearn_ridge(problem: Problem, *, loop: bool) -> Measure:
    """Ridge of scikit-learn."""
    from sklearn.linear_model import Ridge  # noqa: PLC0415 - one way, one import

    x, x_test, z, z_test = split_of(problem)
    penalty = float(problem["ridge"]) * len(x)

    def once() -> np.ndarray:
        return score(Ridge(penalty).fit(x, z).predict(x_test), z_test)

    def one_by_one() -> np.ndarray:
        found = np.empty(z.shape[1])
        for k in range(z.shape[1]):
            prediction = Ridge(penalty).fit(x, z[:, k]).predict(x_test)
            found[k] = score(prediction, z_test[:, k])
        return found

    return one_by_one if loop else once


def reservoirpy_ridge(problem: Problem, *, loop: bool) -> Measure:
    """The ridge node of reservoirpy."""
    from reservoirpy.nodes import Ridge  # noqa: PLC0415 - one way, one import

    x, x_test, z, z_test = split_of(problem)
    penalty = float(problem["ridge"]) * len(x)

    def once() -> np.ndarray:
        return score(np.asarray(Ridge(ridge=penalty).fit(x, z).run(x_test)), z_test)

    def one_by_one() -> np.ndarray:
        found = np.empty(z.shape[1])
        for k in range(z.shape[1]):
            node = Ridge(ridge=penalty).fit(x, z[:, k : k + 1])
            found[k] = score(np.asarray(node.run(x_test))[:, 0], z_test[:, k])
        return found

    return one_by_one if loop else once


WAYS: dict[str, Callable[[Problem], Measure]] = {
    "insample64": lambda p: ours(p, dtype=np.float64, estimator="insample"),
    "insample32": lambda p: ours(p, dtype=np.float32, estimator="insample"),
    "heldout64": lambda p: ours(p, dtype=np.float64, estimator="heldout"),
    "heldout32": lambda p: ours(p, dtype=np.float32, estimator="heldout"),
    "upstream": upstream,
    "sklearn_once": lambda p: sklearn_ridge(p, loop=False),
    "sklearn_loop": lambda p: sklearn_ridge(p, loop=True),
    "reservoirpy_once": lambda p: reservoirpy_ridge(p, loop=False),
    "reservoirpy_loop": lambda p: reservoirpy_ridge(p, loop=True),
}


def main() -> None:
    """Measure as often as told."""
    # Banners of a peer go to standard error; the answers have their own pipe.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    with np.load(sys.argv[2]) as file:
        problem = dict(file)
    measure = WAYS[sys.argv[1]](problem)
    answers.write(json.dumps({"ready": True}) + "\n")
    answers.flush()
    for _ in sys.stdin:
        start = time.process_time()
        found = measure()
        seconds = time.process_time() - start
        np.save(sys.argv[3], found)
        answers.write(json.dumps({"cpu_s": seconds}) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
