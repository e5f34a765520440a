"""A reference that is kept beside the points it belongs to."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import BadZipFile

import numpy as np

from openprc.errors import ConfigError
from openprc.hooks.running import silent
from openprc.schema.atomic import atomic_file
from openprc.tradeoff.reference import ConvergedReference, converged_reference

if TYPE_CHECKING:
    from openprc.hooks.protocols import Progress
    from openprc.scenes.scene import Scene


def kept_reference(
    scene: Scene,
    path: Path | None,
    *,
    digest: str,
    longest: float,
    needed: float,
    progress: Progress = silent,
) -> ConvergedReference:
    """Return the reference in the file `path`; where there is none, compute and keep it.

    Raises
    ------
    ConfigError
        When the file is of another scene, or is none.
    NotConverged
        See `converged_reference`.
    """
    if path is not None and path.exists():
        return _read(path, digest)
    found = converged_reference(
        scene.experiment,
        longest=longest,
        needed=needed,
        exact=scene.reference.exact,
        progress=progress,
    )
    if path is not None:
        head = json.dumps(found.as_dict() | {"scene": digest})
        with atomic_file(path, overwrite=True) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, positions=found.positions, head=np.array(head))
    return found


def _read(path: Path, digest: str) -> ConvergedReference:
    fix = "choose another folder with --out, or remove the file and measure again"
    try:
        with np.load(path, allow_pickle=False) as file:
            head, positions = json.loads(str(file["head"])), file["positions"]
            scene = head.pop("scene")
            head["differences"], head["notes"] = tuple(head["differences"]), tuple(head["notes"])
            found = ConvergedReference(positions=positions, **head)
    except (BadZipFile, KeyError, TypeError, ValueError, EOFError):
        raise ConfigError(
            "this is no reference of a trade-off study",
            expected="the file that `openprc tradeoff --out` writes",
            fix=fix,
            file=path,
        ) from None
    if scene != digest:
        raise ConfigError(
            "the reference is of another scene, or of other options of it",
            expected=f"a scene with the digest {digest[:12]}, found {scene[:12]}",
            fix=fix,
            file=path,
        )
    return found
