"""Readouts and their penalties on the same states: what regularisation and algebra cost."""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from time import process_time
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.errors import TaskError
from openprc.reservoir.readout.least_squares import LeastSquares
from openprc.reservoir.readout.ridge import Ridge
from openprc.tradeoff.point import Point

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.tradeoff.downstream_rows import DownstreamRows

    Reals = NDArray[np.float64]

PENALTIES = (0.0, *(10.0**k for k in range(-12, 0)))
ROUNDS = 3


class DenseSolve:
    """What is commonly written by hand, on ``[1, X]``: for comparison only.

    Parameters
    ----------
    method : {"lstsq", "normal"}
        `numpy.linalg.lstsq` with its default cutoff, or ``X^T X w = X^T y`` by elimination.
    """

    def __init__(self, method: str) -> None:
        self.method = method

    def fit(self, X: Reals, y: Reals) -> DenseSolve:
        """Solve for (n, F) states and (n,) or (n, O) targets."""
        ones = np.hstack([np.ones((len(X), 1)), X])
        if self.method == "lstsq":
            solved = np.linalg.lstsq(ones, y, rcond=None)[0]
        else:
            solved = np.linalg.solve(ones.T @ ones, ones.T @ y)
        self.coef_, self.intercept_ = solved[1:].T, solved[0]
        return self

    def predict(self, X: Reals) -> Reals:
        """Return predictions for (n, F) states."""
        return np.asarray(X @ self.coef_.T + self.intercept_)


def readout_points(rows: DownstreamRows) -> Iterator[Point]:
    """Yield a point for every readout; the first is the reference."""
    truth: dict[str, float] = {}
    for label, readout, setting in readouts():
        point = Point(group="readout", label=label, setting=setting)
        seconds = []
        try:
            for _ in range(ROUNDS):
                begin = process_time()
                scores = rows.errors(readout, standardize=bool(setting["standardize"]))
                seconds.append(process_time() - begin)
        except (TaskError, np.linalg.LinAlgError) as problem:
            text = getattr(problem, "found", str(problem))
            yield Point(**{**point.as_dict(), "status": "failed", "note": text})
            continue
        truth = truth or scores
        yield Point(
            **{
                **point.as_dict(),
                "scores": scores,
                "score_errors": {k: abs(v - truth[k]) for k, v in scores.items()},
                "cpu_seconds": statistics.median(seconds),
                "note": "; ".join(filter(None, (_worse_than_nothing(scores), rows.remarks))),
            }
        )


def _worse_than_nothing(scores: dict[str, float]) -> str:
    """Return a remark on errors above that of the mean of the target."""
    bad = [name for name, value in scores.items() if value > 1.0]
    if not bad:
        return ""
    return (
        f"{', '.join(bad)} above 1: the weights do not hold on the test rows; wash out more, or"
        " train on more"
    )


def readouts() -> Iterator[tuple[str, Any, dict[str, Any]]]:
    """Yield label, estimator and setting, the reference first."""
    for standardize in (True, False):
        how = "" if standardize else ", raw states"

        def named(solver: str, penalty: float, standardize: bool = standardize) -> dict[str, Any]:
            return {"readout": solver, "regularization": penalty, "standardize": standardize}

        yield f"QR{how}", LeastSquares(), named("least-squares", 0.0)
        for penalty in PENALTIES:
            yield f"ridge{how}", Ridge(penalty), named("ridge", penalty)
        yield f"numpy lstsq{how}", DenseSolve("lstsq"), named("numpy lstsq", 0.0)
        yield f"normal equations{how}", DenseSolve("normal"), named("normal equations", 0.0)
