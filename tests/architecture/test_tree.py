"""The shape of the repository: sizes, names, what may not stand in it, metadata."""

from __future__ import annotations

import re
import subprocess
import tomllib
from pathlib import Path

import pytest

from openprc import __version__

MAX_LINES = 400
#: Names that say nothing about what is in a module.
EMPTY_NAMES = {"utils", "util", "helpers", "helper", "common", "misc", "tools"}

# Put together from parts, so that this file does not contain what it looks for.
_FOLDERS = "|".join(("work", "tmp", "root", "home", "Users"))
MACHINE_PATH = re.compile(rf"(?<![\w.~}}/-])/(?:{_FOLDERS})/\w".encode())
_HOSTS = (r"\.".join(("py" + "pi", "org")), "python" + "hosted", r"\.".join(("anaconda", "org")),
          r"\.".join(("npm" + "js", "org")), "arti" + "factory", "index" + "-url")  # fmt: skip
REGISTRY = re.compile("|".join(_HOSTS).encode(), re.IGNORECASE)


def modules(root):
    yield from sorted((root / "openprc").rglob("*.py"))
    yield from sorted(root.glob("plugins/*/openprc_*/**/*.py"))
    yield from sorted(root.glob("plugins/*/*.py"))


@pytest.fixture(scope="session")
def kept_files(root) -> list[Path]:
    """Every file that is tracked, or would be with the next commit."""
    try:
        done = subprocess.run(
            ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
            capture_output=True,
            cwd=root,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout")
    names = [name for name in done.stdout.decode().split("\0") if name]
    return [root / name for name in names if (root / name).is_file()]


def test_modules_are_short(root):
    lengths = {str(p.relative_to(root)): len(p.read_text().splitlines()) for p in modules(root)}
    assert len(lengths) > 50
    assert {name: count for name, count in lengths.items() if count > MAX_LINES} == {}


def test_modules_are_named_by_what_they_are_about(root):
    assert [str(p) for p in modules(root) if p.stem in EMPTY_NAMES] == []


def test_modules_say_what_they_are_about(root):
    import ast

    silent = [str(p) for p in modules(root) if not ast.get_docstring(ast.parse(p.read_text()))]
    assert silent == []


def test_test_folders_are_no_packages_and_file_names_are_unique(root):
    folders = [root / "tests", *root.glob("plugins/*/tests")]
    assert [str(p) for folder in folders for p in folder.rglob("__init__.py")] == []
    names = [p.name for folder in folders for p in folder.rglob("test_*.py")]
    assert sorted(name for name in set(names) if names.count(name) > 1) == []


@pytest.mark.parametrize(
    ("pattern", "hit", "miss"),
    [
        (MACHINE_PATH, b"see /" + b"home/me/run.h5", b"see ~/run.h5 and a/tmp/x, https://x/tmp/y"),
        (MACHINE_PATH, b'"/' + b'tmp/x"', b"/topology/nodes /time_series"),
        (REGISTRY, b"https://py" + b"pi.org/simple", b"pip install openprc"),
    ],
)
def test_the_patterns_find_what_they_should(pattern, hit, miss):
    assert pattern.search(hit)
    assert not pattern.search(miss)


@pytest.mark.parametrize("pattern", [MACHINE_PATH, REGISTRY], ids=["paths", "hosts"])
def test_no_file_tells_about_the_machine_it_was_made_on(kept_files, root, pattern):
    found = []
    for path in kept_files:
        for number, line in enumerate(path.read_bytes().split(b"\n"), start=1):
            if pattern.search(line):
                found.append(f"{path.relative_to(root)}:{number}: {line[:120]!r}")
    assert found == []


def test_nothing_that_is_made_is_kept(kept_files, root):
    made = re.compile(r"(\.partial|\.pyc|\.egg-info|\.simulation\.h5|uv\.lock)(/|\Z)|__pycache__")
    assert [str(p) for p in kept_files if made.search(str(p.relative_to(root)))] == []


def test_files_are_small(kept_files, root):
    large = {str(p.relative_to(root)): p.stat().st_size for p in kept_files}
    assert {name: size for name, size in large.items() if size > 1 << 20} == {}


# --- metadata ----------------------------------------------------------------------------------


def project_of(folder):
    return tomllib.loads((folder / "pyproject.toml").read_text())


def test_the_version_is_said_once(root):
    assert project_of(root)["project"]["version"] == __version__


def test_plugins_are_packaged_alike(plugin_folders):
    assert len(plugin_folders) == 7
    for folder in plugin_folders:
        settings = project_of(folder)
        project = settings["project"]
        package = folder.name.replace("-", "_")
        short = folder.name.removeprefix("openprc-")
        assert project["name"] == folder.name
        assert re.fullmatch(r"1\.0\.0\.dev\d+", project["version"]), folder.name
        assert project["entry-points"]["openprc"] == {short: package}
        assert "openprc>=1.0.0.dev0,<2" in project["dependencies"], folder.name
        assert project["requires-python"] == ">=3.11"
        assert project["license"] == "Apache-2.0"
        assert settings["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"] == [package]
        assert project["readme"] == "README.md"
        readme = (folder / "README.md").read_text()
        assert readme.startswith(f"# {folder.name}\n"), folder.name
        assert list((folder / "tests").glob("test_*.py")), folder.name


def test_plugins_belong_to_the_workspace(root, plugin_folders):
    settings = project_of(root)
    names = {folder.name for folder in plugin_folders}
    group = {entry.partition("[")[0] for entry in settings["dependency-groups"]["dev"]}
    assert names <= group
    assert names <= set(settings["tool"]["uv"]["sources"])
    lines = (root / "requirements.txt").read_text().splitlines()
    listed = {line.removeprefix("-e plugins/").partition("[")[0] for line in lines}
    assert names <= listed


def test_what_the_metadata_names_is_there(root):
    project = project_of(root)["project"]
    for name in (project["readme"], *project["license-files"]):
        assert (root / name).is_file(), name
