"""Errors are as small as noise allows, and as large as they are said to be."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.vision.synth import cramer_rao, speckle
from openprc.vision.tracking.correlation import Correlator, RefineSettings

SHAPE = (130, 170)
CENTRE = np.array([85.0, 65.0])
POINTS = np.stack(np.meshgrid(np.arange(22.0, 150.0, 14.0), np.arange(22.0, 110.0, 14.0)), -1)
POINTS = POINTS.reshape(-1, 2)
N_FRAMES = 8


def values(seed, x, y):
    return speckle(seed=seed).sample(x, y)[0]


def grid():
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    return x, y


def bend(curvature):
    """Return a motion, as displacement of frame 0's places, and its inverse."""

    def forward(p):
        return p + np.stack([0.0 * p[:, 0], curvature * (p[:, 0] - CENTRE[0]) ** 2], 1)

    def back(x, y):
        return x, y - curvature * (x - CENTRE[0]) ** 2

    return forward, back


def turn(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = np.array([[c, -s], [s, c]])

    def forward(p):
        return (p - CENTRE) @ matrix.T + CENTRE

    def back(x, y):
        xy = (np.stack([x, y], -1) - CENTRE) @ matrix + CENTRE
        return xy[..., 0], xy[..., 1]

    return forward, back


def slide(shift):
    return (lambda p: p + shift), (lambda x, y: (x - shift[0], y - shift[1]))


def scores(model, noise, motions, *, deformation=(0.0, 0.0, 0.0, 0.0)):
    """Return errors, errors over sigma and the bound, all (frames, points, 2), where accepted."""
    errors, ratios, bounds = [], [], []
    for k, (forward, back) in enumerate(motions):
        rng = np.random.default_rng([7, k])
        clean = values(k, *grid())
        pair = [
            np.rint(i + rng.normal(0.0, noise, SHAPE)).clip(0, 255).astype(np.uint8)
            for i in (clean, values(k, *back(*grid())))
        ]
        correlator = Correlator(RefineSettings(model=model))
        ids = correlator.add_templates(correlator.prepare(pair[0]), POINTS)
        truth = forward(POINTS)
        guess = np.tile([0.0, 0.0, *deformation], (len(POINTS), 1))
        guess[:, :2] = truth + rng.normal(0.0, 0.1, truth.shape)
        found = correlator.refine(correlator.prepare(pair[1]), ids, guess)
        inside = ((truth > 14.0) & (truth < np.array(SHAPE[::-1]) - 15.0)).all(axis=1)
        assert found.accepted[inside & (ids >= 0)].mean() > 0.99
        good = found.accepted
        errors.append((found.positions - truth)[good])
        ratios.append(errors[-1] / found.sigma[good])
        bounds.append(cramer_rao(clean, POINTS, noise=noise)[good])
    return (np.concatenate(part) for part in (errors, ratios, bounds))


def rms(array):
    return float(np.sqrt((array**2).mean()))


SHIFTS = [slide(s) for s in np.random.default_rng(5).uniform(-0.5, 0.5, (N_FRAMES, 2))]


@pytest.mark.parametrize("noise", [1.0, 2.0, 5.0])
@pytest.mark.parametrize(("model", "most"), [("translation", 1.15), ("auto", 1.2), ("affine", 1.3)])
def test_a_shift_is_found_as_well_as_noise_allows(model, most, noise):
    error, ratio, bound = scores(model, noise, SHIFTS)
    # Both images are noisy and new every time, so the constant part is in here too. The rms of
    # 8 x 63 x 2 values is known to 2 %.
    assert 0.93 < rms(error) / rms(bound) < most
    assert 0.9 < rms(ratio) < 1.1
    # No part of it is the same for all, neither left nor right.
    assert np.abs(error.mean(axis=0)).max() < 4.0 * rms(bound) / np.sqrt(len(error))


def test_noise_does_not_cost_what_deformation_would():
    """On a shift the free choice of the model loses less than half of what affine loses."""
    loss = {
        model: rms(next(scores(model, 3.0, SHIFTS))) for model in ("translation", "auto", "affine")
    }
    assert loss["translation"] < loss["auto"] < loss["affine"]
    assert loss["auto"] - loss["translation"] < 0.5 * (loss["affine"] - loss["translation"])


@pytest.mark.parametrize("model", ["affine", "auto"])
def test_a_rotation_is_found_as_well(model):
    c, s = np.cos(np.radians(15.0)), np.sin(np.radians(15.0))
    error, ratio, bound = scores(
        model, 1.0, [turn(15.0)] * 6, deformation=(c - 1.0, -s, s, c - 1.0)
    )
    assert rms(error) / rms(bound) < 1.3
    assert 0.9 < rms(ratio) < 1.1


def test_curvature_is_seen_where_it_counts():
    # As strong as at the crest of a wave of 4 px amplitude and 160 px length.
    motions = [bend(0.5 * 4.0 * (2.0 * np.pi / 160.0) ** 2 * 0.3)] * 4
    affine, _, bound = scores("affine", 1.0, motions)
    auto, ratio, _ = scores("auto", 1.0, motions)
    quadratic, full, _ = scores("quadratic", 1.0, motions)
    assert rms(affine) > 3.0 * rms(bound)
    assert rms(quadratic) < 2.2 * rms(bound)
    assert rms(auto) < 1.3 * rms(quadratic)
    assert 0.85 < rms(full) < 1.15
    assert rms(ratio) < 1.6


@pytest.mark.parametrize("amount", np.linspace(0.0, 0.02, 6))
def test_nothing_jumps_as_a_deformation_grows(amount):
    """Between no deformation and a clear one the position goes over without a step."""
    rng = np.random.default_rng(11)
    still, noise = values(3, *grid()), rng.normal(0.0, 2.0, SHAPE)
    reference = still + rng.normal(0.0, 2.0, SHAPE)
    found = {"auto": [], "affine": []}
    for stretch in amount + np.array([0.0, 1e-5]):
        x, y = grid()
        image = values(3, (x - CENTRE[0]) / (1.0 + stretch) + CENTRE[0], y) + noise
        for model, positions in found.items():
            correlator = Correlator(RefineSettings(model=model, tolerance=1e-6))
            ids = correlator.add_templates(correlator.prepare(reference), POINTS)
            guess = np.zeros((len(POINTS), 6))
            guess[:, 0] = (POINTS[:, 0] - CENTRE[0]) * (1.0 + stretch) + CENTRE[0]
            guess[:, 1] = POINTS[:, 1]
            answer = correlator.refine(correlator.prepare(image), ids, guess)
            positions.append((answer.positions - guess[:, :2])[answer.accepted])
    step = np.abs(found["auto"][1] - found["auto"][0])
    assert step.max() < 2e-3
    assert np.median(step) < 5e-5
