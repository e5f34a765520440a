"""Two cameras that see the same points: positions in space."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from openprc.errors import CalibrationError
from openprc.vision.calibration.camera import CameraCalibration
from openprc.vision.calibration.mapping import (
    Array,
    FrameCheck,
    as_points,
    finite,
    frame_size,
    length_unit,
)
from openprc.vision.calibration.triangulation import Triangulated, triangulate_pixels

if TYPE_CHECKING:
    from openprc.vision.calibration.boards import Board
    from openprc.vision.calibration.stereo_matching import Correspondences
    from openprc.vision.trajectories.trajectory_set import TrajectorySet


@dataclass(frozen=True, eq=False)
class StereoRig:
    """Two cameras and where the right one is.

    Parameters
    ----------
    left, right : CameraCalibration
        Their `scale_factor` is not used.
    rotation : (3, 3)
        x_right = rotation x_left + translation.
    translation : (3,) [units]
    units : str
        Unit of length.
    rms : float, optional [px]
        Reprojection error of the calibration.
    world_rotation, world_translation : (3, 3), (3,) [units]
        x_world = world_rotation x_left + world_translation; by default the left camera's frame: x
        right, y down, z along its axis.
    notes : tuple of str
        What the user should know.

    Notes
    -----
    Between cameras at an angle a, the one-sigma along the mean direction of view is about that
    across it over tan(a / 2): 20 to 40 degrees are a good compromise.
    """

    left: CameraCalibration
    right: CameraCalibration
    rotation: Array = field(kw_only=True)
    translation: Array = field(kw_only=True)
    units: str = field(default="mm", kw_only=True)
    rms: float | None = field(default=None, kw_only=True)
    world_rotation: Array = field(default=None, kw_only=True)  # type: ignore[assignment]
    world_translation: Array = field(default=None, kw_only=True)  # type: ignore[assignment]
    frame: str = field(default="left camera", kw_only=True)
    notes: tuple[str, ...] = field(default=(), kw_only=True)

    kind: ClassVar[str] = "stereo"
    n_dims: ClassVar[int] = 3
    axes: ClassVar[str] = "x,y,z"
    y_up: ClassVar[bool] = False

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "rotation", rotation_matrix(self.rotation, key="rotation"))
        put(self, "translation", _vector(self.translation, key="translation"))
        turn = np.eye(3) if self.world_rotation is None else self.world_rotation
        shift = np.zeros(3) if self.world_translation is None else self.world_translation
        put(self, "world_rotation", rotation_matrix(turn, key="world_rotation"))
        put(self, "world_translation", _vector(shift, key="world_translation"))
        put(self, "units", length_unit(self.units))
        put(self, "notes", tuple(self.notes))
        if self.baseline == 0.0:
            raise CalibrationError(
                "the two cameras are at the same place",
                expected="a translation other than zero",
                fix="give the position of the right camera's frame",
                key="translation",
            )

    # --- ways to make one -----------------------------------------------------------------

    @classmethod
    def calibrate(
        cls,
        left_images: Any,
        right_images: Any,
        board: Board,
        *,
        left: CameraCalibration | None = None,
        right: CameraCalibration | None = None,
        model: str = "k1k2p1p2k3",
    ) -> StereoRig:
        """Calibrate both cameras and their positions; see `fit_stereo`.

        Parameters
        ----------
        left_images, right_images : iterables of pictures, or folders
            Taken at the same moments, in the same order.
        board : Chessboard, Charuco or CircleGrid
        left, right : CameraCalibration, optional
            Cameras that are calibrated already.
        model : str
            Distortion that is estimated, as in `calibrate_camera`.

        Raises
        ------
        CalibrationError
        """
        from openprc.vision.calibration.stereo_fit import fit_stereo  # noqa: PLC0415 - OpenCV

        return fit_stereo(left_images, right_images, board, left=left, right=right, model=model).rig

    def in_board_frame(self, image_left: Any, board: Board, *, y_up: bool = False) -> StereoRig:
        """Return the rig with the axes of a board as the left camera sees it.

        Parameters
        ----------
        image_left : picture
            Of the left camera.
        board : Chessboard, Charuco or CircleGrid
            In the units of the rig. Its x points right, y down, z away from the camera.
        y_up : bool
            Turn y and z round: y up, z towards the camera.
        """
        from openprc.vision.calibration.board_images import read_image  # noqa: PLC0415 - OpenCV
        from openprc.vision.calibration.facets import board_pose  # noqa: PLC0415 - OpenCV

        if board.units != self.units:
            raise CalibrationError(
                f"the board is in {board.units}, the rig in {self.units}",
                expected="one unit",
                fix="describe the board in the units of the rig",
                key="units",
            )
        pose = board_pose(read_image(image_left), board, self.left)
        turn = np.diag([1.0, -1.0, -1.0]) if y_up else np.eye(3)
        back = turn @ pose.rotation.T
        return replace(
            self,
            world_rotation=back,
            world_translation=-back @ pose.translation,
            frame="board, y up" if y_up else "board",
        )

    # --- geometry -------------------------------------------------------------------------

    @property
    def baseline(self) -> float:
        """Distance of the two cameras [units]."""
        return float(np.linalg.norm(self.translation))

    @property
    def angle(self) -> float:
        """Angle between the axes of the two cameras [deg]."""
        return float(np.degrees(np.arccos(np.clip(self.rotation[2, 2], -1.0, 1.0))))

    def to_world(self, points: ArrayLike) -> Array:
        """Return points of the left camera's frame in the world's, (..., 3) [units]."""
        return as_points(points, dims=3) @ self.world_rotation.T + self.world_translation

    def to_pixels(self, points: ArrayLike) -> tuple[Array, Array]:
        """Return the pixels of both cameras that see points of the world, two (..., 2) [px]."""
        inside = (as_points(points, dims=3) - self.world_translation) @ self.world_rotation
        return (
            self.left.project(inside),
            self.right.project(inside @ self.rotation.T + self.translation),
        )

    def locate(self, pixels_left: ArrayLike, pixels_right: ArrayLike) -> Array:
        """Return points of the world, (..., 2) [px] twice -> (..., 3) [units]; NaN stays NaN."""
        a, b = as_points(pixels_left, key="left"), as_points(pixels_right, key="right")
        found = self.triangulate_points(a.reshape(-1, 2), b.reshape(-1, 2))
        return found.points.reshape(*a.shape[:-1], 3)

    def triangulate_points(
        self,
        pixels_left: ArrayLike,
        pixels_right: ArrayLike,
        *,
        sigma_left: ArrayLike | None = None,
        sigma_right: ArrayLike | None = None,
    ) -> Triangulated:
        """Return points of the world with their reprojection errors and covariances.

        Parameters
        ----------
        pixels_left, pixels_right : (n, 2) [px]
        sigma_left, sigma_right : (n, 2) [px], optional
            One-sigma of the pixels.
        """
        pixels = (as_points(pixels_left, key="left"), as_points(pixels_right, key="right"))
        if pixels[0].shape != pixels[1].shape:
            raise CalibrationError(
                f"the left camera has {len(pixels[0])} points, the right one {len(pixels[1])}",
                expected="the same points in the same order",
                fix="track in the right camera what `correspondences` found there",
                key="pixels_right",
            )
        sigmas = None
        if sigma_left is not None and sigma_right is not None:
            sigmas = (as_points(sigma_left, key="sigma"), as_points(sigma_right, key="sigma"))
        found = triangulate_pixels(
            (self.left, self.right), self.rotation, self.translation, pixels, sigmas
        )
        turn = self.world_rotation
        return replace(
            found, points=self.to_world(found.points), covariance=turn @ found.covariance @ turn.T
        )

    def check_frame(self, shape: tuple[int, int]) -> FrameCheck:
        """Say whether the left camera fits images of a height and a width [px]."""
        return self.left.check_frame(frame_size(shape))

    # --- recordings -------------------------------------------------------------------------

    def triangulate(
        self,
        left: Any,
        right: Any,
        *,
        time_offset: float = 0.0,
        max_error: float = 5.0,
    ) -> TrajectorySet:
        """Join the tracks of both cameras; see `openprc.vision.calibration.stereo_tracks.join`.

        Parameters
        ----------
        left, right : TrackingResult or TrajectorySet
            The same points in the same order.
        time_offset : float [s]
            Added to the right camera's times; see `estimate_time_offset`.
        max_error : float [px]
            Points whose reprojection error is larger become missing.

        Returns
        -------
        TrajectorySet
            (T, N, 3) on the left camera's clock. ``quality`` is the reprojection error [px].
        """
        from openprc.vision.calibration.stereo_tracks import join  # noqa: PLC0415 - knows this class

        return join(self, left, right, time_offset=time_offset, max_error=max_error)

    def correspondences(
        self,
        image_left: Any,
        image_right: Any,
        points_left: ArrayLike,
        *,
        depth_range: tuple[float, float] | None = None,
        subset: int = 31,
    ) -> Correspondences:
        """Find points of the left picture in the right one; see `stereo_matching.match`."""
        from openprc.vision.calibration.stereo_matching import match  # noqa: PLC0415 - compiles

        return match(
            self, image_left, image_right, points_left, depth_range=depth_range, subset=subset
        )

    # --- files --------------------------------------------------------------------------------

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain values."""
        return {
            "kind": self.kind,
            "units": self.units,
            "left": self.left.as_dict(),
            "right": self.right.as_dict(),
            "rotation": self.rotation.tolist(),
            "translation": self.translation.tolist(),
            "rms": self.rms,
            "world_rotation": self.world_rotation.tolist(),
            "world_translation": self.world_translation.tolist(),
            "frame": self.frame,
            "notes": list(self.notes),
        }

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> StereoRig:
        """Make it from `as_dict`."""
        entries = {key: value for key, value in values.items() if key != "kind"}
        cameras = [CameraCalibration.from_dict(entries.pop(side)) for side in ("left", "right")]
        return cls(*cameras, **entries)


