"""IMPORT: what comes of importing the sample, and what it leaves behind."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from openprc.hooks.validating import validate_run
from openprc.schema.provenance import Source
from openprc.schema.trajectory import Trajectory
from openprc.testing.cases import ImporterCase
from openprc.testing.check import check
from openprc.testing.outcome import NotApplicable, fail
from openprc.testing.watching import changes, elsewhere, snapshot, watching
from openprc.testing.workbench import copy_sample, import_sample, imported


@check("IMPORT-1", "the sample is imported, and the file is valid", "importer")
def result_validates(case: ImporterCase, folder: Path) -> None:
    """Import the sample and validate the result."""
    out = folder / "out.h5"
    import_sample(case, copy_sample(case, folder / "sample"), out)
    report = validate_run(out, registry=case.plugins)
    worst = [finding for finding in report.findings if finding.level == "error"]
    # A check of the plugin's own subtree that fails itself is the plugin's fault, too.
    worst += [finding for finding in report.findings if finding.code == "OPS-X03"]
    if worst:
        first = worst[0]
        fail(f"{first.code} at {first.path}: {first.found}", expected=first.expected, fix=first.fix)


@check("IMPORT-2", "missing points are NaN and marked, and only those", "importer")
def nan_and_mask_agree(case: ImporterCase, folder: Path) -> None:
    """Compare NaN with the mask, and the mask with what the author says is missing."""
    del folder
    with Trajectory(imported(case)) as run:
        if not run.n_nodes:
            raise NotApplicable("the sample has no nodes")
        gaps = np.asarray(np.isnan(run.positions()).any(axis=2))
        masked = run.has("/time_series/nodes/observed")
        mask = run.observed() if masked else np.ones(gaps.shape, np.uint8)
    wrong = np.argwhere(gaps != (mask == 0))
    if len(wrong):
        frame, node = wrong[0]
        fail(
            f"node {node} of frame {frame} is {'NaN' if gaps[frame, node] else 'a number'} and "
            f"marked {mask[frame, node]}",
            expected="NaN exactly where the mask is 0",
            fix="pass observed= to writer.append()",
        )
    truth = case.truth() if case.truth else {}
    if "observed" not in truth:
        return
    wanted = np.asarray(truth["observed"])
    if wanted.shape != mask.shape:
        fail(
            f"the mask has the shape {mask.shape}",
            expected=f"{wanted.shape}",
            fix="one mark for each frame and node",
        )
    wrong = np.argwhere(wanted != mask)
    if len(wrong):
        frame, node = wrong[0]
        fail(
            f"node {node} of frame {frame} is marked {mask[frame, node]}",
            expected=f"{wanted[frame, node]}: 0 missing, 1 measured, 2 filled in",
            fix="leave what was not measured NaN; do not write zeros",
        )


@check("IMPORT-3", "every file that was read is hashed under its own name", "importer")
def sources_are_hashed(case: ImporterCase, folder: Path) -> None:
    """Watch what is opened, and look it up in the provenance."""
    imported(case)
    home = folder / "sample"
    sample = copy_sample(case, home)
    path = Path(sample.path).resolve()
    with watching() as watched:
        import_sample(case, sample, folder / "out.h5")
    with Trajectory(folder / "out.h5") as run:
        rows = {row["name"]: row for row in run.provenance["inputs"]}
    expected = Source.of(path, role="source")
    row = rows.get(expected.name)
    if row is None or row["sha256"] != expected.sha256:
        fail(
            f"the provenance lists {sorted(rows)}",
            expected=f"{expected.name} with its SHA-256",
            fix="leave add_source() of the path itself to the host",
        )
    read = {p.resolve() for p in watched.read if p.resolve().is_relative_to(home.resolve())}
    for file in sorted(read):
        if file.is_relative_to(path) or not file.is_file():
            continue
        known = {row["sha256"] for row in rows.values()}
        if hashlib.sha256(file.read_bytes()).hexdigest() not in known:
            fail(
                f"{file.name} was read and is not in the provenance",
                expected="every file that the result depends on",
                fix="call writer.add_source(file) for it",
            )


@check("IMPORT-4", "what is imported stays as it is", "importer")
def source_is_untouched(case: ImporterCase, folder: Path) -> None:
    """Compare bytes and times of the files before and after."""
    imported(case)
    home = folder / "sample"
    sample = copy_sample(case, home)
    before, times = snapshot(home), _times(home)
    import_sample(case, sample, folder / "out.h5")
    told = changes(before, snapshot(home))
    told += [f"{name} was written to" for name, t in _times(home).items() if times.get(name) != t]
    if told:
        fail(
            f"importing changes its source: {told[0]}",
            expected="reading only",
            fix="open files for reading; put nothing beside them",
        )


def _times(folder: Path) -> dict[str, int]:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.stat().st_mtime_ns for path in files}


@check("IMPORT-5", "nothing is written but the result", "importer")
def nothing_is_written_elsewhere(case: ImporterCase, folder: Path) -> None:
    """Import with empty folders as current, home and temporary ones, and look into them."""
    imported(case)
    sample = copy_sample(case, folder / "sample")
    target = folder / "out"
    with elsewhere(folder / "else") as other:
        before = snapshot(other)
        with watching() as watched:
            import_sample(case, sample, target / "out.h5")
        left = changes(before, snapshot(other))
    # Scratch files are nobody's business as long as they are gone.
    astray = watched.written_outside(target, folder / "else" / "temporary")
    told = left + [f"{path} was written" for path in astray]
    told += [f"{name} lies beside the result" for name in _beside(target)]
    if told:
        fail(
            f"importing leaves something behind: {told[0]}",
            expected="the result and nothing else",
            fix="write through the writer; use and remove a temporary folder",
        )


def _beside(target: Path) -> list[str]:
    return [path.name for path in target.iterdir() if path.name != "out.h5"]


@check("IMPORT-6", "importing prints nothing and warns of nothing", "importer")
def importing_is_silent(case: ImporterCase, folder: Path) -> None:
    """Import and listen."""
    imported(case)
    sample = copy_sample(case, folder / "sample")
    with watching() as watched:
        import_sample(case, sample, folder / "out.h5")
    if watched.printed.strip() or watched.warned:
        text = watched.printed.strip() or watched.warned[0]
        fail(
            f"importing says {text[:200]!r}",
            expected="silence",
            fix="say what a reader of the data should know with writer.note()",
        )
