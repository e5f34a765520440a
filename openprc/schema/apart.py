"""Validation in a process of its own, because HDF5 can crash on damaged files.

Now and then a few changed bytes of metadata end the process that opens the file inside the HDF5
library, where no exception can be caught. A forked child takes the blow.
"""

from __future__ import annotations

import os
import pickle
import signal
import warnings
from pathlib import Path

from openprc.schema.findings import Finding
from openprc.schema.validate import Profile, Report, validate_file

CRASHED = "OPS-F06"


def validate_apart(path: str | Path, *, profile: Profile = "default") -> Report:
    """Do what `validate_file` does; a crash of the HDF5 library becomes a finding.

    Where processes cannot be forked the file is validated in this one.
    """
    path = Path(path)
    if not hasattr(os, "fork"):
        return validate_file(path, profile=profile)
    reader, writer = os.pipe()
    with warnings.catch_warnings():
        # Threads of numerical libraries are idle here, and the child does not need them. Python
        # warns of them, and so does JAX where it is loaded.
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", RuntimeWarning)
        child = os.fork()
    if child == 0:
        _work(path, profile, reader, writer)
    os.close(writer)
    try:
        with os.fdopen(reader, "rb") as stream:
            answer = stream.read()
    finally:
        _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status) or not answer:
        return Report(path, profile, (_crash(status),))
    # From our own child: this pickle never touched a file.
    outcome = pickle.loads(answer)  # noqa: S301
    if isinstance(outcome, BaseException):
        raise outcome
    report: Report = outcome
    return report


def _work(path: Path, profile: Profile, reader: int, writer: int) -> None:
    """Validate in the child, send the outcome, and end without the parent's clean-up."""
    code = 1
    try:
        os.close(reader)
        outcome: Report | BaseException
        try:
            outcome = validate_file(path, profile=profile)
        except Exception as error:  # noqa: BLE001 - the parent raises whatever it is
            outcome = error
        with os.fdopen(writer, "wb") as stream:
            stream.write(pickle.dumps(outcome))
        code = 0
    finally:
        os._exit(code)


def _crash(status: int) -> Finding:
    number = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
    name = (
        signal.Signals(number).name if number else f"exit code {os.waitstatus_to_exitcode(status)}"
    )
    return Finding(
        CRASHED,
        "error",
        "/",
        f"the HDF5 library crashed while reading it ({name})",
        "metadata as they were written",
        "the file is damaged: copy it again from where it was made",
    )
