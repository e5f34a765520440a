"""MERLIN's own post-processed results: compared with the positions, and kept on request."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc_merlin import geometry
from openprc_merlin.workspace import Workspace

Floats = NDArray[np.float64]
#: The inverse cosine that MERLIN uses loses this much near flat [rad].
ANGLE_NOISE = 1e-6
STRAIN_NOISE = 1e-9
_BLOCK = 64


def strains(workspace: Workspace) -> Floats | None:
    """Return the stored Green-Lagrange strains, (T, M), or None."""
    if workspace.bars is None:
        return None
    value = _dig(workspace.variables, "STAT", "bar", "Ex")
    value = _dig(workspace.variables, "Data", "Exbar") if value is None else value
    return _by_increment(value, len(workspace.bars), workspace)


def angles(workspace: Workspace) -> Floats | None:
    """Return the stored hinge angles [rad], (T, H), bends before folds, or None."""
    if workspace.hinges is None:
        return None
    n_bends = int((workspace.hinges.code == 2).sum())
    n_folds = len(workspace.hinges.code) - n_bends
    parts = []
    for (newer, older), count in ((("bend", "BdAngle"), n_bends), (("fold", "FdAngle"), n_folds)):
        value = _dig(workspace.variables, "STAT", newer, "Angle")
        value = _dig(workspace.variables, "Data", older) if value is None else value
        part = _by_increment(value, count, workspace)
        if part is None and count:
            return None
        parts.append(np.zeros((workspace.n_increments, 0)) if part is None else part)
    return np.concatenate(parts, axis=1)


def energy(workspace: Workspace) -> Floats | None:
    """Return the stored strain energy, (T,), or None."""
    value = _dig(workspace.variables, "STAT", "PE")
    value = value.get("strain") if isinstance(value, Mapping) else value
    if not isinstance(value, np.ndarray):
        return None
    row = _by_increment(value.reshape(1, -1), 1, workspace)
    return None if row is None else row[:, 0]


def _dig(variables: Mapping[str, Any], *path: str) -> Any:
    value: Any = variables
    for key in path:
        value = value.get(key) if isinstance(value, Mapping) else None
    return value


def _by_increment(value: Any, rows: int, workspace: Workspace) -> Floats | None:
    if not isinstance(value, np.ndarray) or value.ndim != 2 or value.shape[0] != rows:
        return None
    # A history that was cut where the solver diverged keeps its first columns.
    end = workspace.skipped + workspace.n_increments
    if value.shape[1] < end:
        return None
    return np.asarray(value.real[:, workspace.skipped : end].T, dtype=np.float64)


def compare(workspace: Workspace) -> list[str]:
    """Return notes where stored results and positions disagree; positions are trusted."""
    kept_strains, kept_angles = strains(workspace), angles(workspace)
    if kept_strains is None and kept_angles is None:
        return []
    worst_strain = 0.0
    mirrored = other = 0
    for begin in range(0, workspace.n_increments, _BLOCK):
        block = slice(begin, begin + _BLOCK)
        positions = workspace.nodes + workspace.displacements[block]
        if kept_strains is not None and workspace.bars is not None:
            stretch = geometry.bar_lengths(positions, workspace.bars) / workspace.bar_length
            with np.errstate(over="ignore"):
                difference = np.abs((stretch**2 - 1) / 2 - kept_strains[block])
            worst_strain = max(worst_strain, float(difference.max(initial=0.0)))
        if kept_angles is not None and workspace.hinges is not None:
            angle = geometry.dihedral_angles(positions, workspace.hinges.indices)
            wrong = _apart(angle, kept_angles[block])
            flipped = wrong & ~_apart(2 * np.pi - angle, kept_angles[block])
            mirrored += int(flipped.sum())
            other += int((wrong & ~flipped).sum())
    notes = []
    if worst_strain > STRAIN_NOISE:
        notes.append(
            f"stored bar strains differ from those of the positions by up to {worst_strain:.2g}; "
            "the positions are trusted"
        )
    if mirrored:
        notes.append(
            f"{mirrored} stored angles are 2 pi minus those of the positions: MERLIN tells the "
            "side of a hinge by an absolute 1e-8, which fails for edges below about 2e-3 units; "
            "the positions are trusted"
        )
    if other:
        notes.append(
            f"{other} stored angles differ from those of the positions by more than "
            f"{ANGLE_NOISE:g} rad; the positions are trusted"
        )
    return notes


def _apart(angle: Floats, kept: Floats) -> NDArray[np.bool_]:
    """Tell where two angles differ by more than round-off, whatever their turn."""
    return np.abs(np.angle(np.exp(1j * (angle - kept)))) > ANGLE_NOISE
