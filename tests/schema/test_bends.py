"""Bends in geometry.h5 and simulation.h5: three-node bending springs."""

from dataclasses import replace

import h5py
import numpy as np
import pytest
from experiments import experiment, geometry

from openprc.errors import ConfigError
from openprc.schema import Trajectory, TrajectoryWriter, validate_file
from openprc.schema.bend_angle import bend_angles
from openprc.schema.experiment import load_experiment, save_experiment
from openprc.schema.geometry import Bends, Geometry
from openprc.schema.provenance import Provenance

NAN = float("nan")
#: A corner at node 1, a straight line 0-1-2, node 4 on top of node 1, node 5 beyond node 0.
NODES = [[-1, 0, 0], [0, 0, 0], [2, 0, 0], [0, 1, 0], [0, 0, 0], [-2, 0, 0]]


def bent(**columns):
    given = {"indices": [[0, 1, 3]], "stiffness": [2.0]} | columns
    return Geometry(positions=NODES, masses=np.ones(6), bends=Bends(**given))


# --- geometry.h5 ------------------------------------------------------------------------------


def test_bends_are_straight_and_undamped_unless_told():
    bends = Bends(indices=[[0, 1, 2], [1, 2, 3]], stiffness=[1.0, 2.0])
    assert len(bends) == 2
    assert bends.rest_angle.tolist() == [np.pi, np.pi]
    assert bends.damping.tolist() == [0.0, 0.0]
    assert len(geometry().bends) == 0
    with pytest.raises(ValueError, match="read-only"):
        bends.stiffness[0] = 3.0


def test_what_is_saved_is_loaded(tmp_path):
    bends = Bends(
        indices=[[0, 1, 3], [2, 1, 3]],
        stiffness=[0.1, 0.3],
        rest_angle=[np.pi, 1.0 / 3.0],
        damping=[0.0, 1e-3],
    )
    scene = experiment(geometry=replace(bent(), bends=bends), actuators=())
    save_experiment(scene, tmp_path)
    loaded = load_experiment(tmp_path).geometry.bends
    for name in ("indices", "stiffness", "rest_angle", "damping"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(bends, name))


def test_without_bends_the_file_has_none(tmp_path):
    save_experiment(experiment(), tmp_path)
    with h5py.File(tmp_path / "input/geometry.h5") as file:
        assert "elements/bends" not in file


def test_units_are_stored_and_converted_and_columns_have_defaults(tmp_path):
    scene = experiment(geometry=bent(damping=[0.5]), actuators=())
    save_experiment(scene, tmp_path)
    with h5py.File(tmp_path / "input/geometry.h5", "r+") as file:
        group = file["elements/bends"]
        assert {name: group[name].attrs.get("unit") for name in group} == {
            "indices": None,
            "stiffness": "N*m/rad",
            "rest_angle": "rad",
            "damping": "N*m*s/rad",
        }
        group["stiffness"].attrs["unit"] = "N*mm/rad"
        group["rest_angle"][...] = 90.0
        group["rest_angle"].attrs["unit"] = "deg"
        del group["damping"]
    loaded = load_experiment(tmp_path).geometry.bends
    np.testing.assert_allclose(loaded.stiffness, 2e-3, rtol=1e-15)
    np.testing.assert_allclose(loaded.rest_angle, np.pi / 2.0, rtol=1e-15)
    assert loaded.damping.tolist() == [0.0]


MISTAKES = [
    ({"indices": [[0, 1]]}, "indices", r"shape \(1, 2\).*expected: \(E, 3\)"),
    ({"indices": [[0, 1, 9]]}, "indices", r"element 0 names node \[0, 1, 9\]"),
    ({"indices": [[0, 1, 0]]}, "indices", r"element 0 uses a node twice.*3 different nodes"),
    ({"indices": [[0, 1, 4]]}, "indices", "an arm of element 0 has no length"),
    ({"indices": [[0, 1, 5]]}, "indices", "the arms of element 0 lie on each other"),
    ({"stiffness": [1.0, 2.0]}, "stiffness", r"shape \(2,\)"),
    ({"stiffness": [-1.0]}, "stiffness", "-1 at element 0"),
    ({"stiffness": [NAN]}, "stiffness", "NaN or infinity at element 0"),
    ({"damping": [-2.0]}, "damping", "-2 at element 0"),
    ({"rest_angle": [0.0]}, "rest_angle", "0 rad at element 0.*above 0 and up to pi"),
    ({"rest_angle": [3.15]}, "rest_angle", "3.15 rad at element 0"),
    (
        {"indices": [[0, 1, 2]], "rest_angle": [3.0]},
        "rest_angle",
        "element 0 starts straight and rests at 3 rad.*move the vertex a little off",
    ),
]


