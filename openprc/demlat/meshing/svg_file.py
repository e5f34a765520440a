"""Crease patterns from SVG drawings."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args
from xml.etree import ElementTree

import numpy as np

from openprc.demlat.meshing.cutting import cut_sheet
from openprc.demlat.meshing.mesh import Mesh
from openprc.demlat.meshing.mesh_text import finite, metres_per_unit, named, read_text
from openprc.demlat.meshing.parameters import between
from openprc.demlat.meshing.planar_graph import panels_of, split_crossings
from openprc.demlat.meshing.polygons import triangulate
from openprc.demlat.meshing.svg_shapes import CURVED, SHAPES, shape_lines, transform_matrix
from openprc.errors import ConfigError, OpenPRCError, UnreadableFile, UnsafeFile

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Reals = NDArray[np.float64]

LineKind = Literal["mountain", "valley", "boundary", "cut", "facet", "fold"]
LINE_KINDS: tuple[LineKind, ...] = get_args(LineKind)
#: The colours of Origami Simulator (Ghassaei, Demaine & Gershenfeld 2018, 7OSME); magenta is
#: a fold that is neither mountain nor valley.
COLOURS: Mapping[str, LineKind] = MappingProxyType(
    {
        "#ff0000": "mountain",
        "#0000ff": "valley",
        "#000000": "boundary",
        "#00ff00": "cut",
        "#ffff00": "facet",
        "#ff00ff": "fold",
    }
)
_NAMES = MappingProxyType(
    {
        "red": "#ff0000",
        "blue": "#0000ff",
        "black": "#000000",
        "lime": "#00ff00",
        "green": "#008000",
        "yellow": "#ffff00",
        "magenta": "#ff00ff",
        "fuchsia": "#ff00ff",
        "gray": "#808080",
        "grey": "#808080",
        "white": "#ffffff",
    }
)
_RGB = re.compile(r"rgb\(\s*(\d+)\s*,\s*(\d+)\s*,\s*(\d+)\s*\)")
_RULE = re.compile(r"([^{}]+)\{([^{}]*)\}")
#: Elements that draw nothing where they stand.
_HIDDEN = ("defs", "clipPath", "mask", "marker", "pattern", "symbol", "metadata")
_GROUPS = ("svg", "g", "a", "switch")
MAX_DEPTH = 64
SENSES = MappingProxyType({"mountain": -1, "valley": 1})
#: Points that are nearer than this share of the drawing are one.
TOLERANCE = 1e-5


class _Style(NamedTuple):
    stroke: str
    opacity: float
    hidden: bool


class _Line(NamedTuple):
    ends: Reals
    kind: LineKind
    opacity: float


def read_svg(
    path: str | Path,
    *,
    scale: float,
    colours: Mapping[str, LineKind] | None = None,
    fold_angle: float = 0.0,
    tolerance: float = TOLERANCE,
) -> Mesh:
    """Return the sheet of a crease pattern.

    Lines, polylines, polygons, rectangles and paths of straight lines are read, with groups,
    transforms and styles. Lines are divided where they cross. By default red lines are
    mountains, blue ones valleys, black the boundary, green (#00ff00) cuts, yellow facets and
    magenta folds. y points up in the mesh, so that the drawing is seen from above.

    Parameters
    ----------
    path : path-like
    scale : float [m]
        Length of one user unit of the drawing.
    colours : mapping of colour to kind, optional
        Colours as ``#rrggbb`` or by name, in place of the default; kinds are "mountain",
        "valley", "boundary", "cut", "facet" and "fold".
    fold_angle : float [rad]
        Mountains and valleys rest at ``pi -+ fold_angle * opacity``; 0 leaves them flat.
    tolerance : float
        Points that are nearer than this share of the drawing are one.

    Raises
    ------
    UnreadableFile, UnsafeFile
        When the file cannot be read, is no SVG, or declares a document type or entities.
    ConfigError
        For curves, colours without a kind, and lines that enclose no panels.
    """
    file, text = read_text(path)
    unit = metres_per_unit(scale, file=file)
    rest = between(fold_angle, "fold_angle", low=0.0, high=math.pi, closed=True)
    near = between(tolerance, "tolerance", low=0.0, high=0.1, unit="of the drawing")
    kinds = COLOURS if colours is None else _checked_colours(colours)
    lines = list(_lines(_root(text, file), kinds, file))
    if not lines:
        raise ConfigError(
            "no lines", expected="lines with a stroke colour", fix="draw the crease pattern",
            file=file,
        )  # fmt: skip
    try:
        return _sheet(lines, unit, rest, near)
    except OpenPRCError as error:
        raise named(error, file) from None


def _sheet(lines: list[_Line], unit: float, rest: float, near: float) -> Mesh:
    segments = np.stack([line.ends for line in lines]) * [1.0, -1.0]
    segments = segments - segments.min(axis=(0, 1))
    size = float(segments.max())
    lengths = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    keep = np.flatnonzero(lengths > near * size)
    # Where lines lie upon each other, what says more about the sheet comes first.
    rank = np.array([_RANK[lines[k].kind] for k in keep])
    keep = keep[np.argsort(rank, kind="stable")]
    points, edges, parents = split_crossings(segments[keep], tolerance=near * size)
    cut = np.array([lines[keep[parent]].kind == "cut" for parent in parents])
    panels = panels_of(points, edges)
    rims = _rims(panels)
    divided = _openable(points, edges, parents, cut, rims)
    if len(divided[0]) > len(points):
        points, edges, parents = divided
        panels = panels_of(points, edges)
        rims = _rims(panels)
    positions = np.concatenate([points * unit, np.zeros((len(points), 1))], axis=1)
    triangles, diagonals = triangulate(positions, panels)
    owner = [lines[keep[parent]] for parent in parents]
    pairs = [(int(i), int(j)) for i, j in edges]
    inner = [n for n, pair in enumerate(pairs) if pair not in rims]
    border = next((pairs[n] for n in inner if owner[n].kind == "boundary"), None)
    if border is not None:
        x, y = points[list(border)].mean(axis=0)
        raise ConfigError(
            f"a boundary line lies inside the sheet, at ({x:g}, {y:g}) from the lower left",
            expected="boundary lines around the sheet",
            fix="draw cuts in the colour of cuts",
            key="stroke",
        )
    senses = {pairs[n]: SENSES.get(owner[n].kind, 0) for n in inner}
    wanted = {
        pairs[n]: math.pi - senses[pairs[n]] * rest * owner[n].opacity
        for n in inner
        if senses[pairs[n]] and rest > 0.0
    }
    soft = [pairs[n] for n in inner if owner[n].kind == "facet"]
    facets = np.concatenate([diagonals, np.array(soft, dtype="i4").reshape(-1, 2)])
    cuts = [pairs[n] for n in inner if owner[n].kind == "cut"]
    return cut_sheet(positions, triangles, facets, cuts, senses, wanted)


def _openable(
    points: Reals,
    edges: NDArray[np.int64],
    parents: NDArray[np.int64],
    cut: NDArray[np.bool_],
    rims: set[tuple[int, int]],
) -> tuple[Reals, NDArray[np.int64], NDArray[np.int64]]:
    """Divide slits of one edge in two: they need a node between their tips to open at."""
    uses = np.bincount(edges[cut].ravel(), minlength=len(points))
    uses[np.array(list(rims)).ravel()] += 1
    alone = cut & (uses[edges] == 1).all(axis=1)
    ends = edges[alone]
    middle = len(points) + np.arange(len(ends))
    halves = [np.stack([ends[:, side], middle], axis=1) for side in range(2)]
    return (
        np.concatenate([points, points[ends].mean(axis=1)]),
        np.concatenate([edges[~alone], *halves]),
        np.concatenate([parents[~alone], parents[alone], parents[alone]]),
    )


_RANK = {kind: n for n, kind in enumerate(("cut", "boundary", "mountain", "valley", "fold"))}
_RANK["facet"] = len(_RANK)


def _rims(panels: list[list[int]]) -> set[tuple[int, int]]:
    """Return the edges, lower node first, that belong to one panel."""
    once: set[tuple[int, int]] = set()
    for panel in panels:
        for i, j in zip(panel, [*panel[1:], panel[0]], strict=True):
            once ^= {(min(i, j), max(i, j))}
    return once


def _root(text: str, file: Path) -> ElementTree.Element:
    upper = text.upper()
    if "<!ENTITY" in upper or "<!DOCTYPE" in upper:
        raise UnsafeFile(
            "the drawing declares a document type or entities",
            expected="plain SVG: entities can grow without bound, or name other files",
            fix="remove the <!DOCTYPE ...> lines; nothing in a drawing needs them",
            file=file,
        )
    try:
        root = ElementTree.fromstring(text)  # noqa: S314 - see above
    except ElementTree.ParseError as error:
        raise UnreadableFile(
            f"this is no XML: {error}", expected="an SVG drawing", file=file
        ) from None
    if _tag(root) != "svg":
        raise UnreadableFile(
            f"the root of the document is <{_tag(root)}>", expected="<svg>", file=file
        )
    return root


def _tag(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def _lines(root: ElementTree.Element, kinds: Mapping[str, LineKind], file: Path) -> Iterator[_Line]:
    rules = _class_rules(root)
    waiting = [(root, np.eye(3), _Style("none", 1.0, False), 0)]
    while waiting:
        element, outer, inherited, depth = waiting.pop()
        tag = _tag(element)
        if depth > MAX_DEPTH:
            raise UnsafeFile("groups in groups", expected=f"at most {MAX_DEPTH} levels", file=file)
        if tag in _HIDDEN:
            continue
        if tag == "use":
            raise ConfigError(
                "a <use> element",
                expected="lines drawn where they are",
                fix="unlink the clones in the drawing program",
                file=file,
            )
        style = _style(element, inherited, rules, file)
        matrix = outer @ transform_matrix(element.get("transform", ""), file)
        if tag in _GROUPS:
            waiting += [(child, matrix, style, depth + 1) for child in reversed(element)]
        elif tag in (*SHAPES, *CURVED) and not style.hidden and style.stroke != "none":
            kind = kinds.get(_colour(style.stroke))
            if kind is None:
                raise ConfigError(
                    f"lines of the colour {style.stroke!r}",
                    expected="one of " + ", ".join(f"{c} ({k})" for c, k in kinds.items()),
                    fix="say what they are: colours=",
                    file=file,
                    key="stroke",
                )
            for ends in shape_lines(tag, element.attrib, file):
                placed = np.array([[*end, 1.0] for end in ends]) @ matrix.T
                yield _Line(placed[:, :2], kind, style.opacity)


def _class_rules(root: ElementTree.Element) -> dict[str, str]:
    rules: dict[str, str] = {}
    for element in root.iter():
        if _tag(element) == "style":
            for names, body in _RULE.findall(element.text or ""):
                for name in names.split(","):
                    rules[name.strip()] = rules.get(name.strip(), "") + ";" + body
    return rules


def _style(
    element: ElementTree.Element, inherited: _Style, rules: Mapping[str, str], file: Path
) -> _Style:
    found: dict[str, str] = dict(element.attrib)
    classes = [f".{name}" for name in element.get("class", "").split()]
    bodies = [rules.get(name, "") for name in (_tag(element), *classes)]
    for body in (*bodies, element.get("style", "")):
        for part in body.split(";"):
            name, colon, value = part.partition(":")
            if colon:
                found[name.strip()] = value.replace("!important", "").strip()
    opacity = inherited.opacity
    for name in ("opacity", "stroke-opacity"):
        if name in found:
            opacity *= finite(found[name], file=file, key=name)
    hidden = found.get("display") == "none" or found.get("visibility") == "hidden"
    stroke = found.get("stroke", inherited.stroke).strip()
    stroke = inherited.stroke if stroke == "inherit" else stroke
    return _Style(stroke, opacity, inherited.hidden or hidden)


def _colour(text: str) -> str:
    """Return a colour as ``#rrggbb``, or as it is when it is of another kind."""
    colour = text.strip().lower()
    colour = _NAMES.get(colour, colour)
    if match := _RGB.fullmatch(colour):
        return "#" + "".join(f"{min(int(part), 255):02x}" for part in match.groups())
    if re.fullmatch(r"#[0-9a-f]{3}", colour):
        return "#" + "".join(2 * digit for digit in colour[1:])
    return colour


def _checked_colours(colours: Mapping[str, Any]) -> dict[str, LineKind]:
    for colour, kind in colours.items():
        if kind not in LINE_KINDS:
            raise ConfigError(
                f"the kind {kind!r} for {colour!r}",
                expected="one of " + ", ".join(LINE_KINDS),
                key="colours",
            )
    return {_colour(colour): kind for colour, kind in colours.items()}
