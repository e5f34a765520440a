"""What contact refuses and remarks on, and whether its lists leave anyone out."""

from dataclasses import replace

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from openprc.demlat import BarHingeModel, run_ensemble
from openprc.demlat.contact import findings, hook, search
from openprc.demlat.contact.findings import (
    distance_to_triangle,
    overlapping_facings,
    overlapping_pairs,
)
from openprc.demlat.contact.table import FACINGS, PAIRS, contact_tables, enlarged
from openprc.demlat.integrators.respa import RESPA
from openprc.demlat.integrators.rk4 import RK4
from openprc.demlat.integrators.verlet import Verlet
from openprc.errors import UnsupportedScene
from openprc.schema.experiment import Collision, Experiment
from openprc.schema.geometry import Bars, Geometry


@pytest.fixture
def pair():
    bars = Bars(indices=[[0, 2], [1, 2]], stiffness=[10.0, 10.0], rest_length=[1.0, 0.8])
    geometry = Geometry(
        positions=[[0, 0, 0], [1.0, 0, 0], [0.5, 0.9, 0]],
        masses=[1.0, 1.0, 1.0],
        collidable=[True, True, False],
        bars=bars,
    )
    return Experiment(
        geometry=geometry,
        duration=0.1,
        dt=0.01,
        save_interval=0.1,
        collision=Collision(enabled=True, radius=0.1),
    )


def only_finding(experiment):
    (finding,) = BarHingeModel.supports(experiment)
    return finding


def test_a_radius_without_bars_is_asked_for(pair):
    geometry = replace(pair.geometry, bars=Bars())
    finding = only_finding(replace(pair, geometry=geometry, collision=Collision(enabled=True)))
    assert finding.code == "DEM-COLLISION-RADIUS"
    assert finding.found == "contact without a radius, and no bar to derive one from"
    assert finding.fix == "set collision_radius"


def test_the_radius_is_a_quarter_of_the_shortest_bar(pair):
    remarks = list(BarHingeModel(replace(pair, collision=Collision(enabled=True))).remarks())
    assert any(
        "collision_radius is not given: nodes have the radius 0.2 m, a quarter of the shortest bar"
        in remark
        for remark in remarks
    )


def test_integrators_that_choose_their_step_are_refused(pair, monkeypatch):
    adaptive = replace(findings.INTEGRATORS["rk4"], name="free", step="adaptive")
    known = dict(findings.INTEGRATORS) | {"free": adaptive}
    monkeypatch.setattr(findings, "INTEGRATORS", known)
    (finding,) = findings.contact_refusals(replace(pair, integrator="free"))
    assert finding.code == "DEM-COLLISION-INTEGRATOR"
    assert finding.found == "contact with the integrator 'free', which chooses its step"
    assert "an integrator with a fixed step, after which contacts act: rk4" in finding.expected


def test_rigid_elements_are_refused(pair):
    bars = replace(pair.geometry.bars, rigid=[True, False])
    rigid = replace(pair, geometry=replace(pair.geometry, bars=bars))
    finding = next(f for f in BarHingeModel.supports(rigid) if "COLLISION" in f.code)
    assert finding.code == "DEM-COLLISION-RIGID"
    assert finding.found == "contact of a body with rigid bars or hinges"
    assert "an impact does not spread through constraints" in finding.expected


def test_single_precision_is_refused(pair):
    finding = only_finding(replace(pair, precision="float32"))
    assert finding.code == "DEM-COLLISION-PRECISION"
    assert finding.found == "contact in float32"
    assert "gaps are small differences of coordinates" in finding.expected


def test_faces_without_area_are_refused(pair):
    positions = [[0, 0, 0], [1.0, 0, 0], [0.5, 0, 0]]
    geometry = replace(pair.geometry, positions=positions, faces=[[0, 1, 2]])
    collision = replace(pair.collision, faces=True)
    finding = only_finding(replace(pair, geometry=geometry, collision=collision))
    assert finding.code == "DEM-COLLISION-FACE"
    assert finding.found == "face 0 [0, 1, 2] has no area"
    assert not BarHingeModel.supports(replace(pair, geometry=geometry))


def test_ensembles_with_contact_are_refused(pair):
    with pytest.raises(UnsupportedScene, match="scene 0 has contact"):
        run_ensemble([pair, pair])


def test_what_cannot_collide_is_remarked_on(pair):
    alone = replace(pair.geometry, collidable=[True, False, False])
    remarks = list(BarHingeModel(replace(pair, geometry=alone)).remarks())
    assert any(remark.endswith("nothing can collide") for remark in remarks)
    faceless = replace(pair, collision=replace(pair.collision, faces=True))
    assert any(
        "collision_faces is on and the geometry has no faces: only nodes collide" in remark
        for remark in BarHingeModel(faceless).remarks()
    )


