"""npz, pickle and CSV files that people save from their own loop."""

import pickle
from collections import OrderedDict

import numpy as np
import pytest

from openprc.errors import (
    ConfigError,
    Diverged,
    MissingData,
    NotATrajectory,
    SchemaError,
    UnreadableFile,
    UnsafeFile,
    UntrustedPickle,
)

T, N = 40, 4
TIME = np.arange(T) * 0.025


def motion(n=N):
    """Nodes on a circle, each with its own phase: (T, n, 3)."""
    phase = TIME[:, None] + np.arange(n)
    return np.stack([np.cos(phase), np.sin(phase), 0.1 * phase], axis=2)


def speed(n=N):
    phase = TIME[:, None] + np.arange(n)
    return np.stack([-np.sin(phase), np.cos(phase), np.full_like(phase, 0.1)], axis=2)


@pytest.fixture
def save_npz(tmp_path):
    def save(**arrays):
        np.savez(tmp_path / "user.npz", **arrays)
        return tmp_path / "user.npz"

    return save


@pytest.fixture
def save_pickle(tmp_path):
    def save(value):
        path = tmp_path / "user.pkl"
        path.write_bytes(pickle.dumps(value))
        return path

    return save


@pytest.fixture
def save_text(tmp_path):
    def save(text):
        path = tmp_path / "user.csv"
        path.write_text(text)
        return path

    return save


# --- npz ---------------------------------------------------------------------------------------


def test_npz(pb_import, save_npz):
    run = pb_import(save_npz(t=TIME, pos=motion(), vel=speed(), q=TIME[:, None] * [1, 2], step=3))
    np.testing.assert_array_equal(run.positions(), motion())
    np.testing.assert_array_equal(run.velocities(), speed())
    np.testing.assert_array_equal(run.time, TIME)
    np.testing.assert_array_equal(run.channel("q"), TIME[:, None] * [1, 2])
    assert run.channel_columns("q") == ("q0", "q1")
    assert any("step ()" in note for note in run.notes)


@pytest.mark.parametrize(
    ("arrays", "options"),
    [
        ({"t": TIME, "pos": motion().reshape(T, -1)}, {}),
        ({"t_ms": TIME * 1e3, "positions": motion()}, {}),
        ({"time": TIME * 1e3, "xyz": motion()}, {"time_unit": "ms"}),
        ({"clock": TIME[:, None], "odd": motion()}, {"time_key": "clock"}),
        ({"t": TIME, "a": motion(), "b": -motion()}, {"position_key": "a"}),
        ({"links": motion()}, {"dt": 0.025}),
        ({"T": TIME, "Pos": motion()}, {}),
    ],
    ids=["flat", "ms-name", "ms-option", "time-key", "position-key", "dt", "capitals"],
)
def test_npz_variants(pb_import, save_npz, arrays, options):
    run = pb_import(save_npz(**arrays), **options)
    np.testing.assert_allclose(run.positions(), motion(), atol=1e-15)
    np.testing.assert_allclose(run.time, TIME, atol=1e-12)


def test_npz_units_input_and_single_precision(pb_import, save_npz):
    path = save_npz(
        t=TIME.astype("f4"), pos=1e3 * motion(), u=np.sin(TIME), plane=motion()[..., :2]
    )
    run = pb_import(path, unit="mm", input_key="u", input_unit="N*m", input_quantity="torque")
    np.testing.assert_allclose(run.positions(unit="m"), motion(), atol=1e-12)
    np.testing.assert_array_equal(run.time, TIME)  # float32 times are put back on k/40
    drive = run.input("u")
    np.testing.assert_array_equal(drive.value[:, 0], np.sin(TIME))
    assert (drive.unit, drive.quantity) == ("N*m", "torque")


def test_two_dimensions_stay_two(pb_import, save_npz):
    run = pb_import(save_npz(t=TIME, pos=motion()[..., :2]))
    assert run.dims == 2


def test_cloth(pb_import, data):
    run = pb_import(data / "cloth_drop.npz")
    saved = np.load(data / "cloth_drop.npz")
    np.testing.assert_array_equal(run.positions(), saved["vertices"])
    np.testing.assert_array_equal(run.indices("faces"), saved["obj_faces"])
    assert run.dt == pytest.approx(1 / 240)
    assert any("render_vertices_t0" in note for note in run.notes)


def test_truth_files_are_user_files_too(pb_import, data):
    run = pb_import(data / "pendulum5_chain_truth.npz")
    saved = np.load(data / "pendulum5_chain_truth.npz")
    np.testing.assert_array_equal(run.positions(), saved["pos"])
    kuka = pb_import(data / "kuka_ik_circle_truth.npz", input_key="q_target", input_unit="rad")
    assert kuka.input("q_target").value.shape == (1201, 7)


