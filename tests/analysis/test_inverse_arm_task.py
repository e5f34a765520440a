"""Statics by hand, and an arm that moves as told when its torques are applied."""

import numpy as np
import pytest

from openprc.analysis.tasks import InverseArmTask, TwoLinkArm
from openprc.analysis.tasks.runge_kutta import rk4_step
from openprc.errors import TaskError

ARM = TwoLinkArm(lengths=(0.6, 0.4), masses=(1.5, 0.7), damping=0.3)


def energies(arm, q, dq):
    """Return kinetic and potential energy from the velocities of the centres of mass."""
    (l1, l2), (m1, m2) = arm.lengths, arm.masses
    a, b = q[0], q[0] + q[1]
    w1, w2 = dq[0], dq[0] + dq[1]
    v1 = 0.5 * l1 * w1 * np.array([-np.sin(a), np.cos(a)])
    v2 = 2 * v1 + 0.5 * l2 * w2 * np.array([-np.sin(b), np.cos(b)])
    kinetic = 0.5 * (m1 * v1 @ v1 + m2 * v2 @ v2)
    kinetic += (m1 * l1**2 * w1**2 + m2 * l2**2 * w2**2) / 24
    height1, height2 = 0.5 * l1 * np.sin(a), l1 * np.sin(a) + 0.5 * l2 * np.sin(b)
    return kinetic, arm.gravity * (m1 * height1 + m2 * height2)


def lagrange_torques(arm, q, dq, ddq, h=1e-4):
    """Return d/dt dT/dq' - d(T - V)/dq + damping by differences of the energies alone."""

    def momentum(q, dq):
        return np.array([
            (energies(arm, q, dq + e)[0] - energies(arm, q, dq - e)[0]) / 2.0
            for e in np.eye(2)
        ])  # fmt: skip

    ahead = momentum(q + h * dq + 0.5 * h**2 * ddq, dq + h * ddq)
    behind = momentum(q - h * dq + 0.5 * h**2 * ddq, dq - h * ddq)
    slope = []
    for e in h * np.eye(2):
        (t1, v1), (t0, v0) = energies(arm, q + e, dq), energies(arm, q - e, dq)
        slope.append((t1 - v1 - t0 + v0) / (2 * h))
    return (ahead - behind) / (2 * h) - np.array(slope) + arm.damping * dq


def test_torques_are_those_of_lagrange():
    rng = np.random.default_rng(0)
    for _ in range(20):
        q, dq, ddq = rng.uniform(-3, 3, (3, 2))
        expected = lagrange_torques(ARM, q, dq, ddq)
        np.testing.assert_allclose(ARM.torques(q, dq, ddq), expected, atol=2e-6)


def test_stretched_out_and_at_rest():
    still = np.zeros(2)
    shoulder, elbow = ARM.torques(still, still, still)
    assert elbow == pytest.approx(0.7 * 9.81 * 0.2)
    assert shoulder == pytest.approx(1.5 * 9.81 * 0.3 + 0.7 * 9.81 * 0.8)
    hanging = ARM.torques([-np.pi / 2, 0.0], still, still)
    np.testing.assert_allclose(hanging, 0.0, atol=1e-14)


def test_work_of_the_torques_is_the_energy_and_what_damping_took():
    task = InverseArmTask(dt=0.001, arm=ARM)
    t, phases = task.dt * np.arange(3001), np.array([[0.1, 0.7, 2.0], [1.0, 3.0, 0.0]])
    q, dq, ddq = ARM.joint_motion(*task.path(t, phases))
    power = (ARM.torques(q, dq, ddq) * dq).sum(axis=1) - ARM.damping * (dq**2).sum(axis=1)
    work = task.dt * (power.sum() - 0.5 * (power[0] + power[-1]))
    gained = sum(energies(ARM, q[-1], dq[-1])) - sum(energies(ARM, q[0], dq[0]))
    assert work == pytest.approx(gained, abs=1e-6)


@pytest.mark.parametrize("elbow", [1, -1])
def test_kinematics(elbow):
    arm = TwoLinkArm(elbow=elbow)
    task = InverseArmTask(arm=arm)
    phases = np.random.default_rng(3).uniform(0, 6, (2, 3))
    h = 1e-4
    t = np.array([1.0 - h, 1.0, 1.0 + h])
    position, velocity, acceleration = task.path(t, phases)
    q, dq, ddq = arm.joint_motion(position, velocity, acceleration)
    assert (np.sign(q[:, 1]) == elbow).all()
    np.testing.assert_allclose(arm.position(q), position, atol=1e-14)
    np.testing.assert_allclose(dq[1], (q[2] - q[0]) / (2 * h), atol=1e-6)
    np.testing.assert_allclose(ddq[1], (dq[2] - dq[0]) / (2 * h), atol=1e-6)
    np.testing.assert_allclose(velocity[1], (position[2] - position[0]) / (2 * h), atol=1e-6)
    np.testing.assert_allclose(acceleration[1], (velocity[2] - velocity[0]) / (2 * h), atol=1e-6)


def test_the_torques_move_the_arm_along_the_path():
    """Integrate the forward dynamics, with M and the rest read off the torques of unit motions."""
    arm = TwoLinkArm(damping=0.2, gravity=9.81)
    task = InverseArmTask(dt=0.004, arm=arm)
    data = task.generate(501, rng=5)
    phases = np.array(data.metadata["phases"]).reshape(2, 3)
    still = np.zeros(2)

    def rates(time, *state):
        q, dq = np.array(state[:2]), np.array(state[2:])
        torque = arm.torques(*arm.joint_motion(*task.path(time, phases)))
        rest = arm.torques(q, dq, still)
        mass = np.stack([arm.torques(q, dq, e) - rest for e in np.eye(2)], axis=1)
        return (1.0, *dq, *np.linalg.solve(mass, torque - rest))

    q, dq, _ = arm.joint_motion(*task.path(0.0, phases))
    state = (0.0, *q, *dq)
    for k in range(500):
        state = rk4_step(rates, state, task.dt)
        if k % 100 == 99:
            np.testing.assert_allclose(arm.position(state[1:3]), data.input[k + 1], atol=1e-6)
    assert np.ptp(data.input, axis=0).min() > 0.05


def test_data():
    data = InverseArmTask().generate(200, rng=1)
    assert data.target.names == ("shoulder", "elbow")
    assert np.abs(data.input - [0.5, 0.3]).max() <= 0.15
    again = InverseArmTask().generate(200, rng=data.seed)
    assert again.target_for(0.01 * data.input) is again.target


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: TwoLinkArm(lengths=(1.0,)), "lengths is \\(1.0,\\)"),
        (lambda: TwoLinkArm(masses=(1.0, -1.0)), "masses is -1.0"),
        (lambda: TwoLinkArm(damping=-1.0), "damping is -1.0"),
        (lambda: TwoLinkArm(elbow=0), "the elbow is 0"),
        (lambda: InverseArmTask(amplitude=0.0), "amplitude is 0.0"),
        (lambda: InverseArmTask(frequencies=()), "no frequencies"),
        (lambda: InverseArmTask(frequencies=(1.0, 0.0)), "frequencies is 0.0"),
        (
            lambda: InverseArmTask(centre=(1.0, 0.4)).generate(10, rng=0),
            "10 positions are out of reach; .* from the shoulder\n.*less than 1 m",
        ),
    ],
)
def test_wrong_parameters(make, words):
    with pytest.raises(TaskError, match=words):
        make()
