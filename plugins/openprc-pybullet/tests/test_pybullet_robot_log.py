"""GENERIC_ROBOT logs: bodies, clock, gaps, and link positions against the live simulation."""

import numpy as np
import pytest
from openprc_pybullet import client

from openprc.errors import (
    ConfigError,
    Diverged,
    MissingDependency,
    NotATrajectory,
    UnreadableFile,
)


def chain_urdf(path, *, n=5, length=0.2, mass=0.1):
    """Point masses on massless links that hang from the origin and turn about y."""
    massless = '<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    parts = [f'<robot name="chain"><link name="base"><inertial><mass value="0"/>{massless}']
    for i in range(1, n + 1):
        at = "0 0 0" if i == 1 else f"0 0 -{length}"
        parts.append(
            f'<link name="link{i}"><inertial><origin xyz="0 0 -{length}"/><mass value="{mass}"/>'
            f'{massless}<joint name="joint{i}" type="continuous">'
            f'<parent link="{"base" if i == 1 else f"link{i - 1}"}"/><child link="link{i}"/>'
            f'<origin xyz="{at}"/><axis xyz="0 1 0"/></joint>'
        )
    path.write_text("".join(parts) + "</robot>")
    return path


@pytest.fixture
def bullet():
    """Skip where PyBullet is not installed."""
    return pytest.importorskip("pybullet")


# --- against the live simulation ------------------------------------------------------------


def test_pendulum_links(pb_import, data, tmp_path, bullet):
    urdf = chain_urdf(tmp_path / "chain.urdf")
    run = pb_import(data / "pendulum5_chain.log", urdf=(str(urdf),))
    truth = np.load(data / "pendulum5_chain_truth.npz")
    assert (run.n_frames, run.n_nodes) == (4000, 6)
    # Row k of the log is the state after step k + 1.
    np.testing.assert_allclose(run.positions()[:, 1:], truth["pos"][1:], atol=5e-7)
    np.testing.assert_allclose(run.velocities()[:, 1:], truth["vel"][1:], atol=5e-6)
    assert np.abs(run.positions()[:-1, 1:] - truth["pos"][:-2]).max() > 1e-3
    assert (run.t0, run.dt) == (0.001, 0.001)
    np.testing.assert_allclose(run.time, truth["t"][1:], atol=1e-12)
    np.testing.assert_allclose(run.channel("body0.q", unit="rad"), truth["q"][1:], atol=1e-6)
    np.testing.assert_array_equal(run.node("mass"), [0, *[0.1] * 5])
    np.testing.assert_array_equal(run.node("fixed"), [1, 0, 0, 0, 0, 0])
    assert list(run.node("label")) == ["body0.base", *(f"body0.link{i}" for i in range(1, 6))]
    np.testing.assert_array_equal(run.indices("bars"), [[i, i + 1] for i in range(5)])


def test_kuka_links(pb_import, data, bullet):
    run = pb_import(data / "kuka_ik_circle.log", urdf=("1=kuka_iiwa/model.urdf",))
    truth = np.load(data / "kuka_ik_circle_truth.npz")
    assert (run.n_frames, run.n_nodes) == (1200, 8)
    np.testing.assert_allclose(run.positions()[:, 1:], truth["link_com_pos"][1:], atol=1e-6)
    np.testing.assert_allclose(run.velocities()[:, 1:], truth["link_vel"][1:], atol=1e-6)
    np.testing.assert_allclose(run.positions()[:, 0], truth["base_pos"][1:], atol=1e-7)
    np.testing.assert_allclose(run.channel("body1.q", unit="rad"), truth["q"][1:], atol=1e-6)
    np.testing.assert_allclose(run.channel("body1.u", unit="rad/s"), truth["qd"][1:], atol=1e-5)
    assert run.channel("body1.t", unit="N*m").shape == (1200, 7)
    assert run.channel_columns("body1.q") == tuple(f"body1.q{i}" for i in range(7))
    np.testing.assert_allclose(run.node("mass"), [0, 4, 4, 3, 2.7, 1.7, 1.8, 0.3])
    assert run.dt == pytest.approx(1 / 240, rel=1e-15)


