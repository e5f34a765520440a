"""Doing something in a fresh interpreter, and hearing what came of it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from openprc.testing.outcome import fail

_PATIENCE = 300.0  # s; a busy machine may take long, a process that hangs takes forever


def run_python(
    arguments: Sequence[str],
    *,
    given: Mapping[str, Any] | None = None,
    folder: Path | None = None,
    environment: Mapping[str, str] | None = None,
) -> subprocess.CompletedProcess[str]:
    """Run this interpreter, with the same search path, on `arguments`; `given` is its JSON input.

    Raises
    ------
    CheckFailed
        When it does not end.
    """
    paths = [name for name in sys.path if name and Path(name).exists()]
    variables = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(paths),
        # Faults of plugins are to be told, not raised, whatever the shell of the caller says.
        "OPENPRC_PLUGIN_DEBUG": "",
        **(environment or {}),
    }
    try:
        return subprocess.run(  # noqa: S603 - this interpreter, and arguments of the checks
            [sys.executable, *arguments],
            input=json.dumps(given or {}, default=str),
            capture_output=True,
            text=True,
            cwd=folder,
            env=variables,
            timeout=_PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        fail(
            f"a process did not end within {_PATIENCE:g} s",
            expected="an end",
            fix="look for a loop or a lock",
        )


def answer_of(
    arguments: Sequence[str],
    *,
    given: Mapping[str, Any] | None = None,
    folder: Path | None = None,
    environment: Mapping[str, str] | None = None,
) -> Any:
    """Return what a process printed as JSON in its last line.

    Raises
    ------
    CheckFailed
        When it failed, with the end of its trace.
    """
    done = run_python(arguments, given=given, folder=folder, environment=environment)
    if done.returncode != 0:
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        fail(
            f"a fresh interpreter failed: {lines[-1] if lines else f'exit {done.returncode}'}",
            expected="code that works in an interpreter of its own",
            fix="run it alone to see the trace",
        )
    return json.loads(done.stdout.splitlines()[-1])


__all__ = ["answer_of", "run_python"]
