"""Plans: what is known about a run before it is made, and steps that are chosen."""

import json
import math
from dataclasses import replace

import h5py
import numpy as np
import pytest

from openprc.demlat import BarHingeModel, Engine, SimulationSetup
from openprc.demlat.planning.mechanisms import mechanisms, pieces
from openprc.demlat.planning.plan import make_plan
from openprc.demlat.planning.run_cost import PEFRL_DAMPED, run_cost
from openprc.demlat.planning.scene_checks import scene_findings
from openprc.demlat.planning.stability import step_limit
from openprc.errors import ConfigError, UnsupportedScene
from openprc.hooks.running import plan_experiment
from openprc.schema.experiment import load_experiment, save_experiment

X, Y, Z = np.eye(3)


def codes(scene):
    return [finding.code for finding in scene_findings(scene)]


def finding(scene, code):
    return next(finding for finding in scene_findings(scene) if finding.code == code)


# --- what is odd ---------------------------------------------------------------------------------


def test_a_sound_body_gives_no_findings(lattice):
    assert codes(lattice(3)) == ["PLAN-IDLE-BARS"]
    assert finding(lattice(3), "PLAN-IDLE-BARS").found.startswith("2 bars between fixed nodes")
    held = replace(lattice(3).geometry, fixed=[True] + [False] * 8)
    assert codes(replace(lattice(3), geometry=held)) == []


def test_thin_hinges_are_found(body):
    points = [0 * X, X, [0.5, 5e-4, 0], [0.5, -0.8, 0]]
    hinged = [(0, 1, 2, 3, 1.0, np.pi, 0)]
    bars = [(0, 1, 1, 1, 0), (0, 2, 1, 1, 0), (1, 3, 1, 1, 0)]
    thin = body(points, np.ones(4), hinges=hinged, bars=bars, fixed=[True] + [False] * 3)
    assert codes(thin) == ["PLAN-THIN-HINGE"]
    assert "hinge 0 has a wing 0.0005 of its longest edge" in finding(thin, codes(thin)[0]).found


def test_short_bars_are_found(body):
    points = [0 * X, X, 2 * X, 2 * X + 1e-4 * Y]
    bars = [(0, 1, 1, 1, 0), (1, 2, 1, 1, 0), (2, 3, 1, 1e-4, 0)]
    short = body(points, np.ones(4), bars=bars, fixed=[True, False, False, False])
    assert codes(short) == ["PLAN-SHORT-BAR"]
    assert finding(short, "PLAN-SHORT-BAR").found == (
        "bar 2 is 0.0001 m long, the median bar 1 m"
    )  # fmt: skip


def test_nodes_at_one_point_are_found(body):
    points = [0 * X, X, X, 2 * X]
    bars = [(0, 1, 1, 1, 0), (2, 3, 1, 1, 0)]
    double = body(points, np.ones(4), bars=bars, fixed=[True, False, False, True])
    assert codes(double) == ["PLAN-COINCIDENT-NODES"]
    assert "such as node 1 and node 2" in finding(double, "PLAN-COINCIDENT-NODES").found


def test_elements_between_fixed_nodes_are_found(body):
    points = [0 * X, X, [0.5, 0.8, 0], [0.5, -0.8, 0]]
    hinged = [(0, 1, 2, 3, 1.0, np.pi, 0)]
    idle = body(points, np.ones(4), bars=[(0, 1, 1, 1, 0)], hinges=hinged, fixed=[True] * 4)
    assert codes(idle) == ["PLAN-IDLE-BARS", "PLAN-IDLE-HINGES"]
    assert finding(idle, "PLAN-IDLE-BARS").found == "1 bars between fixed nodes (0)"


