"""The compiled kernels against plain NumPy, and gradients against differences."""

import math

import numpy as np
import pytest

from openprc.demlat import observables
from openprc.demlat.compiled.jit import entry
from openprc.demlat.models.barhinge import drive_kernels, laws
from openprc.demlat.models.barhinge.assembly import assemble
from openprc.demlat.models.barhinge.dynamics_kernels import evaluate, observe
from openprc.demlat.models.barhinge.tables import LEDGER, LEDGER_STRIDE
from openprc.demlat.signal_table import columns_of, sample_signal, signal_table
from openprc.schema.experiment import Signal
from openprc.schema.geometry import Hinges


def random_scene(body, seed=0):
    rng = np.random.default_rng(seed)
    n = 12
    x = rng.normal(size=(n, 3))
    pairs = rng.permuted(np.array([(i, j) for i in range(n) for j in range(i)]), axis=0)[:25]
    bars = np.column_stack([pairs, rng.uniform(1, 9, 25), rng.uniform(0.2, 2, 25), rng.random(25)])
    quads = np.array([rng.choice(n, 4, replace=False) for _ in range(9)])
    folds = np.column_stack([quads, rng.uniform(1, 2, 9), rng.uniform(0, 6, 9), rng.random(9)])
    return body(
        x,
        rng.uniform(1, 2, n),
        velocities=rng.normal(size=(n, 3)),
        bars=bars,
        hinges=folds,
        damping=0.7,
        gravity=(0.3, -1.0, 2.0),
    )


def numpy_energy(scene, x):
    bars, hinges = scene.geometry.bars, scene.geometry.hinges
    energy = -np.sum(scene.geometry.masses[:, None] * np.array(scene.gravity) * x)
    i, j = bars.indices.T
    length = np.linalg.norm(x[j] - x[i], axis=1)
    energy += np.sum(0.5 * bars.stiffness * (length - bars.relaxed_length) ** 2)
    angles = arccos_angle(x, hinges.indices)
    delta = (angles - hinges.rest_angle + np.pi) % (2 * np.pi) - np.pi
    return energy + np.sum(0.5 * hinges.stiffness * delta**2)


def arccos_angle(x, indices):
    """The dihedral angle as the literature has it: sign times arc cosine, modulo 2 pi."""
    j, k, i, l = (x[indices[:, c]] for c in range(4))  # noqa: E741
    m, n = np.cross(i - j, k - j), np.cross(k - j, k - l)
    cosine = np.sum(m * n, 1) / np.linalg.norm(m, axis=1) / np.linalg.norm(n, axis=1)
    sign = np.where(np.sum(m * (k - l), 1) < 0, -1, 1)
    return (sign * np.arccos(np.clip(cosine, -1, 1))) % (2 * np.pi)


