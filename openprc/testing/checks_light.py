"""LIGHT: listing a plugin costs nothing, and what is not installed is asked for politely."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from openprc.testing.cases import Case, ImporterCase
from openprc.testing.check import KINDS, check
from openprc.testing.outcome import NotApplicable, fail
from openprc.testing.processes import answer_of
from openprc.testing.workbench import copy_sample, sample_of

#: Processor time that importing an entry module may take [s], beyond openprc.hooks itself.
LIMIT = 0.1
_TRIALS = 5

_IMPORT = """
import json, sys, time
import openprc.hooks
import numbers  # what a module of records may well want of the standard library
before = set(sys.modules)
began = time.process_time()
__import__(sys.argv[1])
spent = time.process_time() - began
print("\\n" + json.dumps([sorted(set(sys.modules) - before), spent]))
"""


def _listed(case: Case) -> tuple[list[str], float]:
    """Return the modules that importing the entry module brings in, and its processor time."""
    modules, spent = answer_of(["-c", _IMPORT, case.module])
    return modules, spent


@check("LIGHT-1", "importing the entry module imports no heavy package", *KINDS, apart=True)
def entry_module_is_light(case: Case, folder: Path) -> None:
    """Import the entry module in a fresh interpreter and look at what came along."""
    del folder
    modules, _ = _listed(case)
    roots = {name.partition(".")[0] for name in modules}
    found = [name for name in case.forbidden if name in roots or name in modules]
    if found:
        fail(
            f"importing {case.module} imports {', '.join(found)}",
            expected="an entry module that imports records and nothing heavy",
            fix="import it in the module that `load` names, or within a function",
        )


@check("LIGHT-2", "importing the entry module takes less than 0.1 s of processor time", *KINDS,
       apart=True)  # fmt: skip
def entry_module_is_quick(case: Case, folder: Path) -> None:
    """Take the best of several fresh interpreters: only the module itself makes all of them slow.

    Processor time of the process, not time on the wall, which a busy machine stretches.
    """
    del folder
    best = float("inf")
    for _ in range(_TRIALS):
        best = min(best, _listed(case)[1])
        if best <= LIMIT:
            return
    fail(
        f"importing {case.module} takes {best:.2g} s of processor time, at best of {_TRIALS}",
        expected=f"at most {LIMIT:g} s",
        fix="compute nothing at import; load on use",
    )


@check("LIGHT-3", "without its back end the plugin is listed and using it says what to install",
       *KINDS, apart=True)  # fmt: skip
def missing_back_end_is_told(case: Case, folder: Path) -> None:
    """Use it in an interpreter in which no heavy package can be imported."""
    absent = tuple(dict.fromkeys((*case.needs, *case.heavy)))
    if not absent:
        raise NotApplicable("it needs nothing that might not be installed")
    order: dict[str, Any] = {
        "module": case.module,
        "distribution": case.item.distribution,
        "version": case.item.version,
        "hook": case.hook,
        "name": case.name,
        "capability": case.capability,
        "absent": absent,
    }
    if isinstance(case, ImporterCase):
        sample_of(case)
        sample = copy_sample(case, folder / "sample")
        order |= {"sample": sample.path, "options": dict(sample.options), "trust": True,
                  "out": folder / "out.h5"}  # fmt: skip
    answer = answer_of(["-m", "openprc.testing.isolated"], given=order, folder=folder)
    if "error" in answer and not answer["missing"]:
        fail(
            f"without {', '.join(absent)}: {answer['error']}: {answer['found']}",
            expected="MissingDependency with the install line, or a result without them",
            fix="name what each capability needs in ProducerSpec(needs={...})",
        )
    if case.needs and "error" not in answer:
        fail(
            f"it works without {', '.join(case.needs)}",
            expected="needs that it cannot do without",
            fix="take them out of needs",
        )
    if "error" in answer and not any(name in answer["found"] for name in absent):
        fail(
            f"the error is {answer['found']!r}",
            expected=f"one that names {', '.join(absent)}",
            fix="leave it to the host: it knows `needs` and `install`",
        )


__all__ = ["LIMIT"]
