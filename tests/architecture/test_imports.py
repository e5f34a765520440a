"""What may import what, and what importing must not drag in."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib

import pytest

#: Packages that take long to import, or that not everybody has.
HEAVY = {
    "cv2", "elastica", "jax", "matplotlib", "meshio", "numba", "pandas", "pybullet", "pydantic",
    "scipy", "sklearn",
}  # fmt: skip
NUMERIC = {"h5py", "numpy"}
#: What a plugin may use of this package: the contract, the kit, and what runs bodies and writes
#: files by it. Readouts and analysis work on files, whoever made them.
OPEN_TO_PLUGINS = {"demlat", "errors", "exporters", "hooks", "schema", "testing"}


def top(names):
    return {name.partition(".")[0] for name in names}


def test_layers_and_independence_hold(root, environment):
    code = "import sys; from importlinter.cli import lint_imports_command as c; sys.exit(c())"
    done = subprocess.run(
        [sys.executable, "-c", code, "--no-cache"],
        capture_output=True,
        text=True,
        cwd=root,
        env=environment,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 broken" in done.stdout
    kept = int(done.stdout.split("Contracts: ")[1].split(" kept")[0])
    settings = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["importlinter"]
    assert kept == len(settings["contracts"]) >= 2


def test_every_package_has_its_layer(root):
    settings = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["importlinter"]
    layers = next(c["layers"] for c in settings["contracts"] if c["type"] == "layers")
    placed = {name.strip() for layer in layers for name in layer.split("|")}
    there = {f"openprc.{p.parent.name}" for p in root.glob("openprc/*/__init__.py")}
    there |= {f"openprc.{p.stem}" for p in root.glob("openprc/[a-z]*.py")}
    assert there <= placed


@pytest.mark.parametrize(
    ("code", "forbidden"),
    [
        ("import openprc", HEAVY | NUMERIC | {"click", "pluggy", "rich"}),
        ("import openprc.errors", HEAVY | NUMERIC | {"click", "pluggy", "rich"}),
        ("import openprc.hooks", HEAVY | NUMERIC | {"click", "rich"}),
        ("import openprc.hooks.builtin", HEAVY | NUMERIC | {"click", "rich"}),
        ("from openprc.hooks import Registry; Registry([])", HEAVY | NUMERIC | {"click", "rich"}),
        ("import openprc.schema", HEAVY | {"click", "rich"}),
        ("from openprc.schema import Trajectory, TrajectoryWriter", HEAVY | {"click", "rich"}),
        ("from openprc.schema import validate_file, load_experiment", HEAVY | {"click", "rich"}),
        ("from openprc.hooks import import_file, run_experiment", HEAVY | {"click", "rich"}),
    ],
)
def test_imports_are_light(modules_after, code, forbidden):
    assert top(modules_after(code)) & forbidden == set()


CALL = """
import sys
from openprc.cli import main
try:
    main({words!r})
except SystemExit as stop:
    assert not stop.code, stop.code
"""


@pytest.mark.parametrize(
    ("words", "forbidden"),
    [
        (["--help"], HEAVY | NUMERIC | {"pluggy", "rich", "importlib.metadata"}),
        (["--version"], HEAVY | NUMERIC | {"pluggy", "rich"}),
        (["plugins"], HEAVY),
        (["plugins", "--json"], HEAVY),
        (["import", "--help"], HEAVY),
        (["run", "--help"], HEAVY),
        (["validate", "--help"], HEAVY),
        (["info", "--help"], HEAVY),
        (["benchmark", "--help"], HEAVY),
        (["demo", "--help"], HEAVY),
    ],
)
def test_commands_import_what_they_need(modules_after, words, forbidden):
    loaded = modules_after(CALL.format(words=words))
    assert (top(loaded) | loaded) & forbidden == set()


def entry_modules(plugin_folders):
    for folder in plugin_folders:
        project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
        yield from project["entry-points"]["openprc"].values()


def test_entry_modules_of_plugins_import_records_and_nothing_else(plugin_folders, modules_after):
    host = modules_after("import openprc.hooks")
    for name in entry_modules(plugin_folders):
        extra = modules_after(f"import {name}") - host
        assert top(extra) & (HEAVY | NUMERIC | {"click", "rich"}) == set(), name
        package = name.partition(".")[0]
        assert {module for module in extra if module.startswith(package)} == {package}


def imported_from_openprc(source):
    """Yield (line, dotted name) of every import of this package, wherever it stands."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name == "openprc" or alias.name.startswith("openprc."):
                    yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            if node.module == "openprc":
                for alias in node.names:
                    yield node.lineno, f"openprc.{alias.name}"
            elif node.module.startswith("openprc."):
                yield node.lineno, node.module
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute):
            called = node.func.id if isinstance(node.func, ast.Name) else node.func.attr
            if called in ("import_module", "__import__"):
                for word in node.args:
                    if isinstance(word, ast.Constant) and str(word.value).startswith("openprc."):
                        yield node.lineno, str(word.value)


def test_the_reader_of_imports_finds_them_all():
    source = (
        "import openprc.demlat.x\nfrom openprc.cli import main\nfrom openprc import vision\n"
        "def f():\n    from openprc.analysis.tasks import y\n"
        "    import_module('openprc.reservoir')\nimport openprc_example\n"
    )
    assert {name for _, name in imported_from_openprc(source)} == {
        "openprc.demlat.x", "openprc.cli", "openprc.vision", "openprc.reservoir",
        "openprc.analysis.tasks",
    }  # fmt: skip


def test_plugins_use_the_open_part_of_the_package_only(plugin_folders, root):
    wrong = []
    for folder in plugin_folders:
        for path in sorted(folder.glob("openprc_*/**/*.py")):
            for line, name in imported_from_openprc(path.read_text()):
                if [*name.split("."), ""][1] not in OPEN_TO_PLUGINS:
                    wrong.append(f"{path.relative_to(root)}:{line} imports {name}")
    assert wrong == []


def test_the_package_imports_no_plugin(root):
    wrong = []
    for path in sorted((root / "openprc").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            else:
                continue
            wrong += [f"{path}: {name}" for name in names if name.startswith("openprc_")]
    assert wrong == []
