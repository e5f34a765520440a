"""The page: one file, text escaped, pictures inside; and the JSON beside it."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from openprc.compare.page import html as page
from openprc.compare.page.html import page_text
from openprc.compare.studies import Choices, compare_runs
from openprc.errors import ResultExists
from openprc.schema import Provenance, TrajectoryWriter

EVIL = "<script>alert('x')</script>"


def write_wave(path, *, error, labels=("left", EVIL, "right")):
    """Write three nodes on a line, of which the second is off by `error` [m]."""
    times = np.linspace(0.0, 4.0, 201)
    x = np.zeros((len(times), 3, 2))
    x[:, :, 0] = np.arange(3.0)
    x[:, 1:, 1] = 0.1 * np.sin(7.0 * times)[:, np.newaxis]
    x[:, 1, 1] += error * times
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_nodes(3, 2, unit="m", labels=list(labels))
        writer.declare_elements("bars", [[0, 1], [1, 2]])
        writer.append(times, positions=x)
    return path


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    paths = [
        write_wave(folder / f"{name}.h5", error=error)
        for name, error in (("a & b", 0.0), ("c", 1e-6), ("d", 0.05))
    ]
    return compare_runs(paths, choices=Choices(tasks=False))


@pytest.fixture(scope="module")
def text(report):
    return page_text(report)


def test_the_page_needs_nothing_from_elsewhere(text):
    assert "http" not in re.sub(r"data:image/png;base64,[^\"]+", "", text)
    assert not re.search(r"<(script|link|iframe)\b", text)
    assert text.count("data:image/png;base64,") >= 3
    assert text.count("<img alt=") == text.count("<img ")


def test_what_strangers_wrote_is_shown_as_text(text):
    assert EVIL not in text
    assert "&lt;script&gt;" in text
    assert "a &amp; b" in text


def test_the_page_says_what_was_found(text):
    for words in ("differs", "agrees", "1 % of the scale", "matched nodes", "comparison.json"):
        assert words in text, words


def test_json_has_every_figure(report, tmp_path):
    path = report.save(tmp_path / "comparison.json")
    told = json.loads(path.read_text())
    assert told["divergences"]["d.h5"]["verdict"] == "differs"
    pair = told["comparison"]["pairs"][1]
    # Two of three nodes agree, and the third is off by up to 0.05 * 4 m.
    assert pair["largest"] == pytest.approx(0.2)
    assert told["comparison"]["pairs"][0]["rms"] == pytest.approx(1e-6 * 4 / 3, rel=0.02)
    assert told["scale"] > 0.0
    assert len(pair["times"]) == len(pair["rms_over_time"])


def test_results_are_replaced_only_when_told(report, text, tmp_path, monkeypatch):
    monkeypatch.setattr(page, "page_text", lambda report: text)
    for name, save in (
        ("r.json", report.save),
        ("r.html", lambda path, **how: page.save_page(report, path, **how)),
    ):
        path = tmp_path / name
        path.write_text("mine")
        with pytest.raises(ResultExists, match="finished file"):
            save(path)
        assert path.read_text() == "mine"
        save(path, overwrite=True)
        assert path.read_text() != "mine"
    assert sorted(item.name for item in tmp_path.iterdir()) == ["r.html", "r.json"]


def test_equal_files_make_a_page_without_empty_pictures(tmp_path):
    paths = [write_wave(tmp_path / f"{name}.h5", error=0.0) for name in "ab"]
    same = compare_runs(paths, choices=Choices(tasks=False))
    assert same.pair("b.h5").rms == 0.0
    assert same.divergences["b.h5"].verdict == "agrees"
    text = page_text(same)
    assert "Difference over time" not in text
