"""From states, input and targets to capacities, with every choice made and told."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.capacity.blas import blas_limit
from openprc.analysis.capacity.capacities import Capacities
from openprc.analysis.capacity.drive import (
    check_sum,
    checked_input,
    drive_warning,
    refused_drive,
    uncorrelated_inputs,
)
from openprc.analysis.capacity.held_out import (
    HELD_OUT_DEFINITION,
    held_out_capacities,
    held_out_readout,
    held_out_threshold,
)
from openprc.analysis.capacity.in_sample import (
    in_sample_capacities,
    orthonormal_capacities,
    orthonormal_targets,
)
from openprc.analysis.capacity.polynomials import polynomial_rows
from openprc.analysis.capacity.settings import Rows, Settings
from openprc.analysis.capacity.state_basis import RANK_RULE, centre_states, state_basis
from openprc.analysis.capacity.surrogates import surrogate_thresholds
from openprc.analysis.capacity.targets import RowSpan, TargetRows
from openprc.analysis.capacity.terms import Terms
from openprc.analysis.capacity.thresholds import beta_threshold, chance_mean
from openprc.errors import TaskError
from openprc.reservoir.io.whiteness import drive_whiteness
from openprc.reservoir.training.row_split import RowSplit

IN_SAMPLE_DEFINITION = (
    "|Q^T z|^2 / |z|^2, z the target without its mean and Q an orthonormal basis of the centred "
    "states (Dambre et al. 2012, doi:10.1038/srep00514)"
)
#: Rows that a circular shift keeps away from, beyond the largest delay.
_MARGIN = 10


@dataclass
class Prepared:
    """States, tables and targets over the rows that count, row 0 being the oldest input used."""

    states: NDArray[np.floating]
    tables: list[NDArray[np.float64]]
    terms: Terms
    fit: RowSpan
    metadata: dict[str, Any] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)


def measure(
    states: NDArray[np.floating],
    u: ArrayLike,
    terms: Terms,
    *,
    settings: Settings,
    washout: int = 0,
    split: RowSplit | None = None,
    usable: NDArray[np.bool_] | None = None,
) -> Capacities:
    """Measure the capacities of the given targets; warnings are returned, not raised.

    Raises
    ------
    TaskError
        As `openprc.analysis.capacity.information_processing_capacity`.
    """
    states = np.asarray(states)
    if states.ndim != 2 or not states.size:
        raise TaskError(
            f"the states have shape {states.shape}",
            expected="(T, N), one row per symbol of the input",
            fix="pass a matrix",
            key="states",
        )
    values = checked_input(u, len(states))
    rows = Rows.choose(
        len(states),
        max_delay=int(terms.max_delay.max()),
        washout=washout,
        split=split,
        usable=usable,
        held_out=settings.estimator == "heldout",
    )
    offset = rows.first - int(terms.max_delay.max())
    used = slice(offset, rows.last + 1)
    inputs, remark = uncorrelated_inputs(values[used], correlated=settings.correlated)
    notes = [remark] if remark else []
    settings, whiteness, warning = adapted(inputs, settings)
    tables, terms, remark = polynomial_tables(inputs, terms, settings)
    notes += [remark] if remark else []
    if rows.n_without_past:
        notes.append(
            f"{rows.n_without_past} rows after the washout were left out, because targets reach "
            "back to before the first input"
        )
    fit, test = rows.spans(offset)
    prepared = Prepared(states[used], tables, terms, fit)
    prepared.metadata.update(
        estimator=settings.estimator,
        basis=settings.basis,
        n_targets=len(terms),
        max_delay=int(terms.max_delay.max()),
        max_degree=int(terms.total_degree.max()),
        n_states=states.shape[1],
        dtype=np.dtype(settings.dtype).name,
        drive=whiteness,
        rank_rule=RANK_RULE
        if settings.rank_tolerance is None
        else f"singular values above {settings.rank_tolerance:g} times the largest",
    )
    if notes:
        prepared.metadata["notes"] = notes
    if warning:
        prepared.warnings.append(warning)
        if settings.orthonormalize == "exact" and len(terms) >= fit.n_usable - 1:
            raise TaskError(
                f"{whiteness}, and {len(terms)} targets over {fit.n_usable} rows cannot be made "
                "orthonormal",
                expected="independent values from row to row, or fewer targets than rows",
                fix="take one row per symbol of the input, or lower the largest delays",
                key="delays",
            )
    with blas_limit(settings.blas_threads):
        if test is None:
            found = _in_sample(prepared, settings)
        else:
            found = _held_out(prepared, test, settings)
    return checked(found, settings)


def adapted(inputs: NDArray[np.float64], settings: Settings) -> tuple[Settings, str, str]:
    """Return the settings that suit the drive, a sentence on it, and a warning.

    Raises
    ------
    TaskError
        When the drive is not white and that is refused.
    """
    if settings.coloured == "ignore":
        return settings, "not examined", ""
    whiteness = drive_whiteness(inputs)
    if whiteness.white:
        return settings, whiteness.sentence, ""
    if settings.coloured == "refuse":
        raise refused_drive(whiteness)
    null = "circular" if settings.null == "beta" else settings.null
    if settings.estimator == "heldout":
        return replace(settings, null=null), whiteness.sentence, drive_warning(whiteness, "heldout")
    changed = replace(settings, null=null, orthonormalize="exact")
    return changed, whiteness.sentence, drive_warning(whiteness, "insample")


def polynomial_tables(
    inputs: NDArray[np.float64], terms: Terms, settings: Settings
) -> tuple[list[NDArray[np.float64]], Terms, str]:
    """Return the polynomials of each input, the targets that exist, and a remark.

    Raises
    ------
    TaskError
        When an input does not vary, or no target is left.
    """
    highest = int(terms.degrees.max())
    tables = [
        polynomial_rows(column, max_degree=highest, basis=settings.basis) for column in inputs.T
    ]
    limits = np.array([len(table) for table in tables])
    exists = (terms.degrees <= limits[terms.inputs]).all(axis=1)
    if exists.all():
        return tables, terms, ""
    least = int(limits.min())
    remark = (
        f"the input has {least + 1} distinct values, so its polynomials end at degree {least}: "
        f"{int(np.count_nonzero(~exists))} of {len(terms)} targets do not exist"
    )
    if not exists.any():
        raise TaskError(
            remark,
            expected="at least one target",
            fix="ask for lower degrees, or for products of different delays",
            key="delays",
        )
    return tables, terms.take(exists), remark


def _in_sample(prepared: Prepared, settings: Settings) -> Capacities:
    span, terms = prepared.fit, prepared.terms
    n_rows = span.n_usable
    centred = centre_states(prepared.states, span)
    basis = state_basis(
        centred, n_rows=n_rows, dtype=settings.dtype, rank_tolerance=settings.rank_tolerance
    )
    n_constant = centred.n_constant
    # In single precision the basis is a copy; room for targets can be where the states were.
    del centred
    targets = TargetRows(terms, prepared.tables, dtype=settings.dtype)
    prepared.metadata.update(
        definition=IN_SAMPLE_DEFINITION,
        n_constant_states=n_constant,
        method=basis.method,
        chance_mean=chance_mean(basis.rank, n_rows),
    )
    exact = settings.orthonormalize == "exact"
    if exact:
        orthonormal = orthonormal_targets(targets, span=span)
        states = basis.orthonormal()
        states = states if span.usable is None else states[span.usable]
        raw = orthonormal_capacities(states, orthonormal)
        prepared.metadata["n_dependent_targets"] = int(orthonormal.dependent.sum())

        def reordered(order: NDArray[np.intp]) -> NDArray[np.float64]:
            return orthonormal_capacities(states[order], orthonormal)

        n_samples = n_rows
    else:
        raw = in_sample_capacities(basis, targets, span=span)

        def reordered(order: NDArray[np.intp]) -> NDArray[np.float64]:
            tables = [table[:, order] for table in prepared.tables]
            other = TargetRows(terms, tables, dtype=settings.dtype)
            return in_sample_capacities(basis, other, span=span)

        n_samples = prepared.tables[0].shape[1]
    chance = None
    if settings.eps is not None or settings.null == "beta":
        thresholds, rule = in_sample_thresholds(
            raw, rank=basis.rank, n_rows=n_rows, settings=settings
        )
    else:
        thresholds, chance, rule = _by_surrogates(reordered, n_samples, prepared, settings)
    prepared.metadata["threshold_rule"] = rule
    return Capacities(
        terms=terms,
        raw=raw,
        thresholds=thresholds,
        rank=basis.rank,
        n_rows=n_rows,
        estimator="insample",
        orthonormal=exact,
        chance=chance,
        metadata=prepared.metadata,
        warnings=tuple(prepared.warnings),
    )


def in_sample_thresholds(
    raw: NDArray[np.float64], *, rank: int, n_rows: int, settings: Settings
) -> tuple[NDArray[np.float64], str]:
    """Return the thresholds (K,) that need no surrogates, and the rule in words."""
    if settings.eps is not None:
        return np.full(len(raw), settings.eps), f"eps = {settings.eps:.6g}, as given"
    value = beta_threshold(
        raw, rank=rank, n_rows=n_rows, alpha=settings.alpha, correction=settings.correction
    )
    return np.full(len(raw), value), (
        f"Beta(r/2, (T-1-r)/2), r = {rank}, T = {n_rows}, alpha = {settings.alpha:g}, "
        f"{settings.correction} over {len(raw)} targets"
    )


def _held_out(prepared: Prepared, test: RowSpan, settings: Settings) -> Capacities:
    terms, train = prepared.terms, prepared.fit
    readout = held_out_readout(
        prepared.states, train=train, test=test, ridge=settings.ridge, dtype=settings.dtype
    )

    def scored(tables: list[NDArray[np.float64]]) -> NDArray[np.float64]:
        targets = TargetRows(terms, tables, dtype=settings.dtype)
        return held_out_capacities(readout, targets, train=train, test=test)

    raw = scored(prepared.tables)
    level = settings.alpha if settings.correction == "none" else settings.alpha / len(terms)
    value, mean = held_out_threshold(
        readout, n_train=train.n_usable, n_test=test.n_usable, probability=level
    )
    prepared.metadata.update(
        definition=HELD_OUT_DEFINITION,
        ridge=settings.ridge,
        n_train=train.n_usable,
        n_test=test.n_usable,
        chance_mean=mean,
        chance_threshold=value,
    )
    if settings.eps is not None:
        thresholds = np.full(len(terms), settings.eps)
        rule = f"eps = {settings.eps:.6g}, as given"
        if settings.eps >= 1.0:
            prepared.warnings.append(
                f"eps is {settings.eps:.4g}, and no capacity exceeds 1: none counts. Chance "
                f"reaches {value:.4g} at the level asked for"
            )
    elif settings.null == "beta":
        thresholds = np.full(len(terms), value)
        rule = (
            f"held-out capacity of white targets, alpha = {settings.alpha:g}, "
            f"{settings.correction} over {len(terms)} targets"
        )
    else:

        def reordered(order: NDArray[np.intp]) -> NDArray[np.float64]:
            return scored([table[:, order] for table in prepared.tables])

        thresholds, _, rule = _by_surrogates(
            reordered, prepared.tables[0].shape[1], prepared, settings
        )
    prepared.metadata["threshold_rule"] = rule
    return Capacities(
        terms=terms,
        raw=raw,
        thresholds=thresholds,
        rank=readout.rank,
        n_rows=test.n_usable,
        estimator="heldout",
        metadata=prepared.metadata,
        warnings=tuple(prepared.warnings),
    )


def _by_surrogates(
    capacities_of: Any, n_samples: int, prepared: Prepared, settings: Settings
) -> tuple[NDArray[np.float64], NDArray[np.float64], str]:
    thresholds, mean = surrogate_thresholds(
        capacities_of,
        n_samples=n_samples,
        kind=settings.null,
        degrees=prepared.terms.total_degree,
        guard=int(prepared.terms.max_delay.max()) + _MARGIN,
        n_surrogates=settings.n_surrogates,
        alpha=settings.alpha,
        rng=np.random.default_rng(settings.seed),
    )
    return (
        thresholds,
        mean,
        (
            f"largest of each degree in {settings.n_surrogates} {settings.null} surrogates, "
            f"alpha = {settings.alpha:g} per degree"
        ),
    )


def checked(found: Capacities, settings: Settings) -> Capacities:
    """Hold the sum against the rank.

    Raises
    ------
    TaskError
        When it is larger, and that is not to be reported.
    """
    if found.orthonormal:
        return found
    excess = check_sum(
        found.total, n_counted=found.n_significant, rank=found.rank, n_rows=found.n_rows
    )
    if not excess:
        if found.total <= found.rank:
            return found
        remark = (
            f"the sum above threshold is {found.total - found.rank:.3g} more than the rank: each "
            "capacity that counts carries what chance adds to it; corrected_total is without"
        )
        notes = [*found.metadata.get("notes", ()), remark]
        return replace(found, metadata={**found.metadata, "notes": notes})
    fix = (
        'take one row per symbol of an independent input, keep basis="empirical", or pass '
        'orthonormalize="exact"'
    )
    if settings.excess == "raise" and settings.eps is None:
        raise TaskError(
            excess,
            expected="targets that do not overlap",
            fix=f'{fix}; excess="report" returns the numbers',
            key="u",
        )
    return replace(found, warnings=(*found.warnings, f"{excess}; {fix}"))
