"""Making bodies with bends, what refuses them, and what a run of one leaves in its file."""

from dataclasses import replace

import numpy as np
import pytest
from slender_bodies import AREA, MODULUS, RIGIDITY, cantilever, crooked_chain, experiment

from openprc.demlat import (
    BarHingeModel,
    Engine,
    Sensors,
    SimulationSetup,
    SteppedExperiment,
    meshing,
    run_ensemble,
)
from openprc.demlat.backends.choose import refusals
from openprc.demlat.geometry_builder import GeometryBuilder
from openprc.demlat.planning.run_cost import run_cost
from openprc.demlat.planning.stability import step_limit
from openprc.demlat.scaling import SimulationScaler
from openprc.errors import ConfigError
from openprc.reservoir import StateLoader
from openprc.reservoir.features.element_features import ElementSeries
from openprc.schema import Trajectory, validate_file
from openprc.schema.experiment import Actuator, Signal, save_experiment
from openprc.schema.geometry import Bends, Geometry

# --- building -----------------------------------------------------------------------------------


@pytest.fixture
def corner():
    build = GeometryBuilder()
    build.add_nodes([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0], [2.0, 0.0]])
    return build


def test_bends_rest_at_the_angle_of_their_nodes_unless_told(corner):
    assert corner.add_bend([0, 1, 2], stiffness=2.0, damping=0.1) == 0
    assert corner.add_bend([0, 1, 3], stiffness=1.0) == 1
    assert corner.add_bend([0, 1, 2], stiffness=3.0, rest_angle=2.0) == 2
    bends = corner.geometry().bends
    np.testing.assert_allclose(bends.rest_angle, [np.pi / 2.0, np.pi, 2.0], rtol=1e-15)
    assert bends.stiffness.tolist() == [2.0, 1.0, 3.0]
    assert bends.damping.tolist() == [0.1, 0.0, 0.0]


def test_straight_is_straight_whatever_rounding_says():
    build = GeometryBuilder()
    build.add_nodes(np.arange(3)[:, None] * np.array([0.1, 0.3, -0.7]) / 3.0)
    build.add_bend([0, 1, 2], stiffness=1.0)
    assert build.geometry().bends.rest_angle[0] == np.pi


def test_a_bend_has_three_known_nodes(corner):
    with pytest.raises(ConfigError, match="a bend with 4 nodes"):
        corner.add_bend([0, 1, 2, 3], stiffness=1.0)
    with pytest.raises(ConfigError, match="node 7"):
        corner.add_bend([0, 1, 7], stiffness=1.0)


def test_a_geometry_is_taken_up_with_its_bends(corner):
    corner.take_geometry(cantilever(4))
    corner.add_bend([0, 2, 4], stiffness=9.0)
    bends = corner.geometry().bends
    assert bends.indices.tolist() == [[0, 1, 2], [1, 2, 3], [2, 3, 4], [0, 2, 4]]


def test_the_mesh_of_a_rod_is_the_cantilever():
    mesh = meshing.chain(5, link_length=0.2, bends=True)
    rod = meshing.rod_constants(mesh, radius=0.02, young_modulus=MODULUS, density=1000.0)
    build = GeometryBuilder()
    mesh.to_setup(build, **rod, fixed=[0, 1], bend_damping=0.0)
    found, expected = build.geometry(), cantilever(5)
    np.testing.assert_allclose(found.positions, expected.positions, atol=1e-15)
    np.testing.assert_allclose(found.masses, expected.masses, rtol=1e-14)
    np.testing.assert_array_equal(found.fixed, expected.fixed)
    np.testing.assert_allclose(found.bars.stiffness, MODULUS * AREA / 0.2, rtol=1e-14)
    np.testing.assert_array_equal(found.bends.indices, expected.bends.indices)
    np.testing.assert_allclose(found.bends.stiffness, RIGIDITY / 0.2, rtol=1e-14)


@pytest.mark.parametrize("name", ["radius", "young_modulus", "density"])
def test_constants_of_rods_are_positive(name):
    mesh = meshing.chain(5, link_length=0.2, bends=True)
    given = {"radius": 0.1, "young_modulus": 1.0, "density": 1.0} | {name: 0.0}
    with pytest.raises(ConfigError, match=r"found 0\.0") as caught:
        meshing.rod_constants(mesh, **given)
    assert caught.value.key == name


