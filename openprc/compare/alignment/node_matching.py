"""Which node of one file is which node of another: by label, by order, or by place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from openprc.compare.alignment.clocks import node_names
from openprc.compare.alignment.node_assignment import assign, nearest_distance, neighbour_distance
from openprc.compare.alignment.rigid_motion import fit_rigid_motion
from openprc.errors import ConfigError, MissingData

if TYPE_CHECKING:
    from openprc.compare.alignment.settings import AlignmentSettings
    from openprc.schema.trajectory import Trajectory

Reals = NDArray[np.float64]
Indices = NDArray[np.intp]
By = Literal["label", "index", "assignment", "pairs"]

#: Nodes of equal number are the same where they are this close, in distances to neighbours.
SAME_PLACE = 0.25
#: How many nodes are named in a sentence.
NAMED = 5


@dataclass(frozen=True)
class NodeMatch:
    """Matched nodes of two files.

    Parameters
    ----------
    by : {"label", "index", "assignment", "pairs"}
    reference, other : (n,) int
    labels : n str
        As the reference calls them; numbers where it has no labels.
    unmatched_reference, unmatched_other : tuple of str
    notes : tuple of str
    """

    by: By
    reference: Indices
    other: Indices
    labels: tuple[str, ...]
    unmatched_reference: tuple[str, ...]
    unmatched_other: tuple[str, ...]
    notes: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON output."""
        return {
            "by": self.by,
            "n_matched": len(self.labels),
            "unmatched_reference": list(self.unmatched_reference),
            "unmatched_other": list(self.unmatched_other),
        }


def match_nodes(
    reference: Trajectory,
    other: Trajectory,
    places: tuple[Reals, Reals],
    *,
    settings: AlignmentSettings,
) -> NodeMatch:
    """Match the nodes of two files.

    Parameters
    ----------
    places : (n, d) and (m, d) [unit of the comparison]
        Of all nodes of either file in the same state of the body, NaN where missing.

    Raises
    ------
    ConfigError
        When a node is named that is not there, or files have no node in common that way.
    MissingData
        When labels are asked for and a file has none.
    """
    files = (reference, other)
    names = (node_names(reference), node_names(other))
    labelled = all(t.has("/topology/nodes/label") for t in files)
    notes: list[str] = []
    if settings.pairs is not None:
        i, j = _of_pairs(files, names, settings)
        return _made("pairs", i, j, names, notes)
    if settings.match in ("auto", "label"):
        if labelled:
            i, j = _of_labels(names)
            if len(i):
                notes += _doubts(places, i, j, settings)
                return _made("label", i, j, names, notes)
            notes.append(
                f"no label is in both files ({_some(names[0])} and {_some(names[1])}), so nodes"
                " are matched by place"
            )
        if settings.match == "label":
            raise _no_labels(files, names, labelled)
    equal = len(names[0]) == len(names[1])
    if settings.match == "index":
        if not equal:
            raise ConfigError(
                f"it has {len(names[1])} nodes, and {reference.path.name} has {len(names[0])}",
                expected='as many nodes in the same order, for match="index"',
                fix='choose match="label" or "assignment", or name pairs',
                file=other.path,
                key="match",
            )
        order = np.arange(len(names[0]))
        return _made("index", order, order, names, notes)
    if settings.match == "auto" and equal and _same_order(places, settings):
        order = np.arange(len(names[0]))
        return _made("index", order, order, names, notes)
    return _by_place(files, names, places, settings, notes)


def _of_labels(names: tuple[tuple[str, ...], tuple[str, ...]]) -> tuple[Indices, Indices]:
    where = {name: number for number, name in enumerate(names[1])}
    i = np.array([n for n, name in enumerate(names[0]) if name in where], dtype=np.intp)
    j = np.array([where[name] for name in names[0] if name in where], dtype=np.intp)
    return i, j


def _of_pairs(
    files: tuple[Trajectory, Trajectory],
    names: tuple[tuple[str, ...], tuple[str, ...]],
    settings: AlignmentSettings,
) -> tuple[Indices, Indices]:
    pairs = settings.pairs or {}
    found: list[list[int]] = [[], []]
    for side, wanted in enumerate((list(pairs), list(pairs.values()))):
        for name in wanted:
            if str(name) not in names[side]:
                raise ConfigError(
                    f"there is no node {name!r}",
                    expected="nodes such as " + _some(names[side]),
                    fix="correct the pairs",
                    file=files[side].path,
                    key="pairs",
                )
            found[side].append(names[side].index(str(name)))
        if len(set(found[side])) != len(wanted) or not wanted:
            raise ConfigError(
                "a node is paired twice" if wanted else "there are no pairs",
                expected="every node once",
                fix="correct the pairs",
                file=files[side].path,
                key="pairs",
            )
    return np.array(found[0], dtype=np.intp), np.array(found[1], dtype=np.intp)


