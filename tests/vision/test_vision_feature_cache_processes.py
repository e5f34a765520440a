"""The sidecar between processes, and of a real recording."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from openprc.vision import FeatureMapCache, VideoSource
from openprc.vision.synth import cases

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "vision"

WORKER = """
import sys
from openprc.vision import FeatureMapCache, VideoSource
path, first = sys.argv[1], int(sys.argv[2])
source = VideoSource(path)
for corners in range(first, first + 6):
    kept = FeatureMapCache(source)
    found = kept.get_or_detect(source.read_frame(0), "gftt", max_corners=corners)
    if len(found) != corners or kept.notes:
        sys.exit(f"{corners}: {len(found)} {kept.notes}")
"""


def test_two_processes_at_once_never_leave_a_broken_file(tmp_path):
    scene = cases.case("translation", n_frames=3, shape=(120, 160))
    clip = scene.write(tmp_path / "clip.avi", codec="FFV1", fps=30.0)
    sidecar = tmp_path / "clip.avi.fmap.h5"
    command = [sys.executable, "-c", WORKER, str(clip)]
    running = [
        subprocess.Popen([*command, first], stderr=subprocess.PIPE, text=True)
        for first in ("10", "13")
    ]
    problems = [process.communicate()[1] for process in running]
    assert problems == ["", ""]
    with h5py.File(sidecar) as file:
        assert 1 <= len(file) <= 9
        for group in file.values():
            assert len(group["keypoints"]) == len(group["responses"])
    assert list(tmp_path.glob("*.fmap.h5*")) == [sidecar]
    assert not list(tmp_path.glob(".*"))


@pytest.mark.skipif(not DATA.is_dir(), reason="the shared recordings are not there")
def test_a_real_recording_is_detected_once(tmp_path):
    written = []
    for _ in range(2):
        source = VideoSource(DATA / "mechanism_ffv1.avi")
        found = FeatureMapCache(source, cache_dir=tmp_path).get_or_detect(
            source.read_frame(0), method="sift", contrast_threshold=0.04
        )
        (sidecar,) = tmp_path.iterdir()
        written.append(sidecar.stat().st_mtime_ns)
    assert written[0] == written[1]
    best = found.top_n(200)
    assert len(best) == 200
    assert len(np.unique(best.keypoints, axis=0)) == 200