def test_floating_base_with_offset_centre_of_mass(pb_import, data, bullet):
    """Laikago's inertial frame is 4 cm from its URDF frame, and its base moves and turns."""
    run = pb_import(data / "laikago_replay.log", urdf=("laikago/laikago_toes.urdf",))
    saved = pb_import(data / "laikago_replay_user.pkl", trust=True)
    rows = np.rint(saved.time / 0.002).astype(int) - 1
    np.testing.assert_allclose(run.positions()[rows, 1:], saved.positions(), atol=1e-6)
    np.testing.assert_allclose(run.time[rows], saved.time, atol=1e-12)


def test_several_bodies(pb_import, data, bullet):
    run = pb_import(data / "r2d2_drive_all.log", urdf=("1=r2d2.urdf", "2=cube.urdf"))
    truth = np.load(data / "r2d2_drive_truth_every4.npz")
    rows = np.rint(truth["t"][1:] * 240).astype(int) - 1
    assert run.n_nodes == 1 + 15 + 1
    x, v = run.positions()[rows], run.velocities()[rows]
    np.testing.assert_allclose(x[:, 0], truth["r2d2_base_pos"][1:], atol=1e-6)
    np.testing.assert_allclose(x[:, 1:16], truth["r2d2_link_com_pos"][1:], atol=1e-6)
    np.testing.assert_allclose(v[:, 1:16], truth["r2d2_link_vel"][1:], atol=1e-6)
    np.testing.assert_allclose(x[:, 16], truth["cube_base_pos"][1:], atol=1e-6)
    # One of the eight joints slides: its channel is in metres.
    assert run.channel("body1.q", unit="rad").shape == (720, 7)
    assert run.channel("body1.q_prismatic", unit="m").shape == (720, 1)
    assert not np.any(run.node("fixed"))
    assert "left out bodies 0" in " ".join(run.notes)


def test_model_from_sdf_by_its_joints(pb_import, data, bullet):
    run = pb_import(
        data / "kuka_block_grasp_vr_2017.bin", urdf=("0=kuka_iiwa/kuka_with_gripper.sdf",)
    )
    assert (run.n_frames, run.n_nodes) == (2105, 16)
    assert run.dt == 0.002
    assert "body0.left_finger_tip" in list(run.node("label"))
    assert any("cut off after 64 bytes" in note for note in run.notes)


# --- without a model --------------------------------------------------------------------------


def test_bases_only(pb_import, data):
    run = pb_import(data / "r2d2_drive_all.log")
    truth = np.load(data / "r2d2_drive_truth_every4.npz")
    rows = np.rint(truth["t"][1:] * 240).astype(int) - 1
    assert list(run.node("label")) == ["body1", "body2"]
    np.testing.assert_allclose(run.positions()[rows, 0], truth["r2d2_base_pos"][1:], atol=1e-7)
    np.testing.assert_allclose(run.velocities()[rows, 0], truth["r2d2_base_vel"][1:], atol=1e-7)
    np.testing.assert_allclose(
        run.channel("body1.orientation")[rows], truth["r2d2_base_orn"][1:], atol=1e-7
    )
    np.testing.assert_allclose(
        run.channel("body1.omega", unit="rad/s")[rows], truth["r2d2_base_omega"][1:], atol=1e-7
    )
    np.testing.assert_allclose(
        run.channel("body2.orientation")[rows], truth["cube_base_orn"][1:], atol=1e-7
    )
    assert any("unit arb" in note for note in run.notes)


def test_bodies_and_static(pb_import, data):
    only = pb_import(data / "r2d2_drive_all.log", bodies=(2,))
    assert list(only.node("label")) == ["body2"]
    everything = pb_import(data / "r2d2_drive_all.log", include_static=True)
    assert list(everything.node("label")) == ["body0", "body1", "body2"]
    np.testing.assert_array_equal(everything.node("fixed"), [1, 0, 0])
    plane = pb_import(data / "r2d2_drive_all.log", bodies=(0,))
    assert np.ptp(plane.positions(), axis=0).max() == 0


