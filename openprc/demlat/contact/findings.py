"""What contact cannot do, and what the reader of a result with contact should know."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from openprc.demlat.integrators import INTEGRATORS
from openprc.schema.findings import Finding

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.experiment import Experiment

#: Radius of a node in lengths of the shortest bar, where the experiment does not say.
RADIUS_SHARE = 0.25
#: Below this ratio of twice the area to the square of the longest edge a face is a line.
FLAT = 1e-12


def contact_radius(experiment: Experiment) -> float:
    """Return the radius of a node [m]: as given, else a quarter of the shortest bar."""
    if experiment.collision.radius is not None:
        return experiment.collision.radius
    return RADIUS_SHARE * float(experiment.geometry.bars.rest_length.min())


def can_touch(experiment: Experiment) -> bool:
    """Say whether anything of the experiment can touch anything else."""
    geometry, collision = experiment.geometry, experiment.collision
    if not collision.enabled or not geometry.collidable.any():
        return False
    return bool(geometry.collidable.sum() > 1 or (collision.faces and len(geometry.faces)))


def contact_refusals(experiment: Experiment) -> Iterator[Finding]:
    """Yield what keeps the contact of `experiment` from being modelled."""
    if not can_touch(experiment):
        return
    geometry, collision = experiment.geometry, experiment.collision
    if collision.radius is None and not len(geometry.bars):
        yield Finding(
            code="DEM-COLLISION-RADIUS",
            level="error",
            path="physics.collision_radius",
            found="contact without a radius, and no bar to derive one from",
            expected="the radius of a node [m]",
            fix="set collision_radius",
        )
    scheme = INTEGRATORS.get(experiment.integrator)
    if scheme is not None and scheme.step == "adaptive":
        able = [n for n, s in INTEGRATORS.items() if s.step == "fixed" and s.rigid == "no"]
        yield Finding(
            code="DEM-COLLISION-INTEGRATOR",
            level="error",
            path="simulation.integrator",
            found=f"contact with the integrator {scheme.name!r}, which chooses its step",
            expected="an integrator with a fixed step, after which contacts act: "
            + ", ".join(able),
            fix="choose one of these, or set enable_collision to false",
        )
    if geometry.bars.rigid.any() or geometry.hinges.rigid.any():
        yield Finding(
            code="DEM-COLLISION-RIGID",
            level="error",
            path="physics.enable_collision",
            found="contact of a body with rigid bars or hinges",
            expected="soft ones: an impact does not spread through constraints",
            fix="give them a stiffness about 100 times that of the soft ones, or set"
            " enable_collision to false",
        )
    if experiment.precision != "float64":
        yield Finding(
            code="DEM-COLLISION-PRECISION",
            level="error",
            path="simulation.precision",
            found=f"contact in {experiment.precision}",
            expected="float64: gaps are small differences of coordinates",
            fix="set precision to float64, or enable_collision to false",
        )
    if collision.faces:
        flat = _degenerate_faces(experiment)
        if len(flat):
            face = int(flat[0])
            yield Finding(
                code="DEM-COLLISION-FACE",
                level="error",
                path="geometry.faces",
                found=f"face {face} {geometry.faces[face].tolist()} has no area",
                expected="triangles that nodes can touch",
                fix="drop the face, or move its corners apart",
            )


def _degenerate_faces(experiment: Experiment) -> NDArray[np.int64]:
    a, b, c = experiment.geometry.positions[experiment.geometry.faces].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    edges = [np.linalg.norm(p - q, axis=1) for p, q in ((a, b), (b, c), (c, a))]
    return np.flatnonzero(area <= FLAT * np.max(edges, axis=0) ** 2)


def contact_remarks(experiment: Experiment) -> Iterator[str]:
    """Yield what the reader should know of the contacts of `experiment`."""
    geometry, collision = experiment.geometry, experiment.collision
    if not collision.enabled:
        return
    if not can_touch(experiment):
        yield (
            "enable_collision is on, but no two collidable nodes and no collidable node with"
            " faces (collision_faces) are there: nothing can collide"
        )
        return
    if collision.faces and not len(geometry.faces):
        yield "collision_faces is on and the geometry has no faces: only nodes collide"
    if collision.radius is None and not len(geometry.bars):
        return  # refused
    radius = contact_radius(experiment)
    if collision.radius is None:
        yield (
            f"collision_radius is not given: nodes have the radius {radius:.4g} m, a quarter of"
            " the shortest bar"
        )
    yield from _overlaps(experiment, radius)


def _overlaps(experiment: Experiment, radius: float) -> Iterator[str]:
    consequence = "they keep that distance until they have moved apart"
    pairs = overlapping_pairs(experiment, radius)
    if len(pairs):
        i, j = pairs[0]
        gap = np.linalg.norm(np.subtract(*experiment.geometry.positions[[i, j]]))
        yield (
            f"{len(pairs)} pairs of collidable nodes are closer than two radii"
            f" ({2 * radius:.4g} m) at t = 0, such as {i} and {j} ({gap:.4g} m): {consequence}"
        )
    facings = overlapping_facings(experiment, radius) if experiment.collision.faces else pairs[:0]
    if len(facings):
        node, face = facings[0]
        yield (
            f"{len(facings)} collidable nodes are closer to faces than their radius"
            f" ({radius:.4g} m) at t = 0, such as node {node} and face {face}: {consequence}"
        )


def overlapping_pairs(experiment: Experiment, radius: float) -> NDArray[np.int64]:
    """Return collidable nodes without a common bar that overlap at t = 0: (P, 2) [node]."""
    from scipy.spatial import cKDTree  # noqa: PLC0415 - only scenes with contact need it

    geometry = experiment.geometry
    nodes = np.flatnonzero(geometry.collidable)
    tree = cKDTree(geometry.positions[nodes])
    pairs = tree.query_pairs(2.0 * radius * (1.0 - 1e-12), output_type="ndarray")
    pairs = nodes[np.sort(pairs, axis=1)].reshape(-1, 2)
    bonds = np.sort(geometry.bars.indices, axis=1)
    n = geometry.n_nodes
    bonded = np.isin(pairs[:, 0] * n + pairs[:, 1], bonds[:, 0].astype("i8") * n + bonds[:, 1])
    pairs = pairs[~bonded & ~geometry.fixed[pairs].all(axis=1)]
    return pairs[np.lexsort(pairs.T[::-1])]


def overlapping_facings(experiment: Experiment, radius: float) -> NDArray[np.int64]:
    """Return collidable nodes and faces that overlap at t = 0: (P, 2) [node, face]."""
    from scipy.spatial import cKDTree  # noqa: PLC0415 - only scenes with contact need it

    geometry = experiment.geometry
    nodes = np.flatnonzero(geometry.collidable)
    corners = geometry.positions[geometry.faces]
    middle = corners.mean(axis=1)
    around = np.linalg.norm(corners - middle[:, np.newaxis], axis=2).max(axis=1, initial=0.0)
    near = cKDTree(geometry.positions[nodes]).query_ball_point(middle, around + radius)
    counts = [len(found) for found in near]
    face = np.repeat(np.arange(len(near)), counts)
    node = nodes[np.concatenate([*near, []]).astype("i8")]
    foreign = (geometry.faces[face] != node[:, np.newaxis]).all(axis=1)
    free = ~(geometry.fixed[node] & geometry.fixed[geometry.faces[face]].all(axis=1))
    face, node = face[foreign & free], node[foreign & free]
    gap = distance_to_triangle(geometry.positions[node], corners[face])
    facings = np.stack([node, face], axis=1)[gap < radius * (1.0 - 1e-12)]
    return facings[np.lexsort(facings.T[::-1])]


def distance_to_triangle(
    points: NDArray[np.float64], corners: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return distances of points (P, 3) from triangles (P, 3, 3) [m]: (P,).

    The least of the distances from the three edges and, above the inside, from the plane.
    """
    a, b, c = corners.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    inside = np.ones(len(points), dtype=bool)
    nearest = np.full(len(points), np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        edge, from_p = q - p, points - p
        inside &= np.einsum("pa,pa->p", np.cross(edge, from_p), normal) >= 0.0
        along = np.einsum("pa,pa->p", from_p, edge) / np.einsum("pa,pa->p", edge, edge)
        foot = np.clip(along, 0.0, 1.0)[:, np.newaxis] * edge
        nearest = np.minimum(nearest, np.linalg.norm(from_p - foot, axis=1))
    height = np.abs(np.einsum("pa,pa->p", points - a, normal))
    return np.where(inside, np.minimum(height, nearest), nearest)
