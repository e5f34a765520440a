"""What the commands of ``openprc calibrate`` read and write alike."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from openprc.cli.console import console, print_json, table
from openprc.errors import CalibrationError
from openprc.schema.atomic import refuse_existing

if TYPE_CHECKING:
    from openprc.vision.calibration.camera import CameraCalibration


def refuse_outputs(out: Path, force: bool, picture: Path | None = None) -> None:
    """Refuse before the work what could not be written after it."""
    if picture is not None and picture.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise click.UsageError(f"--picture writes .png, .pdf or .svg, not {picture.name!r}")
    for path in (out, picture):
        if path is None:
            continue
        if path.is_dir():
            raise click.UsageError(f"{path} is a folder; name a file")
        if not force:
            refuse_existing(path)


def load_camera(path: Path) -> CameraCalibration:
    """Read a calibration that has to be a camera's."""
    from openprc.vision.calibration.calibration_file import (  # noqa: PLC0415 - kept light
        load_calibration,
    )

    found = load_calibration(path)
    if found.kind != "camera":
        raise CalibrationError(
            f"this is a calibration of the kind {found.kind!r}",
            expected="a camera, as openprc calibrate board writes it",
            fix="calibrate the camera first",
            file=path,
            key="kind",
        )
    return found  # type: ignore[no-any-return]


def camera_rows(camera: CameraCalibration) -> list[list[Any]]:
    """Return what is known of a camera, with one-sigma: name, value, unit."""

    def known(name: str, value: float) -> str:
        sigma = camera.sigma.get(name)
        if not sigma:
            return f"{value:.6g}"
        return f"{value:.6g} ± {sigma:.2g}"

    k = camera.matrix
    values = {"fx": k[0, 0], "fy": k[1, 1], "cx": k[0, 2], "cy": k[1, 2]}
    rows: list[list[Any]] = [["reprojection error, rms", _short(camera.rms), "px"]]
    rows += [[name, known(name, value), "px"] for name, value in values.items()]
    from openprc.vision.calibration.distortion import NAMES  # noqa: PLC0415 - kept light

    rows += [
        [name, known(name, value), "1"]
        for name, value in zip(NAMES, camera.dist, strict=False)
        if value or name in camera.sigma
    ]
    return rows


def _short(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def finish(
    calibration: Any,
    out: Path,
    force: bool,
    as_json: bool,
    rows: list[list[Any]],
    told: dict[str, Any],
    *,
    extra: list[Any] | None = None,
    written: list[Path] | None = None,
) -> None:
    """Write the file, then say what is in it."""
    from openprc.vision.calibration.calibration_file import (  # noqa: PLC0415 - kept light
        save_calibration,
    )

    save_calibration(out, calibration, overwrite=force)
    paths = [str(path) for path in (out, *(written or []))]
    if as_json:
        print_json(
            {**told, "calibration": calibration.as_dict(), "notes": list(calibration.notes),
             "written": paths}
        )  # fmt: skip
        return
    show = console()
    show.print(table(["", "value", "unit"], rows, title=f"calibration: {calibration.kind}"))
    for item in extra or []:
        show.print(item)
    print_notes(calibration)
    for path in paths:
        show.print(f"written: {path}", markup=False, soft_wrap=True)


def print_notes(calibration: Any) -> None:
    """Print what the user should know."""
    for note in calibration.notes:
        console().print(f"note: {note}", markup=False)