def test_truncated_real_log(pb_import, data):
    run = pb_import(data / "kuka_block_grasp_vr_2017.bin")
    assert (run.n_frames, list(run.node("label"))) == (2105, ["body0", "body2"])
    assert run.time[-1] == pytest.approx(4.21, abs=1e-12)


def test_start_time(pb_import, data):
    assert pb_import(data / "kuka_ik_circle.log", t0=2.0).time[0] == pytest.approx(2 + 1 / 240)


# --- synthetic logs: closed form --------------------------------------------------------------


def free_fall(step, dt):
    t = (step + 1) * dt
    return (0.5, 0.0, 10 - 4.905 * t * t), (0.0, 0.0, -9.81 * t)


def test_free_fall(pb_import, write_log, robot_header, robot_record):
    dt = 1 / 128  # exact in float32, as are the stamps
    records = []
    for step in range(100):
        x, v = free_fall(step, dt)
        records.append(robot_record(step, dt=dt, pos=x, vel=v))
    run = pb_import(write_log(robot_header(), *records))
    np.testing.assert_allclose(run.time, (np.arange(100) + 1) * dt, atol=0)
    np.testing.assert_allclose(run.positions()[:, 0, 2], 10 - 4.905 * run.time**2, rtol=1e-7)
    np.testing.assert_allclose(run.velocities()[:, 0, 2], -9.81 * run.time, rtol=1e-7)


def test_body_that_appears_and_leaves(pb_import, write_log, robot_header, robot_record):
    records = []
    for step in range(10):
        records.append(robot_record(step, body=3, pos=(step, 0, 0)))
        if 4 <= step < 7:
            records.append(robot_record(step, body=7, pos=(0, step, 0), q=(step,), u=(1,), dof=1))
            records[-2:-1] = [robot_record(step, body=3, pos=(step, 0, 0))]
    # All records of one log have the same columns.
    header, size = robot_header(1), len(robot_record(0, dof=1))
    records = [r if len(r) == size else r + bytes(8) for r in records]
    run = pb_import(write_log(header, *records))
    seen = np.zeros((10, 2), dtype=int)
    seen[:, 0], seen[4:7, 1] = 1, 1
    np.testing.assert_array_equal(run.observed(), seen)
    np.testing.assert_array_equal(np.isnan(run.positions()[..., 0]), seen == 0)
    np.testing.assert_array_equal(run.positions()[4:7, 1, 1], [4, 5, 6])
    np.testing.assert_array_equal(run.channel("body7.q")[4:7, 0], [4, 5, 6])
    assert np.isnan(run.channel("body7.q")[:4]).all()
    assert any("bodies 7 were not logged in every step" in note for note in run.notes)


def test_incomplete_last_step_is_left_out(pb_import, write_log, robot_header, robot_record):
    records = [robot_record(s, body=b, pos=(s, b, 0)) for s in range(5) for b in (1, 2)]
    run = pb_import(write_log(robot_header(), *records[:-1]))
    assert run.n_frames == 4
    assert any("stepCount 4) lacks bodies 2" in note for note in run.notes)


# --- refusals -----------------------------------------------------------------------------------


def test_overflow_names_the_remedy(pb_import, data):
    path = data / "minitaur_generic_default_dof12_OVERFLOW.log"
    with pytest.raises(
        NotATrajectory, match=r"720 empty records \(written after body 0\)"
    ) as error:
        pb_import(path)
    assert "maxLogDof" in error.value.fix
    with pytest.raises(ConfigError, match=r"bodies 1 are not in the log(.|\n)*maxLogDof"):
        pb_import(path, bodies=(1,))
    plane = pb_import(path, include_static=True)
    assert any("720 records are empty" in note for note in plane.notes)


