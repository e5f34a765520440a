"""One deliberate mistake for every check, and which checks it trips.

``python tests/testing/fault_matrix.py`` prints the matrix; ``--run`` tries it first.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import faulty_importers
import faulty_plugin
import faulty_recorders
import ticker_code
import wire_code
import wire_plugin

from openprc.testing import (
    ExporterCase,
    ImporterCase,
    RecorderCase,
    RunnerCase,
    all_checks,
    checks_for,
)


@dataclass(frozen=True)
class Fault:
    """A mistake, the case that has it, and the checks that it trips."""

    name: str
    what: str
    make: Callable[[], Any]
    trips: tuple[str, ...]

    @property
    def kind(self) -> str:
        return self.make().kind


def importer(spec, *, entry_module="faulty_plugin", sample=wire_code.write_sample, heavy=()):
    """Return the case of an importer of the wire format."""
    return ImporterCase(
        spec, make_sample=sample, truth=wire_code.truth, entry_module=entry_module, heavy=heavy
    )


def recorder(name, spec, entry_module="faulty_plugin"):
    """Return the case of a recorder of the ticker."""
    script, forget, crash = faulty_recorders.scripts_of(name, spec)
    return RecorderCase(
        spec, script=script, truth=ticker_code.truth, forget=forget, crash=crash,
        entry_module=entry_module,
    )  # fmt: skip


def exporter(spec, entry_module="faulty_plugin"):
    """Return the case of an exporter to the wire format."""
    return ExporterCase(spec, importer="wire", entry_module=entry_module)


GOOD = {
    "importer": lambda: importer(wire_plugin.producer(), entry_module="wire_plugin"),
    "runner": lambda: RunnerCase(wire_plugin.runner(), entry_module="wire_plugin"),
    "recorder": lambda: recorder("TickerRecorder", wire_plugin.recorder(), "wire_plugin"),
    "exporter": lambda: exporter(wire_plugin.exporter(), "wire_plugin"),
}

#: Entry modules that are wrong, in front of the good importer.
_ENTRIES = {
    "faulty_entry_ageless": ("the entry module does not state OPENPRC_PLUGIN_API",
                             "SPEC-1 REPEAT-2"),
    "faulty_entry_heavy": ("the entry module imports scipy", "LIGHT-1 LIGHT-2"),
    "faulty_entry_slow": ("the entry module computes for 0.2 s", "LIGHT-2"),
}  # fmt: skip


def _entry(name):
    return importer(wire_plugin.producer(), entry_module=name)


def _odd(name):
    return importer(faulty_plugin.odd_record(name))


def _importer(name):
    heavy = ("tabnanny",) if name == "NeedsPackage" else ()
    return importer(faulty_plugin.importer_record(name), heavy=heavy)


def _runner(name):
    return RunnerCase(faulty_plugin.runner_record(name), entry_module="faulty_plugin")


def _recorder(name):
    return recorder(name, faulty_plugin.recorder_record(name))


def _exporter(name):
    return exporter(faulty_plugin.exporter_record(name))


def _astray():
    return importer(
        wire_plugin.producer(), entry_module="wire_plugin",
        sample=faulty_importers.sample_elsewhere,
    )  # fmt: skip


FAULTS = [
    Fault(f"{kind} {name}", row[0], lambda make=make, name=name: make(name), tuple(row[1].split()))
    for kind, make, table in (
        ("entry", _entry, _ENTRIES),
        ("record", _odd, faulty_plugin.ODD),
        ("importer", _importer, faulty_plugin.IMPORTERS),
        ("runner", _runner, faulty_plugin.RUNNERS),
        ("recorder", _recorder, faulty_plugin.RECORDERS),
        ("exporter", _exporter, faulty_plugin.EXPORTERS),
    )
    for name, row in table.items()
]
FAULTS.append(
    Fault("sample elsewhere", "the sample is not in the folder given", _astray, ("SPEC-3",))
)


def tripped(case, *, apart=True, only=None):
    """Return ids of checks that a case fails, with what they say."""
    found = {}
    for check in checks_for(case):
        if (only is not None and check.id not in only) or (check.apart and not apart):
            continue
        with tempfile.TemporaryDirectory() as folder:
            outcome = check.run(case, Path(folder))
        if outcome.state == "failed":
            found[check.id] = outcome
    return found


def as_markdown(*, run=False):
    """Return the matrix as a table; with `run` what is found, too."""
    lines = ["| fault | what is wrong | trips |" + (" says |" if run else ""),
             "|---|---|---|" + ("---|" if run else "")]  # fmt: skip
    for fault in FAULTS:
        row = f"| {fault.name} | {fault.what} | {' '.join(fault.trips)} |"
        if run:
            found = tripped(fault.make())
            row += " " + "; ".join(f"{k}: {o.found[:80]}" for k, o in found.items()) + " |"
            if set(found) != set(fault.trips):
                row += " **NOT AS STATED**"
        lines.append(row)
    reached = {name for fault in FAULTS for name in fault.trips}
    lines.append("")
    lines.append(f"{len(FAULTS)} faults, {len(reached)} of {len(all_checks())} checks")
    return "\n".join(lines)


if __name__ == "__main__":
    print(as_markdown(run="--run" in sys.argv))
