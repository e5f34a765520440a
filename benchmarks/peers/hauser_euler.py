"""Hauser's network in explicit Euler steps, rates by differences of lengths, as in the original."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np


@numba.njit(cache=True)
def _lengths(
    x: Any, bars: Any, constants: Any, rest: Any, fixed: Any, force: Any, h: float
) -> np.ndarray:
    k1, k3, d1, d3 = constants
    n_rows, n_bars = len(force), len(bars)
    x, v, pull = x.copy(), np.zeros_like(x), np.zeros_like(x)
    out, before = np.empty((n_rows, n_bars)), rest.copy()
    for t in range(n_rows):
        pull[:, 0] = force[t]
        pull[:, 1] = 0.0
        for m in range(n_bars):
            a, b = bars[m]
            dx, dy = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1]
            length = np.sqrt(dx * dx + dy * dy)
            out[t, m] = length
            s, rate = length - rest[m], (length - before[m]) / h
            before[m] = length
            tension = k1[m] * s + k3[m] * s**3 + d1[m] * rate + d3[m] * rate**3
            fx, fy = tension * dx / length, tension * dy / length
            pull[a, 0] += fx
            pull[a, 1] += fy
            pull[b, 0] -= fx
            pull[b, 1] -= fy
        for i in range(len(x)):
            if not fixed[i]:
                for c in range(2):
                    x[i, c] += h * v[i, c]
                    v[i, c] += h * pull[i, c]  # all masses are 1 kg
    return out


def euler_lengths(experiment: Any) -> np.ndarray:
    """Return the lengths of all bars at every frame, (T, M) [m], one step a frame."""
    geometry, bars = experiment.geometry, experiment.geometry.bars
    force = np.zeros((experiment.n_frames, geometry.n_nodes))
    for actuator in experiment.actuators:
        force[:, actuator.node] = experiment.signals[actuator.signal].values[:, 0]
    constants = (bars.stiffness, bars.stiffness_cubic, bars.damping, bars.damping_cubic)
    lengths: np.ndarray = _lengths(
        np.ascontiguousarray(geometry.positions[:, :2]),
        np.ascontiguousarray(bars.indices),
        tuple(np.ascontiguousarray(c) for c in constants),
        np.ascontiguousarray(bars.rest_length),
        np.ascontiguousarray(geometry.fixed),
        force,
        experiment.save_interval,
    )
    return lengths
