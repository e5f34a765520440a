"""Pictures of boards and textured planes by exact projection: what a known camera would see."""

from __future__ import annotations

import numpy as np


def rotation(x=0.0, y=0.0, z=0.0):
    """Rotation matrix from angles about the axes [deg], z first."""
    out = np.eye(3)
    for axis, angle in ((2, z), (0, x), (1, y)):
        a = np.radians(angle)
        turn = np.eye(3)
        i, j = [k for k in range(3) if k != axis]
        turn[i, i] = turn[j, j] = np.cos(a)
        turn[i, j], turn[j, i] = -np.sin(a), np.sin(a)
        if axis == 1:
            turn = turn.T
        out = turn @ out
    return out


class Rays:
    """The ideal directions of all pixels of a camera, and how they change inside a pixel."""

    def __init__(self, camera):
        height, width = camera.frame_shape
        grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(float)
        self.directions = camera.to_normalized(grid)
        self.slopes = camera.normalized_jacobian(grid)


def render(rays, pattern, turn, shift, *, samples=4, background=128.0):
    """Return (H, W) uint8: `pattern(X, Y)` in grey levels on a plane, the mean over each pixel.

    The plane is x_camera = turn (X, Y, 0) + shift; each pixel is sampled `samples`^2 times.
    """
    total = np.zeros(rays.directions.shape[:2])
    inner = (np.arange(samples) + 0.5) / samples - 0.5
    normal = turn[:, 2]
    for dy in inner:
        for dx in inner:
            xy = rays.directions + rays.slopes @ np.array([dx, dy])
            along = xy[..., 0] * normal[0] + xy[..., 1] * normal[1] + normal[2]
            with np.errstate(divide="ignore", invalid="ignore"):
                depth = (normal @ shift) / along
            point = np.concatenate([xy, np.ones((*xy.shape[:-1], 1))], -1) * depth[..., None]
            plane = (point - shift) @ turn
            value = pattern(plane[..., 0], plane[..., 1])
            total += np.where(depth > 0.0, value, background)
    return np.rint(total / samples**2).clip(0, 255).astype(np.uint8)


def chessboard(board, *, dark=20.0, light=220.0, edge=0.016):
    """Pattern of a chessboard whose first inner corner is the origin; light around it.

    Edges are tanh ramps over `edge` squares: a sharp one, sampled a few times per pixel, would be
    in the wrong place by a tenth of a pixel.
    """
    size, width = board.square, edge * np.pi

    def ramp(x, low, high):
        return 0.25 * (1 + np.tanh((x - low) / edge)) * (1 + np.tanh((high - x) / edge))

    def pattern(x, y):
        i, j = x / size, y / size
        sign = np.tanh(np.sin(np.pi * i) / width) * np.tanh(np.sin(np.pi * j) / width)
        inside = ramp(i, -1.0, board.columns) * ramp(j, -1.0, board.rows)
        return light + inside * 0.5 * (1 + sign) * (dark - light)

    return pattern


def circles(board, *, dark=20.0, light=220.0):
    """Pattern of a symmetric grid of dark circles."""
    size = board.square

    def pattern(x, y):
        i = np.clip(np.rint(x / size), 0, board.columns - 1)
        j = np.clip(np.rint(y / size), 0, board.rows - 1)
        return np.where(np.hypot(x - i * size, y - j * size) < 0.3 * size, dark, light)

    return pattern


def charuco(board, *, cell=40):
    """Pattern of a ChArUco board, from the drawing that OpenCV makes of it."""
    drawing = board.as_opencv().generateImage((board.columns * cell, board.rows * cell))

    smooth = np.pad(drawing.astype(float), cell, constant_values=255.0)

    def pattern(x, y):
        column = np.clip(x / board.square * cell - 0.5 + cell, 0.0, smooth.shape[1] - 2.0)
        row = np.clip(y / board.square * cell - 0.5 + cell, 0.0, smooth.shape[0] - 2.0)
        i, j = np.floor(row).astype(int), np.floor(column).astype(int)
        a, b = row - i, column - j
        upper = (1 - b) * smooth[i, j] + b * smooth[i, j + 1]
        lower = (1 - b) * smooth[i + 1, j] + b * smooth[i + 1, j + 1]
        return (1 - a) * upper + a * lower

    return pattern


def facing(distance, *, x=0.0, y=0.0, z=0.0, centre=(0.0, 0.0), at=(0.0, 0.0)):
    """Pose of a plane turned by angles [deg], whose point `centre` is at (at, distance)."""
    turn = rotation(x, y, z)
    return turn, np.array([*at, distance]) - turn @ np.array([*centre, 0.0])


VIEWS = (
    {"x": 25, "y": 5, "z": 3, "at": (-0.12, -0.08)},
    {"x": -25, "y": 8, "z": -4, "at": (0.12, -0.08)},
    {"x": 4, "y": 28, "z": 10, "at": (-0.1, 0.1)},
    {"x": -6, "y": -28, "z": -8, "at": (0.12, 0.08)},
    {"x": 20, "y": 20, "z": 15, "at": (0.0, 0.0)},
    {"x": -20, "y": 22, "z": -15, "at": (0.05, -0.1)},
    {"x": 18, "y": -22, "z": 5, "at": (-0.14, 0.02)},
    {"x": -22, "y": -18, "z": -5, "at": (0.13, 0.0)},
    {"x": 2, "y": 3, "z": 0, "at": (0.0, 0.1)},
    {"x": 30, "y": 0, "z": 2, "at": (0.0, -0.1)},
)
"""Poses of a board: angles [deg], and where its middle is, as fractions of the distance."""


def poses(board, distance, views=VIEWS):
    """Yield the rotation and translation of each of VIEWS for a board."""
    centre = 0.5 * (board.points.min(axis=0) + board.points.max(axis=0))[:2]
    for view in views:
        at = np.array(view["at"]) * distance
        angles = {name: view[name] for name in ("x", "y", "z")}
        yield facing(distance, centre=centre, at=at, **angles)
