"""Rigid motions and scales are found and taken out; mirror images are not slipped in."""

import numpy as np
import pytest
from compared_files import compared, motion, rotation, write

from openprc.compare.alignment.rigid_motion import fit_rigid_motion
from openprc.errors import MissingData

T = 0.01 * np.arange(300)
SHIFT = np.array([3.0, -1.0, 0.5])
DRIFT = np.array([0.0, 0.0, 0.2])


@pytest.fixture
def reference(tmp_path):
    return write(tmp_path / "reference.h5", T, motion(T)[0])


@pytest.mark.parametrize("kind", ["first", "all"])
def test_a_rotation_and_a_shift_are_found(tmp_path, reference, kind):
    # Other places y with x = R y + shift.
    y = (motion(T)[0] - SHIFT) @ rotation()
    pair = compared(reference, write(tmp_path / "o.h5", T, y), rigid_motion=kind, match="index")
    np.testing.assert_allclose(pair.transform.rotation, rotation(), atol=1e-13)
    np.testing.assert_allclose(pair.transform.shift, SHIFT, atol=1e-13)
    assert pair.rms < 1e-14
    assert pair.transform.scale == 1.0
    cosine = (np.trace(rotation()) - 1) / 2
    assert pair.transform.angle == pytest.approx(np.arccos(cosine), rel=1e-12)


def test_all_instants_give_the_least_squares(tmp_path, reference):
    rng = np.random.default_rng(2)
    y = (motion(T)[0] - SHIFT) @ rotation() + rng.normal(scale=0.05, size=(len(T), 6, 3))
    other = write(tmp_path / "o.h5", T, y)
    least = compared(reference, other, rigid_motion="all", match="index")
    first = compared(reference, other, rigid_motion="first", match="index")
    assert least.rms < first.rms
    assert least.rms == pytest.approx(0.05 * 3**0.5, rel=0.05)
    assert least.transform.rms == pytest.approx(least.rms, rel=1e-6)


def test_a_scale_is_fitted_where_asked_for(tmp_path, reference):
    y = (motion(T)[0] - SHIFT) @ rotation() * 800.0
    other = write(tmp_path / "o.h5", T, y, unit="px")
    pair = compared(reference, other, rigid_motion="all", scale="fit", match="index")
    assert pair.transform.scale == pytest.approx(1 / 800.0, rel=1e-12)
    assert pair.rms < 1e-13
    matched = compared(reference, other, rigid_motion="first", scale="fit")
    assert matched.rms < 1e-13


def test_a_mirror_image_is_refused_told_and_allowed(tmp_path, reference):
    y = motion(T)[0] * [1.0, -1.0, 1.0]
    other = write(tmp_path / "o.h5", T, y, frame="image")
    pair = compared(reference, other, rigid_motion="all", match="index")
    assert np.linalg.det(pair.transform.rotation) == pytest.approx(1.0)
    assert pair.rms > 0.1
    assert any("a mirror image would fit better" in note for note in pair.notes)
    allowed = compared(reference, other, rigid_motion="all", match="index", reflect=True)
    assert allowed.transform.reflected
    assert allowed.rms < 1e-14


def test_planar_bodies_turn_in_their_plane(tmp_path):
    x = motion(T)[0][..., :2]
    turn = np.array([[np.cos(2.0), -np.sin(2.0)], [np.sin(2.0), np.cos(2.0)]])
    files = [write(tmp_path / "a.h5", T, x), write(tmp_path / "b.h5", T, (x - 1.0) @ turn)]
    pair = compared(*files, rigid_motion="all", match="index")
    assert pair.rms < 1e-14
    assert pair.transform.angle == pytest.approx(2.0, rel=1e-12)


def test_far_from_the_origin_no_digits_are_lost(tmp_path):
    x = motion(T)[0] + 1e5
    y = (motion(T)[0] - SHIFT) @ rotation() - 3e5
    files = [write(tmp_path / "a.h5", T, x), write(tmp_path / "b.h5", T, y)]
    assert compared(*files, rigid_motion="all", match="index").rms < 1e-9


