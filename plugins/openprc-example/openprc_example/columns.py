"""What the columns of a table mean, told from their names alone.

============================  ==================================================
name                          meaning
============================  ==================================================
``t`` or ``time``             time, in s unless the header says ``t [ms]``
``x0``, ``y0``, ``z0``        coordinates of node 0 (``x``, ``y`` without a
                              number: of the only node)
``seen0``                     1 measured, 2 filled in, 0 missing
``u``, ``u0``, ``u1``         input
``input/NAME/COLUMN``         a column of the input NAME
``NAME/COLUMN``               a column of the channel NAME
anything else                 a channel of that name
============================  ==================================================
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from openprc.errors import ConfigError, UnreadableFile
from openprc_example.table import Column

TIME_NAMES = ("t", "time")
_COORDINATE = re.compile(r"(?P<axis>[xyz])(?P<node>\d*)\Z")
_SEEN = re.compile(r"seen(?P<node>\d*)\Z")
_INPUT = re.compile(r"u\d*\Z")
_UNUSABLE = re.compile(r"[^A-Za-z0-9_.\- ]")


@dataclass
class Group:
    """Columns that belong together: their places in the table, their names, and one unit."""

    places: list[int] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    unit: str | None = None


@dataclass
class Layout:
    """The table's columns by meaning.

    ``coordinates`` maps a node number to its places for x, y and maybe z; ``seen`` maps a
    node number to one place.
    """

    time: int | None = None
    time_unit: str = "s"
    coordinates: dict[int, list[int]] = field(default_factory=dict)
    unit: str | None = None
    seen: dict[int, int] = field(default_factory=dict)
    channels: dict[str, Group] = field(default_factory=dict)
    inputs: dict[str, Group] = field(default_factory=dict)

    @property
    def dims(self) -> int:
        """2 or 3, or 0 without coordinates."""
        return len(next(iter(self.coordinates.values()), []))


def find_layout(columns: Sequence[Column], *, inputs: Sequence[str], path: Path) -> Layout:
    """Sort the columns by meaning.

    Parameters
    ----------
    columns : sequence of Column
    inputs : names of columns that are inputs whatever they are called
    path : named in errors

    Raises
    ------
    UnreadableFile
        When a node lacks a coordinate or columns that belong together differ in unit.
    ConfigError
        When `inputs` names a column that is not there.
    """
    names = [column.name for column in columns]
    for name in inputs:
        if name not in names:
            raise ConfigError(
                f"there is no column {name!r}",
                expected="one of " + ", ".join(names),
                fix="correct the option input",
                file=path,
                key="input",
            )
    layout = Layout()
    axes: dict[int, dict[str, int]] = {}
    spatial = _has_places(names)
    for place, column in enumerate(columns):
        name = column.name
        found = _COORDINATE.match(name) if spatial else None
        if name in inputs:
            _add(layout.inputs, name, name, place, column, path)
        elif name.lower() in TIME_NAMES and layout.time is None:
            layout.time, layout.time_unit = place, column.unit or "s"
        elif found:
            axes.setdefault(int(found["node"] or 0), {})[found["axis"]] = place
        elif spatial and (mark := _SEEN.match(name)):
            layout.seen[int(mark["node"] or 0)] = place
        elif _INPUT.match(name):
            _add(layout.inputs, "u", name, place, column, path)
        elif name.startswith("input/") and name.count("/") > 1:
            _, group, label = name.split("/", 2)
            _add(layout.inputs, group, label, place, column, path)
        else:
            group, _, label = name.partition("/")
            _add(layout.channels, group, label or group, place, column, path)
    _set_coordinates(layout, axes, columns, path)
    return layout


def _has_places(names: Sequence[str]) -> bool:
    # x0, x1, x2 without any y are the states of some system, and u, y its input and output.
    return any(name.startswith("x") and "y" + name[1:] in names and _COORDINATE.match(name)
               for name in names)  # fmt: skip


def _add(
    groups: dict[str, Group], name: str, label: str, place: int, column: Column, path: Path
) -> None:
    # The contract wants plain names; the label of the column stays as it is.
    name = _UNUSABLE.sub("_", name).lstrip(".- ") or "_"
    group = groups.setdefault(name, Group(unit=column.unit))
    if group.places and group.unit != column.unit:
        raise UnreadableFile(
            f"{column.name!r} is in {column.unit!r}, the columns before it in {group.unit!r}",
            expected=f"one unit for all columns of {name!r}",
            fix="correct the header, or give the column another name",
            file=path,
            key=column.name,
        )
    group.places.append(place)
    group.names.append(label)


def _set_coordinates(
    layout: Layout, axes: dict[int, dict[str, int]], columns: Sequence[Column], path: Path
) -> None:
    wanted = "xyz" if any("z" in found for found in axes.values()) else "xy"
    for node in sorted(axes):
        absent = [axis for axis in wanted if axis not in axes[node]]
        if absent:
            raise UnreadableFile(
                f"node {node} has no column {absent[0]}{node}",
                expected=f"the columns {', '.join(wanted)} for every node",
                fix="add it, or rename the columns of this node if they are no coordinates",
                file=path,
                key=f"{absent[0]}{node}",
            )
        layout.coordinates[node] = [axes[node][axis] for axis in wanted]
    places = [place for group in layout.coordinates.values() for place in group]
    units = {columns[place].unit for place in places}
    if len(units) > 1:
        raise UnreadableFile(
            f"the coordinates have several units: {', '.join(sorted(map(str, units)))}",
            expected="one unit for all coordinates",
            fix="convert the columns, or correct the header",
            file=path,
        )
    layout.unit = units.pop() if units else None
    stray = set(layout.seen) - set(layout.coordinates)
    if stray:
        raise UnreadableFile(
            f"seen{min(stray)} belongs to no node",
            expected="a column seenN only beside xN and yN",
            fix="remove it, or add the coordinates",
            file=path,
            key=f"seen{min(stray)}",
        )
