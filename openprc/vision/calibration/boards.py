"""Boards with a known pattern: what they look like, and where their points are in a picture."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import CalibrationError
from openprc.vision.calibration.corner_refinement import refine_corners
from openprc.vision.calibration.mapping import Array, finite, length_unit
from openprc.vision.opencv import load_cv2


@dataclass(frozen=True, slots=True)
class BoardView:
    """The points of a board that one picture shows.

    Attributes
    ----------
    ids : (n,)
        Which points of the board.
    points : (n, 3) [units of the board]
        Where they are on it, z = 0, x right and y down.
    pixels : (n, 2) [px]
        Where they are in the picture.
    """

    ids: NDArray[np.intp]
    points: Array
    pixels: Array


@dataclass(frozen=True)
class Board:
    """What all boards have in common; use `Chessboard`, `Charuco` or `CircleGrid`.

    Parameters
    ----------
    columns, rows : int
        Size of the pattern, counted as each board says.
    square : float [units]
        Side of a square, or distance of neighbouring circles.
    units : str
        Unit of length.
    """

    columns: int
    rows: int
    square: float
    units: str = "mm"

    def __post_init__(self) -> None:
        for key in ("columns", "rows"):
            value = getattr(self, key)
            if not isinstance(value, int | np.integer) or value < 2 or value > 1000:
                raise CalibrationError(
                    f"the board has {value!r} {key}",
                    expected="a whole number of at least 2",
                    fix="count the pattern of the board",
                    key=key,
                )
        object.__setattr__(self, "square", finite(self.square, key="square", above=0.0))
        length_unit(self.units)

    @property
    def points(self) -> Array:
        """All points of the board, (n, 3) [units], row after row."""
        x, y = np.meshgrid(np.arange(float(self.columns)), np.arange(float(self.rows)))
        return self.square * np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])

    def find(self, image: NDArray[np.uint8]) -> BoardView:
        """Find the board in a picture (H, W).

        Raises
        ------
        CalibrationError
            When it is not there.
        """
        raise NotImplementedError

    def _upright(self, pixels: Array) -> BoardView:
        """Number a complete grid so that x points right in the picture, as far as it can.

        A plain grid looks the same from two sides (a square one from four), and the finder may
        begin at any of its corners.
        """
        grid = pixels.reshape(self.rows, self.columns, 2)
        turns = [grid, grid[::-1, ::-1]]
        if self.rows == self.columns:
            quarter = np.swapaxes(grid, 0, 1)
            turns += [quarter[::-1], quarter[:, ::-1]]
        mirrored = [turn[:, ::-1] for turn in turns]
        upright = [t for t in turns + mirrored if _handed(t) > 0.0]
        best = max(upright, key=lambda t: _pointing_right(t))
        return BoardView(
            np.arange(grid.size // 2), self.points, np.ascontiguousarray(best.reshape(-1, 2))
        )

    def _refined(self, image: NDArray[np.uint8], view: BoardView, *, free: float) -> BoardView:
        plane = view.points[:, :2]
        pixels = refine_corners(image, plane, view.pixels, square=self.square, free=free)
        return BoardView(view.ids, view.points, pixels)

    def _missing(self, what: str) -> CalibrationError:
        return CalibrationError(
            f"{what} not found",
            expected="the whole board, sharp, evenly lit, with a bright margin around it",
            fix="check the counts of the pattern, and the picture",
        )


def _sides(grid: Array) -> tuple[Array, Array]:
    return (grid[:, -1] - grid[:, 0]).mean(axis=0), (grid[-1] - grid[0]).mean(axis=0)


def _handed(grid: Array) -> float:
    x, y = _sides(grid)
    return float(x[0] * y[1] - x[1] * y[0])


def _pointing_right(grid: Array) -> float:
    x, _ = _sides(grid)
    return float(x[0] / np.hypot(*x))


@dataclass(frozen=True)
class Chessboard(Board):
    """A chessboard; `columns` and `rows` count the inner corners.

    Examples
    --------
    >>> Chessboard(9, 6, 25.0, "mm").points.shape
    (54, 3)
    """

    def find(self, image: NDArray[np.uint8]) -> BoardView:
        """Find all inner corners in a picture (H, W); raises CalibrationError."""
        cv2 = load_cv2()
        size = (self.columns, self.rows)
        found, corners = False, None
        if min(image.shape) >= 3 * max(size):
            flags = cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE
            found, corners = cv2.findChessboardCornersSB(image, size, flags=flags)
        if not found:
            raise self._missing(f"a chessboard with {self.columns} x {self.rows} inner corners was")
        view = self._upright(np.asarray(corners, np.float64).reshape(-1, 2))
        return self._refined(image, view, free=0.45)


@dataclass(frozen=True)
class CircleGrid(Board):
    """A grid of dark circles; `square` is the distance of neighbours.

    In an asymmetric grid every other row is shifted by half of the distance of the columns, and
    `square` is that half: points lie at (2 i + j mod 2, j) times `square`.
    """

    asymmetric: bool = False

    @property
    def points(self) -> Array:
        """All points of the board, (n, 3) [units], row after row."""
        if not self.asymmetric:
            return super().points
        i, j = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        x, y = 2.0 * i + j % 2, 1.0 * j
        return self.square * np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])

    def find(self, image: NDArray[np.uint8]) -> BoardView:
        """Find all circles in a picture (H, W); raises CalibrationError."""
        cv2 = load_cv2()
        kind = cv2.CALIB_CB_ASYMMETRIC_GRID if self.asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
        found, centres = False, None
        if min(image.shape) >= 3 * max(self.columns, self.rows):
            found, centres = cv2.findCirclesGrid(image, (self.columns, self.rows), flags=kind)
        if not found:
            raise self._missing(f"a grid of {self.columns} x {self.rows} circles was")
        pixels = np.asarray(centres, np.float64).reshape(-1, 2)
        if self.asymmetric:
            return BoardView(np.arange(len(pixels)), self.points, pixels)
        return self._upright(pixels)


@dataclass(frozen=True)
class Charuco(Board):
    """A chessboard with markers in its white squares; it may be seen in part.

    Parameters
    ----------
    columns, rows : int
        Number of squares.
    square : float [units]
        Side of a square.
    units : str
        Unit of length.
    marker : float [units]
        Side of a marker.
    dictionary : str
        Name of the set of markers in OpenCV, such as DICT_5X5_100.
    """

    marker: float = 0.0
    dictionary: str = "DICT_5X5_100"

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "marker", finite(self.marker, key="marker", above=0.0))
        if self.marker >= self.square:
            raise CalibrationError(
                f"the markers have a side of {self.marker:g}, the squares {self.square:g}",
                expected="markers smaller than the squares they stand in",
                fix="measure both on the board",
                key="marker",
            )
        if not re.fullmatch(r"DICT_\w+", str(self.dictionary)):
            raise CalibrationError(
                f"the set of markers is {self.dictionary!r}",
                expected="a name of OpenCV such as DICT_5X5_100 or DICT_4X4_50",
                fix="use the name the board was generated with",
                key="dictionary",
            )

    @property
    def points(self) -> Array:
        """All inner corners, (n, 3) [units], row after row."""
        x, y = np.meshgrid(np.arange(1.0, self.columns), np.arange(1.0, self.rows))
        return self.square * np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])

    def as_opencv(self) -> Any:
        """Return OpenCV's board, which can draw itself: ``generateImage((width, height))``."""
        cv2 = load_cv2()
        name = getattr(cv2.aruco, self.dictionary, None)
        if not isinstance(name, int):
            raise CalibrationError(
                f"OpenCV has no set of markers {self.dictionary!r}",
                expected="one of "
                + " ".join(sorted(item for item in dir(cv2.aruco) if item.startswith("DICT_"))),
                fix="use the name the board was generated with",
                key="dictionary",
            )
        return cv2.aruco.CharucoBoard(
            (self.columns, self.rows),
            self.square,
            self.marker,
            cv2.aruco.getPredefinedDictionary(name),
        )

    def find(self, image: NDArray[np.uint8]) -> BoardView:
        """Find the inner corners that a picture (H, W) shows; raises CalibrationError."""
        cv2 = load_cv2()
        detector = cv2.aruco.CharucoDetector(self.as_opencv())
        corners, ids = None, None
        if min(image.shape) >= 32:
            corners, ids, *_ = detector.detectBoard(image)
        # OpenCV 4 gives (n, 1, 2) and (n, 1), OpenCV 5 (n, 2) and (n,).
        found = np.zeros(0, np.intp) if ids is None else np.asarray(ids, np.intp).reshape(-1)
        if len(found) < 4:
            raise self._missing(
                f"{len(found)} corners of a ChArUco board of {self.columns} x {self.rows} squares "
                f"and markers {self.dictionary} were found, the others"
            )
        order = np.argsort(found)
        pixels = np.asarray(corners, np.float64).reshape(-1, 2)[order]
        view = BoardView(found[order], self.points[found[order]], pixels)
        # From a corner the nearest of a marker is across the diagonal of the margin around it.
        margin = 0.5 * (self.square - self.marker) / self.square
        return self._refined(image, view, free=min(0.45, 1.3 * margin))
