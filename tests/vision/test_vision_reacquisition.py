"""What neighbours say of a point, and the coarse search."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.vision.synth import cases
from openprc.vision.tracking.consistency import out_of_line, out_of_place
from openprc.vision.tracking.key_templates import rotation, strain, wear
from openprc.vision.tracking.local_motion import local_motion, neighbour_table
from openprc.vision.tracking.wide_search import wide_search

RNG = np.random.default_rng(3)
POINTS = RNG.uniform(0, 300, (80, 2))
TABLE = neighbour_table(POINTS, 12)
TURN = np.array([[0.98, -0.08], [0.09, 1.03]])
MOVED = POINTS @ TURN.T + [4.0, -7.0]


def test_the_motion_of_neighbours_is_found_though_an_eighth_has_gone_astray():
    moved = MOVED.copy()
    moved[::8] += RNG.normal(0, 20, moved[::8].shape)
    motion = local_motion(POINTS[TABLE], moved[TABLE], np.ones(TABLE.shape, bool), POINTS)
    np.testing.assert_allclose(motion.positions, MOVED, atol=0.05)
    np.testing.assert_allclose(motion.gradients, np.broadcast_to(TURN, (80, 2, 2)), atol=2e-3)


@pytest.mark.parametrize("known", [0, 1, 2])
def test_few_neighbours_give_a_shift_and_none_gives_nothing(known):
    valid = np.zeros(TABLE.shape, bool)
    valid[:, :known] = True
    motion = local_motion(POINTS[TABLE], POINTS[TABLE] + [3.0, 1.0], valid, POINTS)
    expected = POINTS + np.array([3.0, 1.0]) if known else np.full_like(POINTS, np.nan)
    np.testing.assert_allclose(motion.positions, expected, atol=1e-9)


def test_a_step_of_another_length_is_out_of_line():
    moved = POINTS + np.array([2.0, 0.0])
    moved[17] += [9.0, 0.0]
    found = np.ones(80, bool)
    assert out_of_line(POINTS, moved, found, TABLE, allowance=1.5).tolist() == [17]
    found[17] = False
    assert out_of_line(POINTS, moved, found, TABLE, allowance=1.5).tolist() == []


def test_a_slide_is_out_of_place_and_a_body_of_its_own_is_not():
    moved = MOVED.copy()
    moved[5] += [1.5, 0.0]
    body = np.r_[30, TABLE[30, :3]]
    moved[body] = POINTS[body] + [40.0, 0.0]
    deformation = np.tile(TURN, (80, 1, 1))
    deformation[body] = np.eye(2)
    everyone = np.arange(80)
    off = out_of_place(
        everyone,
        POINTS,
        moved,
        deformation,
        np.ones(80, bool),
        TABLE,
        doubtful=np.zeros(80, bool),
    )
    assert off[5]
    assert not off[30]


def test_rotation_and_strain_are_those_of_the_polar_decomposition():
    angle = np.radians(33.0)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    f = (turn @ np.diag([1.2, 0.7]))[None]
    assert rotation(f)[0] == pytest.approx(33.0)
    assert strain(f)[0] == pytest.approx(0.3)


def test_wear_goes_from_none_to_one_at_refusal():
    fresh = np.array([1.0, 1.0, 0.9])
    quality = np.array([1.0, 0.95, 0.7])
    np.testing.assert_allclose(wear(quality, fresh, max_znssd=0.1), [0.0, 1.0, 1.0])


def test_a_point_8_px_off_is_found_and_a_repeated_pattern_is_not_guessed():
    image = next(iter(cases.case("translation", n_frames=1, shape=(120, 160)).frames()))
    points = np.array([[60.0, 60.0], [90.0, 50.0]])
    expected = np.zeros((2, 6))
    expected[:, :2] = points + np.array([[8.0, -6.0], [-5.0, 7.0]])
    found = wide_search(image, image, points, expected, size=21, radius=10)
    np.testing.assert_allclose(found[:, :2], points, atol=0.5)
    x, y = np.meshgrid(np.arange(160), np.arange(120))
    dots = np.uint8(128 + 60 * np.sin(x * np.pi / 4) * np.sin(y * np.pi / 4))
    assert np.isnan(wide_search(dots, dots, points, expected, size=21, radius=10)).all()
    expected[:, :2] = [[np.nan, 3.0], [1e9, -1e9]]
    assert np.isnan(wide_search(image, image, points, expected, size=21, radius=10)).all()
