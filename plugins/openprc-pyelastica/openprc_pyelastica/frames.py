"""Blocks of recorded states to frames of a trajectory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError
from openprc_pyelastica.extras import DISTRIBUTION, EXTENSION_VERSION
from openprc_pyelastica.joints import Joint
from openprc_pyelastica.plane import AXES, FLATNESS
from openprc_pyelastica.recorded_signals import Signal
from openprc_pyelastica.recorded_systems import Body
from openprc_pyelastica.track import Track

if TYPE_CHECKING:
    from openprc.schema import TrajectoryWriter

#: Element kinds of what a rod has besides lengths, and what is kept of each.
SEGMENTS, CORNERS, ORIENTED = "segments", "corners", "rigid-bodies"
HALF_STEP_NOTE = (
    "segments/sigma and corners/kappa belong to half a simulation step before the time of their "
    "frame, as PyElastica leaves them; positions, velocities, directors and the bars' lengths "
    "belong to the time itself"
)


class Frames:
    """Says what is recorded and hands blocks to the writer.

    Parameters
    ----------
    writer : TrajectoryWriter
    bodies : sequence of Body
    joints : sequence of Joint
        Recorded as bars of rest length 0 behind those of the rods.
    signals : sequence of Signal
    every : int
        Simulation steps from one frame to the next.
    plane : {"xy", "xz", "yz"}, optional
        Two coordinates to keep of a run along whose third one nothing moves.
    """

    def __init__(
        self,
        writer: TrajectoryWriter,
        bodies: Sequence[Body],
        joints: Sequence[Joint],
        *,
        signals: Sequence[Signal],
        every: int,
        plane: str | None = None,
    ) -> None:
        self.written = 0
        self._writer = writer
        self._bodies = bodies
        self._joints = joints
        self._signals = signals
        self._every = every
        self._plane = plane
        kept = [AXES.index(axis) for axis in plane or AXES]
        self._lost = sorted(set(range(3)) - set(kept))
        # A slice looks at the same memory, a list of numbers would copy it.
        self._axes = slice(kept[0], None, kept[1] - kept[0]) if plane != "xy" else slice(2)
        self._n_nodes = sum(body.n_nodes for body in bodies)
        rods = [body.bars + body.first for body in bodies]
        ends = np.array([joint.nodes for joint in joints], dtype=np.int64).reshape(-1, 2)
        self._bars = np.concatenate([*rods, ends])
        self._rest = np.concatenate(
            [
                *(np.asarray(body.system.rest_lengths) for body in bodies if body.is_rod),
                np.zeros(len(joints)),
            ]
        )
        self._kept: dict[tuple[str, str], str] = {}

    def append(
        self,
        tracks: Sequence[Track],
        rows: int,
        *,
        lengths: Mapping[str, NDArray[np.float64]],
        drives: Mapping[str, NDArray[np.float64]],
    ) -> None:
        """Append the first `rows` frames of all tracks, whose rods have these `lengths`."""
        if not self.written:
            self._declare(tracks)
        positions = self._joined(tracks, "position_collection", rows)
        elements: dict[tuple[str, str], NDArray[np.float64]] = {}
        if len(self._bars):
            parts = [lengths[track.body.name][:rows] for track in tracks if track.body.is_rod]
            if self._joints:
                parts.append(_gaps(positions, self._bars[-len(self._joints) :]))
            length = np.concatenate(parts, axis=1) if len(parts) > 1 else parts[0]
            elements["bars", "length"] = length
            if not self._joints:
                elements["bars", "strain"] = length / self._rest - 1.0
        for (kind, quantity), attribute in self._kept.items():
            parts = [
                _flat(track.blocks[attribute][:rows])
                for track in tracks
                if attribute in track.blocks and track.body.is_rod == (kind != ORIENTED)
            ]
            elements[kind, quantity] = np.concatenate(parts, axis=1)
        self._writer.append(
            tracks[0].times[:rows],
            positions=self._projected(positions),
            velocities=self._joined(tracks, "velocity_collection", rows)[..., self._axes],
            elements=elements,
            inputs=drives,
        )
        self.written += rows

    def _joined(self, tracks: Sequence[Track], name: str, rows: int) -> NDArray[np.float64]:
        joined = np.empty((rows, self._n_nodes, 3))
        for track in tracks:
            nodes = slice(track.body.first, track.body.first + track.body.n_nodes)
            joined[:, nodes] = track.blocks[name][:rows].transpose(0, 2, 1)
        return joined

    def _projected(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the coordinates that are kept.

        Raises
        ------
        ConfigError
            When something moves, or lies, along the one that is not.
        """
        for axis in self._lost:
            width = float(np.ptp(positions[..., axis]))
            if width > FLATNESS * float(np.ptp(positions, axis=(0, 1)).max()):
                raise ConfigError(
                    f"the run is not in the plane {self._plane}: positions spread over "
                    f"{width:.3g} m along {AXES[axis]}",
                    expected=f"one value of {AXES[axis]} for all nodes at all times",
                    fix="leave plane out",
                    key="plane",
                )
        return positions[..., self._axes]

    def _declare(self, tracks: Sequence[Track]) -> None:
        writer = self._writer
        writer.declare_nodes(
            self._n_nodes,
            len(self._plane or AXES),
            unit="m",
            axes=",".join(self._plane or AXES),
            velocities=True,
            mass=self._masses(),
            labels=[label for body in self._bodies for label in body.labels],
        )
        if len(self._bars):
            static: dict[str, tuple[Any, str | None]] = {"rest_length": (self._rest, "m")}
            series = {"length": "m", "strain": "1"}
            if self._joints:
                del series["strain"]
                rods = len(self._bars) - len(self._joints)
                kinds = ["element"] * rods + [joint.kind for joint in self._joints]
                static["kind"] = (kinds, None)
                writer.note(
                    f"{len(self._joints)} joint(s) are bars of rest length 0; no strain is stored "
                    "because theirs is not defined"
                )
            writer.declare_elements("bars", self._bars, series=series, static=static)
        self._declare_kept(tracks)
        for signal in self._signals:
            writer.declare_input(signal.name, signal.columns, **signal.declaration)
        self._declare_constants()
        writer.note(f"a frame is {self._every} simulation step(s) of PyElastica")

    def _declare_kept(self, tracks: Sequence[Track]) -> None:
        blocks = {name for track in tracks for name in track.blocks if track.body.is_rod}
        series: dict[str, dict[str, int]] = {}
        for kind, quantity, attribute, width in (
            (SEGMENTS, "directors", "director_collection", 9),
            (SEGMENTS, "sigma", "sigma", 3),
            (CORNERS, "kappa", "kappa", 3),
        ):
            if attribute in blocks:
                series.setdefault(kind, {})[quantity] = width
                self._kept[kind, quantity] = attribute
        rods = [body for body in self._bodies if body.is_rod]
        tables = {
            SEGMENTS: [body.bars + body.first for body in rods],
            CORNERS: [body.corners + body.first for body in rods],
        }
        for kind, widths in series.items():
            units = {name: "1/m" if name == "kappa" else "1" for name in widths}
            self._writer.declare_elements(
                kind, np.concatenate(tables[kind]), series=units, widths=widths
            )
        turned = [
            track.body.first
            for track in tracks
            if not track.body.is_rod and "director_collection" in track.blocks
        ]
        if turned:
            self._kept[ORIENTED, "directors"] = "director_collection"
            self._writer.declare_elements(
                ORIENTED,
                np.array(turned)[:, np.newaxis],
                series={"directors": "1"},
                widths={"directors": 9},
            )
        if "sigma" in blocks:
            self._writer.note(HALF_STEP_NOTE)

    def _declare_constants(self) -> None:
        radii = {
            body.name: np.array(radius, dtype=np.float64)
            for body in self._bodies
            if np.ndim(radius := getattr(body.system, "radius", None)) <= 1 and radius is not None
        }
        if not radii:
            return
        self._writer.declare_extension(DISTRIBUTION, EXTENSION_VERSION)
        for name, radius in radii.items():
            self._writer.put_extension(
                DISTRIBUTION, f"{name}.radius", radius, unit="m", comment="at t = 0"
            )

    def _masses(self) -> NDArray[np.float64] | None:
        parts = []
        for body in self._bodies:
            mass = np.atleast_1d(np.asarray(getattr(body.system, "mass", ()), dtype=np.float64))
            if mass.shape != (body.n_nodes,):
                self._writer.note(f"{body.name} does not tell the masses of its nodes")
                return None
            parts.append(mass)
        return np.concatenate(parts)


def _gaps(positions: NDArray[np.float64], bars: NDArray[np.int64]) -> NDArray[np.float64]:
    arms = positions[:, bars[:, 1]] - positions[:, bars[:, 0]]
    gaps: NDArray[np.float64] = np.sqrt(np.einsum("tbx,tbx->tb", arms, arms))
    return gaps


def _flat(block: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (T, 3, n) as (T, n, 3), and directors (T, 3, 3, n) as (T, n, 9), row by row."""
    last = np.moveaxis(block, -1, 1)
    return last.reshape(*last.shape[:2], -1)
