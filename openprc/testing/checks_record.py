"""RECORD: a recorder keeps what happens, however the script ends."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from openprc.errors import OpenPRCError
from openprc.hooks.validating import validate_run
from openprc.schema.atomic import partial_path
from openprc.schema.trajectory import Trajectory
from openprc.testing.cases import RecorderCase
from openprc.testing.check import check
from openprc.testing.outcome import NotApplicable, fail
from openprc.testing.processes import run_python
from openprc.testing.recordings import recorded
from openprc.testing.watching import watching

_CALL = """
import importlib.util, sys
from pathlib import Path
file, name, out = sys.argv[1:]
sys.path.insert(0, str(Path(file).parent))
spec = importlib.util.spec_from_file_location("openprc_forgetful_script", file)
module = importlib.util.module_from_spec(spec)
sys.modules[spec.name] = module
spec.loader.exec_module(module)
kept = getattr(module, name)(Path(out))
"""


@check("RECORD-1", "the script records a valid file", "recorder")
def script_records(case: RecorderCase, folder: Path) -> None:
    """Run the script and validate what it left."""
    if case.script is None:
        raise NotApplicable("the case has no script that records something")
    out = folder / "out.h5"
    with watching() as watched:
        case.script(out)
    if not out.exists():
        left = sorted(path.name for path in folder.iterdir())
        fail(
            f"the script left {left or 'nothing'}",
            expected="the file that it was asked for",
            fix="close the recording at the end",
        )
    report = validate_run(out, registry=case.plugins)
    worst = [finding for finding in report.findings if finding.level == "error"]
    if worst:
        fail(
            f"{worst[0].code} at {worst[0].path}: {worst[0].found}",
            expected=worst[0].expected,
            fix=worst[0].fix,
        )
    if watched.warned:
        fail(
            f"recording warns: {watched.warned[0][:200]}",
            expected="silence",
            fix="say it with writer.note()",
        )


@check("RECORD-2", "the state at t = 0 is recorded, and time increases", "recorder")
def beginning_is_recorded(case: RecorderCase, folder: Path) -> None:
    """Look at the clock."""
    del folder
    with Trajectory(recorded(case)) as run:
        time = run.time
    if time[0] != 0.0:
        fail(
            f"the first frame is at t = {time[0]:.9g}",
            expected="0: the state before any step",
            fix="record once when attaching, before the loop",
        )
    if len(time) < 2 or not (np.diff(time) > 0).all():
        fail(
            f"{len(time)} frames, whose times do not all increase",
            expected="at least two frames, each later than the one before",
            fix="record once a step",
        )


@check("RECORD-3", "a forgotten close leaves a complete file at the end of the process", "recorder",
       apart=True)  # fmt: skip
def forgotten_close(case: RecorderCase, folder: Path) -> None:
    """Let a fresh interpreter run a script that does not close, and end."""
    if case.forget is None:
        raise NotApplicable("the case has no script that forgets to close (forget=)")
    module = sys.modules.get(case.forget.__module__)
    source = getattr(module, "__file__", None)
    name = case.forget.__qualname__
    if source is None or "." in name or "<" in name:
        fail(
            f"forget= is {name}",
            expected="a function of a module, which another process can find",
            fix="define it at the top level of a file",
        )
    out = folder / "out.h5"
    done = run_python(["-c", _CALL, source, name, str(out)], folder=folder)
    if done.returncode != 0:
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        fail(
            f"the process ends with {done.returncode}: {lines[-1] if lines else ''}",
            expected="a quiet end",
            fix="do the work of the end in __exit__",
        )
    if not out.exists():
        left = sorted(path.name for path in folder.iterdir())
        fail(
            f"the process left {left or 'nothing'}",
            expected="the complete file",
            fix="attach through openprc.hooks.record_run, which closes at exit",
        )
    with Trajectory(out) as run, Trajectory(recorded(case)) as whole:
        frames, wanted, status = run.n_frames, whole.n_frames, run.status
    if frames != wanted or status != "complete":
        fail(
            f"{frames} frames with status {status!r}",
            expected=f"{wanted} frames, complete",
            fix="flush what is still held in memory in __exit__",
        )


@check("RECORD-4", "an error in the loop passes, and leaves the frames before it", "recorder")
def crash_keeps_frames(case: RecorderCase, folder: Path) -> None:
    """Let the loop of the script fail."""
    if case.crash is None:
        raise NotApplicable("the case has no script that crashes (crash=)")
    out = folder / "out.h5"
    try:
        case.crash(out)
    except OpenPRCError as error:
        fail(
            f"{type(error).__name__}: {error.found}",
            expected="the error of the script itself",
            fix="let errors of the loop pass through __exit__",
        )
    except Exception:  # noqa: BLE001, S110 - the script's own error, of any type
        pass
    else:
        fail(
            "the error of the loop did not get out",
            expected="the error of the script itself",
            fix="return None from __exit__",
        )
    partial = partial_path(out)
    if out.exists() or not partial.exists():
        left = sorted(path.name for path in folder.iterdir())
        fail(
            f"the crash left {left or 'nothing'}",
            expected=f"{partial.name}",
            fix="leave the life of the file to the host",
        )
    with Trajectory(partial, allow_incomplete=True) as run:
        if run.status != "failed" or run.n_frames < 1:
            fail(
                f"{run.n_frames} frames with status {run.status!r}",
                expected="the frames before the error, with status 'failed'",
                fix="flush what is held in memory when __exit__ is given an error",
            )
