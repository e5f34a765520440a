"""Models whose links stand elsewhere when a script loads them in another way."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import ConfigError

INERTIA = '<inertia ixx="{0}" iyy="{1}" izz="{2}" ixy="0.03" ixz="0.01" iyz="-0.02"/>'
LINK = """<link name="{name}"><inertial><origin xyz="0.1 0.2 -0.1" rpy="0.3 0.1 0.2"/>
<mass value="1"/>{inertia}</inertial></link>"""
JOINT = """<joint name="to_{name}" type="{kind}"><parent link="{parent}"/><child link="{name}"/>
<origin xyz="0.5 0.6 0.7" rpy="0.1 0.2 0.3"/><axis xyz="0 0.6 0.8"/></joint>"""


def write_model(folder, *, skew=True):
    """Write a body of four links; with `skew` its principal axes are not those of the links."""
    inertia = INERTIA.format(0.1, 0.15, 0.2)
    if not skew:
        inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    names = ("body", "shin", "foot", "arm")
    links = [LINK.format(name=name, inertia=inertia) for name in names]
    # In the file the arm comes before the foot; in the tree the foot comes before the arm.
    joints = [
        JOINT.format(name="shin", parent="body", kind="continuous"),
        JOINT.format(name="arm", parent="body", kind="continuous"),
        JOINT.format(name="foot", parent="shin", kind="fixed"),
    ]
    path = folder / "walker.urdf"
    order = [links[0], links[3], links[1], links[2]]
    path.write_text(f'<robot name="walker">{"".join([*order, *joints])}</robot>')
    return path


@pytest.fixture
def log(world, tmp_path):
    """Simulate a tumbling body, log it, and return the log and what the API told."""
    p, start = world

    def make(model, *, flags=0, scale=1.0):
        client = start()
        body = p.loadURDF(
            str(model), (0, 0, 1), flags=flags, globalScaling=scale, physicsClientId=client
        )
        n = p.getNumJoints(body, client)
        p.setJointMotorControlArray(
            body, range(n), p.VELOCITY_CONTROL, forces=[0.0] * n, physicsClientId=client
        )
        p.resetBaseVelocity(body, (1, 0, 2), (1, 2, 3), physicsClientId=client)
        path = tmp_path / "walker.log"
        logger = p.startStateLogging(
            p.STATE_LOGGING_GENERIC_ROBOT, str(path), physicsClientId=client
        )
        live = []
        for _ in range(60):
            p.stepSimulation(physicsClientId=client)
            base = p.getBasePositionAndOrientation(body, client)[0]
            links = p.getLinkStates(body, range(n), 1, 1, client)
            live.append([base, *(state[0] for state in links)])
        p.stopStateLogging(logger, client)
        return path, np.array(live)

    return make


@pytest.mark.parametrize("flag", [
    "URDF_USE_INERTIA_FROM_FILE", "URDF_MAINTAIN_LINK_ORDER", "URDF_MERGE_FIXED_LINKS",
])  # fmt: skip
def test_flags_of_loading(world, log, pb_import, tmp_path, flag):
    p, _ = world
    model = write_model(tmp_path)
    path, live = log(model, flags=getattr(p, flag))
    run = pb_import(path, urdf=(str(model),), urdf_flags=(flag,))
    assert run.positions() == pytest.approx(live, abs=1e-6)
    # Without the flag they are elsewhere, and unless links are missing the import says so.
    other = pb_import(path, urdf=(str(model),))
    if other.n_nodes == run.n_nodes:
        assert np.abs(other.positions() - live).max() > 0.05
        assert any(flag in note and "urdf_flags" in note for note in other.notes)
    assert not any(f"with {flag}" in note for note in run.notes)


def test_a_scaled_model(log, pb_import, tmp_path):
    model = write_model(tmp_path)
    path, live = log(model, scale=2.5)
    run = pb_import(path, urdf=(str(model),), urdf_scale=2.5)
    assert run.positions() == pytest.approx(live, abs=2e-6)


def test_nothing_is_said_where_flags_make_no_difference(log, pb_import, tmp_path):
    text = write_model(tmp_path, skew=False).read_text()
    model = tmp_path / "straight.urdf"
    tail = text.index('<link name="arm">')
    foot = text.index('<link name="shin">')
    # The links in the order of the tree.
    model.write_text(
        text[:tail] + text[foot : text.index("<joint")] + text[tail:foot]
        + text[text.index("<joint") :]
    )  # fmt: skip
    path, live = log(model)
    run = pb_import(path, urdf=(str(model),))
    assert run.positions() == pytest.approx(live, abs=1e-6)
    assert not any("urdf_flags" in note for note in run.notes)


@pytest.mark.parametrize("scale", [0.0, -1.0, np.inf, np.nan])
def test_scales_that_are_none(log, pb_import, tmp_path, scale):
    model = write_model(tmp_path)
    with pytest.raises(ConfigError, match="urdf_scale is"):
        pb_import(log(model)[0], urdf=(str(model),), urdf_scale=scale)


def test_a_model_of_a_body_that_overflowed(
    pb_import, write_log, robot_header, robot_record, tmp_path
):
    full = [robot_record(step, body=0, pos=(0, 0, step)) for step in range(4)]
    path = write_log(robot_header(), *(record + b"\xaa\xbb" for record in full))
    with pytest.raises(ConfigError, match="body 1 is not imported") as raised:
        pb_import(path, urdf=(f"1={write_model(tmp_path)}",))
    assert "maxLogDof" in raised.value.fix