def wrapped(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def central_differences(function, x, step=1e-6):
    gradient = np.zeros_like(x)
    for index in np.ndindex(*x.shape):
        for sign in (1, -1):
            moved = x.copy()
            moved[index] += sign * step
            gradient[index] += sign * function(moved) / (2 * step)
    return gradient


@entry
def forces_of(stamp):
    def run(body, x, v, force, rates, energy):
        _ = stamp
        evaluate(body, x, v, force, rates, 0.0, 0.0, 1.0)
        observe(body, x, v, energy)

    return run


@entry
def column_at(stamp):
    def run(table, column, t, t_from, t_to):
        _ = stamp
        value, rate = drive_kernels.value_and_rate(table, column, t, t_from, t_to)
        return value, rate, drive_kernels.acceleration(table, column, t, t_from, t_to)

    return run


def compiled_forces(scene, x, v, vectors=False):
    """Forces [N], powers lost by kind [W] and energies by kind [J] at any state."""
    assembly = assemble([scene], vectors=vectors)
    body, packing, unit = assembly.body, assembly.packing, assembly.scaler
    force, energy = np.zeros_like(body.mass), np.zeros(4 * LEDGER_STRIDE)
    rates = np.zeros(len(LEDGER) * LEDGER_STRIDE)
    flat = packing.coordinates
    forces_of(
        body, flat(x[None] / unit.length), flat(v[None] / unit.velocity), force, rates, energy
    )
    powers = rates.reshape(-1, LEDGER_STRIDE).sum(axis=1) * unit.moment / unit.time
    energies = energy.reshape(-1, LEDGER_STRIDE).sum(axis=1) * unit.moment
    return packing.nodes(force)[0] * unit.force, powers, energies


def test_forces_are_minus_the_gradient_of_the_energy(body):
    scene = random_scene(body)
    x = scene.geometry.positions.copy()
    force, powers, _ = compiled_forces(scene, x, np.zeros_like(x))
    expected = -central_differences(lambda at: numpy_energy(scene, at), x)
    np.testing.assert_allclose(force, expected, atol=2e-8 * np.abs(force).max())
    assert not powers.any()


def test_the_compiled_energy_is_that_of_numpy(body):
    scene = random_scene(body)
    x, v = scene.geometry.positions.copy(), scene.geometry.velocities.copy()
    *_, energies = compiled_forces(scene, x, v)
    assert energies[1:].sum() == pytest.approx(numpy_energy(scene, x), rel=1e-13)
    kinetic = 0.5 * np.sum(scene.geometry.masses[:, None] * v**2)
    assert energies[0] == pytest.approx(kinetic, rel=1e-14)


def test_lanes_give_what_single_elements_give(body):
    scene = random_scene(body)
    x, v = scene.geometry.positions.copy(), scene.geometry.velocities.copy()
    for one, many in zip(
        compiled_forces(scene, x, v), compiled_forces(scene, x, v, vectors=True), strict=True
    ):
        np.testing.assert_allclose(many, one, rtol=1e-12, atol=1e-12 * np.abs(one).max())


def test_damping_forces_against_numpy(body):
    scene = random_scene(body)
    geometry = scene.geometry
    x, v = geometry.positions.copy(), geometry.velocities.copy()
    moving, powers, _ = compiled_forces(scene, x, v)
    resting, *_ = compiled_forces(scene, x, np.zeros_like(v))
    drag = 0.7 * geometry.masses / geometry.masses.mean()
    expected = -drag[:, None] * v
    i, j = geometry.bars.indices.T
    unit = (x[j] - x[i]) / np.linalg.norm(x[j] - x[i], axis=1, keepdims=True)
    pull = (geometry.bars.damping * np.sum(unit * (v[j] - v[i]), axis=1))[:, None] * unit
    np.add.at(expected, i, pull)
    np.add.at(expected, j, -pull)
    gradients = observables.hinge_gradients(x[None], geometry.hinges.indices)[0]
    rates = np.einsum("kna,kna->k", gradients, v[geometry.hinges.indices])
    moment = (geometry.hinges.damping * rates)[:, None, None] * gradients
    np.add.at(expected, geometry.hinges.indices, -moment)
    np.testing.assert_allclose(moving - resting, expected, atol=1e-12 * np.abs(moving).max())
    # Everything that the damping forces take is booked.
    assert powers[1:].sum() == pytest.approx(-np.sum(expected * v), rel=1e-12)


def fold(angle, scale=1.0, skew=0.3):
    """One hinge with the given dihedral angle: crease along x, wing i raised from flat."""
    x = np.array([[0, 0, 0], [1, 0, 0], [skew, 0.7, 0], [0.6, 0, 0]], dtype=float)
    # Wing l lies opposite to i and is turned about the crease until the angle fits.
    x[3, 1:] = -0.9 * np.cos(np.pi - angle), 0.9 * np.sin(np.pi - angle)
    return scale * x


@pytest.mark.parametrize("angle", [0.05, 0.5, 1.5, 3.0, np.pi, 3.3, 5.0, 2 * np.pi - 0.05])
@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e3])
def test_hinge_gradient_against_differences(angle, scale):
    x = fold(angle, scale)
    indices = np.array([[0, 1, 2, 3]])
    hinge = Hinges(indices=indices, stiffness=[1.0], rest_angle=[0.0])
    measured = observables.hinge_angles(x[None], hinge)[0, 0]
    assert min(abs(measured - angle), abs(2 * np.pi - measured - angle)) < 1e-12
    gradient = observables.hinge_gradients(x[None], indices)[0, 0]
    expected = central_differences(
        lambda at: wrapped(observables.hinge_angles(at[None], hinge)[0, 0] - measured),
        x,
        step=1e-6 * scale,
    )
    np.testing.assert_allclose(gradient * scale, expected * scale, atol=1e-8)
    np.testing.assert_allclose(gradient.sum(axis=0) * scale, 0, atol=1e-13)
    np.testing.assert_allclose(np.cross(x, gradient).sum(axis=0), 0, atol=1e-12)
    # At the wings it is one over the height.
    assert np.linalg.norm(gradient[2]) == pytest.approx(1 / (0.7 * scale))
    assert np.linalg.norm(gradient[3]) == pytest.approx(1 / (0.9 * scale))


