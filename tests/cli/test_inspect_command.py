"""``openprc inspect``: complete tables and JSON, and every kind of wrong call."""

import json
from dataclasses import replace

import numpy as np
import pytest
from older_files import write_inputs

from openprc.compare.inspection import inspect_experiment
from openprc.demlat.planning.engine_terms import engine_terms
from openprc.demlat.planning.step_table import scheme_steps
from openprc.schema.experiment import Experiment, load_experiment, save_experiment
from openprc.schema.geometry import Bars, Geometry, Hinges

KEYS = ["name", "runs", "physics", "producers", "terms", "steps", "plan", "motions", "findings",
        "notes"]  # fmt: skip


@pytest.fixture
def square(tmp_path):
    """Write an open square on two fixed nodes: one mechanism."""

    def write(**settings):
        geometry = Geometry(
            positions=[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]],
            masses=np.ones(4),
            fixed=[True, True, False, False],
            bars=Bars(
                indices=[(1, 2), (2, 3), (3, 0)],
                stiffness=np.full(3, 100.0),
                rest_length=np.ones(3),
                **settings.pop("bars", {}),
            ),
            **settings.pop("elements", {}),
        )
        times = {"duration": 1.0, "dt": 0.01, "save_interval": 0.1}
        scene = Experiment(geometry=geometry, **times | settings)
        save_experiment(scene, tmp_path / "square")
        return tmp_path / "square"

    return write


def test_everything_is_shown(openprc, square):
    said = openprc("inspect", square())
    assert said.code == 0
    for part in (
        "what it uses", "who can run it", "what the engine compiles",
        "steps: how long they may be", "stability limit", "motions that strain nothing",
        "nodes 2 and 3 shift together along x", "PLAN-MECHANISM", "expected:", "to do:",
    ):  # fmt: skip
        assert part in said.text, part


def test_json_is_complete(openprc, square):
    data = openprc("inspect", square(), "--json").data
    assert list(data) == KEYS
    assert data["runs"] is True
    assert {item["name"]: item["count"] for item in data["physics"]}["bars"] == 3
    assert [item["producer"] for item in data["producers"]] == ["demlat"]
    assert data["motions"]["n_mechanisms"] == 1
    assert data["motions"]["shown"][0]["nodes"] == [2, 3]
    assert data["plan"]["verdict"] == "fine"
    assert data["plan"]["cost"]["evaluations"] == 400
    (step,) = [item for item in data["steps"] if item["integrator"] == "verlet"]
    assert set(step) >= {"order", "limit", "set_by", "recommended", "verdict", "cost"}
    assert step["set_by"].startswith("bar ")
    (finding,) = data["findings"]
    assert all(finding[key] for key in ("code", "level", "path", "found", "expected", "fix"))


def test_limits_are_those_of_the_closed_form(openprc, square):
    # Two masses at the top in the plane: the fastest mode stretches the bar between them
    # against each other, omega^2 = 2 k / m.
    data = openprc("inspect", square(), "--json").data
    limits = {item["integrator"]: item["limit"] for item in data["steps"]}
    omega = np.sqrt(200.0)
    assert limits["verlet"] == pytest.approx(2.0 / omega, rel=2e-3)
    assert limits["rk4"] == pytest.approx(2.0 * np.sqrt(2.0) / omega, rel=2e-3)
    assert limits["midpoint"] is None
    assert "rattle" not in limits  # nothing is rigid


def test_another_integrator_is_judged(openprc, square):
    data = openprc("inspect", square(), "--integrator", "verlet", "--json").data
    assert data["plan"]["integrator"] == "verlet"


def test_an_accuracy_instead_of_a_step_is_planned(openprc, square):
    folder = square(accuracy=1e-3, integrator="auto", dt_stated=False, dt=0.1,
                    gravity=(0.5, 0.0, 0.0), damping=0.1)  # fmt: skip
    told = json.loads(openprc("inspect", folder, "--json").out)
    assert told["plan"]["accuracy"]["accuracy"] == 1e-3
    assert told["plan"]["integrator"] in {line["integrator"] for line in told["steps"]}
    assert {line["verdict"] for line in told["steps"]} == {None}


def test_rigid_scenes_are_for_schemes_with_constraints(openprc, square):
    folder = square(bars={"rigid": [True] * 3}, integrator="rattle")
    data = openprc("inspect", folder, "--json").data
    assert [item["integrator"] for item in data["steps"]] == ["rattle", "rk4-dae", "rk4-projection"]
    assert {item["name"]: item["state"] for item in data["terms"]}["rigid elements"] == "runs"


def test_a_scene_that_nobody_can_run_is_inspected_all_the_same(openprc, square):
    folder = square(integrator="magic")
    said = openprc("inspect", folder)
    assert said.code == 0
    assert "the engine has no integrator 'magic'" in said.text
    data = openprc("inspect", folder, "--json").data
    assert (data["runs"], data["plan"], data["terms"]) == (False, None, [])
    assert data["motions"]["n_mechanisms"] == 1
    assert data["producers"][0]["state"] == "refuses"


def test_degenerate_hinges_do_not_stop_it(openprc, square):
    line = Hinges(indices=[[0, 1, 2, 3]], stiffness=[1.0], rest_angle=[3.0])
    folder = square(elements={"hinges": line})
    scene = load_experiment(folder)
    points = scene.geometry.positions.copy()
    points[3] = [0.5, 0.0, 0.0]
    save_experiment(replace(scene, geometry=replace(scene.geometry, positions=points)), folder)
    data = openprc("inspect", folder, "--json").data
    assert data["producers"][0]["state"] == "refuses"
    assert "PLAN-THIN-HINGE" in [finding["code"] for finding in data["findings"]]
    assert data["terms"] == []


