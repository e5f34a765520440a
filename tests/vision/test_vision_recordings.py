"""Recordings of others, whose motion was measured or made by somebody else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from openprc.vision import ArraySource, KLTConfig, Tracker, VideoSource

cv2 = pytest.importorskip("cv2")

DATA = Path(__file__).resolve().parents[2] / "../shared/data/vision"
pytestmark = pytest.mark.skipif(not DATA.exists(), reason="recorded videos are not here")

#: Radius around each reference point that surely lies on the part [px].
RADII = {0: 22.0, 1: 8.0, 2: 18.0}


def part_of_mechanism(part):
    table = np.genfromtxt(DATA / "mechanism_reference.csv", delimiter=",", names=True)
    told = table[table["subset"] == part][:40]
    centre = np.array([told["x_ref_px"][0], told["y_ref_px"][0]])
    steps = np.arange(-24.0, 25.0, 3.0)
    x, y = (a.ravel() for a in np.meshgrid(steps, steps))
    inside = np.hypot(x, y) <= max(RADII[part] - 4.0, 5.0)
    return told, centre, centre + np.column_stack([x, y])[inside]


def rigid_shift(start, now, weights):
    """Shift of the origin by the best rigid motion (Kabsch in the plane), complex numbers."""
    z0, z = start @ [1, 1j], now @ [1, 1j]
    middle0, middle = np.average(z0, weights=weights), np.average(z, weights=weights)
    turn = np.exp(1j * np.angle((weights * (z - middle) * (z0 - middle0).conj()).sum()))
    return middle - turn * middle0


def disagreement(part, config):
    """Root mean square of (u, v) against the other program [px], and the part of points found."""
    told, centre, points = part_of_mechanism(part)
    with VideoSource(DATA / "mechanism_ffv1.avi") as source:
        result = Tracker(source, points, config=config).run()
    errors = []
    for k in range(1, 40):
        known = np.isfinite(result.positions[k]).all(axis=1)
        weights = (
            np.ones(known.sum())
            if config.refine == "none"
            else 1.0 / (result.sigma[k, known] ** 2).sum(axis=1)
        )
        shift = rigid_shift(points[known] - centre, result.positions[k, known] - centre, weights)
        errors.append([shift.real - told["u_px"][k], shift.imag - told["v_px"][k]])
    return np.sqrt(np.mean(np.square(errors), axis=0)), np.isfinite(result.positions).mean()


@pytest.mark.parametrize("part", RADII)
def test_the_mechanism_moves_as_dice_measured_it(part):
    rms, found = disagreement(part, KLTConfig())
    assert (rms <= 0.03).all(), rms
    assert found > 0.75


def test_plain_lucas_kanade_does_not_come_near():
    rms, _ = disagreement(0, KLTConfig(refine="none"))
    assert rms.max() > 0.3


@pytest.mark.parametrize("k", ["K50", "K200", "K400"])
def test_the_dic_challenge_is_met(k):
    folder = DATA / "dic_challenge_15"
    truth = np.genfromtxt(folder / "truth_v.csv", delimiter=",", names=True)
    images = [
        cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE)
        for name in ("Reference.png", f"P200_{k}_N2.png")
    ]
    height, width = images[0].shape
    x, y = np.meshgrid(np.arange(30, width - 30, 24), np.arange(30, height - 30, 24))
    points = np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)
    result = Tracker(ArraySource(np.stack(images), fps=1.0), points).run()
    moved = result.positions[1] - points
    # The truth belongs to the row where a point is seen, not to where it came from.
    row = result.positions[1, :, 1]
    v = np.interp(row, truth["y_deformed_px"], truth[f"v_{k}_px"])
    assert np.isfinite(moved).mean() > 0.99
    assert np.sqrt(np.nanmean((moved[:, 1] - v) ** 2)) <= 0.027