def test_bends_of_a_mesh_need_a_stiffness():
    mesh = meshing.chain(5, link_length=0.2, bends=True)
    with pytest.raises(ConfigError, match="4 bends without stiffness"):
        mesh.to_setup(GeometryBuilder(), mass=1.0, stiffness=1.0)
    with pytest.raises(ConfigError, match=r"shape \(3,\)"):
        mesh.to_setup(GeometryBuilder(), mass=1.0, stiffness=1.0, bend_stiffness=[1.0] * 3)
    assert len(meshing.chain(5, link_length=0.2).bends) == 0


def test_bends_of_a_mesh_are_sorted_and_checked():
    points = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]]
    pairs, kinds = [[0, 1], [1, 2], [2, 3]], ["link"] * 3
    mesh = meshing.Mesh(positions=points, bars=pairs, bar_kinds=kinds, bends=[[3, 2, 1], [2, 1, 0]])
    assert mesh.bends.tolist() == [[0, 1, 2], [1, 2, 3]]
    with pytest.raises(ConfigError, match="node 5") as caught:
        meshing.Mesh(positions=points, bars=pairs, bar_kinds=kinds, bends=[[0, 1, 5]])
    assert caught.value.key == "mesh/bends"


# --- units --------------------------------------------------------------------------------------


def test_bends_set_the_unit_of_time_where_nothing_else_is_stiff():
    body = Geometry(
        positions=[[0, 0, 0], [1, 0, 0], [2, 1, 0]],
        masses=np.ones(3),
        bends=Bends(indices=[[0, 1, 2]], stiffness=[2.0**20]),
    )
    assert SimulationScaler.for_experiment(experiment(body)).time == pytest.approx(2.0**-9)


# --- refusals -----------------------------------------------------------------------------------


def test_other_back_ends_refuse_bends():
    for name in ("cuda", "jax"):
        found = refusals(experiment(cantilever(4)), name)
        assert [finding.code for finding in found] == [f"DEM-{name.upper()}-BENDS"]
        assert found[0].found == "3 bends"
        assert found[0].path == "elements/bends"


def test_the_old_stepping_refuses_bends():
    found = BarHingeModel.supports(experiment(cantilever(4), integrator="legacy", dt=1e-5))
    assert [finding.found for finding in found] == ["a bend with the integrator 'legacy'"]


def test_ensembles_have_the_same_bends():
    one = experiment(crooked_chain(5))
    bends = one.geometry.bends
    other = replace(
        one, geometry=replace(one.geometry, bends=replace(bends, indices=bends.indices[:, ::-1]))
    )
    with pytest.raises(ConfigError, match=r"scene 1 has other bends \(indices\) than scene 0"):
        run_ensemble([one, other])


# --- files and sensors ----------------------------------------------------------------------------


def test_a_run_leaves_angles_torques_and_energies(tmp_path):
    scene = experiment(crooked_chain(5, damping=0.4, fixed=(0,)), gravity=(0, 0, -1.0))
    save_experiment(scene, tmp_path)
    result = Engine(BarHingeModel, backend="cpu").run(tmp_path)
    assert validate_file(result.path).ok
    bends = scene.geometry.bends
    with Trajectory(result.path) as run:
        np.testing.assert_array_equal(run.indices("bends"), bends.indices)
        for name in ("stiffness", "rest_angle", "damping"):
            stored = run.element_static("bends", name)
            np.testing.assert_array_equal(stored, getattr(bends, name))
        angle, torque = run.element("bends", "angle"), run.element("bends", "torque")
        assert run.unit("/time_series/elements/bends/torque") == "N*m"
        energy, lost = run.system("elastic_energy_bends"), run.system("dissipated_bends")
        parts = ("bars", "hinges", "bends")
        stored = sum(run.system(f"elastic_energy_{part}") for part in parts)
        whole = run.system("potential_energy") - run.system("gravity_energy")
        total, dissipated = run.system("total_energy"), run.system("dissipated")
    difference = angle - bends.rest_angle
    np.testing.assert_allclose(
        energy, 0.5 * (bends.stiffness * difference**2).sum(axis=1), rtol=1e-12
    )
    # What the dashpots add to the springs' torque is what opposes the motion.
    assert ((torque - bends.stiffness * difference) != 0.0).any()
    np.testing.assert_allclose(whole, stored, rtol=1e-12)
    assert (np.diff(lost) > 0.0).all()
    np.testing.assert_allclose(total + dissipated, total[0], rtol=0, atol=1e-6)


