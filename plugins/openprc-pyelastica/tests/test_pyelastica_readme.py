"""The example of the README runs."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

README = Path(__file__).resolve().parents[1] / "README.md"


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("elastica") is None, reason="needs pyelastica")
@pytest.mark.filterwarnings("default")  # the simulator's own warnings are not ours
def test_the_example_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (example,) = re.findall(r"^```python\n(.*?)^```", README.read_text(), re.DOTALL | re.MULTILINE)
    exec(compile(example, str(README), "exec"), {"__name__": "__main__"})
    assert (tmp_path / "arm.h5").exists()
