"""VTK's XML files that meshio does not know: polygonal data, LZMA, newer versions."""

from __future__ import annotations

import base64
import struct
import zlib

import numpy as np
import pytest

from openprc.errors import UnreadableFile, UnsafeFile


def array(name, values, *, kind="Float64", form="ascii", text=None):
    values = np.asarray(values)
    width = values.shape[1] if values.ndim == 2 else 1
    text = " ".join(map(repr, values.reshape(-1).tolist())) if text is None else text
    return (
        f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{width}" format="{form}">'
        f"{text}</DataArray>"
    )


def polygons(places, *, time=None, head="", points=None):
    field = "" if time is None else f"<FieldData>{array('TimeValue', [time])}</FieldData>"
    ints = {"kind": "Int64"}
    return (
        f'<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian"{head}><PolyData>{field}'
        f'<Piece NumberOfPoints="{len(places)}" NumberOfLines="2" NumberOfPolys="2">'
        f"<PointData>{array('heat', places[:, 2])}</PointData>"
        f"<CellData>{array('load', [1.0, 2.0, 3.0, 4.0])}</CellData>"
        f"<Points>{points or array('Points', places)}</Points>"
        f"<Lines>{array('connectivity', [0, 1, 1, 2, 3], **ints)}"
        f"{array('offsets', [2, 5], **ints)}</Lines>"
        f"<Polys>{array('connectivity', [0, 1, 2, 0, 1, 2, 3], **ints)}"
        f"{array('offsets', [3, 7], **ints)}</Polys></Piece></PolyData></VTKFile>"
    )


@pytest.fixture
def series(tmp_path, motion):
    def write(make):
        for k, places in enumerate(motion):
            (tmp_path / f"body_{k}.vtp").write_text(make(places, k))
        return tmp_path / "body_0.vtp"

    return write


def test_polygonal_data(series, load, motion):
    found = load(series(lambda p, k: polygons(p, time=0.2 * k)), channels=["heat=K", "load=N"])
    np.testing.assert_array_equal(found.run.positions(), motion)
    np.testing.assert_array_equal(found.run.time, 0.2 * np.arange(5))
    np.testing.assert_array_equal(found.run.channel("heat"), motion[..., 2])
    # A line, a polyline of two bars, a triangle, and a quadrilateral of two triangles.
    assert found.run.indices("bars").tolist() == [[0, 1], [1, 2], [2, 3]]
    assert found.run.indices("faces").tolist() == [[0, 1, 2], [0, 1, 2], [0, 2, 3]]
    assert found.run.element("bars", "load")[0].tolist() == [1, 2, 2]
    assert found.run.element("faces", "load")[0].tolist() == [3, 4, 4]
    assert "read by this plugin itself, 5 files" in found.notes


def packed(data, *, blocks=1, promise=None):
    parts = [zlib.compress(part) for part in np.array_split(np.frombuffer(data, "u1"), blocks)]
    sizes = [len(part) for part in parts]
    head = struct.pack(f"<{3 + blocks}I", blocks, promise or len(data), 0, *sizes)
    return (base64.b64encode(head) + base64.b64encode(b"".join(parts))).decode()


@pytest.mark.parametrize("blocks", [1, 3])
def test_packed_numbers(series, load, motion, blocks):
    def make(places, k):
        text = packed(places.astype("<f8").tobytes(), blocks=blocks)
        points = array("Points", places, form="binary", text=text)
        return polygons(places, points=points, head=' compressor="vtkZLibDataCompressor"')

    np.testing.assert_array_equal(load(series(make), dt=0.1).run.positions(), motion)


def test_what_unpacks_to_more_than_it_should_is_refused(series, load):
    bomb = packed(bytes(50_000_000), promise=96)
    points = array("Points", np.zeros((4, 3)), form="binary", text=bomb)
    path = series(
        lambda p, k: polygons(p, points=points, head=' compressor="vtkZLibDataCompressor"')
    )
    with pytest.raises(UnreadableFile, match="array 'Points': buffer size"):
        load(path)


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        (("2 5<", "2 6<"), UnreadableFile, "array 'connectivity' holds 5 numbers"),
        (("2 5<", "5 2<"), UnreadableFile, "array 'connectivity' holds 5"),
        (("3 7<", "0 7<"), UnreadableFile, "offsets of Polys that leave the cells"),
        (('type="Int64"', 'type="Int63"'), UnreadableFile, "an array of type 'Int63'"),
        (('"PolyData" version', '"ImageData" version'), UnreadableFile,
         "'ImageData' with 0 pieces"),
        (('NumberOfPoints="4"', 'NumberOfPoints="9000000"'), UnsafeFile,
         "heat: claims 72,000,000 bytes"),
        (('NumberOfPoints="4"', 'NumberOfPoints="x"'), UnreadableFile, "NumberOfPoints 'x'"),
        (('Name="offsets"', 'Name="other"'), UnreadableFile, "no array offsets in Lines"),
        ((' version="1.0"', ' version="1.0" compressor="vtkLZ4DataCompressor"'), UnreadableFile,
         "packed by vtkLZ4DataCompressor"),
    ],
)  # fmt: skip
def test_damaged_files_are_named(series, load, change, error, words):
    def make(places, k):
        text = polygons(places)
        if "LZ4" in change[1]:
            text = text.replace('format="ascii">', 'format="binary">AQAAAAEAAAABAAAAAAAAAA==', 1)
        assert change[0] in text
        return text.replace(*change)

    with pytest.raises(error, match=words):
        load(series(make), channels=["heat"])


@pytest.mark.parametrize("suffix", ["vtp", "vtu"])
@pytest.mark.parametrize("mode", ["Ascii", "Binary", "Appended", "AppendedBase64"])
@pytest.mark.parametrize("packer", [None, "ZLib", "LZMA"])
def test_whatever_vtk_writes(tmp_path, load, motion, suffix, mode, packer):
    vtk = pytest.importorskip("vtk", reason="vtk is not installed")
    for k, places in enumerate(motion[:3]):
        grid = vtk.vtkPolyData() if suffix == "vtp" else vtk.vtkUnstructuredGrid()
        points = vtk.vtkPoints()
        points.SetDataTypeToDouble()
        for place in places:
            points.InsertNextPoint(place)
        grid.SetPoints(points)
        grid.Allocate(4)
        for code, ids in ((3, [0, 3]), (5, [0, 1, 2]), (5, [0, 2, 3])):
            grid.InsertNextCell(code, len(ids), ids)
        writer = (
            vtk.vtkXMLPolyDataWriter() if suffix == "vtp" else vtk.vtkXMLUnstructuredGridWriter()
        )
        writer.SetFileName(str(tmp_path / f"body_{k}.{suffix}"))
        writer.SetInputData(grid)
        getattr(writer, f"SetDataModeTo{mode.removesuffix('Base64')}")()
        writer.SetEncodeAppendedData(mode.endswith("64"))
        writer.SetCompressorType(getattr(vtk.vtkXMLWriter, (packer or "NONE").upper()))
        writer.SetHeaderTypeToUInt64() if k else writer.SetHeaderTypeToUInt32()
        writer.SetByteOrderToBigEndian() if packer is None else writer.SetByteOrderToLittleEndian()
        writer.Write()
    found = load(tmp_path / f"body_0.{suffix}")
    exact = {"rtol": 0, "atol": 0 if mode != "Ascii" else 1e-11}
    np.testing.assert_allclose(found.run.positions(), motion[:3], **exact)
    assert found.run.indices("bars").tolist() == [[0, 3]]
    assert found.run.indices("faces").tolist() == [[0, 1, 2], [0, 2, 3]]
