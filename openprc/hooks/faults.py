"""The one place that catches everything: where a plugin's code is called.

A plugin is a stranger's code. Whatever it raises, SystemExit included, must be laid at its own
door and must not stop the host or the other plugins.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from openprc.errors import OpenPRCError, PluginError


class PluginWarning(UserWarning):
    """A plugin was left out; the others are loaded."""


def debugging() -> bool:
    """Whether faults of plugins are to be raised as they are (OPENPRC_PLUGIN_DEBUG=1)."""
    return os.environ.get("OPENPRC_PLUGIN_DEBUG", "") not in ("", "0")


def reason(error: BaseException) -> str:
    """Return an exception in one line."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


@contextmanager
def owned_by(plugin: str, doing: str, *, file: str | None = None) -> Iterator[None]:
    """Turn whatever a plugin raises into a `PluginError` that names the plugin.

    Errors of this package pass unchanged: they already say what to do. So does Ctrl-C.
    """
    try:
        yield
    except (OpenPRCError, KeyboardInterrupt):
        raise
    except BaseException as error:
        if debugging():
            raise
        raise PluginError(
            f"the plugin {plugin} failed while {doing}: {reason(error)}",
            expected="a plugin that reports problems as OpenPRC errors",
            fix=f"report it to the authors of {plugin}; OPENPRC_PLUGIN_DEBUG=1 shows the trace",
            file=file,
        ) from error
