"""Entry point ``openprc``: finds the command, and turns every error into a message and a code.

Exit codes: 0 done; 1 the run, the check or a plugin failed; 2 the input or the call is wrong.
"""

from __future__ import annotations

import json
import os
import sys
import warnings
from importlib import import_module
from typing import Any

import click

from openprc import __version__
from openprc.errors import OpenPRCError

#: Command to (module, one line of help). The module is imported when the command runs, so
#: that ``openprc --help`` stays instant.
COMMANDS: dict[str, tuple[str, str]] = {
    "attach-input": ("attach_input", "Add what drove the body to a copy of a file"),
    "benchmark": ("benchmark", "Train a readout on a NARMA task and score it"),
    "characterise": ("characterise", "Measure everything that a body can compute"),
    "calibrate": ("calibrate", "Calibrate a camera, two cameras, or a plane from images"),
    "check-plugin": ("check_plugin", "Run the conformance kit on an installed plugin"),
    "compare": ("compare", "Say how much runs of one body differ, and whether that matters"),
    "demo": ("demo", "Import, run, validate and score one small body a producer"),
    "export": ("export", "Write a trajectory in another format"),
    "import": ("import_run", "Turn another program's file into simulation.h5"),
    "info": ("info", "Show what a file or an experiment folder holds"),
    "inspect": ("inspect_scene", "Say what an experiment needs, and who can run it"),
    "migrate": ("migrate", "Copy a file of an older schema to the present one"),
    "new-plugin": ("new_plugin", "Write a plugin that works as it is, to be changed"),
    "pack": ("pack", "Write a compressed copy and verify it"),
    "plugins": ("plugins", "List plugins and what they can do"),
    "repair": ("repair", "Save what an unfinished run committed"),
    "run": ("run", "Simulate an experiment folder"),
    "scene": ("scene", "Write a body of the library as an experiment folder"),
    "scenes": ("scenes", "List the bodies of the library"),
    "track": ("track", "Track points through a video into a simulation.h5"),
    "tradeoff": ("tradeoff", "Measure what accuracy costs on a scene"),
    "validate": ("validate", "Check files against the contract"),
}


class LazyGroup(click.Group):
    """A group that imports a command's module only when the command is used."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands."""
        return sorted(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Import and return a command; unknown names give click's own message."""
        if name not in COMMANDS:
            return None
        module = import_module(f"openprc.cli.{COMMANDS[name][0]}")
        command: click.Command = module.command
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Name the nearest command when there is none of that name."""
        name = args[0] if args else ""
        if name and name not in COMMANDS and not name.startswith("-"):
            import difflib  # noqa: PLC0415 - only a mistyped command pays for it

            near = difflib.get_close_matches(name, COMMANDS, n=1)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            raise click.UsageError(f"No such command {name!r}.{hint}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands without importing any of them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, COMMANDS[name][1]) for name in sorted(COMMANDS)])


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="openprc")
def cli() -> None:
    """Physical reservoir computing: from any trajectory to what the body can compute.

    Import a run of another simulator, run the native engine, validate files, and score them.
    """


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit."""
    words = sys.argv[1:] if arguments is None else arguments
    as_json = "--json" in words
    warnings.showwarning = _show_warning
    sys.exit(_guarded(words, as_json=as_json))


def _guarded(words: list[str], *, as_json: bool) -> int:
    try:
        if "_OPENPRC_COMPLETE" in os.environ:  # the shell asks what could be typed next
            cli(words, prog_name="openprc")
        # Not cli(): that would turn Ctrl-C, a closed pipe and EOFError into other things.
        with cli.make_context("openprc", list(words)) as ctx:
            cli.invoke(ctx)
        return 0
    except click.exceptions.Exit as stop:
        return int(stop.exit_code)
    except click.ClickException as error:
        _tell({"error": "UsageError", "found": error.format_message()}, as_json, show=error.show)
        return 2
    except OpenPRCError as error:
        message = f"error: {error}"
        _tell(error.as_dict(), as_json, show=lambda: click.echo(message, err=True))
        return error.exit_code
    except KeyboardInterrupt:
        click.echo("stopped; of a simulation, what was committed is in the partial file", err=True)
        return 130
    except BrokenPipeError:
        # The reader of a pipe has gone; there is nobody left to tell.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except SystemExit as stop:
        # rich meets a closed pipe first, and answers it with exit code 1.
        if isinstance(stop.__context__, BrokenPipeError):
            return 0
        raise
    except OSError as error:
        if _debugging():
            raise
        # A full disk, a folder without permission: not a fault of the program, nor of the data.
        named = f"{error.filename}: " if error.filename else ""
        text = f"{named}{error.strerror or error}"
        _tell(
            {"error": "SystemRefused", "file": error.filename, "found": text},
            as_json,
            show=lambda: click.echo(f"error: {text}", err=True),
        )
        return 1
    except Exception as error:
        if _debugging():
            raise
        text = f"a fault of openprc itself: {type(error).__name__}: {error}"
        fix = "report it with the command; OPENPRC_DEBUG=1 shows the trace"
        _tell(
            {"error": "InternalError", "found": text, "fix": fix},
            as_json,
            show=lambda: click.echo(f"error: {text}\n  to do: {fix}", err=True),
        )
        return 1


def _debugging() -> bool:
    return any(os.environ.get(name) for name in ("OPENPRC_DEBUG", "OPENPRC_PLUGIN_DEBUG"))


def _tell(parts: dict[str, Any], as_json: bool, *, show: Any) -> None:
    if as_json:
        click.echo(json.dumps(parts))
    else:
        show()


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: Any = None,
    line: str | None = None,
) -> None:
    click.echo(f"warning: {message}", err=True)
