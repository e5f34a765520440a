"""Pictures that say whether a calibration can be trusted."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.analysis.visualization.figure import Plot, new_figure
from openprc.vision.calibration.coverage import covered_cells

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from openprc.vision.calibration.camera_fit import CameraFit
    from openprc.vision.calibration.planar import PlanarTarget
    from openprc.vision.calibration.stereo_fit import StereoFit


def camera_picture(fit: CameraFit, path: Path) -> Plot:
    """Draw where corners were seen, their errors enlarged, and the error of each view."""
    figure = new_figure((11.0, 4.6))
    left, middle, right = figure.subplots(1, 3, width_ratios=(1.5, 1.0, 1.0))
    pixels = np.concatenate([view.view.pixels for view in fit.views])
    errors = np.concatenate([view.residuals for view in fit.views])
    height, width = fit.camera.frame_shape
    _arrows(left, pixels, errors, (height, width))
    empty = ~covered_cells(pixels, (height, width))
    shade = np.where(empty[..., np.newaxis], [1.0, 0.92, 0.85], 1.0)
    left.imshow(shade, extent=(-0.5, width - 0.5, height - 0.5, -0.5), zorder=-1)
    left.set_title(
        f"{len(fit.views)} views, corners in {100.0 * fit.coverage:.0f} % of the image"
        "\n(tinted: none seen)",
        fontsize=10,
    )
    _cloud(middle, errors)
    _bars(right, [view.rms for view in fit.views], [view.name for view in fit.views], "view")
    return Plot(figure, path)


def plane_picture(
    target: PlanarTarget, pixels: NDArray[np.float64], plane: NDArray[np.float64], path: Path
) -> Plot:
    """Draw the points of a plane with a grid of its coordinates, and their errors."""
    figure = new_figure((9.5, 4.6))
    left, right = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
    errors = pixels - target.to_pixels(plane)
    low, high = plane.min(axis=0), plane.max(axis=0)
    for axis in (0, 1):
        for value in np.linspace(low[axis], high[axis], 7):
            line = np.empty((60, 2))
            line[:, axis] = value
            line[:, 1 - axis] = np.linspace(low[1 - axis], high[1 - axis], 60)
            left.plot(*target.to_pixels(line).T, color="0.8", lw=0.8, zorder=0)
    shape = target.frame_shape
    if shape is None:
        shape = tuple(int(v) for v in (pixels.max(axis=0) + 20)[::-1])  # type: ignore[assignment]
    _arrows(left, pixels, errors, shape)
    left.set_title(
        f"tilt {target.tilt:.2f} deg, {target.scale:.4g} {target.units}/px at the middle",
        fontsize=10,
    )
    _cloud(right, errors)
    return Plot(figure, path)


def stereo_picture(fit: StereoFit, path: Path) -> Plot:
    """Draw the two cameras from above, and the error of each pair."""
    figure = new_figure((10.0, 4.4))
    left, right = figure.subplots(1, 2, width_ratios=(1.2, 1.0))
    rig = fit.rig
    place = -rig.rotation.T @ rig.translation
    reach = 1.5 * rig.baseline / max(2.0 * np.tan(np.radians(max(rig.angle, 5.0)) / 2.0), 0.2)
    for name, origin, axis, colour in (
        ("left", np.zeros(3), np.array([0.0, 0.0, 1.0]), "tab:blue"),
        ("right", place, rig.rotation[2], "tab:orange"),
    ):
        end = origin + reach * axis
        left.plot([origin[0], end[0]], [origin[2], end[2]], color=colour, lw=1.5)
        left.plot(origin[0], origin[2], "s", color=colour, ms=9, label=f"{name} camera")
    left.set_aspect("equal", adjustable="datalim")
    left.set_xlabel(f"x [{rig.units}]")
    left.set_ylabel(f"z [{rig.units}]")
    left.legend(fontsize=8)
    left.set_title(
        f"from above: {rig.angle:.1f} deg between the axes, baseline "
        f"{rig.baseline:.4g} {rig.units}",
        fontsize=10,
    )
    _bars(right, list(fit.errors), list(fit.pairs), "pair")
    return Plot(figure, path)


def _arrows(
    axes: Axes,
    pixels: NDArray[np.float64],
    errors: NDArray[np.float64],
    shape: tuple[int, int],
) -> None:
    """Points in the image with their errors, enlarged so that they can be seen."""
    height, width = shape
    typical = float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))
    # A typical error becomes a fiftieth of the image.
    factor = 0.02 * width / typical if typical > 1e-9 else 1.0
    # 1, 2 or 5 times a power of ten, to be read off easily.
    power = 10.0 ** np.floor(np.log10(factor))
    factor = power * max(step for step in (1.0, 2.0, 5.0) if step * power <= factor * 1.0001)
    axes.plot(*pixels.T, ".", color="0.35", ms=3)
    axes.quiver(
        *pixels.T, *(factor * errors.T), angles="xy", scale_units="xy", scale=1.0,
        color="tab:red", width=0.0022,
    )  # fmt: skip
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_aspect("equal")
    axes.set_xlabel(f"x [px]; errors {factor:g} times enlarged")
    axes.set_ylabel("y [px]")


def _cloud(axes: Axes, errors: NDArray[np.float64]) -> None:
    axes.plot(*errors.T, ".", color="tab:red", ms=3, alpha=0.6)
    rms = float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))
    limit = 1.1 * max(float(np.abs(errors).max(initial=0.0)), 1e-6)
    axes.axhline(0.0, color="0.8", lw=0.8, zorder=0)
    axes.axvline(0.0, color="0.8", lw=0.8, zorder=0)
    axes.set_xlim(-limit, limit)
    axes.set_ylim(-limit, limit)
    axes.set_aspect("equal")
    axes.locator_params(nbins=5)
    axes.set_xlabel("error in x [px]")
    axes.set_ylabel("error in y [px]")
    axes.set_title(f"reprojection error, rms {rms:.3g} px", fontsize=10)


def _bars(axes: Axes, values: list[float], names: list[str], what: str) -> None:
    places: Any = np.arange(len(values))
    axes.barh(places, values, color="tab:blue")
    axes.set_yticks(places, [name[-24:] for name in names], fontsize=7 if len(names) < 30 else 4)
    axes.invert_yaxis()
    axes.locator_params(axis="x", nbins=4)
    axes.set_xlabel("rms reprojection error [px]")
    axes.set_title(f"error of each {what}", fontsize=10)
