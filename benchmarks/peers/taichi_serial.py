"""Taichi on one thread: the whole Runge-Kutta loop in one kernel, serial by its own switch."""

import numpy as np
import taichi as ti
from engine_scenes import Scene

from peers.serving import Run, serve

# Taichi reads the annotations of its kernels as values, so they must not be postponed here.


def prepare(scene: Scene) -> Run:
    """Return a function that runs n steps."""
    ti.init(
        arch=ti.cpu,
        default_fp=ti.f64,
        cpu_max_num_threads=1,
        offline_cache=False,
        log_level=ti.ERROR,
    )
    n_nodes, n_bars, n_hinges = scene.size
    h = scene.dt

    def vectors() -> ti.MatrixField:
        return ti.Vector.field(3, ti.f64, shape=n_nodes)

    def numbers(values: np.ndarray) -> ti.ScalarField:
        # A field cannot be empty.
        field = ti.field(ti.f64, shape=max(len(values), 1))
        if len(values):
            field.from_numpy(values)
        return field

    def indices(values: np.ndarray) -> ti.MatrixField:
        field = ti.Vector.field(values.shape[1], ti.i32, shape=max(len(values), 1))
        if len(values):
            field.from_numpy(values)
        return field

    x, v, xs, vs, sx, sv, force = (vectors() for _ in range(7))
    drag = numbers(scene.drag)
    inverse_mass = numbers(np.where(scene.fixed, 0.0, 1.0 / scene.masses))
    bars, hinges = indices(scene.bars), indices(scene.hinges)
    stiffness, damping = numbers(scene.stiffness), numbers(scene.damping)
    rest_length, hinge_stiffness = numbers(scene.rest_length), numbers(scene.hinge_stiffness)
    rest_cos, rest_sin = (numbers(f(scene.rest_angle - np.pi)) for f in (np.cos, np.sin))

    # Written out as f[i] = f[i] + ...: `+=` on a field would be an atomic addition.
    @ti.func
    def add_bars():  # noqa: ANN202 - as in `advance`
        for e in range(n_bars):
            i, j = bars[e][0], bars[e][1]
            d = xs[j] - xs[i]
            length = d.norm()
            inverse = 1.0 / length
            rate = d.dot(vs[j] - vs[i]) * inverse
            tension = stiffness[e] * (length - rest_length[e]) + damping[e] * rate
            pull = (tension * inverse) * d
            force[i] = force[i] + pull
            force[j] = force[j] - pull

    @ti.func
    def add_hinges():  # noqa: ANN202 - as in `advance`
        for e in range(n_hinges):
            j, k, i, l = hinges[e][0], hinges[e][1], hinges[e][2], hinges[e][3]  # noqa: E741
            a, b, c = xs[i] - xs[j], xs[k] - xs[j], xs[k] - xs[l]
            m, n = a.cross(b), b.cross(c)
            bb = b.dot(b)
            crease = ti.sqrt(bb)
            sine, cosine = -crease * n.dot(a), -m.dot(n)
            difference = ti.atan2(
                sine * rest_cos[e] - cosine * rest_sin[e],
                cosine * rest_cos[e] + sine * rest_sin[e],
            )
            moment = -hinge_stiffness[e] * difference * crease
            fi, fl = (moment / m.dot(m)) * m, (-moment / n.dot(n)) * n
            inverse = 1.0 / bb
            p, q = a.dot(b) * inverse, c.dot(b) * inverse
            force[i] = force[i] + fi
            force[l] = force[l] + fl
            force[j] = force[j] + ((p - 1.0) * fi - q * fl)
            force[k] = force[k] + ((q - 1.0) * fl - p * fi)

    @ti.kernel
    def advance(n_steps: ti.i32):  # noqa: ANN202 - Taichi takes None for a type of result
        ti.loop_config(serialize=True)
        for _ in range(n_steps):
            for i in range(n_nodes):
                xs[i] = x[i]
                vs[i] = v[i]
                sx[i] = ti.Vector([0.0, 0.0, 0.0])
                sv[i] = ti.Vector([0.0, 0.0, 0.0])
            for stage in range(4):
                for i in range(n_nodes):
                    force[i] = -drag[i] * vs[i]
                add_bars()
                if ti.static(n_hinges > 0):
                    add_hinges()
                weight = h / 3.0
                if stage == 0 or stage == 3:
                    weight = h / 6.0
                share = 0.5 * h
                if stage == 2:
                    share = h
                for i in range(n_nodes):
                    acceleration = force[i] * inverse_mass[i]
                    sx[i] = sx[i] + weight * vs[i]
                    sv[i] = sv[i] + weight * acceleration
                    xs[i] = x[i] + share * vs[i]
                    vs[i] = v[i] + share * acceleration
            for i in range(n_nodes):
                x[i] = x[i] + sx[i]
                v[i] = v[i] + sv[i]

    def run(n_steps: int) -> np.ndarray:
        x.from_numpy(scene.positions)
        v.from_numpy(scene.velocities)
        advance(n_steps)
        return x.to_numpy()

    return run


if __name__ == "__main__":
    serve(prepare)
