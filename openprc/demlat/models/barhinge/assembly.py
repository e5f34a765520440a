"""From experiments to the tables of compiled code: one scene, or scenes side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.demlat.compiled.packing import Blocks
from openprc.demlat.compiled.scene_packing import Packing
from openprc.demlat.contact.findings import can_touch
from openprc.demlat.contact.table import ContactTable, contact_tables
from openprc.demlat.integrators import INTEGRATORS
from openprc.demlat.models.barhinge.drive_table import drive_table
from openprc.demlat.models.barhinge.idle_elements import idle_elements, preset
from openprc.demlat.models.barhinge.rigid_assembly import (
    RigidScene,
    knows_constraints,
    mark_undetermined,
    rigid_elements,
    rigid_scene,
)
from openprc.demlat.models.barhinge.tables import (
    Body,
    Cables,
    CubicBars,
    LinearBars,
    LinearBends,
    LinearHinges,
    OgdenBars,
    PrintedDampers,
    State,
    Struts,
    WalledHinges,
    ledger_size,
)
from openprc.demlat.scaling import SimulationScaler
from openprc.errors import UnsupportedScene

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.demlat.models.barhinge.rigid_elements import RigidElements
    from openprc.schema.experiment import Experiment

    Reals = NDArray[np.float64]

BAR_GROUPS = {
    "linear": LinearBars,
    "cubic": CubicBars,
    "cable": Cables,
    "strut": Struts,
    "ogden": OgdenBars,
}
#: Below this many elements a scene is stepped element by element: vectors would hardly be
#: faster, and all small scenes share one compiled loop.
LEAST_ELEMENTS = 64


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
    idle_energy : bars, hinges, bends [J]
        Of elements between fixed nodes, which are not stepped.
    rigid : RigidScene, optional
        Where the integrator keeps constraints.
    """

    body: Body
    state: State
    packing: Packing
    scaler: SimulationScaler
    reference: Reals
    reference_work: float
    rigid: RigidScene | None = None
    idle_energy: tuple[float, float, float] = (0.0, 0.0, 0.0)


