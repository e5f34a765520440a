"""Synthetic clips: patterns, motions and light are what their formulas say."""

from __future__ import annotations

import re

import numpy as np
import pytest

from openprc.errors import ResultExists, UnknownName, UnreadableFile
from openprc.vision.synth import (
    Occluder,
    Photometry,
    Scene,
    cases,
    cramer_rao,
    miura,
    rotation,
    speckle,
    translation,
)
from openprc.vision.synth.motions import forward
from openprc.vision.synth.textures import Speckle
from openprc.vision.synth.writing import write_clip

cv2 = pytest.importorskip("cv2")

SHAPE = (90, 120)


def still(**settings):
    return Scene(
        motion=translation(lambda _k: np.zeros(2)), n_frames=4, shape=SHAPE,
        **settings,
    )  # fmt: skip


# --- patterns ---


@pytest.mark.parametrize("texture", [speckle(), miura()], ids=["speckle", "miura"])
def test_the_gradient_is_that_of_the_value(texture):
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-300, 900, (2, 400))
    step = 1e-5
    _, slope_x, slope_y = texture.sample(x, y)
    along_x = (texture.sample(x + step, y)[0] - texture.sample(x - step, y)[0]) / (2 * step)
    along_y = (texture.sample(x, y + step)[0] - texture.sample(x, y - step)[0]) / (2 * step)
    np.testing.assert_allclose(slope_x, along_x, atol=1e-5)
    np.testing.assert_allclose(slope_y, along_y, atol=1e-5)


def test_speckle_is_the_sum_of_its_blobs():
    texture = Speckle(contrast=20.0, seed=3)
    rows, columns = np.mgrid[:256, :256]
    x, y = 400.3, 511.8
    blobs = texture.blobs
    dx = x - (columns + blobs[..., 0]) * texture.cell
    dy = y - (rows + blobs[..., 1]) * texture.cell
    total = (blobs[..., 2] * np.exp(-0.5 * (dx**2 + dy**2) / blobs[..., 3] ** 2)).sum()
    value = texture.sample(np.array([x]), np.array([y]))[0][0]
    assert value == pytest.approx(texture.mean + total, abs=1e-5)


@pytest.mark.parametrize("contrast", [10.0, 30.0])
def test_contrast_of_speckle_is_its_root_mean_square(contrast):
    x, y = np.random.default_rng(1).uniform(0, 1100, (2, 40_000))
    assert speckle(contrast=contrast).sample(x, y)[0].std() == pytest.approx(contrast, rel=0.03)


def test_blur_is_that_of_a_gaussian():
    from scipy.ndimage import gaussian_filter

    y, x = np.mgrid[:160, :160].astype(float)
    sharp, blurred = (speckle().sample(x, y, blur=b)[0] for b in (0.0, 1.3))
    inner = (slice(30, -30), slice(30, -30))
    # The filter is sampled at whole pixels, the formula is not.
    np.testing.assert_allclose(gaussian_filter(sharp, 1.3)[inner], blurred[inner], atol=0.15)


def test_miura_has_no_closed_form_under_a_blur():
    with pytest.raises(ValueError, match="no closed form"):
        miura().sample(np.zeros(1), np.zeros(1), blur=1.0)


# --- motions ---


@pytest.mark.parametrize("name", sorted(cases.CASES))
def test_truth_undoes_the_way_back(name):
    clip = cases.case(name, shape=SHAPE, n_frames=12)
    points = np.random.default_rng(2).uniform(5, 85, (50, 2))
    truth = clip.truth(points)
    np.testing.assert_array_equal(truth[0], points)
    for k in range(12):
        back = clip.motion.back(truth[k, :, 0], truth[k, :, 1], k)
        np.testing.assert_allclose(np.column_stack(back), points, atol=2e-12)


def test_turn_is_that_of_the_closed_form():
    motion = rotation(lambda k: 0.1 * k, centre=(10.0, 20.0))
    place = forward(motion, np.array([[13.0, 20.0]]), 5)
    # A positive angle turns x towards y.
    expected = [[10 + 3 * np.cos(0.5), 20 + 3 * np.sin(0.5)]]
    np.testing.assert_allclose(place, expected, atol=1e-12)


def test_points_that_are_not_known_stay_so():
    truth = cases.case("rotation", n_frames=3).truth([[np.nan, 3.0], [50.0, 60.0]])
    assert np.isnan(truth[:, 0]).all()
    assert np.isfinite(truth[:, 1]).all()


def test_a_motion_that_folds_onto_itself_is_refused():
    clip = cases.case("wave", n_frames=12)
    twice = type(clip.motion)(lambda k: 60.0 * k, 160.0)
    with pytest.raises(ValueError, match="folds the plane onto itself"):
        forward(twice, np.random.default_rng(0).uniform(0, 400, (40, 2)), 1)


# --- frames ---


def test_a_whole_pixel_of_motion_moves_the_image():
    clip = Scene(
        motion=translation(lambda k: np.array([3.0 * k, 1.0 * k])), n_frames=3, shape=SHAPE
    )
    np.testing.assert_allclose(clip.clean(2)[2:, 6:], clip.clean(0)[:-2, :-6], atol=1e-9)


def test_noise_has_its_size_and_differs_between_frames():
    clip = still(photometry=Photometry(noise=3.0), seed=5)
    first, second = (clip.frame(k).astype(float) for k in (1, 2))
    # The difference of two frames has twice the variance, of noise and of rounding.
    assert (first - second).std() == pytest.approx(np.sqrt(2 * (9 + 1 / 12)), rel=0.03)
    np.testing.assert_array_equal(clip.frame(1), clip.frame(1))


