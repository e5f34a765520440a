"""Checks that are read off the table of the contract: presence, shape, type, units."""

from __future__ import annotations

import math
from collections.abc import Iterator

import h5py
import numpy as np

from openprc.schema.layout import (
    DATASETS,
    ELEMENT_ARITY,
    PHYSICAL_DIMENSIONS,
    DatasetRule,
    attributes_of,
    match,
)
from openprc.schema.units import UNITS
from openprc.schema.validate import Complaint, check
from openprc.schema.view import POSITIONS, TIME, View

_REWRITE = "write the file with TrajectoryWriter"


@check("OPS-L01", "error", "every required dataset is present")
def required(view: View) -> Iterator[Complaint]:
    """Required datasets."""
    for rule in DATASETS:
        if rule.need == "required" and rule.path not in view.datasets:
            yield rule.path, "the dataset is missing", rule.meaning, _REWRITE


@check("OPS-L02", "warning", "every dataset is one that the contract knows")
def unknown(view: View) -> Iterator[Complaint]:
    """Datasets in the contract's own groups that it does not know."""
    roots = ("/time_series/", "/inputs/", "/topology/", "/provenance/")
    for path in view.datasets:
        if path.startswith(roots) and match(path) is None:
            yield (
                path,
                "not part of the contract",
                "a path of the table in docs/simulation-h5.md",
                "make it a channel, or move it below /extensions/<your distribution>",
            )


@check("OPS-L03", "error", "every dataset has the stated shape, letters meaning one number each")
def shapes(view: View) -> Iterator[Complaint]:
    """Shapes, with T, N and D shared over the whole file and E over a kind of element."""
    sizes = {"T": view.n_frames, "N": view.n_nodes}
    positions = view.dataset(POSITIONS)
    if positions is not None and positions.ndim == 3:
        sizes["D"] = int(positions.shape[2])
    for path, (rule, holders) in view.ruled.items():
        local = dict(sizes)
        kind = holders.get("kind")
        if kind is not None:
            indices = view.dataset(f"/topology/{kind}/indices")
            if indices is not None and indices.ndim == 2:
                local["E"] = int(indices.shape[0])
            if kind in ELEMENT_ARITY:
                local["k"] = ELEMENT_ARITY[kind]
        yield from _shape(path, view.datasets[path], rule, local)


def _shape(
    path: str, item: h5py.Dataset, rule: DatasetRule, sizes: dict[str, int]
) -> Iterator[Complaint]:
    found = item.shape
    wanted = tuple(letter for letter in rule.shape if not letter.endswith("?"))
    ranks = {len(wanted), len(rule.shape)}
    if found is None or len(found) not in ranks:
        text = f"({', '.join(rule.shape)})" if rule.shape else "a scalar"
        yield path, f"shape {found}", text, _REWRITE
        return
    for letter, size in zip(rule.shape, found, strict=False):
        known = sizes.get(letter.rstrip("?")) if not letter.endswith("?") else None
        if known is not None and known != size:
            yield path, f"shape {found}: {letter} is {size}", f"{letter} = {known}", _REWRITE
        elif letter == "D" and size not in (2, 3):
            yield path, f"shape {found}: D is {size}", "2 or 3 dimensions", _REWRITE
        elif letter in ("N", "C", "E", "K") and size == 0 and letter != "E":
            yield path, f"shape {found}: {letter} is 0", "at least one", "leave the dataset out"


@check("OPS-L04", "error", "every dataset has one of the stated types")
def types(view: View) -> Iterator[Complaint]:
    """Types."""
    for path, (rule, _) in view.ruled.items():
        found = type_name(view.datasets[path].dtype)
        if found not in rule.dtypes:
            yield path, f"type {found}", " or ".join(rule.dtypes), _REWRITE


def type_name(dtype: np.dtype[np.generic]) -> str:
    """Return the type as the table writes it: f8, i4, u1, str, table."""
    if dtype.names:
        return "table"
    if h5py.check_string_dtype(dtype) is not None:
        return "str"
    return f"{dtype.kind}{dtype.itemsize}"


@check("OPS-L05", "error", "every dataset has the attributes that its rule demands")
def attributes(view: View) -> Iterator[Complaint]:
    """Attributes of datasets."""
    for path, (rule, _) in view.ruled.items():
        owner = view.datasets[path]
        for wanted in attributes_of(rule.path):
            if wanted.name not in owner.attrs:
                if wanted.need == "required":
                    yield path, f"attribute {wanted.name} is missing", wanted.meaning, _REWRITE
                continue
            value = view.attribute(path, wanted.name)
            if wanted.choices and value not in wanted.choices:
                yield path, f"{wanted.name} is {value!r}", " or ".join(wanted.choices), _REWRITE
            elif not _has_type(value, wanted.type):
                yield (
                    path,
                    f"{wanted.name} is {value!r}",
                    f"a value of type {wanted.type}",
                    _REWRITE,
                )


