"""ROBUST: damaged and hostile files end in an error with a name, or in a valid result."""

from __future__ import annotations

import os
import shutil
import time
from pathlib import Path

import numpy as np

from openprc.errors import OpenPRCError, PluginError
from openprc.hooks.importing import import_file
from openprc.hooks.protocols import Sample
from openprc.schema.atomic import partial_path
from openprc.testing.cases import ImporterCase
from openprc.testing.check import check
from openprc.testing.damage import (
    bombs,
    chosen,
    entity_document,
    flip,
    members,
    redirected,
    restored,
    sizes_to_cut,
    traversing_archive,
    truncate,
)
from openprc.testing.outcome import fail
from openprc.testing.watching import watching
from openprc.testing.workbench import copy_sample, imported

#: Files with flipped bits that are tried, and the seconds after which fewer will do.
N_FLIPS = 16
_ENOUGH = 6
_PATIENCE = 6.0


def attempt(
    case: ImporterCase, sample: Sample, out: Path, *, what: str, trust: bool = True
) -> bool:
    """Import what became of the sample; return whether that gave a result.

    Raises
    ------
    CheckFailed
        When the error is none of this package's, or something is left behind.
    """
    try:
        import_file(
            sample.path, out, as_name=case.item.qualified_name, options=sample.options,
            trust=trust and case.record.trusts_pickle, registry=case.plugins,
        )  # fmt: skip
    except OpenPRCError as error:
        if type(error) is PluginError:
            fail(
                f"{what}: {error.found}",
                expected="an error that says what is wrong with the file",
                fix="raise UnreadableFile, SchemaError, ... with found, expected and fix",
            )
        if not (error.found and error.expected and error.fix):
            fail(
                f"{what}: {type(error).__name__} says {error.found!r}, expected "
                f"{error.expected!r}, to do {error.fix!r}",
                expected="all three",
                fix="say what was found, what was expected, and what to do",
            )
        left = [path.name for path in (out, partial_path(out)) if path.exists()]
        if left:
            fail(
                f"{what}: {', '.join(left)} was left behind",
                expected="nothing",
                fix="write through the writer that the host passes",
            )
        return False
    out.unlink()
    return True


@check("ROBUST-1", "truncated files give a named error or a valid result, and nothing else",
       "importer")  # fmt: skip
