"""Checks that only some uses demand: benchmarking and archiving."""

from __future__ import annotations

from collections.abc import Iterator

from openprc.schema.validate import Complaint, check
from openprc.schema.view import TIME, View


@check("OPS-B01", "error", "frames are evenly spaced", profile="benchmark")
def uniform(view: View) -> Iterator[Complaint]:
    """Benchmarks need a uniform clock."""
    if view.attribute(TIME, "uniform") != 1:
        yield TIME, "frames are not evenly spaced", "a uniform clock", "resample the file"


@check("OPS-B02", "error", "time is physical", profile="benchmark")
def physical(view: View) -> Iterator[Complaint]:
    """Benchmarks need physical time."""
    if view.attribute(TIME, "kind") != "physical":
        yield TIME, "load steps instead of time", "physical time", "benchmark a dynamic run"


@check("OPS-B03", "error", "there is an input", profile="benchmark")
def has_input(view: View) -> Iterator[Complaint]:
    """Benchmarks need the drive."""
    if not view.children("/inputs"):
        yield "/inputs", "no input", "what drove the body", "add it with `openprc attach-input`"


@check("OPS-A01", "error", "every file that was read is listed with its hash", profile="archive")
def hashed(view: View) -> Iterator[Complaint]:
    """Archives need the hashes of what a file was made from."""
    item = view.dataset("/provenance/inputs")
    parents = view.dataset("/provenance/parents")
    if (item is None or not len(item)) and parents is None:
        yield (
            "/provenance/inputs",
            "no source is listed",
            "role, name, bytes and sha256",
            ("make the file again with `openprc import` or `openprc run`"),
        )


@check("OPS-A02", "error", "no unit is arbitrary", profile="archive")
def real_units(view: View) -> Iterator[Complaint]:
    """Archives need units."""
    for path in view.datasets:
        if view.attribute(path, "unit") in ("arb", "arb/s"):
            yield path, "arbitrary unit", "a unit of the closed list", "say the unit on import"


@check("OPS-A03", "warning", "the versions of producer and plugin are known", profile="archive")
def versions(view: View) -> Iterator[Complaint]:
    """Archives should know the versions."""
    for name in ("producer_version", "plugin_version"):
        if view.attribute("/provenance", name) == "unknown":
            yield "/provenance", f"{name} is unknown", "a version", "state it"
