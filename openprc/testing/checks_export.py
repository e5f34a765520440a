"""EXPORT: what goes out comes back, and nothing else happens."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from openprc.errors import OpenPRCError, PluginError
from openprc.hooks.exporting import export_file
from openprc.hooks.importing import import_file
from openprc.hooks.options import check_options
from openprc.schema.trajectory import Trajectory
from openprc.testing.cases import ExporterCase
from openprc.testing.check import check
from openprc.testing.closed_form_trajectories import KINDS, trajectory
from openprc.testing.diagnosis import deviation, explain
from openprc.testing.outcome import NotApplicable, fail
from openprc.testing.watching import changes, elsewhere, snapshot, watching


def _name(case: ExporterCase) -> str:
    suffixes = case.record.suffixes
    return "out" + (case.suffix or (suffixes[0] if suffixes else f".{case.name}"))


def _export(case: ExporterCase, kind: str, out: Path) -> tuple[Path, ...]:
    """Export a copy that lies beside `out`: files that refer to it may stay in their folder."""
    out.parent.mkdir(parents=True, exist_ok=True)
    source = out.parent / "simulation.h5"
    shutil.copyfile(trajectory(kind), source)
    return export_file(
        source, out, to=case.item.qualified_name, options=case.options, registry=case.plugins
    )


@check(
    "EXPORT-1",
    "a body is exported; what the format has no room for is refused with a named error",
    "exporter",
)
def exports_or_refuses(case: ExporterCase, folder: Path) -> None:
    """Export trajectories with bars, in a plane, with gaps, and without nodes."""
    for kind, what in KINDS.items():
        out = folder / kind / _name(case)
        try:
            made = _export(case, kind, out)
        except OpenPRCError as error:
            if type(error) is PluginError:
                fail(
                    f"{what}: {error.found}",
                    expected="files, or an error that says why not",
                    fix="raise MissingData, UnsupportedScene, ... with found, expected and fix",
                )
            if kind == "body":
                fail(
                    f"{what}: {type(error).__name__}: {error.found}",
                    expected="files; what has no room in them may stay behind",
                    fix="export positions in SI units at least",
                )
            continue
        empty = [path.name for path in made if not path.is_file() or not path.stat().st_size]
        if empty:
            fail(
                f"{what}: {empty[0]} is empty",
                expected="files with something in them",
                fix="report the files that were written",
            )


@check(
    "EXPORT-2",
    "exported and imported again, positions, times and inputs are the same",
    "exporter",
)
def way_out_and_back(case: ExporterCase, folder: Path) -> None:
    """Export, import with the producer of the case, and compare."""
    if case.importer is None:
        raise NotApplicable("the case names no importer for this format (importer=)")
    for kind in KINDS:
        out = folder / kind / _name(case)
        try:
            _export(case, kind, out)
        except OpenPRCError:
            continue  # whether it may be refused is for EXPORT-1 to say
        back = folder / kind / "back.h5"
        import_file(
            out, back, as_name=case.importer, options=case.import_options, registry=case.plugins
        )
        with Trajectory(trajectory(kind)) as one, Trajectory(back) as two:
            _compare(case, kind, one, two)


def _compare(case: ExporterCase, kind: str, one: Trajectory, two: Trajectory) -> None:
    pairs = {"times": (two.time, one.time)}
    if one.n_nodes:
        if not two.n_nodes:
            fail(
                f"{KINDS[kind]}: no nodes came back",
                expected=f"{one.n_nodes}",
                fix="export positions",
            )
        unit = one.position_unit
        pairs["positions"] = (two.positions(unit=unit), one.positions())
    for name in one.inputs:
        if name in two.inputs:
            pairs[f"input {name!r}"] = (two.input(name).value, one.input(name).value)
    for name in one.channels:
        if name in two.channels:
            pairs[f"channel {name!r}"] = (two.channel(name), one.channel(name))
    for name, (found, wanted) in pairs.items():
        why = explain(found, wanted, tolerance=case.tolerance)
        if found.shape != wanted.shape:
            fail(
                f"{KINDS[kind]}: {name} come back with the shape {found.shape}; {why}",
                expected=f"{wanted.shape}",
                fix="export every frame and node",
            )
        if not np.array_equal(np.isnan(found), np.isnan(wanted)):
            fail(
                f"{KINDS[kind]}: {int(np.isnan(found).sum())} numbers of the {name} are missing",
                expected=f"{int(np.isnan(wanted).sum())}",
                fix="leave missing points missing; refuse what has no room for them",
            )
        off = deviation(found, wanted)
        if off > case.tolerance:
            fail(
                f"{KINDS[kind]}: {name} come back {off:.3g} of their spread off; {why}",
                expected=f"within {case.tolerance:g}",
                fix="write numbers with all their digits",
            )


@check("EXPORT-3", "nothing is written beside the files that are reported, and nothing is changed",
       "exporter")  # fmt: skip
def nothing_else_is_written(case: ExporterCase, folder: Path) -> None:
    """Call the exporter itself in a folder with another file, and look around."""
    source = trajectory("body")
    target = folder / "out"
    target.mkdir()
    (target / "other.txt").write_text("of somebody else\n", encoding="utf-8")
    options = check_options(case.record, case.record.options, case.options)
    content = source.read_bytes()
    with elsewhere(folder / "else") as other:
        here, there = snapshot(target), snapshot(other)
        exporter = case.plugins.load(case.item)()
        with watching() as watched, Trajectory(source) as run:
            final = target / _name(case)
            made = [
                Path(p) for p in exporter.export(run, final, options={**options, "final": final})
            ]
        told = changes(there, snapshot(other))
        told += [text for text in changes(here, snapshot(target))
                 if text.removesuffix(" is new") not in {path.name for path in made}]  # fmt: skip
    stray = [path for path in made if path.parent != target or not path.is_file()]
    if stray or not made:
        fail(
            f"export() reports {stray[0] if stray else 'no file'}",
            expected="the files that it made, beside the path it was given",
            fix="return every file that was written",
        )
    told += [f"{path} was written" for path in
             watched.written_outside(target, folder / "else" / "temporary")]  # fmt: skip
    if source.read_bytes() != content:
        told.append("the trajectory differs")
    if told:
        fail(
            f"besides the files it reports, {told[0]}",
            expected="these files and nothing else",
            fix="report every file; use and remove a temporary folder",
        )
    if watched.printed.strip() or watched.warned:
        text = watched.printed.strip() or watched.warned[0]
        fail(
            f"exporting says {text[:200]!r}",
            expected="silence",
            fix="raise what is wrong, and leave the rest unsaid",
        )
