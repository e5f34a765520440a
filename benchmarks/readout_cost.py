"""What training a readout costs beyond the bare fit, and choosing its penalty on folds of time.

    python benchmarks/readout_cost.py [--peer-python PATH] [--sizes 10000x100 ...] [--rounds 7]
                                      [--no-cv] [--json FILE]

The unit is the CPU time of scikit-learn's ``Ridge(1e-6).fit(X_train, y_train)``, one thread, on the
training rows alone. ``Trainer.train`` is the whole of it, with states already read: fit,
predictions of training and test rows (a quarter as many), scores and remarks. PATH is the
Python of an environment with reservoirpy. Everybody takes turns in every round; a ratio is the
median over rounds of the ratio within a round, and after the slash that of the best rounds:
other work on the machine can only slow somebody down. The error is the largest difference of
test predictions from those of a singular value decomposition, over the standard deviation of
the target. The floor is one symmetric rank-k update of the training states (BLAS syrk): no
solver by normal equations can be faster.

States are echoes of a common signal with offsets of 1 and noise of 1e-3, as those of a body are:
collinear, not white. The second table scores ten penalties on five folds: against GridSearchCV
with the same folds: of a pipeline that scales within each fold, as ours does, and of a bare Ridge.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from peers.asking import PeerProcess
from rich.console import Console
from rich.table import Table
from scipy.linalg import svd
from scipy.linalg.blas import dsyrk
from sklearn.linear_model import Ridge as SklearnRidge
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from threadpoolctl import threadpool_limits

from openprc.reservoir import Ridge, Split, StateLoader, Trainer
from openprc.reservoir.training.cross_validation import choose_regularization
from openprc.schema import Provenance, TrajectoryWriter

SIZES = ("10000x100", "10000x300", "10000x1000", "100000x100", "100000x300")
CV_SIZES = ("20000x100", "20000x300")
PENALTY = 1e-6
PENALTIES = 10.0 ** np.arange(-6, 4)
BARE, OURS = "scikit-learn Ridge.fit", "Trainer, Ridge"
SCALED, UNSCALED = "GridSearchCV(scaler, Ridge)", "GridSearchCV(Ridge)"


class Given:
    """A feature that gives a matrix which is already in memory."""

    def __init__(self, matrix: np.ndarray) -> None:
        self.matrix = matrix

    def transform(self, loader: StateLoader) -> np.ndarray:
        """Return the matrix."""
        return self.matrix

    def names(self, loader: StateLoader) -> list[str]:
        """Return one name per column."""
        return [f"x{k}" for k in range(self.matrix.shape[1])]


class Peer(PeerProcess):
    """reservoirpy in a process of its own."""

    name = "reservoirpy Ridge.fit"

    def __init__(self, python: Path, folder: Path) -> None:
        self.out = folder / "prediction.npy"
        super().__init__(python, "peers.reservoirpy_ridge", folder / "states.npz", self.out)

    def __call__(self) -> float:
        """Return the CPU time of one fit [s]."""
        return float(self.ask("fit")["cpu_s"])


def make_states(n: int, width: int, *, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return collinear states (n, width) and a target (n,)."""
    rng = np.random.default_rng(seed)
    latent = rng.normal(size=(n, max(8, width // 4)))
    mixing = rng.normal(size=(latent.shape[1], width))
    states = latent @ mixing
    states += 1e-3 * rng.normal(size=states.shape)
    states += 1.0
    return states, latent[:, 0] + 0.1 * rng.normal(size=n)


def empty_file(path: Path, n: int) -> None:
    """Write a trajectory of n frames whose only channel says nothing."""
    with TrajectoryWriter(path, provenance=Provenance("benchmark")) as writer:
        writer.declare_channel("clock", ["k"], unit="1")
        writer.append(np.arange(n) * 1e-3, channels={"clock": np.arange(n)[:, None] * 1.0})


def cpu(call: Callable[[], object]) -> float:
    """Return the CPU seconds of one call."""
    start = time.process_time()
    call()
    return time.process_time() - start


def reference(states: np.ndarray, target: np.ndarray, n_train: int) -> np.ndarray:
    """Return test predictions of ridge by singular values of the standardised states."""
    x, y = states[:n_train], target[:n_train]
    mean, scale = x.mean(axis=0), x.std(axis=0)
    u, s, vt = svd((x - mean) / scale, full_matrices=False)
    weights = vt.T @ (s / (s**2 + PENALTY) * (u.T @ (y - y.mean())))
    return ((states[n_train:] - mean) / scale) @ weights + y.mean()


def turns(calls: dict[str, Callable[[], float]], rounds: int) -> dict[str, list[float]]:
    """Let everybody take turns; return seconds by name."""
    for call in calls.values():
        call()
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            times[name].append(call())
    return times


def ratio(times: dict[str, list[float]], over: str, under: str) -> tuple[float, float]:
    """Return the median ratio within a round, and that of the best rounds."""
    within = [a / b for a, b in zip(times[over], times[under], strict=True)]
    return statistics.median(within), min(times[over]) / min(times[under])


def training(size: str, *, peer_python: Path | None, rounds: int) -> list[dict[str, Any]]:
    """Measure one size; return a row for each candidate."""
    n_train, width = (int(part) for part in size.split("x"))
    n = n_train + n_train // 4
    states, target = make_states(n, width)
    exact = reference(states, target, n_train)
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        empty_file(folder / "run.h5", n)
        loader = stack.enter_context(StateLoader(folder / "run.h5"))
        split = Split(washout=0, train=n_train, test=n - n_train, unit="rows", clock="frames")
        trainers = {
            OURS: Trainer(Given(states), Ridge(PENALTY), loader=loader, split=split),
            "Trainer, Ridge float32": Trainer(
                Given(states), Ridge(PENALTY, precision="float32"), loader=loader, split=split
            ),
            "Trainer, scikit-learn Ridge": Trainer(
                Given(states), SklearnRidge(PENALTY), loader=loader, split=split
            ),
        }
        x, y, later = states[:n_train], target[:n_train], states[n_train:]
        pipeline = make_pipeline(StandardScaler(), SklearnRidge(PENALTY))
        calls: dict[str, Callable[[], float]] = {
            BARE: lambda: cpu(lambda: SklearnRidge(PENALTY).fit(x, y)),
            "floor: syrk": lambda: cpu(lambda: dsyrk(1.0, x.T)),
            "copying: scale, fit, predict": lambda: cpu(
                lambda: (
                    pipeline.fit(x, y),
                    pipeline.predict(x),
                    pipeline.predict(states[n_train:]),
                )
            ),
        }
        for label, trainer in trainers.items():
            assert trainer.states.values.shape == states.shape
            calls[label] = lambda t=trainer: cpu(lambda: t.train(target))
        peer = None
        if peer_python is not None:
            np.savez(folder / "states.npz", states=states, target=target, n_train=n_train,
                     penalty=PENALTY)  # fmt: skip
            peer = calls[Peer.name] = stack.enter_context(Peer(peer_python, folder))
        times = turns(calls, rounds)
        errors = {
            label: trainer.train(target).evaluation.prediction[:, 0]
            for label, trainer in trainers.items()
        }
        errors["copying: scale, fit, predict"] = pipeline.predict(later)
        if peer is not None:
            errors[Peer.name] = np.load(peer.out)[:, 0]
    return [
        {
            "size": size,
            "candidate": label,
            "ms": [1e3 * seconds for seconds in values],
            "over_bare_fit": ratio(times, label, BARE),
            "over_floor": ratio(times, label, "floor: syrk"),
            "error": None
            if label not in errors
            else float(np.abs(errors[label] - exact).max() / target.std()),
        }
        for label, values in times.items()
    ]


def validation(size: str, *, rounds: int) -> list[dict[str, Any]]:
    """Measure cross-validation of one size; return a row for each candidate."""
    n, width = (int(part) for part in size.split("x"))
    states, target = make_states(n, width)
    ours = choose_regularization(states, target, penalties=PENALTIES, gap=50)
    folds = [(fold.train(n), np.arange(n)[fold.test]) for fold in ours.folds]
    pipeline = make_pipeline(StandardScaler(), SklearnRidge())
    how = {"cv": folds, "scoring": "neg_mean_squared_error", "refit": False}
    grid = GridSearchCV(pipeline, {"ridge__alpha": PENALTIES}, **how)
    bare = GridSearchCV(SklearnRidge(), {"alpha": PENALTIES}, **how)
    times = turns(
        {
            "choose_regularization": lambda: cpu(
                lambda: choose_regularization(states, target, penalties=PENALTIES, gap=50)
            ),
            SCALED: lambda: cpu(lambda: grid.fit(states, target)),
            UNSCALED: lambda: cpu(lambda: bare.fit(states, target)),
        },
        rounds,
    )
    theirs = np.stack([-grid.cv_results_[f"split{k}_test_score"] for k in range(len(folds))])
    difference = np.abs(theirs / target.var() / ours.fold_nmse[:, :, 0] - 1).max()
    return [
        {
            "size": size,
            "candidate": label,
            "ms": [1e3 * seconds for seconds in values],
            "scaled_over_this": ratio(times, SCALED, label),
            "bare_over_this": ratio(times, UNSCALED, label),
            "largest_difference_of_errors": float(difference),
        }
        for label, values in times.items()
    ]


def shown(pair: tuple[float, float]) -> str:
    """Return both ratios as text."""
    return f"{pair[0]:.3g} / {pair[1]:.3g}"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--peer-python", type=Path, metavar="PATH")
    parser.add_argument("--sizes", nargs="*", choices=SIZES, default=SIZES)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--cv", action=argparse.BooleanOptionalAction, default=True)
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args()
    peer_python = options.peer_python and options.peer_python.absolute()
    console = Console(width=max(Console().width, 110))
    rows: list[dict[str, Any]] = []
    folds: list[dict[str, Any]] = []
    with threadpool_limits(1):
        for size in options.sizes:
            found = training(size, peer_python=peer_python, rounds=options.rounds)
            rows += found
            table = Table(title=f"{size} training states", title_justify="left")
            for heading in ("", "ms", "x bare fit", "x floor", "error"):
                table.add_column(heading, justify="right" if heading else "left", no_wrap=True)
            for row in found:
                error = "-" if row["error"] is None else f"{row['error']:.1e}"
                table.add_row(row["candidate"], f"{statistics.median(row['ms']):.1f}",
                              shown(row["over_bare_fit"]), shown(row["over_floor"]),
                              error)  # fmt: skip
            console.print(table)
        for size in CV_SIZES if options.cv else ():
            found = validation(size, rounds=max(3, options.rounds // 2))
            folds += found
            table = Table(
                title=f"{size}, 5 folds, {len(PENALTIES)} penalties; errors agree to "
                f"{found[0]['largest_difference_of_errors']:.1e}",
                title_justify="left",
            )
            for heading in ("", "ms", f"{SCALED} / this", f"{UNSCALED} / this"):
                table.add_column(heading, justify="right" if heading else "left", no_wrap=True)
            for row in found:
                ms = f"{statistics.median(row['ms']):.0f}"
                ratios = shown(row["scaled_over_this"]), shown(row["bare_over_this"])
                table.add_row(row["candidate"], ms, *ratios)
            console.print(table)
    if options.json:
        content = {"python": sys.version, "training": rows, "cross_validation": folds}
        options.json.write_text(json.dumps(content, indent=2) + "\n")


if __name__ == "__main__":
    main()
