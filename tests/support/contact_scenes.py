"""Scenes of the contact tests."""

import numpy as np

from openprc.schema.experiment import Collision, Experiment
from openprc.schema.geometry import Bars, Geometry, Hinges

FLOOR = [[-5.0, -5, 0], [5, -5, 0], [0, 8, 0]]
GRAVITY = 9.81


def contact_scene(
    positions,
    velocities,
    *,
    masses=None,
    floor=False,
    radius=0.1,
    gravity=0.0,
    bars=(),
    stiffness=100.0,
    faces=None,
    collidable=None,
    fixed=None,
    hinges=None,
    collision=None,
    **settings,
):
    """Make an experiment whose nodes are collidable unless they are corners of the floor."""
    n = len(positions)
    corners = len(FLOOR) if floor else 0
    moved = [*(FLOOR if floor else []), *positions]
    lengths = [np.linalg.norm(np.subtract(moved[i], moved[j])) for i, j in bars]
    geometry = Geometry(
        positions=moved,
        velocities=[[0, 0, 0]] * corners + list(velocities),
        masses=[1.0] * corners + list([1.0] * n if masses is None else masses),
        fixed=[True] * corners + list([False] * n if fixed is None else fixed),
        collidable=[False] * corners + list([True] * n if collidable is None else collidable),
        bars=Bars(
            indices=np.array(bars, int).reshape(-1, 2),
            stiffness=[stiffness] * len(bars),
            rest_length=lengths,
        ),
        hinges=Hinges() if hinges is None else hinges,
        faces=[[0, 1, 2]] if floor else ([] if faces is None else faces),
    )
    rules = {"radius": radius, "faces": floor or faces is not None} | (collision or {})
    times = {"duration": 1.0, "dt": 1e-3, "save_interval": 1e-2} | settings
    return Experiment(
        geometry=geometry,
        gravity=(0.0, 0.0, -gravity) if np.isscalar(gravity) else gravity,
        collision=Collision(enabled=True, **rules),
        **times,
    )
