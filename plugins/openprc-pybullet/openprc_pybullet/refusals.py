"""Files of PyBullet that hold no trajectory: recognised, and refused with the reason."""

from __future__ import annotations

from pathlib import Path

from openprc.errors import NotATrajectory

_HEAD = 4096

#: What it is, why it cannot be imported, what to do.
_REASONS = {
    "bullet": (
        "a .bullet file written by saveBullet: one snapshot of the world",
        "it holds a single instant",
        "record the run with startStateLogging(STATE_LOGGING_GENERIC_ROBOT, ...), or save the "
        "poses of every step",
    ),
    "commands": (
        "a log of client commands (STATE_LOGGING_ALL_COMMANDS)",
        "it holds what was asked of the server, as raw structures of one version of Bullet, "
        "and no state",
        "replay it in that version of PyBullet and record STATE_LOGGING_GENERIC_ROBOT meanwhile",
    ),
    "profile": (
        "a timing profile (STATE_LOGGING_PROFILE_TIMINGS)",
        "it tells how long the code took, not where the bodies were",
        "record STATE_LOGGING_GENERIC_ROBOT instead",
    ),
    "world": (
        "a script written by saveWorld: the poses of the bases at one instant, six decimals",
        "it holds a single instant",
        "record the run with startStateLogging(STATE_LOGGING_GENERIC_ROBOT, ...)",
    ),
}


def recognise(head: bytes) -> str | None:
    """Return which of the refused kinds a file that begins with `head` is, or None."""
    if head.startswith((b"BULLETd", b"BULLETf")):
        return "bullet"
    if head.startswith(b"BT3CMD"):
        return "commands"
    start = head.lstrip()
    if start.startswith(b'{"traceEvents"') and b'"cat":"timing"' in start:
        return "profile"
    if start.startswith(b"import pybullet") and b".connect(p.SHARED_MEMORY)" in start:
        return "world"
    return None


def read_head(path: Path) -> bytes:
    """Return the first few kilobytes of a file."""
    with path.open("rb") as stream:
        return stream.read(_HEAD)


def refuse(kind: str, path: Path) -> NotATrajectory:
    """Return the error that explains why a file of this kind is not imported."""
    what, why, remedy = _REASONS[kind]
    return NotATrajectory(
        f"this is {what}; {why}",
        expected="a recording over time",
        fix=remedy,
        file=path,
    )
