"""Scenes recorded from a running script: every value is the one that PyBullet tells."""

from __future__ import annotations

import numpy as np
import pytest
from openprc_pybullet.samples import PENDULUM, Pendulum, pendulum_urdf

from openprc.errors import ConfigError
from openprc.hooks import record_run

CHAIN = Pendulum(
    parents=(-1, 0, 1, 2, 3),
    lengths=(0.2,) * 5,
    axes=((0, 1, 0),) * 5,
    dampings=(0.0,) * 5,
    mass=0.1,
    torque=0.0,
    rest=0.0,
)


def load(p, client, folder, body, *, angles=(), at=(0, 0, 0)):
    """Load a pendulum, its motors off and without damping; return its id."""
    model = folder / f"model{len(list(folder.glob('model*.urdf')))}.urdf"
    model.write_text(pendulum_urdf(body), encoding="utf-8")
    robot = p.loadURDF(
        str(model), at, useFixedBase=True, flags=p.URDF_USE_INERTIA_FROM_FILE,
        physicsClientId=client,
    )  # fmt: skip
    n = len(body.lengths)
    for link in range(-1, n):
        p.changeDynamics(robot, link, linearDamping=0, angularDamping=0, physicsClientId=client)
    p.setJointMotorControlArray(
        robot, range(n), p.VELOCITY_CONTROL, forces=[0.0] * n, physicsClientId=client
    )
    for joint, angle in enumerate(angles):
        p.resetJointState(robot, joint, angle, physicsClientId=client)
    return robot


def states_of(p, client, robot):
    """Return positions and velocities of base and links, and joint states, of this instant."""
    links = p.getLinkStates(
        robot, range(p.getNumJoints(robot, client)), 1, 1, physicsClientId=client
    )
    at, turned = p.getBasePositionAndOrientation(robot, client)
    speed, omega = p.getBaseVelocity(robot, client)
    joints = p.getJointStates(robot, range(len(links)), client)
    return {
        "positions": [at, *(state[0] for state in links)],
        "velocities": [speed, *(state[6] for state in links)],
        "frames": [state[4] for state in links],
        "orientation": turned,
        "omega": omega,
        "q": [joint[0] for joint in joints],
        "u": [joint[1] for joint in joints],
        "t": [joint[3] for joint in joints],
    }


def test_every_value_is_the_live_one(world, recorded, tmp_path):
    p, start = world
    client = start()
    robot = load(p, client, tmp_path, PENDULUM, angles=(0.4, -1.0, 0.3, 2.0, 1.0), at=(1, 2, 3))
    live = [states_of(p, client, robot)]
    with record_run(client, tmp_path / "run.h5", producer="pybullet") as session:
        for _ in range(1500):  # more than a block
            session.step()
            live.append(states_of(p, client, robot))
        assert session.n_frames == 1501
    run = recorded()
    for name, found in {
        "positions": run.positions(),
        "velocities": run.velocities(),
        **{key: run.channel(f"body0.{key}") for key in ("orientation", "omega", "q", "u", "t")},
    }.items():
        assert np.array_equal(found, np.array([frame[name] for frame in live])), name
    assert np.ptp(run.positions(), axis=0).max() > 0.3  # it did move
    assert np.array_equal(run.time, np.arange(1501) * (1 / 240))


def test_nodes_have_names_masses_and_parents(world, recorded, tmp_path):
    p, start = world
    client = start()
    load(p, client, tmp_path, PENDULUM)
    with record_run(client, tmp_path / "run.h5", producer="pybullet") as session:
        session.step()
    run = recorded()
    assert run.node("label").tolist() == ["body0.base", *(f"body0.link{i}" for i in range(1, 6))]
    assert run.node("mass").tolist() == [0.0, *[PENDULUM.mass] * 5]
    assert run.node("fixed").tolist() == [1, 0, 0, 0, 0, 0]
    assert run.indices("bars").tolist() == [[0, 1], [1, 2], [2, 3], [1, 4], [4, 5]]
    lengths = np.array(PENDULUM.lengths)
    above = np.array([0.0, *lengths[[0, 1, 0, 3]]])
    # From centre to centre along a hanging chain, half of either rod.
    expected = (above + lengths) / 2
    assert run.element_static("bars", "rest_length") == pytest.approx(expected, abs=1e-7)
    names = run.extension("openprc-pybullet", "body0.joints").tolist()
    assert names == [f"joint{i}" for i in range(1, 6)]
    assert run.extension("openprc-pybullet", "gravity").tolist() == [0, 0, -9.81]
    owners = run.extension("openprc-pybullet", "node_body_link").tolist()
    assert owners == [[0, link] for link in range(-1, 5)]