def test_velocities_turn_with_the_body(tmp_path):
    x, v = motion(T)
    reference = write(tmp_path / "r.h5", T, x, velocities=v)
    other = write(
        tmp_path / "o.h5",
        T,
        (x - SHIFT) @ rotation(),
        velocities=(v + DRIFT) @ rotation(),
    )
    pair = compared(reference, other, rigid_motion="all", velocities=True, match="index")
    assert pair.velocity_errors.rms == pytest.approx(0.2, rel=1e-9)
    bare = compared(reference, write(tmp_path / "n.h5", T, x), velocities=True)
    assert bare.velocity_errors is None
    assert any("velocities are not compared" in note for note in bare.notes)


def test_velocities_are_interpolated_like_places(tmp_path):
    t = 0.004 + 0.01 * np.arange(298)
    x, v = motion(T)
    reference = write(tmp_path / "r.h5", T, x, velocities=v)
    other = write(tmp_path / "o.h5", 1e3 * t, 1e3 * motion(t)[0], velocities=motion(t)[1],
                  unit="mm", time_unit="ms", velocity_unit="m/s")  # fmt: skip
    pair = compared(reference, other, velocities=True)
    assert pair.interpolant == "hermite"
    assert pair.rms < 1e-6
    assert pair.velocity_errors.rms < 1e-3


def test_missing_points_do_not_enter_the_motion(tmp_path, reference):
    y = (motion(T)[0] - SHIFT) @ rotation()
    seen = np.ones(y.shape[:2], dtype="u1")
    seen[:, 3] = 0
    seen[50:70, 1] = 0
    other = write(tmp_path / "o.h5", T, y, seen=seen)
    assert compared(reference, other, rigid_motion="all", match="index").rms < 1e-14


@pytest.mark.parametrize("direction", [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
def test_a_line_of_nodes_turns_by_the_least_angle(direction):
    s = np.linspace(0, 1, 5)[:, None]
    x, y = s * [1.0, 0, 0], s * np.asarray(direction) + 2.0
    found = fit_rigid_motion([(x[None], y[None])])
    np.testing.assert_allclose(found.apply(y[None])[0], x, atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(found.rotation), 1.0)
    assert found.angle == pytest.approx(np.arccos(direction[0]), abs=1e-12)
    assert "on a line" in found.notes[0]


def test_a_single_node_does_not_turn():
    found = fit_rigid_motion([(np.ones((4, 1, 3)), np.zeros((4, 1, 3)))])
    np.testing.assert_array_equal(found.rotation, np.eye(3))
    np.testing.assert_allclose(found.shift, 1.0)
    assert "coincide" in found.notes[0]


def test_elements_do_not_feel_where_the_body_lies(tmp_path, reference):
    bars, hinges = [[0, 1], [1, 4], [2, 5]], [[0, 1, 2, 4]]
    x = motion(T)[0]
    first = write(tmp_path / "a.h5", T, x, bars=bars, hinges=hinges)
    moved = write(tmp_path / "b.h5", T, 1.01 * (x - SHIFT) @ rotation())
    pair = compared(first, moved, elements=True, match="index")
    assert [item.kind for item in pair.elements] == ["bars", "hinges"]
    length = np.sqrt(((x[:, [1, 4, 5]] - x[:, [0, 1, 2]]) ** 2).sum(axis=2))
    assert pair.elements[0].rms == pytest.approx(0.01 * np.sqrt((length**2).mean()), rel=1e-9)
    assert pair.elements[0].largest_element == np.argmax(length.max(axis=0))
    assert pair.elements[1].largest < 1e-12
    # Bars whose ends are not matched are left out.
    part = write(tmp_path / "c.h5", T, x[:, :4])
    assert compared(first, part, elements=True).elements[0].n_elements == 1


def test_no_offset_without_a_first_place(tmp_path, reference):
    seen = np.ones((len(T), 6), dtype="u1")
    seen[0, 1] = 0
    other = write(tmp_path / "o.h5", T, motion(T)[0], seen=seen)
    with pytest.raises(MissingData, match="1 nodes are not seen at the first common instant"):
        compared(reference, other, quantity="displacements", match="index")