def _doubts(
    places: tuple[Reals, Reals], i: Indices, j: Indices, settings: AlignmentSettings
) -> list[str]:
    """Say when nodes of one label are somewhere else, while the order of places would fit."""
    if settings.rigid_motion != "none" or len(i) < 2:
        return []
    x, y = places[0][i], places[1][j]
    known = np.isfinite(x).all(axis=1) & np.isfinite(y).all(axis=1)
    if known.sum() < 2:
        return []
    apart = np.sqrt(((x[known] - y[known]) ** 2).sum(axis=1))
    spacing = neighbour_distance(x[known])
    if not np.median(apart) > spacing:
        return []
    text = f"nodes of one label start {float(np.median(apart)):.3g} apart (median)"
    found = assign(x[known], y[known], limit=spacing / 2, fit=False, scale=False, reflect=False)
    if len(found.reference) > 0.9 * known.sum():
        return [text + ', while places would match: the labels may count differently, try match='
                '"assignment"']  # fmt: skip
    return [text + ': a rigid motion ("first" or "all") may be wanted']


def _same_order(places: tuple[Reals, Reals], settings: AlignmentSettings) -> bool:
    """Tell whether nodes of equal number are at equal places."""
    x, y = places
    known = np.isfinite(x).all(axis=1) & np.isfinite(y).all(axis=1)
    if not known.any():
        return False
    x, y = x[known], y[known]
    if settings.rigid_motion != "none":
        motion = fit_rigid_motion(
            [(x[np.newaxis], y[np.newaxis])],
            scale=settings.scale == "fit",
            reflect=settings.reflect,
        )
        y = motion.apply(y[np.newaxis])[0]
    apart = np.sqrt(((x - y) ** 2).sum(axis=1))
    return bool(apart.max() <= SAME_PLACE * neighbour_distance(x))


def _by_place(
    files: tuple[Trajectory, Trajectory],
    names: tuple[tuple[str, ...], tuple[str, ...]],
    places: tuple[Reals, Reals],
    settings: AlignmentSettings,
    notes: list[str],
) -> NodeMatch:
    seen = [np.flatnonzero(np.isfinite(p).all(axis=1)) for p in places]
    for side in (0, 1):
        if not len(seen[side]):
            raise MissingData(
                "no node is seen at the first common instant",
                expected="places to match nodes by",
                fix='start later, or choose match="label" or "index"',
                file=files[side].path,
                key="match",
            )
    x, y = (p[s] for p, s in zip(places, seen, strict=True))
    fit = settings.rigid_motion != "none"
    # Of the denser body: a sparse one would take any node of it for its own.
    spacing = min(neighbour_distance(p) for p in ((x,) if settings.scale == "fit" else (x, y)))
    limit = settings.match_limit or spacing / 2
    found = assign(
        x, y, limit=limit, fit=fit, scale=settings.scale == "fit", reflect=settings.reflect
    )
    if not len(found.reference):
        raise ConfigError(
            f"no node of it is within {limit:.3g} of a node of {files[0].path.name}; the nearest"
            f" pair is {nearest_distance(x, y):.3g} apart",
            expected="nodes of one body at about the same places",
            fix='let rigid_motion="first" bring the bodies together, raise match_limit, or name'
            " pairs",
            file=files[1].path,
            key="match",
        )
    i, j = seen[0][found.reference], seen[1][found.other]
    order = np.argsort(i)
    if len(found.ambiguous):
        named = _some([names[0][k] for k in seen[0][found.ambiguous]])
        notes.append(
            f"{len(found.ambiguous)} nodes have a second candidate within {limit:.3g}: {named}"
        )
    if found.placements > 1:
        notes.append(
            f"the body fits in {found.placements} ways equally well, as a symmetric one does:"
            " which node is which cannot be told from places"
        )
    fewer = min(len(x), len(y))
    if 2 * len(i) < fewer:
        notes.append(
            f"only {len(i)} of {fewer} nodes have a counterpart within {limit:.3g}: the bodies may"
            " be laid onto each other wrongly; labels or pairs settle that"
        )
    for side in (0, 1):
        unseen = len(names[side]) - len(seen[side])
        if unseen:
            notes.append(
                f"{files[side].path.name}: {unseen} nodes are not seen at the first common"
                " instant and stay unmatched"
            )
    return _made("assignment", i[order], j[order], names, notes)


def _made(
    by: By,
    i: Indices,
    j: Indices,
    names: tuple[tuple[str, ...], tuple[str, ...]],
    notes: list[str],
) -> NodeMatch:
    taken = (set(i.tolist()), set(j.tolist()))
    left = [
        tuple(name for number, name in enumerate(names[side]) if number not in taken[side])
        for side in (0, 1)
    ]
    labels = tuple(names[0][k] for k in i)
    return NodeMatch(by, i, j, labels, left[0], left[1], tuple(notes))


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + more


def _no_labels(
    files: tuple[Trajectory, Trajectory],
    names: tuple[tuple[str, ...], tuple[str, ...]],
    labelled: bool,
) -> MissingData | ConfigError:
    if labelled:
        return ConfigError(
            f"none of its labels ({_some(names[1])}) is in {files[0].path.name}"
            f" ({_some(names[0])})",
            expected="labels that both files have",
            fix='choose match="assignment" or "index", or name pairs',
            file=files[1].path,
            key="match",
        )
    bare = next(t for t in files if not t.has("/topology/nodes/label"))
    return MissingData(
        "its nodes have no labels",
        expected='labels in both files, for match="label"',
        fix='choose match="assignment" or "index", or name pairs',
        file=bare.path,
        key="/topology/nodes/label",
    )


__all__ = ["By", "NodeMatch", "match_nodes"]
