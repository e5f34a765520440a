"""Asking a peer that waits in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any, Self

BENCHMARKS = Path(__file__).parents[1]


class PeerProcess:
    """``python -m MODULE ...`` on one thread, which answers every line with one of JSON.

    Other lines that it prints are passed over. It is up and ready once this is made.
    """

    def __init__(self, python: Path, module: str, *arguments: Path) -> None:
        self.child = subprocess.Popen(
            [python, "-m", module, *arguments],
            cwd=BENCHMARKS,
            env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._answer()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.child.communicate()

    def ask(self, words: str) -> dict[str, Any]:
        """Send a line and return the answer."""
        assert self.child.stdin is not None
        self.child.stdin.write(f"{words}\n")
        self.child.stdin.flush()
        return self._answer()

    def _answer(self) -> dict[str, Any]:
        assert self.child.stdout is not None
        for line in self.child.stdout:
            if line.startswith("{"):
                answer: dict[str, Any] = json.loads(line)
                return answer
        raise SystemExit("the peer ended; see its message above")
