"""The first chapter of docs/plugins.md, done as it says: block by block, file by file."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import venv
from pathlib import Path

import pytest
from click.testing import CliRunner

from openprc.cli.main import cli

ROOT = Path(__file__).resolve().parents[2]
_BLOCK = re.compile(r"^```(console|python file=(\S+))\n(.*?)^```", re.DOTALL | re.MULTILINE)


def chapter():
    """Return ("console", line) and (name of a file, text), in order."""
    text = (ROOT / "docs" / "plugins.md").read_text(encoding="utf-8")
    start = text.index("## From nothing to a passing plugin")
    text = text[start : text.index("\n## ", start + 3)]
    steps = []
    for kind, file, body in _BLOCK.findall(text):
        if kind == "console":
            steps += [("console", line.removeprefix("$ ")) for line in body.splitlines()]
        else:
            steps.append((file, body))
    return steps


def write(folder, name, text):
    path = folder / name
    assert path.is_file(), f"{name} is not in the skeleton"
    path.write_text(text, encoding="utf-8")


def test_the_chapter_has_commands_and_files():
    kinds = [kind for kind, _ in chapter()]
    assert kinds.count("console") >= 8
    assert len(kinds) - kinds.count("console") >= 4


def test_the_files_of_the_chapter_pass_the_kit(tmp_path):
    """Without installing: the plugin is found by its path."""
    for kind, body in chapter():
        if body.startswith("openprc new-plugin"):
            done = CliRunner().invoke(cli, [*body.split()[1:], "--out", str(tmp_path)])
            assert done.exit_code == 0, done.output
        elif kind != "console":
            write(tmp_path, kind, body)
    folder = tmp_path / "openprc-pendulum"
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(folder)],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(folder)])},
        check=False,
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
    passed = int(re.search(r"(\d+) passed", done.stdout)[1])
    assert passed >= 15, done.stdout


@pytest.mark.slow
def test_the_chapter_in_a_fresh_environment(tmp_path):
    """Every command as it is typed, in a new virtual environment with nothing but the package."""
    home = tmp_path / "environment"
    venv.create(home, with_pip=True)
    binaries = home / ("Scripts" if os.name == "nt" else "bin")
    environment = {
        key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "OPENPRC"))
    } | {"PATH": os.pathsep.join([str(binaries), os.environ["PATH"]]), "VIRTUAL_ENV": str(home)}

    def do(line):
        done = subprocess.run(
            line, shell=True, capture_output=True, text=True, cwd=tmp_path, env=environment,
            check=False,
        )  # fmt: skip
        assert done.returncode == 0, f"$ {line}\n{done.stdout[-4000:]}\n{done.stderr[-4000:]}"
        return done.stdout

    do(f'pip install -q "{ROOT}"')
    printed = ""
    for kind, body in chapter():
        if kind == "console":
            printed += do(body)
        else:
            write(tmp_path, kind, body)
    assert "pendulum" in printed
    assert len(re.findall(r"(\d+) passed", printed)) == 2
    assert "conforms" in printed
    assert (tmp_path / "swing.h5").is_file()
