"""Soft bodies of a running scene: the vertices of the simulated mesh, faces from its .obj."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, UnreadableFile, UnsupportedScene
from openprc.schema import safety
from openprc_pybullet.recorded_client import Connection
from openprc_pybullet.recorded_parts import Channel, Nodes, Values

#: A mesh file larger than this is no mesh of a body that PyBullet can simulate.
MAX_BYTES = 256 << 20


@dataclass(frozen=True, slots=True)
class SoftBody:
    """What the user says of a soft body, because PyBullet does not tell.

    Parameters
    ----------
    mesh : Path, optional
        The .obj it was loaded from, for the faces.
    mass : float, optional
        The mass given to ``loadSoftBody`` [kg]; every vertex has an equal share of it.
    """

    mesh: Path | None = None
    mass: float | None = None


def read_soft_option(given: Mapping[int, Any] | None) -> dict[int, SoftBody]:
    """Read ``{body: path}``, ``{body: None}`` or ``{body: {"mesh": path, "mass": kg}}``.

    Raises
    ------
    ConfigError
        When it is something else.
    """
    if not isinstance(given, Mapping | None):
        raise _wrong_option("soft", given)
    found = {}
    for body, value in (given or {}).items():
        if isinstance(body, bool) or not isinstance(body, int):
            raise _wrong_option(body, value)
        told = dict(value) if isinstance(value, Mapping) else {"mesh": value}
        mesh, mass = told.pop("mesh", None), told.pop("mass", None)
        if told or not (mesh is None or isinstance(mesh, str | Path)):
            raise _wrong_option(body, value)
        if mass is not None and not (isinstance(mass, int | float) and 0 < mass < np.inf):
            raise _wrong_option(body, value)
        found[int(body)] = SoftBody(
            None if mesh is None else Path(mesh), None if mass is None else float(mass)
        )
    return found


def _wrong_option(body: object, value: object) -> ConfigError:
    return ConfigError(
        f"soft body {body!r} is given as {value!r}",
        expected='its id and the path of its .obj, None, or {"mesh": path, "mass": kilograms}',
        fix="correct it",
        key="soft",
    )


def simulated_vertices(connection: Connection, body: int) -> tuple[tuple[float, ...], ...]:
    """Return the simulated vertices; without the flag the mesh that is drawn comes back."""
    p = connection.bullet
    data = p.getMeshData(
        body, -1, flags=p.MESH_DATA_SIMULATION_MESH, physicsClientId=connection.client
    )
    vertices: tuple[tuple[float, ...], ...] = data[1]
    return vertices


def refuse_hollow(connection: Connection, body: int) -> None:
    """Refuse a soft body without vertices: the next ``stepSimulation`` would crash Python.

    Raises
    ------
    UnsupportedScene
    """
    if not simulated_vertices(connection, body):
        raise UnsupportedScene(
            f"soft body {body} has no simulated vertices: PyBullet did not find its mesh, said "
            "so on the terminal only, and the next stepSimulation() would crash this process",
            expected="a soft body with a mesh",
            fix="correct fileName and simFileName of loadSoftBody, or removeBody it",
            key=f"body {body}",
        )


class SoftPart:
    """A soft body whose simulated vertices become nodes; its velocities nobody knows."""

    channels: tuple[Channel, ...] = ()

    def __init__(self, connection: Connection, body: int, told: SoftBody) -> None:
        self.body = body
        self._connection = connection
        n = len(simulated_vertices(connection, body))
        faces = read_faces(told.mesh, n_vertices=n, body=body) if told.mesh else ()
        self.nodes = Nodes(
            labels=tuple(f"body{body}.v{i}" for i in range(n)),
            owners=tuple((body, i) for i in range(n)),
            masses=None if told.mass is None else (told.mass / n,) * n,
            fixed=(False,) * n,
            faces=faces,
            has_velocities=False,
        )
        self.width = 3 * n

    def read(self, row: list[float]) -> None:
        """Append the vertices."""
        row += chain.from_iterable(simulated_vertices(self._connection, self.body))

    def values(self, block: NDArray[np.float64]) -> Values:
        """Return the vertices of a block."""
        return Values(block.reshape(len(block), -1, 3))


def read_faces(path: Path, *, n_vertices: int, body: int) -> tuple[tuple[int, int, int], ...]:
    """Read the triangles of a Wavefront .obj; polygons are cut into fans.

    Raises
    ------
    UnreadableFile
        When there is no such file, it is no .obj, or not the mesh of this body.
    """
    path = safety.check_readable(path)
    if path.suffix.lower() != ".obj" or path.stat().st_size > MAX_BYTES:
        raise _not_its_mesh(path, body, "it is no Wavefront .obj")
    faces: list[tuple[int, int, int]] = []
    count = 0
    with path.open(encoding="utf-8", errors="replace") as lines:
        for number, line in enumerate(lines, 1):
            words = line.split()
            if words[:1] == ["v"]:
                count += 1
            elif words[:1] == ["f"]:
                corners = [_corner(word, count) for word in words[1:]]
                if len(corners) < 3 or min(corners) < 0:
                    raise _not_its_mesh(path, body, f"line {number} is no face: {line.strip()!r}")
                faces += [(corners[0], *pair) for pair in pairwise(corners[1:])]
    if count != n_vertices:
        raise _not_its_mesh(path, body, f"{count} vertices, and the body has {n_vertices}")
    highest = max((max(face) for face in faces), default=-1)
    if highest >= count:
        raise _not_its_mesh(path, body, f"a face names vertex {highest + 1} of {count}")
    # A corner that is named twice makes no triangle.
    return tuple(face for face in faces if len(set(face)) == 3)


def _corner(word: str, count: int) -> int:
    """Return the vertex, counted from 0, that ``v/vt/vn`` names; -1 when it names none."""
    text = word.partition("/")[0]
    if not text.removeprefix("-").isdecimal():
        return -1
    index = int(text)
    # Negative ones count backwards from the last vertex so far.
    return index - 1 if index > 0 else count + index if index < 0 else -1


def _not_its_mesh(path: Path, body: int, found: str) -> UnreadableFile:
    return UnreadableFile(
        f"this is not the mesh of soft body {body}: {found}",
        expected="the .obj that loadSoftBody simulates (simFileName, or fileName without it)",
        fix=f"name that file, or record without faces: soft={{{body}: None}}",
        file=path,
        key="soft",
    )
