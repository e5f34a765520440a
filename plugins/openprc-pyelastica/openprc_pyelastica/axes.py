"""Which axis of a stored array holds the three components, and which the nodes.

PyElastica keeps components first, so that stacked positions are (T, 3, n). Some scripts
transpose before they save. With three nodes the shape says nothing and other arrays of the
same rod have to decide.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, SchemaError
from openprc_pyelastica.grouping import Shape
from openprc_pyelastica.quantities import QUANTITIES

Layout = Literal["3n", "n3"]

#: How closely stored lengths follow from the positions: they are half a step older.
LENGTH_TOLERANCE = 0.05
#: Cosine of the angle between an element and its tangent, at least: they are half a step apart.
ALIGNMENT = 0.9


def from_shape(shape: Shape, *, rank: int = 1) -> Layout | None:
    """Tell the layout of a stacked array from its shape, None when it does not decide.

    Parameters
    ----------
    shape : tuple
        (T, 3, n) or (T, n, 3) for vectors; (T, 3, 3, n) or (T, n, 3, 3) for `rank` 2.
    rank : int
        Number of component axes.
    """
    if len(shape) != 2 + rank:
        return None
    first = shape[1 : 1 + rank] == (3,) * rank
    last = shape[-rank:] == (3,) * rank
    if first == last:
        return None
    return "3n" if first else "n3"


def decide(arrays: Mapping[str, NDArray[np.generic]], *, axes: str, key: str) -> tuple[Layout, str]:
    """Decide the layout of one rod.

    Parameters
    ----------
    arrays : mapping of canonical name to stacked array
        At least ``position`` (T, 3, n) or (T, n, 3) [m].
    axes : {"auto", "3n", "n3"}
        What the caller says.
    key : str
        Name of the position array in the file, for messages.

    Returns
    -------
    layout : {"3n", "n3"}
    reason : str
        Empty when the shape of the positions decides by itself.

    Raises
    ------
    SchemaError
        No axis has length 3, or it is not the axis that the caller named.
    ConfigError
        Three nodes, and nothing that tells the axes apart.
    """
    shape = arrays["position"].shape
    found = from_shape(shape)
    if 3 not in shape[1:]:
        raise SchemaError(
            f"positions have shape {shape}: no axis after the first has length 3",
            expected="(T, 3, n) as PyElastica keeps them, or (T, n, 3)",
            fix="store the whole position_collection in the callback",
            key=key,
        )
    if axes != "auto":
        if found and found != axes:
            raise SchemaError(
                f"axes={axes} does not fit positions of shape {shape}",
                expected="(T, 3, n) for axes=3n, (T, n, 3) for axes=n3",
                fix=f"leave axes at auto, or say axes={found}",
                key=key,
            )
        return ("3n" if axes == "3n" else "n3"), ""
    if found:
        return found, ""
    votes = _votes(arrays)
    if len(set(votes.values())) == 1:
        layout = next(iter(votes.values()))
        return layout, f"three nodes: axes {layout} concluded from {', '.join(sorted(votes))}"
    against = f", and {', '.join(sorted(votes))} contradict each other" if votes else ""
    raise ConfigError(
        f"positions have shape {shape}: with three nodes the axes cannot be told apart{against}",
        expected="directors, sigma, tangents, kappa or lengths in the file, or the option",
        fix="say axes=3n (components first, as PyElastica keeps them) or axes=n3",
        key=key,
    )


def _votes(arrays: Mapping[str, NDArray[np.generic]]) -> dict[str, Layout]:
    """Return which layout each array speaks for; where one measures it, the shapes do not count.

    Scripts that transpose the positions often leave directors and strains as they are.
    """
    votes: dict[str, Layout] = {}
    for name, measured in (
        ("lengths", _from_lengths(arrays)),
        ("tangents", _from_tangents(arrays)),
    ):
        if measured:
            votes[name] = measured
    if votes:
        return votes
    for name, array in arrays.items():
        quantity = QUANTITIES.get(name)
        if quantity and quantity.rank and quantity.place != "node":
            layout = from_shape(array.shape, rank=quantity.rank)
            if layout:
                votes[name] = layout
    return votes


def _from_lengths(arrays: Mapping[str, NDArray[np.generic]]) -> Layout | None:
    stored = arrays.get("lengths")
    position = arrays["position"]
    if stored is None or stored.ndim != 2 or stored.shape != (len(position), 2):
        return None
    fits: list[Layout] = []
    layouts: tuple[Layout, Layout] = ("3n", "n3")
    for layout in layouts:
        derived = np.linalg.norm(np.diff(nodes_last(position, layout), axis=1), axis=2)
        if np.all(np.abs(derived - stored) <= LENGTH_TOLERANCE * np.abs(stored)):
            fits.append(layout)
    return fits[0] if len(fits) == 1 else None


def _from_tangents(arrays: Mapping[str, NDArray[np.generic]]) -> Layout | None:
    """Compare the elements with the stored tangents, or with d3, which leans by the shear."""
    stored, position = arrays.get("tangents"), arrays["position"]
    if stored is not None and stored.ndim == 3:
        tangents = canonical_order(stored, "3n", rank=1)
    elif (directors := arrays.get("directors")) is not None and directors.ndim == 4:
        tangents = canonical_order(directors, "3n", rank=2)[:, :, 2]
    else:
        return None
    if tangents.shape != (len(position), 2, 3):
        return None
    fits: list[Layout] = []
    layouts: tuple[Layout, Layout] = ("3n", "n3")
    for layout in layouts:
        arms = np.diff(nodes_last(position, layout), axis=1)
        along = np.einsum("tex,tex->te", arms, tangents)
        if np.all(along > ALIGNMENT * np.linalg.norm(arms, axis=2)):
            fits.append(layout)
    return fits[0] if len(fits) == 1 else None


def nodes_last(array: NDArray[np.generic], layout: Layout) -> NDArray[np.float64]:
    """Return vectors as (T, n, 3), whatever the layout."""
    return canonical_order(array, layout, rank=1)


def canonical_order(
    array: NDArray[np.generic], layout: Layout, *, rank: int
) -> NDArray[np.float64]:
    """Return a stacked array with components last: (T, n, 3), directors (T, n, 3, 3).

    The shape wins over `layout` where it decides: scripts that transpose the positions often
    leave the other arrays as they are.
    """
    own = from_shape(array.shape, rank=rank) or layout
    if rank and own == "3n":
        array = np.moveaxis(array, -1, 1)
    # A view of a file's own order: writing turns it, block by block.
    return np.asarray(array, dtype=np.float64)
