"""``openprc calibrate``: cameras, planes, scales and pairs of cameras, each to one file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from rich.markup import escape

from openprc.cli.calibrate_options import (
    COUNTS,
    LENGTH,
    POINT,
    board_options,
    make_board,
    needed_board,
)
from openprc.cli.calibrate_output import (
    camera_rows,
    finish,
    load_camera,
    print_notes,
    refuse_outputs,
)
from openprc.cli.console import console, force_option, json_option, print_json, spinner, table
from openprc.cli.options import NOT_NEGATIVE

_PATH = click.Path(path_type=Path)
_MODELS = ("none", "k1", "k1k2", "k1k2p1p2", "k1k2p1p2k3", "rational", "thin-prism")

_out_option = click.option("--out", type=_PATH, required=True, help="File to write (JSON).")
_picture_option = click.option(
    "--picture", type=_PATH, help="Picture of reprojection errors and coverage."
)
_model_option = click.option(
    "--model", type=click.Choice(_MODELS), default="k1k2p1p2k3", show_default=True,
    help="Distortion that is estimated.",
)  # fmt: skip
_frame_option = click.option(
    "--frame-size", type=COUNTS, help="Width x height of the images, as in 640x480."
)


@click.group("calibrate")
def command() -> None:
    """Calibrate a camera, two cameras, or a plane from images.

    The file that is written goes to `openprc track --calibration`. The quickest is a known length
    in the image (scale); better is a board lying in the plane of motion (plane); a camera with a
    visible lens distortion is calibrated first (board), positions in space need two (stereo).
    """


@command.command("scale")
@click.option("--from", "start", type=POINT, required=True, help="One end [px], as in 120.5,88.")
@click.option("--to", "end", type=POINT, required=True, help="Other end [px].")
@click.option("--length", type=LENGTH, required=True, help="Distance of the two, as in 50mm.")
@click.option(
    "--sigma-px", type=NOT_NEGATIVE, default=0.5, show_default=True,
    help="One-sigma of each coordinate of the ends [px].",
)  # fmt: skip
@click.option("--sigma-length", type=LENGTH, help="One-sigma of the length, as in 0.1mm.")
@click.option("--origin", type=POINT, default="0,0", help="Pixel that becomes 0,0.")
@click.option("--y-up", is_flag=True, help="Count y upwards.")
@_frame_option
@_out_option
@force_option
@json_option
def scale_command(
    start: tuple[float, float],
    end: tuple[float, float],
    length: tuple[float, str],
    sigma_px: float,
    sigma_length: tuple[float, str] | None,
    origin: tuple[float, float],
    y_up: bool,
    frame_size: tuple[int, int] | None,
    out: Path,
    force: bool,
    as_json: bool,
) -> None:
    """Take one scale for the whole image from two points a known distance apart."""
    from openprc.schema.units import conversion_factor  # noqa: PLC0415 - beside its only use
    from openprc.vision.calibration.scale_bar import ScaleBar  # noqa: PLC0415 - kept light

    refuse_outputs(out, force)
    spread = 0.0
    if sigma_length is not None:
        spread = sigma_length[0] * conversion_factor(sigma_length[1], length[1])
    bar = ScaleBar(
        start,
        end,
        *length,
        sigma_px=sigma_px,
        sigma_length=spread,
        origin=origin,
        y_up=y_up,
        frame_shape=None if frame_size is None else frame_size[::-1],
    )
    rows = [
        ["length in the image", bar.length_px, "px"],
        ["scale", bar.scale, f"{bar.units}/px"],
        ["one-sigma of the scale", 100.0 * bar.relative_sigma, "%"],
    ]
    told = {"scale": bar.scale, "relative_sigma": bar.relative_sigma, "length_px": bar.length_px}
    finish(bar, out, force, as_json, rows, told)


@command.command("board")
@click.argument("images", nargs=-1, required=True, type=_PATH)
@board_options
@_model_option
@click.option(
    "--distance", type=LENGTH,
    help="Distance of the plane of motion, parallel to the sensor: results are lengths then.",
)  # fmt: skip
@click.option("--y-up", is_flag=True, help="Count y upwards.")
@_picture_option
@_out_option
@force_option
@json_option
def board_command(
    images: tuple[Path, ...],
    model: str,
    distance: tuple[float, str] | None,
    y_up: bool,
    picture: Path | None,
    out: Path,
    force: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Calibrate a camera with IMAGES of a board: files, one folder, or one video."""
    from dataclasses import replace  # noqa: PLC0415 - beside its only use

    from openprc.vision.calibration.camera_fit import fit_camera  # noqa: PLC0415 - OpenCV

    board = needed_board(options)
    refuse_outputs(out, force, picture)
    with spinner("looking for the board", hidden=as_json):
        fit = fit_camera(images[0] if len(images) == 1 else images, board, model=model)
    camera = replace(fit.camera, y_up=y_up)
    if distance is not None:
        camera = camera.at_distance(distance[0], units=distance[1])
    written = []
    if picture is not None:
        # Drawing needs matplotlib.
        from openprc.analysis.visualization.calibration_quality import (  # noqa: PLC0415
            camera_picture,
        )

        written.append(camera_picture(fit, picture).save())
    rows = camera_rows(camera)
    rows += [
        ["views used", len(fit.views), ""],
        ["views rejected", len(fit.rejected), ""],
        ["image covered", 100.0 * fit.coverage, "%"],
    ]
    views = [[v.name, len(v.view.ids), v.rms, v.tilt] for v in fit.views]
    extra = [
        table(["view", "points", escape("rms [px]"), escape("tilt [deg]")], views, title="views")
    ]
    if fit.rejected:
        extra.append(
            table(["picture", "reason"], [list(r) for r in fit.rejected], title="rejected")
        )
    finish(camera, out, force, as_json, rows, fit.as_dict(), extra=extra, written=written)


