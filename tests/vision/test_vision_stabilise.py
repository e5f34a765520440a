"""A camera that shakes: what still points show of it is taken off on the way to the file."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import CalibrationError
from openprc.hooks import import_file
from openprc.schema import Trajectory
from openprc.vision import TrajectorySet
from openprc.vision.synth import Photometry, Scene, speckle
from openprc.vision.synth.motions import TileMotion

pytest.importorskip("cv2")

N_FRAMES, SIDE = 16, 50


@pytest.fixture(scope="module")
def shaken(tmp_path_factory):
    """Six patches before a shaking camera, the last of which moves as well."""
    folder = tmp_path_factory.mktemp("shaken")
    k = np.arange(N_FRAMES)
    shake = 1.5 * np.stack([np.sin(1.1 * k), np.sin(1.7 * k)], axis=1)
    shifts = np.tile(shake[:, None, None], (1, 2, 3, 1))
    own = 4.0 * np.sin(0.4 * k)
    shifts[:, 1, 2, 0] += own
    clip = Scene(
        texture=speckle(seed=2),
        motion=TileMotion(shifts, SIDE),
        n_frames=N_FRAMES,
        shape=(2 * SIDE, 3 * SIDE),
        photometry=Photometry(noise=1.0),
    )
    centres = [(SIDE * (i + 0.5), SIDE * (j + 0.5)) for j in (0, 1) for i in (0, 1, 2)]
    points = folder / "points.csv"
    points.write_text("".join(f"{x},{y}\n" for x, y in centres))
    return clip.write(folder / "clip.avi"), points, shake, own


@pytest.mark.parametrize("stabilise", [True, False], ids=["steadied", "as seen"])
def test_the_motion_of_the_camera_is_taken_off_when_asked(shaken, tmp_path, stabilise):
    path, points, shake, own = shaken
    out = tmp_path / "run.h5"
    options = {"points": str(points), "stabilise": stabilise}
    import_file(path, out, as_name="vision", options=options)
    with Trajectory(out) as run:
        places = run.positions()
        told = [note for note in run.provenance["notes"] if "still points" in note]
    moved = places - places[0]
    camera = np.zeros_like(shake) if stabilise else shake
    for still in range(5):
        np.testing.assert_allclose(moved[:, still], camera, atol=0.08)
    np.testing.assert_allclose(moved[:, 5, 0], own + camera[:, 0], atol=0.12)
    assert len(told) == stabilise


def test_a_calibration_of_two_cameras_places_no_point_of_one(shaken):
    from openprc.vision import Tracker

    result = Tracker(shaken[0], [[25.0, 25.0]]).run()
    with pytest.raises(CalibrationError, match="the calibration is a object"):
        TrajectorySet.from_tracking_result(result, calibration=object())