def test_angle_conventions():
    # Flat is pi; wing i raised gives less than pi; swapping one pair mirrors the angle.
    x = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.2], [0, -1, 0]], dtype=float)

    def angle(*order):
        hinge = Hinges(indices=[order], stiffness=[1.0], rest_angle=[0.0])
        return observables.hinge_angles(x[None], hinge)[0, 0]

    raised = angle(0, 1, 2, 3)
    assert raised == pytest.approx(np.pi - np.arctan(0.2))
    assert angle(1, 0, 3, 2) == pytest.approx(raised, abs=1e-14)
    assert angle(1, 0, 2, 3) == pytest.approx(2 * np.pi - raised, abs=1e-14)
    x[2, 2] = 0
    assert angle(0, 1, 2, 3) == pytest.approx(np.pi, abs=1e-15)


@pytest.mark.parametrize("exponent", range(-12, 1))
@pytest.mark.parametrize("folded", [False, True])
@pytest.mark.parametrize("vectors", [False, True])
def test_hinge_forces_are_exact_from_flat_to_folded_shut(body, exponent, folded, vectors):
    # An arc cosine would lose everything below 1e-8 rad. Wing i at height 1 over the crease,
    # so its force is k times the bend, across the panel.
    bend = 10.0**exponent
    angle = np.pi - bend if folded else bend
    wing = [0, math.cos(angle), math.sin(angle)]
    scene = body(
        [[0, 0, 0], [1, 0, 0], wing, [0, -1, 0]], [1] * 4, hinges=[(0, 1, 2, 3, 1.0, np.pi, 0)]
    )
    x = scene.geometry.positions.copy()
    force, *_ = compiled_forces(scene, x, np.zeros_like(x), vectors=vectors)
    # The angle that the rounded coordinates really have.
    actual = math.atan2(wing[2], wing[1])
    assert np.linalg.norm(force[2]) * math.hypot(*wing) == pytest.approx(actual, rel=1e-14)


@pytest.mark.parametrize("turns", [-1, 0, 1])
def test_rest_angles_may_be_given_in_any_turn(body, turns):
    x = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.2], [0, -1, 0]], dtype=float)
    moments = [
        compiled_forces(
            body(x, [1] * 4, hinges=[(0, 1, 2, 3, 1.0, 0.4 + 2 * np.pi * n, 0)]), x, 0 * x
        )[0]
        for n in (0, turns)
    ]
    np.testing.assert_allclose(moments[1], moments[0], atol=1e-13)


def test_the_arctangent_is_that_of_the_library():
    rng = np.random.default_rng(3)
    y, x = rng.normal(size=(2, 4000)) * 10.0 ** rng.uniform(-14, 3, size=(2, 4000))
    ours = np.array([laws.arctangent(*pair) for pair in zip(y, x, strict=True)])
    np.testing.assert_allclose(ours, np.arctan2(y, x), rtol=4e-16, atol=0)


@pytest.mark.parametrize("interpolation", ["linear", "hold", "cubic"])
@pytest.mark.parametrize("integrated", [False, True])
def test_compiled_signals_are_those_of_numpy(interpolation, integrated):
    rng = np.random.default_rng(4)
    first = Signal(name="a", values=rng.normal(size=5), dt=1.0)
    signal = Signal(name="b", values=rng.normal(size=(9, 3)), dt=0.3, interpolation=interpolation)
    table = signal_table([*columns_of(first), *columns_of(signal, integrated=integrated)])
    times = np.linspace(0, 4, 57)
    fine = np.linspace(0, 4, 560 * 64 + 1)
    values = sample_signal(signal, fine)
    sums = np.cumsum((values[1:] + values[:-1]) / 2 * (fine[1] - fine[0]), axis=0)
    h = 1e-5
    for t in times:
        expected = sample_signal(signal, np.array([t]))[0]
        for axis in range(3):
            value, rate, second = column_at(table, 1 + axis, t, t, t + h)
            if integrated:
                assert rate == pytest.approx(expected[axis], abs=1e-12)
                until = np.searchsorted(fine, t)
                assert value == pytest.approx(sums[until - 1, axis] if until else 0.0, abs=2e-3)
            else:
                assert value == pytest.approx(expected[axis], abs=1e-12)
            ahead = column_at(table, 1 + axis, t + h, t, t + h)
            assert rate == pytest.approx((ahead[0] - value) / h, abs=5e-3)
            assert second == pytest.approx((ahead[1] - rate) / h, abs=5e-2)


