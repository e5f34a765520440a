"""The yardstick: Runge-Kutta over scattered scalar elements, the whole loop in one function.

What one writes first in Numba: nodes as rows of (N, 3) arrays, one bar after the other added
to both its ends, no thought given to vectors. Everything else is judged against it.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from engine_scenes import Scene

from peers.serving import Run, serve

# Not "nnan" and "ninf": a run that blows up should show it.
jit = numba.njit(error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"})


def flat_tables(scene: Scene) -> tuple[np.ndarray, ...]:
    """Return what `add_forces` takes after the force."""
    bend = scene.rest_angle - np.pi
    return (
        scene.drag,
        scene.bars.astype(np.uint32),
        scene.stiffness,
        scene.rest_length,
        scene.damping,
        scene.hinges.astype(np.uint32),
        scene.hinge_stiffness,
        np.cos(bend),
        np.sin(bend),
    )


def inverse_masses(scene: Scene) -> np.ndarray:
    """Return 1/m, 0 where fixed: (N,) [1/kg]."""
    return np.where(scene.fixed, 0.0, 1.0 / scene.masses)


@jit
def forces(
    x: Any,
    v: Any,
    f: Any,
    drag: Any,
    bars: Any,
    stiffness: Any,
    rest_length: Any,
    damping: Any,
    hinges: Any,
    hinge_stiffness: Any,
    rest_cos: Any,
    rest_sin: Any,
) -> None:
    """Set `f` (N, 3) [N] to all forces."""
    for i in range(x.shape[0]):
        for a in range(3):
            f[i, a] = -drag[i] * v[i, a]
    for e in range(bars.shape[0]):
        i, j = bars[e, 0], bars[e, 1]
        dx, dy, dz = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        inverse = 1.0 / length
        rate = dx * (v[j, 0] - v[i, 0]) + dy * (v[j, 1] - v[i, 1]) + dz * (v[j, 2] - v[i, 2])
        tension = stiffness[e] * (length - rest_length[e]) + damping[e] * rate * inverse
        scale = tension * inverse
        f[i, 0] += scale * dx
        f[i, 1] += scale * dy
        f[i, 2] += scale * dz
        f[j, 0] -= scale * dx
        f[j, 1] -= scale * dy
        f[j, 2] -= scale * dz
    for e in range(hinges.shape[0]):
        j, k, i, l = hinges[e, 0], hinges[e, 1], hinges[e, 2], hinges[e, 3]  # noqa: E741
        ax, ay, az = x[i, 0] - x[j, 0], x[i, 1] - x[j, 1], x[i, 2] - x[j, 2]
        bx, by, bz = x[k, 0] - x[j, 0], x[k, 1] - x[j, 1], x[k, 2] - x[j, 2]
        cx, cy, cz = x[k, 0] - x[l, 0], x[k, 1] - x[l, 1], x[k, 2] - x[l, 2]
        mx, my, mz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        bb = bx * bx + by * by + bz * bz
        crease = math.sqrt(bb)
        sine = -crease * (nx * ax + ny * ay + nz * az)
        cosine = -(mx * nx + my * ny + mz * nz)
        # The angle between bend and rest, without a branch for whole turns.
        difference = math.atan2(
            sine * rest_cos[e] - cosine * rest_sin[e], cosine * rest_cos[e] + sine * rest_sin[e]
        )
        moment = -hinge_stiffness[e] * difference * crease
        si = moment / (mx * mx + my * my + mz * mz)
        sl = -moment / (nx * nx + ny * ny + nz * nz)
        inverse = 1.0 / bb
        p = (ax * bx + ay * by + az * bz) * inverse
        q = (cx * bx + cy * by + cz * bz) * inverse
        ix, iy, iz = si * mx, si * my, si * mz
        lx, ly, lz = sl * nx, sl * ny, sl * nz
        f[i, 0] += ix
        f[i, 1] += iy
        f[i, 2] += iz
        f[l, 0] += lx
        f[l, 1] += ly
        f[l, 2] += lz
        f[j, 0] += (p - 1.0) * ix - q * lx
        f[j, 1] += (p - 1.0) * iy - q * ly
        f[j, 2] += (p - 1.0) * iz - q * lz
        f[k, 0] += (q - 1.0) * lx - p * ix
        f[k, 1] += (q - 1.0) * ly - p * iy
        f[k, 2] += (q - 1.0) * lz - p * iz


@jit
def rk4(x: Any, v: Any, inverse_mass: Any, h: float, n_steps: int, tables: Any) -> None:
    """Advance `x` and `v` in place by `n_steps` steps of `h` [s]."""
    xs, vs, sx, sv = x.copy(), v.copy(), np.zeros_like(x), np.zeros_like(x)
    f = np.empty_like(x)
    for _ in range(n_steps):
        for stage in range(4):
            forces(xs, vs, f, *tables)
            weight = h / 6.0 if stage in (0, 3) else h / 3.0
            share = h if stage == 2 else 0.5 * h
            for i in range(x.shape[0]):
                for a in range(3):
                    acceleration = f[i, a] * inverse_mass[i]
                    sx[i, a] += weight * vs[i, a]
                    sv[i, a] += weight * acceleration
                    xs[i, a] = x[i, a] + share * vs[i, a]
                    vs[i, a] = v[i, a] + share * acceleration
        for i in range(x.shape[0]):
            for a in range(3):
                x[i, a] += sx[i, a]
                v[i, a] += sv[i, a]
                xs[i, a], vs[i, a] = x[i, a], v[i, a]
                sx[i, a] = 0.0
                sv[i, a] = 0.0


def prepare(scene: Scene) -> Run:
    """Return a function that runs n steps."""
    tables, inverse = flat_tables(scene), inverse_masses(scene)

    def run(n_steps: int) -> np.ndarray:
        x, v = scene.positions.copy(), scene.velocities.copy()
        rk4(x, v, inverse, scene.dt, n_steps, tables)
        return x

    return run


if __name__ == "__main__":
    serve(prepare)