def truncated_files(case: ImporterCase, folder: Path) -> None:
    """Cut every file of the sample at several places."""
    imported(case)
    sample = copy_sample(case, folder / "sample")
    files = members(folder / "sample")
    # A folder of hundreds of like files is represented by its first, middle and last one.
    for index in sorted({0, len(files) // 2, len(files) - 1}):
        file = files[index]
        for size in sizes_to_cut(file.stat().st_size):
            with restored(file):
                truncate(file, size)
                attempt(case, sample, folder / "out.h5", what=f"{file.name} cut to {size} bytes")


@check(
    "ROBUST-2",
    "flipped bits give a named error or a valid result, and nothing else",
    "importer",
)
def flipped_bits(case: ImporterCase, folder: Path) -> None:
    """Flip bits in many copies of the sample, always the same ones."""
    imported(case)
    sample = copy_sample(case, folder / "sample")
    began = time.perf_counter()
    for seed in range(N_FLIPS):
        rng = np.random.default_rng(seed)
        file = chosen(folder / "sample", rng)
        with restored(file):
            done = flip(file, rng)
            attempt(case, sample, folder / "out.h5", what=f"{done} (seed {seed})")
        if seed >= _ENOUGH and time.perf_counter() - began > _PATIENCE:
            return


@check("ROBUST-3", "empty files and folders give a named error", "importer")
def empty_files(case: ImporterCase, folder: Path) -> None:
    """Empty the sample, and in a folder one file after the other."""
    imported(case)
    sample = copy_sample(case, folder / "sample")
    path = Path(sample.path)
    files = members(folder / "sample")
    for index in sorted({0, len(files) // 2, len(files) - 1}):
        file = files[index]
        with restored(file):
            truncate(file, 0)
            made = attempt(case, sample, folder / "out.h5", what=f"{file.name} emptied")
        if made and file == path:
            fail("an empty file gives a result", expected="UnreadableFile", fix="check the size")
    if path.is_dir():
        for file in files:
            file.unlink()
        if attempt(case, sample, folder / "out.h5", what="a folder without files"):
            fail("an empty folder gives a result", expected="UnreadableFile", fix="look first")


@check("ROBUST-4", "code in a pickle is never run, whether or not the file is trusted", "importer")
def pickle_bombs(case: ImporterCase, folder: Path) -> None:
    """Put pickles that run code in the place of the sample."""
    imported(case)
    sample = copy_sample(case, folder / "sample")
    marker = folder / "executed"
    path = Path(sample.path)
    targets = [path] if path.is_file() else members(path)[:1]
    original = targets[0].read_bytes()
    for what, content in list(bombs(targets[0], marker)):
        suffixes = case.record.suffixes if path.is_file() else ()
        for name in dict.fromkeys([targets[0].name, *(f"bomb{s}" for s in suffixes)]):
            file = targets[0].with_name(name)
            file.write_bytes(content)
            hostile = Sample(file if path.is_file() else path, sample.options)
            for trust in (False, True):
                attempt(case, hostile, folder / "out.h5", what=f"{what} as {name}", trust=trust)
                if marker.exists():
                    marker.rmdir()
                    fail(
                        f"{what}, named {name}, was run{' when trusted' if trust else ''}",
                        expected="UntrustedPickle or UnsafeFile",
                        fix="read with openprc.schema.safety.load_pickle and load_npz",
                    )
        targets[0].write_bytes(original)


@check("ROBUST-5", "a file does not lead to other files", "importer")
def files_that_lead_outside(case: ImporterCase, folder: Path) -> None:
    """Move the data elsewhere, behind links, and see whether they are followed."""
    imported(case)
    sample = copy_sample(case, folder / "sample")
    path = Path(sample.path)
    file = path if path.is_file() else members(path)[0]
    original = file.read_bytes()
    outside = folder / "outside"
    outside.mkdir()
    elsewhere = outside / "elsewhere.h5"
    for virtual, what in ((False, "an external link"), (True, "a virtual dataset")):
        file.write_bytes(original)
        if redirected(file, elsewhere, virtual=virtual) and attempt(
            case, sample, folder / "out.h5", what=what
        ):
            fail(
                f"data behind {what} in HDF5 were read from another file",
                expected="UnsafeFile",
                fix="open files of strangers with openprc.schema.safety.open_hdf5",
            )
    for content, what in (
        (traversing_archive(), "an archive with ../ in a name"),
        (entity_document(elsewhere), "XML with an external entity"),
    ):
        file.write_bytes(content)
        with watching() as watched:
            attempt(case, sample, folder / "out.h5", what=what)
        if elsewhere in watched.read or (folder / "escaped.txt").exists():
            fail(
                f"{what} was followed",
                expected="UnsafeFile",
                fix="unpack nothing; refuse documents with a DOCTYPE",
            )


@check("ROBUST-6", "a folder in the place of a file, or a file in that of a folder, is told",
       "importer")  # fmt: skip
def folder_instead_of_file(case: ImporterCase, folder: Path) -> None:
    """Swap files and folders."""
    imported(case)
    sample = copy_sample(case, folder / "sample")
    path = Path(sample.path)
    if path.is_file():
        path.unlink()
        path.mkdir()
        (path / "letter.txt").write_text("Dear reader\n", encoding="utf-8")
        what = "a folder of that name"
    else:
        shutil.rmtree(path) if path != folder / "sample" else None
        path = folder / "sample.txt"
        path.write_text("Dear reader\n", encoding="utf-8")
        sample = Sample(path, sample.options)
        what = "a file instead of the folder"
    if attempt(case, sample, folder / "out.h5", what=what):
        fail(f"{what} gives a result", expected="UnreadableFile", fix="look at what the path is")


@check("ROBUST-7", "a file that cannot be opened is told", "importer")
def unreadable_files(case: ImporterCase, folder: Path) -> None:
    """Take the permission to read away, or where that binds nobody (root) the file itself."""
    imported(case)
    home = folder / "sample"
    sample = copy_sample(case, home)
    path = Path(sample.path)
    files = members(home)
    locked = hasattr(os, "geteuid") and os.geteuid() != 0
    for file in dict.fromkeys((files[0], files[-1])):
        content = file.read_bytes()
        if locked:
            file.chmod(0)
            what = f"{file.name} without permission to read"
        else:
            file.unlink()
            file.symlink_to(folder / "nowhere")
            what = f"{file.name} that leads nowhere"
        try:
            made = attempt(case, sample, folder / "out.h5", what=what)
        finally:
            if locked:
                file.chmod(0o600)
            else:
                file.unlink()
                file.write_bytes(content)
        if made and file == path:
            fail(f"{what} gives a result", expected="UnreadableFile", fix="open it")


__all__ = ["N_FLIPS", "attempt"]
