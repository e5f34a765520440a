"""Contact of nodes with each other and with faces, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from contact_scenes import GRAVITY, contact_scene

from openprc.demlat import BarHingeModel
from openprc.schema.experiment import Collision
from openprc.schema.geometry import Bars, Hinges


@pytest.fixture(scope="module")
def scene():
    return contact_scene


# --- nodes ----------------------------------------------------------------------------------


@pytest.mark.parametrize("restitution", [1.0, 0.6, 0.0])
def test_head_on_collision_of_unequal_masses(scene, simulate, restitution):
    m, u = np.array([1.0, 3.0]), np.array([2.0, -0.5])
    run = simulate(
        scene(
            [[0, 0, 0], [1.0, 0, 0]],
            [[u[0], 0, 0], [u[1], 0, 0]],
            masses=m,
            collision={"restitution": restitution},
        )
    )
    mean = (m @ u) / m.sum()
    after = mean - restitution * m[::-1] / m.sum() * (u - u[::-1])
    when = (1.0 - 0.2) / (u[0] - u[1])
    np.testing.assert_allclose(run.v[-1, :, 0], after, rtol=1e-13, atol=1e-14)
    expected = np.array([0.0, 1.0]) + u * when + after * (1.0 - when)
    np.testing.assert_allclose(run.x[-1, :, 0], expected, rtol=1e-12)
    lost = 0.5 * m.prod() / m.sum() * (1 - restitution**2) * (u[0] - u[1]) ** 2
    assert run.ledger[-1, 4] == pytest.approx(lost, rel=1e-12, abs=1e-13)
    assert np.abs(run.balance).max() < 1e-13


def test_oblique_collision_conserves_momentum_angular_momentum_and_energy(scene, simulate):
    m = np.array([1.0, 2.0])
    run = simulate(scene([[0, 0, 0], [1, 0.12, 0.05]], [[3, 0.1, 0], [0, 0, 0.1]], masses=m))
    momentum = np.einsum("n,tna->ta", m, run.v)
    angular = np.einsum("n,tna->ta", m, np.cross(run.x, run.v))
    assert np.abs(momentum - momentum[0]).max() < 1e-13
    assert np.abs(angular - angular[0]).max() < 1e-13
    assert np.abs(run.kinetic - run.kinetic[0]).max() < 1e-13
    # The impulse is along the line of centres at contact, wherever in a step that is.
    gap = run.x[0, 1] - run.x[0, 0]
    speed = run.v[0, 1] - run.v[0, 0]
    a, b, c = speed @ speed, gap @ speed, gap @ gap - 0.04
    line = gap + speed * (-b - np.sqrt(b * b - a * c)) / a
    change = run.v[-1, 0] - run.v[0, 0]
    assert np.linalg.norm(np.cross(change, line)) < 1e-11 * np.linalg.norm(change)


def test_nodes_that_pass_each_other_within_a_step_collide(scene, simulate):
    run = simulate(
        scene([[0, 0, 0], [1, 0, 0]], [[900.0, 0, 0], [0, 0, 0]], duration=0.01, dt=1e-3)
    )
    np.testing.assert_allclose(run.v[-1, :, 0], [0.0, 900.0], atol=1e-9)


@pytest.mark.parametrize("direction", [1, -1])
def test_newtons_cradle_lets_the_last_ball_leave(scene, simulate, direction):
    x = [0.0, *(0.5 + 0.2 * np.arange(9))]
    v = [1.0] + [0.0] * 9
    if direction < 0:
        x, v = x[::-1], v[::-1]
    run = simulate(scene([[at, 0, 0] for at in x], [[at, 0, 0] for at in v]))
    np.testing.assert_allclose(run.v[-1, :, 0], v[::-1], atol=1e-12)


def test_bonded_nodes_do_not_touch_each_other(scene, simulate):
    touching = scene(
        [[0, 0, 0], [0.15, 0, 0]], [[1, 0, 0], [-1, 0, 0]], bars=[(0, 1)], stiffness=1e3
    )
    alone = replace(touching, collision=Collision())
    np.testing.assert_array_equal(simulate(touching).x, simulate(alone).x)
    assert not [r for r in BarHingeModel(touching).remarks() if "closer" in r]


def test_nodes_that_overlap_at_the_start_may_part_but_not_come_closer(scene, simulate):
    still = scene([[0, 0, 0], [0.15, 0, 0]], [[0, 0, 0], [0, 0, 0]])
    run = simulate(still)
    assert np.abs(run.v).max() == 0.0
    np.testing.assert_array_equal(run.x[-1], run.x[0])
    closing = scene([[0, 0, 0], [0.15, 0, 0]], [[0.5, 0, 0], [-0.5, 0, 0]])
    run = simulate(closing)
    assert np.linalg.norm(run.x[:, 0] - run.x[:, 1], axis=1).min() >= 0.15 - 1e-12
    np.testing.assert_allclose(run.v[-1, :, 0], [-0.5, 0.5], rtol=1e-12)
    remarks = list(BarHingeModel(closing).remarks())
    assert any(
        "1 pairs of collidable nodes are closer than two radii (0.2 m) at t = 0, such as 0 and 1"
        " (0.15 m): they keep that distance until they have moved apart" in r
        for r in remarks
    )


def test_overlap_counts_as_apart_once_it_has_been_left(scene, simulate):
    # A free node leaves a fixed one upwards, and falls back.
    run = simulate(
        scene(
            [[0, 0, 0], [0, 0, 0.15]],
            [[0, 0, 0], [0, 0, 2.0]],
            fixed=[True, False],
            gravity=GRAVITY,
        )
    )
    assert run.x[5:, 1, 2].min() > 0.2 - 1e-9


# --- faces ----------------------------------------------------------------------------------


@pytest.mark.parametrize("restitution", [1.0, 0.7])
def test_bouncing_ball_reaches_the_heights_and_times_of_the_closed_form(
    scene, simulate, restitution
):
    h = 0.8
    run = simulate(
        scene(
            [[0.1, 0.2, 0.1 + h]],
            [[0.3, 0, 0]],
            masses=[2.0],
            floor=True,
            gravity=GRAVITY,
            duration=2.0,
            collision={"restitution": restitution},
        )
    )
    first = np.sqrt(2 * h / GRAVITY)
    flight = 2 * first * restitution ** np.arange(1, 12)
    starts = first + np.concatenate([[0], np.cumsum(flight)])
    for t, z in zip(run.t, run.x[:, 3, 2], strict=True):
        if t < first:
            expected = h - 0.5 * GRAVITY * t * t
        else:
            n = np.searchsorted(starts, t, side="right") - 1
            s = t - starts[n]
            expected = restitution ** (n + 1) * GRAVITY * first * s - 0.5 * GRAVITY * s * s
        assert z - 0.1 == pytest.approx(expected, abs=1e-10)
    np.testing.assert_allclose(run.x[:, 3, 0], 0.1 + 0.3 * run.t, rtol=1e-12)
    assert np.abs(run.balance).max() < 1e-11


def test_bounces_are_of_second_order_where_forces_vary(scene, simulate):
    # An oscillator about the wall: half a period between bounces, whatever the amplitude.
    k = 40.0
    base = scene(
        [[0, 0, 0.1], [0, 0, 0.1 + 0.3], [0, 0, -0.9]],
        [[0, 0, 0], [0, 0, 0], [0, 0, 0]],
        floor=True,
        fixed=[True, False, True],
        collidable=[False, True, False],
        bars=[(4, 5)],
        stiffness=k,
        duration=2.0,
        save_interval=0.1,
    )
    bars = Bars(indices=[[4, 5]], stiffness=[k], rest_length=[1.0])
    base = replace(base, geometry=replace(base.geometry, bars=bars))
    for count in (5, 10, 20, 40, 160):
        run = simulate(replace(base, dt=0.1 / count))
        expected = 0.1 + 0.3 * np.abs(np.cos(np.sqrt(k) * run.t))
        # How much of the second order there is depends on where in a step impacts fall.
        assert np.abs(run.x[:, 4, 2] - expected).max() < 0.2 / count**2
        assert np.abs(run.balance).max() < 3.0 / count**2


@pytest.mark.parametrize("friction", [0.05, 0.2, 5.0])
def test_oblique_bounce_with_friction(scene, simulate, friction):
    e, vx, vz = 0.8, 1.5, -2.0
    run = simulate(
        scene(
            [[0, 0, 1.1]],
            [[vx, 0, vz]],
            floor=True,
            collision={"restitution": e, "friction": friction},
        )
    )
    rubbed = min(friction * (1 + e) * abs(vz), vx)  # sliding, or sticking
    np.testing.assert_allclose(run.v[-1, 3], [vx - rubbed, 0, -e * vz], atol=1e-12)
    assert np.abs(run.balance).max() < 1e-12


@pytest.mark.parametrize("friction", [0.0, 0.3, 1.0])
def test_block_on_an_incline_of_two_faces(scene, simulate, friction):
    slope = 0.5
    tilted = GRAVITY * np.array([np.sin(slope), 0.0, -np.cos(slope)])
    experiment = scene(
        [[-4, -1, 0], [4, -1, 0], [4, 1, 0], [-4, 1, 0], [-0.5, 0.1, 0.1]],
        [[0, 0, 0]] * 5,
        fixed=[True] * 4 + [False],
        collidable=[False] * 4 + [True],
        faces=[[0, 1, 2], [0, 2, 3]],
        gravity=tuple(tilted),
        collision={"friction": friction, "restitution": 0.5},
    )
    run = simulate(experiment)
    rate = GRAVITY * max(np.sin(slope) - friction * np.cos(slope), 0.0)
    if friction == 1.0:
        assert rate == 0.0
    else:
        assert run.x[-1, 4, 0] > 0.5  # it has crossed the seam between the faces
    np.testing.assert_allclose(run.x[:, 4, 0], -0.5 + 0.5 * rate * run.t**2, atol=1e-9)
    np.testing.assert_allclose(run.x[:, 4, 1], 0.1, atol=1e-12)
    np.testing.assert_allclose(run.x[:, 4, 2], 0.1, atol=1e-9)
    rubbed = friction * GRAVITY * np.cos(slope) * (run.x[-1, 4, 0] + 0.5)
    assert run.ledger[-1, 4] == pytest.approx(rubbed, abs=1e-9)
    assert np.abs(run.balance).max() < 1e-9


@pytest.mark.parametrize("restitution", [1.0, 0.0])
def test_a_resting_node_stays_where_it_is(scene, simulate, restitution):
    run = simulate(
        scene(
            [[0.3, 0.1, 0.1], [0.3, 0.1, 0.3]],
            [[0, 0, 0]] * 2,
            floor=True,
            gravity=GRAVITY,
            duration=10.0,
            save_interval=0.1,
            collision={"restitution": restitution},
        )
    )
    assert np.abs(run.x[:, 3:] - run.x[0, 3:]).max() < 1e-10
    assert np.abs(run.v).max() < 1e-9
    assert np.abs(run.ledger).max() < 1e-9


def test_free_face_takes_the_momentum_of_what_hits_it(scene, simulate):
    m = np.array([1.0, 2.0, 0.5, 0.7])
    run = simulate(
        scene(
            [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.3, 0.5]],
            [[0, 0, 0]] * 3 + [[0.1, 0, -2.0]],
            masses=m,
            faces=[[0, 1, 2]],
            collidable=[False, False, False, True],
        )
    )
    momentum = np.einsum("n,tna->ta", m, run.v)
    angular = np.einsum("n,tna->ta", m, np.cross(run.x, run.v))
    assert run.v[-1, 0, 2] < -0.1
    assert np.abs(momentum - momentum[0]).max() < 1e-13
    assert np.abs(angular - angular[0]).max() < 1e-13
    assert np.abs(run.kinetic - run.kinetic[0]).max() < 1e-12


def test_fast_node_does_not_pass_a_face(scene, simulate):
    run = simulate(scene([[0, 0, 0.5]], [[0, 0, -700.0]], floor=True, duration=0.01, dt=1e-3))
    assert run.x[:, 3, 2].min() >= 0.1 - 1e-9
    assert run.v[-1, 3, 2] == pytest.approx(700.0)


def test_faces_have_two_sides_and_an_edge(scene, simulate):
    from_below = simulate(scene([[0, 0, -0.5]], [[0, 0, 2.0]], floor=True))
    assert from_below.v[-1, 3, 2] == pytest.approx(-2.0)
    edge_on = simulate(scene([[0, -6.0, 0]], [[0, 2.0, 0]], floor=True))
    assert edge_on.v[-1, 3, 1] == pytest.approx(-2.0)
    assert edge_on.x[:, 3, 1].max() <= -5.1 + 1e-9


def test_panels_that_fold_onto_each_other_do_not_pass(scene, simulate):
    # A triangle hinged to a fixed one, pressed shut and beyond by its spring.
    hinge = Hinges(indices=[[0, 1, 2, 3]], stiffness=[0.5], rest_angle=[0.01], damping=[0.01])
    experiment = scene(
        [[0, 0, 0], [1, 0, 0], [0.5, 0.9, 0], [0.5, -0.5, 0.5]],
        [[0, 0, 0]] * 4,
        masses=[0.1] * 4,
        fixed=[True, True, True, False],
        faces=[[0, 1, 2], [0, 3, 1]],
        bars=[(0, 3), (1, 3)],
        stiffness=500.0,
        hinges=hinge,
        radius=0.05,
        duration=4.0,
        collision={"restitution": 0.3},
        damping=0.1,
    )
    open_run = simulate(replace(experiment, collision=Collision()))
    assert open_run.x[:, 3, 2].min() < 0.0  # without contact it goes through
    run = simulate(experiment)
    assert run.x[:, 3, 2].min() > 0.05 - 1e-6
    assert run.x[-1, 3, 2] == pytest.approx(0.05, abs=1e-6)
    assert np.abs(run.balance).max() < 1e-3 * run.potential[0]


# --- held and driven ------------------------------------------------------------------------


def test_driven_obstacle_counts_as_infinitely_heavy_and_its_work_is_booked(scene, simulate, drive):
    experiment = scene(
        [[0, 0, 0], [1.0, 0, 0]],
        [[0, 0, 0], [-1, 0, 0]],
        masses=[0.001, 2.0],
        collision={"restitution": 0.5},
    )
    signal, actuator = drive([[0, 0, 0], [1.5, 0, 0]], dt=1.0, type="position")
    run = simulate(replace(experiment, signals={"u": signal}, actuators=(actuator,)))
    after = 1.5 + 0.5 * 2.5
    assert run.v[-1, 1, 0] == pytest.approx(after, rel=1e-12)
    np.testing.assert_allclose(run.x[:, 0, 0], 1.5 * run.t, atol=1e-14)
    impulse = 2.0 * (after + 1.0)
    assert run.work_in[-2] - run.work_in[0] == pytest.approx(1.5 * impulse, rel=1e-9)
    assert np.abs(run.balance).max() < 1e-12


def test_node_that_slides_on_a_rail_reacts_along_it_only(scene, simulate, drive):
    experiment = scene([[0, 0, 0], [1.0, 0.08, 0]], [[0, 0, 0], [-1, 0, 0]])
    signal, actuator = drive([0.0, 0.0], dt=1.0, type="position", axes=(0, 1, 1))
    run = simulate(replace(experiment, signals={"u": signal}, actuators=(actuator,)))
    assert np.abs(run.x[:, 0, 1:]).max() == 0.0
    assert run.v[-1, 0, 0] < -0.1
    assert run.v[:, :, 0].sum(axis=1) == pytest.approx(-1.0)
    assert np.abs(run.balance).max() < 1e-13


# --- many -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def gas(scene):
    rng = np.random.default_rng(3)
    grid = 0.3 * np.stack(np.meshgrid(*[np.arange(4.0)] * 3, indexing="ij"), -1).reshape(-1, 3)
    return scene(
        grid + 0.04 * rng.uniform(-1, 1, grid.shape),
        rng.uniform(-3, 3, grid.shape) - 2 * (grid - 0.45),
        masses=rng.uniform(0.5, 2.0, len(grid)),
        duration=0.5,
        collision={"friction": 0.0},
    )


def test_gas_conserves_momentum_and_energy(gas, simulate):
    run = simulate(gas)
    momentum = np.einsum("n,tna->ta", gas.geometry.masses, run.v)
    assert np.abs(momentum - momentum[0]).max() < 1e-11
    assert run.kinetic[-1] == pytest.approx(run.kinetic[0], rel=1e-3)
    assert np.abs(run.balance).max() < 1e-10
    apart = np.linalg.norm(run.x[:, :, None] - run.x[:, None], axis=-1)
    apart[:, np.arange(64), np.arange(64)] = np.inf
    assert apart.min() > 0.2 - 1e-6


@pytest.mark.parametrize("change", [{"SKIN": 0.05}, {"ROOM": (0, 0, 0), "LEAST_ROOM": 1}])
def test_lists_and_their_room_do_not_change_the_motion(gas, simulate, monkeypatch, change):
    expected = simulate(gas)
    for name, value in change.items():
        monkeypatch.setattr(f"openprc.demlat.contact.table.{name}", value)
    run = simulate(gas)
    np.testing.assert_array_equal(run.x, expected.x)
    np.testing.assert_array_equal(run.ledger, expected.ledger)


def test_lattice_that_is_hit(scene, simulate):
    # More than 64 elements: vectors of lanes.
    n = 6
    number = np.arange(n * n).reshape(n, n)
    grid = np.stack(np.meshgrid(0.1 * np.arange(n), 0.1 * np.arange(n), indexing="ij"), -1)
    pairs = [
        *zip(number[:-1].flat, number[1:].flat, strict=True),
        *zip(number[:, :-1].flat, number[:, 1:].flat, strict=True),
        *zip(number[:-1, :-1].flat, number[1:, 1:].flat, strict=True),
    ]
    positions = np.zeros((n * n + 1, 3))
    positions[:-1, :2] = grid.reshape(-1, 2)
    positions[-1] = [-0.3, 0.27, 0.0]
    velocities = np.zeros_like(positions)
    velocities[-1, 0] = 2.0
    experiment = scene(
        positions,
        velocities,
        masses=[0.01] * (n * n) + [0.05],
        bars=pairs,
        radius=0.02,
        dt=2.5e-4,
        duration=0.5,
    )
    run = simulate(experiment)
    assert np.abs(run.x[:, :, 2]).max() == 0.0
    assert run.v[-1, -1, 0] < 0.5
    momentum = np.einsum("n,tna->ta", experiment.geometry.masses, run.v)
    assert np.abs(momentum - momentum[0]).max() < 1e-14
    assert np.abs(run.balance).max() < 3e-3 * run.kinetic[0]
