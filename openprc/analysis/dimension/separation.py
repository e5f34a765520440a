"""Separation: how far apart different inputs drive the states.

Three measures of the literature that are easily confused. `separation_ratio` and
`separation_profile` compare distances of states with distances of inputs; `class_separation`
compares classes of states with one another.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.dimension.rank_tests import checked_streams, final_states
from openprc.analysis.dimension.spectra import checked_states
from openprc.errors import TaskError


@dataclass(frozen=True)
class SeparationRatio:
    """Distances of states over distances of the inputs that led to them, over all pairs.

    Parameters
    ----------
    rms : float
        Root mean square distance of states over that of inputs, in units of state per unit of
        input. Expansion where above 1, as far as the units are the same.
    mean : float
        Mean over pairs of the ratio of the two distances.
    correlation : float
        Pearson correlation of the two distances over pairs: near 1 where similar inputs lead to
        similar states. NaN where all pairs of inputs are equally far apart, which
        `has_correlation` tells.
    n_pairs : int
    """

    rms: float
    mean: float
    correlation: float
    n_pairs: int

    @property
    def has_correlation(self) -> bool:
        """Whether distances differ between pairs, so that a correlation exists."""
        return bool(np.isfinite(self.correlation))


def separation_ratio(states: ArrayLike, streams: ArrayLike) -> SeparationRatio:
    """Compare the distances between final states with those between the input streams.

    The distance of two streams is the Euclidean one of all their symbols, that of two states
    the Euclidean one of all states: ``d_x(i, j) / d_u(i, j)``, after
    the separation ratio of Gibbons 2010, doi:10.1109/IJCNN.2010.5596307.

    Parameters
    ----------
    states : (M, N)
    streams : (M, L) or (M, L, C)

    Raises
    ------
    TaskError
        When the numbers of rows differ, or two streams are equal, so that a ratio is undefined.
    """
    values = checked_states(states)
    inputs = checked_streams(streams).reshape(len(np.asarray(streams)), -1)
    if len(values) != len(inputs):
        raise TaskError(
            f"there are {len(values)} states and {len(inputs)} streams",
            expected="one final state per stream",
            fix="pass the states that these streams led to",
            key="states",
        )
    upper = np.triu_indices(len(values), k=1)
    of_states, of_inputs = (_distances(rows)[upper] for rows in (values, inputs))
    if not of_inputs.min() > 0.0:
        raise TaskError(
            f"{np.count_nonzero(of_inputs == 0.0)} pairs of streams are equal",
            expected="streams that differ",
            fix="leave out repetitions; consistency compares those",
            key="streams",
        )
    spread = min(np.ptp(of_states), np.ptp(of_inputs))
    return SeparationRatio(
        rms=float(np.sqrt(np.mean(of_states**2) / np.mean(of_inputs**2))),
        mean=float(np.mean(of_states / of_inputs)),
        correlation=float(np.corrcoef(of_states, of_inputs)[0, 1]) if spread > 0 else float("nan"),
        n_pairs=len(of_states),
    )


def separation_profile(
    body: Any, stream: ArrayLike, *, max_delay: int, difference: float
) -> NDArray[np.float64]:
    """Return how far a change of one symbol moves the states, by its delay, (max_delay + 1,).

    Element k is ``|x - x_k| / difference``, where x is the final state after `stream`, and x_k
    that after the same stream with the symbol k steps before its end raised by `difference`.
    For a linear body ``x(t) = W x(t-1) + v u(t)`` that is ``|W^k v|`` exactly.

    Parameters
    ----------
    body : Body
        As in `openprc.analysis.dimension.rank_tests.final_states`.
    stream : (L,) or (L, C)
    max_delay : int
        Below L.
    difference : float
        In the unit of the input, added to every column of the symbol.

    Raises
    ------
    TaskError
        When `max_delay` is not within the stream, or `difference` is zero.
    """
    symbols = np.asarray(stream, dtype=np.float64)
    symbols = symbols[:, None] if symbols.ndim == 1 else symbols
    if symbols.ndim != 2 or not 0 <= max_delay < len(symbols) or not difference:
        raise TaskError(
            f"the stream has shape {np.shape(stream)}, max_delay is {max_delay} and difference "
            f"is {difference!r}",
            expected="(L,) or (L, C), a delay from 0 to L - 1, and a difference other than 0",
            fix="correct these",
            key="max_delay",
        )
    changed = np.repeat(symbols[None], max_delay + 2, axis=0)
    for k in range(max_delay + 1):
        changed[k + 1, len(symbols) - 1 - k] += difference
    states = final_states(body, changed)
    return np.linalg.norm(states[1:] - states[0], axis=1) / abs(difference)


def class_separation(states: ArrayLike, labels: ArrayLike) -> float:
    """Return the separation of classes of final states.

    ``c_d / (c_v + 1)``, where c_d is the mean distance between the centres of the n classes,
    over all n^2 ordered pairs, and c_v the mean over classes of the mean distance of a state
    from the centre of its class: Norton and Ventura 2010, Neurocomputing 73:2893.
    The 1 in the denominator makes the figure depend on the unit of the states: compare bodies
    on standardised states.

    Parameters
    ----------
    states : (M, N)
    labels : (M,)
        The class of the input that led to each state.

    Raises
    ------
    TaskError
        When there is not one label per state, or there is only one class.
    """
    values = checked_states(states)
    classes, member = np.unique(np.asarray(labels), return_inverse=True)
    if np.shape(labels) != (len(values),) or len(classes) < 2:
        raise TaskError(
            f"labels has shape {np.shape(labels)} and {len(classes)} classes, for "
            f"{len(values)} states",
            expected="one label per state, of two classes or more",
            fix="pass the class of each input",
            key="labels",
        )
    centres = np.stack([values[member == c].mean(axis=0) for c in range(len(classes))])
    between = float(_distances(centres).mean())
    from_centre = np.linalg.norm(values - centres[member], axis=1)
    within = float(np.mean([from_centre[member == c].mean() for c in range(len(classes))]))
    return between / (within + 1.0)


def _distances(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Euclidean distances of all pairs of rows, (M, M), without cancellation."""
    from scipy.spatial.distance import pdist, squareform

    return squareform(pdist(rows))
