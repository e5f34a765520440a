"""What the runner models, what it refuses, and what a reader of its results should know."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.schema.findings import Finding
from openprc_pyelastica.chains import Chain, Sorted, sort_chains
from openprc_pyelastica.held_parts import held_parts
from openprc_pyelastica.rod_material import checked_options, material_of
from openprc_pyelastica.rod_step_limit import StepLimit, step_limit

if TYPE_CHECKING:
    from openprc.schema import Experiment

#: Deviation of a rest angle from pi that rounding explains [rad].
STRAIGHT = 1e-9
#: Cosine between neighbouring bars below which a chain counts as folded back.
FOLDED = -1.0 + 1e-6


def findings(experiment: Experiment) -> Iterator[Finding]:
    """Yield what cannot be modelled ("error"), and what is done differently ("hint")."""
    refused = False
    for finding in _refusals(experiment):
        refused |= finding.level == "error"
        yield finding
    if not refused:
        yield from _remarks(experiment)


def _error(code: str, path: str, found: str, expected: str, fix: str) -> Finding:
    return Finding(f"PYE-{code}", "error", path, found, expected, fix)


def _refusals(experiment: Experiment) -> Iterator[Finding]:
    geometry = experiment.geometry
    if len(geometry.hinges):
        yield _error(
            "HINGES",
            "elements/hinges",
            f"{len(geometry.hinges)} dihedral hinges: a rod bends about any axis across it and has"
            " no faces to fold",
            "chains of bars with bends at their inner nodes",
            "run it with demlat, or model the crease pattern by something else",
        )
    yield from _bars(experiment)
    yield from _bends(experiment)
    yield from _shape(experiment, sort_chains(geometry))
    yield from _settings(experiment)
    held = experiment.held_axes
    for number, actuator in enumerate(experiment.actuators):
        clash = np.flatnonzero(held[actuator.node] & np.array(actuator.axes))
        if actuator.type == "force" and len(clash):
            yield _error(
                "DEAD-FORCE",
                f"actuators[{number}].axes",
                f"a force on {'xyz'[clash[0]]} of node {actuator.node}, which is held there",
                "forces on axes that can move",
                "drop the axis or the actuator: the force would have no effect",
            )


def _bars(experiment: Experiment) -> Iterator[Finding]:
    bars = experiment.geometry.bars
    for what, bad, why, fix in (
        (
            "rigid",
            bars.rigid,
            "rigid bars: a rod always stretches",
            "give them a stiffness",
        ),
        (
            "law",
            bars.law != "linear",
            "bars with another law than the linear one, which is the only one of a rod",
            "give them the law 'linear'",
        ),
        (
            "damping",
            bars.damping > 0.0,
            "dashpots along bars: PyElastica damps motion, not the rate of strain",
            "set them to 0 and use the uniform damping of the experiment",
        ),
        (
            "stiffness",
            ~(bars.stiffness > 0.0) & ~bars.rigid,
            "bars without stiffness, which an element of a rod cannot be",
            "give them a stiffness above 0",
        ),
        (
            "rest_length",
            ~(bars.relaxed_length > 0.0),
            "bars without a length, which an element of a rod cannot be",
            "give them a rest length above 0",
        ),
    ):
        if np.any(bad):
            yield _error(
                f"BAR-{what.upper().replace('_', '-')}",
                f"elements/bars/{what}",
                f"{int(np.sum(bad))} {why}",
                "linear elastic bars without dashpots",
                f"{fix}, or run it with demlat",
            )


def _bends(experiment: Experiment) -> Iterator[Finding]:
    bends = experiment.geometry.bends
    curved = np.abs(bends.rest_angle - math.pi) > STRAIGHT
    if curved.any():
        yield _error(
            "CURVED",
            "elements/bends/rest_angle",
            f"{int(curved.sum())} bends that rest at an angle: the natural curvature of a rod has"
            " an axis, and a bend does not tell one",
            "bends that are straight at rest, pi",
            "set the rest angles to pi, or run it with demlat",
        )
    if bends.damping.any():
        yield _error(
            "BEND-DAMPING",
            "elements/bends/damping",
            f"{int((bends.damping > 0).sum())} bends with dashpots: PyElastica damps motion, not"
            " the rate of strain",
            "bends without damping",
            "set it to 0 and use the uniform damping of the experiment, or run it with demlat",
        )


def _shape(experiment: Experiment, found: Sorted) -> Iterator[Finding]:
    geometry = experiment.geometry
    expected = "chains: bars that follow each other from one end to another"
    if not len(geometry.bars):
        yield _error(
            "NO-BARS",
            "elements/bars",
            "no bars at all: a rod is made of a chain of them",
            expected,
            "add bars, or run it with another producer",
        )
        return
    if found.branches:
        some = ", ".join(map(str, found.branches[:5]))
        yield _error(
            "BRANCH",
            "elements/bars/indices",
            f"{len(found.branches)} node(s) with three or more bars ({some}): a lattice or a"
            " branching body, and rods only meet in soft penalty joints",
            expected,
            "run it with demlat",
        )
    if found.lone:
        yield _error(
            "LONE-NODE",
            "nodes",
            f"{len(found.lone)} node(s) without a bar, such as node {found.lone[0]}",
            expected,
            "drop them, or run it with demlat",
        )
    if found.loop is not None:
        yield _error(
            "LOOP",
            "elements/bars/indices",
            f"a closed loop of bars through node {found.loop}: a ring rod is curved at rest, and"
            " bars and bends do not say how",
            expected,
            "run it with demlat",
        )
    if found.strays:
        stray = found.strays[0]
        yield _error(
            "STRAY-BEND",
            "elements/bends/indices",
            f"bend {stray} on {geometry.bends.indices[stray].tolist()}, which do not follow each"
            " other along a chain",
            "bends between neighbouring bars",
            "drop it, or run it with demlat",
        )
    for chain in found.chains:
        yield from _chain(experiment, chain)


def _chain(experiment: Experiment, chain: Chain) -> Iterator[Finding]:
    geometry = experiment.geometry
    first, last = int(chain.nodes[0]), int(chain.nodes[-1])
    if chain.n_elements < 2:
        yield _error(
            "SHORT",
            "elements/bars/indices",
            f"a single bar between nodes {first} and {last}: a rod has two elements or more",
            "chains of at least two bars",
            "divide the bar, or run it with demlat",
        )
        return
    free = ~experiment.held_axes[chain.nodes].all(axis=1)
    empty = chain.nodes[free & ~(geometry.masses[chain.nodes] > 0.0)]
    if len(empty):
        yield _error(
            "NO-MASS",
            "nodes/mass",
            f"node {int(empty[0])} is free and has no mass",
            "masses above 0 of all nodes that move",
            "give it a mass",
        )
    tangents = np.diff(geometry.positions[chain.nodes], axis=0)
    lengths = np.linalg.norm(tangents, axis=1)
    if not lengths.all():
        yield _error(
            "ZERO-LENGTH",
            "nodes/positions",
            f"two neighbours in the chain from node {first} to node {last} are at one place",
            "bars that have a direction at t = 0",
            "move one of them",
        )
        return
    tangents /= lengths[:, np.newaxis]
    cosines = (tangents[1:] * tangents[:-1]).sum(axis=1)
    if (cosines < FOLDED).any():
        corner = int(chain.nodes[1:-1][np.argmin(cosines)])
        yield _error(
            "FOLDED",
            "nodes/positions",
            f"the chain is folded back on itself at node {corner}, about no particular axis",
            "bars that are not opposite to their neighbours at t = 0",
            "unfold it a little",
        )


def _settings(experiment: Experiment) -> Iterator[Finding]:
    if experiment.collision.enabled and experiment.geometry.collidable.any():
        yield _error(
            "CONTACT",
            "physics.enable_collision",
            "contact between nodes: rods touch along their whole length, and otherwise",
            "a body without contact",
            "set enable_collision to false, or run it with demlat",
        )
    if experiment.precision != "float64":
        yield _error(
            "PRECISION",
            "simulation.precision",
            f"the precision {experiment.precision}",
            "float64, in which PyElastica computes",
            "set it to float64; export.precision chooses that of the file",
        )


def _remarks(experiment: Experiment) -> Iterator[Finding]:
    if experiment.integrator != "verlet":
        yield Finding(
            code="PYE-INTEGRATOR",
            level="hint",
            path="simulation.integrator",
            found=f"the integrator {experiment.integrator!r}",
            expected="PyElastica's position Verlet, which is used",
            fix="say verlet, or nothing",
        )
    limit = shortest_limit(experiment, options=checked_options({}))
    if experiment.step_check == "refuse" and experiment.dt > limit.step:
        yield Finding(
            code="PYE-UNSTABLE-STEP",
            level="warning",
            path="simulation.dt",
            found=f"dt = {experiment.dt:g} s, which would blow up: {limit.setter} set the"
            " stability limit",
            expected=f"at most {limit.step:.4g} s with the default options",
            fix="take a shorter dt, or say substeps=auto; the run is refused otherwise",
        )


def shortest_limit(experiment: Experiment, *, options: Mapping[str, Any]) -> StepLimit:
    """Return the step limit of the rod that has the shortest.

    `options` are as `checked_options` returns them.
    """
    limits = []
    for chain in sort_chains(experiment.geometry).chains:
        held = held_parts(chain, experiment, clamp=options["clamp"])
        material = material_of(chain, experiment, options=options)
        limits.append(step_limit(material, held_nodes=held.nodes, held_elements=held.elements))
    return min(limits, key=lambda limit: limit.step)
