"""Runs that a recorder's script made, each made once."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from openprc.testing.outcome import NotApplicable
from openprc.testing.workbench import bench_of

if TYPE_CHECKING:
    from openprc.testing.cases import RecorderCase


def recorded(case: RecorderCase) -> Path:
    """Return the file that the case's script records, made once.

    Raises
    ------
    NotApplicable
        When there is no script, or it fails; RECORD-1 says why.
    """
    if case.script is None:
        raise NotApplicable("the case has no script that records something")
    bench = bench_of(case)
    out = bench.folder / "recorded.h5"
    if "recorded" not in bench.made:
        bench.made["recorded"] = False
        try:
            case.script(out)
        except Exception as error:  # what a script raises is for RECORD-1 to tell
            raise NotApplicable("the script fails: see RECORD-1") from error
        bench.made["recorded"] = out.exists()
    if not bench.made["recorded"]:
        raise NotApplicable("the script leaves no file: see RECORD-1")
    return out


__all__ = ["recorded"]