def test_folders_of_the_older_layout(openprc, tmp_path):
    folder = write_inputs(tmp_path / "old")
    data = openprc("inspect", folder, "--json").data
    assert list(data) == KEYS
    names = {item["name"] for item in data["physics"]}
    assert {"rigid bars", "hinges", "position drives"} <= names


def test_scenes_of_the_library_by_name(openprc, square, tmp_path):
    data = openprc("inspect", "pendulum", "--json").data
    assert data["motions"]["n_whole"] > 0
    # A folder of that name wins.
    square().rename(tmp_path / "pendulum")
    data = openprc("inspect", "pendulum", "--json").data
    assert data["motions"]["n_mechanisms"] == 1


def test_what_is_shown_is_written(openprc, square, tmp_path):
    folder, out = square(), tmp_path / "seen.json"
    said = openprc("inspect", folder, "--out", out)
    assert said.code == 0
    assert "written:" in said.text
    first = json.loads(out.read_text())
    assert list(first) == KEYS
    again = openprc("inspect", folder, "--out", out)
    assert again.code == 2
    assert "there is a finished file of this name" in again.text
    assert openprc("inspect", folder, "--out", out, "--force", "--json").data == first
    assert sorted(p.name for p in tmp_path.iterdir()) == ["seen.json", "square"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("nowhere",), "there is no folder and no scene 'nowhere'"),
        (("pendulun",), "did you mean 'pendulum'?"),
        (("square", "--integrator", "rk5"), "the integrator 'rk5'"),
        ((), "Missing argument"),
    ],
)
def test_wrong_calls_end_with_a_message(openprc, square, words, told):
    square()
    said = openprc("inspect", *words)
    assert said.code == 2
    assert told in said.text


def test_wrong_files_end_with_a_message(openprc, square, tmp_path):
    folder = square()
    (folder / "input" / "config.json").write_text("{}")
    said = openprc("inspect", folder, "--json")
    assert said.code == 2
    assert said.data["error"] == "ConfigError"
    (tmp_path / "empty").mkdir()
    assert openprc("inspect", tmp_path / "empty").code == 2


# --- what the engine compiles --------------------------------------------------------------------


def lattice(n=8, **settings):
    node = np.arange(n * n).reshape(n, n)
    pairs = [(node[:-1], node[1:]), (node[:, :-1], node[:, 1:]), (node[:-1, :-1], node[1:, 1:])]
    indices = np.concatenate([np.stack([a.ravel(), b.ravel()], axis=1) for a, b in pairs])
    x = np.stack([*np.divmod(np.arange(n * n), n), np.zeros(n * n)], axis=1).astype(float)
    bars = Bars(
        indices=indices,
        stiffness=np.full(len(indices), 10.0),
        rest_length=np.linalg.norm(x[indices[:, 1]] - x[indices[:, 0]], axis=1),
        damping=np.full(len(indices), settings.pop("dashpots", 0.0)),
    )
    body = Geometry(
        positions=x, masses=np.ones(n * n), fixed=np.arange(n * n) < 2 * n, bars=bars,
    )  # fmt: skip
    times = {"duration": 1.0, "dt": 0.01, "save_interval": 0.1}
    return Experiment(geometry=body, **times | settings)


def terms(experiment):
    return {item.name: item.state for item in engine_terms(experiment)}


def test_large_bodies_are_stepped_without_what_they_lack():
    bare = terms(lattice())
    absent = ("third axis", "damping of bars", "hinges", "bends", "rigid elements", "gravity",
              "drag", "actuators", "contact", "elements between fixed nodes")  # fmt: skip
    assert {name: bare[name] for name in absent} == dict.fromkeys(absent, "left out")
    full = terms(lattice(gravity=(0.0, 0.0, -1.0), damping=0.1, dashpots=0.1))
    present = ("third axis", "damping of bars", "gravity", "drag")
    assert {name: full[name] for name in present} == dict.fromkeys(present, "runs")


def test_small_bodies_share_a_loop():
    small = terms(lattice(3))
    assert {small[name] for name in ("hinges", "gravity", "drag", "actuators")} == {"idle"}
    assert (small["third axis"], small["bends"]) == ("runs", "left out")


def test_the_table_of_steps_is_the_estimate_of_each_scheme():
    from openprc.demlat.planning.stability import step_limit

    scene = lattice(gravity=(0.0, 0.0, -1.0), dashpots=0.5)
    for line in scheme_steps(scene):
        alone = step_limit(replace(scene, integrator=line.integrator))
        assert line.limit == (alone.limit if np.isfinite(alone.limit) else None)
        assert line.verdict == alone.verdict(scene.dt)
        if line.recommended is not None:
            assert line.recommended <= min(alone.recommended, scene.save_interval) * (1 + 1e-12)
            assert scene.save_interval / line.recommended == pytest.approx(
                round(scene.save_interval / line.recommended)
            )


def test_an_inspection_asks_the_registry_that_it_is_given(square):
    from openprc.hooks import Registry

    seen = inspect_experiment(load_experiment(square()), registry=Registry([]))
    assert [item.producer for item in seen.producers] == ["demlat"]
    assert seen.runs
