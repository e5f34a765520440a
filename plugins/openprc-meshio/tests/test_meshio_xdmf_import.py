"""XDMF time series as the programs around write them; every number is compared."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from openprc.errors import ConfigError, NotATrajectory, UnreadableFile

FENICS = '<?xml version="1.0"?>\n<!DOCTYPE Xdmf SYSTEM "Xdmf.dtd" []>\n'
POINTS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])


def heavy(shape, inner, *, name="run.h5", number="Float", precision=8):
    size = " ".join(map(str, shape))
    return (
        f'<DataItem Dimensions="{size}" NumberType="{number}" Precision="{precision}" '
        f'Format="HDF">{name}:{inner}</DataItem>'
    )


def test_one_mesh_in_the_first_step_as_fenics_writes_it(tmp_path, load, motion):
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["Mesh/0/mesh/topology"] = TRIANGLES.astype("u4")
        file["Mesh/0/mesh/geometry"] = POINTS[:, :2]
        for k, places in enumerate(motion):
            file[f"VisualisationVector/{k}"] = places - POINTS
    mesh = (
        '<Topology NumberOfElements="2" TopologyType="Triangle" NodesPerElement="3">'
        + heavy((2, 3), "/Mesh/0/mesh/topology", number="UInt", precision=4)
        + '</Topology><Geometry GeometryType="XY">'
        + heavy((4, 2), "/Mesh/0/mesh/geometry")
        + "</Geometry>"
    )
    point_at = (
        '<xi:include xpointer="xpointer(//Grid[@Name=&quot;TimeSeries_f&quot;]/Grid[1]'
        '/*[self::Topology or self::Geometry])" />'
    )
    steps = [
        f'<Grid Name="mesh" GridType="Uniform">{point_at if k else mesh}<Time Value="{0.5 * k}" />'
        '<Attribute Name="displacement" AttributeType="Vector" Center="Node">'
        + heavy((4, 3), f"/VisualisationVector/{k}")
        + "</Attribute></Grid>"
        for k in range(5)
    ]
    path = tmp_path / "run.xdmf"
    path.write_text(
        FENICS + '<Xdmf Version="3.0" xmlns:xi="https://www.w3.org/2001/XInclude"><Domain>'
        '<Grid Name="TimeSeries_f" GridType="Collection" CollectionType="Temporal">'
        + "".join(steps)
        + "</Grid></Domain></Xdmf>"
    )
    found = load(path)
    # A plate that leaves its plane: the third component of the field counts.
    np.testing.assert_array_equal(found.run.positions(), motion)
    np.testing.assert_array_equal(found.run.time, 0.5 * np.arange(5))
    np.testing.assert_array_equal(found.run.indices("faces"), TRIANGLES)
    np.testing.assert_array_equal(found.run.node("rest"), POINTS)
    assert "'displacement' was taken as the displacement, by its name" in found.notes
    assert [row["name"] for row in found.run.provenance["inputs"]] == ["run.xdmf", "run.h5"]


def test_two_functions_on_one_mesh_as_dolfinx_writes_them(tmp_path, load, motion):
    flat = motion.copy()
    flat[..., 2] = 0.0
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["Mesh/mesh/topology"], file["Mesh/mesh/geometry"] = TRIANGLES, POINTS[:, :2]
        for k, places in enumerate(flat):
            file[f"Function/u/{k}"], file[f"Function/v/{k}"] = places - POINTS, 2 * places
    mesh = (
        '<Grid Name="mesh" GridType="Uniform"><Topology TopologyType="Triangle" '
        'NumberOfElements="2" NodesPerElement="3">'
        + heavy((2, 3), "/Mesh/mesh/topology", number="Int")
        + '</Topology><Geometry GeometryType="XY">'
        + heavy((4, 2), "/Mesh/mesh/geometry")
        + "</Geometry></Grid>"
    )
    point_at = (
        "<xi:include xpointer=\"xpointer(/Xdmf/Domain/Grid[@GridType='Uniform'][1]"
        '/*[self::Topology or self::Geometry])" />'
    )
    both = "".join(
        f'<Grid Name="{name}" GridType="Collection" CollectionType="Temporal">'
        + "".join(
            f'<Grid Name="{name}" GridType="Uniform">{point_at}<Time Value="{k}" />'
            f'<Attribute Name="{name}" AttributeType="Vector" Center="Node">'
            + heavy((4, 3), f"/Function/{name}/{k}")
            + "</Attribute></Grid>"
            for k in range(5)
        )
        + "</Grid>"
        for name in "uv"
    )
    path = tmp_path / "run.xdmf"
    path.write_text(f'{FENICS}<Xdmf Version="3.0"><Domain>{mesh}{both}</Domain></Xdmf>')
    found = load(path, velocity="v")
    # z is 0 in every frame: two dimensions were measured.
    assert found.run.dims == 2
    np.testing.assert_array_equal(found.run.positions(), flat[..., :2])
    np.testing.assert_array_equal(found.run.velocities(), 2 * flat[..., :2])
    assert found.run.unit("/time_series/nodes/velocities") == "mm/s"
    assert "z is 0 everywhere" in found.notes
    assert load(path, collection="u", dims=3).run.dims == 3
    with pytest.raises(ConfigError, match="no temporal collection 'w'"):
        load(path, collection="w")


def test_a_mesh_in_every_step(xdmf, xml, load, motion):
    steps = [f'{xml.mesh(p)}<Time Value="{k}"/>' for k, p in enumerate(motion)]
    found = load(xdmf(xml.temporal(steps)))
    np.testing.assert_array_equal(found.run.positions(), motion)
    assert not found.run.has("/topology/nodes/rest")


@pytest.mark.parametrize("form", ["HDF", "XML", "Binary"])
@pytest.mark.parametrize("package", ["meshio", "meshlane"])
def test_what_the_time_series_writers_of_meshio_write(
    tmp_path, monkeypatch, load, motion, package, form
):
    writers = pytest.importorskip(package, reason=f"{package} is not installed").xdmf
    # Its heavy file lands in the current directory, wherever the .xdmf goes.
    monkeypatch.chdir(tmp_path)
    with writers.TimeSeriesWriter("run.xdmf", data_format=form) as writer:
        writer.write_points_cells(POINTS, [("triangle", TRIANGLES.copy())])
        for k, places in enumerate(motion):
            writer.write_data(0.1 * k, point_data={"u": places - POINTS})
    before = sorted(item.name for item in tmp_path.iterdir())
    found = load(tmp_path / "run.xdmf")
    # "%.16e" of the XML mode is one digit short of what some doubles need.
    np.testing.assert_allclose(found.run.positions(), motion, rtol=0, atol=2e-16)
    if form != "XML":
        np.testing.assert_array_equal(found.run.positions(), POINTS + (motion - POINTS))
    assert sorted(item.name for item in tmp_path.iterdir()) == sorted([*before, "imported"])


def test_slabs_of_one_array_and_references(tmp_path, load, motion):
    """Numbers stand once; items point at them by HyperSlab and by Reference."""
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["places"], file["cells"] = np.repeat(motion, 2, axis=0).astype("f4"), TRIANGLES
    steps = "".join(
        f'<Grid><Time Value="{k}"/><Topology Reference="XML">/Xdmf/Domain/Topology[1]</Topology>'
        '<Geometry Type="XYZ"><DataItem ItemType="HyperSlab" Dimensions="4 3">'
        f'<DataItem Format="XML" Dimensions="3 3">{2 * k} 0 0 1 1 1 1 4 3</DataItem>'
        + heavy((10, 4, 3), "/places", precision=4)
        + "</DataItem></Geometry></Grid>"
        for k in range(5)
    )
    path = tmp_path / "run.xdmf"
    path.write_text(
        '<Xdmf Version="2.0"><Domain><Topology Type="Triangle" NumberOfElements="2">'
        + heavy((2, 3), "/cells", number="Int")
        + '</Topology><Grid GridType="Collection" CollectionType="Temporal">'
        + steps
        + "</Grid></Domain></Xdmf>"
    )
    found = load(path)
    np.testing.assert_array_equal(found.run.positions(), motion.astype("f4"))


@pytest.mark.parametrize(
    ("clock", "times"),
    [
        ('<Time TimeType="HyperSlab"><DataItem Dimensions="3">1.0 0.25 5</DataItem></Time>',
         1 + 0.25 * np.arange(5)),
        ('<Time TimeType="List"><DataItem Dimensions="5">0 1 3 4 8</DataItem></Time>',
         [0, 1, 3, 4, 8]),
    ],
)  # fmt: skip
def test_times_of_the_whole_collection(xdmf, xml, load, motion, clock, times):
    steps = xml.temporal([xml.mesh(places) for places in motion])
    text = steps.replace('CollectionType="Temporal">', f'CollectionType="Temporal">{clock}')
    found = load(xdmf(text))
    np.testing.assert_array_equal(found.run.time, times)
    assert found.run.time_kind == "physical"


def test_mixed_cells_and_columns_of_coordinates(xdmf, xml, load, motion):
    mixed = np.array([2, 2, 0, 1, 4, 0, 1, 2, 2, 3, 1, 2, 3, 5, 0, 1, 2, 3])
    steps = [
        f'<Time Value="{k}"/><Topology TopologyType="Mixed" NumberOfElements="4">'
        f'{xml.item(mixed)}</Topology><Geometry GeometryType="X_Y_Z">'
        f"{xml.item(p[:, 0])}{xml.item(p[:, 1])}{xml.item(p[:, 2])}</Geometry>"
        f"{xml.attribute('s', np.array([1.0, 2.0, 3.0, 4.0]) * k, 'Cell')}"
        for k, p in enumerate(motion)
    ]
    found = load(xdmf(xml.temporal(steps)), channels=["s=Pa"])
    np.testing.assert_array_equal(found.run.positions(), motion)
    # A line, then a polyline of three nodes, which is two bars.
    assert found.run.indices("bars").tolist() == [[0, 1], [1, 2], [2, 3]]
    assert found.run.indices("faces").tolist() == [[0, 1, 2], [0, 1, 2], [0, 2, 3]]
    np.testing.assert_array_equal(found.run.element("bars", "s")[2], [2, 6, 6])
    np.testing.assert_array_equal(found.run.element("faces", "s")[2], [4, 8, 8])
    assert found.run.unit("/time_series/elements/bars/s") == "Pa"
    assert "1 quad were split" in found.notes


def test_binary_with_an_offset_and_foreign_endianness(tmp_path, xdmf, xml, load, motion):
    (tmp_path / "heavy.bin").write_bytes(b"head" + motion.astype(">f8").tobytes())
    steps = [
        f'<Time Value="{k}"/><Topology TopologyType="Triangle">{xml.item(TRIANGLES)}</Topology>'
        '<Geometry GeometryType="XYZ"><DataItem Format="Binary" Endian="Big" Precision="8" '
        f'Seek="{4 + 96 * k}" Dimensions="4 3">heavy.bin</DataItem></Geometry>'
        for k in range(5)
    ]
    np.testing.assert_array_equal(load(xdmf(xml.temporal(steps))).run.positions(), motion)


# --- refusals ---


def test_a_mesh_at_one_instant(xdmf, xml, load):
    with pytest.raises(NotATrajectory, match="1 grids and no temporal collection"):
        load(xdmf(f"<Grid>{xml.mesh()}</Grid>"))


def test_functions_at_different_instants(xdmf, xml, load, motion):
    def steps(name, times):
        return xml.temporal(
            [f'{xml.mesh(p)}<Time Value="{t}"/>' for p, t in zip(motion, times, strict=True)],
            name=name,
        )

    path = xdmf(steps("a", range(5)) + steps("b", range(1, 6)))
    with pytest.raises(ConfigError, match="'a' and 'b' are not at the same instants"):
        load(path)
    assert load(path, collection="b").run.time[0] == 1.0


STEP = '<Time Value="{k}"/>'
CELLS = '<Topology TopologyType="Triangle"><DataItem NumberType="Int" Dimensions="1 3">0 1 2</DataItem></Topology>'  # noqa: E501
PLACES = '<Geometry><DataItem Dimensions="3 3">0 0 0 1 0 0 0 1 {k}</DataItem></Geometry>'


@pytest.mark.parametrize(
    ("step", "words"),
    [
        (STEP + CELLS, "a step has no geometry"),
        (STEP + PLACES, "a step has no topology"),
        (STEP + CELLS + PLACES.replace("0 1 {k}", "0 {k}"), "says Dimensions '3 3' and holds 8"),
        (STEP + CELLS + PLACES.replace("0 1 {k}", "0 1 x{k}"), "numbers in the text cannot be"),
        (STEP + CELLS.replace("Triangle", "3DRectMesh") + PLACES, "a topology of type '3DRectMesh"),
        (STEP + CELLS.replace("0 1 2<", "0 1 9<") + PLACES, "a triangle names node 9"),
        (STEP + CELLS.replace("Triangle", "Mixed") + PLACES, "code 0 at place 0"),
        (STEP + CELLS + PLACES.replace("<Geometry>", '<Geometry Type="ORIGIN_DXDYDZ">'),
         "a geometry of type 'ORIGIN_DXDYDZ'"),
        (STEP + CELLS + PLACES.replace("<DataItem ", '<DataItem ItemType="Function" '),
         "a data item of type 'Function'"),
        (STEP + CELLS + PLACES.replace("<DataItem ", '<DataItem Format="Magic" '),
         "a data item of format 'Magic'"),
        (STEP + CELLS + PLACES.replace("<DataItem ", '<DataItem Precision="3" '), "precision '3'"),
        (STEP + CELLS + PLACES.replace("3 3", "3 x"), "Dimensions '3 x'"),
        ('<Time Value="soon"/>' + CELLS + PLACES, "the time 'soon'"),
        (STEP + '<include xpointer="xpointer(//Mesh[1]/*)"/>', "leads nowhere"),
        (STEP + '<include xpointer="xpointer(id(7))"/>', r"a reference 'xpointer\(id\(7\)\)'"),
        (STEP + '<include href="other.xdmf"/>', "it includes the file 'other.xdmf'"),
        (STEP + CELLS + PLACES + '<Attribute Name="f" ItemType="FiniteElementFunction"/>',
         "stored as a finite element function"),
        (STEP + CELLS + PLACES + '<Attribute Name="u"><DataItem Dimensions="2">1 2</DataItem>'
         "</Attribute>", "the attribute 'u' has 2 numbers for 3 nodes"),
        (STEP + CELLS + PLACES + '<Attribute Name="u"/>', "the attribute 'u' holds nothing"),
    ],
)  # fmt: skip
def test_damaged_steps_are_named(xdmf, xml, load, step, words):
    steps = [step.format(k=k) for k in range(3)]
    with pytest.raises(UnreadableFile, match=words):
        load(xdmf(xml.temporal(steps)))


def test_a_step_without_time(xdmf, xml, load, motion):
    steps = [f'{xml.mesh(p)}<Time Value="{k}"/>' for k, p in enumerate(motion)]
    steps[3] = xml.mesh(motion[3])
    with pytest.raises(UnreadableFile, match="step 3 has no time and others have"):
        load(xdmf(xml.temporal(steps)))


def test_grids_of_a_step_with_points_of_their_own(xdmf, xml, load, motion):
    parts = "".join(f"<Grid>{xml.mesh(p)}</Grid>" for p in motion[:2])
    step = (
        f'<Grid GridType="Collection" CollectionType="Spatial"><Time Value="{{k}}"/>{parts}</Grid>'
    )
    text = (
        '<Grid GridType="Collection" CollectionType="Temporal">'
        + "".join(step.format(k=k) for k in range(3))
        + "</Grid>"
    )
    with pytest.raises(UnreadableFile, match="points of their own"):
        load(xdmf(text))


def test_a_file_that_was_cut_off(xdmf, xml, load, motion):
    path = xdmf(xml.temporal([f'{xml.mesh(p)}<Time Value="{k}"/>' for k, p in enumerate(motion)]))
    path.write_text(path.read_text()[:-40])
    with pytest.raises(UnreadableFile, match="this is not XML"):
        load(path)
