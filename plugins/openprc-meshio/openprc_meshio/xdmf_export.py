"""simulation.h5 to an XDMF sidecar that points into it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO
from xml.sax.saxutils import escape, quoteattr

from openprc.errors import ConfigError
from openprc_meshio.export_fields import Field, Outline, outline

if TYPE_CHECKING:
    from openprc.schema import Trajectory

_TYPES = {"f8": ("Float", 8), "f4": ("Float", 4), "i4": ("Int", 4), "u1": ("UChar", 1)}
_GEOMETRY = {2: "XY", 3: "XYZ"}


class XdmfExporter:
    """Writes XML only: every number stays where it is, in the trajectory.

    Each frame takes its rows of the datasets with a HyperSlab item. Bars are a grid of
    polylines and faces a grid of triangles; where there are both, a frame is a spatial
    collection of the two. Without elements the nodes themselves are shown.
    """

    def export(
        self, trajectory: Trajectory, path: Path, *, options: Mapping[str, Any]
    ) -> list[Path]:
        """Write the sidecar of every ``options["stride"]``-th frame to `path`.

        Raises
        ------
        MissingData
            When there are no positions, or a field that is asked for is not there.
        ConfigError
            When an option is wrong, or the trajectory cannot be named from where the sidecar
            will be.
        """
        given = outline(trajectory, options)
        heavy = _reference(trajectory.path, Path(options.get("final") or path))
        with path.open("x", encoding="utf-8", newline="\n") as stream:
            _write(stream, trajectory, given, heavy)
        return [path]


def _reference(target: Path, sidecar: Path) -> str:
    """Return the name of the trajectory as seen from the folder of the sidecar."""
    real = target.resolve()
    try:
        name = os.path.relpath(real, sidecar.parent.resolve())
    except ValueError as error:  # two drives of Windows
        raise ConfigError(
            f"no relative path leads to {real} from there",
            expected="the sidecar on the drive of the trajectory",
            fix="write it beside the trajectory, or export vtkhdf, which copies the numbers",
            file=sidecar,
            key="out",
        ) from error
    name = name.replace(os.sep, "/")
    if ":" in name or name != name.strip() or not name.isprintable():
        raise ConfigError(
            f"the trajectory is named {name!r} from there",
            expected="a path without ':' (XDMF ends a file name there), control characters, or "
            "blanks at its ends",
            fix="rename the file or folder, or export vtkhdf, which copies the numbers",
            file=sidecar,
            key="out",
        )
    return name


@dataclass(frozen=True)
class _Part:
    """One grid of a frame: what connects the nodes, and which cell data it carries."""

    name: str
    topology: str
    fields: tuple[Field, ...]


def _write(stream: TextIO, trajectory: Trajectory, given: Outline, heavy: str) -> None:
    name = escape(heavy)
    parts = list(_parts(given, name))
    stream.write('<?xml version="1.0" encoding="utf-8"?>\n<Xdmf Version="3.0">\n <Domain>\n')
    for key, value in given.remarks.items():
        stream.write(f"  <Information Name={quoteattr(key)} Value={quoteattr(value)}/>\n")
    # Places are named here and referred to below: VTK tells frames apart by the text inside the
    # item of a geometry, and complains about one that only has other items in it.
    for row in given.frames:
        stream.write(f"  {_slab(given.positions, row, name, title=f'places {row}')}\n")
    stream.write('  <Grid Name="trajectory" GridType="Collection" CollectionType="Temporal">\n')
    times = trajectory.time
    geometry = _GEOMETRY[given.dims]
    for row in given.frames:
        clock = f'<Time Value="{float(times[row])!r}"/>'
        place = (
            f'<Geometry GeometryType="{geometry}"><DataItem Reference="XML">'
            f'/Xdmf/Domain/DataItem[@Name="places {row}"]</DataItem></Geometry>'
        )
        nodal = "".join(_attribute(field, "Node", row, name) for field in given.nodal)
        if len(parts) > 1:
            stream.write(
                f'   <Grid Name="frame {row}" GridType="Collection" CollectionType="Spatial">'
                f"{clock}\n"
            )
        for part in parts:
            label = part.name if len(parts) > 1 else f"frame {row}"
            stream.write(
                f'   <Grid Name="{label}" GridType="Uniform">{"" if len(parts) > 1 else clock}'
                f"{part.topology}{place}{nodal}"
            )
            for field in part.fields:
                stream.write(_attribute(field, "Cell", row, name))
            stream.write("</Grid>\n")
        if len(parts) > 1:
            stream.write("   </Grid>\n")
    stream.write("  </Grid>\n </Domain>\n</Xdmf>\n")


def _parts(given: Outline, name: str) -> Iterator[_Part]:
    for kind, shape, width in (("bars", "Polyline", 2), ("faces", "Triangle", 3)):
        count = given.elements.get(kind, 0)
        if count:
            item = (
                f'<DataItem Format="HDF" NumberType="Int" Precision="4" '
                f'Dimensions="{count} {width}">{name}:/topology/{kind}/indices</DataItem>'
            )
            topology = (
                f'<Topology TopologyType="{shape}" NumberOfElements="{count}" '
                f'NodesPerElement="{width}">{item}</Topology>'
            )
            yield _Part(kind, topology, given.cell.get(kind, ()))
    if not any(given.elements.values()):
        numbers = " ".join(map(str, range(given.n_nodes)))
        item = (
            f'<DataItem Format="XML" NumberType="Int" Dimensions="{given.n_nodes} 1">'
            f"{numbers}</DataItem>"
        )
        topology = (
            f'<Topology TopologyType="Polyvertex" NumberOfElements="{given.n_nodes}" '
            f'NodesPerElement="1">{item}</Topology>'
        )
        yield _Part("nodes", topology, ())


def _attribute(field: Field, centre: str, row: int, name: str) -> str:
    width = field.shape[2] if len(field.shape) == 3 else 1
    kind = {1: "Scalar", 2: "Vector", 3: "Vector", 6: "Tensor6", 9: "Tensor"}.get(width, "Matrix")
    return (
        f'<Attribute Name={quoteattr(field.name)} AttributeType="{kind}" Center="{centre}">'
        f"{_slab(field, row, name)}</Attribute>"
    )


def _slab(field: Field, row: int, name: str, *, title: str = "") -> str:
    """Return the item that takes row `row` of a dataset: start, stride, count."""
    named = f'Name="{title}" ' if title else ""
    rank = len(field.shape)
    inner = " ".join(map(str, field.shape[1:]))
    numbers = f"{row} {'0 ' * (rank - 1)}{'1 ' * rank}1 {inner}"
    number, precision = _TYPES[field.dtype]
    whole = " ".join(map(str, field.shape))
    return (
        f'<DataItem {named}ItemType="HyperSlab" Dimensions="{inner}">'
        f'<DataItem Format="XML" NumberType="Int" Dimensions="3 {rank}">{numbers}</DataItem>'
        f'<DataItem Format="HDF" NumberType="{number}" Precision="{precision}" '
        f'Dimensions="{whole}">{name}:{escape(field.path)}</DataItem></DataItem>'
    )