def test_light_scales_shifts_and_slants():
    clean = still().clean(0)
    light = Photometry(gain=lambda k: 1 + 0.1 * k, bias=lambda k: 2.0 * k, slope=lambda k: 0.2 * k)
    slant = 1.0 + 0.4 * np.linspace(-0.5, 0.5, SHAPE[1])
    np.testing.assert_allclose(
        still(photometry=light).clean(2), clean * slant * 1.2 + 4.0, atol=1e-9
    )


def test_an_open_shutter_averages_the_motion():
    def clip(shutter):
        return Scene(
            motion=translation(lambda k: np.array([6.0 * k, 0.0])), n_frames=3, shape=SHAPE,
            photometry=Photometry(shutter=shutter, exposures=3),
        )  # fmt: skip

    sharp = clip(0.0)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    parts = [sharp.texture.sample(x - 6.0 * k, y)[0] for k in (1 - 1 / 6, 1.0, 1 + 1 / 6)]
    np.testing.assert_allclose(clip(0.5).clean(1), np.mean(parts, axis=0), atol=1e-9)
    np.testing.assert_array_equal(clip(0.5).clean(0), sharp.clean(0))


def test_the_bar_hides_what_is_behind_it():
    clip = still(occluder=Occluder(width=30.0, left=lambda k: 20.0 + 10 * k, contrast=0.0))
    image = clip.frame(1)
    assert (image[:, 30:60] == 60).all()
    assert image[:, :30].std() > 10
    seen = clip.visible([[25.0, 40.0], [45.0, 40.0], [65.0, 40.0]])
    np.testing.assert_array_equal(seen[1], [True, False, True])
    np.testing.assert_array_equal(clip.visible([[25.0, 40.0]], margin=10)[1], [False])


def test_points_that_leave_the_image_are_not_seen():
    clip = Scene(motion=translation(lambda k: np.array([50.0 * k, 0.0])), n_frames=3, shape=SHAPE)
    np.testing.assert_array_equal(clip.visible([[60.0, 40.0]])[:, 0], [True, True, False])


def test_frames_beyond_the_clip_are_refused():
    with pytest.raises(IndexError, match="frame 4 of a clip of 4"):
        still().frame(4)


def test_unknown_cases_are_named():
    with pytest.raises(UnknownName, match=re.escape("there is no clip 'waves'")):
        cases.case("waves")


# --- the bound ---


def test_the_bound_of_a_plane_wave():
    # I = A sin(k x) + A sin(k y): G = n A^2 k^2 / 2 along both axes, over whole periods.
    height, period, side = 20.0, 7.0, 21
    k = 2 * np.pi / period
    y, x = np.mgrid[:61, :61].astype(float)
    image = height * (np.sin(k * x) + np.sin(k * y))
    noise = 2.0
    sigma = cramer_rao(image, [[30.0, 30.0]], window=side, noise=noise)
    information = side**2 * height**2 * k**2 / 2
    expected = np.sqrt(2 * (noise**2 + 1 / 12) / information)
    # Splines through seven samples a period follow the slope of a sine to half a percent.
    np.testing.assert_allclose(sigma, [[expected, expected]], rtol=0.01)


def test_the_bound_says_where_it_does_not_know():
    image = np.tile(np.sin(np.arange(60.0)), (60, 1))
    sigma = cramer_rao(image, [[5.0, 30.0], [30.0, 30.0]], noise=1.0)
    assert np.isnan(sigma).all()  # beyond the image, and without texture along y


# --- files ---


def test_a_written_clip_reads_back_bit_for_bit(tmp_path):
    clip = cases.case("affine", shape=(62, 84), n_frames=5)
    path = clip.write(tmp_path / "clip.avi")
    capture = cv2.VideoCapture(str(path))
    for frame in clip.frames():
        delivered, image = capture.read()
        assert delivered
        np.testing.assert_array_equal(image if image.ndim == 2 else image[..., 1], frame)
    assert not capture.read()[0]
    capture.release()
    assert [p.name for p in tmp_path.iterdir()] == ["clip.avi"]


def test_lossy_codecs_are_counted(tmp_path):
    clip = cases.case("affine", shape=(60, 80), n_frames=5)
    assert clip.write(tmp_path / "clip.mp4", codec="mp4v").stat().st_size > 0


def test_a_codec_that_cannot_be_written_is_refused(tmp_path):
    clip = cases.case("affine", shape=(60, 80), n_frames=2)
    with pytest.raises(UnreadableFile, match="the video was not written"):
        clip.write(tmp_path / "clip.mp4", codec="ProR")
    assert list(tmp_path.iterdir()) == []


def test_odd_sizes_are_refused_before_they_are_cropped(tmp_path):
    clip = cases.case("affine", shape=(61, 80), n_frames=2)
    with pytest.raises(UnreadableFile, match="would crop 80 x 61 px to even numbers"):
        clip.write(tmp_path / "clip.avi")
    assert list(tmp_path.iterdir()) == []


def test_a_finished_clip_is_kept_when_asked(tmp_path):
    clip = cases.case("affine", shape=(60, 80), n_frames=2)
    path = clip.write(tmp_path / "clip.avi")
    with pytest.raises(ResultExists):
        write_clip(clip, path, overwrite=False)
