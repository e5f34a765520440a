"""``openprc track``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from openprc.cli.console import (
    console,
    force_option,
    json_option,
    print_findings,
    print_json,
    progress_bar,
    table,
)
from openprc.cli.options import FINITE, pairs_option, parse_pairs
from openprc.errors import ConfigError
from openprc.hooks.importing import ProducedRun, import_file
from openprc.schema import atomic

_FILE = click.Path(path_type=Path)
#: Option of the command to the option of the producer that it stands for.
_PASSED = (
    "detector", "max_points", "points", "mask", "reference_frame", "refine", "subset",
    "fb_threshold", "fps", "calibration", "scale_bar", "y_up", "drive", "drive_hold",
    "drive_marker", "bars", "min_ratio", "max_gap", "smooth", "rate", "strict",
)  # fmt: skip


@click.command("track")
@click.argument("path", metavar="CLIP", type=_FILE)
@click.option("--out", type=_FILE, help="Default: NAME.simulation.h5 here.")
@click.option("--detector", help="shi-tomasi (default), sift, orb, akaze, or one of your own.")
@click.option("--max-points", type=int, help="Most points to track. Default: 100.")
@click.option("--points", type=_FILE, help="CSV of x,y in px to track instead of detected points.")
@click.option("--mask", type=_FILE, help="Image, white where points may be detected.")
@click.option("--reference-frame", type=int, help="Frame in which points are placed. Default: 0.")
@click.option("--refine", type=click.Choice(["icgn", "none"]), help="none: plain Lucas-Kanade.")
@click.option("--subset", type=int, help="Side of the matched window in px, odd. Default: 21.")
@click.option("--fb-threshold", type=FINITE, help="Largest forward-backward distance in px.")
@click.option("--fps", type=FINITE, help="Frames per second, instead of the container's times.")
@click.option("--calibration", type=_FILE, help="File of `openprc calibrate`, or of OpenCV.")
@click.option("--scale-bar", metavar="X1,Y1,X2,Y2,LENGTH UNIT", help="As '12,40,312,40,50 mm'.")
@click.option("--y-up", is_flag=True, default=None, help="Turn the y axis of the calibration up.")
@click.option("--drive", type=_FILE, help="CSV of what drove the body.")
@click.option("--drive-hold", type=FINITE, help="Duration of a symbol of the drive in s.")
@click.option("--drive-marker", metavar="N|X,Y", help="Point whose displacement is the input.")
@click.option("--bars", type=_FILE, help="CSV of pairs of points whose distance becomes a bar.")
@click.option("--min-ratio", type=FINITE, help="Leave out points found in fewer of the frames.")
@click.option("--max-gap", type=int, help="Fill gaps of up to so many frames, marked as filled.")
@click.option("--smooth", type=int, help="Savitzky-Golay window in frames, odd.")
@click.option("--rate", type=FINITE, help="Resample to an even clock of so many Hz.")
@click.option("--strict", is_flag=True, default=None, help="Refuse damaged recordings.")
@pairs_option("producer vision, see `openprc plugins`")
@click.option("--annotate", type=_FILE, help="Also write a video with the points drawn over it.")
@click.option("--qc", type=_FILE, help="Also write a picture of tracks, quality and sigma.")
@force_option
@json_option
def command(
    path: Path,
    out: Path | None,
    options: tuple[str, ...],
    annotate: Path | None,
    qc: Path | None,
    force: bool,
    as_json: bool,
    **words: Any,
) -> None:
    """Track points through the video CLIP into a simulation.h5.

    CLIP is a video file, a folder of numbered images, or a recording of a high-speed camera. It
    is read once, from its beginning to its end; Ctrl-C keeps what was tracked so far.
    """
    target = out or Path(f"{path.resolve().name.split('.')[0]}.simulation.h5")
    chosen = parse_pairs(options)
    for name in _PASSED:
        if words[name] is None:
            continue
        if name in chosen:
            raise click.UsageError(f"--{name.replace('_', '-')} and -o {name}= are given")
        chosen[name] = words[name]
    _check_outputs(path, target, annotate, qc, force=force)
    importers: list[Any] = []
    try:
        with progress_bar(f"tracking {path.name}", hidden=as_json) as report:

            def configure(importer: Any) -> None:
                importers.append(importer)
                importer.progress = _reporter(report)

            run = import_file(
                path, target, as_name="vision", options=chosen, overwrite=force,
                configure=configure,
            )  # fmt: skip
    except KeyboardInterrupt:
        _tell_interrupted(target)
        raise click.exceptions.Exit(130) from None
    tracked = importers[0].tracked
    written = _write_pictures(tracked, annotate, qc, target=target, force=force, hidden=as_json)
    if as_json:
        print_json(
            {**run.as_dict(), "figures": {**tracked.figures, **_in_unit(tracked)}, **written}
        )
    else:
        _show(run, tracked, written)


def _check_outputs(
    clip: Path, target: Path, annotate: Path | None, qc: Path | None, *, force: bool
) -> None:
    """Refuse what could not be written before an hour is spent on tracking."""
    if annotate is not None:
        from openprc.vision.annotation import codec_of  # noqa: PLC0415 - on demand

        codec_of(annotate)
    if qc is not None and qc.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise ConfigError(
            f"a picture cannot be named {qc.name!r}",
            expected="a name that ends in .png .pdf .svg",
            fix="choose .png",
            key="--qc",
        )
    named = [item for item in (target, annotate, qc) if item is not None]
    for item in named[1:]:
        if item.is_dir():
            raise ConfigError(
                f"{item} is a folder", expected="a file name", fix="add one", key=str(item)
            )
        if not force:
            atomic.refuse_existing(item)
    places = [item.resolve() for item in (clip, *named)]
    if len(set(places)) < len(places):
        raise ConfigError(
            "two of the files have the same name",
            expected="a name of its own for the clip and for each output",
            fix="choose other names",
            key="--out",
        )


def _reporter(report: Callable[[float, str], None]) -> Callable[[int, int | None], None]:
    def moved(done: int, total: int | None) -> None:
        # What a container declares can be too little.
        if total and done <= total:
            report(done / total, f"{done}/{total}")
        else:
            report(0.0 if not total else 1.0, f"{done} frames")

    return moved


def _tell_interrupted(target: Path) -> None:
    partial = atomic.partial_path(target)
    if partial.exists():
        click.echo(
            f"stopped; what was tracked so far is in {partial}, and `openprc repair {partial}` "
            "makes a file of it",
            err=True,
        )
    else:
        click.echo("stopped before anything was tracked; nothing is left behind", err=True)


def _write_pictures(
    tracked: Any, annotate: Path | None, qc: Path | None, *, target: Path, force: bool, hidden: bool
) -> dict[str, str]:
    written = {}
    if qc is not None:
        # matplotlib takes a second to import; the help of this command need not wait for it.
        from openprc.analysis.visualization.tracking_quality import (  # noqa: PLC0415
            plot_tracking_quality,
        )

        image = tracked.source.read_frame(tracked.result.reference_frame)
        scale, unit = _scale(tracked)
        title = f"{tracked.source.name}: {tracked.result.n_features} points, " \
                f"{tracked.result.n_frames} frames"  # fmt: skip
        plot = plot_tracking_quality(
            image, tracked.result, title=title, unit_per_px=scale, unit=unit
        )
        plot.save(qc)
        written["qc"] = str(qc)
    if annotate is not None:
        from openprc.vision.annotation import annotate_video  # noqa: PLC0415 - on demand

        with progress_bar(f"writing {annotate.name}", hidden=hidden) as report:
            annotate_video(
                tracked.source, tracked.result, annotate, overwrite=force,
                progress=_reporter(report),
            )  # fmt: skip
        written["annotate"] = str(annotate)
    return written


def _scale(tracked: Any) -> tuple[float | None, str]:
    """Return the size of a pixel at the centre of the image, where there is a calibration."""
    import numpy as np  # noqa: PLC0415 - on demand

    calibration = tracked.calibration
    if calibration is None:
        return None, "px"
    height, width = tracked.source.shape
    slope = calibration.jacobian(np.array([[0.5 * width, 0.5 * height]]))[0]
    return float(np.sqrt(abs(np.linalg.det(slope)))), str(calibration.units)


def _in_unit(tracked: Any) -> dict[str, Any]:
    scale, unit = _scale(tracked)
    sigma = tracked.figures["median_sigma_px"]
    if scale is None or sigma is None:
        return {}
    return {"unit_per_px": scale, "unit": unit, "median_sigma": sigma * scale}


def _show(run: ProducedRun, tracked: Any, written: dict[str, str]) -> None:
    out = console()
    told = tracked.figures
    points = told["points"]
    sigma = told["median_sigma_px"]
    scale, unit = _scale(tracked)
    spread = "unknown (refine none)" if sigma is None else f"{sigma:.2g} px"
    if scale is not None and sigma is not None:
        spread += f" = {sigma * scale:.2g} {unit}"
    share = told["fraction_by_status"]
    lost = ", ".join(
        f"{100 * share[name]:.2g} % {word}"
        for name, word in (("lost", "lost"), ("oob", "out of the image"), ("drift", "refused"))
        if share[name]
    )
    rows = [
        ["frames", f"{told['frames']} in {told['duration_s']:.4g} s"],
        ["frame times", told["time"]],
        ["dropped, duplicated frames", f"{told['dropped_frames']}, {told['duplicated_frames']}"],
        ["points", f"{points}, of which {run.n_nodes} are nodes"],
        ["found", f"{100 * told['found_fraction']:.2f} %" + (f" ({lost})" if lost else "")],
        ["alive at the end", f"{told['alive_at_end']} of {points}"],
        ["found in every frame", f"{told['complete']} of {points}"],
        ["found again after a loss", f"{told['recovered']} points, {told['recoveries']} times"],
        ["median sigma", spread],
        ["median quality (ZNCC)", _number(told["median_quality"])],
        ["template updates", str(told["template_updates"])],
        ["noise", _number(told["noise_grey_levels"], " grey levels")],
        ["moving (motion over 3 sigma)", f"{told['moving']} of {points}, median motion "
         f"{_number(told['median_motion_snr'])} sigma"],
        ["input", ", ".join(run.inputs) or "none: see `openprc track --help`, --drive"],
        ["file", str(run.path)],
    ]  # fmt: skip
    rows += [[name, place] for name, place in written.items()]
    out.print(table(["figure", tracked.source.name], rows))
    for note in run.notes:
        out.print(f"note: {note}", markup=False)
    print_findings(out, run.findings)


def _number(value: float | None, unit: str = "") -> str:
    return "unknown" if value is None else f"{value:.4g}{unit}"