def test_a_chain_stands_where_its_joint_angles_put_it(world, recorded, tmp_path):
    p, start = world
    client = start(dt=1e-3)
    load(p, client, tmp_path, CHAIN, angles=(np.pi / 2, 0, 0, 0, 0))
    with record_run(client, tmp_path / "run.h5", producer="pybullet") as session:
        for _ in range(1000):
            session.step()
    run = recorded()
    # Angles about y add up; a rod that hangs along -z turns towards -x.
    turned = np.cumsum(run.channel("body0.q"), axis=1)
    along = 0.2 * np.stack([-np.sin(turned), np.zeros_like(turned), -np.cos(turned)], axis=-1)
    centres = np.cumsum(along, axis=1) - along / 2
    assert run.positions()[:, 1:] == pytest.approx(centres, abs=1e-6)
    assert np.ptp(turned) > 2


def test_a_pendulum_swings_as_the_closed_form_says(world, recorded, tmp_path):
    p, start = world
    client = start(dt=1e-3)
    one = Pendulum((-1,), (1.0,), ((0, 1, 0),), (0.0,), 0.1, 0.0, 0.0)
    load(p, client, tmp_path, one, angles=(0.01,))
    with record_run(client, tmp_path / "run.h5", producer="pybullet") as session:
        for _ in range(2000):
            session.step()
    run = recorded()
    # A thin rod of length l about its end: omega^2 = 3 g / (2 l).
    omega = np.sqrt(1.5 * 9.81)
    # Semi-implicit Euler from rest is the leapfrog of a start half a step earlier.
    phase = omega * (run.time + 0.5e-3)
    expected = -0.5 * np.sin(0.01 * np.cos(phase) / np.cos(omega * 0.5e-3))
    assert run.positions(nodes=[1])[:, 0, 0] == pytest.approx(expected, abs=2e-6)


