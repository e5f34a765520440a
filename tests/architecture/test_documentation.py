"""The pages: their Python runs, their commands exist."""

from __future__ import annotations

import doctest
import re
import shlex
import tomllib
from importlib import import_module
from itertools import pairwise
from pathlib import Path

import pytest

from openprc.cli.main import COMMANDS, cli
from openprc.hooks import Registry
from openprc.scenes.catalog import SCENES

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("README.md"), *ROOT.glob("docs/**/*.md")])
PLUGIN_PAGES = sorted(ROOT.glob("plugins/*/README.md"))
_BLOCK = re.compile(r"^```(\w*)([^\n]*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
_END_OF_COMMAND = {"|", "&&", "||", ";", ">", ">>", "2>", "&"}


def blocks(text, *languages):
    """Return the code in these languages, but for the files of a walk-through (`file=NAME`).

    Those are the business of test_plugin_walkthrough.py.
    """
    return [
        match[3]
        for match in _BLOCK.finditer(text)
        if match[1] in languages and " file=" not in match[2]
    ]


def name_of(path):
    return str(path.relative_to(ROOT))


def typed_lines(text):
    """Yield every line of the console blocks that somebody types, and the inline commands."""
    for match in _BLOCK.finditer(text):
        if match[1] not in ("console", "bash", "sh", "shell"):
            continue
        lines = match[3].replace("\\\n", " ").splitlines()
        prompted = any(line.startswith("$ ") for line in lines)
        for line in lines:
            if not prompted or line.startswith("$ "):
                yield line.removeprefix("$ ")
    yield from re.findall(r"`(openprc [^`\n]+)`", _BLOCK.sub("", text))


def openprc_calls(text):
    """Return every `openprc ...` that the page tells to type, as lists of words."""
    calls = []
    for line in typed_lines(text):
        words = shlex.split(line, comments=True)
        while (start := next((i for i, w in enumerate(words) if _is_openprc(w)), None)) is not None:
            words = words[start + 1 :]
            end = next((i for i, word in enumerate(words) if word in _END_OF_COMMAND), len(words))
            calls.append(words[:end])
    return calls


def _is_openprc(word):
    return word.rpartition("/")[2] == "openprc"


def mistakes(words, known_options, known_producers):
    """Return what is wrong with a call."""
    if not words or words[0] in ("--help", "-h", "--version"):
        return []
    if words[0] not in COMMANDS:
        return [f"no command {words[0]!r}"]
    command = cli.get_command(None, words[0])
    flags = {"--help", "-h"}
    for parameter in command.params:
        flags |= {*parameter.opts, *parameter.secondary_opts}
    found = []
    for word, following in pairwise([*words[1:], ""]):
        if word.startswith("-") and word.partition("=")[0] not in flags:
            found.append(f"{words[0]} has no option {word!r}")
        option = following.partition("=")[0]
        if word in ("-o", "--option") and option not in known_options and not option.isupper():
            found.append(f"nobody has the option {following!r}")
        if word in ("--as", "--producer") and following.rpartition("/")[2] not in known_producers:
            if following.isupper():
                continue  # a placeholder
            found.append(f"no producer {following!r}")
    return found


@pytest.fixture(scope="module")
def known():
    """Names of producers and of their options, of the package and of the plugins here."""
    with pytest.MonkeyPatch.context() as patch:
        specs = [item.spec for item in Registry([]).producers]
        exporters = [item.spec for item in Registry([]).records("openprc_exporters")]
        for file in ROOT.glob("plugins/*/pyproject.toml"):
            patch.syspath_prepend(file.parent)
            project = tomllib.loads(file.read_text())["project"]
            for name in project["entry-points"]["openprc"].values():
                module = import_module(name)
                specs += getattr(module, "openprc_producers", list)()
                exporters += getattr(module, "openprc_exporters", list)()
        options = {option.name for spec in specs + exporters for option in spec.options}
        options |= {option.name for spec in specs for option in spec.run_options}
        options |= {option.name for scene in SCENES.values() for option in scene.options}
        yield options, {spec.name for spec in specs}


def test_there_is_a_readme_with_code_and_commands():
    text = (ROOT / "README.md").read_text()
    assert blocks(text, "python")
    assert openprc_calls(text)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_the_python_of_a_page_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for folder in ROOT.glob("plugins/openprc-*"):
        monkeypatch.syspath_prepend(folder)
    namespace = {"__name__": "__main__"}
    for number, block in enumerate(blocks(page.read_text(), "python"), start=1):
        where = f"{name_of(page)}, block {number}"
        if ">>> " in block:
            test = doctest.DocTestParser().get_doctest(block, namespace, where, where, 0)
            failures = []
            runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
            runner.run(test, out=failures.append, clear_globs=False)
            assert not failures, "".join(failures)
            namespace.update(test.globs)
        else:
            exec(compile(block, where, "exec"), namespace)


@pytest.mark.parametrize("page", [*PAGES, *PLUGIN_PAGES], ids=name_of)
def test_the_commands_of_a_page_exist(page, known):
    for words in openprc_calls(page.read_text()):
        assert mistakes(words, *known) == [], " ".join(["openprc", *words])


@pytest.mark.parametrize("page", [*PAGES, *PLUGIN_PAGES], ids=name_of)
def test_links_to_files_lead_somewhere(page):
    text = _BLOCK.sub("", page.read_text())
    targets = re.findall(r"\]\(([^)\s]+)\)", text)
    local = [t.partition("#")[0] for t in targets if "://" not in t and not t.startswith("#")]
    assert [t for t in local if not (page.parent / t).exists()] == []


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("```console\n$ openprc validate run.h5 --json\nrun.h5: valid\n```\n", []),
        ("```console\n$ openprc valdate run.h5\n```\n", ["no command 'valdate'"]),
        ("```bash\nopenprc run x --sede 3\n```\n", ["run has no option '--sede'"]),
        ("```sh\nA=1 uv run openprc import x.csv \\\n  -o untis=m\n```\n",
         ["nobody has the option 'untis=m'"]),
        ("```console\n$ openprc import x --as zzz | less\n```\n", ["no producer 'zzz'"]),
        ("```console\n$ openprc --help && openprc nope\n```\n", ["no command 'nope'"]),
        ("```sh setup\n.venv/bin/openprc nope && x\n```\n", ["no command 'nope'"]),
        ("```console\nopenprc run x --sede 3\n```\n", ["run has no option '--sede'"]),
        ("see `openprc nope x` and `openprc run`", ["no command 'nope'"]),
        ("```console\n$ openprc import x --as NAME  # openprc nope\n```\n", []),
    ],
)  # fmt: skip
def test_the_reader_of_commands_finds_mistakes(text, wrong, known):
    assert [m for words in openprc_calls(text) for m in mistakes(words, *known)] == wrong
