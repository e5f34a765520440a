"""simulation.h5 to extended XYZ."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.errors import ConfigError, MissingData
from openprc.exporters.rows import Rows, require_positions

if TYPE_CHECKING:
    from openprc.schema import Trajectory


class XyzExporter:
    """Writes a block of lines a frame: the number of nodes, a comment, and a line a node.

    The comment has the keys of extended XYZ (``Properties=species:S:1:pos:R:3 Time=...``).
    The format knows no missing points and no two-dimensional places: a frame in which a node
    is missing is refused, and z = 0 is written where there is no z.
    """

    def export(
        self, trajectory: Trajectory, path: Path, *, options: Mapping[str, Any]
    ) -> list[Path]:
        """Write every ``options["stride"]``-th frame to `path`.

        Raises
        ------
        MissingData
            When there are no positions, or a node is missing in a frame.
        ConfigError
            When the stride is below 1, or the species is not one word.
        """
        frames, species = Rows(trajectory.n_frames, options), options["species"]
        if len(species.split()) != 1:
            raise ConfigError(
                f"species is {species!r}",
                expected="one word without spaces",
                fix="correct the option",
                key="species",
            )
        require_positions(trajectory)
        with path.open("x", encoding="utf-8") as stream:
            for frame in range(0, trajectory.n_frames, frames.stride):
                places = trajectory.positions(slice(frame, frame + 1))[0]
                stream.write(_block(trajectory, frame, places, species=species))
        return [path]


def _block(trajectory: Trajectory, frame: int, places: Any, *, species: str) -> str:
    if np.isnan(places).any():
        node = int(np.flatnonzero(np.isnan(places).any(axis=1))[0])
        raise MissingData(
            f"node {node} is missing in frame {frame}",
            expected="every node in every frame, which the format needs",
            fix="export it as csv or npz, which know missing points",
            file=trajectory.path,
            key="/time_series/nodes/observed",
        )
    flat = np.zeros((len(places), 3))
    flat[:, : places.shape[1]] = places
    time = float(trajectory.time[frame])
    head = f"Properties=species:S:1:pos:R:3 Time={time!r} unit={trajectory.position_unit}"
    lines = [f"{species} {x!r} {y!r} {z!r}" for x, y, z in flat.tolist()]
    return "\n".join([str(len(flat)), head, *lines]) + "\n"
