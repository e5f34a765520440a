"""``openprc compare``: files, scenes, folders of one's own; and every call that is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

from openprc.schema import Provenance, TrajectoryWriter
from openprc.schema.experiment import save_experiment
from openprc.testing import closed_form_scenes


@pytest.fixture
def make_run(tmp_path):
    """Return a function that writes a node on a circle, at a rate and a distance [m]."""

    def make(name, *, rate=1.0, radius=1.0, start=0.0, labels=None, dims=2, n_nodes=1):
        path = tmp_path / name
        times = start + np.linspace(0.0, 6.0, 301)
        x = np.zeros((len(times), n_nodes, dims))
        x[..., 0] = radius * np.cos(rate * times)[:, np.newaxis] + 10.0 * np.arange(n_nodes)
        x[..., 1] = radius * np.sin(rate * times)[:, np.newaxis]
        with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
            writer.declare_nodes(n_nodes, dims, unit="m", labels=labels)
            writer.append(times, positions=x)
        return path

    return make


def test_two_files(openprc, make_run):
    one, other = make_run("one.h5"), make_run("other.h5", radius=1.001)
    outcome = openprc("compare", one, other, "--unit", "mm")
    assert outcome.code == 0
    # A circle that is larger by 1 mm, watched from a point on it.
    for words in ("rms [mm]", "one.h5", "other.h5", "agrees", "reference", "not scored"):
        assert words in outcome.text, words
    data = openprc("compare", one, other, "--json").data
    pair = data["comparison"]["pairs"][0]
    assert pair["largest"] == pytest.approx(1e-3, rel=1e-6)
    assert pair["rms"] == pytest.approx(1e-3, rel=1e-6)
    assert data["divergences"]["other.h5"]["verdict"] == "agrees"


def test_another_reference(openprc, make_run):
    files = [make_run(f"{name}.h5", radius=r) for name, r in (("a", 1.0), ("b", 1.1), ("c", 1.2))]
    data = openprc("compare", *files, "--reference", "c.h5", "--no-tasks", "--json").data
    assert data["reference"] == "c.h5"
    pairs = data["comparison"]["pairs"]
    assert [pair["name"] for pair in pairs] == ["a.h5", "b.h5"]
    assert [pair["largest"] for pair in pairs] == pytest.approx([0.2, 0.1])


def test_a_folder_is_written_once(openprc, make_run, tmp_path):
    files, out = [make_run("a.h5"), make_run("b.h5", radius=1.05)], tmp_path / "found"
    assert openprc("compare", *files, "--no-tasks", "--out", out).code == 0
    assert sorted(item.name for item in out.iterdir()) == ["comparison.html", "comparison.json"]
    before = (out / "comparison.json").read_bytes()
    again = openprc("compare", *files, "--no-tasks", "--out", out)
    assert again.code == 2
    assert "--force" in again.text
    assert (out / "comparison.json").read_bytes() == before
    assert openprc("compare", *files, "--no-tasks", "--out", out, "--force").code == 0


def test_a_scene_on_two_producers(openprc, tmp_path):
    out = tmp_path / "found"
    outcome = openprc(
        "compare", "--scene", "oscillator", "-s", "periods=2",
        "--producers", "demlat,demlat:verlet,vision", "--out", out,
    )  # fmt: skip
    assert outcome.code == 0
    for words in ("closed-form", "within", "CPU [s]", "vision: refused: vision cannot run"):
        assert words in outcome.text, words
    told = json.loads((out / "comparison.json").read_text())
    assert [run["status"] for run in told["producers"]] == ["ok", "ok", "refused"]
    assert told["producers"][0]["cpu_seconds"] > 0.0
    assert told["cost"].startswith("CPU time of this process")
    assert {item.name for item in (out / "runs").iterdir()} == {
        "demlat.h5", "demlat-verlet.h5", "closed-form.h5",
    }  # fmt: skip
    assert (out / "input" / "geometry.h5").is_file()
    again = openprc("compare", "--scene", "oscillator", "--producers", "demlat", "--out", out)
    assert again.code == 2
    assert "finished file of this name" in again.text


def test_a_folder_of_ones_own(openprc, tmp_path):
    save_experiment(closed_form_scenes.oscillator(1.0).experiment, tmp_path / "mine")
    data = openprc(
        "compare", "--experiment", tmp_path / "mine", "--producers", "demlat,demlat:dop853",
        "--no-tasks", "--twins", "--json",
    ).data  # fmt: skip
    assert data["title"] == "mine"
    assert data["twins"]["chaotic"] is False
    assert data["divergences"]["demlat:dop853"]["verdict"] == "agrees"
    # Nothing is written beside what the user gave.
    assert [item.name for item in (tmp_path / "mine").iterdir()] == ["input"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "one of the three"),
        (("--scene", "oscillator", "--experiment", "x"), "one of the three"),
        (("--scene", "oscillator"), "say who runs it"),
        (("--experiment", "x", "--producers", "demlat", "-s", "n=1"), "-s is for --scene"),
        (("a.h5", "b.h5", "--producers", "demlat"), "--producers needs --scene"),
        (("a.h5", "b.h5", "--twins"), "--twins needs --scene"),
        (("a.h5",), "1 file to compare"),
        (("a.h5", "a.h5"), "the same file is named twice"),
        (("a.h5", "b.h5"), "a.h5"),
        (("--scene", "oscilator", "--producers", "demlat"), "did you mean 'oscillator'"),
        (("--scene", "oscillator", "--producers", "demlat", "-s", "x=1"), "no option 'x'"),
        (("--scene", "oscillator", "--producers", "nobody"), "no producer named 'nobody'"),
        (("--scene", "oscillator", "--producers", "vision"), "none of the producers runs it"),
        (("--experiment", "nowhere", "--producers", "demlat"), "nowhere"),
        (
            ("--scene", "oscillator", "--producers", "demlat", "--reference", "x"),
            "no run called 'x'",
        ),
    ],
)
def test_calls_that_are_refused(openprc, words, said):
    outcome = openprc("compare", *words)
    assert outcome.code == 2
    assert said in outcome.text
    assert "Traceback" not in outcome.text


def test_refusals_are_json_for_programs(openprc):
    outcome = openprc("compare", "--scene", "oscillator", "--producers", "vision", "--json")
    assert outcome.code == 2
    assert outcome.data["error"] == "ConfigError"


def test_files_without_anything_in_common(openprc, make_run):
    early = make_run("early.h5")
    late = openprc("compare", early, make_run("late.h5", start=100.0))
    assert late.code == 2
    assert "overlap" in late.text or "common" in late.text
    named = make_run("named.h5", n_nodes=2, labels=["p", "q"])
    strange = make_run("strange.h5", n_nodes=3, labels=["x", "y", "z"], radius=50.0)
    assert openprc("compare", named, strange, "--match", "label").code == 2


def test_a_file_where_a_folder_is_to_be_made(openprc, make_run, tmp_path):
    (tmp_path / "taken").write_text("mine")
    one, two = make_run("one.h5"), make_run("two.h5")
    for call in (
        ("compare", one, two, "--out", tmp_path / "taken"),
        ("compare", one, two, "--out", tmp_path / "taken" / "deeper"),
        ("scene", "oscillator", "--out", tmp_path / "taken"),
        ("tradeoff", "oscillator", "--out", tmp_path / "taken"),
    ):
        done = openprc(*call)
        assert done.code == 2
        assert "taken is a file" in done.text
        assert "give another --out" in done.text
    assert (tmp_path / "taken").read_text() == "mine"


def test_nodes_that_do_not_move_agree_with_nothing(openprc, make_run, tmp_path):
    with TrajectoryWriter(tmp_path / "still.h5", provenance=Provenance("test")) as writer:
        writer.declare_nodes(1, 3, unit="m")
        for k in range(20):
            writer.append(0.1 * k, positions=[[0.0, 0.0, 0.0]])
    copy = tmp_path / "copy.h5"
    copy.write_bytes((tmp_path / "still.h5").read_bytes())
    data = openprc("compare", tmp_path / "still.h5", copy, "--json").data
    assert data["divergences"] == {}