@pytest.mark.parametrize(("columns", "key", "words"), MISTAKES)
def test_mistakes(tmp_path, columns, key, words):
    with pytest.raises(ConfigError, match=f"(?s){words}") as caught:
        save_experiment(experiment(geometry=bent(**columns), actuators=()), tmp_path)
    assert caught.value.key == f"elements/bends/{key}"
    assert list(tmp_path.iterdir()) == []


def test_straight_bends_may_start_straight_in_any_direction(tmp_path):
    direction = np.array([0.3, -0.7, 0.64807407])
    nodes = np.arange(3)[:, None] * direction / 3.0
    bends = Bends(indices=[[0, 1, 2]], stiffness=[1.0])
    body = Geometry(positions=nodes, masses=np.ones(3), bends=bends)
    save_experiment(experiment(geometry=body, actuators=()), tmp_path)
    assert len(load_experiment(tmp_path).geometry.bends) == 1


# --- the angle ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "turn", [0.0, 1e-12, 1e-9, 1e-6, 1e-3, 1.0, 2.0, np.pi - 1e-3, np.pi - 1e-9]
)
def test_angles_are_exact_from_straight_to_folded(turn):
    nodes = np.array([[-1.5, 0, 0], [0, 0, 0], [0.5 * np.cos(turn), 0.5 * np.sin(turn), 0]])
    angle = bend_angles(nodes[None], np.array([[0, 1, 2]]))[0, 0]
    assert angle == pytest.approx(np.pi - turn, rel=0, abs=1e-15)


def test_angles_do_not_depend_on_pose_scale_and_order_of_ends():
    rng = np.random.default_rng(3)
    nodes = rng.standard_normal((40, 3, 3))
    turned = 1e3 * nodes @ np.linalg.qr(rng.standard_normal((3, 3)))[0] + rng.standard_normal(3)
    row = np.array([[0, 1, 2]])
    angles = bend_angles(nodes, row)
    np.testing.assert_allclose(bend_angles(nodes, row[:, ::-1]), angles, rtol=0, atol=1e-15)
    np.testing.assert_allclose(bend_angles(turned, row), angles, rtol=0, atol=1e-13)
    u, v = nodes[:, 0] - nodes[:, 1], nodes[:, 2] - nodes[:, 1]
    cosine = np.sum(u * v, axis=1) / np.linalg.norm(u, axis=1) / np.linalg.norm(v, axis=1)
    np.testing.assert_allclose(np.cos(angles[:, 0]), cosine, rtol=0, atol=1e-14)


# --- simulation.h5 ------------------------------------------------------------------------------


def test_recorded_bends_are_read_back_and_valid(tmp_path):
    path = tmp_path / "run.h5"
    angles = np.linspace(3.0, 2.0, 4)[:, None]
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_nodes(3, 3, unit="m", rest=np.array(NODES[:3], dtype=float))
        writer.declare_elements(
            "bends",
            [[0, 1, 2]],
            series={"angle": "rad"},
            static={"stiffness": ([2.0], "N*m/rad"), "rest_angle": ([np.pi], "rad")},
        )
        for t, angle in enumerate(angles):
            writer.append(
                float(t), positions=np.array(NODES[:3], float), elements={("bends", "angle"): angle}
            )
    found = validate_file(path)
    assert found.ok
    assert not [finding for finding in found.findings if "bends" in finding.path]
    with Trajectory(path) as run:
        assert run.element_kinds == ("bends",)
        np.testing.assert_array_equal(run.indices("bends"), [[0, 1, 2]])
        np.testing.assert_array_equal(run.element("bends", "angle"), angles)
        np.testing.assert_array_equal(run.element_static("bends", "stiffness"), [2.0])
