"""Who can import this path?"""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Real
from pathlib import Path

from openprc.errors import AmbiguousFile, NoImporter, OpenPRCError, UnreadableFile
from openprc.hooks.faults import debugging, reason
from openprc.hooks.registry import Registered, Registry, missing_packages
from openprc.hooks.specs import ProducerSpec
from openprc.schema.safety import check_readable, is_hdf5, npz_headers, open_hdf5

#: An importer that is less sure than this does not claim the file.
THRESHOLD = 0.5
_MAGIC_BYTES = 4096


@dataclass(frozen=True)
class Verdict:
    """What one importer said of a path."""

    item: Registered
    score: float
    problem: str = ""


@dataclass(frozen=True)
class Choice:
    """The importer chosen for a path, how sure it is, and what the others said."""

    item: Registered
    score: float
    verdicts: tuple[Verdict, ...]


def choose_importer(path: Path, *, registry: Registry, as_name: str | None = None) -> Choice:
    """Choose the importer of a file or folder.

    Raises
    ------
    UnreadableFile
        When the path does not exist, or is an empty file.
    NoImporter
        When nobody claims it; the message tells who was asked, whose back end is missing,
        or who failed.
    AmbiguousFile
        When two importers are equally sure.
    UnknownName, AmbiguousName
        When `as_name` is not one producer.
    """
    if not path.is_dir():
        check_readable(path)
    elif not any(path.iterdir()):
        raise UnreadableFile(
            "the folder is empty", expected="a run", fix="name another folder", file=path
        )
    if as_name is not None:
        item = registry.producer(as_name)
        registry.load(item, capability="import")
        return Choice(item, 1.0, ())
    importers = [item for item in registry.producers if "import" in item.spec.capabilities]
    likely = [item for item in importers if hinted(item.spec, path)]
    verdicts = [_ask(registry, item, path) for item in likely]
    if not any(verdict.score >= THRESHOLD for verdict in verdicts):
        # A user may name a file anything: those that the hints left out are asked, too.
        verdicts += [_ask(registry, item, path) for item in importers if item not in likely]
    best = max((verdict.score for verdict in verdicts), default=0.0)
    if best < THRESHOLD:
        _explain_container(path)
        raise _nobody(path, verdicts, registry)
    winners = [verdict for verdict in verdicts if verdict.score == best]
    if len(winners) > 1:
        names = [verdict.item.qualified_name for verdict in winners]
        raise AmbiguousFile(
            f"{' and '.join(names)} are equally sure that they can read it ({best:g})",
            expected="one importer",
            fix=f"say which with --as, for example --as {names[0]}",
            file=path,
        )
    return Choice(winners[0].item, best, tuple(verdicts))


def _explain_container(path: Path) -> None:
    """Raise what keeps HDF5 or .npz from being imported, if that can be told without a plugin.

    Raises
    ------
    UnsafeFile, UnreadableFile
        When nobody may or can open it.
    NoImporter
        When it is a file of this package.
    """
    if path.is_dir():
        return
    if path.suffix.lower() == ".npz":
        npz_headers(path)
    if not is_hdf5(path):
        return
    with open_hdf5(path, allow_references=True, allow_vlen=True, allow_soft_links=True) as file:
        kind = file.attrs.get("kind") if "openprc_schema" in file.attrs else None
    if kind is not None:
        raise NoImporter(
            f"this is an OpenPRC file already, of kind {kind}",
            expected="a file of another program",
            fix="use it as it is: `openprc info`, `openprc validate`, `openprc benchmark`",
            file=path,
        )


def hinted(spec: ProducerSpec, path: Path) -> bool:
    """Whether the record's suffixes or magic bytes fit; folders fit every importer."""
    if path.is_dir() or not (spec.suffixes or spec.magic):
        return True
    if path.name.lower().endswith(spec.suffixes):
        return True
    with path.open("rb") as stream:
        head = stream.read(_MAGIC_BYTES)
    return any(magic in head for magic in spec.magic)


def _ask(registry: Registry, item: Registered, path: Path) -> Verdict:
    absent = missing_packages(item.spec, "import")
    if absent:
        return Verdict(item, 0.0, f"needs {', '.join(absent)}; {item.spec.install}".rstrip("; "))
    try:
        answer = registry.load(item, capability="import").sniff(path)
        # float() would take the text "0.9", too.
        score = float(answer) if isinstance(answer, Real) else math.nan
        if not 0.0 <= score <= 1.0:
            return Verdict(item, 0.0, f"broken: sniff() returned {answer!r}")
    except OpenPRCError as error:
        return Verdict(item, 0.0, f"broken: {error.found}")
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a plugin may raise anything, even SystemExit
        if debugging():
            raise
        return Verdict(item, 0.0, f"broken: sniff() raised {reason(error)}")
    return Verdict(item, score)


def _nobody(path: Path, verdicts: list[Verdict], registry: Registry) -> NoImporter:
    likely = [v for v in verdicts if v.problem and hinted(v.item.spec, path)]
    absent = [v for v in likely if v.problem.startswith("needs ")]
    broken = [v for v in likely if v.problem.startswith("broken: ")]
    left_out = [f"{p.name} ({p.problem})" for p in registry.plugins if p.problem]
    remark = f"; plugins left out: {', '.join(left_out)}" if left_out else ""
    if absent:
        names = "; ".join(f"{v.item.name} {v.problem}" for v in absent)
        return NoImporter(
            f"no importer could look at it; the likely one lacks a package: {names}",
            expected="an importer whose packages are installed",
            fix=absent[0].item.spec.install or "install what it needs",
            file=path,
        )
    if broken:
        names = "; ".join(
            f"{v.item.qualified_name}: {v.problem.removeprefix('broken: ')}" for v in broken
        )
        return NoImporter(
            f"the likely importer is broken: {names}",
            expected="an importer that works",
            fix="report it to its authors; OPENPRC_PLUGIN_DEBUG=1 shows the trace" + remark,
            file=path,
        )
    asked = ", ".join(f"{v.item.name} {v.score:g}" for v in verdicts) or "nobody"
    nearest = max(verdicts, key=lambda v: v.score, default=None)
    # An importer that is nearly sure knows best what is wrong with the file.
    name = nearest.item.name if nearest is not None and nearest.score > 0.0 else "NAME"
    return NoImporter(
        f"no importer recognises it; asked: {asked}",
        expected=f"one that is at least {THRESHOLD:g} sure",
        fix=f"force one with --as {name}, or install the plugin for this format" + remark,
        file=path,
    )
