"""Where things are, and running Python in a fresh process."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def root() -> Path:
    """The root of the repository."""
    return ROOT


@pytest.fixture(scope="session")
def plugin_folders() -> list[Path]:
    """The folders of the plugins in this repository."""
    return sorted(path.parent for path in ROOT.glob("plugins/*/pyproject.toml"))


@pytest.fixture(scope="session")
def environment(plugin_folders) -> dict[str, str]:
    """An environment in which package and plugins can be imported, installed or not."""
    paths = [str(ROOT), *map(str, plugin_folders), os.environ.get("PYTHONPATH", "")]
    kept = {k: v for k, v in os.environ.items() if not k.startswith("OPENPRC_")}
    return {**kept, "PYTHONPATH": os.pathsep.join(filter(None, paths))}


@pytest.fixture(scope="session")
def modules_after(environment):
    """Return a function that runs code in a fresh process and returns what it imported."""

    def run(code: str) -> set[str]:
        report = "\nimport sys; print(); print('MODULES', *sys.modules)"
        done = subprocess.run(
            [sys.executable, "-W", "error", "-c", code + report],
            capture_output=True,
            text=True,
            env=environment,
            cwd=ROOT,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        last = done.stdout.strip().splitlines()[-1]
        assert last.startswith("MODULES ")
        return set(last.split()[1:])

    return run