def _has_type(value: object, wanted: str) -> bool:
    if wanted == "strings":
        return isinstance(value, tuple) and all(isinstance(item, str) for item in value)
    kinds: dict[str, tuple[type, ...]] = {"str": (str,), "int": (int,), "float": (int, float)}
    return isinstance(value, kinds[wanted]) and not isinstance(value, bool)


@check("OPS-L06", "error", "columns and axes name every column once")
def columns(view: View) -> Iterator[Complaint]:
    """Column names."""
    for path in view.ruled:
        item = view.datasets[path]
        for name in ("columns", "axes"):
            if name not in item.attrs or item.ndim == 0:
                continue
            names = [str(n) for n in np.atleast_1d(view.attribute(path, name))]
            if len(names) != item.shape[-1] or len(set(names)) != len(names):
                yield path, f"{name} {names}", f"{item.shape[-1]} different names", _REWRITE


@check("OPS-L07", "error", "every unit is in the closed list")
def known_units(view: View) -> Iterator[Complaint]:
    """Units."""
    for path, item in view.datasets.items():
        if "unit" in item.attrs and view.attribute(path, "unit") not in UNITS:
            yield (
                path,
                f"unknown unit {view.attribute(path, 'unit')!r}",
                "one of " + " ".join(UNITS),
                "convert the values, or say 'arb' when there is no unit",
            )


@check("OPS-L08", "error", "si_factor is the factor of the unit")
def factors(view: View) -> Iterator[Complaint]:
    """Factors to SI."""
    for path, item in view.datasets.items():
        unit, factor = view.attribute(path, "unit"), view.attribute(path, "si_factor")
        if (
            "si_factor" not in item.attrs
            or unit not in UNITS
            or not isinstance(factor, int | float)
        ):
            continue
        wanted = UNITS[unit].si_factor
        same = math.isclose(factor, wanted, rel_tol=1e-12) or (
            math.isnan(factor) and math.isnan(wanted)
        )
        if not same:
            yield path, f"si_factor {factor!r} for {unit!r}", f"{wanted!r}", _REWRITE


@check("OPS-L09", "error", "units measure what the dataset holds")
def dimensions(view: View) -> Iterator[Complaint]:
    """Physical dimensions: lengths in units of length, masses in units of mass."""
    for path, allowed in PHYSICAL_DIMENSIONS.items():
        unit = view.attribute(path, "unit") if path in view.datasets else None
        if unit in UNITS and UNITS[unit].dimension not in allowed:
            yield path, f"{unit!r}, a unit of {UNITS[unit].dimension}", allowed[0], "correct it"


@check("OPS-L10", "error", "there are positions or channels")
def recorded(view: View) -> Iterator[Complaint]:
    """Something must have been recorded."""
    if view.dataset(POSITIONS) is None and not any(
        path.startswith("/time_series/channels/") for path in view.datasets
    ):
        yield "/time_series", "neither positions nor channels", "one of them", _REWRITE


@check("OPS-L11", "error", "conditional datasets are there where their condition holds")
def conditional(view: View) -> Iterator[Complaint]:
    """Indices of every kind of element, values of every input, t0 and dt of uniform time."""
    series, topology = "/time_series/elements", "/topology"
    kinds = {n for n in view.children(series) if f"{series}/{n}" not in view.datasets}
    kinds |= {
        n
        for n in view.children(topology)
        if n != "nodes" and f"{topology}/{n}" not in view.datasets
    }
    for kind in sorted(kinds):
        path = f"{topology}/{kind}/indices"
        if path not in view.datasets:
            yield path, f"no indices for {kind}", "the nodes of every element", _REWRITE
    for name in view.children("/inputs"):
        path = f"/inputs/{name}/value"
        if path not in view.datasets:
            yield path, f"input {name} has no value", "(T, C) on the clock of the file", _REWRITE
    if view.attribute(TIME, "uniform") == 1:
        for name in ("t0", "dt"):
            if view.attribute(TIME, name) is None:
                yield TIME, f"uniform is 1 and {name} is missing", f"attribute {name}", _REWRITE