def test_overflow_of_everything(pb_import, write_log, robot_header):
    path = write_log(robot_header(2), b"\xaa\xbb" * 40)
    with pytest.raises(NotATrajectory, match=r"no body and 40 empty .* before the first body"):
        pb_import(path)


def test_soft_bodies_are_not_in_logs(pb_import, data):
    with pytest.raises(NotATrajectory, match="nothing moves in this log: bodies 0, 1") as error:
        pb_import(data / "cloth_generic.log")
    assert "soft bodies" in error.value.fix


def test_divergence_is_named(pb_import, write_log, robot_header, robot_record):
    records = [robot_record(s, pos=(s, 0, np.nan if s > 6 else 0)) for s in range(9)]
    with pytest.raises(Diverged, match="posZ of body 0 is nan from step 7 on"):
        pb_import(write_log(robot_header(), *records))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda r: [r(0, body=1), r(0, body=1)], "body 1 appears twice in step 0"),
        (lambda r: [r(0, q=(1,), u=(0,), dof=2), r(1, q=(1, 2), u=(0, 0), dof=2)],
         r"changes its number of joints \(1, 2\)"),
    ],
)  # fmt: skip
def test_damaged_bodies(pb_import, write_log, robot_header, robot_record, make, words):
    records = make(robot_record)
    dof = (len(records[0]) - 70) // 8
    with pytest.raises(UnreadableFile, match=words):
        pb_import(write_log(robot_header(dof), *records))


@pytest.mark.parametrize(
    ("options", "kind", "words"),
    [
        ({"urdf": ("r2d2.urdf",)}, ConfigError, "does not say which body"),
        ({"urdf": ("9=r2d2.urdf",)}, ConfigError, "body 9 is not imported"),
        ({"urdf": ("1=r2d2.urdf", "1=r2d2.urdf")}, ConfigError, "body 1 is named twice"),
        ({"urdf": ("1=nowhere/at_all.urdf",)}, UnreadableFile, "there is no model"),
        ({"bodies": (4, 5)}, ConfigError, "bodies 4, 5 are not in the log"),
        ({"dt": 0.01}, ConfigError, "the time stamps are"),
        ({"dt": -1.0}, ConfigError, "positive number"),
        ({"t0": float("nan")}, ConfigError, "finite time"),
    ],
)
def test_wrong_options(pb_import, data, tmp_path, monkeypatch, options, kind, words):
    # A file of that name, so that the options are judged with and without pybullet_data.
    (tmp_path / "r2d2.urdf").write_text("<robot/>")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(kind, match=words):
        pb_import((data / "r2d2_drive_all.log").resolve(), **options)


def test_wrong_model(pb_import, data, tmp_path, bullet):
    with pytest.raises(UnreadableFile, match=r"5 revolute and prismatic joints, body 1 .* has 8"):
        pb_import(data / "r2d2_drive_all.log", urdf=(f"1={chain_urdf(tmp_path / 'chain.urdf')}",))
    broken = tmp_path / "broken.urdf"
    broken.write_text("<robot")
    with pytest.raises(UnreadableFile, match="PyBullet cannot load the model"):
        pb_import(data / "r2d2_drive_all.log", urdf=(f"1={broken}",))


def test_without_pybullet(pb_import, data, tmp_path, monkeypatch):
    def absent(name):
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    monkeypatch.setattr(client, "import_module", absent)
    urdf = chain_urdf(tmp_path / "chain.urdf")
    with pytest.raises(MissingDependency, match="computing link positions needs PyBullet") as error:
        pb_import(data / "pendulum5_chain.log", urdf=(str(urdf),))
    assert "pip install 'pybullet>=3.2.7'" in error.value.fix
    assert pb_import(data / "pendulum5_chain.log").n_frames == 4000


def test_bullet_does_not_write_to_stdout(pb_import, data, capfd, bullet):
    pb_import(data / "kuka_ik_circle.log", urdf=("kuka_iiwa/model.urdf",))
    assert capfd.readouterr().out == ""
