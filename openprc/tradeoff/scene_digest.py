"""What makes a scene the same scene, whatever it is solved with."""

from __future__ import annotations

import hashlib
import json
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment

#: What a trade-off varies, and what says only where a scene is stored.
_APART = frozenset(
    {
        "dt", "integrator", "tolerance", "constraint_tolerance", "precision", "step_check",
        "stored", "overwrite", "path", "sources", "layout", "notes", "accuracy",
    }
)  # fmt: skip


def scene_digest(experiment: Experiment) -> str:
    """Return a SHA-256 over body, drives, fields, duration and times of frames.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from openprc.scenes.catalog import build_scene
    >>> from openprc.tradeoff.scene_digest import scene_digest
    >>> scene = build_scene("oscillator").experiment
    >>> scene_digest(scene) == scene_digest(replace(scene, integrator="verlet"))
    True
    >>> scene_digest(scene) == scene_digest(replace(scene, damping=0.5))
    False
    """
    digest = hashlib.sha256()
    for column in fields(experiment):
        if column.name not in _APART:
            digest.update(column.name.encode())
            _add(digest, getattr(experiment, column.name))
    return digest.hexdigest()


def _add(digest: Any, value: Any) -> None:
    if is_dataclass(value):
        for column in fields(value):
            digest.update(column.name.encode())
            _add(digest, getattr(value, column.name))
    elif isinstance(value, np.ndarray):
        digest.update(f"{value.dtype.kind}{value.shape}".encode())
        data = value.tolist() if value.dtype.kind in "UO" else value
        digest.update(repr(data).encode() if data is not value else value.tobytes())
    elif isinstance(value, dict):
        for name in sorted(value):
            digest.update(str(name).encode())
            _add(digest, value[name])
    elif isinstance(value, tuple | list):
        for item in value:
            _add(digest, item)
        digest.update(f"|{len(value)}".encode())
    else:
        digest.update(json.dumps(value, default=str).encode())
