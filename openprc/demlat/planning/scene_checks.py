"""What is odd about a body before it is run; nothing of it stops a run."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from openprc.demlat.planning.mechanisms import pieces
from openprc.demlat.planning.tangent_operators import hinge_flatness, starting_positions
from openprc.demlat.statics.element_shapes import bar_directions, hinge_bends
from openprc.schema.findings import Finding
from openprc.schema.mistakes import list_some

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.demlat.planning.mechanisms import FreeMotions
    from openprc.schema.experiment import Experiment

    Reals = NDArray[np.float64]

#: Altitude of a hinge's triangle per longest edge below which its forces grow out of hand.
THIN = 1e-3
#: Angle of a hinge from folded shut [rad] below which it is about to pass through itself.
SHUT = 1e-3
#: Length of a bar per median length below which it is probably a mistake.
SHORT = 1e-3
#: Distance of nodes per size of the body below which they are at one point.
COINCIDENT = 1e-9


def scene_findings(experiment: Experiment) -> Iterator[Finding]:
    """Yield what is degenerate, loose or without effect, as warnings and hints."""
    yield from thin_hinges(experiment)
    yield from shut_hinges(experiment)
    yield from zero_bars(experiment)
    yield from short_bars(experiment)
    yield from coincident_nodes(experiment)
    yield from idle_elements(experiment)
    yield from floating_pieces(experiment)


def thin_hinges(experiment: Experiment) -> Iterator[Finding]:
    """Yield hinges with a wing close to its crease line: forces go as one over the altitude."""
    hinges = experiment.geometry.hinges
    flatness = hinge_flatness(starting_positions(experiment), hinges.indices)
    thin = np.flatnonzero(flatness < THIN)
    if len(thin):
        yield Finding(
            code="PLAN-THIN-HINGE",
            level="warning",
            path="elements/hinges/indices",
            found=f"hinge {list_some(thin)} has a wing {flatness[thin].min():.2g} of its longest"
            " edge away from the crease line",
            expected=f"at least {THIN:g}: forces grow as one over that distance",
            fix="move the wing off the line, or leave the hinge out",
        )


def shut_hinges(experiment: Experiment) -> Iterator[Finding]:
    """Yield hinges that are nearly folded shut, where their angle jumps by a full turn."""
    hinges = experiment.geometry.hinges
    positions = starting_positions(experiment)
    sound = hinge_flatness(positions, hinges.indices) >= THIN
    left = np.pi - np.abs(hinge_bends(positions, hinges.indices))
    shut = np.flatnonzero(sound & (left < SHUT))
    if len(shut):
        yield Finding(
            code="PLAN-SHUT-HINGE",
            level="warning",
            path="elements/hinges/indices",
            found=f"hinge {list_some(shut)} is {left[shut].min():.2g} rad from folded shut",
            expected=f"at least {SHUT:g} rad: past 0 or 2 pi the angle jumps by a full turn, and"
            " its moment with it",
            fix="open it a little, or take the law 'enhanced-linear', whose moment keeps it open",
        )


def zero_bars(experiment: Experiment) -> Iterator[Finding]:
    """Yield bars without a length, which have no direction to push or pull along."""
    bars = experiment.geometry.bars
    lengths, _ = bar_directions(starting_positions(experiment), bars.indices)
    zero = np.flatnonzero(lengths == 0.0)
    if len(zero):
        yield Finding(
            code="PLAN-ZERO-BAR",
            level="warning",
            path="elements/bars/indices",
            found=f"bar {list_some(zero)} joins two nodes at one point",
            expected="a bar with a direction at t = 0: this one exerts no force until its nodes"
            " come apart",
            fix="merge its nodes, or move one of them",
        )


def short_bars(experiment: Experiment) -> Iterator[Finding]:
    """Yield bars that are much shorter than the others."""
    bars = experiment.geometry.bars
    lengths, _ = bar_directions(starting_positions(experiment), bars.indices)
    typical = float(np.median(lengths)) if len(lengths) else 0.0
    short = np.flatnonzero((lengths < SHORT * typical) & (lengths > 0.0))
    if len(short):
        yield Finding(
            code="PLAN-SHORT-BAR",
            level="warning",
            path="elements/bars/indices",
            found=f"bar {list_some(short)} is {lengths[short].min():.2g} m long, the median bar"
            f" {typical:.2g} m",
            expected="bars of comparable length: a short one turns about at the least motion",
            fix="merge its nodes, or check their positions",
        )


def coincident_nodes(experiment: Experiment) -> Iterator[Finding]:
    """Yield nodes at one point."""
    positions = starting_positions(experiment)
    size = float(np.ptp(positions, axis=0).max())
    if len(positions) < 2:
        return
    # Only a plan needs neighbours; a run does not load scipy for it.
    from scipy.spatial import cKDTree

    distance, nearest = (np.asarray(part) for part in cKDTree(positions).query(positions, k=2))
    at = np.flatnonzero(distance[:, 1] <= COINCIDENT * size)
    if len(at):
        other = int(nearest[at[0]][nearest[at[0]] != at[0]][0])
        yield Finding(
            code="PLAN-COINCIDENT-NODES",
            level="warning",
            path="nodes/positions",
            found=f"{len(at)} nodes share their points with others, such as node {at[0]}"
            f" and node {other}",
            expected="a point for each node",
            fix="merge them if they are one node; nodes at one point are not joined",
        )


def idle_elements(experiment: Experiment) -> Iterator[Finding]:
    """Yield elements between nodes of which none can move: they only cost time."""
    geometry = experiment.geometry
    for name, elements in (
        ("bars", geometry.bars),
        ("hinges", geometry.hinges),
        ("bends", geometry.bends),
    ):
        idle = np.flatnonzero(geometry.fixed[elements.indices].all(axis=1))
        if len(idle):
            yield Finding(
                code=f"PLAN-IDLE-{name.upper()}",
                level="hint",
                path=f"elements/{name}/indices",
                found=f"{len(idle)} {name} between fixed nodes ({list_some(idle)})",
                fix="leave them out: they move nothing",
            )


# --- pieces ---------------------------------------------------------------------------------------


def floating_pieces(experiment: Experiment) -> Iterator[Finding]:
    """Yield pieces that nothing holds, and nodes without any element."""
    geometry, labels = experiment.geometry, pieces(experiment)
    n_pieces = int(labels.max()) + 1
    held = np.zeros(n_pieces, dtype=bool)
    held[labels[experiment.held_axes.any(axis=1)]] = True
    size = np.bincount(labels)
    touched = np.zeros(geometry.n_nodes, dtype=bool)
    for elements in (geometry.bars, geometry.hinges, geometry.bends):
        touched[elements.indices] = True
    falls = any(experiment.gravity)
    loose = np.flatnonzero(~held[labels] & ~touched)
    if len(loose):
        yield Finding(
            code="PLAN-LOOSE-NODE",
            level="warning",
            path="nodes/positions",
            found=f"no bar or hinge holds node {list_some(loose)}"
            + (", which falls freely" if falls else ""),
            expected="an element at every node that moves",
            fix="connect, fix or remove it",
        )
    floating = np.flatnonzero(~held & (size > 1))
    if len(floating):
        example = np.flatnonzero(labels == floating[0])
        every = len(floating) == n_pieces
        yield Finding(
            code="PLAN-FLOATING",
            level="warning" if falls or not every else "hint",
            path="nodes/fixed",
            found=f"{len(floating)} of {n_pieces} pieces have no fixed or driven node, such as the"
            f" {len(example)} nodes {list_some(example)}"
            + (": gravity carries them away" if falls else ""),
            fix="fix or drive some of their nodes, unless they are meant to float",
        )


# --- motions -------------------------------------------------------------------------------------


def motion_findings(motions: FreeMotions | None) -> Iterator[Finding]:
    """Yield what the search for free motions found worth a second look, as hints."""
    if motions is None:
        yield Finding(
            code="PLAN-NOT-SEARCHED",
            level="hint",
            path="nodes/positions",
            found="the body is too large for a search for mechanisms",
            expected="a body whose rigidity matrix can be factorised in seconds",
            fix="look at a smaller one of its kind",
        )
        return
    inner = [motion for motion in motions.shown if motion.kind == "mechanism"]
    if motions.n_mechanisms:
        example = f", such as: {inner[0].text}" if inner else ""
        many = (
            "1 motion strains"
            if motions.n_mechanisms == 1
            else (f"{motions.n_mechanisms:,} motions strain")
        )
        yield Finding(
            code="PLAN-MECHANISM",
            level="hint",
            path="elements",
            found=f"{many} no element{example}",
            expected="bars, hinges or bends against every motion, unless it is meant to be free",
            fix="brace it, give hinges or bends a stiffness, or fix a node",
        )
    if motions.n_redundant_rigid:
        some = ", ".join(motions.redundant_rigid[:5])
        yield Finding(
            code="PLAN-REDUNDANT-RIGID",
            level="hint",
            path="elements/bars/rigid",
            found=f"{motions.n_redundant_rigid:,} rigid elements are implied by the others"
            + (f", such as {some}" if some else ""),
            expected="independent constraints: forces in redundant ones are not determined",
            fix="leave them out, or make them soft",
        )
