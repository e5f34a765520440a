"""SPEC: what a plugin says about itself."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any

from openprc.errors import MissingDependency
from openprc.hooks.discovery import load_plugin
from openprc.hooks.options import check_options
from openprc.hooks.specs import OptionSpec
from openprc.testing.cases import Case, ExporterCase, ImporterCase
from openprc.testing.check import KINDS, check
from openprc.testing.lookup import ModuleEntry
from openprc.testing.outcome import NotApplicable, fail
from openprc.testing.watching import snapshot
from openprc.testing.workbench import write_sample

#: A DOI, an address, an arXiv number, or at least a year.
_FINDABLE = re.compile(r"10\.\d{4,9}/|https?://|arxiv|\b(19|20)\d\d\b", re.IGNORECASE)

#: Method to the names of its arguments that the host passes, by kind of case.
_METHODS: dict[str, dict[str, tuple[str, ...]]] = {
    "importer": {"sniff": ("path",), "import_run": ("path", "writer", "options")},
    "runner": {
        "supports": ("experiment",),
        "run": ("experiment", "writer", "seed", "progress"),
    },
    "recorder": {"attach": ("simulator", "writer")},
    "exporter": {"export": ("trajectory", "path", "options")},
}
#: Arguments that the host passes by position, whatever they are called.
_POSITIONAL = {"path", "writer", "experiment", "simulator", "trajectory"}


@check("SPEC-1", "the entry module loads, states its API version, and offers the record", *KINDS)
def entry_module_offers_the_record(case: Case, folder: Path) -> None:
    """Load the entry module as the host does."""
    del folder
    if case.item.distribution == "openprc":
        return  # what the package itself brings has no entry point
    plugin = load_plugin(ModuleEntry(case.module, case.item.distribution, case.item.version))
    if plugin.state != "ok":
        fail(
            f"{case.module} is {plugin.state}: {plugin.problem}",
            expected="an entry module that the host takes",
            fix=plugin.fix,
        )
    if case.record not in plugin.records.get(case.hook, ()):
        names = [spec.name for spec in plugin.records.get(case.hook, ())]
        fail(
            f"{case.module} offers {names or 'nothing'} to {case.hook}",
            expected=f"the record {case.name!r}, as it is checked here",
            fix=f"return it from {case.hook}(), or name the module with entry_module=",
        )


def _options(case: Case) -> tuple[OptionSpec, ...]:
    record = case.record
    return tuple(record.run_options if case.kind == "runner" else record.options)


@check("SPEC-2", "every option has a help text and a default that it would take itself", *KINDS)
def options_are_explained(case: Case, folder: Path) -> None:
    """Read the options as the command line would."""
    del folder
    for option in _options(case):
        key = f"option {option.name}"
        if len(option.help.split()) < 2:
            fail(
                f"the {key} has the help {option.help!r}",
                expected="a sentence on what it does, with its unit",
                fix="say it in OptionSpec(help=...)",
            )
        if option.name in ("trust", "final"):
            fail(
                f"an {key} is declared",
                expected="a name that the host does not pass itself",
                fix="choose another name",
            )
        if option.default is None:
            continue
        taken = check_options(case.record, (option,), {option.name: option.default})
        default = tuple(option.default) if option.multiple else option.default
        if taken[option.name] != default or type(taken[option.name]) is not type(default):
            fail(
                f"the default of the {key} is {option.default!r}",
                expected=f"a value of kind {option.kind}",
                fix="give it the kind that it stands for",
            )


@check("SPEC-3", "the sample is written into the folder given, twice the same", "importer")
def sample_is_written(case: ImporterCase, folder: Path) -> None:
    """Write the sample into two folders."""
    contents = []
    for name in ("one", "two"):
        sample = write_sample(case, folder / name)
        path = Path(sample.path)
        if not path.exists() or not path.resolve().is_relative_to((folder / name).resolve()):
            fail(
                f"the sample is at {path}",
                expected="a path below the folder that was given",
                fix="write below `folder` and return that path",
            )
        unknown = set(sample.options) - {option.name for option in case.record.options}
        if unknown:
            fail(
                f"the sample asks for the options {sorted(unknown)}",
                expected="options of the record",
                fix="correct Sample(options=...)",
            )
        contents.append(sorted(snapshot(folder / name)))
    if contents[0] != contents[1]:
        fail(
            "two samples have different files",
            expected="the same files every time",
            fix="leave chance and dates out of the names",
        )


@check("SPEC-4", "who needs a package says how to get it, and a citation can be found", *KINDS)
def install_and_citation(case: Case, folder: Path) -> None:
    """Look at `install` and `citation`."""
    del folder
    record = case.record
    if case.needs and not record.install.strip():
        fail(
            f"{case.name} needs {', '.join(case.needs)}, and install is empty",
            expected="the command that installs it",
            fix="set install= in the record",
        )
    if record.citation and not _FINDABLE.search(record.citation):
        fail(
            f"the citation is {record.citation!r}",
            expected="a DOI, an address, or at least a year",
            fix="add one",
        )


def _parameters(function: Any) -> dict[str, inspect.Parameter]:
    return dict(inspect.signature(function).parameters)


@check("SPEC-5", "the code behind the record is made without arguments and has its methods", *KINDS)
def code_keeps_the_protocol(case: Case, folder: Path) -> None:
    """Make the object and look at the signatures of its methods."""
    del folder
    try:
        made = case.plugins.load(case.item, capability=case.capability)
    except MissingDependency as error:
        raise NotApplicable(error.found) from error
    if isinstance(case, ExporterCase):
        made = made()
    for name, wanted in _METHODS[case.kind].items():
        method = getattr(made, name, None)
        if not callable(method):
            fail(
                f"{case.record.load} has no method {name}()",
                expected=f"{name}{wanted}",
                fix="see openprc.hooks.protocols",
            )
        if case.kind == "runner" and name == "run" and case.record.run_options:
            wanted = (*wanted, "options")
        parameters = _parameters(method)
        kinds = {parameter.kind for parameter in parameters.values()}
        by_name = [word for word in wanted if word not in _POSITIONAL]
        absent = [word for word in by_name if word not in parameters]
        if inspect.Parameter.VAR_KEYWORD in kinds:
            absent = []
        free = [
            parameter.name
            for parameter in parameters.values()
            if parameter.kind in (parameter.POSITIONAL_ONLY, parameter.POSITIONAL_OR_KEYWORD)
            and parameter.name not in by_name
        ]
        count = len(wanted) - len(by_name)
        short = len(free) < count and inspect.Parameter.VAR_POSITIONAL not in kinds
        needed = [word for word in free[count:] if parameters[word].default is inspect._empty]
        if absent or short or needed:
            fail(
                f"{name}{inspect.signature(method)}",
                expected=f"{name}({', '.join(wanted)}), with {by_name} by keyword",
                fix="see openprc.hooks.protocols",
            )
