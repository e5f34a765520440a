"""Names that PyElastica scripts give to what they store, and what those names mean.

Scripts append to a dict in a callback and choose the keys themselves. The spellings below are
those of PyElastica's attributes, of its `ExportCallBack`, and the usual short forms.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

#: Where a quantity lives: nodes, elements between them, joints between elements, whole rod.
Place = Literal["node", "element", "joint", "rod"]

#: Canonical name to accepted spellings (lower case), the preferred one first.
ALIASES: dict[str, tuple[str, ...]] = {
    "time": ("time", "times", "t", "timestamps"),
    "step": ("step", "steps", "current_step"),
    "position": (
        "position",
        "position_collection",
        "positions",
        "node_positions",
        "pos",
        "x",
    ),
    "velocity": (
        "velocity",
        "velocity_collection",
        "velocities",
        "node_velocities",
        "vel",
        "v",
    ),
    "acceleration": ("acceleration", "acceleration_collection", "accelerations"),
    "directors": ("directors", "director_collection", "director", "directors_collection"),
    "omega": ("omega", "omega_collection", "omegas", "angular_velocity"),
    "mass": ("mass", "masses", "nodal_mass"),
    "radius": ("radius", "radii"),
    "lengths": ("lengths", "element_lengths"),
    "rest_lengths": ("rest_lengths", "rest_length"),
    "tangents": ("tangents", "tangent"),
    "dilatation": ("dilatation", "dilatations"),
    "sigma": ("sigma", "shear_strain", "strain_shear"),
    "kappa": ("kappa", "curvature", "curvatures"),
    "internal_stress": ("internal_stress",),
    "internal_couple": ("internal_couple",),
    "internal_forces": ("internal_forces", "internal_force"),
    "internal_torques": ("internal_torques", "internal_torque"),
    "external_forces": ("external_forces", "external_force"),
    "external_torques": ("external_torques", "external_torque"),
}

#: Keys that are taken for the drive when the caller names none.
DRIVES: tuple[str, ...] = ("u", "input", "inputs", "drive", "forcing")

#: Whole-rod numbers that the shipped examples store, with their units.
WHOLE_ROD_UNITS: dict[str, str] = {
    "te": "J",
    "re": "J",
    "se": "J",
    "be": "J",
    "translational_energy": "J",
    "rotational_energy": "J",
    "shear_energy": "J",
    "bending_energy": "J",
    "com": "m",
    "center_of_mass": "m",
    "com_velocity": "m/s",
    "avg_velocity": "m/s",
    "velocity_norms": "m/s",
}


@dataclass(frozen=True, slots=True)
class Quantity:
    """Unit and place of a quantity, and whether it is evaluated half a step before the sample.

    PyElastica's position Verlet step evaluates strains and internal loads between its two half
    moves, so that at callback time they belong to t - dt/2, while positions, velocities and
    directors belong to t. ``vector`` quantities have one axis of length 3, ``directors`` two.
    """

    unit: str
    place: Place
    rank: Literal[0, 1, 2]
    half_step: bool = False


QUANTITIES: dict[str, Quantity] = {
    "position": Quantity("m", "node", 1),
    "velocity": Quantity("m/s", "node", 1),
    "acceleration": Quantity("m/s2", "node", 1),
    "directors": Quantity("1", "element", 2),
    "omega": Quantity("rad/s", "element", 1),
    "mass": Quantity("kg", "node", 0),
    "radius": Quantity("m", "element", 0, half_step=True),
    "lengths": Quantity("m", "element", 0, half_step=True),
    "rest_lengths": Quantity("m", "element", 0),
    "tangents": Quantity("1", "element", 1, half_step=True),
    "dilatation": Quantity("1", "element", 0, half_step=True),
    "sigma": Quantity("1", "element", 1, half_step=True),
    "kappa": Quantity("1/m", "joint", 1, half_step=True),
    "internal_stress": Quantity("N", "element", 1, half_step=True),
    "internal_couple": Quantity("N*m", "joint", 1, half_step=True),
    "internal_forces": Quantity("N", "node", 1, half_step=True),
    "internal_torques": Quantity("N*m", "element", 1, half_step=True),
    "external_forces": Quantity("N", "node", 1, half_step=True),
    "external_torques": Quantity("N*m", "element", 1, half_step=True),
}

#: Names that hardly any other program uses: they tell a PyElastica file from its likes.
SIGNATURE = frozenset(
    {
        "position_collection",
        "velocity_collection",
        "director_collection",
        "omega_collection",
        "directors",
        "dilatation",
        "sigma",
        "kappa",
        "internal_stress",
        "internal_couple",
    }
)

#: Attributes of a rod object; an archive with these is a state saved by ``save_state``.
SNAPSHOT = frozenset({"position_collection", "rest_lengths", "shear_matrix", "bend_matrix"})


def canonical(spelling: str) -> str | None:
    """Return the canonical name of a key, or None when it is not one of `ALIASES`."""
    return _CANONICAL.get(spelling.lower())


def preference(spelling: str) -> int:
    """Return the rank of a spelling among those of its quantity, 0 the most usual."""
    name = _CANONICAL[spelling.lower()]
    return ALIASES[name].index(spelling.lower())


_CANONICAL = {spelling: name for name, spellings in ALIASES.items() for spelling in spellings}
