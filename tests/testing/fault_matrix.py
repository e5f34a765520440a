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

import faulty_exporters
import faulty_recorders
import faulty_runners
import ticker_code
import wire_code
import wire_plugin

from openprc.hooks import OptionSpec
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


def importer(load="wire_code:WireImporter", *, entry_module="", truth=wire_code.truth, heavy=(),
             **fields):  # fmt: skip
    """Return the good importer's case, or one with other code behind it."""
    if "." not in load and ":" not in load:
        load = f"faulty_importers:{load}"
    return ImporterCase(
        wire_plugin.producer(load=load, **fields), truth=truth, entry_module=entry_module,
        heavy=heavy,
    )  # fmt: skip


def runner(load="VerletRunner"):
    """Return the case of a runner with other code behind it."""
    module = "verlet_code" if load == "VerletRunner" else "faulty_runners"
    return RunnerCase(wire_plugin.runner(load=f"{module}:{load}"))


def recorder(load="TickerRecorder"):
    """Return the case of a recorder with other code behind it."""
    module = "ticker_code" if load == "TickerRecorder" else "faulty_recorders"
    spec = wire_plugin.recorder(load=f"{module}:{load}")
    script, forget, crash = faulty_recorders.scripts_of(load, spec)
    return RecorderCase(
        spec, script=script, truth=ticker_code.truth, forget=forget, crash=crash
    )


def exporter(load="WireExporter"):
    """Return the case of an exporter with other code behind it."""
    module = "wire_code" if load == "WireExporter" else "faulty_exporters"
    spec = wire_plugin.exporter(load=f"{module}:{load}")
    return ExporterCase(spec, importer="wire", registry=faulty_exporters.registry_with(spec))


GOOD = {
    "importer": lambda: importer(entry_module="wire_plugin"),
    "runner": runner,
    "recorder": recorder,
    "exporter": exporter,
}


def _rows(make, rows):
    for name, what, trips in rows:
        yield Fault(name, what, lambda name=name: make(name), tuple(trips.split()))


def _options(*options):
    return lambda: importer(options=(*wire_plugin.producer().options, *options))


FAULTS = [
    Fault("no API version", "the entry module does not state OPENPRC_PLUGIN_API",
          lambda: importer(entry_module="faulty_entry_ageless"), ("SPEC-1", "LIGHT-3")),
    Fault("no help", "an option is explained by one word",
          _options(OptionSpec("gain", "gain", kind="float")), ("SPEC-2",)),
    Fault("wrong default", "the default of a number is a text",
          _options(OptionSpec("gain", "what values are multiplied by", kind="float",
                              default="2")), ("SPEC-2",)),
    Fault("sample elsewhere", "the sample is not in the folder that was given",
          lambda: importer(sample="faulty_importers:sample_elsewhere"), ("SPEC-3",)),
    Fault("no install line", "a package is needed, and nothing says how to get it",
          lambda: importer(needs={"import": ("tabnanny",)}), ("SPEC-4", "LIGHT-3")),
    Fault("vague citation", "the citation cannot be found",
          lambda: importer(citation="our paper"), ("SPEC-4",)),
    Fault("half a protocol", "the importer has no import_run()",
          lambda: importer("NoImport"), ("SPEC-5", "IMPORT-1")),
    Fault("heavy entry module", "the entry module imports scipy",
          lambda: importer(entry_module="faulty_entry_heavy"), ("LIGHT-1", "LIGHT-2")),
    Fault("slow entry module", "the entry module computes for 0.2 s",
          lambda: importer(entry_module="faulty_entry_slow"), ("LIGHT-2",)),
    Fault("undeclared package", "importing needs a package that `needs` does not name",
          lambda: importer("NeedsPackage", heavy=("tabnanny",)), ("LIGHT-3",)),
    *_rows(importer, [
        ("Shy", "sniff() is 0.3 sure of its own files", "SNIFF-1"),
        ("ByName", "sniff() looks at the name only", "SNIFF-2 SNIFF-3"),
        ("AnyVideo", "sniff() claims other samples", "SNIFF-3"),
        ("Clumsy", "sniff() raises on a missing path", "SNIFF-4"),
        ("Caching", "sniff() writes a cache", "SNIFF-4"),
        ("Slow", "sniff() takes more than a second", "SNIFF-5"),
        ("Refusing", "import_run() raises KeyError", "IMPORT-1"),
        ("Zeros", "what was not measured becomes 0", "IMPORT-2"),
        ("Unsourced", "a second file is read and not named", "IMPORT-3"),
        ("Touching", "the source is opened for writing", "IMPORT-4 IMPORT-5"),
        ("Littering", "a log is left in the current folder", "IMPORT-5"),
        ("Loud", "importing warns", "IMPORT-6"),
        ("AxisSwap", "(n, 3) is read as (3, n)", "VALUE-1 IMPORT-2"),
        ("Millimetres", "mm are said to be m", "VALUE-1"),
        ("Late", "times are one frame off", "VALUE-2"),
        ("ShiftedDrive", "the input is one frame off", "VALUE-3"),
        ("Degrees", "degrees are said to be radians", "VALUE-4"),
        ("Random", "chance enters the data", "REPEAT-1 REPEAT-2"),
        ("Seeded", "the order of a set enters the data", "REPEAT-2"),
        ("Trusting", "a cut table gives IndexError", "ROBUST-1"),
        ("Fragile", "a flipped bit gives UnicodeDecodeError", "ROBUST-2"),
        ("Empty", "an empty file gives ZeroDivisionError", "ROBUST-3"),
        ("Leaving", "a failed import leaves a file", ""),
        ("Unpickling", "pickles are loaded", "ROBUST-4"),
        ("Following", "links in HDF5 are followed", "ROBUST-5"),
        ("Unpacking", "archives are unpacked with ../", "ROBUST-5"),
        ("Listing", "a folder gives ValueError", "ROBUST-6"),
        ("Opening", "a file that cannot be opened gives OSError", "ROBUST-7"),
        ("Forgetful", "the symbols are not what drove the body", "VALUE-3 PIPE-1"),
    ]),
    *_rows(runner, faulty_runners.TABLE),
    *_rows(recorder, faulty_recorders.TABLE),
    *_rows(exporter, faulty_exporters.TABLE),
]  # fmt: skip


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
