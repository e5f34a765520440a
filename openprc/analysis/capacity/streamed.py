"""Capacities of states that do not fit in memory: one pass over blocks of rows."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from openprc.analysis.capacity.capacities import Capacities
from openprc.analysis.capacity.drive import (
    CapacityWarning,
    Correlated,
    checked_input,
    uncorrelated_inputs,
)
from openprc.analysis.capacity.measurement import (
    IN_SAMPLE_DEFINITION,
    adapted,
    checked,
    in_sample_thresholds,
    polynomial_tables,
)
from openprc.analysis.capacity.polynomials import Basis
from openprc.analysis.capacity.processing import chosen_terms
from openprc.analysis.capacity.settings import Excess, Settings
from openprc.analysis.capacity.state_basis import too_few_rows
from openprc.analysis.capacity.targets import RowSpan, TargetRows, chunks
from openprc.analysis.capacity.terms import Factor, Terms
from openprc.analysis.capacity.thresholds import Correction, chance_mean
from openprc.errors import TaskError
from openprc.reservoir.features.base import ROUND_OFF

STREAMED_RANK_RULE = (
    "eigenvalues of the correlation matrix of the states above states * 8.9e-16 times the "
    "largest: directions below 3e-8 sqrt(states) of the largest singular value do not count"
)


def information_processing_capacity_streamed(
    blocks: Iterable[NDArray[np.floating]],
    u: ArrayLike,
    *,
    delays: Mapping[int, int] | None = None,
    terms: Sequence[Sequence[Factor]] | Terms | None = None,
    delay_step: int = 1,
    first_delay: int = 0,
    washout: int = 0,
    basis: Basis = "empirical",
    eps: float | None = None,
    alpha: float = 0.01,
    correction: Correction = "bonferroni",
    coloured: Literal["refuse", "ignore"] = "refuse",
    correlated: Correlated = "refuse",
    excess: Excess = "raise",
    dtype: DTypeLike = np.float64,
) -> Capacities:
    """Measure in-sample capacities from blocks of rows, each read once.

    Memory is what the input and its polynomials take, ``N (N + K)`` numbers, and one block.
    The states enter through their Gram matrix, which has half of the digits: directions far
    smaller than the largest do not count (`STREAMED_RANK_RULE`), where
    `information_processing_capacity` would still see them.

    Parameters
    ----------
    blocks : iterable of (n, N)
        Consecutive rows of the states, from row 0 on.
    u : (T,) or (T, C)
        The whole input.
    delays, terms, delay_step, first_delay, washout, basis, eps, alpha, correction
        As for `information_processing_capacity`.
    coloured : {"refuse", "ignore"}
        What to do with a drive that is not white.
    correlated, excess, dtype
        As for `information_processing_capacity`.

    Raises
    ------
    TaskError
        When the blocks do not add up to the rows of the input, hold NaN, or as
        `information_processing_capacity`.
    """
    settings = Settings(
        basis=basis,
        eps=eps,
        alpha=alpha,
        correction=correction,
        coloured=coloured,
        correlated=correlated,
        excess=excess,
        dtype=dtype,
    )
    if coloured == "adapt":
        raise TaskError(
            'coloured is "adapt" and the states are read once',
            expected="refuse or ignore",
            fix="load the states for exactly orthonormal targets and circular shifts",
            key="coloured",
        )
    n_inputs = 1 if np.ndim(u) < 2 else np.shape(u)[1]
    chosen = chosen_terms(
        delays, terms, n_inputs=n_inputs, delay_step=delay_step, first_delay=first_delay
    )
    values = checked_input(u, len(np.asarray(u)))
    start = max(washout, int(chosen.max_delay.max()))
    if len(values) < start + 3:
        raise TaskError(
            f"washout and delays take {start} of {len(values)} rows",
            expected="many more rows than the largest delay",
            fix="lower the largest delay, or record for longer",
            key="delays",
        )
    offset = start - int(chosen.max_delay.max())
    inputs, remark = uncorrelated_inputs(values[offset:], correlated=correlated)
    notes = [remark] if remark else []
    settings, whiteness, _ = adapted(inputs, settings)
    tables, chosen, remark = polynomial_tables(inputs, chosen, settings)
    notes += [remark] if remark else []
    sums = _Moments(TargetRows(chosen, tables, dtype=dtype), first=start, offset=offset)
    row = 0
    for block in blocks:
        sums.add(np.asarray(block), row, most=len(values))
        row += len(block)
    if row != len(values):
        raise TaskError(
            f"the blocks hold {row} rows and the input {len(values)}",
            expected="one row of the states per value of the input",
            fix="give blocks that cover the input",
            key="blocks",
        )
    raw, rank, n_constant = sums.capacities()
    if rank >= sums.n_rows - 1:
        raise too_few_rows(sums.n_rows, rank)
    thresholds, rule = in_sample_thresholds(raw, rank=rank, n_rows=sums.n_rows, settings=settings)
    metadata: dict[str, Any] = {
        "estimator": "insample",
        "definition": IN_SAMPLE_DEFINITION,
        "basis": basis,
        "n_targets": len(chosen),
        "max_delay": int(chosen.max_delay.max()),
        "max_degree": int(chosen.total_degree.max()),
        "n_states": sums.n_states,
        "n_constant_states": n_constant,
        "dtype": np.dtype(dtype).name,
        "drive": whiteness,
        "method": "gram",
        "rank_rule": STREAMED_RANK_RULE,
        "chance_mean": chance_mean(rank, sums.n_rows),
        "threshold_rule": rule,
    }
    if notes:
        metadata["notes"] = notes
    found = checked(
        Capacities(chosen, raw, thresholds, rank, sums.n_rows, metadata=metadata), settings
    )
    for sentence in found.warnings:
        warnings.warn(sentence, CapacityWarning, stacklevel=2)
    return found


class _Moments:
    """First and second moments of states and targets, about the mean of the first rows.

    Moments about a point near the mean keep their digits where the states have large offsets.
    """

    def __init__(self, targets: TargetRows, *, first: int, offset: int) -> None:
        self.targets = targets
        self.first, self.offset = first, offset
        self.n_rows = 0
        self.n_states = 0

    def add(self, block: NDArray[np.floating], row: int, *, most: int) -> None:
        """Add the rows of a block that begins at `row`."""
        if block.ndim != 2 or (self.n_states and block.shape[1] != self.n_states):
            raise TaskError(
                f"a block has shape {block.shape}",
                expected=f"(n, {self.n_states or 'N'})",
                fix="give blocks of the same states",
                key="blocks",
            )
        if row + len(block) > most:
            raise TaskError(
                f"the blocks hold at least {row + len(block)} rows and the input {most}",
                expected="one row of the states per value of the input",
                fix="give the whole input",
                key="blocks",
            )
        if not self.n_states:
            self.n_states = block.shape[1]
        rows = block[max(self.first - row, 0) :]
        if not len(rows):
            return
        start = max(row, self.first) - self.offset
        if not self.n_rows:
            self._begin(rows)
        # Pieces of a few thousand rows bound what one block of targets takes.
        for piece in RowSpan(start, start + len(rows)).blocks():
            self._add(rows[piece.start - start : piece.stop - start], piece)

    def _begin(self, rows: NDArray[np.floating]) -> None:
        self.about = rows.mean(axis=0, dtype=np.float64)
        size = np.sqrt(np.square(rows - self.about).mean(axis=0))
        self.scale = np.where(size > 0, size, 1.0)
        n, k = rows.shape[1], len(self.targets)
        self.total, self.gram = np.zeros(n), np.zeros((n, n))
        self.products = np.zeros((k, n))
        self.target_total, self.target_power = np.zeros(k), np.zeros(k)

    def _add(self, rows: NDArray[np.floating], span: RowSpan) -> None:
        x = (rows - self.about) / self.scale
        part = x.sum(axis=0)
        if not np.isfinite(part).all():
            bad = int(np.count_nonzero(~np.isfinite(rows).all(axis=1)))
            raise TaskError(
                f"{bad} rows of the states are NaN or infinite",
                expected="finite numbers in every row",
                fix="leave out the columns with gaps",
                key="blocks",
            )
        self.n_rows += len(rows)
        self.total += part
        self.gram += x.T @ x
        matrix = x.astype(self.targets.dtype, copy=False)
        buffer = self.targets.buffer(span)
        for chunk in chunks(len(self.targets)):
            z = self.targets.fill(chunk, span, buffer)
            here = slice(chunk.start, chunk.stop)
            self.products[here] += z @ matrix
            self.target_total[here] += z @ np.ones(len(rows), dtype=z.dtype)
            self.target_power[here] += np.vecdot(z, z)

    def capacities(self) -> tuple[NDArray[np.float64], int, int]:
        """Return the capacities (K,), the rank, and how many states never change."""
        n = self.n_rows
        gram = self.gram - np.outer(self.total, self.total) / n
        power = np.diag(gram)
        size = np.abs(self.about) / self.scale + np.sqrt(np.diag(self.gram) / n)
        kept = power > n * (2 * ROUND_OFF * size) ** 2
        if not kept.any():
            raise TaskError(
                f"none of the {len(kept)} states changes over the {n} rows",
                expected="a body that moves",
                fix="check that the drive reached the body, or choose other features",
                key="blocks",
            )
        norm = np.sqrt(power[kept])
        values, vectors = np.linalg.eigh(gram[np.ix_(kept, kept)] / np.outer(norm, norm))
        limit = 4 * len(values) * np.finfo(np.float64).eps * values[-1]
        seen = values > limit
        white = vectors[:, seen] / np.sqrt(values[seen])
        crossed = self.products - np.outer(self.target_total, self.total) / n
        inside = (crossed[:, kept] / norm) @ white
        centred = self.target_power - self.target_total**2 / n
        rounding = 64.0 * np.finfo(self.targets.dtype).eps
        found = np.zeros(len(centred))
        np.divide(
            np.einsum("kr,kr->k", inside, inside),
            centred,
            out=found,
            where=centred > rounding * self.target_power,
        )
        return found, int(seen.sum()), int(np.count_nonzero(~kept))
