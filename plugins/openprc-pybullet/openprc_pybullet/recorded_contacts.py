"""Contacts of the recorded bodies, summed for every body or every link in every frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from openprc_pybullet.recorded_client import Connection
from openprc_pybullet.recorded_parts import NO_NODES, Channel, Nodes, Values

ContactChoice = Literal["bodies", "links"]
CONTACT_CHOICES: tuple[ContactChoice, ...] = ("bodies", "links")


class ContactPart:
    """Three channels: number of contact points, sum of normal forces, their vector sum.

    Contact points come and go, and PyBullet does not say which is which, so a column stands
    for a body or for a link. A point between two links of one body counts once for the body.

    Parameters
    ----------
    connection : Connection
    owners : pairs of body and link
        The rigid nodes.
    labels : names of these
    by : {"bodies", "links"}
    """

    nodes: Nodes = NO_NODES

    def __init__(
        self,
        connection: Connection,
        owners: Sequence[tuple[int, int]],
        *,
        labels: Sequence[str],
        by: ContactChoice,
    ) -> None:
        self._connection = connection
        if by == "bodies":
            bodies = list(dict.fromkeys(body for body, _ in owners))
            self._column = {(b, link): bodies.index(b) for b, link in owners}
            names = [f"body{body}" for body in bodies]
        else:
            self._column = {owner: i for i, owner in enumerate(owners)}
            names = list(labels)
        self._n = len(names)
        axes = [f"{name}.{axis}" for name in names for axis in "xyz"]
        self.channels = (
            Channel("contact_count", tuple(names), "1", "number of contact points"),
            Channel("contact_normal_force", tuple(names), "N", "sum of normal forces"),
            Channel("contact_force", tuple(axes), "N", "vector sum of normal forces, no friction"),
        )
        self.width = 5 * self._n

    def read(self, row: list[float]) -> None:
        """Append the sums over the contact points of the last step."""
        n, column = self._n, self._column
        sums = [0.0] * (5 * n)
        points = self._connection.bullet.getContactPoints(physicsClientId=self._connection.client)
        for point in points:
            a, b = column.get((point[1], point[3])), column.get((point[2], point[4]))
            force, normal = point[9], point[7]
            # The normal points from body B to body A.
            for side, sign in ((a, 1.0), (None if a == b else b, -1.0)):
                if side is None:
                    continue
                sums[side] += 1.0
                sums[n + side] += force
                if a != b:  # within a body they cancel
                    for axis in range(3):
                        sums[2 * n + 3 * side + axis] += sign * force * normal[axis]
        row += sums

    def values(self, block: NDArray[np.float64]) -> Values:
        """Sort a block into the three channels."""
        n = self._n
        parts = (block[:, :n], block[:, n : 2 * n], block[:, 2 * n :])
        names = (channel.name for channel in self.channels)
        return Values(np.empty((len(block), 0, 3)), None, dict(zip(names, parts, strict=True)))