def test_velocities_are_those_of_semi_implicit_steps(world, recorded, tmp_path):
    p, start = world
    client = start()
    ball = p.createMultiBody(1.0, basePosition=(0, 0, 5), physicsClientId=client)
    p.changeDynamics(ball, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    with record_run(client, tmp_path / "run.h5", producer="pybullet") as session:
        for _ in range(240):
            session.step()
    run = recorded()
    z, v = run.positions()[:, 0, 2], run.velocities()[:, 0, 2]
    assert v == pytest.approx(-9.81 * run.time, abs=1e-12)
    assert np.diff(z) == pytest.approx(v[1:] / 240, abs=1e-12)
    # x_n = x_0 - g dt^2 n (n + 1) / 2
    n = np.arange(241)
    assert z == pytest.approx(5 - 9.81 / 240**2 * n * (n + 1) / 2, abs=1e-11)
    assert any("semi-implicit" in note for note in notes(run))


def notes(run):
    """Return what the file says of itself."""
    return list(run.provenance["notes"])


def test_frames_are_the_joints(world, recorded, tmp_path):
    p, start = world
    client = start()
    robot = load(p, client, tmp_path, PENDULUM, angles=(0.4, -1.0, 0.3, 2.0, 1.0))
    live = [states_of(p, client, robot)]
    with record_run(client, tmp_path / "run.h5", producer="pybullet", nodes="frame") as session:
        for _ in range(300):
            session.step()
            live.append(states_of(p, client, robot))
    run = recorded()
    # PyBullet rounds its link frames to single precision ...
    frames = np.array([frame["frames"] for frame in live])
    assert run.positions()[:, 1:] == pytest.approx(frames, abs=2e-7)
    # ... and these are not: from joint to joint a rod is rigid.
    bars = run.indices("bars")
    ends = run.positions()[:, bars]
    lengths = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
    assert lengths == pytest.approx(
        np.broadcast_to([0, 0.04, 0.4, 0.04, 0.2], lengths.shape), abs=1e-14
    )
    # Central differences of positions, half a step off because the steps are semi-implicit.
    moved = np.diff(run.positions(), axis=0) * 240
    assert moved == pytest.approx(run.velocities()[1:], abs=0.05)
    assert np.abs(run.velocities()).max() > 1
    assert any("URDF link frames" in note for note in notes(run))


def test_the_frame_of_a_base_is_not_its_centre_of_mass(world, recorded, tmp_path):
    p, start = world
    client = start(gravity=0.0)
    model = tmp_path / "hammer.urdf"
    model.write_text(
        '<robot name="hammer"><link name="head"><inertial><origin xyz="0.1 0.2 0.3" '
        'rpy="0.4 0.5 0.6"/><mass value="2"/><inertia ixx="1" iyy="2" izz="2.5" ixy="0" ixz="0" '
        'iyz="0"/></inertial></link></robot>'
    )
    turn = p.getQuaternionFromEuler((0.7, -0.2, 1.1))
    body = p.loadURDF(str(model), (1, 2, 3), turn, physicsClientId=client)
    p.changeDynamics(body, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    p.resetBaseVelocity(body, (0.1, 0.2, 0.3), (1, 2, 3), physicsClientId=client)
    with record_run(client, tmp_path / "run.h5", producer="pybullet", nodes="frame") as session:
        session.step()
        at, turned = p.getBasePositionAndOrientation(body, client)
        offset, inertial = p.getDynamicsInfo(body, -1, client)[3:5]
        expected, _ = p.multiplyTransforms(at, turned, *p.invertTransform(offset, inertial))
    run = recorded()
    assert run.positions()[0, 0] == pytest.approx([1, 2, 3], abs=1e-12)
    # multiplyTransforms computes in single precision.
    assert run.positions()[1, 0] == pytest.approx(expected, abs=1e-6)
    assert np.linalg.norm(np.subtract(at, expected)) > 0.3
    # The base turns about its centre of mass: the frame has a velocity of its own.
    r = np.subtract((1, 2, 3), p.multiplyTransforms((1, 2, 3), turn, offset, (0, 0, 0, 1))[0])
    speed = np.add((0.1, 0.2, 0.3), np.cross((1, 2, 3), r))
    assert run.velocities()[0, 0] == pytest.approx(speed, abs=1e-6)


def test_every_third_step_is_kept(world, recorded, tmp_path):
    p, start = world
    client = start(dt=0.1)
    p.createMultiBody(1.0, physicsClientId=client)
    with record_run(client, tmp_path / "run.h5", producer="pybullet", every=3, t0=2.0) as session:
        for step in range(8):
            session.step(u=float(step))
        assert session.time == pytest.approx(2.8)
    run = recorded()
    assert run.time == pytest.approx([2.0, 2.3, 2.6], abs=1e-15)
    assert run.input("u").value[:, 0].tolist() == [0, 3, 6]
    assert any("commands changed between saved frames" in note for note in notes(run))


def test_time_is_not_summed_up(world, recorded, tmp_path):
    p, start = world
    client = start(gravity=0.0, dt=0.1)
    p.createMultiBody(1.0, physicsClientId=client)
    with record_run(client, tmp_path / "run.h5", producer="pybullet") as session:
        for _ in range(30_000):
            session.record()  # the clock only
    time = recorded().time
    assert time[-1] == 3000.0  # 0.1 thirty thousand times is 2999.99999999...
    assert recorded().dt == 0.1


def test_record_after_steps_of_ones_own(world, recorded, tmp_path):
    p, start = world
    client = start(dt=0.01)
    p.createMultiBody(1.0, physicsClientId=client)
    with record_run(client, tmp_path / "run.h5", producer="pybullet") as session:
        for _ in range(5):
            for _ in range(4):
                p.stepSimulation(physicsClientId=client)
            session.record(4)
    run = recorded()
    assert run.time == pytest.approx(np.arange(6) * 0.04)
    assert run.velocities()[:, 0, 2] == pytest.approx(-9.81 * run.time, rel=0.05)


@pytest.mark.parametrize(("steps", "every", "words"), [
    (0, 1, "record\\(\\) after 0 steps"), (1.0, 1, "record\\(\\) after 1.0 steps"),
    (3, 2, "3 steps at a time, every 2th"),
])  # fmt: skip
def test_steps_that_do_not_fit_are_refused(world, tmp_path, steps, every, words):
    p, start = world
    client = start()
    p.createMultiBody(1.0, physicsClientId=client)
    with (
        pytest.raises(ConfigError, match=words),
        record_run(client, tmp_path / "run.h5", producer="pybullet", every=every) as session,
    ):
        session.record(steps)


def test_two_servers_side_by_side(world, recorded, tmp_path):
    p, start = world
    sessions = []
    for k, gravity in enumerate((-1.0, -2.0)):
        client = start(gravity=gravity)
        ball = p.createMultiBody(1.0, physicsClientId=client)
        p.changeDynamics(ball, -1, linearDamping=0, physicsClientId=client)
        sessions.append(record_run(client, tmp_path / f"{k}.h5", producer="pybullet"))
    for _ in range(240):
        for recording in sessions:
            recording.session.step()
    for k, recording in enumerate(sessions):
        recording.close()
        assert recorded(tmp_path / f"{k}.h5").velocities()[-1, 0, 2] == pytest.approx(-(k + 1.0))


def test_the_module_and_its_wrapper_are_simulators(world, recorded, tmp_path):
    p, start = world
    start()

    class BulletClient:
        _client = start()

    p.createMultiBody(1.0, physicsClientId=BulletClient._client)
    with record_run(BulletClient(), tmp_path / "run.h5", producer="pybullet") as session:
        session.step()
    assert recorded().n_nodes == 1
    if p.getConnectionInfo(0)["isConnected"]:
        p.createMultiBody(1.0, physicsClientId=0)
        with record_run(p, tmp_path / "other.h5", producer="pybullet") as session:
            session.step()
        assert recorded(tmp_path / "other.h5").n_frames == 2


def test_recording_does_not_change_the_motion(world, tmp_path):
    p, start = world
    ends = []
    for records in (False, True):
        client = start()
        robot = load(p, client, tmp_path, PENDULUM, angles=(1.0, 2.0, 3.0, 4.0, 5.0))
        if records:
            with record_run(
                client, tmp_path / "run.h5", producer="pybullet", contacts=True
            ) as session:
                for _ in range(500):
                    session.step()
        else:
            for _ in range(500):
                p.stepSimulation(physicsClientId=client)
        ends.append(states_of(p, client, robot))
    assert ends[0] == ends[1]


def test_frames_of_links_whose_axes_are_turned(world, recorded, tmp_path):
    p, start = world
    client = start()
    inertia = '<inertia ixx="0.1" iyy="0.15" izz="0.2" ixy="0.03" ixz="0.01" iyz="-0.02"/>'
    origin = '<origin xyz="0.1 0.2 -0.1" rpy="0.3 0.1 0.2"/>'
    link = f"<inertial>{origin}<mass value='1'/>{inertia}</inertial></link>"
    model = tmp_path / "arm.urdf"
    model.write_text(
        f'<robot name="arm"><link name="a">{link}<link name="b">{link}<joint name="j" '
        'type="continuous"><parent link="a"/><child link="b"/><origin xyz="0.5 0.6 0.7" '
        'rpy="1 2 3"/><axis xyz="0 0.6 0.8"/></joint></robot>'
    )
    arm = p.loadURDF(str(model), flags=p.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client)
    p.resetBaseVelocity(arm, (1, 2, 3), (3, 2, 1), physicsClientId=client)
    live = []
    with record_run(client, tmp_path / "run.h5", producer="pybullet", nodes="frame") as session:
        for _ in range(100):
            session.step()
            live.append(p.getLinkStates(arm, [0], 1, 1, client)[0][4])
    run = recorded()
    assert run.positions()[1:, 1] == pytest.approx(np.array(live), abs=1e-6)
    # The joint is a point of both links: its way from the base frame has a fixed length.
    lengths = np.linalg.norm(run.positions()[:, 1] - run.positions()[:, 0], axis=1)
    assert lengths == pytest.approx(np.full(101, np.sqrt(1.1)), abs=1e-7)
    # Mean of two velocities against the way between; the arm of the rotation is that of the end of
    # a step, half a step off, which is 4^2 rad2/s2 * 1 m * dt / 2. Of the centres they differ by 1.
    mean = (run.velocities()[1:-1] + run.velocities()[2:]) / 2
    ways = (run.positions()[2:] - run.positions()[:-2]) * 120
    assert mean == pytest.approx(ways, abs=0.03)
