"""Soft bodies, contacts, and bodies of which PyBullet tells less than of others."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import ConfigError, UnreadableFile, UnsupportedScene
from openprc.hooks import record_run

N = 5  # vertices along an edge of the cloth


def write_cloth(folder, *, quads=False):
    """Write a square cloth in the plane z = 0, 1 m wide, and return its path."""
    lines = [f"v {i / (N - 1)} {j / (N - 1)} 0" for j in range(N) for i in range(N)]
    for j in range(N - 1):
        for i in range(N - 1):
            a = j * N + i + 1
            square = (a, a + 1, a + N + 1, a + N)
            if quads:
                lines.append("f " + " ".join(map(str, square)))
            else:
                lines += [f"f {a} {a + 1} {a + N + 1}", f"f {a} {a + N + 1} {a + N}"]
    path = folder / "cloth.obj"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.fixture
def cloth(world, tmp_path):
    """A falling cloth in a deformable world."""
    p, start = world
    client = start()
    p.resetSimulation(p.RESET_USE_DEFORMABLE_WORLD, physicsClientId=client)
    p.setGravity(0, 0, -9.81, physicsClientId=client)
    mesh = write_cloth(tmp_path)
    body = p.loadSoftBody(
        str(mesh), basePosition=(0, 0, 1), mass=0.5, useMassSpring=1, useBendingSprings=1,
        springElasticStiffness=40, springDampingStiffness=0.1, physicsClientId=client,
    )  # fmt: skip
    return p, client, body, mesh


def notes(run):
    return list(run.provenance["notes"])


def test_a_cloth_is_recorded_vertex_by_vertex(cloth, tmp_path, recorded):
    p, client, body, mesh = cloth
    flag = p.MESH_DATA_SIMULATION_MESH
    live = []
    with record_run(
        client, tmp_path / "run.h5", producer="pybullet", soft={body: {"mesh": mesh, "mass": 0.5}}
    ) as session:
        for _ in range(40):
            live.append(p.getMeshData(body, -1, flags=flag, physicsClientId=client)[1])
            session.step()
    run = recorded()
    assert np.array_equal(run.positions()[:-1], np.array(live))
    assert run.positions()[-1, :, 2].mean() < 0.9
    assert run.indices("faces").shape == (2 * (N - 1) ** 2, 3)
    sides = run.positions()[0][run.indices("faces")]
    areas = np.linalg.norm(np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0]), axis=1)
    assert areas.sum() / 2 == pytest.approx(1.0, abs=1e-6)
    assert run.node("mass").tolist() == [0.5 / N**2] * N**2
    assert run.node("label")[3] == f"body{body}.v3"
    assert not run.has("/time_series/nodes/velocities")
    assert any("no velocities of soft body" in note for note in notes(run))


def test_a_cloth_without_its_mesh(cloth, tmp_path, recorded):
    _, client, _, _ = cloth
    with record_run(client, tmp_path / "run.h5", producer="pybullet") as session:
        session.step()
    run = recorded()
    assert run.n_nodes == N**2
    assert "faces" not in run.element_kinds
    assert not run.has("/topology/nodes/mass")
    for words in ("no faces of soft body", "no masses"):
        assert any(words in note for note in notes(run))


def test_cloth_and_ball_in_one_file(cloth, tmp_path, recorded):
    p, client, body, mesh = cloth
    ball = p.createMultiBody(1.0, basePosition=(0, 0, 3), physicsClientId=client)
    with record_run(
        client, tmp_path / "run.h5", producer="pybullet", bodies=[body, ball], soft={body: mesh}
    ) as session:
        for _ in range(20):
            session.step()
    run = recorded()
    assert run.n_nodes == N**2 + 1
    owners = run.extension("openprc-pybullet", "node_body_link")
    rigid = int(np.flatnonzero(owners[:, 0] == ball)[0])
    assert np.isfinite(run.velocities()[:, rigid]).all()
    assert np.isnan(np.delete(run.velocities(), rigid, axis=1)).all()
    assert np.isfinite(run.positions()).all()
    assert run.indices("faces").min() == 1  # the ball comes first
    assert (run.observed() == 1).all()


def test_a_soft_body_without_vertices_is_refused_before_it_crashes(world, tmp_path):
    p, start = world
    client = start()
    p.resetSimulation(p.RESET_USE_DEFORMABLE_WORLD, physicsClientId=client)
    p.createMultiBody(1.0, physicsClientId=client)
    hollow = p.loadSoftBody(
        str(write_cloth(tmp_path)), simFileName="missing.vtk", mass=1, physicsClientId=client
    )
    with pytest.raises(UnsupportedScene, match=f"soft body {hollow} has no simulated vertices"):
        record_run(client, tmp_path / "run.h5", producer="pybullet", bodies=[0])


@pytest.mark.parametrize(("text", "words"), [
    ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "3 vertices, and the body has 25"),
    ("f 1 2\n", "line 1 is no face: 'f 1 2'"),
    ("f a b c\n", "line 1 is no face"),
    ("f 0 1 2\n", "line 1 is no face"),
    ("v 0 0 0\n" * 25 + "f 1 2 26\n", "a face names vertex 26 of 25"),
    ("v 0 0 0\n" * 25 + "f 1 2 -26\n", "line 26 is no face"),
])  # fmt: skip
def test_another_mesh(cloth, tmp_path, text, words):
    _, client, body, _ = cloth
    other = tmp_path / "other.obj"
    other.write_text(text)
    with pytest.raises(UnreadableFile, match=words) as raised:
        record_run(client, tmp_path / "run.h5", producer="pybullet", soft={body: other})
    assert f"soft={{{body}: None}}" in raised.value.fix
    assert not list(tmp_path.glob("run*"))


def test_a_mesh_that_is_no_obj(cloth, tmp_path):
    _, client, body, _ = cloth
    other = tmp_path / "cloth.vtk"
    other.write_text("# vtk DataFile Version 2.0\n")
    with pytest.raises(UnreadableFile, match=r"it is no Wavefront \.obj"):
        record_run(client, tmp_path / "run.h5", producer="pybullet", soft={body: other})


def test_squares_become_triangles_and_indices_may_count_backwards(cloth, tmp_path, recorded):
    _, client, body, _ = cloth
    mesh = write_cloth(tmp_path, quads=True)
    mesh.write_text(mesh.read_text() + f"f -{N * N}/1/1 2//3 3/4\nf 1 1 2\n")
    with record_run(client, tmp_path / "run.h5", producer="pybullet", soft={body: mesh}) as session:
        session.step()
    faces = recorded().indices("faces").tolist()
    assert len(faces) == 2 * (N - 1) ** 2 + 1  # a triangle with a corner twice is none
    assert faces[:2] == [[0, 1, N + 1], [0, N + 1, N]]
    assert faces[-1] == [0, 1, 2]


@pytest.mark.parametrize("by", [True, "bodies", "links"])
def test_contacts_carry_the_weight(world, tmp_path, recorded, by):
    p, start = world
    client = start()
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=(0.1, 0.1, 0.1), physicsClientId=client)
    floor = p.createCollisionShape(p.GEOM_BOX, halfExtents=(2, 2, 0.1), physicsClientId=client)
    p.createMultiBody(0.0, floor, basePosition=(0, 0, -0.1), physicsClientId=client)
    for k in range(2):  # one on top of the other
        p.createMultiBody(2.0, box, basePosition=(0, 0, 0.1 + 0.2 * k), physicsClientId=client)
    with record_run(client, tmp_path / "run.h5", producer="pybullet", contacts=by) as session:
        for _ in range(480):
            session.step()
    run = recorded()
    weight = 2.0 * 9.81
    normal = run.channel("contact_normal_force")[-60:].mean(axis=0)
    # Two weights from below and one from above on the lower box, one on the upper.
    assert normal == pytest.approx([3 * weight, weight], rel=0.01)
    total = run.channel("contact_force")[-60:].mean(axis=0).reshape(2, 3)
    assert total[:, 2] == pytest.approx([weight, weight], rel=0.01)
    assert np.abs(total[:, :2]).max() < 0.01 * weight
    assert run.channel("contact_count")[-1].tolist() == [8, 4]
    assert run.channel("contact_count")[0].tolist() == [0, 0]
    names = run.channel_columns("contact_count")
    assert names == (("body1", "body2") if by != "links" else tuple(run.node("label").tolist()))


def test_contacts_of_soft_bodies_are_not_told(cloth, tmp_path):
    _, client, _, _ = cloth
    with pytest.raises(ConfigError, match="contacts of soft bodies were asked for"):
        record_run(client, tmp_path / "run.h5", producer="pybullet", contacts=True)


def test_static_bodies_are_left_out_unless_named(world, tmp_path, recorded):
    p, start = world
    client = start()
    ground = p.createMultiBody(0.0, physicsClientId=client)
    ball = p.createMultiBody(1.0, physicsClientId=client)
    for k, bodies in enumerate((None, [ball, ground])):
        path = tmp_path / f"{k}.h5"
        with record_run(client, path, producer="pybullet", bodies=bodies) as session:
            session.step()
    assert recorded(tmp_path / "0.h5").n_nodes == 1
    assert any(f"left out bodies {ground}" in note for note in notes(recorded(tmp_path / "0.h5")))
    both = recorded(tmp_path / "1.h5")
    assert both.node("fixed").tolist() == [0, 1]
    assert both.extension("openprc-pybullet", "node_body_link").tolist() == [[1, -1], [0, -1]]


def test_a_base_that_the_script_moves(world, tmp_path, recorded):
    p, start = world
    client = start()
    table = p.createMultiBody(0.0, physicsClientId=client)
    with record_run(client, tmp_path / "run.h5", producer="pybullet", bodies=[table]) as session:
        for step in range(5):
            p.resetBasePositionAndOrientation(
                table, (0.1 * step, 0, 0), (0, 0, 0, 1), physicsClientId=client
            )
            session.step()
    run = recorded()
    assert run.positions()[:, 0, 0] == pytest.approx([0, 0, 0.1, 0.2, 0.3, 0.4])
    assert any("the script moved them" in note for note in notes(run))


MIXED = """<robot name="cart">
<link name="rail"><inertial><mass value="0"/><inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0"
 iyz="0"/></inertial></link>
{links}
</robot>"""
LINK = """<link name="{name}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0"
 ixz="0" iyz="0"/></inertial></link><joint name="to_{name}" type="{type}"><parent link="{parent}"/>
 <child link="{name}"/><axis xyz="1 0 0"/><origin xyz="0 0 1"/>
 <limit lower="-9" upper="9" effort="9" velocity="9"/></joint>"""


def write_cart(folder):
    """Write a model with a sliding, a welded, a turning and a ball joint in a row."""
    rows = [("cart", "prismatic"), ("post", "fixed"), ("arm", "revolute"), ("bob", "spherical")]
    parents = ["rail", *(name for name, _ in rows)]
    links = [
        LINK.format(name=name, type=kind, parent=parent)
        for (name, kind), parent in zip(rows, parents, strict=False)
    ]
    path = folder / "cart.urdf"
    path.write_text(MIXED.format(links="\n".join(links)))
    return path


def test_joints_of_all_kinds(world, tmp_path, recorded):
    p, start = world
    client = start()
    cart = p.loadURDF(str(write_cart(tmp_path)), useFixedBase=True, physicsClientId=client)
    p.resetJointState(cart, 0, 0.25, physicsClientId=client)
    p.resetJointState(cart, 2, 0.5, physicsClientId=client)
    with record_run(client, tmp_path / "run.h5", producer="pybullet") as session:
        for _ in range(5):
            session.step()
        joints = p.getJointStates(cart, [0, 2], client)
    run = recorded()
    for k, letter in enumerate("qu"):
        assert run.channel(f"body0.{letter}")[-1].tolist() == [joints[1][k]]
        assert run.channel(f"body0.{letter}_prismatic")[-1].tolist() == [joints[0][k]]
    assert run.channel("body0.t")[-1].tolist() == [joints[1][3]]
    assert run.channel_columns("body0.q_prismatic") == ("body0.q0",)
    assert run.channel_columns("body0.q") == ("body0.q1",)
    units = [run.unit(f"/time_series/channels/body0.{name}") for name in ("q", "q_prismatic", "t")]
    assert units == ["rad", "m", "N*m"]
    names = run.extension("openprc-pybullet", "body0.joints").tolist()
    assert names == ["to_cart", "to_arm"]
    assert any("joints to_bob of body 0 turn in several ways" in note for note in notes(run))
    assert run.n_nodes == 5


def test_joint_channels_may_be_left_out(world, tmp_path, recorded):
    p, start = world
    client = start()
    p.loadURDF(str(write_cart(tmp_path)), useFixedBase=True, physicsClientId=client)
    with record_run(client, tmp_path / "run.h5", producer="pybullet", joints=False) as session:
        session.step()
    assert recorded().channels == ("body0.omega", "body0.orientation")


def test_maximal_coordinates(world, tmp_path, recorded):
    p, start = world
    client = start()
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1, physicsClientId=client)
    ball = p.createMultiBody(
        1.0, shape, basePosition=(0, 0, 1), useMaximalCoordinates=True, physicsClientId=client
    )
    live = []
    with record_run(client, tmp_path / "run.h5", producer="pybullet") as session:
        for _ in range(10):
            session.step()
            live.append(p.getBasePositionAndOrientation(ball, client)[0])
    run = recorded()
    assert np.array_equal(run.positions()[1:, 0], np.array(live))
    assert run.positions()[-1, 0, 2] < 1
    assert any("maximal coordinates" in note for note in notes(run))


def test_links_of_one_name_are_numbered(world, tmp_path, recorded):
    p, start = world
    client = start()
    p.createMultiBody(
        1.0,
        linkMasses=[1, 1],
        linkCollisionShapeIndices=[-1, -1],
        linkVisualShapeIndices=[-1, -1],
        linkPositions=[(0, 0, 1)] * 2,
        linkOrientations=[(0, 0, 0, 1)] * 2,
        linkInertialFramePositions=[(0, 0, 0)] * 2,
        linkInertialFrameOrientations=[(0, 0, 0, 1)] * 2,
        linkParentIndices=[0, 1],
        linkJointTypes=[p.JOINT_REVOLUTE] * 2,
        linkJointAxis=[(1, 0, 0)] * 2,
        physicsClientId=client,
    )
    with record_run(client, tmp_path / "run.h5", producer="pybullet"):
        pass
    labels = recorded().node("label").tolist()
    assert len(set(labels)) == 3
    assert all(label.startswith("body0.") for label in labels)
    assert recorded().n_frames == 1
