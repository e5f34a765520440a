"""The functions on constraints that Python calls, compiled once and kept on disk."""

from __future__ import annotations

from typing import Any

from openprc.demlat.compiled.jit import entry
from openprc.demlat.linear import ldl
from openprc.demlat.models.barhinge import constraints


@entry
def values(stamp: int) -> Any:
    """As `constraints.values`."""

    def values(x, table, work):
        _ = stamp
        return constraints.values(x, table, work)

    return values


@entry
def rates(stamp: int) -> Any:
    """As `constraints.rates`."""

    def rates(v, table, work, out):
        _ = stamp
        return constraints.rates(v, table, work, out)

    return rates


@entry
def push(stamp: int) -> Any:
    """As `constraints.push`."""

    def push(target, multiplier, scale, table, work):
        _ = stamp
        constraints.push(target, multiplier, scale, table, work)

    return push


@entry
def prepare(stamp: int) -> Any:
    """As `constraints.prepare`."""

    def prepare(x, inverse_mass, table, work, factor, pivot_tolerance):
        _ = stamp
        return constraints.prepare(x, inverse_mass, table, work, factor, pivot_tolerance)

    return prepare


@entry
def solve(stamp: int) -> Any:
    """As `ldl.solve`."""

    def solve(factor, b):
        _ = stamp
        ldl.solve(factor, b)

    return solve


@entry
def newton_positions(stamp: int) -> Any:
    """As `constraints.newton_positions`."""

    def newton_positions(
        x, inverse_mass, table, work, factor, pivot_tolerance, tolerance, max_iterations
    ):
        _ = stamp
        return constraints.newton_positions(
            x, inverse_mass, table, work, factor, pivot_tolerance, tolerance, max_iterations
        )

    return newton_positions


@entry
def project_velocities(stamp: int) -> Any:
    """As `constraints.project_velocities`."""

    def project_velocities(v, table, work, factor, tolerance, max_iterations):
        _ = stamp
        return constraints.project_velocities(v, table, work, factor, tolerance, max_iterations)

    return project_velocities
