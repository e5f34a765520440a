"""Tracking on real recordings whose motion others have measured or made.

    python benchmarks/tracking_recordings.py FOLDER [--json FILE]

FOLDER holds the recordings. ``mechanism_ffv1.avi``: three parts of a mechanism that turn by 13, 20
and 17 degrees, measured by DICe (subset correlation against the first frame,
``mechanism_reference.csv``). A grid of points is tracked on each part; the rigid motion that fits
them best, weighted by what the tracker says of their precision, gives displacement (u, v) of the
part's reference point, and the angle. The reference is a measurement itself; 0.03 px is what is
demanded.

``dic_challenge_15``: sample 15 of the 2D-DIC Challenge (Reu et al., Exp. Mech. 58:1067, 2018,
doi:10.1007/s11340-017-0349-0), speckle with noise, whose vertical displacement is a known function
of the row in the deformed image. A grid of points is tracked into each of the three images;
0.027 px is what is demanded.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from tracking_methods import OURS, write_json

from openprc.vision import Tracker, VideoSource
from openprc.vision.opencv import load_cv2
from openprc.vision.source.arrays import ArraySource

#: Radius around each reference point that surely lies on the part [px].
RADII = {0: 22.0, 1: 8.0, 2: 18.0}


def read_reference(path: Path) -> dict[int, dict[str, np.ndarray]]:
    """Return part to columns x, y [px], u, v (T,) [px], theta (T,) [rad]."""
    data = np.genfromtxt(path, delimiter=",", names=True)
    columns = {"x": "x_ref_px", "y": "y_ref_px", "u": "u_px", "v": "v_px", "theta": "theta_rad"}
    return {
        part: {name: data[column][data["subset"] == part] for name, column in columns.items()}
        for part in RADII
    }


def points_on_part(centre: np.ndarray, radius: float) -> np.ndarray:
    """Return a grid of points whose windows lie on the part, as far as it is large enough."""
    steps = np.arange(-24.0, 25.0, 3.0)
    x, y = (a.ravel() for a in np.meshgrid(steps, steps))
    return centre + np.column_stack([x, y])[np.hypot(x, y) <= max(radius - 4.0, 5.0)]


def rigid_fit(start: np.ndarray, now: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, float]:
    """Return shift of the origin and angle of the best rigid motion (weighted; Kabsch 1976)."""
    middle, there = (np.average(p, axis=0, weights=weights) for p in (start, now))
    a, b = start - middle, (now - there) * weights[:, None]
    angle = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return there - turn @ middle, float(angle)


def score_mechanism(folder: Path) -> list[dict[str, float | str]]:
    """Track the three parts and compare with DICe."""
    reference = read_reference(folder / "mechanism_reference.csv")
    answers: list[dict[str, float | str]] = []
    for name, config in OURS.items():
        for part, told in reference.items():
            centre = np.array([told["x"][0], told["y"][0]])
            with VideoSource(folder / "mechanism_ffv1.avi") as source:
                points = points_on_part(centre, RADII[part])
                result = Tracker(source, points, config=config).run()
            errors, turns = [], []
            for k in range(1, result.n_frames):
                known = np.isfinite(result.positions[k]).all(axis=1)
                if known.sum() < 3:
                    continue
                # What the tracker says of its own precision is what the fit goes by.
                sigma = (
                    result.sigma[k, known] if config.refine != "none" else np.ones((known.sum(), 2))
                )
                shift, angle = rigid_fit(
                    points[known] - centre,
                    result.positions[k, known] - centre,
                    1.0 / (sigma**2).sum(axis=1),
                )
                errors.append(shift - [told["u"][k], told["v"][k]])
                turns.append(angle - told["theta"][k])
            rms = np.sqrt(np.mean(np.square(errors), axis=0))
            answers.append({
                "tracker": name, "part": part, "points": len(points),
                "frames": len(errors) + 1, "u": float(rms[0]), "v": float(rms[1]),
                "theta": float(np.sqrt(np.mean(np.square(turns)))),
                "alive": float(np.isfinite(result.positions[..., 0]).mean()),
            })  # fmt: skip
    return answers


def score_challenge(folder: Path) -> list[dict[str, float | str]]:
    """Track a grid into the three deformed images and compare with the imposed displacement."""
    cv2 = load_cv2()
    here = folder / "dic_challenge_15"
    truth = np.genfromtxt(here / "truth_v.csv", delimiter=",", names=True)
    reference = cv2.imread(str(here / "Reference.png"), cv2.IMREAD_GRAYSCALE)
    height, width = reference.shape
    x, y = np.meshgrid(np.arange(30, width - 30, 12), np.arange(30, height - 30, 12))
    points = np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)
    answers: list[dict[str, float | str]] = []
    for name, config in OURS.items():
        found = []
        for path in sorted(here.glob("P200_*.png")):
            v_name = f"v_{path.stem.split('_')[1]}_px"
            image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
            source = ArraySource(np.stack([reference, image]), fps=1.0)
            result = Tracker(source, points, config=config).run()
            moved = result.positions[1] - points
            # The truth belongs to the row where a point is seen, not to where it came from.
            v = np.interp(result.positions[1, :, 1], truth["y_deformed_px"], truth[v_name])
            found.append(np.column_stack([moved[:, 0], moved[:, 1] - v]))
        errors = np.concatenate(found)
        known = np.isfinite(errors).all(axis=1)
        answers.append({
            "tracker": name, "points": len(errors),
            "u": float(np.sqrt(np.mean(errors[known, 0] ** 2))),
            "v": float(np.sqrt(np.mean(errors[known, 1] ** 2))),
            "bias": float(np.mean(errors[known, 1])), "alive": float(known.mean()),
        })  # fmt: skip
    return answers


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    mechanism, challenge = score_mechanism(arguments.folder), score_challenge(arguments.folder)
    out = Console()
    table = Table("tracker", "part", "points", "frames", "u rms px", "v rms px", "angle rms rad",
                  "alive", title="mechanism, against DICe")  # fmt: skip
    for r in mechanism:
        table.add_row(
            r["tracker"], *(str(r[k]) for k in ("part", "points", "frames")),
            *(f"{r[k]:.4f}" for k in ("u", "v", "theta", "alive")),
        )  # fmt: skip
    out.print(table)
    table = Table("tracker", "points", "v rms px", "v bias px", "u rms px", "alive",
                  title="2D-DIC Challenge, sample 15")  # fmt: skip
    for r in challenge:
        table.add_row(
            r["tracker"], str(r["points"]), *(f"{r[k]:.4f}" for k in ("v", "bias", "u", "alive"))
        )
    out.print(table)
    worst = max(max(r["u"], r["v"]) for r in mechanism if r["tracker"] == "ours")
    v = next(r["v"] for r in challenge if r["tracker"] == "ours")
    for what, value, limit in (("mechanism, worst of u and v", worst, 0.03),
                               ("challenge, v", v, 0.027)):  # fmt: skip
        verdict = "holds" if value <= limit else "DOES NOT HOLD"
        out.print(f"{what}: {value:.4f} px, at most {limit} px: {verdict}")
    write_json(arguments.json, {"mechanism": mechanism, "challenge": challenge})


if __name__ == "__main__":
    main()
