"""What every command has in common: help, JSON, exit codes, errors without a traceback."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import click
import pytest

from openprc import __version__
from openprc.cli.main import COMMANDS, cli, main
from openprc.errors import OpenPRCError, PluginError
from openprc.hooks import ExporterSpec

ROOT = Path(__file__).resolve().parents[2]

#: A call of every command that prints figures, with words that lead nowhere.
NOWHERE = {
    "attach-input": ["none.h5", "--signal", "none.csv", "--out", "x.h5"],
    "benchmark": ["none.h5"],
    "export": ["none.h5", "--out", "new/x.csv", "--to", "fake"],
    "import": ["none.csv"],
    "info": ["none.h5"],
    "migrate": ["none.h5", "--out", "x.h5"],
    "pack": ["none.h5"],
    "repair": ["none.h5"],
    "run": ["none"],
}


@pytest.mark.parametrize("word", ["--help", "-h"])
def test_help_lists_every_command(openprc, word):
    outcome = openprc(word)
    assert outcome.code == 0
    for name, (_, line) in COMMANDS.items():
        assert f"{name} " in outcome.out
        assert line in outcome.text


def test_version(openprc):
    assert openprc("--version").out == f"openprc, version {__version__}\n"


def test_without_words_the_help_is_shown(openprc):
    outcome = openprc()
    assert outcome.code == 2
    assert "Usage: openprc [OPTIONS] COMMAND" in outcome.text


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_command_has_help_and_json(openprc, name):
    outcome = openprc(name, "--help")
    assert outcome.code == 0
    assert outcome.out.startswith(f"Usage: openprc {name} ")
    command = cli.get_command(None, name)
    assert command.name == name
    parts = command.commands if isinstance(command, click.Group) else {"": command}
    for part, leaf in parts.items():
        assert "--json" in openprc(name, *filter(None, [part]), "--help").out
        for parameter in leaf.params:
            if isinstance(parameter, click.Option):
                assert parameter.help, (name, part, parameter.name)


@pytest.mark.parametrize(
    ("typed", "near"),
    [("valdate", "validate"), ("imprt", "import"), ("benchmrak", "benchmark"), ("Run", "run"),
     ("plugin", "plugins"), ("attach_input", "attach-input")],
)  # fmt: skip
def test_an_unknown_command_suggests_the_nearest(openprc, typed, near):
    outcome = openprc(typed, "x.h5")
    assert outcome.code == 2
    assert f"No such command {typed!r}. Did you mean {near!r}?" in outcome.text


def test_an_unknown_command_that_is_near_to_none(openprc):
    outcome = openprc("qqqqqq")
    assert outcome.code == 2
    assert "No such command 'qqqqqq'." in outcome.text
    assert "Did you mean" not in outcome.text


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["validate", "--profil", "archive"], "Did you mean '--profile'?"),
        (["validate"], "Missing argument 'PATHS...'"),
        (["validate", "x.h5", "--profile", "all"], "'all' is not one of 'default', 'benchmark'"),
        (["info"], "Missing argument 'PATH'"),
        (["info", "a", "b"], "Got unexpected extra argument"),
        (["benchmark", "x.h5", "--order", "two"], "'two' is not a valid integer"),
        (["benchmark", "x.h5", "--ridge", "nan"], "'nan' is not a finite number"),
        (["benchmark", "x.h5", "--washout", "inf"], "'inf' is not a finite number"),
        (["attach-input", "x.h5", "--out", "y.h5"], "Missing option '--signal'"),
        (["attach-input", "x.h5", "--signal", "u.csv", "--out", "y.h5", "--hold", "nan"],
         "'nan' is not a finite number"),
        (["attach-input", "x.h5", "--signal", "u.csv", "--out", "y.h5", "--start", "-inf"],
         "'-inf' is not a finite number"),
        (["import", "x.csv", "-o", "unit"], "--option takes KEY=VALUE, got 'unit'"),
        (["import", "x.csv", "-o", "=m"], "--option takes KEY=VALUE, got '=m'"),
        (["migrate", "x.h5"], "Missing option '--out'"),
        (["run"], "Missing argument 'FOLDER'"),
        (["run", "x", "--seed", "1.5"], "'1.5' is not a valid integer"),
    ],
)  # fmt: skip
def test_a_wrong_call_is_told(openprc, tmp_path, words, told):
    outcome = openprc(*words)
    assert outcome.code == 2
    assert told.lower() in outcome.text.lower()
    as_json = openprc(*words, "--json")
    assert (as_json.code, as_json.data["error"]) == (2, "UsageError")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", NOWHERE)
def test_a_missing_path_is_told_by_every_command(openprc, install, tmp_path, name):
    install(fake={"openprc_exporters": [ExporterSpec("fake", "A fake", "a.b:C")]})
    outcome = openprc(name, *NOWHERE[name])
    assert outcome.code == 2
    assert "does not exist" in outcome.text
    assert "error: " in outcome.err
    assert "expected: " in outcome.err
    assert "to do: " in outcome.err
    assert outcome.out == ""
    data = openprc(name, *NOWHERE[name], "--json").data
    assert set(data) == {"error", "file", "key", "found", "expected", "fix"}
    assert (data["error"], "does not exist" in data["found"]) == ("UnreadableFile", True)
    assert list(tmp_path.iterdir()) == []


# --- what a command may raise ------------------------------------------------------------------


@pytest.fixture
def raising(monkeypatch):
    """Return a function that makes `openprc info` raise."""

    def make(error):
        @click.command("info")
        @click.argument("path")
        @click.option("--json", "as_json", is_flag=True)
        def command(path, as_json):
            raise error

        monkeypatch.setattr(
            sys.modules["openprc.cli.main"],
            "import_module",
            lambda name: type("M", (), {"command": command}),
        )

    return make


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (OpenPRCError("odd", expected="even", fix="add one"), 2, "error: odd expected: even"),
        (PluginError("a plugin failed"), 1, "error: a plugin failed"),
        (KeyboardInterrupt(), 130, "stopped; of a simulation, what was committed"),
        (EOFError("ended"), 1, "a fault of openprc itself: EOFError: ended"),
        (ZeroDivisionError("1/0"), 1, "a fault of openprc itself: ZeroDivisionError: 1/0"),
        (PermissionError(errno.EACCES, "Permission denied", "x.h5"), 1,
         "error: x.h5: Permission denied"),
        (OSError(errno.ENOSPC, "No space left on device"), 1, "No space left on device"),
    ],
)  # fmt: skip
def test_exit_codes(openprc, raising, error, code, words):
    raising(error)
    outcome = openprc("info", "x")
    assert (outcome.code, outcome.out) == (code, "")
    assert words in outcome.text


@pytest.mark.parametrize(
    ("error", "kind"),
    [(OpenPRCError("odd"), "OpenPRCError"), (ZeroDivisionError("1/0"), "InternalError"),
     (OSError(errno.ENOSPC, "No space left"), "SystemRefused")],
)  # fmt: skip
def test_errors_as_json(openprc, raising, error, kind):
    raising(error)
    outcome = openprc("info", "x", "--json")
    assert (outcome.data["error"], outcome.err) == (kind, "")


@pytest.mark.parametrize("switch", ["OPENPRC_DEBUG", "OPENPRC_PLUGIN_DEBUG"])
@pytest.mark.parametrize("error", [ZeroDivisionError("1/0"), OSError(28, "full")])
def test_the_trace_can_be_asked_for(raising, monkeypatch, switch, error):
    monkeypatch.setenv(switch, "1")
    raising(error)
    with pytest.raises(type(error)):
        main(["info", "x"])


@pytest.fixture
def environment():
    """An environment in which the package can be imported, installed or not."""
    paths = [str(ROOT), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}


@pytest.mark.parametrize("word", ["--help", "plugins"])
def test_a_reader_that_goes_away_is_no_error(environment, word):
    code = f"from openprc.cli import main; main([{word!r}])"
    with subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=environment,
    ) as process:
        process.stdout.close()
        told = process.stderr.read()
        process.wait(timeout=20)
    assert (process.returncode, told) == (0, b"")


def test_a_process_of_its_own(tmp_path, environment):
    code = "from openprc.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "validate", str(tmp_path / "none.h5")],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
    )
    assert done.returncode == 2
    assert "does not exist" in done.stdout
    assert done.stderr == ""


def test_shells_can_complete_commands(environment):
    code = "from openprc.cli import main; main([])"
    asked = {"_OPENPRC_COMPLETE": "bash_complete", "COMP_WORDS": "openprc va", "COMP_CWORD": "1"}
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        env={**environment, **asked},
    )
    assert (done.returncode, done.stdout) == (0, "plain,validate\n")