def rotation_matrix(found: Any, *, key: str) -> Array:
    """Return a rotation as a new array (3, 3).

    Raises
    ------
    CalibrationError
        When it is none.
    """
    try:
        matrix = np.array(found, np.float64)
    except (TypeError, ValueError):
        matrix = np.zeros(0)
    # Files hold rotations to six digits or more.
    if matrix.shape != (3, 3) or not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-5):
        what = f"of the shape {matrix.shape}" if matrix.shape != (3, 3) else "not orthogonal"
        raise CalibrationError(
            f"the rotation is {what}",
            expected="a (3, 3) rotation matrix",
            fix="turn a rotation vector into a matrix with cv2.Rodrigues",
            key=key,
        )
    if np.linalg.det(matrix) < 0.0:
        raise CalibrationError(
            "the rotation is a reflection (its determinant is -1)",
            expected="a right-handed rotation matrix",
            fix="check the axes",
            key=key,
        )
    return matrix


def _vector(found: Any, *, key: str) -> Array:
    vector = np.array(found, np.float64).reshape(-1)
    if vector.shape != (3,):
        raise CalibrationError(
            f"{key} has {vector.size} numbers",
            expected="three numbers",
            fix="give x, y and z",
            key=key,
        )
    return np.array([finite(value, key=key) for value in vector])
