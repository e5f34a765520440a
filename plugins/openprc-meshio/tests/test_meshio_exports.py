"""What the exporters write, looked at without VTK, and read back by the importer."""

from __future__ import annotations

import re
import shutil
from xml.etree import ElementTree

import h5py
import numpy as np
import pytest

from openprc.errors import ConfigError, MissingData
from openprc.hooks import export_file
from openprc.schema import Provenance, Trajectory, TrajectoryWriter

FORMATS = ("xdmf", "vtkhdf")


@pytest.fixture
def export(tmp_path):
    def run(path, name, **options):
        return export_file(path, tmp_path / name, options=options)[0]

    return run


# --- XDMF ---


def test_a_sidecar_copies_nothing(trajectory, export, tmp_path):
    path = trajectory()
    before = path.read_bytes()
    sidecar = export(path, "run.xdmf")
    assert sorted(item.name for item in tmp_path.iterdir()) == ["run.h5", "run.xdmf"]
    assert path.read_bytes() == before
    root = ElementTree.parse(sidecar).getroot()
    heavy = [item for item in root.iter("DataItem") if item.get("Format") == "HDF"]
    assert {item.text.partition(":")[0] for item in heavy} == {"run.h5"}
    with h5py.File(path) as file:
        for item in heavy:
            data = file[item.text.partition(":")[2]]
            assert item.get("Dimensions") == " ".join(map(str, data.shape))
            assert int(item.get("Precision")) == data.dtype.itemsize
    # Every number of the text is a selection, none is data.
    light = [item for item in root.iter("DataItem") if item.get("Format") == "XML"]
    assert {tuple(item.get("Dimensions").split()[:1]) for item in light} == {("3",)}


def test_slabs_select_the_rows_that_they_should(trajectory, export):
    path = trajectory(frames=7)
    root = ElementTree.parse(export(path, "run.xdmf", stride=3)).getroot()
    slabs = [item for item in root.iter("DataItem") if item.get("ItemType") == "HyperSlab"]
    rows = {int(slab[0].text.split()[0]) for slab in slabs}
    assert rows == {0, 3, 6}
    strain = [slab for slab in slabs if slab[1].text.endswith("/elements/bars/strain")]
    assert [slab[0].text for slab in strain] == [f"{k} 0 1 1 1 3" for k in (0, 3, 6)]
    assert [float(t.get("Value")) for t in root.iter("Time")] == [0.0, 0.1 * 3, 0.1 * 6]


def test_the_path_is_that_from_the_final_folder(trajectory, tmp_path):
    path = trajectory()
    target = tmp_path / "deep/below/run.xdmf"
    export_file(path, target)
    assert "../../run.h5:/time_series" in target.read_text()
    linked = tmp_path / "link"
    linked.symlink_to(tmp_path / "deep/below", target_is_directory=True)
    export_file(path, linked / "other.xdmf")
    # The system goes up from the real folder, so the link must not count.
    assert "../../run.h5:/time_series" in (linked / "other.xdmf").read_text()


def test_names_that_xdmf_cannot_hold(trajectory, export, tmp_path):
    folder = tmp_path / "12:30"
    folder.mkdir()
    shutil.move(trajectory(), folder / "run.h5")
    with pytest.raises(ConfigError, match=r"named '12:30/run\.h5' from there"):
        export(folder / "run.h5", "run.xdmf")
    # Seen from beside it there is no colon in the way.
    export_file(folder / "run.h5", folder / "run.xdmf")


def test_names_that_xml_has_to_escape(trajectory, export, load):
    path = trajectory(name="a&b<c'.h5")
    with Trajectory(path) as run:
        np.testing.assert_array_equal(
            load(export(path, "run.xdmf"), unit=None).run.positions(), run.positions()
        )


# --- VTKHDF ---