@pytest.mark.parametrize(
    ("arrays", "options", "kind", "words"),
    [
        ({"t": TIME, "a": motion(), "b": motion()}, {}, ConfigError, "several arrays.*: a, b"),
        ({"t": TIME, "q": TIME}, {}, NotATrajectory, "no array looks like positions"),
        ({"pos": motion()}, {}, MissingData, "nothing tells the time"),
        ({"t": TIME[:-1], "pos": motion()}, {}, SchemaError, r"time has shape \(39,\)"),
        ({"t": TIME[::-1], "pos": motion()}, {}, SchemaError, "does not increase at frame 1"),
        ({"t": TIME, "pos": motion().swapaxes(1, 2)}, {}, SchemaError, "as PyElastica stores"),
        ({"t": TIME, "pos": motion()}, {"dt": 0.1}, ConfigError, "off that clock"),
        ({"t": TIME, "pos": motion()}, {"position_key": "x"}, ConfigError, "there is no 'x'"),
        ({"t": TIME, "pos": motion()}, {"time_key": "x"}, ConfigError, "there is no 'x'"),
        ({"t": TIME, "pos": motion()}, {"input_key": "x"}, ConfigError, "there is no 'x'"),
        ({"t": TIME, "pos": motion(), "u": TIME[1:]}, {"input_key": "u"}, SchemaError,
         "input has shape"),
        ({"t": TIME, "pos": np.where(TIME[:, None, None] > 0.5, np.nan, motion())}, {}, Diverged,
         "node 0 is nan in frame 21"),
        ({"t": TIME, "pos": np.array([["a"]])}, {}, SchemaError, "shape .*type"),
    ],
)  # fmt: skip
def test_npz_refusals(pb_import, save_npz, arrays, options, kind, words):
    with pytest.raises(kind, match=words):
        pb_import(save_npz(**arrays), **options)


def test_npz_with_objects(pb_import, save_npz):
    with pytest.raises(UnsafeFile, match="holds Python objects"):
        pb_import(save_npz(t=TIME, pos=np.array([{}], dtype=object)))


# --- pickle ------------------------------------------------------------------------------------


def test_laikago_pickle(pb_import, data):
    with pytest.raises(UntrustedPickle, match="this is a pickle"):
        pb_import(data / "laikago_replay_user.pkl")
    run = pb_import(data / "laikago_replay_user.pkl", trust=True)
    steps = pickle.loads((data / "laikago_replay_user.pkl").read_bytes())
    np.testing.assert_array_equal(run.positions(), np.array([s["links"] for s in steps], "f8"))
    np.testing.assert_array_equal(run.channel("q"), [s["q"] for s in steps])
    assert (run.n_frames, run.n_nodes, run.dt) == (500, 16, pytest.approx(0.004))


@pytest.mark.parametrize(
    "value",
    [
        [{"t": t, "pos": x} for t, x in zip(TIME, motion(), strict=True)],
        [OrderedDict(t=float(t), pos=x.tolist()) for t, x in zip(TIME, motion(), strict=True)],
        [(float(t), x) for t, x in zip(TIME, motion(), strict=True)],
        {"t": list(TIME), "pos": motion()},
    ],
    ids=["dicts", "lists", "tuples", "arrays"],
)
def test_pickles(pb_import, save_pickle, value):
    run = pb_import(save_pickle(value), trust=True)
    np.testing.assert_array_equal(run.positions(), motion())
    np.testing.assert_array_equal(run.time, TIME)


def test_pose_tuples_without_time(pb_import, save_pickle):
    """What ``poses.append(p.getBasePositionAndOrientation(body))`` leaves behind."""
    poses = [(tuple(x[0]), (0.0, 0.0, 0.0, 1.0)) for x in motion()]
    path = save_pickle(poses)
    with pytest.raises(MissingData, match="nothing tells the time"):
        pb_import(path, trust=True)
    run = pb_import(path, trust=True, dt=0.025)
    np.testing.assert_array_equal(run.positions()[:, 0], motion()[:, 0])
    np.testing.assert_array_equal(run.channel("orientation")[:, 3], 1.0)


@pytest.mark.parametrize(
    ("value", "kind", "words"),
    [
        (3, NotATrajectory, "holds a int"),
        ([{"t": 0}, {"t": 1, "x": 2}], SchemaError, "step 1 differs from step 0 in its keys: x"),
        ([(0, 1), (0, 1, 2)], SchemaError, "step 1 has 3 entries, step 0 has 2"),
        ([{"t": 0, "pos": [1]}, {"t": 1, "pos": [1, 2]}], SchemaError, "changes from step to"),
        ([{"t": "x"}, {"t": "y"}], SchemaError, "not numbers"),
    ],
)
def test_pickle_refusals(pb_import, save_pickle, value, kind, words):
    with pytest.raises(kind, match=words):
        pb_import(save_pickle(value), trust=True)


