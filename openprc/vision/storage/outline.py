"""`info`: what a vision file holds, without reading it all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from openprc.schema.damage import damage_named
from openprc.schema.legacy_kinds import shape
from openprc.schema.safety import open_hdf5
from openprc.vision.storage.loading import stored_parts
from openprc.vision.storage.parts import GROUP, PARTS
from openprc.vision.storage.reading import read_source

_ARRAYS = {
    "feature_map": "keypoints",
    "tracking_result": "positions",
    "trajectory_set": "positions",
    "signals": "data",
}


def info(path: str | Path) -> dict[str, Any]:
    """Return an outline as plain values.

    Returns
    -------
    dict
        ``components``, their shapes, the ``units`` of the trajectories, the ``detector``, what
        is known of the video, whether the file is a ``simulation`` that `StateLoader` reads, and
        ``unknown``: names below ``/vision`` that no component has.

    Raises
    ------
    UnreadableFile
        When it is no vision file.
    """
    path = Path(path)
    with open_hdf5(path, allow_vlen=True) as file, damage_named(path, f"/{GROUP}"):
        names = stored_parts(file, path)
        group = file[GROUP]
        found: dict[str, Any] = {
            "path": str(path),
            "components": list(names),
            "simulation": file.attrs.get("kind") == "trajectory" and "time_series/time" in file,
            "version": str(group.attrs.get("version", "older tracker")),
            "unknown": sorted(set(group) - set(PARTS.values())),
        }
        for name in names:
            if name in _ARRAYS:
                where = f"{GROUP}/{PARTS[name]}/{_ARRAYS[name]}"
                size = shape(file, where)
                found[f"{name}_shape"] = None if size is None else list(size)
        if "source" in names:
            found["source"] = read_source(group["source"], path)
        if "feature_map" in names:
            found["detector"] = str(group["feature_map"].attrs.get("detector_name", ""))
        if "trajectory_set" in names:
            found["units"] = str(group["trajectories"].attrs.get("units", ""))
    return found
