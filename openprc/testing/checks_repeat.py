"""REPEAT: importing says the same thing every time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from openprc.schema.trajectory import Trajectory
from openprc.testing.cases import ImporterCase
from openprc.testing.check import check
from openprc.testing.outcome import fail
from openprc.testing.processes import answer_of
from openprc.testing.workbench import copy_sample, import_sample, imported


def _digest(path: Path) -> str:
    with Trajectory(path) as run:
        return run.content_digest()


@check("REPEAT-1", "importing twice gives one content", "importer")
def twice_is_once(case: ImporterCase, folder: Path) -> None:
    """Import the sample again and compare content digests."""
    first = imported(case)
    import_sample(case, copy_sample(case, folder / "sample"), folder / "again.h5")
    if _digest(first) != _digest(folder / "again.h5"):
        fail(
            "two imports of one sample have different contents",
            expected="the same content",
            fix="leave dates, chance and the order of sets out of what is written",
        )


@check("REPEAT-2", "another process, folder and hash seed give the same content", "importer",
       apart=True)  # fmt: skip
def anywhere_is_here(case: ImporterCase, folder: Path) -> None:
    """Import a copy in a fresh interpreter with another PYTHONHASHSEED."""
    first = imported(case)
    sample = copy_sample(case, folder / "other place" / "sample")
    order: dict[str, Any] = {
        "module": case.module,
        "distribution": case.item.distribution,
        "version": case.item.version,
        "hook": case.hook,
        "name": case.name,
        "capability": "import",
        "sample": sample.path,
        "options": dict(sample.options),
        "trust": case.trust or case.record.trusts_pickle,
        "out": folder / "again.h5",
    }
    answer = answer_of(
        ["-m", "openprc.testing.isolated"],
        given=order, folder=folder, environment={"PYTHONHASHSEED": "4711"},
    )  # fmt: skip
    if "error" in answer:
        fail(
            f"a fresh interpreter refuses the sample: {answer['found']}",
            expected="the same result everywhere",
            fix="look for state that is left in modules",
        )
    if answer["digest"] != _digest(first):
        fail(
            "the content depends on the process, the folder or the hash seed",
            expected="the same content everywhere",
            fix="sort sets and folders; store no paths",
        )
