"""SIGKILL at random moments: committed frames stay, and no half file has a final name.

The trial itself is `benchmarks/crash_trial.py`, which also runs on its own.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "benchmarks" / "crash_trial.py"
pytestmark = pytest.mark.skipif(os.name != "posix", reason="there is no SIGKILL")


@pytest.fixture(scope="module")
def trial():
    spec = importlib.util.spec_from_file_location("crash_trial", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    sys.modules["crash_trial"] = module  # dataclasses look their module up there
    spec.loader.exec_module(module)
    yield module
    del sys.modules["crash_trial"]


def judge(trial, record_property, outcomes, least):
    found = trial.summary(outcomes)
    for name, value in found.items():
        record_property(name, value)
    text = f"{found['survivors']} of {found['with_committed_frames']} survived: {found}"
    assert found["lost"] == 0, text
    assert found["survivors"] >= least, text


def test_killed_writer_leaves_every_committed_frame(trial, record_property):
    judge(trial, record_property, trial.run_trials(8, seed=1, longest=0.3), least=4)


@pytest.mark.slow
def test_many_killed_writers_leave_every_committed_frame(trial, record_property):
    judge(trial, record_property, trial.run_trials(60, seed=100), least=40)


def test_trial_notices_a_loss(trial, tmp_path, make_small):
    """A trial that cannot fail would prove nothing."""
    setting = trial.Setting(1 << 10, 1 << 10, 50)
    path = tmp_path / "run-0.h5"
    child = subprocess.Popen(
        [sys.executable, str(SCRIPT), "--child", str(tmp_path), "1024", "1024", "50"],
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    with child:
        heard = "".join(iter(child.stdout.readline, "0 done\n"))
        child.kill()
        child.stdout.read()
    for extra in tmp_path.iterdir():
        if extra != path:
            extra.unlink()
    assert trial._judge(tmp_path, heard, setting.frames).verdict == "between two files"
    partial = path.rename(tmp_path / "run-0.h5.partial")
    assert trial._judge(tmp_path, heard, setting.frames).verdict == "prefix kept"
    (tmp_path / "run-0.h5").unlink()
    whole = partial.read_bytes()
    partial.write_bytes(whole[: len(whole) // 2])
    assert trial._judge(tmp_path, heard, setting.frames).verdict == "lost"
    partial.rename(path).write_bytes(make_small("other.h5").read_bytes())
    (tmp_path / "other.h5").unlink()
    found = trial._judge(tmp_path, heard, setting.frames)
    assert (found.verdict, found.detail) == (
        "lost", "run-0.h5 is under its final name and not whole",
    )  # fmt: skip


@pytest.mark.slow
def test_command_line(trial):
    done = subprocess.run(
        [sys.executable, str(SCRIPT), "--tries", "2", "--longest", "0.1"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.startswith("2 tries, ")
