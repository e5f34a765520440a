"""A small MERLIN2 workspace whose every number is known in closed form."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.hooks import Sample

#: Rest state: the crease between nodes 2 and 3, the wings 1 and 4 at right angles to it [mm].
REST = np.array([[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
BARS = np.array([[2, 3], [1, 2], [1, 3], [2, 4], [3, 4]])
#: Fold stiffness per unit length of crease; the crease is 2 long and the wing 1 high.
KF = 0.2
N_INCREMENTS = 60
LARGEST = 1.1


def fold_angles(n_increments: int = N_INCREMENTS) -> NDArray[np.float64]:
    """Return by how much the hinge is folded after every increment, (T,) [rad]."""
    return LARGEST * np.arange(1, n_increments + 1) / n_increments


def load_factors(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the vertical force on the free wing, K L angle / (height cos(angle)), (T,) [N]."""
    return KF * 2.0 * angles / np.cos(angles)


def workspace(n_increments: int = N_INCREMENTS) -> dict[str, Any]:
    """Return the variables of the run.

    One triangle is held, the other turns rigidly about the crease: node 4 moves on the circle
    (cos a, 0, sin a), every bar keeps its length, and the stored angle is pi + a.
    """
    a = fold_angles(n_increments)
    u = np.zeros((12, n_increments))
    u[9], u[11] = np.cos(a) - 1.0, np.sin(a)
    force = np.zeros((12, 1))
    force[11] = 1.0
    rest_length = np.linalg.norm(REST[BARS[:, 1] - 1] - REST[BARS[:, 0] - 1], axis=1)
    panels = np.empty((2, 1), dtype=object)
    panels[0, 0], panels[1, 0] = np.array([[1.0, 2.0, 3.0]]), np.array([[2.0, 4.0, 3.0]])
    return {
        "Node": REST,
        "Panel": panels,
        "Supp": np.array([[1, 1, 1, 1], [2, 1, 1, 1], [3, 1, 1, 1]], dtype=float),
        "Load": np.array([[4.0, 0.0, 0.0, 1.0]]),
        "Uhis": u,
        "Fhis": load_factors(a)[:, None],
        "truss": {
            "Node": REST,
            "Bars": BARS.astype(float),
            "Trigl": np.array([[1.0, 2.0, 3.0], [2.0, 4.0, 3.0]]),
            "L": rest_length[:, None],
            "A": np.full((5, 1), 0.1),
            "U0": np.zeros((12, 1)),
            "FixedDofs": np.arange(1.0, 10.0)[:, None],
        },
        "angles": {
            "fold": np.array([[2.0, 3.0, 1.0, 4.0]]),
            "bend": np.zeros((0, 4)),
            "Kf": np.array([[KF]]),
            "Kb": np.zeros((0, 1)),
            "pf0": np.array([[np.pi]]),
            "pb0": np.zeros((0, 1)),
        },
        "AnalyInputOpt": {"ModelType": "N4B5", "LoadType": "Force", "Load": force},
    }


def write_sample(folder: Path) -> Sample:
    """Write ``merlin_fold.mat`` into `folder`: rigid folding of one crease, 60 increments."""
    from scipy.io import savemat

    path = Path(folder) / "merlin_fold.mat"
    savemat(path, workspace(), do_compression=True)
    return Sample(path=path, options={"unit": "mm", "force-unit": "N"})
