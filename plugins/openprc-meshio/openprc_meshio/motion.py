"""From frames of a series to rows of a trajectory."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, NotATrajectory, UnreadableFile
from openprc_meshio import topology
from openprc_meshio.frames import Array, Frame, Series
from openprc_meshio.identity import NodeIdentity, cell_values
from openprc_meshio.roles import Kept, Roles, check_values, require

if TYPE_CHECKING:
    from openprc.schema import TrajectoryWriter
    from openprc_meshio.clock import Clock

Floats = NDArray[np.float64]
_BLOCK_BYTES = 4 << 20


class Motion:
    """Declares what a series holds, and appends its frames.

    Parameters
    ----------
    series : Series
    roles : Roles
    options : mapping
        ``ids``, ``edges``, ``dims``, ``missing``.

    Raises
    ------
    UnreadableFile, SchemaError, MissingData
        When the first frame is damaged, or lacks what an option names.
    ConfigError
        When dims does not fit the places.
    """

    def __init__(self, series: Series, roles: Roles, options: Mapping[str, Any]) -> None:
        self._series, self._roles = series, roles
        self._path = series.path
        first = series.frames[0]
        points = first.points()
        if points.ndim != 2 or not len(points) or points.shape[1] not in (2, 3):
            raise UnreadableFile(
                f"points of shape {points.shape} in the first frame",
                expected="points in 2 or 3 dimensions",
                fix="export the mesh with its points",
                file=self._path,
            )
        self._rest = points.astype(np.float64)
        self._wide = points.shape[1]
        for name in (roles.displacement, roles.velocity):
            if name is not None:
                self._wide = max(self._wide, first.point_field(name).shape[1])
        self._identity = NodeIdentity(
            first, n_nodes=len(self._rest), ids=options.get("ids"), path=self._path
        )
        built = topology.build(
            self._identity.tables,
            n_nodes=len(self._rest),
            edges=bool(options.get("edges")),
            path=self._path,
        )
        self.elements = {"bars": built.bars, "faces": built.faces}
        self.notes = list(built.notes)
        self._series_of = {
            kind: [kept for kept in kept_fields if len(self.elements[kind].nodes)]
            for kind, kept_fields in roles.elements.items()
        }
        self._missing = roles.observed or bool(options.get("missing"))
        self._moves = False
        self._token: object = first.same_points
        self._dims = self._planar(options.get("dims"))

    # --- places -----------------------------------------------------------------------------

    def _planar(self, asked: int | None) -> int:
        """Return the number of dimensions in which something was measured."""
        if asked not in (None, 2, 3):
            raise ConfigError(
                f"dims is {asked}", expected="2 or 3", fix="correct the option", file=self._path,
                key="dims",
            )  # fmt: skip
        dims = asked or self._series.dims
        if dims == 3 and self._wide == 2:
            raise ConfigError(
                "dims is 3, and the points have two coordinates",
                expected="dims=2",
                fix="leave the option out",
                file=self._path,
                key="dims",
            )
        if dims or self._wide == 2:
            return dims or 2
        last = len(self._series.frames) - 1
        for index in (0, last, *range(1, last)):
            frame = self._series.frames[index]
            places, speeds = self._places(frame, index), self._speeds(frame, index)
            if np.any(places[:, 2] != 0.0) or (speeds is not None and np.any(speeds[:, 2] != 0.0)):
                return 3
        self.notes.append("z is 0 everywhere: stored in two dimensions; dims=3 keeps it")
        return 2

    def _places(self, frame: Frame, index: int) -> Floats:
        """Return the places of all nodes, (N, 2 or 3), in the order of the frame."""
        return self._displaced(self._points(frame, index), frame, index)

    def _points(self, frame: Frame, index: int) -> Floats:
        if frame.same_points is not None and frame.same_points == self._token:
            return self._rest
        points = frame.points().astype(np.float64)
        self._identity.check_count(frame, index, len(points))
        if points.shape[1:] != self._rest.shape[1:]:
            raise UnreadableFile(
                f"frame {index} has points of shape {points.shape}, the first {self._rest.shape}",
                expected="one number of dimensions",
                fix="export the series again",
                file=self._path,
            )
        return points

    def _displaced(self, points: Floats, frame: Frame, index: int) -> Floats:
        name = self._roles.displacement
        places = _padded(points, self._wide)
        if name is None:
            return places
        return places + _padded(self._field(frame, name, index, key="displacement"), self._wide)

    def _speeds(self, frame: Frame, index: int) -> Floats | None:
        name = self._roles.velocity
        if name is None:
            return None
        return _padded(self._field(frame, name, index, key="velocity"), self._wide)

    def _field(self, frame: Frame, name: str, index: int, *, key: str) -> Array:
        require(frame, name, index, self._path, key=key)
        values = frame.point_field(name)
        check_values(values, name, index, self._path)
        self._identity.check_count(frame, index, len(values))
        if values.ndim == 2 and values.shape[1] > 3 and key != "channels":
            raise UnreadableFile(
                f"the field {name!r} of frame {index} has {values.shape[1]} numbers a point",
                expected="2 or 3",
                fix="export the series again",
                file=self._path,
                key=name,
            )
        return values

    # --- writing ----------------------------------------------------------------------------

    def write(self, writer: TrajectoryWriter, *, clock: Clock, unit: str) -> None:
        """Declare and append everything.

        Raises
        ------
        NotATrajectory
            When nothing moved and no field was asked for.
        """
        self._declare(writer, clock=clock, unit=unit)
        frames = self._series.frames
        row = len(self._rest) * self._dims * 8 * (2 if self._roles.velocity else 1)
        size = max(1, min(1024, _BLOCK_BYTES // row))
        start: Floats | None = None
        for low in range(0, len(frames), size):
            rows = [
                self._row(frames[i], i, clock) for i in range(low, min(low + size, len(frames)))
            ]
            block = _stacked(rows)
            places = block["positions"]
            start = places[0] if start is None else start
            self._moves = self._moves or not np.array_equal(
                places, np.broadcast_to(start, places.shape), equal_nan=True
            )
            writer.append(**block)
        kept = self._roles.channels or any(self._series_of.values())
        if not self._moves and not kept:
            names = ", ".join(map(repr, frames[0].point_names))
            raise NotATrajectory(
                f"no point moves in {len(frames)} frames; fields of the points: {names or 'none'}",
                expected="points that move, or a displacement",
                fix="name the field with the option displacement; for fields on a body at rest, "
                "name them with the option channels",
                file=self._path,
                key="displacement",
            )

    def _declare(self, writer: TrajectoryWriter, *, clock: Clock, unit: str) -> None:
        roles = self._roles
        writer.declare_time(
            unit=clock.unit, kind="pseudo" if clock.kind == "pseudo" else "physical"
        )
        writer.declare_nodes(
            len(self._rest),
            self._dims,
            unit=unit,
            velocities=roles.velocity is not None,
            velocity_unit=roles.velocity_unit,
            observed=self._missing,
            rest=None
            if roles.displacement is None
            else _padded(self._rest, self._wide)[:, : self._dims],
            ids=None if self._identity.ids is None else self._identity.ids.tolist(),
        )
        first = self._series.frames[0]
        for kind, elements in self.elements.items():
            if not len(elements.nodes):
                continue
            fields = self._series_of[kind]
            shapes = {f.stored: self._cell_row(first, kind, f, {}, 0).shape for f in fields}
            writer.declare_elements(
                kind,
                elements.nodes,
                series={f.stored: f.unit for f in fields},
                widths={name: shape[1] for name, shape in shapes.items() if len(shape) > 1},
            )
        for kept in roles.channels:
            values = first.point_field(kept.name)
            width = 1 if values.ndim == 1 else values.shape[1]
            columns = [f"n{n}" if width == 1 else f"n{n}.{c}"
                       for n in range(len(values)) for c in range(width)]  # fmt: skip
            writer.declare_channel(kept.stored, columns, unit=kept.unit)

    def _row(self, frame: Frame, index: int, clock: Clock) -> dict[str, Any]:
        nodes, cells = self._identity.order(frame, index)
        points = self._points(frame, index)
        self._refuse_both(points, index, nodes)
        places = self._displaced(points, frame, index)
        row: dict[str, Any] = {"time": clock.at(index, frame)}
        row["positions"] = self._flat(places, index, nodes, "the places")
        speeds = self._speeds(frame, index)
        if speeds is not None:
            row["velocities"] = self._flat(speeds, index, nodes, "the velocities")
        if self._missing:
            row["observed"] = self._mask(frame, index, row["positions"], nodes)
        elif np.isnan(row["positions"]).any():
            node = int(np.flatnonzero(np.isnan(row["positions"]).any(axis=1))[0])
            raise UnreadableFile(
                f"node {node} of frame {index} is nowhere (NaN)",
                expected="a place for every node",
                fix="pass missing=true if nodes were not seen there; a run that diverged is no "
                "measurement",
                file=self._path,
            )
        row["elements"] = {
            (kind, kept.stored): self._cell_row(frame, kind, kept, cells, index)
            for kind, fields in self._series_of.items()
            for kept in fields
        }
        row["channels"] = {}
        for kept in self._roles.channels:
            values = self._field(frame, kept.name, index, key="channels")
            row["channels"][kept.stored] = (values if nodes is None else values[nodes]).reshape(-1)
        return row

    def _refuse_both(self, points: Floats, index: int, nodes: Any) -> None:
        name = self._roles.displacement
        if name is None or points is self._rest:
            return
        if not np.array_equal(points if nodes is None else points[nodes], self._rest):
            raise ConfigError(
                f"the points of frame {index} have moved, and there is a displacement {name!r} too",
                expected="points that move, or a displacement of points that do not",
                fix="pass displacement=none if the points are the places; otherwise export the "
                "series without warping it",
                file=self._path,
                key="displacement",
            )

    def _flat(self, values: Floats, index: int, nodes: Any, what: str) -> Floats:
        values = values if nodes is None else values[nodes]
        if values.shape[1] == self._dims:
            return values
        off = values[:, 2]
        level = off[np.isfinite(off)][:1]
        if what == "the places" and index == 0:
            self._level = level
        wanted = self._level if what == "the places" else np.zeros(1)
        if level.size and wanted.size and np.nanmax(np.abs(off - wanted)) != 0.0:
            raise ConfigError(
                f"dims is 2, and {what} of frame {index} leave the plane",
                expected="one z for all nodes and frames",
                fix="pass dims=3",
                file=self._path,
                key="dims",
            )
        return values[:, : self._dims]

    def _mask(self, frame: Frame, index: int, places: Floats, nodes: Any) -> Array:
        if not self._roles.observed:
            gone = np.isnan(places).any(axis=1)
            places[gone] = np.nan
            return np.where(gone, 0, 1).astype(np.uint8)
        marks = self._field(frame, "observed", index, key="missing")
        return marks if nodes is None else marks[nodes]

    def _cell_row(
        self, frame: Frame, kind: str, kept: Kept, order: Mapping[str, Any], index: int
    ) -> Array:
        if kept.name not in frame.cell_names:
            raise UnreadableFile(
                f"frame {index} has no cell field {kept.name!r}",
                expected="the fields of the first frame in every frame",
                fix="leave it out of the option channels, or export the series again",
                file=self._path,
                key="channels",
            )
        values = cell_values(frame, kept.name)
        values = {s: a for s, a in values.items() if s in dict(self.elements[kind].cells)}
        for array in values.values():
            check_values(array, kept.name, index, self._path)
        if len({array.shape[1:] for array in values.values()}) > 1:
            raise UnreadableFile(
                f"the cell field {kept.name!r} of frame {index} is not equally wide for all {kind}",
                expected="as many numbers for every cell",
                fix="leave it out of the option channels",
                file=self._path,
                key="channels",
            )
        values = {s: (a[order[s]] if s in order else a) for s, a in values.items()}
        return self.elements[kind].values(values)


def _padded(values: Array, width: int) -> Floats:
    """Return rows of `width` numbers: a plane lies at z = 0."""
    if values.shape[1] >= width:
        return values[:, :width].astype(np.float64, copy=False)
    out = np.zeros((len(values), width))
    out[:, : values.shape[1]] = values
    return out


def _stacked(rows: list[dict[str, Any]]) -> dict[str, Any]:
    def joined(key: str) -> Any:
        if isinstance(rows[0][key], dict):
            return {name: np.stack([row[key][name] for row in rows]) for name in rows[0][key]}
        return np.stack([row[key] for row in rows])

    return {key: joined(key) for key in rows[0]}


__all__ = ["Motion"]
