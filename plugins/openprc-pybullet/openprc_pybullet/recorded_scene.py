"""All recorded parts as one file: nodes side by side, bars and faces between them, channels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.schema import TrajectoryWriter
from openprc_pybullet.recorded_client import Clock, Connection
from openprc_pybullet.recorded_parts import Part, Values
from openprc_pybullet.robot_log import DISTRIBUTION


class Scene:
    """The parts of a recording.

    Parameters
    ----------
    parts : sequence of Part
        The rigid ones first.
    """

    def __init__(self, parts: Sequence[Part]) -> None:
        self._parts = tuple(parts)
        self._stops = np.cumsum([0, *(part.width for part in parts)])
        self.width = int(self._stops[-1])
        self.labels = [label for part in parts for label in part.nodes.labels]
        self.n_nodes = len(self.labels)
        with_nodes = [part.nodes for part in parts if part.nodes.labels]
        #: How many nodes, the first ones, have velocities.
        self.n_speeds = sum(len(nodes.labels) for nodes in with_nodes if nodes.has_velocities)
        self._fixed = np.array([flag for part in parts for flag in part.nodes.fixed], dtype=bool)
        self._held = np.flatnonzero(self._fixed)
        self._moved: set[int] = set()

    def values(self, block: NDArray[np.float64]) -> Values:
        """Sort a block of rows (B, width) into nodes (B, N, 3) and channels."""
        if len(self._parts) == 1:
            return self._parts[0].values(block)
        found = [
            part.values(block[:, a:b])
            for part, a, b in zip(self._parts, self._stops[:-1], self._stops[1:], strict=True)
        ]
        channels = {name: table for item in found for name, table in item.channels.items()}
        speeds = None
        if self.n_speeds:
            speeds = np.concatenate(
                [
                    np.full_like(item.positions, np.nan)
                    if item.velocities is None
                    else item.velocities
                    for item in found
                ],
                axis=1,
            )
        return Values(np.concatenate([item.positions for item in found], axis=1), speeds, channels)

    def as_frames(self, values: Values, rows: int) -> dict[str, Any]:
        """Return the first `rows` frames as what ``writer.append`` takes."""
        frames: dict[str, Any] = {
            "positions": values.positions[:rows],
            "channels": {name: table[:rows] for name, table in values.channels.items()},
        }
        if self.n_speeds:
            frames["velocities"] = None if values.velocities is None else values.velocities[:rows]
            if self.n_speeds < self.n_nodes:
                # NaN velocities of soft bodies need a mask that says the positions are there.
                frames["observed"] = np.ones((rows, self.n_nodes), dtype="u1")
        return frames

    def reach(self, rest: NDArray[np.float64], connection: Connection) -> float:
        """Return the size of the scene [m]: of the nodes, or of a body that is larger."""
        sizes = [float(np.linalg.norm(np.ptp(rest, axis=0)))]
        for body in {owner[0] for part in self._parts for owner in part.nodes.owners}:
            low, high = connection.bullet.getAABB(body, -1, connection.client)
            sizes.append(float(np.linalg.norm(np.subtract(high, low))))
        return max((size for size in sizes if np.isfinite(size)), default=0.0) or 1.0

    def declare(self, writer: TrajectoryWriter, first: Values, *, clock: Clock, every: int) -> None:
        """Declare everything but the inputs.

        Parameters
        ----------
        writer : TrajectoryWriter
        first : Values
            The first frame.
        clock : Clock
        every : int
        """
        nodes = [part.nodes for part in self._parts if part.nodes.labels]
        masses = [mass for item in nodes for mass in item.masses or ()]
        if len(masses) != self.n_nodes:
            writer.note("no masses: PyBullet does not tell those of soft bodies (soft={id: ...})")
        writer.declare_nodes(
            self.n_nodes,
            3,
            unit="m",
            velocities=self.n_speeds > 0,
            observed=0 < self.n_speeds < self.n_nodes,
            mass=masses if len(masses) == self.n_nodes else None,
            fixed=self._fixed,
            labels=self.labels,
        )
        starts = np.cumsum([0, *(len(item.labels) for item in nodes)])
        bars = [
            (a + i, b + i) for item, i in zip(nodes, starts, strict=False) for a, b in item.bars
        ]
        if bars:
            ends = first.positions[0][np.array(bars)]
            lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
            writer.declare_elements("bars", np.array(bars), static={"rest_length": (lengths, "m")})
        faces = [
            [i + corner for corner in face]
            for item, i in zip(nodes, starts, strict=False)
            for face in item.faces
        ]
        if faces:
            writer.declare_elements("faces", np.array(faces))
        for part in self._parts:
            for channel in part.channels:
                writer.declare_channel(
                    channel.name, channel.columns, unit=channel.unit, quantity=channel.quantity
                )
        self._declare_extension(writer, clock, every)

    def _declare_extension(self, writer: TrajectoryWriter, clock: Clock, every: int) -> None:
        writer.declare_extension(DISTRIBUTION, "1")
        owners = [owner for part in self._parts for owner in part.nodes.owners]
        writer.put_extension(
            DISTRIBUTION,
            "node_body_link",
            np.array(owners, dtype="i4"),
            comment="unique id of the body and index of the link (-1 the base) of every node; of "
            "soft bodies the number of the vertex",
        )
        for part in self._parts:
            names = getattr(part, "joint_names", ())
            if names:
                body = part.nodes.owners[0][0]
                writer.put_extension(
                    DISTRIBUTION,
                    f"body{body}.joints",
                    list(names),
                    comment="names of the joints q0, q1, ...",
                )
        writer.put_extension(DISTRIBUTION, "gravity", np.array(clock.gravity), unit="m/s2")
        writer.put_extension(
            DISTRIBUTION, "step", np.array(clock.dt), unit="s", comment="of the simulation"
        )
        writer.put_extension(
            DISTRIBUTION,
            "sub_steps",
            np.array(clock.sub_steps),
            comment="numSubSteps: parts into which PyBullet divides a step",
        )
        writer.put_extension(DISTRIBUTION, "every", np.array(every), comment="steps per frame")
        if clock.sub_steps > 1:
            writer.note(
                f"every step is divided into {clock.sub_steps} sub-steps (numSubSteps), over which "
                "forces that the script applies are held"
            )

    def watch_fixed(self, positions: NDArray[np.float64]) -> list[str]:
        """Return labels of nodes, held by mass 0, that a script was found to move."""
        held = positions[:, self._held]
        moved = self._held[(held.max(axis=0) > held.min(axis=0)).any(axis=1)]
        new = [int(i) for i in moved if int(i) not in self._moved]
        self._moved.update(new)
        return [self.labels[i] for i in new]
