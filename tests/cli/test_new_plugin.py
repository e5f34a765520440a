"""``openprc new-plugin``: what it writes loads, and nothing is written over."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
import tomllib
from itertools import combinations

import pytest
from click.testing import CliRunner

from openprc.cli.main import cli
from openprc.cli.scaffold import PARTS, create_plugin
from openprc.errors import ConfigError, ResultExists

EVERY_MIX = [kinds for count in range(1, len(PARTS) + 1) for kinds in combinations(PARTS, count)]


@pytest.mark.parametrize("kinds", EVERY_MIX, ids="-".join)
def test_every_mix_of_kinds_is_a_plugin(tmp_path, kinds):
    folder = create_plugin("my-rig", tmp_path, kinds=kinds)
    assert folder == tmp_path / "openprc-my-rig"
    assert [path.name for path in tmp_path.iterdir()] == ["openprc-my-rig"]
    project = tomllib.loads((folder / "pyproject.toml").read_text())
    assert project["project"]["entry-points"]["openprc"] == {"my-rig": "openprc_my_rig"}
    for file in folder.rglob("*.py"):
        text = file.read_text()
        ast.parse(text)
        assert "$" not in text
        assert max(map(len, text.splitlines())) <= 100, file.name
    for kind in PARTS:
        assert (folder / "openprc_my_rig" / f"{PARTS[kind][0]}.py").exists() == (kind in kinds)
        assert (f"{PARTS[kind][1]}Case(" in (folder / "tests/test_conforms.py").read_text()) == (
            kind in kinds
        )


def loaded(folder, code):
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=folder, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_its_records_name_code_that_is_there(tmp_path):
    folder = create_plugin("openprc-my-rig", tmp_path, kinds=tuple(PARTS))
    printed = loaded(
        folder,
        "import importlib, openprc_my_rig as m\n"
        "for spec in [*m.openprc_producers(), *m.openprc_exporters()]:\n"
        "    for target in filter(None, (spec.load, getattr(spec, 'sample', ''))):\n"
        "        module, name = target.split(':')\n"
        "        print(spec.name, getattr(importlib.import_module(module), name).__name__)\n",
    )
    assert printed == ["my-rig", "Producer", "my-rig", "write_sample", "my-rig", "Exporter"]


@pytest.mark.parametrize("name", ["", "My-Rig", "1rig", "rig_a", "../rig", "rig-", "example"])
def test_names_that_cannot_be(tmp_path, name):
    with pytest.raises(ConfigError, match="cannot be that of a plugin"):
        create_plugin(name, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_kinds_that_cannot_be(tmp_path):
    with pytest.raises(ConfigError, match="a plugin cannot 'dance'"):
        create_plugin("rig", tmp_path, kinds=("import", "dance"))
    with pytest.raises(ConfigError, match="would do nothing"):
        create_plugin("rig", tmp_path, kinds=())


def test_what_is_there_stays(tmp_path):
    (tmp_path / "openprc-rig").mkdir()
    (tmp_path / "openprc-rig" / "mine.txt").write_text("mine")
    with pytest.raises(ResultExists, match="something of this name"):
        create_plugin("rig", tmp_path)
    assert [path.name for path in (tmp_path / "openprc-rig").iterdir()] == ["mine.txt"]


def test_the_command(tmp_path):
    call = ["new-plugin", "rig", "--kind", "run", "--kind", "export", "--out", str(tmp_path)]
    done = CliRunner().invoke(cli, [*call, "--json"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.output)
    assert told["folder"] == str(tmp_path / "openprc-rig")
    assert "openprc_rig/runner.py" in told["files"]
    assert "openprc_rig/importer.py" not in told["files"]
    done = CliRunner().invoke(cli, ["new-plugin", "other", "--out", str(tmp_path)])
    assert "openprc check-plugin openprc-other" in done.output
    assert CliRunner().invoke(cli, ["new-plugin", "x", "--kind", "dance"]).exit_code == 2