@command.command("plane")
@click.argument("image", required=False, type=_PATH)
@board_options
@click.option(
    "--points", type=_PATH,
    help="CSV with four columns: pixel x, pixel y, and where that is on the plane, x and y.",
)  # fmt: skip
@click.option("--units", default="mm", show_default=True, help="Unit of the points of the plane.")
@click.option("--camera", "camera_file", type=_PATH, help="Calibration that takes distortion out.")
@click.option("--y-up", is_flag=True, help="Count the board's y upwards.")
@_frame_option
@_picture_option
@_out_option
@force_option
@json_option
def plane_command(
    image: Path | None,
    points: Path | None,
    units: str,
    camera_file: Path | None,
    y_up: bool,
    frame_size: tuple[int, int] | None,
    picture: Path | None,
    out: Path,
    force: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Calibrate the plane of motion, tilted or not: from a board in it in IMAGE, or from points."""
    from openprc.vision.calibration.planar import PlanarTarget  # noqa: PLC0415 - kept light

    board = make_board(options)
    if (board is None) == (points is None) or (board is not None) != (image is not None):
        raise click.UsageError("give an image and its board, or --points alone")
    refuse_outputs(out, force, picture)
    camera = None if camera_file is None else load_camera(camera_file)
    if points is not None:
        from openprc.vision.calibration.point_pairs import read_pairs  # noqa: PLC0415 - kept light

        if y_up:
            raise click.UsageError("--y-up is for boards; with --points the axes are those given")
        pixels, plane = read_pairs(points)
        shape = None if frame_size is None else frame_size[::-1]
    else:
        from openprc.vision.calibration.board_images import read_image  # noqa: PLC0415 - OpenCV

        seen = read_image(image)
        view = board.find(seen)  # type: ignore[union-attr]
        pixels, plane = view.pixels, view.points[:, :2] * (1.0, -1.0 if y_up else 1.0)
        shape, units = seen.shape[:2], board.units  # type: ignore[union-attr]
    target = PlanarTarget.from_points(pixels, plane, units, camera=camera, frame_shape=shape)
    written = []
    if picture is not None:
        # Drawing needs matplotlib.
        from openprc.analysis.visualization.calibration_quality import (  # noqa: PLC0415
            plane_picture,
        )

        written.append(plane_picture(target, pixels, plane, picture).save())
    largest = float(target.calibration_sigma(pixels).max())
    rows = [
        ["points", target.n_points, ""],
        ["reprojection error, rms", target.rms, "px"],
        ["scale at the middle", target.scale, f"{target.units}/px"],
        ["one-sigma of the map, largest", largest if largest == largest else None, target.units],
        ["tilt of the plane", target.tilt, "deg"],
    ]
    told = {
        "rms_px": target.rms, "scale": target.scale, "tilt_deg": target.tilt,
        "points": target.n_points, "largest_sigma": largest,
    }  # fmt: skip
    finish(target, out, force, as_json, rows, told, written=written)


@command.command("stereo")
@click.argument("left", type=_PATH)
@click.argument("right", type=_PATH)
@board_options
@_model_option
@click.option("--left-camera", type=_PATH, help="Calibration of the left camera, if there is one.")
@click.option("--right-camera", type=_PATH, help="Calibration of the right camera.")
@_picture_option
@_out_option
@force_option
@json_option
def stereo_command(
    left: Path,
    right: Path,
    model: str,
    left_camera: Path | None,
    right_camera: Path | None,
    picture: Path | None,
    out: Path,
    force: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Calibrate two cameras from pairs of pictures of a board in the folders LEFT and RIGHT.

    Pairs are taken in the order of the file names, and have to show the same moment.
    """
    from openprc.vision.calibration.stereo_fit import fit_stereo  # noqa: PLC0415 - OpenCV

    board = needed_board(options)
    refuse_outputs(out, force, picture)
    cameras = {
        side: None if path is None else load_camera(path)
        for side, path in (("left", left_camera), ("right", right_camera))
    }
    with spinner("looking for the board", hidden=as_json):
        fit = fit_stereo(left, right, board, model=model, **cameras)
    rig = fit.rig
    written = []
    if picture is not None:
        # Drawing needs matplotlib.
        from openprc.analysis.visualization.calibration_quality import (  # noqa: PLC0415
            stereo_picture,
        )

        written.append(stereo_picture(fit, picture).save())
    rows = [
        ["pairs used", len(fit.pairs), ""],
        ["pictures rejected", len(fit.rejected), ""],
        ["reprojection error, rms", rig.rms, "px"],
        ["board in space, rms", fit.board_rms, rig.units],
        ["baseline", rig.baseline, rig.units],
        ["angle between the axes", rig.angle, "deg"],
    ]
    for side, camera in (("left", rig.left), ("right", rig.right)):
        rows += [[f"{side}: {name}", value, unit] for name, value, unit in camera_rows(camera)]
    extra = [
        table(
            ["pair", escape("rms [px]")],
            [[name, error] for name, error in zip(fit.pairs, fit.errors, strict=True)],
            title="pairs",
        )
    ]
    if fit.rejected:
        extra.append(
            table(["picture", "reason"], [list(r) for r in fit.rejected], title="rejected")
        )
    finish(rig, out, force, as_json, rows, fit.as_dict(), extra=extra, written=written)


@command.command("show")
@click.argument("file", type=_PATH)
@json_option
def show_command(file: Path, as_json: bool) -> None:
    """Show what a calibration FILE holds: of openprc, OpenCV or ROS."""
    from openprc.vision.calibration.calibration_file import (  # noqa: PLC0415 - kept light
        load_calibration,
    )

    found = load_calibration(file)
    if as_json:
        print_json(found.as_dict())
        return
    hidden = ("kind", "notes", "covariance", "sigma", "left", "right", "camera")
    rows = [
        [key, str(v)] for key, v in found.as_dict().items() if key not in hidden and v is not None
    ]
    out = console()
    out.print(table(["", "value"], [["kind", found.kind], *rows], title=file.name))
    print_notes(found)
