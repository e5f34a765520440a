"""From experiments to the tables of compiled code: one scene, or scenes side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.demlat.compiled.packing import Blocks, ensemble_blocks, run_blocks, spread_blocks
from openprc.demlat.models.barhinge.tables import (
    LEDGER,
    LEDGER_STRIDE,
    Body,
    Cables,
    CubicBars,
    Drives,
    Lanes,
    LinearBars,
    LinearHinges,
    OgdenBars,
    PrintedDampers,
    State,
    Struts,
    WalledHinges,
)
from openprc.demlat.scaling import SimulationScaler
from openprc.demlat.signal_table import columns_of, signal_table

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.experiment import Experiment

    Reals = NDArray[np.float64]

BAR_GROUPS = {
    "linear": LinearBars,
    "cubic": CubicBars,
    "cable": Cables,
    "strut": Struts,
    "ogden": OgdenBars,
}
#: Lanes of a vector register (and what two narrower ones hold).
WIDTH = {"float64": 8, "float32": 16}
#: Below this many elements a scene is stepped element by element: vectors would hardly be
#: faster, and all small scenes share one compiled loop.
LEAST_ELEMENTS = 64


@dataclass(frozen=True)
class Packing:
    """How coordinates and parameters of S scenes stand in memory.

    Attributes
    ----------
    lanes : template
    scenes : int
        1, or the number of lanes.
    n_nodes, dims, stride : int
    """

    lanes: Lanes
    scenes: int
    n_nodes: int
    dims: int
    stride: int

    @classmethod
    def plan(
        cls, *, n_nodes: int, dims: int, vectors: bool, scenes: int, precision: str
    ) -> Packing:
        """Return the packing of `scenes` scenes with `n_nodes` nodes."""
        width = WIDTH[precision] if vectors else 1
        number = np.float32 if precision == "float32" else float
        used = n_nodes * width if scenes > 1 else n_nodes + width - 1
        stride = -(-used // width) * width
        if (stride * (4 if precision == "float32" else 8)) % 4096 == 0:
            stride += width  # or x, y and z would compete for the same lines of the cache
        return cls((number(0.0),) * width, scenes, n_nodes, dims, stride)

    @property
    def dtype(self) -> type:
        """Type of the coordinates."""
        return np.float32 if isinstance(self.lanes[0], np.float32) else np.float64

    def coordinates(self, values: Reals) -> Reals:
        """Return values (S, N, 3) as flat coordinates: (dims * stride,)."""
        flat = np.zeros((self.dims, self.stride), dtype=self.dtype)
        by_axis = values.transpose(2, 1, 0)[: self.dims]
        flat[:, : self.n_nodes * self.scenes] = by_axis.reshape(self.dims, -1)
        return flat.reshape(-1)

    def nodes(self, flat: Reals) -> Reals:
        """Return flat coordinates as (S, N, dims)."""
        used = flat.reshape(self.dims, self.stride)[:, : self.n_nodes * self.scenes]
        return used.reshape(self.dims, self.n_nodes, self.scenes).transpose(2, 1, 0)

    def at(self, node: int, axis: int, scene: int) -> int:
        """Return where a coordinate stands."""
        return axis * self.stride + node * self.scenes + scene

    def blocks(self, indices: NDArray[np.int32], chosen: NDArray[np.int64]) -> Iterator[Blocks]:
        """Yield blocks that cover the chosen elements."""
        width = len(self.lanes)
        if self.scenes > 1:
            yield ensemble_blocks(indices, chosen, width)
        elif width == 1:
            yield spread_blocks(indices, chosen, 1)
        else:
            blocks, rest = run_blocks(indices, chosen, width)
            if len(blocks.element):
                yield blocks
            if len(rest):
                yield spread_blocks(indices, rest, width)

    def parameters(self, blocks: Blocks, values: Reals, fill: float = 0.0) -> Reals:
        """Return values (S, E) in the order of the lanes."""
        if self.scenes > 1:
            chosen = blocks.element.reshape(-1, self.scenes)[:, 0]
            return np.ascontiguousarray(values[:, chosen].T, dtype=self.dtype).reshape(-1)
        return blocks.spread_out(values[0], fill).astype(self.dtype)


@dataclass(frozen=True)
class Assembly:
    """Scenes, ready to be stepped.

    Attributes
    ----------
    body : Body
    state : State
        At t = 0, before driven coordinates have been placed.
    packing : Packing
    scaler : SimulationScaler
    reference : (S, N, 3) [m]
        Added to saved positions; 0 unless in displacement form.
    reference_work : float [J]
        What gravity does on the way from the origin to `reference`, in the first scene.
    """

    body: Body
    state: State
    packing: Packing
    scaler: SimulationScaler
    reference: Reals
    reference_work: float


def assemble(
    experiments: Sequence[Experiment],
    *,
    vectors: bool | None = None,
    displaced: bool | None = None,
) -> Assembly:
    """Turn experiments of one topology into tables.

    Parameters
    ----------
    experiments : sequence of Experiment
        One, or as many as there are lanes.
    vectors : bool, optional
        Step many elements at once; by default when there are enough of them.
    displaced : bool, optional
        Store displacements from the start instead of positions; by default in float32, which
        would lose them in the coordinates.
    """
    first = experiments[0]
    geometry = first.geometry
    n_elements = len(geometry.bars) + len(geometry.hinges)
    single = first.precision == "float32"
    if vectors is None:
        vectors = n_elements >= LEAST_ELEMENTS or len(experiments) > 1 or single
    packing = Packing.plan(
        n_nodes=geometry.n_nodes,
        dims=2 if vectors and all(e.planar for e in experiments) else 3,
        vectors=vectors,
        scenes=len(experiments),
        precision=first.precision,
    )
    return _Assembler(experiments, packing, single if displaced is None else displaced).result()


class _Assembler:
    def __init__(
        self, experiments: Sequence[Experiment], packing: Packing, displaced: bool
    ) -> None:
        self.experiments = experiments
        self.first = experiments[0]
        self.packing = packing
        self.scaler = SimulationScaler.for_experiment(self.first)
        self.positions = np.array([e.geometry.positions for e in experiments])
        self.reference = self.positions if displaced else np.zeros_like(self.positions)
        self.displaced = displaced
        # All small scenes share one compiled loop, so nothing is left out of them.
        self.lean = len(packing.lanes) > 1
        self.held = np.array([e.held_axes for e in experiments])

    def column(self, kind: str, name: str, unit: float = 1.0) -> Reals:
        """Return a parameter of bars or hinges of every scene, scaled: (S, E)."""
        return np.array([getattr(getattr(e.geometry, kind), name) for e in self.experiments]) / unit

    def result(self) -> Assembly:
        scale, packing = self.scaler, self.packing
        geometries = [e.geometry for e in self.experiments]
        masses = np.array([g.masses for g in geometries]) / scale.mass
        drag = np.array([e.drag for e in self.experiments]) / scale.damping
        gravity = np.array([e.gravity for e in self.experiments]) * scale.time**2 / scale.length
        weight = masses[:, :, np.newaxis] * gravity[:, np.newaxis, :]
        ones = np.ones((1, 1, 3))
        with np.errstate(divide="ignore"):
            inverse = np.where(self.held, 0.0, 1.0 / (masses[:, :, np.newaxis] * ones))
        free_drag = np.where(self.held, 0.0, drag[:, :, np.newaxis] * ones)
        free_weight = np.where(self.held, 0.0, weight)
        n_bars, n_hinges = len(geometries[0].bars), len(geometries[0].hinges)
        reals = packing.coordinates
        body = Body(
            lanes=packing.lanes,
            space=(0,) * packing.dims,
            stride=packing.stride,
            inverse_mass=reals(inverse),
            drag=None if self.lean and not free_drag.any() else reals(free_drag),
            weight=None if self.lean and not free_weight.any() else reals(free_weight),
            bars=tuple(self._bars()),
            hinges=tuple(self._hinges()),
            drives=self._drives(masses, drag, weight),
            contacts=(),
            constraints=None,
            mass=reals(masses[:, :, np.newaxis] * ones),
            full_weight=reals(weight),
            scratch=(
                *(np.zeros(n_bars), np.zeros(n_bars), np.zeros(n_hinges), np.zeros(n_hinges)),
                geometries[0].hinges.rest_angle.copy(),
            ),
        )
        velocities = np.array([g.velocities for g in geometries]) / scale.velocity
        state = State(
            x=reals((self.positions - self.reference) / scale.length),
            v=reals(velocities),
            ledger=np.zeros(len(LEDGER) * LEDGER_STRIDE, packing.dtype),
        )
        falling = float((weight[0] * self.reference[0]).sum()) / scale.length * scale.moment
        return Assembly(body, state, packing, scale, self.reference, falling)

    # --- elements ---------------------------------------------------------------------------

    def _bars(self) -> Iterator[Any]:
        bars, scale = self.first.geometry.bars, self.scaler
        columns = {
            "stiffness": self.column("bars", "stiffness", scale.stiffness),
            "relaxed": self.column("bars", "relaxed_length", scale.length),
            "damping": self.column("bars", "damping", scale.damping),
        }
        printed = self.first.bar_damping == "printed"
        if printed:
            ratios = self.column("bars", "damping")
            columns["damping"] = np.zeros_like(ratios)
        soft = ~bars.rigid
        for law, group in BAR_GROUPS.items():
            chosen = np.flatnonzero(soft & (bars.law == law))
            if not len(chosen) and not (law == "linear" and not self.lean):
                continue
            more: dict[str, Reals] = {}
            if law == "cubic":
                area = scale.length**2
                more["stiffness_cubic"] = self.column(
                    "bars", "stiffness_cubic", scale.stiffness / area
                )
                more["damping_cubic"] = self.column(
                    "bars", "damping_cubic", scale.damping * scale.time**2 / area
                )
            for blocks in self._blocks(bars.indices, chosen):
                yield self._group(group, blocks, columns | more, ("i", "j"))
        if printed:
            yield from self._printed_dampers(ratios, columns["stiffness"], soft)

    def _printed_dampers(
        self, ratios: Reals, stiffness: Reals, soft: NDArray[np.bool_]
    ) -> Iterator[PrintedDampers]:
        bars, scale = self.first.geometry.bars, self.scaler
        masses = np.array([e.geometry.masses for e in self.experiments]) / scale.mass
        drags = [
            2.0 * ratios * np.sqrt(masses[:, bars.indices[:, end]] * stiffness) for end in (0, 1)
        ]
        for blocks in self._blocks(bars.indices, np.flatnonzero(soft)):
            yield PrintedDampers(
                self.packing.lanes,
                blocks.element,
                blocks.column(0),
                blocks.column(1),
                *(self.packing.parameters(blocks, drag) for drag in drags),
            )

    def _hinges(self) -> Iterator[Any]:
        hinges, scale = self.first.geometry.hinges, self.scaler
        rest = self.column("hinges", "rest_angle") - np.pi
        columns = {
            "stiffness": self.column("hinges", "stiffness", scale.moment),
            "sine": np.sin(rest),
            "cosine": np.cos(rest),
            "damping": self.column("hinges", "damping", scale.moment * scale.time),
        }
        low, high = self.column("hinges", "limit_low"), self.column("hinges", "limit_high")
        walls = {
            "low": low - np.pi - rest,
            "high": high - np.pi - rest,
            "low_room": low,
            "high_room": 2.0 * np.pi - high,
        }
        for law, group in (("linear", LinearHinges), ("enhanced-linear", WalledHinges)):
            chosen = np.flatnonzero(~hinges.rigid & (hinges.law == law))
            if not len(chosen) and not (law == "linear" and not self.lean):
                continue
            more = walls if law == "enhanced-linear" else {}
            for blocks in self._blocks(hinges.indices, chosen):
                yield self._group(group, blocks, columns | more, ("j", "k", "i", "l"))

    def _blocks(self, indices: NDArray[np.int32], chosen: NDArray[np.int64]) -> Iterator[Blocks]:
        if len(chosen):
            yield from self.packing.blocks(indices, chosen)
        else:
            empty = np.zeros((0, indices.shape[1]), np.int32)
            yield Blocks(np.zeros(0, np.int32), empty, 1)

    def _group(
        self, group: Any, blocks: Blocks, columns: dict[str, Reals], nodes: tuple[str, ...]
    ) -> Any:
        # Filling lanes need a rest angle, a length and room that divide nothing by zero.
        fills = {"cosine": 1.0, "relaxed": 1.0, "low_room": 1.0, "high_room": 1.0}
        packed = {
            name: self.packing.parameters(blocks, values, fills.get(name, 0.0))
            for name, values in columns.items()
        }
        if self.lean and not packed["damping"].any():
            packed["damping"] = None  # type: ignore[assignment]
        places = {name: blocks.column(number) for number, name in enumerate(nodes)}
        return group(
            lanes=self.packing.lanes,
            element=blocks.element,
            offset=self._offset(blocks, columns) if self.displaced else None,
            **places,
            **packed,
        )

    def _offset(self, blocks: Blocks, columns: dict[str, Reals]) -> tuple[Reals, ...]:
        geometry, unit = self.first.geometry, self.scaler.length
        if "relaxed" in columns:
            ends = self.reference[:, geometry.bars.indices] / unit
            along = ends[:, :, 1] - ends[:, :, 0]
            squares = np.einsum("sea,sea->se", along, along) - columns["relaxed"] ** 2
            values = [*along.transpose(2, 0, 1), squares]
            fills = [1.0, 0.0, 0.0, 0.0]
        else:
            corners = self.reference[:, geometry.hinges.indices] / unit
            j, k, i, l = (corners[:, :, c] for c in range(4))  # noqa: E741
            values = [v for edge in (i - j, k - j, k - l) for v in edge.transpose(2, 0, 1)]
            fills = [0.0] * 9
        return tuple(
            self.packing.parameters(blocks, value, fill)
            for value, fill in zip(values, fills, strict=True)
        )

    # --- drives -----------------------------------------------------------------------------

    def _drives(self, masses: Reals, drag: Reals, weight: Reals) -> Drives | None:
        scale, columns = self.scaler, []
        known: dict[tuple[int, str, str], int] = {}
        motion: list[tuple[Any, ...]] = []
        force: list[tuple[Any, ...]] = []
        for scene, experiment in enumerate(self.experiments):
            for actuator in experiment.actuators:
                signal = experiment.signals[actuator.signal]
                key = (scene, actuator.signal, actuator.type)
                unit = scale.force if actuator.type == "force" else scale.length
                if key not in known:
                    known[key] = len(columns)
                    for column in columns_of(signal, integrated=actuator.type == "velocity"):
                        columns.append(
                            column._replace(
                                dt=column.dt / scale.time,
                                coefficients=column.coefficients / unit,
                            )
                        )
                for axis in np.flatnonzero(actuator.axes):
                    if axis >= self.packing.dims:
                        continue  # a planar scene: the signal is 0 along z
                    at = self.packing.at(actuator.node, axis, scene)
                    index = known[key] + (axis if signal.values.shape[1] == 3 else 0)
                    if actuator.type == "force":
                        force.append((at, index, scene))
                        continue
                    start = -self.reference[scene, actuator.node, axis]
                    if actuator.type == "velocity":
                        start += experiment.geometry.positions[actuator.node, axis]
                    node = scene, actuator.node
                    motion.append(
                        (
                            at,
                            index,
                            start / scale.length,
                            masses[node],
                            drag[node],
                            weight[(*node, axis)],
                            scene,
                        )
                    )
        if self.lean and not columns:
            return None
        m = list(zip(*motion, strict=True)) or [()] * 7
        f = list(zip(*force, strict=True)) or [()] * 3
        integers = (0, 1, 6)
        return Drives(
            signal_table(columns),
            *(np.array(c, dtype="i8" if n in integers else "f8") for n, c in enumerate(m)),
            *(np.array(c, dtype="i8") for c in f),
        )
