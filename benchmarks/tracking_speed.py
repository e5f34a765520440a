"""How fast points are tracked on one thread, beside how precisely.

    python benchmarks/tracking_speed.py [--rounds 3] [--json FILE] [--pyidi PYTHON]
        [--pyvale PYTHON]

Speckle that turns and stretches (``affine`` of `openprc.vision.synth`, noise 1), 250 points at
480 x 360 px, and 1000 points at 1920 x 1080 px. CPU time of one thread, medians of interleaved
rounds, compiling left out. "tracking" starts from frames in memory; "from a video" decodes a
lossless one (FFV1) as well, opening included: at the smaller size one of 81 frames, 21 of which
are those in memory. A peer has the same frames and points, on one thread; its rms error
stands beside ours because a faster and coarser answer is no comparison.

The limit that is named is plain Lucas-Kanade there and back: the prediction that every frame
needs before anything is refined.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table
from tracking_methods import (
    OURS,
    add_peer_options,
    peers_given,
    track_ours,
    track_peer,
    write_json,
)

from openprc.vision import Tracker, VideoSource, detect
from openprc.vision.opencv import load_cv2
from openprc.vision.synth import cases
from openprc.vision.tracking.correlation import Correlator

#: Shape, points, their least distance [px], and frames of the video.
SIZES = {
    "480 x 360": ((360, 480), 250, 5.0, 81),
    "1920 x 1080": ((1080, 1920), 1000, 12.0, 21),
}
N_FRAMES = 21
MARGIN = 45


@dataclass
class Row:
    """One way of tracking at one size.

    Attributes
    ----------
    rms : float [px]
    seconds : list of float
        CPU time a round.
    work : int
        Points times frames.
    """

    size: str
    way: str
    work: int
    rms: float = np.nan
    seconds: list[float] = field(default_factory=list)
    remark: str = ""

    @property
    def speed(self) -> float:
        """Points times frames per second of CPU time."""
        return self.work / statistics.median(self.seconds) if self.seconds else np.nan

    @property
    def best(self) -> float:
        """The same of the fastest round: other work on the machine can only slow it down."""
        return self.work / min(self.seconds) if self.seconds else np.nan


def spaced_points(clip: cases.Scene, n_points: int, distance: float) -> np.ndarray:
    """Return corners away from the edges, (N, 2) [px]."""
    height, width = clip.shape
    found = detect(clip.frame(0), "gftt", min_distance=distance)
    inner = found.filter_by_roi(MARGIN, MARGIN, width - 2 * MARGIN, height - 2 * MARGIN)
    return inner.top_n(n_points).keypoints


def parts(frames: np.ndarray, points: np.ndarray) -> dict[str, float]:
    """Return CPU seconds a frame of what a frame is made of."""
    cv2 = load_cv2()
    correlator = Correlator()
    first = correlator.prepare(frames[0])
    ids = correlator.add_templates(first, points)
    start = points.astype(np.float32).reshape(-1, 1, 2)
    led, _, _ = cv2.calcOpticalFlowPyrLK(frames[0], frames[1], start, None)
    guesses = np.column_stack([led[:, 0], np.zeros((len(points), 4))])
    image = correlator.prepare(frames[1])
    correlator.refine(image, ids, guesses)

    def klt() -> None:
        there, _, _ = cv2.calcOpticalFlowPyrLK(frames[0], frames[1], start, None)
        cv2.calcOpticalFlowPyrLK(frames[1], frames[0], there, None)

    def prefilter() -> None:
        correlator.prepare(frames[1]).require_all()

    def refine() -> None:
        correlator.refine(image, ids, guesses)

    seconds = {}
    for name, work in (("KLT there and back", klt), ("spline prefilter", prefilter),
                       ("refinement", refine)):  # fmt: skip
        taken = []
        for _ in range(7):
            started = time.process_time()
            work()
            taken.append(time.process_time() - started)
        seconds[name] = min(taken)
    return seconds


def measure(size: str, rounds: int, peers: dict[str, Path]) -> tuple[list[Row], dict[str, float]]:
    """Take turns between all ways at one size."""
    shape, n_points, distance, n_video = SIZES[size]
    filmed = cases.case("affine", noise=1.0, shape=shape, n_frames=n_video)
    clip = replace(filmed, n_frames=N_FRAMES)
    frames = np.stack(list(clip.frames()))
    points = spaced_points(clip, n_points, distance)
    truth = filmed.truth(points)
    work = len(points) * (N_FRAMES - 1)
    rows = {name: Row(size, f"{name}, tracking", work) for name in OURS}
    rows["video"] = Row(size, "ours, from a video", len(points) * (n_video - 1))
    rows |= {name: Row(size, name, work) for name in peers if name in ("pyidi DIC", "pyidi LK")}

    def error(positions: np.ndarray) -> float:
        return float(
            np.sqrt(np.nanmean(((positions - truth[: len(positions)])[1:] ** 2).sum(axis=2)))
        )

    with tempfile.TemporaryDirectory() as folder:
        video = filmed.write(Path(folder) / "clip.avi")
        for config in OURS.values():
            track_ours(frames[:3], points, config)
        for _ in range(rounds):
            for name, config in OURS.items():
                tracks = track_ours(frames, points, config)
                rows[name].seconds.append(tracks.seconds)
                rows[name].rms = error(tracks.positions)
            started = time.process_time()
            with VideoSource(video) as source:
                result = Tracker(source, points).run()
            rows["video"].seconds.append(time.process_time() - started)
            rows["video"].rms = error(result.positions)
            for name in peers:
                if name not in rows:
                    continue
                answer, rows[name].remark = track_peer(frames, points, name, peers[name])
                if answer is not None:
                    rows[name].seconds.append(answer.seconds)
                    rows[name].rms = error(answer.positions)
        if "pyvale" in peers:
            rows |= measure_grid(clip, frames, size, rounds, peers["pyvale"])
    return list(rows.values()), parts(frames, points)


def measure_grid(
    clip: cases.Scene, frames: np.ndarray, size: str, rounds: int, interpreter: Path
) -> dict[str, Row]:
    """Take turns with pyvale, on the grid that it correlates."""
    height, width = clip.shape
    x, y = np.meshgrid(
        np.arange(MARGIN + 25, width - MARGIN, 20), np.arange(MARGIN + 25, height - MARGIN, 20)
    )
    nodes = np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)
    truth = clip.truth(nodes)
    work = len(nodes) * (N_FRAMES - 1)
    rows = {
        "pyvale": Row(size, "pyvale, its grid", work),
        "grid": Row(size, "ours, pyvale's grid", work),
    }
    for _ in range(rounds):
        answer, rows["pyvale"].remark = track_peer(frames, nodes, "pyvale", interpreter)
        for name, tracks in (("pyvale", answer), ("grid", track_ours(frames, nodes, OURS["ours"]))):
            if tracks is not None:
                rows[name].seconds.append(tracks.seconds)
                rows[name].rms = float(
                    np.sqrt(np.nanmean(((tracks.positions - truth)[1:] ** 2).sum(axis=2)))
                )
    return rows


def judge(rows: list[Row], out: Console) -> None:
    """Say what is demanded of 250 points at 480 x 360, and whether it holds."""
    by = {row.way: row for row in rows if row.size == "480 x 360"}
    whole = by.get("ours, from a video")
    if whole is None:
        return
    told = [("end to end from a video, a second", whole.speed, 20_000.0)]
    pairs = (
        ("pyidi DIC", "ours, tracking", 50.0),
        ("pyvale, its grid", "ours, pyvale's grid", 10.0),
    )
    for peer, own, limit in pairs:
        if peer in by and by[peer].seconds:
            told.append((f"{own} over {peer}", by[own].speed / by[peer].speed, limit))
    for what, value, limit in told:
        verdict = "holds" if value >= limit else "DOES NOT HOLD"
        out.print(f"{what}: {value:,.4g}, at least {limit:,g}: {verdict}")
    if len(told) > 1:
        out.print("of the two ratios, one has to hold")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--sizes", nargs="*", default=list(SIZES), choices=list(SIZES))
    parser.add_argument("--json", type=Path)
    add_peer_options(parser)
    arguments = parser.parse_args()
    load_cv2().setNumThreads(1)
    rows: list[Row] = []
    shares: dict[str, dict[str, float]] = {}
    for size in track(arguments.sizes, description="sizes"):
        more, shares[size] = measure(size, arguments.rounds, peers_given(arguments))
        rows += more
    out = Console()
    table = Table(
        "size", "way", "points x frames / s", "best round", "rms px", "against ours", "remark"
    )
    ours = {row.size: row for row in rows if row.way == "ours, tracking"}
    for row in rows:
        ratio = ours[row.size].speed / row.speed
        against = f"1/{ratio:.3g}" if ratio >= 1 else f"{1 / ratio:.3g}"
        table.add_row(
            row.size, row.way, f"{row.speed:,.0f}", f"{row.best:,.0f}", f"{row.rms:.4f}", against,
            row.remark,
        )  # fmt: skip
    out.print(table)
    for size, seconds in shares.items():
        told = ", ".join(f"{name} {1e3 * s:.2f} ms" for name, s in seconds.items())
        whole = ours[size].work / ours[size].best / (N_FRAMES - 1)
        limit = seconds["KLT there and back"]
        out.print(
            f"{size}, best rounds: {1e3 * whole:.2f} ms a frame ({told}); "
            f"{whole / limit:.2f} times the prediction alone"
        )
    judge(rows, out)
    write_json(
        arguments.json,
        {"rows": [asdict(r) | {"speed": r.speed} for r in rows], "parts": shares},
    )


if __name__ == "__main__":
    main()
