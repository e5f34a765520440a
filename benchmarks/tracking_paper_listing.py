"""The pipeline that the OpenPRC paper prints, run on a real clip and scored end to end.

    python benchmarks/tracking_paper_listing.py FOLDER [--json FILE]

FOLDER holds ``mechanism_ffv1.avi`` and ``mechanism_reference.csv``. The lines between the two
marks are those of the paper, with a copy of the clip in the place of its file name; the camera is a
pinhole of focal length 1 px with its axis through the origin, so that a pixel is 25 mm and the
tracks can be held against the reference. The listing states a frame of 1920 x 1080 px, and the clip
has 640 x 480: that this is told counts, too. In the end a readout learns, from the saved file, the
angle of the first part as DICe measured it, on 24 frames, and is tested on the 12 that follow; few
or no features lie on the others.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import warnings
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from tracking_methods import write_json
from tracking_recordings import RADII, read_reference, rigid_fit

import openprc.vision as vision
from openprc.reservoir.features.node_features import NodeDisplacements
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.readout.ridge import Ridge
from openprc.reservoir.training.trainer import Trainer
from openprc.schema.validate import validate_file


def listing(clip: Path, saved: Path, K: np.ndarray) -> tuple[object, object, object]:
    """Run the listing; return the tracks, the trajectories, and the features."""
    # --- the paper's lines begin here
    src = vision.VideoSource(clip)
    fmap = vision.FeatureMapCache(src).get_or_detect(
        src.read_frame(0), method="sift", contrast_threshold=0.04
    )
    fmap = fmap.top_n(200)
    src.reset()
    result = vision.Tracker(
        src,
        fmap,
        config=vision.KLTConfig(win_size=(21, 21), max_level=3, fb_threshold=1.0),
    ).run()
    cal = vision.CameraCalibration.from_matrix(
        K, frame_shape=(1080, 1920), scale_factor=25.0, physical_units="mm"
    )
    tset = vision.TrajectorySet.from_tracking_result(result, calibration=cal)
    good = result.track_ratios() >= 0.6
    tset = tset.select_features(good).fill_gaps("linear", max_gap=10).smooth(5)
    vision.save(
        saved,
        source=src,
        feature_map=fmap,
        tracking_result=result,
        trajectory_set=tset,
        signals=tset.to_signals(dim=2),
        signals_meta={"dim": 2, "units": tset.units},
    )
    src.release()
    # --- and end here
    return result, tset, fmap


def main() -> None:
    """Run, score and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    reference = read_reference(arguments.folder / "mechanism_reference.csv")
    with tempfile.TemporaryDirectory() as folder:
        saved = Path(folder) / "experiment_vision.h5"
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            # A copy: the cache of features is written beside the video.
            clip = shutil.copy(arguments.folder / "mechanism_ffv1.avi", folder)
            result, tset, fmap = listing(Path(clip), saved, np.eye(3))
        findings = [f for f in validate_file(saved).findings if f.level == "error"]
        loader = StateLoader(saved)
        whole = np.flatnonzero(np.isfinite(tset.positions).all(axis=(0, 2)))
        features = NodeDisplacements(node_ids=whole.tolist())
        states = features.transform(loader)
        angle = reference[0]["theta"][: result.n_frames]
        trainer = Trainer(
            features, Ridge(1e-5), loader=loader,
            washout=4 / 30, train_duration=24 / 30, test_duration=12 / 30,
        )  # fmt: skip
        nrmse = trainer.train(angle).nrmse
    start = result.positions[0]
    rows = []
    for part, r in reference.items():
        centre = np.array([r["x"][0], r["y"][0]])
        near = np.flatnonzero(np.hypot(*(start - centre).T) <= RADII[part])
        errors = []
        for k in range(1, result.n_frames):
            known = near[np.isfinite(result.positions[k, near]).all(axis=1)]
            if len(known) >= 3:
                weights = 1.0 / (result.sigma[k, known] ** 2).sum(axis=1)
                shift, _ = rigid_fit(
                    start[known] - centre, result.positions[k, known] - centre, weights
                )
                errors.append(shift - [r["u"][k], r["v"][k]])
        rms = np.sqrt(np.mean(np.square(errors), axis=0)) if errors else np.full(2, np.nan)
        rows.append({"part": part, "points": len(near), "frames": len(errors) + 1,
                     "u": float(rms[0]), "v": float(rms[1])})  # fmt: skip
    out = Console()
    for warning in told:
        out.print(f"told: {warning.message}", markup=False)
    out.print(
        f"{len(fmap)} features, {result.n_frames} frames, {tset.positions.shape[1]} kept of which "
        f"every position is known in {np.isfinite(tset.positions).all(axis=(0, 2)).sum()}; "
        f"units {tset.units}; {len(findings)} errors against the contract; states of shape "
        f"{states.shape}"
    )
    table = Table("part", "points", "frames", "u rms px", "v rms px", title="against DICe")
    for row in rows:
        table.add_row(*(str(row[k]) for k in ("part", "points", "frames")),
                      f"{row['u']:.4f}", f"{row['v']:.4f}")  # fmt: skip
    out.print(table)
    out.print(f"readout of the angle of part 0, NRMSE on the test frames: {nrmse:.4f}")
    write_json(arguments.json, {"parts": rows, "nrmse": nrmse})


if __name__ == "__main__":
    main()
