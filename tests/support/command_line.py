"""The command line in this process."""

from __future__ import annotations

import json
from dataclasses import dataclass

import pytest

from openprc.cli.main import main


@dataclass
class Outcome:
    """What a call of the command line did."""

    code: int
    out: str
    err: str

    @property
    def text(self):
        """All that was printed, on one line."""
        return " ".join((self.out + self.err).split())

    @property
    def data(self):
        """What was printed as JSON."""
        return json.loads(self.out)


def called(capsys, *words):
    """Call the command line with words; what was printed before does not count."""
    capsys.readouterr()
    with pytest.raises(SystemExit) as stop:
        main([str(word) for word in words])
    printed = capsys.readouterr()
    outcome = Outcome(stop.value.code, printed.out, printed.err)
    assert "Traceback" not in outcome.text
    return outcome
