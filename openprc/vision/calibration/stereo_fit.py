"""Where the right camera is, from pairs of pictures of a board."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from openprc.errors import CalibrationError
from openprc.vision.calibration.boards import Board, BoardView
from openprc.vision.calibration.camera import CameraCalibration
from openprc.vision.calibration.camera_fit import CameraFit, find_boards, fit_views
from openprc.vision.calibration.mapping import Array
from openprc.vision.calibration.stereo import StereoRig
from openprc.vision.opencv import load_cv2

#: Fewest pairs in which both cameras see the board.
FEWEST_PAIRS = 3


@dataclass(frozen=True, slots=True)
class StereoFit:
    """A rig, and what it was fitted to.

    Attributes
    ----------
    rig : StereoRig
    pairs : tuple of str
        Names of the left pictures of the pairs that were used.
    rejected : tuple of (str, str)
        Pictures that were not used, and why.
    errors : tuple of float [px]
        Reprojection error of the triangulated board points, for each pair.
    board_rms : float [units]
        How far triangulated boards are from the board as it is, after moving it there: the error
        of positions in space that no reprojection error shows.
    cameras : tuple of CameraFit
        Left and right, where they were calibrated here.
    """

    rig: StereoRig
    pairs: tuple[str, ...]
    rejected: tuple[tuple[str, str], ...]
    errors: tuple[float, ...]
    board_rms: float
    cameras: tuple[CameraFit, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return everything but the single points as plain values."""
        rig = self.rig
        return {
            "rig": rig.as_dict(),
            "rms_px": rig.rms,
            "baseline": rig.baseline,
            "angle_deg": rig.angle,
            "units": rig.units,
            "board_rms": self.board_rms,
            "pairs": [
                {"name": name, "rms_px": error}
                for name, error in zip(self.pairs, self.errors, strict=True)
            ],
            "rejected": [{"name": name, "reason": reason} for name, reason in self.rejected],
            "cameras": [fit.as_dict() for fit in self.cameras],
            "notes": list(rig.notes),
        }


def fit_stereo(
    left_images: Any,
    right_images: Any,
    board: Board,
    *,
    left: CameraCalibration | None = None,
    right: CameraCalibration | None = None,
    model: str = "k1k2p1p2k3",
) -> StereoFit:
    """Calibrate a rig; see `StereoRig.calibrate`.

    Each camera is calibrated by itself with all its views, unless it is given; then the pose of
    the right one alone is estimated, with the intrinsics held.

    Raises
    ------
    CalibrationError
        When fewer than three pairs show the board in both pictures.
    """
    sides = [_named(images, board) for images in (left_images, right_images)]
    counts = [len(side.names) for side in sides]
    if counts[0] != counts[1]:
        raise CalibrationError(
            f"there are {counts[0]} left and {counts[1]} right pictures",
            expected="pairs taken at the same moments, in the same order",
            fix="leave out pictures that have no partner",
            key="images",
        )
    fits: list[CameraFit] = []
    cameras: list[CameraCalibration] = []
    for side, given, name in zip(sides, (left, right), ("left", "right"), strict=True):
        if given is None:
            fit = fit_views(
                [(side.names[i], view) for i, view in side.views.items()],
                side.shape,
                model=model,
                rejected=side.rejected,
            )
            fits.append(fit)
            cameras.append(fit.camera)
            continue
        check = given.check_frame(side.shape)
        if check.warning is not None:
            raise CalibrationError(
                f"the {name} camera: {check.warning.partition(':')[0]}",
                expected="pictures of the size that the camera was calibrated with",
                fix="calibrate the camera at this setting",
                key=name,
            )
        cameras.append(check.calibration)  # type: ignore[arg-type]
    return _fit_pairs(sides, board, (cameras[0], cameras[1]), tuple(fits))


@dataclass(frozen=True, slots=True)
class _Side:
    names: list[str]
    views: dict[int, BoardView]
    rejected: list[tuple[str, str]]
    shape: tuple[int, int]


def _named(images: Any, board: Board) -> _Side:
    """The pictures of one camera, numbered so that partners keep their numbers."""
    from openprc.vision.calibration.board_images import pictures  # noqa: PLC0415 - OpenCV

    listed = list(pictures(images))
    numbered = [(f"{i}", picture) for i, (_, picture) in enumerate(listed)]
    found, rejected, shape = find_boards([picture for _, picture in numbered], board)
    names = [name for name, _ in listed]

    def number(name: str) -> int:
        return int(name.rpartition(" ")[2])

    return _Side(
        names,
        {number(name): view for name, view in found},
        [(names[number(name)], reason) for name, reason in rejected],
        shape,
    )


