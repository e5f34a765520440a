"""The command line: a lazy group, one file a command."""

from openprc.cli.main import main

__all__ = ["main"]