def test_elements_can_be_left_out_of_the_file(tmp_path):
    scene = experiment(crooked_chain(5), stored=replace(experiment(crooked_chain(3)).stored,
                                                        elements=False))  # fmt: skip
    save_experiment(scene, tmp_path)
    result = Engine(BarHingeModel, backend="cpu").run(tmp_path)
    with Trajectory(result.path) as run:
        assert run.element_series("bends") == ()
        assert (run.system("elastic_energy_bends") > 0.0).any()


def test_idle_bends_show_what_they_always_do(simulate):
    """In scenes that are stepped as vectors, elements between fixed nodes are left out."""
    chain = crooked_chain(70, damping=0.3, fixed=(0, 1, 2, 3))
    run = simulate(experiment(chain, duration=0.1))
    idle = chain.bends
    change = run.bend_angle[:, :2] - idle.rest_angle[:2]
    np.testing.assert_allclose(run.bend_moment[:, :2], idle.stiffness[:2] * change, rtol=1e-12)
    assert np.ptp(run.bend_angle[:, :2], axis=0).max() == 0.0
    assert run.bend_angle[0, 0] == pytest.approx(np.pi, abs=np.pi)
    change = run.bend_angle - idle.rest_angle
    np.testing.assert_allclose(
        run.energy[:, 4], 0.5 * (idle.stiffness * change**2).sum(axis=1), rtol=1e-12
    )


def test_a_scene_of_idle_bends_only(simulate):
    chain = crooked_chain(70, fixed=range(70))
    run = simulate(experiment(replace(chain, fixed=np.arange(70) < 69), duration=0.1))
    assert run.ledger.shape[1] == 6
    still = simulate(experiment(chain, duration=0.1))
    change = still.bend_angle[-1] - chain.bends.rest_angle
    energy = 0.5 * (chain.bends.stiffness * change**2).sum()
    assert still.energy[-1, 4] == pytest.approx(energy, rel=1e-12)


def test_sensors_read_what_features_read(tmp_path):
    geometry = crooked_chain(5, damping=0.4, fixed=(0,))
    push = Signal(name="push", values=np.array([0.3, -0.2, 0.1]), dt=0.1, interpolation="hold")
    scene = experiment(
        geometry,
        signals={"push": push},
        actuators=(Actuator(node=4, signal="push", type="force", axes=(0, 0, 1)),),
        duration=0.3,
    )
    save_experiment(scene, tmp_path)
    result = Engine(BarHingeModel, backend="cpu").run(tmp_path)
    feature = ElementSeries("bends", "angle", element_ids=[0, 2])
    loader = StateLoader(result.path)
    sensors = Sensors("bend_angles", ids=[0, 2])
    body = SteppedExperiment(scene, hold=0.1, sensors=[sensors])
    assert body.names == tuple(feature.names(loader))
    states = body.run(push.values[:, 0])
    np.testing.assert_allclose(states, feature.transform(loader)[1:], rtol=0, atol=1e-12)
    with pytest.raises(ConfigError, match="bend 3 of 3"):
        SteppedExperiment(scene, hold=0.1, sensors=[Sensors("bend_angles", ids=[3])])


def test_a_body_of_bends_alone_says_which_one_blew_up(simulate):
    body = Geometry(
        positions=[[0, 0, 0], [1, 0, 0], [2, 1, 0]],
        masses=np.ones(3),
        bends=Bends(indices=[[0, 1, 2]], stiffness=[1e8]),
    )
    scene = experiment(body, step_check="warn", dt=0.1)
    with pytest.raises(Exception, match=r"it belongs to bend 0 \[0, 1, 2\], not to a bar"):
        simulate(scene)


def test_the_cost_of_a_run_counts_bends():
    with_bends = experiment(cantilever(20))
    without = replace(with_bends, geometry=replace(with_bends.geometry, bends=Bends()))
    costs = [run_cost(scene, step_limit(scene)) for scene in (without, with_bends)]
    assert costs[1].seconds > costs[0].seconds
    assert costs[1].file_size - costs[0].file_size == 8 * 11 * (2 * 19 + 2)


def test_setups_take_bends(tmp_path):
    setup = SimulationSetup(tmp_path / "corner", overwrite=True)
    nodes = setup.add_nodes([[0, 0, 0], [1, 0, 0], [1, 1, 0]], mass=0.1)
    setup.add_bend(nodes, stiffness=2.0)
    setup.set_simulation_params(duration=1.0, dt="auto", save_interval=0.1)
    assert setup.experiment().dt == pytest.approx(0.1 / np.ceil(0.1 / setup.experiment().dt))
    assert len(setup.experiment().geometry.bends) == 1