def test_the_layout_of_vtkhdf(trajectory, export):
    path = trajectory(frames=7)
    with h5py.File(export(path, "run.vtkhdf", stride=2)) as file, Trajectory(path) as run:
        root, steps = file["VTKHDF"], file["VTKHDF/Steps"]
        assert root.attrs["Type"] == b"PolyData"
        # VTK reads the type as fixed-length ASCII text only.
        assert h5py.check_string_dtype(root.attrs.get_id("Type").dtype).length == 8
        assert root.attrs["Version"].tolist() == [2, 2]
        assert steps.attrs["NSteps"] == 4
        np.testing.assert_array_equal(steps["Values"], run.time[::2])
        np.testing.assert_array_equal(steps["PointOffsets"], 4 * np.arange(4))
        assert steps["CellOffsets"].shape == steps["ConnectivityIdOffsets"].shape == (4, 4)
        np.testing.assert_array_equal(root["Points"][4:8], run.positions()[2])
        np.testing.assert_array_equal(root["PointData/velocities"][-4:], run.velocities()[6])
        assert root["Lines/Connectivity"][()].tolist() == [0, 1, 1, 2, 2, 3]
        assert root["Polygons/Offsets"][()].tolist() == [0, 3, 6]
        # Cells of all kinds share an array: bars first, then faces.
        strain = root["CellData/strain"][()].reshape(4, 5)
        np.testing.assert_array_equal(strain[:, :3], run.element("bars", "strain")[::2])
        assert np.isnan(strain[:, 3:]).all()
        area = root["CellData/area"][()].reshape(4, 5)
        np.testing.assert_array_equal(area[:, 3:], run.element("faces", "area")[::2])
        np.testing.assert_array_equal(steps["CellDataOffsets/area"], 5 * np.arange(4))


def test_memory_does_not_grow_with_the_run(trajectory, export, monkeypatch):
    """In blocks of one frame the same file comes out."""
    path = trajectory(frames=40)
    with h5py.File(export(path, "a.vtkhdf")) as whole:
        monkeypatch.setattr("openprc_meshio.vtkhdf_export._BLOCK_BYTES", 1)
        with h5py.File(export(path, "b.vtkhdf")) as single:
            for name in ("Points", "CellData/strain", "PointData/velocities"):
                np.testing.assert_array_equal(whole["VTKHDF"][name], single["VTKHDF"][name])


def test_quantities_of_one_name_and_two_shapes(tmp_path, export, load):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_nodes(3, 3, unit="m")
        writer.declare_elements("bars", [[0, 1]], series={"stress": "Pa"})
        writer.declare_elements("faces", [[0, 1, 2]], series={"stress": "Pa"}, widths={"stress": 3})
        rng = np.random.default_rng(0)
        writer.append(
            np.arange(4.0),
            positions=rng.random((4, 3, 3)),
            elements={("bars", "stress"): rng.random((4, 1)),
                      ("faces", "stress"): rng.random((4, 1, 3))},
        )  # fmt: skip
    for name in ("run.xdmf", "run.vtkhdf"):
        found = load(export(path, name), unit=None).run
        with Trajectory(path) as run:
            np.testing.assert_array_equal(
                found.element("bars", "stress"), run.element("bars", "stress")
            )
            # One array of VTK is of one width: the wider one gets a name of its own there.
            stored = "stress" if name == "run.xdmf" else "faces_stress"
            np.testing.assert_array_equal(
                found.element("faces", stored), run.element("faces", "stress")
            )


