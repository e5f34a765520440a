"""What several checks of a case share: its sample, and the file that comes of it."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from openprc.errors import OpenPRCError
from openprc.hooks.importing import ProducedRun, import_file
from openprc.hooks.protocols import Sample
from openprc.hooks.registry import resolve
from openprc.testing.outcome import NotApplicable, fail

if TYPE_CHECKING:
    from openprc.testing.cases import Case, ImporterCase


@dataclass
class Bench:
    """A folder of one case, and what was made in it so far."""

    folder: Path
    made: dict[str, Any] = field(default_factory=dict)


@cache
def kit_folder() -> Path:
    """Return a folder for this process, removed at its end."""
    # Not TemporaryDirectory(): it would warn when the interpreter ends before it is collected.
    folder = Path(tempfile.mkdtemp(prefix="openprc-testing-"))
    owner = os.getpid()

    def clear() -> None:
        if os.getpid() == owner:
            shutil.rmtree(folder, ignore_errors=True)

    atexit.register(clear)
    return folder


_BENCHES: dict[int, tuple[Case, Bench]] = {}


def bench_of(case: Case) -> Bench:
    """Return the bench of a case; the case is kept, so that its id stays its own."""
    if id(case) not in _BENCHES:
        folder = kit_folder() / str(len(_BENCHES))
        folder.mkdir()
        _BENCHES[id(case)] = (case, Bench(folder))
    return _BENCHES[id(case)][1]


def as_sample(made: Any, owner: str) -> Sample:
    """Return what a writer of samples returned as a `Sample`."""
    if isinstance(made, Sample):
        return made
    if isinstance(made, str | Path):
        return Sample(Path(made))
    return fail(
        f"the sample of {owner} is a {type(made).__name__}",
        expected="a path, or an openprc.hooks.Sample",
        fix="return Sample(path, options={...}) from the function that writes it",
    )


def write_sample(case: ImporterCase, folder: Path) -> Sample:
    """Let the author's function write the sample into a new folder.

    Raises
    ------
    CheckFailed
        When there is no such function, or it returns something else.
    """
    make = case.make_sample
    if make is None:
        if not case.record.sample:
            fail(
                f"there is no sample of {case.name}",
                expected="ProducerSpec.sample, or ImporterCase(make_sample=...)",
                fix="write a function that writes a small run whose numbers are known",
            )
        make = resolve(case.item, case.record.sample)
    folder.mkdir(parents=True, exist_ok=True)
    return as_sample(make(folder), case.name)


def sample_of(case: ImporterCase) -> Sample:
    """Return the sample of a case, written once; it is not to be changed."""
    bench = bench_of(case)
    if "sample" not in bench.made:
        folder = bench.folder / "sample"
        if folder.exists():
            raise NotApplicable("the sample cannot be written: see SPEC-3")
        try:
            made = write_sample(case, folder)
            if not Path(made.path).resolve().is_relative_to(folder.resolve()):
                raise NotApplicable("the sample is not where it should be")
            bench.made["sample"] = made
        except Exception as error:  # whatever the author's function raises is for SPEC-3 to tell
            raise NotApplicable("the sample cannot be written: see SPEC-3") from error
    sample: Sample = bench.made["sample"]
    return sample


def copy_sample(case: ImporterCase, folder: Path) -> Sample:
    """Copy the sample, with all that lies beside it, into a new folder."""
    sample = sample_of(case)
    home = bench_of(case).folder / "sample"
    shutil.copytree(home, folder, symlinks=True)
    return relocated(sample, home, folder)


def relocated(sample: Sample, old: Path, new: Path) -> Sample:
    """Return a sample whose paths lead to `new` instead of `old`."""

    def moved(value: Any) -> Any:
        if isinstance(value, Path):
            return new / value.relative_to(old) if value.is_relative_to(old) else value
        if isinstance(value, str):
            return value.replace(str(old), str(new))
        if isinstance(value, tuple | list):
            return type(value)(moved(item) for item in value)
        return value

    path = moved(Path(sample.path))
    options = {name: moved(value) for name, value in sample.options.items()}
    return Sample(path=path, options=options, inputs=sample.inputs)


def import_sample(case: ImporterCase, sample: Sample, out: Path) -> ProducedRun:
    """Import a sample, or what became of it, with the producer of the case."""
    return import_file(
        sample.path,
        out,
        as_name=case.item.qualified_name,
        options=sample.options,
        trust=case.trust or case.record.trusts_pickle,
        registry=case.plugins,
    )


def imported(case: ImporterCase) -> Path:
    """Return the imported sample, made once.

    Raises
    ------
    NotApplicable
        When it cannot be imported; IMPORT-1 says why.
    """
    bench = bench_of(case)
    out = bench.folder / "imported.h5"
    if "imported" not in bench.made:
        sample = sample_of(case)
        try:
            import_sample(case, sample, out)
        except OpenPRCError as error:
            bench.made["imported"] = error
        else:
            bench.made["imported"] = out
    if isinstance(bench.made["imported"], OpenPRCError):
        raise NotApplicable("the sample cannot be imported: see IMPORT-1")
    return out


__all__ = [
    "Bench", "as_sample", "bench_of", "copy_sample", "import_sample", "imported", "relocated",
    "sample_of", "write_sample",
]  # fmt: skip
