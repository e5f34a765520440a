"""A plane seen at an angle: pixels to positions on it, tilt and perspective included."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from openprc.errors import CalibrationError
from openprc.vision.calibration.camera import CameraCalibration
from openprc.vision.calibration.homography import (
    apply_homography,
    fit_homography,
    homography_jacobian,
)
from openprc.vision.calibration.mapping import (
    Array,
    Calibration,
    as_points,
    frame_size,
    length_unit,
)

if TYPE_CHECKING:
    from openprc.vision.calibration.boards import Board


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanarTarget(Calibration):
    """Positions on a plane of which at least four points are known.

    Right for motion in that plane, whatever its tilt. Without a `camera` the lens is taken to be
    free of distortion.

    Parameters
    ----------
    homography : (3, 3)
        From (X, Y, 1) on the plane [units] to the pixels of the ideal camera.
    units : str
        Unit of length.
    camera : CameraCalibration, optional
        Takes out the distortion before.
    frame_shape : (int, int), optional
        Height and width of the images [px].
    rms : float, optional [px]
        Distance of the points from where the plane would put them.
    n_points : int
        How many points were used.
    centre : (2,) [units]
        Middle of the points used.
    covariance : (9, 9), optional
        Of the entries of the homography, row after row.
    notes : tuple of str
        What the user should know.
    """

    homography: Array
    units: str = "mm"
    camera: CameraCalibration | None = None
    frame_shape: tuple[int, int] | None = None
    rms: float | None = None
    n_points: int = 0
    centre: tuple[float, float] = (0.0, 0.0)
    covariance: Array | None = field(default=None, repr=False)
    notes: tuple[str, ...] = ()

    kind: ClassVar[str] = "plane"

    def __post_init__(self) -> None:
        put = object.__setattr__
        matrix = np.array(self.homography, np.float64)
        if matrix.shape != (3, 3) or not np.isfinite(matrix).all() or np.linalg.cond(matrix) > 1e15:
            raise CalibrationError(
                f"the homography is {np.asarray(self.homography).tolist()}",
                expected="a (3, 3) matrix that has an inverse",
                fix="use PlanarTarget.from_points",
                key="homography",
            )
        matrix.flags.writeable = False
        put(self, "homography", matrix)
        put(self, "units", length_unit(self.units))
        if self.frame_shape is None and self.camera is not None:
            put(self, "frame_shape", self.camera.frame_shape)
        elif self.frame_shape is not None:
            put(self, "frame_shape", frame_size(self.frame_shape))
        if self.covariance is not None:
            put(self, "covariance", np.array(self.covariance, np.float64).reshape(9, 9))
        put(self, "centre", tuple(float(value) for value in self.centre))
        put(self, "notes", tuple(self.notes))

    # --- ways to make one -----------------------------------------------------------------

    @classmethod
    def from_points(
        cls,
        pixels: ArrayLike,
        plane: ArrayLike,
        units: str = "mm",
        *,
        camera: CameraCalibration | None = None,
        frame_shape: tuple[int, int] | None = None,
    ) -> PlanarTarget:
        """Fit the plane to points of which both positions are known.

        Parameters
        ----------
        pixels : (n, 2) [px]
            At least four.
        plane : (n, 2) [units]
            Where these are on the plane; the axes are yours, y up or down.
        units : str
            Unit of length.
        camera : CameraCalibration, optional
            Takes out the distortion before.
        frame_shape : (int, int), optional
            Height and width of the images [px].

        Raises
        ------
        CalibrationError
            When there are fewer than four points, or they lie on a line.
        """
        seen, known = as_points(pixels, key="pixels"), as_points(plane, key="plane")
        if camera is not None and frame_shape is not None:
            camera = _fitting(camera, frame_shape)
        ideal = seen if camera is None else camera.undistorted(seen)
        fit = fit_homography(known, ideal)
        notes = () if len(known) > 4 else (
            "four points fit exactly whatever their errors: with more, the errors would be known",
        )  # fmt: skip
        target = cls(
            homography=fit.matrix,
            units=units,
            camera=camera,
            frame_shape=frame_shape,
            n_points=len(known),
            centre=tuple(known.mean(axis=0)),  # type: ignore[arg-type]
            covariance=fit.covariance,
            notes=notes,
        )
        if len(known) == 4:
            return target
        # In the picture as it is: the fit was made in the undistorted one.
        errors = seen - target.to_pixels(known)
        return replace(target, rms=float(np.sqrt(np.mean(np.sum(errors**2, axis=1)))))

    @classmethod
    def from_board(
        cls,
        image: Any,
        board: Board,
        *,
        camera: CameraCalibration | None = None,
        y_up: bool = False,
    ) -> PlanarTarget:
        """Fit the plane in which a board lies.

        Parameters
        ----------
        image : (H, W[, 3]) array or path-like
            One picture of the board in the plane of motion.
        board : Chessboard, Charuco or CircleGrid
        camera : CameraCalibration, optional
            Takes out the distortion before.
        y_up : bool
            Count the board's y upwards, not downwards.

        Raises
        ------
        CalibrationError
            When the board is not found.
        """
        from openprc.vision.calibration.board_images import read_image  # noqa: PLC0415 - OpenCV

        picture = read_image(image)
        view = board.find(picture)
        plane = view.points[:, :2] * (1.0, -1.0 if y_up else 1.0)
        return cls.from_points(
            view.pixels, plane, board.units, camera=camera, frame_shape=picture.shape[:2]
        )

    # --- the map ----------------------------------------------------------------------------

    @property
    def y_up(self) -> bool:  # type: ignore[override]
        """Whether y of the plane points against the rows of the image."""
        return bool(homography_jacobian(self.homography, np.array(self.centre))[1, 1] < 0.0)

    @property
    def _inverse(self) -> Array:
        inverse = np.linalg.inv(self.homography)
        return inverse / np.linalg.norm(inverse)

    def to_physical(self, points: ArrayLike) -> Array:
        """Return positions on the plane, (..., 2) [px] -> (..., 2) [units]; NaN stays NaN.

        Raises
        ------
        CalibrationError
            For pixels beyond the horizon of the plane, or out of reach of the distortion model.
        """
        pixels = as_points(points)
        ideal = pixels if self.camera is None else self.camera.undistorted(pixels)
        out, third = apply_homography(self._inverse, ideal)
        if (third <= 0.0).any():
            x, y = pixels[third <= 0.0].reshape(-1, 2)[0]
            raise CalibrationError(
                f"{int((third <= 0.0).sum())} pixels do not see the plane, the first at "
                f"({x:.1f}, {y:.1f}) px: they are beyond its horizon",
                expected="points on the plane",
                fix="leave out those points, or check the points that the plane was fitted to",
            )
        return out

    def to_pixels(self, points: ArrayLike) -> Array:
        """Return the pixels that see points of the plane; NaN for points behind the camera."""
        ideal, third = apply_homography(self.homography, as_points(points))
        ideal[~(third > 0.0)] = np.nan
        return ideal if self.camera is None else self.camera.from_normalized(
            self.camera._normalise(ideal)
        )  # fmt: skip

    def jacobian(self, points: ArrayLike) -> Array:
        """Return the derivative of `to_physical`, (..., 2, 2) [units/px]."""
        pixels = as_points(points)
        if self.camera is None:
            return homography_jacobian(self._inverse, pixels)
        lens = self.camera.matrix[:2, :2] @ self.camera.normalized_jacobian(pixels)
        return homography_jacobian(self._inverse, self.camera.undistorted(pixels)) @ lens

    def calibration_sigma(self, points: ArrayLike) -> Array:
        """Return the one-sigma of the map itself, (..., 2) [px] -> (..., 2) [units].

        It is common to all frames: a shift of the point, not jitter. NaN where four points were
        used, whose errors are unknown.
        """
        pixels = as_points(points)
        if self.covariance is None:
            return np.full(pixels.shape, np.nan)
        plane = self.to_physical(pixels)
        image, third = apply_homography(self.homography, plane)
        j = np.zeros((*plane.shape[:-1], 2, 9))
        row = np.concatenate([plane, np.ones((*plane.shape[:-1], 1))], -1) / third[..., np.newaxis]
        j[..., 0, 0:3] = j[..., 1, 3:6] = row
        j[..., :, 6:9] = -image[..., :, np.newaxis] * row[..., np.newaxis, :]
        back = np.linalg.inv(homography_jacobian(self.homography, plane)) @ j
        return np.sqrt(np.einsum("...ik,kl,...il->...i", back, self.covariance, back))

    # --- what it looks like -----------------------------------------------------------------

    def _axis_jacobian(self) -> Array:
        """Derivative of the ideal image by the plane, where the optical axis meets it."""
        matrix = self.homography
        if self.camera is not None:
            matrix = np.linalg.inv(self.camera.matrix) @ matrix
            axis = np.zeros(2)
        elif self.frame_shape is not None:
            axis = 0.5 * (np.array(self.frame_shape[::-1], np.float64) - 1.0)
        else:
            axis = apply_homography(matrix, np.array(self.centre))[0]
        plane, third = apply_homography(
            np.linalg.inv(matrix) * np.sign(np.linalg.det(matrix)), axis
        )
        del third
        return homography_jacobian(matrix, plane)

    @property
    def tilt(self) -> float:
        """Angle between the plane and the sensor [deg].

        On the optical axis lengths along the tilt are shorter by its cosine. Without a camera the
        axis is taken to be in the middle of the image (of the points, where its size is not known)
        and the pixels to be square.
        """
        large, small = np.linalg.svd(self._axis_jacobian(), compute_uv=False)
        return float(np.degrees(np.arccos(min(1.0, small / large))))

    @property
    def scale(self) -> float:
        """Length of a pixel at the middle of the points, mean of all directions [units/px]."""
        pixel = self.to_pixels(np.array(self.centre))
        return float(np.sqrt(abs(np.linalg.det(self.jacobian(pixel)))))

    # --- other sizes, files -------------------------------------------------------------------

    def turned_up(self) -> PlanarTarget:
        """Return the same plane with y counted the other way, if it points down."""
        if self.y_up:
            return self
        turn = np.diag([1.0, -1.0, 1.0])
        wide = np.kron(np.eye(3), turn)
        x, y = self.centre
        return replace(
            self,
            homography=self.homography @ turn,
            centre=(x, -y),
            covariance=None if self.covariance is None else wide @ self.covariance @ wide.T,
        )

    def rescaled(self, shape: tuple[int, int]) -> PlanarTarget | None:
        """Return the same plane in images of another resolution."""
        if self.frame_shape is None:
            return None
        new = frame_size(shape)
        fx, fy = new[1] / self.frame_shape[1], new[0] / self.frame_shape[0]
        resize = np.array([[fx, 0.0, 0.5 * fx - 0.5], [0.0, fy, 0.5 * fy - 0.5], [0.0, 0.0, 1.0]])
        wide = np.kron(resize, np.eye(3))
        return replace(
            self,
            homography=resize @ self.homography,
            camera=None if self.camera is None else self.camera.rescaled(new),
            frame_shape=new,
            rms=None if self.rms is None else self.rms * fx,
            covariance=None if self.covariance is None else wide @ self.covariance @ wide.T,
        )

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain values."""
        return {
            "kind": self.kind,
            "units": self.units,
            "homography": self.homography.tolist(),
            "camera": None if self.camera is None else self.camera.as_dict(),
            "frame_shape": None if self.frame_shape is None else list(self.frame_shape),
            "rms": self.rms,
            "n_points": self.n_points,
            "centre": list(self.centre),
            "covariance": None if self.covariance is None else self.covariance.tolist(),
            "notes": list(self.notes),
        }

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> PlanarTarget:
        """Make it from `as_dict`."""
        entries = {key: value for key, value in values.items() if key != "kind"}
        if entries.get("camera") is not None:
            entries["camera"] = CameraCalibration.from_dict(entries["camera"])
        return cls(**entries)


def _fitting(camera: CameraCalibration, shape: tuple[int, int]) -> CameraCalibration:
    check = camera.check_frame(shape)
    if check.warning is not None:
        raise CalibrationError(
            check.warning.partition(":")[0],
            expected="images of the size that the camera was calibrated with, or of its shape",
            fix="calibrate the camera at this setting",
            key="frame_shape",
        )
    return check.calibration  # type: ignore[return-value]
