"""A pinhole camera with a lens: pixels to directions, and to lengths on a plane in front of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from openprc.errors import CalibrationError
from openprc.vision.calibration.distortion import (
    coefficients,
    distort,
    distortion_jacobian,
    undistort,
    valid_radius,
)
from openprc.vision.calibration.intrinsics import doubts, intrinsic_matrix
from openprc.vision.calibration.mapping import (
    Array,
    Calibration,
    as_points,
    finite,
    frame_size,
    length_unit,
)


@dataclass(frozen=True, eq=False, kw_only=True)
class CameraCalibration(Calibration):
    """Intrinsics of a camera, and the distance of the plane on which things move.

    A pixel (u, v) is freed from the distortion of the lens and becomes
    ((u - cx) / fx, (v - cy) / fy) times `scale_factor`: a length on the plane at that distance,
    parallel to the sensor, counted from the optical axis.

    Parameters
    ----------
    matrix : (3, 3) [px]
        Intrinsic matrix [[fx, s, cx], [0, fy, cy], [0, 0, 1]].
    dist : (n,)
        Distortion in OpenCV's order, see `openprc.vision.calibration.distortion`.
    frame_shape : (int, int)
        Height and width of the images that the matrix belongs to [px].
    scale_factor : float [units]
        Distance of the plane from the camera along its axis.
    units : str
        Unit of `scale_factor` and of all results; "1" for coordinates at unit distance.
    y_up : bool
        Count y upwards.
    rms : float, optional [px]
        Reprojection error of the calibration.
    sigma : dict
        One-sigma of fx, fy, cx, cy [px] and of the distortion, where they were estimated.
    notes : tuple of str
        What the user should know.

    Examples
    --------
    >>> K = [[1000.0, 0.0, 320.0], [0.0, 1000.0, 240.0], [0.0, 0.0, 1.0]]
    >>> camera = CameraCalibration.from_matrix(K, frame_shape=(480, 640), scale_factor=500.0)
    >>> camera.to_physical([330.0, 240.0]), camera.units
    (array([5., 0.]), 'mm')
    """

    matrix: Array
    dist: Array = field(default=None)  # type: ignore[assignment]
    frame_shape: tuple[int, int]
    scale_factor: float = 1.0
    units: str = "1"
    y_up: bool = False
    rms: float | None = None
    sigma: dict[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    kind: ClassVar[str] = "camera"

    def __post_init__(self) -> None:
        put = object.__setattr__
        shape = frame_size(self.frame_shape)
        put(self, "frame_shape", shape)
        put(self, "matrix", intrinsic_matrix(self.matrix))
        put(self, "dist", coefficients(self.dist))
        put(self, "scale_factor", finite(self.scale_factor, key="scale_factor", above=0.0))
        put(self, "units", length_unit(self.units, key="physical_units"))
        put(self, "y_up", bool(self.y_up))
        for array in (self.matrix, self.dist):
            array.flags.writeable = False
        notes = list(self.notes)
        notes += [note for note in doubts(self.matrix, shape) if note not in notes]
        put(self, "notes", tuple(notes))

    # --- ways to make one -----------------------------------------------------------------

    @classmethod
    def from_matrix(
        cls,
        K: ArrayLike,
        dist: ArrayLike | None = None,
        *,
        frame_shape: tuple[int, int],
        scale_factor: float | None = None,
        physical_units: str | None = None,
        y_up: bool = False,
        **attributes: Any,
    ) -> CameraCalibration:
        """Take an intrinsic matrix and distortion coefficients.

        Parameters
        ----------
        K : (3, 3) [px]
        dist : (n,), optional
            4, 5, 8, 12 or 14 coefficients in OpenCV's order.
        frame_shape : (int, int)
            Height and width of the images of that calibration [px].
        scale_factor : float, optional [physical_units]
            Distance of the plane. Without it, results are coordinates at unit distance.
        physical_units : str, optional
            Unit of length, "mm" by default.
        y_up : bool
            Count y upwards.

        Raises
        ------
        CalibrationError, UnitError
        """
        notes = tuple(attributes.pop("notes", ()))
        if scale_factor is None:
            scale_factor = 1.0
            if physical_units is None:
                physical_units = "1"
            elif physical_units != "1":
                notes += (
                    f"no scale_factor was given: the plane is taken to be 1 {physical_units} in "
                    "front of the camera",
                )
        return cls(
            matrix=K,  # type: ignore[arg-type]
            dist=dist,  # type: ignore[arg-type]
            frame_shape=frame_shape,
            scale_factor=scale_factor,
            units="mm" if physical_units is None else physical_units,
            y_up=y_up,
            notes=notes,
            **attributes,
        )

    @classmethod
    def from_intrinsics(
        cls,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        *,
        frame_shape: tuple[int, int],
        dist: ArrayLike | None = None,
        scale_factor: float | None = None,
        physical_units: str | None = None,
        y_up: bool = False,
    ) -> CameraCalibration:
        """Take focal lengths and principal point [px]; the rest as in `from_matrix`."""
        return cls.from_matrix(
            [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]],
            dist,
            frame_shape=frame_shape,
            scale_factor=scale_factor,
            physical_units=physical_units,
            y_up=y_up,
        )

    @classmethod
    def from_opencv_yaml(
        cls,
        path: str | Path,
        *,
        frame_shape: tuple[int, int] | None = None,
        scale_factor: float | None = None,
        physical_units: str | None = None,
        y_up: bool = False,
    ) -> CameraCalibration:
        """Read a file of OpenCV's FileStorage (YAML, XML, JSON) or a ROS camera_info.

        Parameters
        ----------
        path : path-like
        frame_shape : (int, int), optional
            Needed only where the file has no image size.
        scale_factor, physical_units, y_up
            As in `from_matrix`.

        Raises
        ------
        UnreadableFile
            When it is no such file.
        CalibrationError
            When the matrix is missing or makes no sense.
        """
        # OpenCV reads its own format; it is not needed to use a calibration.
        from openprc.vision.calibration.opencv_file import read_opencv_file  # noqa: PLC0415

        found = read_opencv_file(path)
        shape = frame_shape if frame_shape is not None else found.pop("frame_shape", None)
        found.pop("frame_shape", None)
        if shape is None:
            raise CalibrationError(
                "the file does not say for which size of image it was made",
                expected="image_width and image_height, or the argument frame_shape",
                fix="pass frame_shape=(height, width) of the images of that calibration",
                file=path,
                key="image_width",
            )
        return cls.from_matrix(
            found.pop("K"),
            found.pop("dist"),
            frame_shape=shape,
            scale_factor=scale_factor,
            physical_units=physical_units,
            y_up=y_up,
            **found,
        )

    # --- the lens ---------------------------------------------------------------------------

    def to_normalized(self, points: ArrayLike, *, outside: str = "raise") -> Array:
        """Return the directions in which pixels look, x/z and y/z, without distortion.

        Parameters
        ----------
        points : (..., 2) [px]
            NaN stays NaN.
        outside : {"raise", "nan"}
            What becomes of pixels that the distortion model does not reach.

        Raises
        ------
        CalibrationError
            For such pixels, when they are not to become NaN.
        """
        pixels = as_points(points)
        ideal, solved = undistort(self._normalise(pixels), self.dist)
        if outside == "raise" and not solved.all():
            lost = pixels[~solved]
            x, y = lost.reshape(-1, 2)[0]
            raise CalibrationError(
                f"{len(lost.reshape(-1, 2))} points lie where the lens distortion has no inverse, "
                f"the first at ({x:.1f}, {y:.1f}) px",
                expected="points inside the part of the image that the calibration covers: the "
                f"model holds up to {valid_radius(self.dist):.4g} from the axis (tangent of the "
                "angle)",
                fix="calibrate with boards in the corners of the image, use fewer coefficients, or "
                "leave out those points",
                key="dist",
            )
        return ideal

    def undistorted(self, points: ArrayLike) -> Array:
        """Return where a camera without distortion would see points, (..., 2) [px]."""
        return self._pixels(self.to_normalized(points))

    def from_normalized(self, directions: ArrayLike) -> Array:
        """Return the pixels that see directions x/z, y/z, distortion included, (..., 2) [px]."""
        return self._pixels(distort(as_points(directions), self.dist))

    def project(self, points: ArrayLike) -> Array:
        """Return the pixels of points in front of the camera.

        Parameters
        ----------
        points : (..., 3)
            x right, y down, z along the optical axis, any unit.

        Returns
        -------
        (..., 2) [px]
            NaN for points behind the camera, which no pixel sees.
        """
        xyz = as_points(points, dims=3)
        z = np.where(xyz[..., 2:] > 0.0, xyz[..., 2:], np.nan)
        return self.from_normalized(xyz[..., :2] / z)

    def normalized_jacobian(self, points: ArrayLike) -> Array:
        """Return the derivative of `to_normalized` at pixels, (..., 2, 2) [1/px]."""
        ideal = self.to_normalized(points, outside="nan")
        forward = self.matrix[:2, :2] @ distortion_jacobian(ideal, self.dist)
        a, b, c, d = forward[..., 0, 0], forward[..., 0, 1], forward[..., 1, 0], forward[..., 1, 1]
        inverse = np.stack([np.stack([d, -b], -1), np.stack([-c, a], -1)], -2)
        return inverse / (a * d - b * c)[..., np.newaxis, np.newaxis]

    def _normalise(self, pixels: Array) -> Array:
        inverse = np.linalg.inv(self.matrix[:2, :2])
        return (pixels - self.matrix[:2, 2]) @ inverse.T

    def _pixels(self, normalised: Array) -> Array:
        return normalised @ self.matrix[:2, :2].T + self.matrix[:2, 2]

    # --- the plane --------------------------------------------------------------------------

    @property
    def _slopes(self) -> Array:
        return self.scale_factor * np.array([1.0, -1.0 if self.y_up else 1.0])

    def to_physical(self, points: ArrayLike) -> Array:
        """Return positions from the optical axis on the plane, (..., 2) [px] -> (..., 2) [units].

        Raises
        ------
        CalibrationError
            For pixels that the distortion model does not reach.
        """
        return self.to_normalized(points) * self._slopes

    def to_pixels(self, points: ArrayLike) -> Array:
        """Return the pixels that see points of the plane, (..., 2) [units] -> (..., 2) [px]."""
        return self.from_normalized(as_points(points) / self._slopes)

    def jacobian(self, points: ArrayLike) -> Array:
        """Return the derivative of `to_physical`, (..., 2, 2) [units/px]."""
        return self._slopes[:, np.newaxis] * self.normalized_jacobian(points)

    # --- other sizes, other planes, files -----------------------------------------------------

    def at_distance(self, distance: float, *, units: str = "mm") -> CameraCalibration:
        """Return the same camera for a plane at another distance."""
        return replace(self, scale_factor=distance, units=units)

    def rescaled(self, shape: tuple[int, int]) -> CameraCalibration:
        """Return the same camera at another resolution of the same field of view.

        The corner of the image stays where it is, so that cx + 1/2 scales, not cx.
        """
        new = frame_size(shape)
        factor = np.array([new[1] / self.frame_shape[1], new[0] / self.frame_shape[0]])
        matrix = self.matrix.copy()
        matrix[:2] *= factor[:, np.newaxis]
        matrix[:2, 2] += 0.5 * factor - 0.5
        along = {"fx": 0, "cx": 0, "fy": 1, "cy": 1}
        sigma = {
            name: value * (factor[along[name]] if name in along else 1.0)
            for name, value in self.sigma.items()
        }
        rms = None if self.rms is None else self.rms * float(factor.mean())
        return replace(self, matrix=matrix, frame_shape=new, sigma=sigma, rms=rms)

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain values."""
        return {
            "kind": self.kind,
            "units": self.units,
            "matrix": self.matrix.tolist(),
            "dist": self.dist.tolist(),
            "frame_shape": list(self.frame_shape),
            "scale_factor": self.scale_factor,
            "y_up": self.y_up,
            "rms": self.rms,
            "sigma": {key: float(value) for key, value in self.sigma.items()},
            "notes": list(self.notes),
        }

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> CameraCalibration:
        """Make it from `as_dict`."""
        return cls(**{key: value for key, value in values.items() if key != "kind"})
