"""Every exception that OpenPRC raises on purpose.

A message has three parts, because a reader needs all three: what was found, what was
expected, and what to do about it. The file and the key (a dataset path, a configuration
field, an option) are separate attributes so that tools need not parse prose.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any


class OpenPRCError(Exception):
    """Base of the family.

    Parameters
    ----------
    found : str
        What was met, as a clause without a full stop.
    expected : str
        What should have been there instead.
    fix : str
        What the reader can do now.
    file : path-like, optional
        The file concerned.
    key : str, optional
        The dataset, attribute, field or option concerned.
    """

    #: Exit code at the command line: 1 for a run that failed, 2 for input that is wrong.
    exit_code = 2

    def __init__(
        self,
        found: str,
        *,
        expected: str = "",
        fix: str = "",
        file: str | Path | None = None,
        key: str | None = None,
    ) -> None:
        self.found = found
        self.expected = expected
        self.fix = fix
        self.file = None if file is None else str(file)
        self.key = key
        super().__init__(self.message())

    def message(self) -> str:
        """Return the whole message, one line for each part that is present."""
        where = ": ".join(part for part in (self.file, self.key) if part)
        lines = [f"{where}: {self.found}" if where else self.found]
        if self.expected:
            lines.append(f"  expected: {self.expected}")
        if self.fix:
            lines.append(f"  to do: {self.fix}")
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        """Return the parts as plain values, for JSON output."""
        return {
            "error": type(self).__name__,
            "file": self.file,
            "key": self.key,
            "found": self.found,
            "expected": self.expected,
            "fix": self.fix,
        }

    def __reduce__(self) -> tuple[Any, ...]:
        # The keyword-only signature would otherwise be lost on the way between processes.
        return (_rebuild, (type(self), self.found, self.expected, self.fix, self.file, self.key))


def _rebuild(
    kind: type[OpenPRCError],
    found: str,
    expected: str,
    fix: str,
    file: str | None,
    key: str | None,
) -> OpenPRCError:
    return kind(found, expected=expected, fix=fix, file=file, key=key)


# --- files and the contract -------------------------------------------------------------


class UnreadableFile(OpenPRCError):
    """The path is missing, a directory, empty, truncated, or not of the format it claims."""


class UnsafeFile(OpenPRCError):
    """Reading the file could reach outside it, run code, or exhaust the memory."""


class UntrustedPickle(UnsafeFile):
    """The file is a pickle and the caller has not said that its origin is trusted."""


class SchemaError(OpenPRCError):
    """The content breaks the file contract."""


class SchemaTooNew(SchemaError):
    """The file follows a newer major version of the contract than this package knows."""


class SchemaTooOld(SchemaError):
    """The file follows an older major version and has to be migrated or imported first."""


class IncompleteFile(SchemaError):
    """The run that wrote the file did not finish."""


class ResultExists(OpenPRCError):
    """Writing would replace a finished result."""


class MissingData(SchemaError):
    """Something that was asked for is not in the file. Nothing is made up in its place."""


class MissingInputError(MissingData):
    """The file does not say what drove the body."""


class UnitError(SchemaError):
    """The unit is not in the closed list, or there is no conversion between the two units."""


class NonUniformTime(SchemaError):
    """The samples are not evenly spaced, so there is no single time step."""


class NotATrajectory(UnreadableFile):
    """The file was recognised, and it holds something other than a trajectory."""


# --- video -------------------------------------------------------------------------------


class VideoError(UnreadableFile):
    """The video is damaged, empty, or changes in the middle."""


class NoFeaturesError(MissingData):
    """The image shows nothing that a detector would track."""


class CalibrationError(OpenPRCError):
    """The calibration cannot be computed, or does not fit the recording."""


# --- experiments and runs ---------------------------------------------------------------


class ConfigError(OpenPRCError):
    """The experiment's configuration, geometry or signals are wrong."""


class UnsupportedScene(OpenPRCError):
    """The producer cannot model something that the scene contains."""


class Diverged(OpenPRCError):
    """The integration left the range of finite, plausible numbers."""

    exit_code = 1


class NotConverged(OpenPRCError):
    """An iteration ended without the balance that was asked for."""

    exit_code = 1


class TaskError(OpenPRCError):
    """The task, split or score cannot be computed from what was given."""


# --- plugins ----------------------------------------------------------------------------


class PluginError(OpenPRCError):
    """A plugin broke the contract or failed while it was used."""

    exit_code = 1


class MissingDependency(PluginError):
    """The plugin is there, the package that it drives is not."""

    exit_code = 2


class UnknownName(PluginError):
    """No record of that name is registered."""

    exit_code = 2


class AmbiguousName(PluginError):
    """Several distributions registered a record of that name."""

    exit_code = 2


class NoImporter(PluginError):
    """No importer recognises the file."""

    exit_code = 2


class AmbiguousFile(PluginError):
    """Several importers recognise the file equally well."""

    exit_code = 2
