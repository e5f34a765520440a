"""The few forms of XPath that XDMF files use to point at other parts of themselves.

``/Xdmf/Domain/Grid[@GridType='Uniform'][1]/*[self::Topology or self::Geometry]`` and
``//Grid[@Name="mesh"]/Grid[1]`` are typical; anything beyond names, positions and attributes
is refused.
"""

from __future__ import annotations

import re
from xml.etree.ElementTree import Element

_STEP = re.compile(r"(?P<axis>//?)(?P<name>\*|[\w.-]+)(?P<tests>(?:\[[^\]]*\])*)")
_TEST = re.compile(r"\[([^\]]*)\]")
_ATTRIBUTE = re.compile(r"""\s*@([\w.-]+)\s*=\s*(?:"([^"]*)"|'([^']*)')\s*\Z""")
_SELF = re.compile(r"\s*self::[\w.-]+(?:\s+or\s+self::[\w.-]+)*\s*\Z")
_POINTER = re.compile(r"\s*xpointer\((.*)\)\s*\Z", re.DOTALL)


def pointer_path(text: str) -> str:
    """Return the path inside ``xpointer(...)``; a bare path is returned as it is."""
    found = _POINTER.match(text)
    return (found[1] if found else text).strip()


def select(root: Element, path: str) -> list[Element]:
    """Return the elements that an absolute path means, in order of the document.

    Raises
    ------
    ValueError
        When the path is of a form that is not known.
    """
    steps = list(_STEP.finditer(path))
    if not steps or "".join(step[0] for step in steps) != path:
        raise ValueError(path)
    document = Element("document")
    document.append(root)
    found = [document]
    for step in steps:
        parents = found if step["axis"] == "/" else [n for node in found for n in node.iter()]
        chosen: dict[int, Element] = {}
        for parent in parents:
            nodes = [node for node in parent if step["name"] in ("*", node.tag)]
            for test in _TEST.findall(step["tests"]):
                nodes = _filter(nodes, test)
            chosen.update((id(node), node) for node in nodes)
        found = list(chosen.values())
    return found


def _filter(nodes: list[Element], test: str) -> list[Element]:
    if test.strip().isdigit():
        place = int(test) - 1
        return nodes[place : place + 1] if place >= 0 else []
    if found := _ATTRIBUTE.match(test):
        wanted = found[2] if found[2] is not None else found[3]
        return [node for node in nodes if node.get(found[1]) == wanted]
    if _SELF.match(test):
        names = re.findall(r"self::([\w.-]+)", test)
        return [node for node in nodes if node.tag in names]
    raise ValueError(test)