def assemble(
    experiments: Sequence[Experiment],
    *,
    vectors: bool | None = None,
    displaced: bool | None = None,
    dims: int | None = None,
    ledger: bool = True,
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
    dims : {2, 3}, optional
        By default 2 for planar scenes that are stepped as vectors.
    ledger : bool
        Whether energies are kept.
    """
    first = experiments[0]
    geometry = first.geometry
    n_elements = int((~geometry.bars.rigid).sum() + (~geometry.hinges.rigid).sum())
    n_elements += len(geometry.bends)
    if knows_constraints(first) or can_touch(first):
        dims = 3
    single = first.precision == "float32"
    scheme = INTEGRATORS.get(first.integrator)
    one_by_one = scheme is not None and not scheme.vectors
    if len(experiments) > 1 and (one_by_one or knows_constraints(first)):
        raise UnsupportedScene(
            f"{len(experiments)} scenes side by side with the integrator {first.integrator!r}",
            expected="one scene, or an integrator that steps vectors",
            fix="run the scenes one by one, or use rk4 or verlet",
            key="simulation.integrator",
        )
    if one_by_one:
        vectors = False
    if vectors is None:
        vectors = n_elements >= LEAST_ELEMENTS or len(experiments) > 1 or single
    packing = Packing.plan(
        n_nodes=geometry.n_nodes,
        dims=dims or (2 if vectors and all(e.planar for e in experiments) else 3),
        vectors=vectors,
        scenes=len(experiments),
        precision=first.precision,
    )
    assembler = _Assembler(experiments, packing, single if displaced is None else displaced)
    return assembler.result(ledger=ledger)


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
        self.idle = idle_elements(experiments, wanted=self.lean)
        self.rigid = None
        if knows_constraints(self.first):
            self.rigid = rigid_scene(self.first)
            self.positions = self.rigid.positions[np.newaxis]

    def column(self, kind: str, name: str, unit: float = 1.0) -> Reals:
        """Return a parameter of bars, hinges or bends of every scene, scaled: (S, E)."""
        return np.array([getattr(getattr(e.geometry, kind), name) for e in self.experiments]) / unit

    def result(self, *, ledger: bool) -> Assembly:
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
        n_bars, n_hinges, n_bends = (
            len(elements)
            for elements in (geometries[0].bars, geometries[0].hinges, geometries[0].bends)
        )
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
            bends=tuple(self._bends()),
            drives=drive_table(
                self.experiments,
                packing,
                scale,
                nodal=(masses, drag, weight),
                origin=self.reference,
                optional=self.lean,
            ),
            contacts=self._contacts(reals(inverse)),
            constraints=self._constraints(),
            mass=reals(masses[:, :, np.newaxis] * ones),
            full_weight=reals(weight),
            scratch=(
                *(np.zeros(n_bars), np.zeros(n_bars), np.zeros(n_hinges), np.zeros(n_hinges)),
                geometries[0].hinges.rest_angle.copy(),
                *(np.zeros(n_bends), np.zeros(n_bends)),
            ),
        )
        idle_energy = preset(body.scratch, geometries[0], self.idle, scale)
        if self.rigid is not None:
            mark_undetermined(body.scratch, self.first.geometry, self.rigid)
        velocities = np.array([g.velocities for g in geometries]) / scale.velocity
        state = State(
            x=reals((self.positions - self.reference) / scale.length),
            v=reals(velocities),
            ledger=np.zeros(ledger_size(with_bends=n_bends > 0), packing.dtype) if ledger else None,
        )
        falling = float((weight[0] * self.reference[0]).sum()) / scale.length * scale.moment
        return Assembly(
            body, state, packing, scale, self.reference, falling, self.rigid, idle_energy
        )

    def _constraints(self) -> RigidElements | None:
        if self.rigid is None:
            return None
        stride, scale = self.packing.stride, self.scaler
        return rigid_elements(self.first, self.rigid, stride=stride, scaler=scale)

    def _contacts(self, inverse_mass: Reals) -> tuple[ContactTable, ...]:
        if len(self.experiments) > 1:
            return ()  # ensembles refuse contact
        return contact_tables(
            self.first,
            inverse_mass=inverse_mass,
            stride=self.packing.stride,
            unit=self.scaler.length,
        )

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
        soft = ~bars.rigid & ~self.idle.bars
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
        for law, group in (("linear", LinearHinges), ("enhanced-linear", WalledHinges)):
            chosen = np.flatnonzero(~hinges.rigid & ~self.idle.hinges & (hinges.law == law))
            if not len(chosen) and not (law == "linear" and not self.lean):
                continue
            more = self._walls(rest) if law == "enhanced-linear" else {}
            for blocks in self._blocks(hinges.indices, chosen):
                yield self._group(group, blocks, columns | more, ("j", "k", "i", "l"))

    def _walls(self, rest: Reals) -> dict[str, Reals]:
        low, high = self.column("hinges", "limit_low"), self.column("hinges", "limit_high")
        return {
            "sine": np.zeros_like(rest),
            "cosine": np.ones_like(rest),
            "rest_bend": rest,
            "low": low - np.pi - rest,
            "high": high - np.pi - rest,
            "low_room": low,
            "high_room": 2.0 * np.pi - high,
        }

    def _bends(self) -> Iterator[LinearBends]:
        bends, scale = self.first.geometry.bends, self.scaler
        columns = {
            "stiffness": self.column("bends", "stiffness", scale.moment),
            "rest_turn": np.pi - self.column("bends", "rest_angle"),
            "damping": self.column("bends", "damping", scale.moment * scale.time),
        }
        # Scenes without bends have other code; in the others the ledger has a row for them.
        if len(bends):
            for blocks in self._blocks(bends.indices, np.flatnonzero(~self.idle.bends)):
                yield self._group(LinearBends, blocks, columns, ("i", "j", "k"))

    def _blocks(self, indices: NDArray[np.int32], chosen: NDArray[np.int64]) -> Iterator[Blocks]:
        if len(chosen):
            yield from self.packing.blocks(indices, chosen)
        else:
            empty = np.zeros((0, indices.shape[1]), np.int32)
            yield Blocks(np.zeros(0, np.int32), empty, 1)

    def _group(
        self, group: Any, blocks: Blocks, columns: dict[str, Reals], nodes: tuple[str, ...]
    ) -> Any:
        # Filling lanes need a rest angle, a length and room that divide nothing by zero, and
        # limits that no angle reaches: the energy of a wall is the logarithm of a cosine.
        fills = {"cosine": 1.0, "relaxed": 1.0, "low_room": 1.0, "high_room": 1.0}
        fills |= {"low": -2.0 * np.pi, "high": 2.0 * np.pi}
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
        elif "rest_turn" in columns:
            corners = self.reference[:, geometry.bends.indices] / unit
            first, last = (corners[:, :, c] - corners[:, :, 1] for c in (0, 2))
            values = [v for edge in (first, first + last) for v in edge.transpose(2, 0, 1)]
            fills = [0.0] * 6
        else:
            corners = self.reference[:, geometry.hinges.indices] / unit
            j, k, i, l = (corners[:, :, c] for c in range(4))  # noqa: E741
            values = [v for edge in (i - j, k - j, k - l) for v in edge.transpose(2, 0, 1)]
            fills = [0.0] * 9
        packing = self.packing
        if packing.scenes > 1 and (self.reference == self.reference[0]).all():
            # One number for all lanes: these would be most of what is read.
            chosen = blocks.element.reshape(-1, packing.scenes)[:, 0]
            return tuple(value[0, chosen, None].astype(packing.dtype) for value in values)
        return tuple(
            packing.parameters(blocks, value, fill)
            for value, fill in zip(values, fills, strict=True)
        )