@pytest.mark.parametrize("gravity", [(0, 0, 0), (0, 0, -9.81)])
def test_pieces_that_nothing_holds_are_found(body, gravity):
    points = [0 * X, X, 5 * Y, 5 * Y + X, 9 * Z]
    bars = [(0, 1, 1, 1, 0), (2, 3, 1, 1, 0)]
    scene = body(points, np.ones(5), bars=bars, fixed=[True] + [False] * 4, gravity=gravity)
    assert pieces(scene).tolist() == [0, 0, 1, 1, 2]
    assert codes(scene) == ["PLAN-LOOSE-NODE", "PLAN-FLOATING"]
    loose, floating = (finding(scene, code) for code in codes(scene))
    assert "no bar or hinge holds node 4" in loose.found
    assert "1 of 3 pieces have no fixed or driven node, such as the 2 nodes 2, 3" in floating.found
    assert ("falls freely" in loose.found) == any(gravity)
    assert ("gravity carries them away" in floating.found) == any(gravity)


def test_a_body_that_floats_as_a_whole_is_only_hinted_at(lattice):
    free = lattice(3, pinned=False)
    assert [f.level for f in scene_findings(free)] == ["hint"]


def test_driven_nodes_hold_their_piece(body, drive):
    signal, actuator = drive([0.0, 0.0], dt=1.0, node=0, type="velocity", axes=(1, 0, 0))
    scene = body([0 * X, X], np.ones(2), bars=[(0, 1, 1, 1, 0)])
    held = replace(scene, signals={"u": signal}, actuators=(actuator,))
    assert codes(scene) == ["PLAN-FLOATING"]
    assert codes(held) == []


# --- mechanisms ----------------------------------------------------------------------------------


def test_mechanisms_of_textbook_frames(body):
    square = [0 * X, X, X + Y, Y]
    edges = [(0, 1, 1, 1, 0), (1, 2, 1, 1, 0), (2, 3, 1, 1, 0), (3, 0, 1, 1, 0)]
    diagonal = (0, 2, 1, math.sqrt(2), 0)
    # Planar: 8 coordinates, 4 bars, 3 motions as a whole.
    assert mechanisms(body(square, np.ones(4), bars=edges)) == (1, 3)
    assert mechanisms(body(square, np.ones(4), bars=[*edges, diagonal])) == (0, 3)
    pinned = body(square, np.ones(4), bars=edges, fixed=[True, True, False, False])
    assert mechanisms(pinned) == (1, 0)
    # In space a tetrahedron is rigid; a square with a crease folds.
    corners = [0 * X, X, Y, Z]
    pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
    assert mechanisms(body(corners, np.ones(4), bars=[(*p, 1, 1, 0) for p in pairs])) == (0, 6)
    folded = [0 * X, X, [0.5, 0.8, 0], [0.5, -0.6, 0.4]]
    panels = [(*p, 1, 1, 0) for p in ((0, 1), (0, 2), (1, 2), (0, 3), (1, 3))]
    assert mechanisms(body(folded, np.ones(4), bars=panels)) == (1, 6)
    fold = [(0, 1, 2, 3, 1.0, np.pi, 0)]
    assert mechanisms(body(folded, np.ones(4), bars=panels, hinges=fold)) == (0, 6)
    # Without stiffness a hinge holds nothing.
    limp = [(0, 1, 2, 3, 0.0, np.pi, 0)]
    assert mechanisms(body(folded, np.ones(4), bars=panels, hinges=limp)) == (1, 6)


def test_motions_as_a_whole_are_counted_piece_by_piece(body):
    points = [0 * X, X + Z, 5 * Y, 7 * Z]
    scene = body(points, np.ones(4), bars=[(0, 1, 1, 1, 0)], fixed=[True, False, False, False])
    # A bar on a pivot turns about two axes; two loose nodes move along three axes each.
    assert mechanisms(scene) == (0, 2 + 3 + 3)


def test_large_bodies_are_not_searched(lattice, monkeypatch):
    monkeypatch.setattr("openprc.demlat.planning.rigidity.DENSE", 5)
    monkeypatch.setattr("openprc.demlat.planning.rigidity.MOST_COORDINATES", 10)
    plan = make_plan(lattice(3))
    assert (plan.n_mechanisms, plan.n_rigid_motions) == (None, None)
    assert ("mechanisms", "not checked: too many coordinates") in plan.rows()


