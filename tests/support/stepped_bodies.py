"""Small bodies that can be stepped, and series for them to generate."""

import numpy as np


class Taps:
    """The last n symbols of one input, the newest first."""

    n_inputs = 1

    def __init__(self, n_states):
        self.n_states = n_states
        self.reset()

    def reset(self):
        self.state = np.zeros(self.n_states)

    def step(self, u):
        self.state = np.concatenate([u, self.state[:-1]])
        return self.state.copy()


def zero_crossings(x):
    """Return where a series crosses zero upwards, between its samples."""
    up = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    return up - x[up] / (x[up + 1] - x[up])


def mackey_glass(n, *, tau=17, substeps=10):
    """Return ``x' = 0.2 x(t - tau) / (1 + x(t - tau)^10) - 0.1 x``, sampled at unit time."""
    h, lag = 1.0 / substeps, tau * substeps
    x = np.full(n * substeps + lag, 1.2)

    def rate(now, past):
        return 0.2 * past / (1.0 + past**10) - 0.1 * now

    for i in range(lag, len(x) - 1):
        begin, end = x[i - lag], x[i - lag + 1]
        middle = 0.5 * (begin + end)
        a = rate(x[i], begin)
        b = rate(x[i] + h / 2 * a, middle)
        c = rate(x[i] + h / 2 * b, middle)
        x[i + 1] = x[i] + h / 6 * (a + 2 * b + 2 * c + rate(x[i] + h * c, end))
    return x[lag::substeps]