# --- both ---


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(("dims", "dtype"), [(2, "f4"), (3, "f8")])
@pytest.mark.parametrize("kinds", [(True, True), (True, False), (False, True), (False, False)])
def test_what_goes_out_comes_back(trajectory, export, load, form, dims, kinds, dtype):
    times = np.cumsum([0.0, 0.1, 0.1, 0.25, 0.1, 1.0, 1 / 3])
    path = trajectory(dims=dims, bars=kinds[0], faces=kinds[1], times=times, dtype=dtype)
    found = load(export(path, f"out.{form}"), unit=None).run
    with Trajectory(path) as run:
        np.testing.assert_array_equal(found.positions(), run.positions())
        np.testing.assert_array_equal(found.velocities(), run.velocities())
        np.testing.assert_array_equal(found.time, run.time)
        assert (found.dims, found.position_unit) == (dims, "mm")
        assert found.unit("/time_series/nodes/velocities") == "mm/s"
        assert found.element_kinds == run.element_kinds
        for kind in run.element_kinds:
            np.testing.assert_array_equal(found.indices(kind), run.indices(kind))
            assert found.element_series(kind) == run.element_series(kind)
            for name in run.element_series(kind):
                np.testing.assert_array_equal(found.element(kind, name), run.element(kind, name))
                key = f"/time_series/elements/{kind}/{name}"
                assert found.unit(key) == run.unit(key)


@pytest.mark.parametrize("form", FORMATS)
def test_missing_points_are_told_and_come_back(trajectory, export, load, form):
    path = trajectory(missing=True)
    out = export(path, f"out.{form}")
    if form == "xdmf":
        told = re.search(r'Name="openprc\.missing" Value="([^"]*)"', out.read_text())[1]
    else:
        with h5py.File(out) as file:
            told = file["VTKHDF"].attrs["openprc.missing"]
    assert told.startswith("1 of 28 places were not observed and are NaN")
    found = load(out, unit=None).run
    with Trajectory(path) as run:
        np.testing.assert_array_equal(found.observed(), run.observed())
        np.testing.assert_array_equal(found.positions(), run.positions())


@pytest.mark.parametrize("form", FORMATS)
def test_load_steps_stay_load_steps(tmp_path, export, load, form):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_time(unit="1", kind="pseudo")
        writer.declare_nodes(2, 3, unit="m")
        writer.append([1, 2, 5], positions=np.random.default_rng(0).random((3, 2, 3)))
    found = load(export(path, f"out.{form}"), unit=None).run
    assert (found.time_kind, found.time.tolist()) == ("pseudo", [1, 2, 5])


@pytest.mark.parametrize("form", FORMATS)
def test_fields_and_stride(trajectory, export, load, form):
    path = trajectory(frames=10)
    found = load(export(path, f"a.{form}", fields=["strain"], stride=4), unit=None).run
    assert not found.has("/time_series/nodes/velocities")
    assert found.element_series("bars") == ("strain",)
    assert found.n_frames == 3
    found = load(export(path, f"b.{form}", fields=["none"]), unit=None).run
    assert found.element_series("bars") == ()


@pytest.mark.parametrize("form", FORMATS)
def test_exports_that_are_refused(trajectory, export, tmp_path, form):
    path = trajectory()
    with pytest.raises(ConfigError, match="stride is 0"):
        export(path, f"a.{form}", stride=0)
    with pytest.raises(MissingData, match="no field 'stress' to export") as caught:
        export(path, f"a.{form}", fields=["stress"])
    assert "area, force, strain, velocities" in caught.value.expected
    with TrajectoryWriter(tmp_path / "c.h5", provenance=Provenance("test")) as writer:
        writer.declare_channel("light", ["light"], unit="arb")
        writer.append([0.0, 1.0], channels={"light": [[1.0], [2.0]]})
    with pytest.raises(MissingData, match="no positions"):
        export(tmp_path / "c.h5", f"a.{form}")
    assert sorted(item.name for item in tmp_path.iterdir()) == ["c.h5", "run.h5"]


def test_units_of_an_export_are_not_asked_for_again(trajectory, export, load):
    out = export(trajectory(), "out.xdmf")
    with pytest.raises(ConfigError, match="the option says 'm' and the file 'mm'"):
        load(out, unit="m")
    with pytest.raises(ConfigError, match="the option says 'ms' and the file 's'"):
        load(out, unit=None, time_unit="ms")
    with pytest.raises(ConfigError, match="the option says 'm/s' and the file 'mm/s'"):
        load(out, unit=None, velocity_unit="m/s")
