"""``openprc scenes`` and ``openprc scene``."""

import subprocess
import sys

import pytest

from openprc.scenes.catalog import SCENES
from openprc.schema import load_experiment


def test_the_table_has_every_scene(call):
    said = call("scenes")
    assert said.code == 0
    for name in SCENES:
        assert name in said.text
    assert "known by" in said.text
    assert "openprc scene NAME --out DIR" in said.text


def test_the_list_as_json(call):
    rows = call("scenes", "--json").data["scenes"]
    assert [row["name"] for row in rows] == list(SCENES)
    for row in rows:
        spec = SCENES[row["name"]]
        assert row["needs"] == list(spec.needs)
        assert "demlat" in row["producers"]
        defaults = {option["name"]: option["default"] for option in row["options"]}
        assert defaults == {option.name: option.default for option in spec.options}
        assert all(option["help"] for option in row["options"])


def test_asked_producers_refuse_what_their_records_do_not_tell(call):
    """A record says "contact"; shown the ball, PyBullet's runner refuses it."""
    rows = {row["name"]: row for row in call("scenes", "--ask", "--json").data["scenes"]}
    assert rows["bouncing-body"]["producers"] == ["demlat"]
    assert "pyelastica" not in rows["spring-lattice"]["producers"]


def test_listing_imports_no_simulator_and_no_solver():
    code = (
        "import sys; from openprc.cli.main import main\n"
        "try: main(['scenes'])\n"
        "except SystemExit: pass\n"
        "heavy = 'scipy numba pybullet elastica h5py sklearn matplotlib pydantic'.split()\n"
        "print('LOADED', sorted(set(heavy) & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.rstrip().endswith("LOADED []")


def test_writing_a_scene(call, tmp_path):
    said = call("scene", "pendulum", "--out", "swing", "-o", "angle=0.5", "-o", "rigid=true")
    assert said.code == 0
    experiment = load_experiment(tmp_path / "swing")
    assert experiment.geometry.bars.rigid.all()
    assert experiment.geometry.labels == ("pivot", "bob")
    assert "elliptic function of a rigid pendulum" in said.text
    assert "openprc run swing --producer demlat" in said.text
    assert (
        "openprc scene pendulum --check swing/output/simulation.h5 -o angle=0.5 -o rigid=true"
        in said.text
    )


def test_what_is_known_as_json(call):
    data = call("scene", "cantilever", "-o", "n=5", "--out", "a b", "--json").data
    assert data["options"] == {"n": 5, "force": 0.005, "duration": 24.0}
    assert data["reference"]["kind"] == "closed form"
    tip = data["reference"]["probes"][0]
    assert tip["value"] == pytest.approx(0.00954930, abs=5e-9)
    assert tip["unit"] == "m"
    assert data["experiment"]["n_nodes"] == 6
    assert {"bends", "drag", "force drives"} <= {p["name"] for p in data["experiment"]["physics"]}
    assert len(data["files"]) == 3
    assert {p["producer"]: p["state"] for p in data["producers"]}["demlat"] == "runs"
    assert data["commands"]["run"]["demlat"] == "openprc run 'a b' --producer demlat"
    assert data["commands"]["check"].startswith("openprc scene cantilever --check 'a b'/output")
    assert data["chaotic"] is False
    assert set(data) >= {"scale", "quasi_static", "input_name", "features", "run_options"}


def test_nothing_is_written_unless_asked(call, tmp_path):
    said = call("scene", "swinging-chain")
    assert said.code == 0
    assert "chaotic" in said.text
    assert "openprc scene swinging-chain --out DIR" in said.text
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("inside", ["input", "."])
def test_an_experiment_is_not_replaced(call, tmp_path, inside):
    folder = tmp_path / "mine" / inside
    folder.mkdir(parents=True)
    (folder / "config.json").write_text("mine")
    said = call("scene", "oscillator", "--out", "mine")
    assert said.code == 2
    assert "there is an experiment in this folder already" in said.text
    assert "--force" in said.text
    assert (folder / "config.json").read_text() == "mine"
    assert call("scene", "oscillator", "--out", "mine", "--force").code == 0
    assert load_experiment(tmp_path / "mine").geometry.n_nodes == 2


def test_a_run_that_holds_and_one_that_does_not(call):
    call("scene", "oscillator", "--out", "one", "-o", "periods=2")
    assert call("run", "one").code == 0
    held = call("scene", "oscillator", "--check", "one/output/simulation.h5", "-o", "periods=2")
    assert held.code == 0
    assert "frequency" in held.text
    wrong = ("--check", "one/output/simulation.h5", "-o", "frequency=1.01")
    said = call("scene", "oscillator", *wrong)
    assert said.code == 1
    assert "2 of 2 do not hold" in said.text
    data = call("scene", "oscillator", *wrong, "--json").data
    assert data["ok"] is False
    assert data["probes"][0]["measured"] == pytest.approx(1.0)
    assert data["probes"][0]["deviation"] == pytest.approx(0.01 / 1.01, rel=1e-6)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["scene", "oscilator"], "did you mean 'oscillator'?"),
        (["scene", "nothing-like-it"], "see `openprc scenes`"),
        (["scene", "miura", "-o", "collumns=3"], "did you mean 'columns'?"),
        (["scene", "miura", "-o", "variant=twisting"], "one of driven, folding"),
        (["scene", "oscillator", "-o", "periods=1.5"], "a whole number"),
        (["scene", "oscillator", "-o", "frequency=-3"], "expected: above 0"),
        (["scene", "oscillator", "--out", "a", "--check", "b"], "one at a time"),
        (["scene", "oscillator", "--check", "absent.h5"], "absent.h5"),
    ],
)
def test_wrong_calls(call, words, says):
    said = call(*words)
    assert said.code == 2
    assert says in said.text
    assert "Traceback" not in said.text


def test_a_run_of_another_body(call):
    call("scene", "oscillator", "--out", "one", "-o", "periods=1")
    call("run", "one")
    said = call("scene", "pendulum", "--check", "one/output/simulation.h5")
    assert said.code == 2
    assert "no node is labelled 'bob'" in said.text