def test_hostile_pickle(pb_import, tmp_path):
    path = tmp_path / "bomb.pkl"
    path.write_bytes(b"cos\nsystem\n(S'true'\ntR.")
    with pytest.raises(UnsafeFile, match=r"asks for os\.system"):
        pb_import(path, trust=True)


# --- CSV ---------------------------------------------------------------------------------------


def test_r2d2_csv(pb_import, data):
    run = pb_import(data / "r2d2_base.csv")
    truth = np.load(data / "r2d2_drive_truth_every4.npz")
    assert (run.n_frames, run.n_nodes) == (721, 1)
    np.testing.assert_allclose(run.positions()[::4, 0], truth["r2d2_base_pos"], atol=6e-7)
    np.testing.assert_allclose(run.channel("orientation")[::4], truth["r2d2_base_orn"], atol=6e-7)
    # Printed with six decimals, the times alone would not be evenly spaced.
    np.testing.assert_allclose(run.time, np.arange(721) / 240, atol=1e-12)
    assert run.uniform
    assert any("rounded in the file" in note for note in run.notes)


def table(header, columns, fmt="%.17g", **kwargs):
    rows = "\n".join(",".join(fmt % v for v in row) for row in np.stack(columns, axis=1))
    return f"{header}\n{rows}\n"


@pytest.mark.parametrize(
    ("header", "labels"),
    [
        ("t,a_x,a_y,a_z,b_x,b_y,b_z", ["a", "b"]),
        ("time,x0,y0,z0,x1,y1,z1", ["0", "1"]),
        ("t,cube1.posX,cube1.posY,cube1.posZ,cube2.posX,cube2.posY,cube2.posZ", ["cube1", "cube2"]),
    ],
)
def test_bodies_side_by_side(pb_import, save_text, header, labels):
    run = pb_import(save_text(table(header, [TIME, *motion(2).reshape(T, 6).T])))
    np.testing.assert_array_equal(run.positions(), motion(2))
    assert list(run.node("label")) == labels


def test_bodies_below_each_other(pb_import, save_text):
    time, body = np.repeat(TIME, 2), np.tile([3, 8], T)
    x, v = motion(2).reshape(-1, 3), speed(2).reshape(-1, 3)
    quaternion = np.tile([0, 0, 0, 1], (2 * T, 1))
    header = "t,body,x,y,z,qx,qy,qz,qw,vx,vy,vz"
    text = table(header, [time, body, *x.T, *quaternion.T, *v.T])
    run = pb_import(save_text(text))
    np.testing.assert_array_equal(run.positions(), motion(2))
    np.testing.assert_array_equal(run.velocities(), speed(2))
    assert list(run.node("label")) == ["body3", "body8"]
    assert set(run.channels) == {"body3.orientation", "body8.orientation"}
    with pytest.raises(SchemaError, match="79 rows for 40 instants and 2 bodies"):
        pb_import(save_text(text.rsplit("\n", 2)[0] + "\n"))


def test_csv_rows_as_frames(pb_import, save_text):
    path = save_text(table("x;y;z".replace(";", ","), [*motion(1).reshape(T, 3).T]))
    with pytest.raises(MissingData, match="no column tells the time"):
        pb_import(path)
    np.testing.assert_allclose(pb_import(path, dt=0.025, t0=1.0).time, 1 + TIME)


def test_csv_extra_columns_and_input(pb_import, save_text):
    path = save_text(table("t,x,y,z,torque,gap", [TIME, *motion(1)[:, 0].T, TIME**2, -TIME]))
    run = pb_import(path, input_key="torque", input_unit="N*m")
    np.testing.assert_array_equal(run.input("torque").value[:, 0], TIME**2)
    np.testing.assert_array_equal(run.channel("gap")[:, 0], -TIME)


@pytest.mark.parametrize(
    ("text", "kind", "words"),
    [
        ("t,x,y,z\n0,0,0,0\n0.1,1,2\n", UnreadableFile, "line 3 has 3 cells, the header has 4"),
        ("t,x,y,z\n0,0,0,zero\n", UnreadableFile, "line 2: could not convert"),
        ("t,x,y,z\n", UnreadableFile, "there are no rows"),
        ("t,x,y\n0,1,2\n", NotATrajectory, "no columns x, y, z"),
        ("body,x,y,z\n0,1,2,3\n", MissingData, "no column tells the time"),
        ("t,x,y,z\n0,0,0,0\n0,1,1,1\n", SchemaError, "does not increase at frame 1"),
    ],
)
def test_csv_refusals(pb_import, save_text, text, kind, words):
    with pytest.raises(kind, match=words):
        pb_import(save_text(text))