# --- the plan ------------------------------------------------------------------------------------


def test_a_plan_counts_and_judges(lattice, drive):
    signal, actuator = drive(np.zeros((2, 3)), dt=1.0, node=8, type="position")
    scene = lattice(3, damping=0.01, dt=1e-3)
    driven = replace(scene, signals={"u": signal}, actuators=(actuator,))
    plan, limit = make_plan(driven), step_limit(driven)
    assert (plan.n_nodes, plan.n_fixed, plan.n_driven, plan.n_free) == (9, 3, 1, 15)
    assert (plan.n_bars, plan.n_hinges, plan.n_steps, plan.n_frames) == (20, 0, 1000, 101)
    assert (plan.verdict, plan.limit, plan.omega) == ("fine", limit.limit, limit.omega)
    assert plan.accurate == pytest.approx(0.35 * limit.limit)
    assert 0 < plan.loss < 0.01
    assert plan.set_by.startswith("bar ")
    assert plan.runs
    assert any("m away from where node 8 is" in remark for remark in plan.remarks)


def test_what_is_refused_is_in_the_plan(lattice):
    plan = make_plan(lattice(3, dt=0.01))
    assert not plan.runs
    assert (plan.verdict, plan.loss) == ("unstable", None)
    assert [f.code for f in plan.findings if f.level == "error"] == ["DEM-UNSTABLE-STEP"]


def test_a_plan_is_plain_data(lattice):
    scene = lattice(3)
    data = json.loads(json.dumps(make_plan(scene).as_dict()))
    assert data["verdict"] == "fine"
    assert data["cost"]["evaluations"] == 4000
    free = make_plan(replace(scene, integrator="dop853"))
    assert (free.limit, free.n_steps, free.accurate, free.loss) == (None, None, None, None)
    assert dict(free.rows())["steps, frames"] == "chosen by the scheme, 101"
    assert json.loads(json.dumps(free.as_dict()))["limit"] is None


def test_a_wrong_experiment_has_no_plan(lattice):
    with pytest.raises(ConfigError, match="a time above 0 s"):
        make_plan(lattice(3, dt=-1.0))
    with pytest.raises(ConfigError, match="the integrator 'magic'"):
        make_plan(lattice(3, integrator="magic"))


def test_plans_follow_runs(lattice, simulate):
    """The number of evaluations is that of the steps; the file is as large as its frames."""
    scene = lattice(3, damping=0.01)
    limit = step_limit(scene)
    assert run_cost(scene, limit).evaluations == 4 * 1000
    pefrl = replace(scene, integrator="pefrl")
    assert run_cost(pefrl, step_limit(pefrl)).evaluations == 4 * 1000 * PEFRL_DAMPED
    still = replace(lattice(3), integrator="pefrl")
    assert run_cost(still, step_limit(still)).evaluations == 4 * 1000
    tight = replace(scene, integrator="rk45", tolerance=1e-11)
    loose = replace(tight, tolerance=1e-6)
    ratio = [run_cost(s, step_limit(s)).evaluations for s in (tight, loose)]
    assert ratio[0] / ratio[1] == pytest.approx(10.0, rel=1e-2)


def test_the_size_of_the_file_is_foreseen(folder):
    plan = plan_experiment(folder)
    result = Engine(BarHingeModel).run(folder)
    stored = 0

    def count(_, node):
        nonlocal stored
        if isinstance(node, h5py.Dataset) and len(node.shape) and node.shape[0] == 101:
            stored += node.size * node.dtype.itemsize

    with h5py.File(result.path) as file:
        file.visititems(count)
    assert plan.cost.file_size == pytest.approx(stored, rel=0.1)


def test_the_command_line_plans_without_running(folder, command):
    code, out, _ = command("run", folder, "--plan")
    assert code == 0
    assert "stability limit" in out
    assert make_plan(load_experiment(folder)).set_by in out
    assert not (folder / "output").exists()
    data = json.loads(command("run", folder, "--plan", "--json")[1])
    assert data["runs"] is True
    assert data["cost"]["evaluations"] == 4000


