"""CUDA kernels: the stages of the classical Runge-Kutta scheme, frames, sums and the guard.

A stage is two passes. One thread an element stores the forces of its ends; one thread a node
adds up the ends that meet there, in a fixed order, and goes on to the next stage. Nothing is
added atomically, so results do not depend on the order in which threads run.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from numba import cuda

from openprc.demlat.backends.cuda_elements import (
    DAMPING,
    RELAXED,
    STAGE_V,
    STAGE_X,
    SUM_V,
    SUM_X,
    Bars,
    Drives,
    Hinges,
    V,
    X,
    bar_energy,
    bar_tension,
    device,
    fold_energy,
    measure_bar,
    measure_hinge,
    push_bar,
    push_hinge,
    signal_at,
    spring_moment,
)

#: Rows of `Nodes.constants`, three axes each but for the mass.
INVERSE_MASS, DRAG, WEIGHT, FULL_WEIGHT, MASS = 0, 3, 6, 9, 12
#: Rows of `Nodes.sums`: work put in at a node, and lost to drag.
WORK, LOST = 0, 1
#: Columns of the sums over the body.
KINETIC, OF_BARS, OF_HINGES, FALLING, WORK_IN, BY_DRAG, BY_BARS, BY_HINGES = range(8)
N_SUMS = 8
NOTHING_ESCAPED = 1 << 40


class Nodes(NamedTuple):
    """Nodes, and the ends of elements that meet there.

    Attributes
    ----------
    motion : (18, N)
        Position, velocity, stage position, stage velocity and the sums over the stages.
    constants : (13, N)
        Inverse mass, drag and weight (0 where held), weight of all coordinates, mass.
    sums : (2, N)
        Work and loss since t = 0.
    first_end : (N + 1,) i4
    slots : (E,) i4
        Slots of the ends at a node; ``-1 - s`` for the negative of what is in slot s.
    """

    motion: Any
    constants: Any
    sums: Any
    first_end: Any
    slots: Any


class Elements(NamedTuple):
    """Elements and what they store.

    Attributes
    ----------
    bars, hinges
    ends : (3, slots) [N]
        Of bars, then (from `hinge_slots` on) of the hinges' j, k, i and l.
    losses : (M + K,) [J]
        Energy lost since t = 0.
    energies : (M + K,) [J]
        As last observed.
    """

    bars: Bars
    hinges: Hinges
    ends: Any
    losses: Any
    energies: Any


class Frames(NamedTuple):
    """A block of B saved frames.

    Attributes
    ----------
    x, v : (B, N, 3)
    length, tension : (B, M)
    change, moment : (B, K)
        `change` is the angle minus the rest angle.
    node_energy : (2, N)
        Kinetic energy and that of the weight, as last observed.
    """

    x: Any
    v: Any
    length: Any
    tension: Any
    change: Any
    moment: Any
    node_energy: Any


# --- one stage ------------------------------------------------------------------------------


@device
def weight_of(stage: int, h: float) -> float:
    """Return the weight of a stage in the sum over the step."""
    return h / 6.0 if stage == 0 or stage == 3 else h / 3.0


@device
def time_of(stage: int, t: float, h: float) -> float:
    """Return the time of a stage of the step that begins at `t`."""
    if stage == 0:
        return t
    return t + h if stage >= 3 else t + 0.5 * h


@device
def push_element(e: int, elements: Elements, motion: Any, weight: float) -> None:
    """Store the forces of bar `e`, or of hinge ``e - M``."""
    n_bars = elements.bars.nodes.shape[1]
    if e < n_bars:
        push_bar(e, elements.bars, motion, elements.ends, elements.losses, weight)
    else:
        hinge_slots = elements.ends.shape[1] - 4 * elements.hinges.nodes.shape[1]
        push_hinge(
            e - n_bars,
            elements.hinges,
            motion,
            elements.ends,
            hinge_slots,
            elements.losses,
            e,
            weight,
        )


@device
def gather(a: int, n: int, nodes: Nodes, ends: Any) -> float:
    """Return the sum along axis `a` of the ends that meet at node `n`."""
    total = 0.0
    for p in range(nodes.first_end[n], nodes.first_end[n + 1]):
        slot = nodes.slots[p]
        if slot >= 0:
            total += ends[a, slot]
        else:
            total -= ends[a, -1 - slot]
    return total


@device
def put(a: int, n: int, motion: Any, drives: Drives, t: float, t_from: float, t_to: float) -> None:
    """Place the stage of a driven coordinate where its signal says."""
    row = drives.motion_row[a, n]
    if row >= 0:
        value, rate = signal_at(drives, drives.motion_column[row], t, t_from, t_to)
        motion[STAGE_X + a, n] = drives.motion_reals[0, row] + value
        motion[STAGE_V + a, n] = rate


@device
def coordinate_force(
    a: int, n: int, nodes: Nodes, ends: Any, drives: Drives, t: float, t_from: float, t_to: float
) -> Any:
    """Return the force on a coordinate, the power put in there, and the power lost to drag."""
    u = nodes.motion[STAGE_V + a, n]
    resistance = nodes.constants[DRAG + a, n] * u
    force = nodes.constants[WEIGHT + a, n] - resistance + gather(a, n, nodes, ends)
    lost, work = resistance * u, 0.0
    row = drives.motion_row[a, n]
    if row >= 0:
        # Weight and drag of a held coordinate are not among its constants, which it ignores.
        resistance = drives.motion_reals[1, row] * u
        force += drives.motion_reals[2, row] - resistance
        lost += resistance * u
        work -= force * u
    for p in range(drives.push_first[3 * n + a], drives.push_first[3 * n + a + 1]):
        value, _ = signal_at(drives, drives.push_column[p], t, t_from, t_to)
        force += value
        work += value * u
    return force, work, lost


@device
def advance_node(
    n: int, nodes: Nodes, ends: Any, drives: Drives, step: int, stage: int, h: float, hold: bool
) -> None:
    """Add a stage of node `n` to the sums and go to the next one, or end the step.

    At the end of a step driven coordinates are handed over to the segments that begin there;
    with `hold` they stay on those that end.
    """
    motion = nodes.motion
    t = step * h
    weight = weight_of(stage, h)
    ahead = h if stage == 2 else 0.5 * h
    now, after = time_of(stage, t, h), time_of(stage + 1, t, h)
    work, lost = 0.0, 0.0
    for a in range(3):
        force, power, loss = coordinate_force(a, n, nodes, ends, drives, now, t, t + h)
        work += power
        lost += loss
        slope_x = motion[STAGE_V + a, n]
        slope_v = force * nodes.constants[INVERSE_MASS + a, n]
        sum_x, sum_v = weight * slope_x, weight * slope_v
        if stage > 0:
            sum_x += motion[SUM_X + a, n]
            sum_v += motion[SUM_V + a, n]
        if stage < 3:
            motion[SUM_X + a, n] = sum_x
            motion[SUM_V + a, n] = sum_v
            motion[STAGE_X + a, n] = motion[X + a, n] + ahead * slope_x
            motion[STAGE_V + a, n] = motion[V + a, n] + ahead * slope_v
            put(a, n, motion, drives, after, t, t + h)
        else:
            motion[STAGE_X + a, n] = motion[X + a, n] + sum_x
            motion[STAGE_V + a, n] = motion[V + a, n] + sum_v
            end = (step + 1) * h
            if hold:
                put(a, n, motion, drives, t + h, t, t + h)
            else:
                put(a, n, motion, drives, end, end, end + h)
            motion[X + a, n] = motion[STAGE_X + a, n]
            motion[V + a, n] = motion[STAGE_V + a, n]
    nodes.sums[WORK, n] += weight * work
    nodes.sums[LOST, n] += weight * lost


@cuda.jit
def push_elements(elements, nodes, stage, h):
    """First pass of a stage: one thread an element."""
    e = cuda.grid(1)
    if e < elements.losses.shape[0]:
        push_element(e, elements, nodes.motion, weight_of(stage, h))


@cuda.jit
def advance_nodes(elements, nodes, drives, step, stage, h, hold):
    """Second pass of a stage: one thread a node."""
    n = cuda.grid(1)
    if n < nodes.motion.shape[1]:
        advance_node(n, nodes, elements.ends, drives, step, stage, h, hold)


@cuda.jit
def march(elements, nodes, drives, step, count, h, hold):
    """Take `count` steps of a small body in one block of threads, without further launches."""
    first, width = cuda.threadIdx.x, cuda.blockDim.x
    for number in range(step, step + count):
        for stage in range(4):
            for e in range(first, elements.losses.shape[0], width):
                push_element(e, elements, nodes.motion, weight_of(stage, h))
            cuda.syncthreads()
            held = hold and number == step + count - 1
            for n in range(first, nodes.motion.shape[1], width):
                advance_node(n, nodes, elements.ends, drives, number, stage, h, held)
            cuda.syncthreads()


@cuda.jit
def place(nodes, drives, t, t_to):
    """Put driven coordinates where the segments that begin at `t` say."""
    n = cuda.grid(1)
    if n < nodes.motion.shape[1]:
        for a in range(3):
            put(a, n, nodes.motion, drives, t, t, t_to)
            nodes.motion[X + a, n] = nodes.motion[STAGE_X + a, n]
            nodes.motion[V + a, n] = nodes.motion[STAGE_V + a, n]


@cuda.jit
def add_forces(elements, nodes, drives, t, t_to, force):
    """Write all forces on every coordinate to `force` (3, N), after `push_elements`."""
    n = cuda.grid(1)
    if n < nodes.motion.shape[1]:
        for a in range(3):
            total, _, _ = coordinate_force(a, n, nodes, elements.ends, drives, t, t, t_to)
            force[a, n] = total


# --- frames ---------------------------------------------------------------------------------


@cuda.jit
def observe(elements, nodes, frames, row):
    """Write a frame to row `row`, and energies for `add_up`; one thread an element or node."""
    at = cuda.grid(1)
    motion = nodes.motion
    bars, hinges = elements.bars, elements.hinges
    n_bars, n_hinges = bars.nodes.shape[1], hinges.nodes.shape[1]
    if at < n_bars:
        length, rate, _, _, _ = measure_bar(at, bars, motion)
        law, stretch = bars.nodes[2, at], length - bars.reals[RELAXED, at]
        tension, _ = bar_tension(law, stretch, rate, bars.reals, at)
        frames.length[row, at] = length
        frames.tension[row, at] = tension
        elements.energies[at] = bar_energy(law, stretch, bars.reals, at)
    elif at < n_bars + n_hinges:
        h = at - n_bars
        change, rate, _, _, _, _, _, _, _, _ = measure_hinge(h, hinges, motion)
        frames.change[row, h] = change
        frames.moment[row, h] = spring_moment(change, hinges, h) + hinges.reals[DAMPING, h] * rate
        elements.energies[at] = fold_energy(change, hinges, h)
    elif at < n_bars + n_hinges + motion.shape[1]:
        n = at - n_bars - n_hinges
        squares, falling = 0.0, 0.0
        for a in range(3):
            x, v = motion[X + a, n], motion[V + a, n]
            frames.x[row, n, a] = x
            frames.v[row, n, a] = v
            squares += v * v
            falling -= nodes.constants[FULL_WEIGHT + a, n] * x
        frames.node_energy[0, n] = 0.5 * nodes.constants[MASS, n] * squares
        frames.node_energy[1, n] = falling


@device
def share(values: Any, begin: int, end: int, thread: int, width: int) -> float:
    """Return the sum of every `width`-th value from ``begin + thread`` on."""
    total = 0.0
    for at in range(begin + thread, end, width):
        total += values[at]
    return total


@cuda.jit
def add_up(elements, nodes, frames, partial):
    """First pass of the sums over the body: (8, threads) shares."""
    thread, width = cuda.grid(1), partial.shape[1]
    if thread < width:
        n_nodes, n_bars = nodes.motion.shape[1], elements.bars.nodes.shape[1]
        n = elements.losses.shape[0]
        partial[KINETIC, thread] = share(frames.node_energy[0], 0, n_nodes, thread, width)
        partial[FALLING, thread] = share(frames.node_energy[1], 0, n_nodes, thread, width)
        partial[WORK_IN, thread] = share(nodes.sums[WORK], 0, n_nodes, thread, width)
        partial[BY_DRAG, thread] = share(nodes.sums[LOST], 0, n_nodes, thread, width)
        partial[OF_BARS, thread] = share(elements.energies, 0, n_bars, thread, width)
        partial[OF_HINGES, thread] = share(elements.energies, n_bars, n, thread, width)
        partial[BY_BARS, thread] = share(elements.losses, 0, n_bars, thread, width)
        partial[BY_HINGES, thread] = share(elements.losses, n_bars, n, thread, width)


@cuda.jit
def finish_sums(partial, sums, row):
    """Second pass: a row of `sums` (rows, 8)."""
    kind = cuda.grid(1)
    if kind < partial.shape[0]:
        sums[row, kind] = share(partial[kind], 0, partial.shape[1], 0, 1)


@cuda.jit
def find_escaped(nodes, limit, escaped, look):
    """Write the first coordinate (axis first) that is not below `limit` to ``escaped[look]``."""
    n = cuda.grid(1)
    n_nodes = nodes.motion.shape[1]
    if n < n_nodes:
        for a in range(3):
            if not abs(nodes.motion[X + a, n]) < limit:  # also true for NaN
                # The least of integers is the same in any order.
                cuda.atomic.min(escaped, look, a * n_nodes + n)