def test_a_jump_at_the_end_of_a_step_is_not_seen_from_within_it():
    held = Signal(name="a", values=[1.0, 2.0], dt=0.3, interpolation="hold")
    table = signal_table(columns_of(held))
    assert column_at(table, 0, 3 * 0.1, 2 * 0.1, 3 * 0.1)[0] == 1.0
    assert column_at(table, 0, 3 * 0.1, 3 * 0.1, 4 * 0.1)[0] == 2.0


def test_observables_against_plain_loops(body):
    scene = random_scene(body)
    geometry = scene.geometry
    x, v = geometry.positions[None], geometry.velocities[None]
    lengths = observables.bar_lengths(x, geometry.bars)
    forces = observables.bar_forces(x, v, lengths, geometry.bars)
    strains = observables.bar_strains(lengths, geometry.bars)
    for e, (i, j) in enumerate(geometry.bars.indices):
        along = x[0, j] - x[0, i]
        length = np.linalg.norm(along)
        rate = along @ (v[0, j] - v[0, i]) / length
        rest = geometry.bars.rest_length[e]
        tension = geometry.bars.stiffness[e] * (length - rest) + geometry.bars.damping[e] * rate
        assert lengths[0, e] == pytest.approx(length)
        assert strains[0, e] == pytest.approx(length / rest - 1)
        assert forces[0, e] == pytest.approx(tension)
    angles = observables.hinge_angles(x, geometry.hinges)
    np.testing.assert_allclose(angles[0], arccos_angle(x[0], geometry.hinges.indices), atol=1e-7)
    torques = observables.hinge_torques(angles, 0 * angles, geometry.hinges)
    delta = np.angle(np.exp(1j * (angles - geometry.hinges.rest_angle)))
    np.testing.assert_allclose(torques, geometry.hinges.stiffness * delta, atol=1e-12)


def test_elements_between_fixed_nodes_are_shown_and_not_stepped(body, simulate):
    # Half of the nodes of a grid are fixed; the same scene one element at a time is the judge.
    rng = np.random.default_rng(5)
    n = 6
    x = np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), -1).reshape(-1, 2) * 1.0
    x = np.column_stack([x, 0.1 * rng.normal(size=len(x))])
    number = np.arange(n * n).reshape(n, n)
    pairs = np.concatenate(
        [
            np.stack([number[:, :-1], number[:, 1:]], -1).reshape(-1, 2),
            np.stack([number[:-1], number[1:]], -1).reshape(-1, 2),
        ]
    )
    quads = np.stack(
        [number[:-1, 1:-1], number[1:, 1:-1], number[:-1, :-2], number[:-1, 2:]], -1
    ).reshape(-1, 4)
    bars = np.column_stack(
        [
            pairs,
            rng.uniform(5, 9, len(pairs)),
            rng.uniform(0.9, 1.1, len(pairs)),
            rng.uniform(0, 0.1, len(pairs)),
        ]
    )
    folds = np.column_stack(
        [quads, np.full(len(quads), 0.1), rng.uniform(2.8, 3.4, len(quads)), np.zeros(len(quads))]
    )
    scene = body(
        x, np.ones(n * n), bars=bars, hinges=folds, fixed=np.arange(n * n) < 18, duration=0.2
    )
    idle = scene.geometry.fixed[scene.geometry.bars.indices].all(axis=1)
    many = assemble([scene])
    stepped = {int(e) for group in many.body.bars for e in group.element if e >= 0}
    assert idle.sum() == 27
    assert stepped == set(np.flatnonzero(~idle).tolist())
    run = simulate(scene)
    length = observables.bar_lengths(run.x[-1:], scene.geometry.bars)
    np.testing.assert_allclose(run.length[-1:], length, rtol=1e-13)
    np.testing.assert_allclose(
        run.tension[-1:],
        observables.bar_forces(run.x[-1:], run.v[-1:], length, scene.geometry.bars),
        atol=1e-12,
    )
    np.testing.assert_allclose(
        run.angle[-1:], observables.hinge_angles(run.x[-1:], scene.geometry.hinges), atol=1e-12
    )
    assert run.potential[-1] == pytest.approx(numpy_energy(scene, run.x[-1]), rel=1e-12)