def test_producers_without_plans_say_so(folder):
    with pytest.raises(UnsupportedScene, match="makes no plans"):
        plan_experiment(folder, producer="strange", registry=_Strange())


class _Strange:
    """A registry of one producer that only runs."""

    def producer(self, name):
        return name

    def load(self, item, *, capability):
        return object()


# --- steps that are chosen -----------------------------------------------------------------------


def pendulum(folder, **settings):
    setup = SimulationSetup(folder, overwrite=True)
    pivot = setup.add_node([0, 0, 0], fixed=True)
    bob = setup.add_node([1, 0, 0], mass=0.1)
    setup.add_bar(pivot, bob, stiffness=1e3, damping=0.0)
    setup.set_physics(gravity=-9.81)
    setup.set_simulation_params(**{"duration": 1.0, "dt": "auto", "save_interval": 0.05} | settings)
    return setup


@pytest.mark.parametrize("scheme", ["rk4", "verlet", "pefrl"])
def test_the_chosen_step_is_the_largest_recommended_one(tmp_path, scheme):
    experiment = pendulum(tmp_path, integrator=scheme).experiment()
    limit = step_limit(experiment)
    n_steps = experiment.steps_per_frame
    assert experiment.dt == 0.05 / n_steps
    assert experiment.dt <= limit.recommended < 0.05 / (n_steps - 1)
    (note,) = experiment.notes
    assert f"was chosen, {n_steps} steps a frame: bar 0 between nodes 0 and 1 sets" in note


def test_the_chosen_step_is_saved_as_a_number(tmp_path):
    setup = pendulum(tmp_path)
    setup.save()
    written = json.loads((tmp_path / "input" / "config.json").read_text())
    assert written["simulation"]["dt"] == setup.experiment().dt
    assert Engine(BarHingeModel).run(tmp_path).n_frames == 21


def test_without_anything_stiff_a_frame_is_one_step(tmp_path):
    setup = SimulationSetup(tmp_path, overwrite=True)
    setup.add_node([0, 0, 0])
    setup.set_simulation_params(duration=1.0, dt="auto", save_interval=0.5)
    experiment = setup.experiment()
    assert experiment.dt == 0.5
    assert "nothing bounds it" in experiment.notes[0]


def test_schemes_that_choose_their_steps_get_a_first_one(tmp_path):
    experiment = pendulum(tmp_path, integrator="dop853").experiment()
    assert experiment.dt <= 1 / step_limit(experiment).omega
    assert "dop853 chooses its steps itself; this is the first" in experiment.notes[0]


def test_a_step_cannot_be_chosen_for_what_is_wrong(tmp_path):
    with pytest.raises(ConfigError, match="dt = 'fast'"):
        pendulum(tmp_path, dt="fast")
    with pytest.raises(ConfigError, match="save_interval"):
        pendulum(tmp_path, save_interval=-1.0).experiment()
    with pytest.raises(ConfigError, match="the integrator 'magic'"):
        pendulum(tmp_path, integrator="magic").experiment()


def test_a_finished_plan_says_when_a_step_was_forced(tmp_path, lattice):
    save_experiment(lattice(3, dt=0.01, step_check="warn"), tmp_path)
    plan = plan_experiment(tmp_path)
    assert plan.runs
    assert any("expect divergence" in remark for remark in plan.remarks)


def test_a_step_cannot_be_chosen_for_old_runs(tmp_path):
    setup = SimulationSetup(tmp_path)
    setup.add_bar(setup.add_node([0, 0, 0], fixed=True), setup.add_node([1, 0, 0]), stiffness=1.0)
    setup.set_simulation_params(duration=1.0, dt="auto", save_interval=0.1, integrator="legacy")
    with pytest.raises(ConfigError, match="dt='auto' with the integrator 'legacy'"):
        setup.experiment()