def test_nodes_in_faces_at_the_start_are_remarked_on(pair):
    geometry = Geometry(
        positions=[[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, 0.05]],
        masses=[1.0] * 4,
        collidable=[False, False, False, True],
        faces=[[0, 1, 2]],
    )
    collision = replace(pair.collision, faces=True)
    model = BarHingeModel(replace(pair, geometry=geometry, collision=collision))
    assert any(
        "1 collidable nodes are closer to faces than their radius (0.1 m) at t = 0, such as node 3"
        " and face 0: they keep that distance until they have moved apart" in remark
        for remark in model.remarks()
    )


# --- neighbours -----------------------------------------------------------------------------


@numba.njit(error_model="numpy", _nrt=False)
def make_lists(lists, stride, x, reach):
    search.list_pairs(lists, stride, x, reach)
    search.list_facings(lists, stride, x, reach)


def listed(experiment, reach):
    """Return pairs and facings with a gap below `reach`, from the cells."""
    positions = experiment.geometry.positions
    flat = np.ascontiguousarray(positions.T).reshape(-1)
    inverse = np.where(experiment.geometry.fixed, 0.0, 1.0)
    (table,) = contact_tables(
        experiment, inverse_mass=np.tile(inverse, 3), stride=len(positions), unit=1.0
    )
    while True:
        lists = table.lists
        make_lists(lists, len(positions), flat, reach)
        n_pairs, n_facings = lists.status[PAIRS], lists.status[FACINGS]
        if n_pairs <= len(lists.pair) and n_facings <= len(lists.facing):
            return lists.pair[:n_pairs], lists.facing[:n_facings]
        table = enlarged(table)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(4, 120),
    spread=st.sampled_from([0.02, 0.4, 3.0, 1e6]),
    flat=st.booleans(),
)
def test_cells_find_what_looking_at_everyone_finds(seed, n, spread, flat):
    rng = np.random.default_rng(seed)
    positions = spread * rng.uniform(-1, 1, (n, 3)) * [1, 1, 0 if flat else 1]
    positions[n // 2] = positions[0]  # coincident
    faces = np.array([rng.choice(n, 3, replace=False) for _ in range(n // 3)])
    a, b, c = positions[faces].transpose(1, 0, 2)
    edges = np.linalg.norm([a - b, b - c, c - a], axis=2).max(axis=0)
    faces = faces[np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-6 * edges**2]
    bars = rng.integers(0, n, (n, 2))
    bars = bars[bars[:, 0] != bars[:, 1]]
    geometry = Geometry(
        positions=positions,
        masses=np.ones(n),
        fixed=rng.random(n) < 0.3,
        collidable=rng.random(n) < 0.8,
        bars=Bars(indices=bars, stiffness=np.ones(len(bars)), rest_length=np.ones(len(bars))),
        faces=faces,
    )
    if geometry.collidable.sum() < 2:
        return
    radius, reach = 0.05, 0.03
    experiment = Experiment(
        geometry=geometry,
        duration=1.0,
        dt=1.0,
        save_interval=1.0,
        collision=Collision(enabled=True, radius=radius, faces=True),
    )
    pairs, facings = listed(experiment, reach)
    i, j = np.triu_indices(n, 1)
    near = np.linalg.norm(positions[i] - positions[j], axis=1) < 2 * radius + reach
    touchable = geometry.collidable[i] & geometry.collidable[j]
    touchable &= ~(geometry.fixed[i] & geometry.fixed[j])
    bonds = {tuple(sorted(bar)) for bar in bars.tolist()}
    free = np.array([(a, b) not in bonds for a, b in zip(i.tolist(), j.tolist(), strict=True)])
    expected = np.stack([i, j], axis=1)[near & touchable & free]
    np.testing.assert_array_equal(pairs, expected)  # sorted as well
    node, face = (index.reshape(-1) for index in np.indices((n, len(faces))))
    gap = distance_to_triangle(positions[node], positions[faces[face]])
    close = (gap < radius + reach) & geometry.collidable[node]
    close &= (faces[face] != node[:, None]).all(axis=1)
    close &= ~(geometry.fixed[node] & geometry.fixed[faces[face]].all(axis=1))
    expected = set(zip(node[close].tolist(), face[close].tolist(), strict=True))
    assert set(map(tuple, facings.tolist())) == expected
    assert len(facings) == len(expected)
    # What is reported before the run comes from another search still.
    np.testing.assert_array_equal(overlapping_pairs(experiment, radius + reach / 2), pairs)
    found = overlapping_facings(experiment, radius + reach)
    assert set(map(tuple, found.tolist())) == expected


def test_schemes_that_carry_forces_over_are_told_of_contacts():
    @numba.njit(error_model="numpy", _nrt=False)
    def tell(scheme):
        hook.forget_forces(scheme)

    clock = np.array([1.0, 2.0])
    arrays = (np.zeros(3), np.zeros(3), None, clock)
    tell(Verlet(*arrays))
    assert np.isnan(clock[0])
    clock[0] = 1.0
    tell(RESPA(2, False, Verlet(*arrays), np.zeros(3), np.zeros(3), None))
    assert np.isnan(clock[0])
    tell(RK4(*[np.zeros(3)] * 5, None))
