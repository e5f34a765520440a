"""The intrinsics of a camera from pictures of a board (Zhang 2000, doi:10.1109/34.888718)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import CalibrationError
from openprc.vision.calibration.board_images import pictures
from openprc.vision.calibration.boards import Board, BoardView
from openprc.vision.calibration.camera import CameraCalibration
from openprc.vision.calibration.coverage import covered_cells
from openprc.vision.calibration.distortion import NAMES, valid_radius
from openprc.vision.calibration.mapping import Array
from openprc.vision.opencv import load_cv2

#: Which coefficients are estimated, by name of the model.
MODELS: dict[str, tuple[str, ...]] = {
    "none": (),
    "k1": ("k1",),
    "k1k2": ("k1", "k2"),
    "k1k2p1p2": ("k1", "k2", "p1", "p2"),
    "k1k2p1p2k3": ("k1", "k2", "p1", "p2", "k3"),
    "rational": NAMES[:8],
    "thin-prism": NAMES[:12],
}
#: Fewest views; how far apart [deg] the boards' normals should be, and have to be.
FEWEST_VIEWS, LEAST_TILT, REFUSED_TILT = 3, 15.0, 5.0


@dataclass(frozen=True, slots=True)
class FittedView:
    """A view that was used.

    Attributes
    ----------
    name : str
    view : BoardView
    rotation : (3, 3)
        From the board to the camera.
    translation : (3,) [units of the board]
    residuals : (n, 2) [px]
        Seen minus predicted.
    """

    name: str
    view: BoardView
    rotation: Array
    translation: Array
    residuals: Array

    @property
    def rms(self) -> float:
        """Root of the mean squared distance [px]."""
        return float(np.sqrt(np.mean(np.sum(self.residuals**2, axis=1))))

    @property
    def tilt(self) -> float:
        """Angle between the board and the sensor [deg]."""
        return float(np.degrees(np.arccos(min(1.0, abs(self.rotation[2, 2])))))


@dataclass(frozen=True, slots=True)
class CameraFit:
    """A camera, and the views that it was fitted to.

    Attributes
    ----------
    camera : CameraCalibration
    views : tuple of FittedView
    rejected : tuple of (str, str)
        Names of pictures that were not used, and why.
    coverage : float
        Fraction of the parts of the image in which corners were seen.
    """

    camera: CameraCalibration
    views: tuple[FittedView, ...]
    rejected: tuple[tuple[str, str], ...]
    coverage: float

    def as_dict(self) -> dict[str, Any]:
        """Return everything but the single points as plain values."""
        return {
            "camera": self.camera.as_dict(),
            "rms_px": self.camera.rms,
            "sigma": dict(self.camera.sigma),
            "coverage": self.coverage,
            "views": [
                {"name": v.name, "points": len(v.view.ids), "rms_px": v.rms, "tilt_deg": v.tilt}
                for v in self.views
            ],
            "rejected": [{"name": name, "reason": reason} for name, reason in self.rejected],
            "notes": list(self.camera.notes),
        }


def calibrate_camera(
    images: Any, board: Board, *, model: str = "k1k2p1p2k3", limit: int = 40
) -> CameraCalibration:
    """Calibrate a camera with pictures of a board.

    Parameters
    ----------
    images : iterable of arrays or paths, a folder, or a video source
        Ten or more, with the board tilted in several directions and in all parts of the image.
    board : Chessboard, Charuco or CircleGrid
    model : str
        Which distortion is estimated: a key of `MODELS`.
    limit : int
        Largest number of frames taken from a video.

    Returns
    -------
    CameraCalibration
        With ``rms`` [px], ``sigma`` of each number, and notes on what is weak. `fit_camera` also
        gives the single views.

    Raises
    ------
    CalibrationError
        When the views do not determine the camera.
    """
    return fit_camera(images, board, model=model, limit=limit).camera


def fit_camera(
    images: Any, board: Board, *, model: str = "k1k2p1p2k3", limit: int = 40
) -> CameraFit:
    """Find the board in pictures and fit the camera; see `calibrate_camera`."""
    found, rejected, shape = find_boards(images, board, limit=limit)
    return fit_views(found, shape, model=model, rejected=rejected)


def find_boards(
    images: Any, board: Board, *, limit: int = 40
) -> tuple[list[tuple[str, BoardView]], list[tuple[str, str]], tuple[int, int]]:
    """Return the views of a board with their names, the pictures without, and their size.

    Raises
    ------
    CalibrationError
        When pictures are of different size, or there are none.
    """
    found: list[tuple[str, BoardView]] = []
    rejected: list[tuple[str, str]] = []
    shape: tuple[int, int] | None = None
    for name, image in pictures(images, limit=limit):
        if shape is None:
            shape = (image.shape[0], image.shape[1])
        if image.shape != shape:
            raise CalibrationError(
                f"{name} has {image.shape[1]}x{image.shape[0]} pixels, the pictures before "
                f"{shape[1]}x{shape[0]}",
                expected="pictures of one camera at one resolution",
                fix="leave out the others; turn off automatic rotation",
                key=name,
            )
        try:
            found.append((name, board.find(image)))
        except CalibrationError as error:
            if error.key is not None:  # about the board itself, not about this picture
                raise
            rejected.append((name, error.found))
    if shape is None:
        raise CalibrationError(
            "there are no pictures",
            expected="pictures of the board",
            fix="check the folder or the list",
            key="images",
        )
    return found, rejected, shape


def fit_views(
    views: list[tuple[str, BoardView]],
    shape: tuple[int, int],
    *,
    model: str = "k1k2p1p2k3",
    rejected: list[tuple[str, str]] | None = None,
) -> CameraFit:
    """Fit a camera to views in images of a height and a width.

    Raises
    ------
    CalibrationError
    """
    if model not in MODELS:
        raise CalibrationError(
            f"there is no distortion model {model!r}",
            expected="one of " + " ".join(MODELS),
            fix="k1k2p1p2k3 suits most lenses",
            key="model",
        )
    rejected = list(rejected or [])
    usable = []
    for name, view in views:
        if len(view.ids) < 6 or np.linalg.svd(view.points[:, :2] - view.points[:, :2].mean(0))[1][
            1
        ] < 1e-6 * np.ptp(view.points):
            rejected.append((name, f"only {len(view.ids)} points, or all on a line"))
        else:
            usable.append((name, view))
    if len(usable) < FEWEST_VIEWS:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in rejected[:3])
        raise CalibrationError(
            f"the board was found in {len(usable)} of {len(usable) + len(rejected)} pictures"
            + (f" ({reasons})" if reasons else ""),
            expected=f"at least {FEWEST_VIEWS} views, better 10 to 20",
            fix="check the counts of the pattern; take sharp pictures of the whole board, tilted "
            "in several directions",
            key="images",
        )
    matrix, dist, rotations, translations, sigma = _solve(usable, shape, MODELS[model])
    camera = CameraCalibration(matrix=matrix, dist=dist, frame_shape=shape, sigma=sigma)
    fitted = []
    for (name, view), r, t in zip(usable, rotations, translations, strict=True):
        residuals = view.pixels - camera.project(view.points @ r.T + t)
        fitted.append(FittedView(name, view, r, t, residuals))
    squares = np.concatenate([np.sum(v.residuals**2, axis=1) for v in fitted])
    everything = np.concatenate([v.view.pixels for v in fitted])
    coverage = float(covered_cells(everything, shape).mean())
    camera = CameraCalibration(
        matrix=matrix,
        dist=dist,
        frame_shape=shape,
        sigma=sigma,
        rms=float(np.sqrt(squares.mean())),
        notes=tuple(_notes(fitted, camera, coverage)),
    )
    return CameraFit(camera, tuple(fitted), tuple(rejected), coverage)


def _solve(
    views: list[tuple[str, BoardView]], shape: tuple[int, int], free: tuple[str, ...]
) -> tuple[Array, Array, list[Array], list[Array], dict[str, float]]:
    cv2 = load_cv2()
    flags = 0
    if set(free) & set(NAMES[5:8]):
        flags |= cv2.CALIB_RATIONAL_MODEL
    if set(free) & set(NAMES[8:12]):
        flags |= cv2.CALIB_THIN_PRISM_MODEL | cv2.CALIB_RATIONAL_MODEL
    if "p1" not in free:
        flags |= cv2.CALIB_ZERO_TANGENT_DIST
    for name in ("k1", "k2", "k3"):
        if name not in free:
            flags |= getattr(cv2, f"CALIB_FIX_{name.upper()}")
    points = [view.points.astype(np.float32).reshape(-1, 1, 3) for _, view in views]
    pixels = [view.pixels.astype(np.float32).reshape(-1, 1, 2) for _, view in views]
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 200, 1e-12)
    try:
        _, matrix, dist, turns, shifts, spread, *_ = cv2.calibrateCameraExtended(
            points, pixels, shape[::-1], None, None, flags=flags, criteria=criteria
        )
    except cv2.error as error:
        raise CalibrationError(
            f"OpenCV found no camera for these views ({error.err or error.func})",
            expected="boards tilted in several directions, each numbered alike",
            fix="take more pictures at other angles",
            key="images",
        ) from error
    n = max([4, *(NAMES.index(name) + 1 for name in free)])
    size = next(length for length in (4, 5, 8, 12) if length >= n)
    coefficients = np.asarray(dist, np.float64).reshape(-1)[:size] if free else np.zeros(0)
    deviations = np.asarray(spread, np.float64).reshape(-1)
    names = ("fx", "fy", "cx", "cy", *NAMES)
    wanted = {"fx", "fy", "cx", "cy", *free}
    sigma = {n: float(s) for n, s in zip(names, deviations, strict=False) if n in wanted}
    rotations = [np.asarray(cv2.Rodrigues(turn)[0], np.float64) for turn in turns]
    focal = matrix[[0, 1], [0, 1]]
    finite = np.isfinite([*matrix.ravel(), *coefficients, *sigma.values()]).all()
    # No lens sees more than 174 degrees, or less than a fortieth of a degree.
    sound = finite and (focal > 0.05 * max(shape)).all() and (focal < 2000.0 * max(shape)).all()
    if not sound or _widest(rotations) < REFUSED_TILT:
        raise CalibrationError(
            "the views do not determine the focal length"
            + (
                f": the boards are parallel within {_widest(rotations):.1f} degrees"
                if sound
                else ""
            ),
            expected="boards tilted by 20 to 40 degrees, in several directions",
            fix="take more pictures at other angles, or estimate fewer coefficients",
            key="images",
        )
    return (
        np.asarray(matrix, np.float64),
        coefficients,
        rotations,
        [np.asarray(shift, np.float64).reshape(3) for shift in shifts],
        sigma,
    )


def _widest(rotations: list[Array]) -> float:
    """Largest angle between the normals of any two boards [deg]."""
    normals = np.array([rotation[:, 2] for rotation in rotations])
    cosines: NDArray[np.float64] = np.abs(normals @ normals.T)
    return float(np.degrees(np.arccos(np.clip(np.nan_to_num(cosines).min(), 0.0, 1.0))))


def _notes(views: list[FittedView], camera: CameraCalibration, coverage: float) -> list[str]:
    notes = []
    widest = _widest([view.rotation for view in views])
    if widest < LEAST_TILT:
        notes.append(
            f"the boards are parallel within {widest:.1f} degrees: focal length and distance "
            "are hard to tell apart; tilt the board by 20 to 40 degrees in several directions"
        )
    for name, place in (("fx", (0, 0)), ("fy", (1, 1))):
        share = camera.sigma[name] / camera.matrix[place]
        if share > 0.02:
            notes.append(
                f"{name} is known to {100.0 * share:.1f} % only: take more pictures, with the "
                "board tilted and near"
            )
    if len(views) < 10:
        notes.append(f"{len(views)} views were used; 10 to 20 make the result dependable")
    if coverage < 0.6:
        notes.append(
            f"corners were seen in {100.0 * coverage:.0f} % of the image: outside of that the "
            "distortion is extrapolated"
        )
    height, width = camera.frame_shape
    corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], float)
    if np.isnan(camera.to_normalized(corners, outside="nan")).any():
        notes.append(
            f"the distortion model has no inverse in the corners of the image (it holds up to "
            f"{valid_radius(camera.dist):.3g} from the axis): show the board there"
        )
    rms = float(np.sqrt(np.mean(np.concatenate([np.sum(v.residuals**2, 1) for v in views]))))
    if rms > 1.0:
        notes.append(
            f"the reprojection error of {rms:.2f} px is large: is the board flat, are the counts "
            "and the model right, and are the pictures sharp?"
        )
    usual = float(np.median([view.rms for view in views]))
    bad = [view.name for view in views if view.rms > max(3.0 * usual, 0.2)]
    if bad:
        notes.append("views that fit much worse than the others: " + ", ".join(bad[:5]))
    return notes
