"""Warp on the CPU: one kernel an element kind, atomic additions, recorded launches."""

import numpy as np
import warp as wp
from engine_scenes import Scene

from peers.serving import Run, serve

# Warp reads the annotations of its kernels as values, so they must not be postponed here.


@wp.kernel
def add_bars(
    x: wp.array(dtype=wp.vec3d),
    v: wp.array(dtype=wp.vec3d),
    bars: wp.array2d(dtype=wp.int32),
    stiffness: wp.array(dtype=wp.float64),
    rest_length: wp.array(dtype=wp.float64),
    damping: wp.array(dtype=wp.float64),
    force: wp.array(dtype=wp.vec3d),
) -> None:
    """Add the forces of all bars."""
    e = wp.tid()
    i = bars[e, 0]
    j = bars[e, 1]
    d = x[j] - x[i]
    length = wp.length(d)
    inverse = wp.float64(1.0) / length
    rate = wp.dot(d, v[j] - v[i]) * inverse
    tension = stiffness[e] * (length - rest_length[e]) + damping[e] * rate
    pull = (tension * inverse) * d
    wp.atomic_add(force, i, pull)
    wp.atomic_sub(force, j, pull)


@wp.kernel
def add_hinges(
    x: wp.array(dtype=wp.vec3d),
    hinges: wp.array2d(dtype=wp.int32),
    stiffness: wp.array(dtype=wp.float64),
    rest_cos: wp.array(dtype=wp.float64),
    rest_sin: wp.array(dtype=wp.float64),
    force: wp.array(dtype=wp.vec3d),
) -> None:
    """Add the forces of all hinges."""
    e = wp.tid()
    j = hinges[e, 0]
    k = hinges[e, 1]
    i = hinges[e, 2]
    l = hinges[e, 3]  # noqa: E741
    one = wp.float64(1.0)
    a = x[i] - x[j]
    b = x[k] - x[j]
    c = x[k] - x[l]
    m = wp.cross(a, b)
    n = wp.cross(b, c)
    bb = wp.dot(b, b)
    crease = wp.sqrt(bb)
    sine = -crease * wp.dot(n, a)
    cosine = -wp.dot(m, n)
    difference = wp.atan2(
        sine * rest_cos[e] - cosine * rest_sin[e], cosine * rest_cos[e] + sine * rest_sin[e]
    )
    moment = -stiffness[e] * difference * crease
    fi = (moment / wp.dot(m, m)) * m
    fl = (-moment / wp.dot(n, n)) * n
    inverse = one / bb
    p = wp.dot(a, b) * inverse
    q = wp.dot(c, b) * inverse
    wp.atomic_add(force, i, fi)
    wp.atomic_add(force, l, fl)
    wp.atomic_add(force, j, (p - one) * fi - q * fl)
    wp.atomic_add(force, k, (q - one) * fl - p * fi)


@wp.kernel
def end_stage(
    last: wp.bool,
    weight: wp.float64,
    share: wp.float64,
    inverse_mass: wp.array(dtype=wp.float64),
    drag: wp.array(dtype=wp.float64),
    x: wp.array(dtype=wp.vec3d),
    v: wp.array(dtype=wp.vec3d),
    xs: wp.array(dtype=wp.vec3d),
    vs: wp.array(dtype=wp.vec3d),
    sx: wp.array(dtype=wp.vec3d),
    sv: wp.array(dtype=wp.vec3d),
    force: wp.array(dtype=wp.vec3d),
) -> None:
    """Add a stage to the sums, make the next one, and start its force with the drag."""
    i = wp.tid()
    acceleration = force[i] * inverse_mass[i]
    sx[i] = sx[i] + weight * vs[i]
    sv[i] = sv[i] + weight * acceleration
    if last:
        x[i] = x[i] + sx[i]
        v[i] = v[i] + sv[i]
        xs[i] = x[i]
        vs[i] = v[i]
        sx[i] = wp.vec3d()
        sv[i] = wp.vec3d()
    else:
        xs[i] = x[i] + share * vs[i]
        vs[i] = v[i] + share * acceleration
    force[i] = -drag[i] * vs[i]


def prepare(scene: Scene) -> Run:
    """Return a function that runs n steps."""
    wp.config.quiet = True
    wp.init()
    n_nodes, n_bars, n_hinges = scene.size
    h = scene.dt

    def numbers(values: np.ndarray) -> wp.array:
        return wp.array(values, dtype=wp.float64, device="cpu")

    x, v, xs, vs, sx, sv, force = (
        wp.zeros(n_nodes, dtype=wp.vec3d, device="cpu") for _ in range(7)
    )
    bars, hinges = (wp.array(t, dtype=wp.int32, device="cpu") for t in (scene.bars, scene.hinges))
    bar_tables = [numbers(t) for t in (scene.stiffness, scene.rest_length, scene.damping)]
    bend = scene.rest_angle - np.pi
    hinge_tables = [numbers(t) for t in (scene.hinge_stiffness, np.cos(bend), np.sin(bend))]
    inverse = numbers(np.where(scene.fixed, 0.0, 1.0 / scene.masses))
    drag = numbers(scene.drag)
    state = [x, v, xs, vs, sx, sv, force]

    def record(kernel: wp.Kernel, count: int, inputs: list) -> wp.Launch:
        return wp.launch(kernel, dim=count, inputs=inputs, device="cpu", record_cmd=True)

    launches = []
    for weight, share in ((h / 6, h / 2), (h / 3, h / 2), (h / 3, h), (h / 6, 0.0)):
        launches.append(record(add_bars, n_bars, [xs, vs, bars, *bar_tables, force]))
        if n_hinges:
            launches.append(record(add_hinges, n_hinges, [xs, hinges, *hinge_tables, force]))
        inputs = [share == 0.0, weight, share, inverse, drag, *state]
        launches.append(record(end_stage, n_nodes, inputs))

    def run(n_steps: int) -> np.ndarray:
        for array in (x, xs):
            array.assign(scene.positions)
        for array in (v, vs):
            array.assign(scene.velocities)
        sx.zero_()
        sv.zero_()
        force.assign(-scene.drag[:, np.newaxis] * scene.velocities)
        for _ in range(n_steps):
            for launch in launches:
                launch.launch()
        return x.numpy().copy()

    return run


if __name__ == "__main__":
    serve(prepare)
