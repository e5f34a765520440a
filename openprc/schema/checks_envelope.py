"""Checks of the envelope: root attributes, status, provenance, extensions."""

from __future__ import annotations

import re
import uuid
from collections.abc import Iterator
from datetime import datetime

import numpy as np

from openprc.schema.layout import ROOT_GROUPS, TIME_AXIS, attributes_of
from openprc.schema.validate import Complaint, check
from openprc.schema.view import POSITIONS, TIME, View

_REWRITE = "write the file with TrajectoryWriter"


@check("OPS-R01", "error", "every required root attribute is present")
def root_attributes(view: View) -> Iterator[Complaint]:
    """Required root attributes."""
    for rule in attributes_of("/"):
        if rule.need == "required" and rule.name not in view.file.attrs:
            yield "/", f"root attribute {rule.name} is missing", rule.meaning, _REWRITE


@check("OPS-R02", "error", "root attributes have the stated type and one of the stated values")
def root_values(view: View) -> Iterator[Complaint]:
    """Types and choices of root attributes."""
    kinds = {"str": str, "int": int, "float": float}
    for rule in attributes_of("/"):
        if rule.name not in view.file.attrs:
            continue
        value = view.attribute("/", rule.name)
        if not isinstance(value, kinds.get(rule.type, str)) or isinstance(value, bool):
            yield "/", f"{rule.name} is {value!r}", f"a value of type {rule.type}", _REWRITE
        elif rule.choices and value not in rule.choices:
            yield "/", f"{rule.name} is {value!r}", " or ".join(rule.choices), _REWRITE
        elif rule.need == "optional" and value == "":
            yield "/", f"{rule.name} is empty", "absent rather than empty", "delete it"


@check("OPS-R03", "error", "the file holds a trajectory")
def kind(view: View) -> Iterator[Complaint]:
    """Kind of the file."""
    value = view.attribute("/", "kind")
    if value in ("readout", "metrics", "optimization"):
        yield "/", f"the file holds {value}", "a trajectory", "see it with `openprc info`"


@check("OPS-R04", "error", "run_id is a UUID and created an ISO 8601 instant in UTC")
def identity(view: View) -> Iterator[Complaint]:
    """Identity of the run."""
    run_id, created = view.attribute("/", "run_id"), view.attribute("/", "created")
    if isinstance(run_id, str):
        try:
            uuid.UUID(run_id)
        except ValueError:
            yield "/", f"run_id is {run_id!r}", "a UUID", _REWRITE
    if isinstance(created, str):
        try:
            instant = datetime.fromisoformat(created)
        except ValueError:
            instant = None
        if instant is None or instant.utcoffset() is None or instant.utcoffset():
            yield "/", f"created is {created!r}", "ISO 8601 with the offset of UTC", _REWRITE


@check("OPS-R05", "error", "the run has ended")
def ended(view: View) -> Iterator[Complaint]:
    """Runs that were killed or failed."""
    status = view.attribute("/", "status")
    if status in ("running", "failed"):
        yield (
            "/",
            f"status is {status!r}",
            "complete",
            "keep what was committed with `openprc repair`, or run it again",
        )


@check("OPS-R06", "warning", "the run was not interrupted")
def interrupted(view: View) -> Iterator[Complaint]:
    """Runs cut short but whole."""
    if view.attribute("/", "status") == "interrupted":
        yield (
            "/",
            "the run was interrupted: frames at the end are missing",
            "complete",
            "run it again",
        )


@check("OPS-R07", "error", "dims equals the number of axes of the positions, 0 without positions")
def dims(view: View) -> Iterator[Complaint]:
    """Dimensions."""
    item = view.dataset(POSITIONS)
    wanted = int(item.shape[2]) if item is not None and item.ndim == 3 else 0
    stated = view.attribute("/", "dims")
    if isinstance(stated, int) and stated != wanted:
        yield "/", f"dims is {stated}, the positions have {wanted} axes", f"dims {wanted}", _REWRITE


@check("OPS-R08", "warning", "nothing but the groups of the contract stands at the root")
def strays(view: View) -> Iterator[Complaint]:
    """Unknown objects at the root."""
    for name in view.file:
        if name not in ROOT_GROUPS:
            yield (
                f"/{name}",
                "not part of the contract",
                "one of " + ", ".join(ROOT_GROUPS),
                "move it below /extensions/<your distribution>",
            )
        elif (name == "committed") != (f"/{name}" in view.datasets):
            wanted = "a dataset" if name == "committed" else "a group"
            yield f"/{name}", f"not {wanted}", wanted, _REWRITE


@check("OPS-R09", "error", "/committed equals the number of frames")
def committed(view: View) -> Iterator[Complaint]:
    """Commit counter."""
    item = view.dataset("/committed")
    if item is None or item.shape != () or item.dtype.kind not in "iu":
        return
    if view.dataset(TIME) is not None and int(item[()]) != view.n_frames:
        yield (
            "/committed",
            f"{int(item[()])} rows are committed, {view.n_frames} are there",
            "equal numbers in a finished file",
            "cut the rest off with `openprc repair`",
        )


@check("OPS-P01", "error", "/provenance states every required attribute")
def provenance(view: View) -> Iterator[Complaint]:
    """Provenance."""
    if "/provenance" not in view.objects:
        yield "/provenance", "the group is missing", "who made the file and how", _REWRITE
        return
    for rule in attributes_of("/provenance"):
        if rule.need == "required" and not view.attribute("/provenance", rule.name):
            yield "/provenance", f"attribute {rule.name} is missing", rule.meaning, _REWRITE


@check("OPS-P02", "error", "sources are listed by base name with a SHA-256")
def sources(view: View) -> Iterator[Complaint]:
    """Table of the files that were read."""
    item = view.dataset("/provenance/inputs")
    if item is None:
        return
    names = item.dtype.names or ()
    if set(names) != {"role", "name", "bytes", "sha256"}:
        yield "/provenance/inputs", f"columns {names}", "role, name, bytes, sha256", _REWRITE
        return
    for row in item[()]:
        name, digest = (_text(row[field]) for field in ("name", "sha256"))
        if "/" in name or "\\" in name:
            yield "/provenance/inputs", f"a path: {name!r}", "base names only", _REWRITE
        if not re.fullmatch(r"[0-9a-f]{64}", digest):
            yield "/provenance/inputs", f"sha256 of {name} is {digest!r}", "64 hex digits", _REWRITE


@check("OPS-X01", "error", "every extension states its version")
def extensions(view: View) -> Iterator[Complaint]:
    """Extensions."""
    for name in view.children("/extensions"):
        path = f"/extensions/{name}"
        if path in view.datasets:
            yield path, "a dataset", "a group named after a distribution", "put it below one"
        elif not view.attribute(path, "version"):
            yield path, "attribute version is missing", "the version of the extension", "state it"


@check("OPS-X04", "error", "a time series of an extension has one row a frame")
def extension_series(view: View) -> Iterator[Complaint]:
    """Time series of extensions."""
    for path, item in view.datasets.items():
        axis = view.attribute(path, TIME_AXIS)
        if not path.startswith("/extensions/") or axis is None:
            continue
        if axis != 0:
            yield path, f"{TIME_AXIS} is {axis!r}", "0, or no such attribute", _REWRITE
        elif item.shape is None or item.ndim == 0 or len(item) != view.n_frames:
            yield path, f"shape {item.shape}", f"{view.n_frames} rows, one a frame", _REWRITE


def _text(value: object) -> str:
    return value.decode(errors="replace") if isinstance(value, bytes | np.bytes_) else str(value)
