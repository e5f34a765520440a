"""A new plugin from templates: a distribution that works as it is, to be changed file by file."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from string import Template

from openprc.errors import ConfigError, ResultExists

#: What a plugin can be, to the template of its part and what that part is for.
PARTS = {
    "import": (
        "importer",
        "Importer",
        "how a file of your program is read, and how it is recognised",
    ),
    "run": ("runner", "Runner", "your simulator, and what it cannot model"),
    "record": ("recorder", "Recorder", "what is stored of a loop that a user's script runs"),
    "export": ("exporter", "Exporter", "how a trajectory is written in your format"),
}
_CASES = {
    "import": "    ImporterCase(SPEC, truth=truth),\n",
    "run": "    RunnerCase(SPEC),\n",
    "record": "    RecorderCase(SPEC, script=script, truth=swing, forget=forget, crash=crash),\n",
    "export": "    ExporterCase(EXPORTER),\n",
}
_NAMES = {
    "import": "ImporterCase", "run": "RunnerCase", "record": "RecorderCase",
    "export": "ExporterCase",
}  # fmt: skip
_VALID = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*\Z")
#: Names that would be a plugin of this project, or shadow one of its modules.
_TAKEN = ("", "example", "testing")


def create_plugin(name: str, parent: Path, *, kinds: Sequence[str] = ("import",)) -> Path:
    """Write the distribution ``openprc-<name>`` into the folder `parent` and return its folder.

    Parameters
    ----------
    name : str
        Lower-case words joined by hyphens; a leading "openprc-" is left out.
    parent : Path
        Made when it is not there.
    kinds : sequence of {"import", "run", "record", "export"}

    Raises
    ------
    ConfigError
        When the name or a kind is not valid.
    ResultExists
        When the folder is there already.
    """
    short = name.removeprefix("openprc-")
    if not _VALID.match(short) or short in _TAKEN:
        raise ConfigError(
            f"the name {name!r} cannot be that of a plugin",
            expected="lower-case letters, digits and hyphens, such as my-simulator",
            fix="choose another name",
            key="name",
        )
    wanted = [kind for kind in PARTS if kind in kinds]
    unknown = sorted(set(kinds) - set(PARTS))
    if unknown or not wanted:
        raise ConfigError(
            f"a plugin cannot {unknown[0]!r}" if unknown else "the plugin would do nothing",
            expected="one or more of " + ", ".join(PARTS),
            fix="correct the kind",
            key="kind",
        )
    target = parent / f"openprc-{short}"
    if target.exists():
        raise ResultExists(
            "there is something of this name",
            expected="no such folder",
            fix="choose another name or folder",
            file=target,
        )
    parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=parent, prefix=".new-plugin-") as scratch:
        folder = Path(scratch) / target.name
        for path, text in _contents(short, wanted).items():
            file = folder / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
        shutil.move(folder, target)
    return target


def _contents(short: str, kinds: list[str]) -> dict[str, str]:
    package = "openprc_" + short.replace("-", "_")
    words = {
        "name": short,
        "distribution": f"openprc-{short}",
        "package": package,
        "title": short.replace("-", " ").capitalize(),
        "upper": short.replace("-", "").upper(),
    }
    found = {
        "pyproject.toml": _fill("pyproject.toml", words),
        "README.md": _fill("README.md", {**words, "rows": _rows(package, kinds)}),
        f"{package}/__init__.py": _init(words, kinds),
        "tests/test_conforms.py": _tests(words, kinds),
    }
    for kind in kinds:
        stem = PARTS[kind][0]
        found[f"{package}/{stem}.py"] = _fill(f"{stem}.py", words)
    if "import" in kinds:
        found[f"{package}/samples.py"] = _fill("samples.py", words)
    producing = [kind for kind in kinds if kind != "export"]
    if producing:
        imports = "".join(
            f"from {package}.{PARTS[kind][0]} import {PARTS[kind][1]}\n"
            for kind in sorted(producing, key=lambda kind: PARTS[kind][0])
        )
        bases = ", ".join(PARTS[kind][1] for kind in producing)
        found[f"{package}/producer.py"] = _fill(
            "producer.py", {**words, "imports": imports, "bases": bases}
        )
    return found


def _fill(name: str, words: dict[str, str]) -> str:
    text = (files("openprc.cli") / "skeleton" / f"{name}.txt").read_text(encoding="utf-8")
    return Template(text).substitute(words)


def _rows(package: str, kinds: list[str]) -> str:
    rows = [f"| `{package}/{PARTS[kind][0]}.py` | {PARTS[kind][2]} |\n" for kind in kinds]
    if "import" in kinds:
        rows.append(f"| `{package}/samples.py` | a small run of which every number is known |\n")
    return "".join(rows)


def _init(words: dict[str, str], kinds: list[str]) -> str:
    producing = [kind for kind in kinds if kind != "export"]
    names = [
        *(["ExporterSpec"] if "export" in kinds else []),
        *(["OptionSpec"] if "import" in kinds else []),
        *(["ProducerSpec"] if producing else []),
    ]
    records = ""
    if producing:
        fields = ""
        if "import" in kinds:
            fields += f'            suffixes=(".{words["name"]}",),\n'
            fields += f'            magic=(b"{words["name"]} trajectory 1",),\n'
            fields += (
                '            options=(OptionSpec("unit", "Unit of lengths", default="mm"),),\n'
                f'            sample="{words["package"]}.samples:write_sample",\n'
            )
        if "run" in kinds:
            fields += (
                '            elements=("nodes", "bars", "gravity", "damping", "force-actuators"),\n'
            )
        capabilities = "".join(f'"{kind}", ' for kind in producing)
        capabilities = capabilities.rstrip() if len(producing) == 1 else capabilities.rstrip(", ")
        records += _fill(
            "producer_record.py", {**words, "capabilities": capabilities, "fields": fields}
        )
    if "export" in kinds:
        records += _fill("exporter_record.py", words)
    return _fill("init.py", {**words, "imports": ", ".join(names), "records": records.rstrip("\n")})


_TRUTH = '''

def truth():
    """What the sample holds."""
    return {"time": samples.times(), "positions": samples.positions()}
'''
_SCRIPTS = '''

def start(out):
    return record_run(Swing(), out, producer="$name")


def script(out):
    """Record 50 steps."""
    with start(out) as session:
        for _ in range(50):
            session.step()


def forget(out):
    """Record 50 steps, and forget to close."""
    recording = start(out)
    for _ in range(50):
        recording.session.step()


def crash(out):
    """Record some steps, and fail."""
    with start(out) as session:
        session.step()
        raise RuntimeError("on purpose")


def swing():
    """What `script` records."""
    time = 0.01 * np.arange(51)
    place = np.stack([np.cos(np.pi * time), np.sin(np.pi * time)], axis=-1)
    return {"time": time, "positions": place[:, np.newaxis]}
'''


def _imported(names: list[str]) -> str:
    """Return names for an import statement, in one line or one a line."""
    if len(names) < 5:
        return ", ".join(names)
    return "(\n" + "".join(f"    {name},\n" for name in names) + ")"


def _tests(words: dict[str, str], kinds: list[str]) -> str:
    package = words["package"]
    hooks = [
        *(["openprc_exporters"] if "export" in kinds else []),
        *(["openprc_producers"] if kinds != ["export"] else []),
    ]
    own = [
        f"from {package} import {', '.join([*hooks, *(['samples'] if 'import' in kinds else [])])}"
    ]
    others = []
    helpers = ""
    if kinds != ["export"]:
        helpers += "(SPEC,) = openprc_producers()\n"
    if "export" in kinds:
        helpers += "(EXPORTER,) = openprc_exporters()\n"
    if "import" in kinds:
        helpers += _TRUTH
    if "record" in kinds:
        own.append(f"from {package}.recorder import Swing")
        others.append("from openprc.hooks import record_run")
        helpers += Template(_SCRIPTS).substitute(words)
    head = "import numpy as np\n" if "record" in kinds else ""
    head += "\n".join(own) + "\n"
    if others:
        head += "\n" + "\n".join(others)
    return _fill(
        "test_conforms.py",
        {
            "head": head,
            "names": _imported(
                [*sorted(_NAMES[kind] for kind in kinds), "parametrize_with_checks"]
            ),
            "helpers": helpers.rstrip("\n") + ("\n\n" if helpers.count("def ") else ""),
            "cases": "".join(_CASES[kind] for kind in kinds),
        },
    )


__all__ = ["PARTS", "create_plugin"]