def _fit_pairs(
    sides: list[_Side],
    board: Board,
    cameras: tuple[CameraCalibration, CameraCalibration],
    fits: tuple[CameraFit, ...],
) -> StereoFit:
    cv2 = load_cv2()
    rejected = [*sides[0].rejected, *sides[1].rejected]
    pairs: list[tuple[str, Array, Array, Array]] = []
    for i, view in sides[0].views.items():
        partner = sides[1].views.get(i)
        if partner is None:
            continue
        ids, at, there = np.intersect1d(view.ids, partner.ids, return_indices=True)
        if len(ids) < 4:
            rejected.append((sides[0].names[i], f"{len(ids)} points are seen by both cameras"))
            continue
        pairs.append((sides[0].names[i], view.points[at], view.pixels[at], partner.pixels[there]))
    if len(pairs) < FEWEST_PAIRS:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in rejected[:3])
        raise CalibrationError(
            f"both cameras see the board in {len(pairs)} of {len(sides[0].names)} pairs"
            + (f" ({reasons})" if reasons else ""),
            expected=f"at least {FEWEST_PAIRS} pairs, better 10 to 20",
            fix="hold the board where both cameras see it",
            key="images",
        )
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 200, 1e-12)
    lens = []
    for camera in cameras:
        lens += [camera.matrix.copy(), camera.dist.copy() if camera.dist.size else np.zeros(5)]
    flags = cv2.CALIB_FIX_INTRINSIC
    if max(camera.dist.size for camera in cameras) > 5:
        flags |= cv2.CALIB_RATIONAL_MODEL
    _, *_, rotation, translation, _, _ = cv2.stereoCalibrate(
        [points.astype(np.float32).reshape(-1, 1, 3) for _, points, _, _ in pairs],
        [pixels.astype(np.float32).reshape(-1, 1, 2) for _, _, pixels, _ in pairs],
        [pixels.astype(np.float32).reshape(-1, 1, 2) for _, _, _, pixels in pairs],
        *lens,
        sides[0].shape[::-1],
        flags=flags,
        criteria=criteria,
    )
    rig = StereoRig(
        *cameras, rotation=rotation, translation=np.reshape(translation, 3), units=board.units
    )
    errors, distances = [], []
    for _, points, a, b in pairs:
        found = rig.triangulate_points(a, b)
        errors.append(float(np.sqrt(np.mean(found.error**2))))
        distances.append(_misfit(points, found.points))
    board_rms = float(np.sqrt(np.mean(np.concatenate(distances) ** 2)))
    rms = float(np.sqrt(np.mean(np.square(errors))))
    final = StereoRig(
        *cameras,
        rotation=rig.rotation,
        translation=rig.translation,
        units=board.units,
        rms=rms,
        notes=tuple(_notes(rig, pairs, rms, board_rms, board)),
    )
    names = tuple(name for name, *_ in pairs)
    return StereoFit(final, names, tuple(rejected), tuple(errors), board_rms, fits)


def _misfit(points: Array, found: Array) -> Array:
    """Distances after the best rigid motion (Kabsch 1976, doi:10.1107/S0567739476001873)."""
    a, b = points - points.mean(axis=0), found - found.mean(axis=0)
    u, _, v = np.linalg.svd(a.T @ b)
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
    return np.linalg.norm(a @ turn - b, axis=1)


def _notes(
    rig: StereoRig, pairs: list[tuple[str, Array, Array, Array]], rms: float, board_rms: float,
    board: Board,
) -> list[str]:  # fmt: skip
    notes = [f"{side}: {note}" for side in ("left", "right") for note in getattr(rig, side).notes]
    if len(pairs) < 10:
        notes.append(f"{len(pairs)} pairs were used; 10 to 20 make the result dependable")
    if rms > 1.0:
        notes.append(
            f"the reprojection error of {rms:.2f} px is large: were both pictures of each pair "
            "taken at the same moment?"
        )
    if board_rms > 0.02 * board.square:
        notes.append(
            f"triangulated boards are off by {board_rms:.3g} {board.units} rms: positions in space "
            "are no better than that"
        )
    if rig.angle < 10.0:
        notes.append(
            f"the cameras' axes are {rig.angle:.1f} degrees apart: distances along the line of "
            "sight will be noisy; 20 to 40 degrees are better"
        )
    return notes


__all__ = ["StereoFit", "fit_stereo"]
