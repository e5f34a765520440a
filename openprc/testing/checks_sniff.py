"""SNIFF: an importer claims its own files, and no others."""

from __future__ import annotations

import shutil
import time
from numbers import Real
from pathlib import Path
from typing import Any

from openprc.hooks.sniff import THRESHOLD
from openprc.testing.cases import Case, ImporterCase
from openprc.testing.check import check
from openprc.testing.decoys import contents, other_samples, truncated
from openprc.testing.outcome import NotApplicable, fail
from openprc.testing.watching import changes, elsewhere, snapshot, watching
from openprc.testing.workbench import copy_sample, sample_of

#: Processor time that one sniff may take [s].
LIMIT = 1.0
_TRIALS = 3
#: Size of the long file that a sniff is timed on.
_LONG = 24 << 20


def _importer(case: Case) -> Any:
    return case.plugins.load(case.item, capability="import")


def _suffixes(case: ImporterCase) -> list[str]:
    path = Path(sample_of(case).path)
    own = "".join(path.suffixes[-1:]) if path.is_file() else ""
    return list(dict.fromkeys([*([own] if own else []), *case.record.suffixes])) or [""]


def _score(importer: Any, path: Path, what: str) -> float:
    try:
        answer = importer.sniff(path)
    except Exception as error:  # noqa: BLE001 - whatever it is, sniff() must not raise it
        fail(
            f"sniff() raised {type(error).__name__} on {what}: {error}",
            expected="0.0 for what it cannot read",
            fix="look before reading",
        )
    if isinstance(answer, bool) or not isinstance(answer, Real) or not 0.0 <= float(answer) <= 1.0:
        fail(
            f"sniff() returned {answer!r} on {what}",
            expected="a number from 0 to 1",
            fix="1.0 verified by content, 0.7 structure, 0.3 name only, 0.0 no",
        )
    return float(answer)


def _refuse_claim(importer: Any, path: Path, what: str) -> None:
    score = _score(importer, path, what)
    if score >= THRESHOLD:
        fail(
            f"sniff() is {score:g} sure of {what}, named {path.name!r}",
            expected=f"less than {THRESHOLD:g}",
            fix="look at more of the content than the name and the first bytes",
        )


@check("SNIFF-1", "its own sample is claimed", "importer")
def own_sample_is_claimed(case: ImporterCase, folder: Path) -> None:
    """Sniff at the sample, and at the sample under another name."""
    sample = copy_sample(case, folder / "sample")
    score = _score(_importer(case), Path(sample.path), "its own sample")
    if score < THRESHOLD:
        fail(
            f"sniff() is {score:g} sure of its own sample",
            expected=f"at least {THRESHOLD:g}",
            fix="recognise the format by its content",
        )


def _decoys(case: ImporterCase, folder: Path) -> list[tuple[Path, str]]:
    found = []
    for suffix in _suffixes(case):
        for number, (what, content) in enumerate(contents().items()):
            path = folder / f"decoy{number}{suffix}"
            path.write_bytes(content)
            found.append((path, what))
        empty = folder / f"empty{suffix}"
        empty.write_bytes(b"")
        found.append((empty, "an empty file"))
    sample = Path(copy_sample(case, folder / "whole").path)
    found.append((truncated(sample, folder / "cut"), "the first bytes of its own sample"))
    nothing = folder / "nothing"
    nothing.mkdir()
    letters = folder / "letters"
    letters.mkdir()
    (letters / "letter.txt").write_bytes(contents()["a letter"])
    return [*found, (nothing, "an empty folder"), (letters, "a folder with a letter")]


@check("SNIFF-2", "empty files, noise, text, unrelated data and truncated files are not claimed",
       "importer")  # fmt: skip
def decoys_are_not_claimed(case: ImporterCase, folder: Path) -> None:
    """Sniff at decoys under the importer's own endings."""
    importer = _importer(case)
    for path, what in _decoys(case, folder):
        _refuse_claim(importer, path, what)


@check("SNIFF-3", "samples of other producers are not claimed, whatever their ending", "importer")
def other_samples_are_not_claimed(case: ImporterCase, folder: Path) -> None:
    """Sniff at the samples of all installed importers, under the importer's own endings."""
    importer = _importer(case)
    found = [
        pair for pair in other_samples(case.plugins, case.item) if pair[0] not in case.lookalikes
    ]
    if not found:
        raise NotApplicable("no other importer with a sample is installed")
    for name, sample in found:
        path = Path(sample.path)
        what = f"the sample of {name}"
        _refuse_claim(importer, path, what)
        if path.is_file():
            for suffix in _suffixes(case):
                copy = folder / f"{name}{suffix}"
                shutil.copyfile(path, copy)
                _refuse_claim(importer, copy, what)


@check("SNIFF-4", "sniffing never raises, prints or writes", "importer")
def sniffing_leaves_no_trace(case: ImporterCase, folder: Path) -> None:
    """Sniff at the sample, decoys and odd paths, and watch the disk."""
    importer = _importer(case)
    sample = Path(copy_sample(case, folder / "sample").path)
    places = [(sample, "its own sample"), *_decoys(case, folder)]
    loop = folder / f"loop{_suffixes(case)[0]}"
    loop.symlink_to(loop)
    places += [
        (folder / f"missing{_suffixes(case)[0]}", "a path that does not exist"),
        (loop, "a link to itself"),
    ]
    before = snapshot(folder)
    with elsewhere(folder / "else") as other:
        whole = snapshot(other)
        with watching() as watched:
            for path, what in places:
                _score(importer, path, what)
        left = changes(whole, snapshot(other))
    after = {k: v for k, v in snapshot(folder).items() if not k.startswith("else")}
    told = left or changes(before, after) or watched.written
    if told:
        fail(
            f"sniffing changes the disk: {told[0]}",
            expected="reading only",
            fix="do not unpack, cache or convert in sniff()",
        )
    if watched.printed.strip() or watched.warned:
        text = watched.printed.strip() or watched.warned[0]
        fail(
            f"sniffing says {text[:200]!r}",
            expected="silence",
            fix="return the score and nothing else",
        )


@check("SNIFF-5", "a sniff takes at most a second of processor time", "importer")
def sniffing_is_quick(case: ImporterCase, folder: Path) -> None:
    """Time sniffs at the sample and at a long file; the best of several counts."""
    importer = _importer(case)
    sample = Path(copy_sample(case, folder / "sample").path)
    places = [(sample, "its own sample")]
    if sample.is_file() and (size := sample.stat().st_size):
        long = folder / f"long{sample.suffix}"
        long.write_bytes(sample.read_bytes() * max(1, _LONG // size))
        places.append((long, f"its own sample over and over, {_LONG >> 20} MiB"))
    for path, what in places:
        best = float("inf")
        for _ in range(_TRIALS):
            began = time.process_time()
            importer.sniff(path)
            best = min(best, time.process_time() - began)
            if best <= LIMIT:
                break
        else:
            fail(
                f"sniff() took {best:.2g} s on {what}",
                expected=f"at most {LIMIT:g} s",
                fix="read the beginning of the file only",
            )


__all__ = ["LIMIT"]
