"""Compiled entries for callers that own the loop over steps: forces, driven nodes, frames.

Positions and velocities come as (N, 3) arrays in SI units; the flat, scaled coordinates that the
kernels take are the work arrays of `openprc.demlat.forces.ForceField`.
"""

from __future__ import annotations

from typing import Any

from openprc.demlat.compiled.jit import entry, jit
from openprc.demlat.integrators.stepping import save_frame, total
from openprc.demlat.models.barhinge.drive_kernels import place_driven
from openprc.demlat.models.barhinge.dynamics_kernels import evaluate


@jit
def take_nodes(values: Any, stride: int, unit: float, flat: Any) -> None:
    """Copy values (N, 3) to flat coordinates, measured in `unit`."""
    for node in range(values.shape[0]):
        for axis in range(3):
            flat[axis * stride + node] = values[node, axis] / unit


@jit
def give_nodes(flat: Any, stride: int, unit: float, values: Any) -> None:
    """Copy flat coordinates back to values (N, 3)."""
    for node in range(values.shape[0]):
        for axis in range(3):
            values[node, axis] = unit * flat[axis * stride + node]


@entry
def field_forces(stamp: int) -> Any:
    """``field_forces(body, work, positions, velocities, clock, scale, out, power)``.

    `work` holds flat positions, velocities, forces, and powers by lane; `clock` the time and
    the step around it that says which side of a jump counts; `scale` the units of length,
    velocity, force and power. Sets `out` (N, 3) to the forces and `power` to the ledger's
    powers.
    """

    def field_forces(body, work, positions, velocities, clock, scale, out, power):
        _ = stamp
        x, v, force, rates = work
        length, velocity, newton, watt = scale
        take_nodes(positions, body.stride, length, x)
        take_nodes(velocities, body.stride, velocity, v)
        evaluate(body, x, v, force, rates, clock[0], clock[1], clock[2])
        give_nodes(force, body.stride, newton, out)
        for row in range(power.size):
            power[row] = watt * total(rates, row)

    return field_forces


@entry
def field_place(stamp: int) -> Any:
    """``field_place(drives, stride, work, positions, velocities, clock, scale)``.

    Puts driven coordinates where their signals say, with the signals' rates.
    """

    def field_place(drives, stride, work, positions, velocities, clock, scale):
        _ = stamp
        x, v, _force, _rates = work
        length, velocity, _newton, _watt = scale
        take_nodes(positions, stride, length, x)
        take_nodes(velocities, stride, velocity, v)
        place_driven(drives, x, v, clock[0], clock[1], clock[2])
        give_nodes(x, stride, length, positions)
        give_nodes(v, stride, velocity, velocities)

    return field_place


@entry
def field_frame(stamp: int) -> Any:
    """``field_frame(body, work, energy, positions, velocities, units, scale, row, buffer)``.

    Fills a row of a frame buffer with the state and what is derived from it; the ledger's
    columns stay 0.
    """

    def field_frame(body, work, energy, positions, velocities, units, scale, row, buffer):
        _ = stamp
        x, v, _force, rates = work
        take_nodes(positions, body.stride, units[0], x)
        take_nodes(velocities, body.stride, units[1], v)
        rates[:] = 0.0
        save_frame(body, x, v, rates, energy, scale, row, buffer)

    return field_frame
