"""Which keys of a file belong to which rod.

Several rods share a file by a prefix or suffix (``shearable_position``, ``position_rod1``) or
by nesting (``rod1/position``). The shapes alone decide, so that `sniff` can do the same from
headers.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from openprc_pyelastica.quantities import ALIASES, QUANTITIES, canonical, preference

Shape = tuple[int, ...]

_SEPARATORS = "_-./ :"
_SPELLINGS = sorted(
    (spelling for spellings in ALIASES.values() for spelling in spellings),
    key=lambda spelling: (-len(spelling), spelling),
)


@dataclass(frozen=True)
class Grouping:
    """Keys sorted by rod.

    Parameters
    ----------
    rods : mapping of rod name to mapping of canonical name to key
        Only rods that have node positions. The rod of keys without prefix is called ``""``.
    shared : mapping of canonical name to key
        Quantities without prefix in a file whose rods all have one, such as a common time.
    extras : mapping of rod name to keys
        Everything else; ``""`` holds what belongs to no rod in particular.
    """

    rods: Mapping[str, Mapping[str, str]]
    shared: Mapping[str, str] = field(default_factory=dict)
    extras: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def split_key(key: str) -> tuple[str, str | None]:
    """Split a key into the name of its rod and the canonical quantity.

    >>> split_key("shearable_director_collection")
    ('shearable', 'directors')
    >>> split_key("position_rod1")
    ('rod1', 'position')
    >>> split_key("te")
    ('', None)
    """
    lower = key.lower()
    if canonical(lower):
        return "", canonical(lower)
    for spelling in _SPELLINGS:
        name = None
        if lower.endswith(spelling) and lower[-len(spelling) - 1] in _SEPARATORS:
            name = key[: -len(spelling) - 1]
        elif lower.startswith(spelling):
            rest = key[len(spelling) :]
            if rest[0] in _SEPARATORS:
                name = rest[1:]
            elif rest.isdigit() and len(spelling) > 1:
                name = rest
        if name is not None and name.strip(_SEPARATORS):
            return _rod_name(name), canonical(spelling)
    return "", None


def _rod_name(text: str) -> str:
    text = re.sub(r"[^\w-]+", "_", text.strip(_SEPARATORS))
    return f"rod{text}" if text.isdigit() else text


def group(
    shapes: Mapping[str, Shape], *, position: str | None = None, time: str | None = None
) -> Grouping:
    """Sort keys by rod.

    Parameters
    ----------
    shapes : mapping of key to shape
    position, time : str, optional
        Keys that the caller names for these two quantities.
    """
    found: dict[str, dict[str, str]] = {}
    loose: dict[str, list[str]] = {}
    for key in sorted(shapes, key=_order):
        name, quantity = split_key(key)
        if position is not None and quantity == "position":
            quantity = "position" if key == position else None
        if time is not None and quantity == "time":
            quantity = None
        if key == position:
            name, quantity = name if quantity else "", "position"
        elif key == time:
            name, quantity = "", "time"
        slots = found.setdefault(name, {})
        if quantity is None or not _fits(quantity, shapes[key]) or quantity in slots:
            loose.setdefault(name, []).append(key)
        else:
            slots[quantity] = key

    rods = [name for name, slots in found.items() if _is_nodal(slots, shapes)]
    if not rods:  # single points are taken only where nothing better is there
        rods = [name for name, slots in found.items() if _is_point(slots, shapes)]
    elif position is None:
        rods = [name for name in rods if not _is_point(found[name], shapes)]
    rods.sort(key=_natural)
    shared = {} if "" in rods else found.get("", {})
    extras: dict[str, tuple[str, ...]] = {name: tuple(loose.get(name, ())) for name in rods}
    stray = [key for name, slots in found.items() if name not in rods and name for key in
             (*slots.values(), *loose.get(name, ()))]  # fmt: skip
    extras[""] = (*loose.get("", ()), *sorted(stray))
    return Grouping({name: found[name] for name in rods}, shared, extras)


def _order(key: str) -> tuple[int, str]:
    # Preferred spellings come first and win their slot.
    return (preference(key) if canonical(key) else 99, key)


def _natural(name: str) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]


def _fits(quantity: str, shape: Shape) -> bool:
    if quantity == "position":
        return len(shape) == 3 or (len(shape) == 2 and shape[1] == 3)
    if quantity in ("time", "step"):
        return len(shape) <= 1
    return True


def _is_nodal(slots: Mapping[str, str], shapes: Mapping[str, Shape]) -> bool:
    return "position" in slots and len(shapes[slots["position"]]) == 3


def _is_point(slots: Mapping[str, str], shapes: Mapping[str, Shape]) -> bool:
    return "position" in slots and len(shapes[slots["position"]]) == 2


def unstack(shapes: Mapping[str, Shape]) -> dict[str, tuple[str, int]]:
    """Find arrays that stack several equal rods along axis 1, such as (T, R, 3, n).

    A callback that is handed a list of rods stores such arrays.

    Returns
    -------
    dict of new key to (key, rod)
        Empty when nothing is stacked.
    """
    counts = {
        shape[1]
        for key, shape in shapes.items()
        if canonical(key) == "position" and len(shape) == 4 and 3 in shape[2:]
    }
    if len(counts) != 1:
        return {}
    (count,) = counts
    parts: dict[str, tuple[str, int]] = {}
    for key, shape in shapes.items():
        quantity = QUANTITIES.get(canonical(key) or "")
        if quantity and len(shape) == 3 + quantity.rank and shape[1] == count:
            parts.update({f"rod{rod}/{key}": (key, rod) for rod in range(count)})
    return parts


def flat_time(shape: Shape) -> bool:
    """Tell whether times of this shape are one column or one row of them."""
    return len(shape) == 2 and 1 in shape


def coordinates(shapes: Mapping[str, Shape]) -> dict[str, tuple[str, str, str]]:
    """Find positions that are kept as three arrays x, y, z of shape (T, n).

    Returns
    -------
    dict of new key to the keys of x, y and z
    """
    found: dict[str, tuple[str, str, str]] = {}
    for key, shape in shapes.items():
        prefix = key[:-1]
        if key[-1:] not in ("x", "X") or len(shape) != 2 or prefix[-1:] not in ("", *_SEPARATORS):
            continue
        y, z = (prefix + chr(ord(key[-1]) + step) for step in (1, 2))
        if shapes.get(y) == shapes.get(z) == shape:
            found[f"{prefix}position"] = (key, y, z)
    return found
