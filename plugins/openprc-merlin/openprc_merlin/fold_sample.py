"""A FOLD animation whose every number is known in closed form."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from openprc.hooks import Sample

#: Two right triangles beside the crease 1-2, flat in the first frame [mm].
FLAT = np.array([[-10.0, 0.0, 0.0], [0.0, -10.0, 0.0], [0.0, 10.0, 0.0], [10.0, 0.0, 0.0]])
N_FRAMES = 41
LARGEST = 1.2


def fold_angles(n_frames: int = N_FRAMES) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the fold angle of every frame, (T,) [rad], valleys positive."""
    angles: np.ndarray[Any, np.dtype[np.float64]] = LARGEST * np.sin(
        2 * np.pi * np.arange(n_frames) / (n_frames - 1)
    )
    return angles


def document(n_frames: int = N_FRAMES) -> dict[str, Any]:
    """Return the animation: vertex 3 turns about the crease, the other triangle is held."""
    frames = []
    for angle in fold_angles(n_frames).tolist():
        points = FLAT.copy()
        points[3] = [10 * np.cos(angle), 0.0, 10 * np.sin(angle)]
        degrees = float(np.rad2deg(angle))
        frames.append(
            {
                "frame_inherit": True,
                "frame_parent": 0,
                "vertices_coords": points.tolist(),
                "edges_foldAngle": [degrees, 0.0, 0.0, 0.0, 0.0],
            }
        )
    return {
        "file_spec": 1.2,
        "file_classes": ["animation"],
        "frame_classes": ["foldedForm"],
        "frame_unit": "mm",
        "vertices_coords": frames[0]["vertices_coords"],
        "edges_vertices": [[1, 2], [0, 1], [0, 2], [1, 3], [2, 3]],
        "edges_assignment": ["V", "B", "B", "B", "B"],
        "faces_vertices": [[0, 1, 2], [1, 3, 2]],
        "file_frames": frames[1:],
    }


def write_sample(folder: Path) -> Sample:
    """Write ``crease.fold`` into `folder`: one crease that folds up and down once."""
    path = Path(folder) / "crease.fold"
    path.write_text(json.dumps(document()), encoding="utf-8")
    return Sample(path=path, options={"dt": 0.01})
