"""Series of mesh files through meshlane and meshio, whose habits stay inside."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest
from openprc_meshio import mesh_files
from openprc_meshio.importer import MeshSeriesImporter

from openprc.errors import (
    ConfigError,
    MissingDependency,
    NotATrajectory,
    SchemaError,
    UnreadableFile,
)

READERS = [name for name in mesh_files.READERS if mesh_files.find_spec(name)]
LINES = np.array([[0, 3], [1, 2]])
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])

if not READERS:
    pytest.skip("neither meshlane nor meshio is installed", allow_module_level=True)


@pytest.fixture(params=READERS)
def reader(request):
    return request.param


@pytest.fixture
def package():
    return mesh_files.load_reader()


@pytest.fixture
def series(tmp_path, package, motion):
    """Write numbered files; return the folder."""

    def write(suffix, *, numbers=None, places=motion, cells=None, form=None, **fields):
        folder = tmp_path / "series"
        folder.mkdir(exist_ok=True)
        numbers = range(len(places)) if numbers is None else numbers
        for number, points in zip(numbers, places, strict=True):
            data = package.Mesh(
                points, cells or [("line", LINES), ("triangle", TRIANGLES)],
                point_data={name: values[number] for name, values in fields.items()},
            )  # fmt: skip
            data.write(folder / f"body_{number:04d}{suffix}", file_format=form)
        return folder

    return write


@pytest.mark.parametrize(
    ("suffix", "form"),
    [(".vtu", None), (".vtk", None), (".msh", "gmsh22"), (".inp", "abaqus"), (".mesh", None),
     (".vol", None)],
)  # fmt: skip
def test_numbered_files_of_many_formats(series, load, motion, suffix, form, reader):
    folder = series(suffix, form=form)
    found = load(folder, reader=reader, dt=0.5)
    # Text formats print 16 digits behind the point; what is lost is below 1e-16 of the places.
    np.testing.assert_allclose(found.run.positions(), motion, rtol=0, atol=3e-16)
    np.testing.assert_array_equal(found.run.indices("bars"), LINES)
    np.testing.assert_array_equal(found.run.indices("faces"), TRIANGLES)
    np.testing.assert_array_equal(found.run.time, 0.5 * np.arange(5))
    assert f"read by {reader} " in found.notes
    assert MeshSeriesImporter().sniff(folder) == 0.7
    first = folder / f"body_0000{suffix}"
    assert MeshSeriesImporter().sniff(first) == 0.7
    by_file = load(first)
    assert by_file.run.time_kind == "pseudo"
    assert len(by_file.run.provenance["inputs"]) == 5


def test_numbers_in_names_are_load_steps(series, load):
    folder = series(".vtu", numbers=[0, 20, 40, 60, 80])
    found = load(folder)
    assert (found.run.time_kind, found.run.time.tolist()) == ("pseudo", [0, 20, 40, 60, 80])
    assert "load steps, the number of the file" in found.notes
    assert load(folder, dt=0.1).run.time[1] == 0.1
    (folder / "body_0040.vtu").unlink()
    with pytest.raises(ConfigError, match=r"numbered \.\.\., 20, 60, and before that every 20"):
        load(folder, dt=0.1)


def test_a_list_gives_the_times(series, load, motion):
    folder = series(".vtu")
    rows = "".join(
        f'<DataSet timestep="{0.25 * k}" part="0" file="body_{k:04d}.vtu"/>'
        for k in (2, 0, 1, 3, 4)
    )
    (folder / "run.pvd").write_text(
        f'<?xml version="1.0"?><VTKFile type="Collection"><Collection>{rows}</Collection></VTKFile>'
    )
    for path in (folder / "run.pvd", folder):
        found = load(path)
        np.testing.assert_array_equal(found.run.positions(), motion)
        np.testing.assert_array_equal(found.run.time, 0.25 * np.arange(5))
    assert MeshSeriesImporter().sniff(folder / "run.pvd") == 1.0


def test_the_list_that_paraview_writes(series, load, motion):
    folder = series(".vtu")
    rows = [{"name": f"body_{k:04d}.vtu", "time": 0.5 * k} for k in (1, 0, 2)]
    path = folder / "body.vtu.series"
    path.write_text(json.dumps({"file-series-version": "1.0", "files": rows}))
    assert MeshSeriesImporter().sniff(path) == 1.0
    found = load(path)
    np.testing.assert_array_equal(found.run.positions(), motion[:3])
    np.testing.assert_array_equal(found.run.time, [0.0, 0.5, 1.0])
    for text, words in (
        ('{"files": 3}', "no list of files: TypeError"),
        ("{", "no list of files: JSONDecodeError"),
        ('{"files": [{"name": "body_0000.vtu", "time": "x"}]}', "data set 0 is at time 'x'"),
    ):
        path.write_text(text)
        with pytest.raises(UnreadableFile, match=words):
            load(path)


@pytest.mark.parametrize(
    ("rows", "error", "words"),
    [
        ('<DataSet timestep="0" file="body_0000.vtu"/>', NotATrajectory, "it lists 1 files"),
        ('<DataSet timestep="x" file="body_0000.vtu"/>', UnreadableFile, "set 0 is at time 'x'"),
        ('<DataSet timestep="1" file="body_0000.vtu"/><DataSet timestep="1" file="body_0001.vtu"/>',
         UnreadableFile, "body_0000.vtu and body_0001.vtu are both at time 1"),
        ('<DataSet timestep="1" file="a.pvtu"/><DataSet timestep="2" file="b.pvtu"/>',
         UnreadableFile, "it lists a.pvtu"),
        ('<DataSet timestep="1" file="gone.vtu"/>', UnreadableFile, "'gone.vtu', which is not"),
    ],
)  # fmt: skip
def test_lists_that_are_refused(series, load, rows, error, words):
    folder = series(".vtu")
    for name in ("a.pvtu", "b.pvtu"):
        (folder / name).write_text("<VTKFile/>")
    (folder / "run.pvd").write_text(f"<VTKFile><Collection>{rows}</Collection></VTKFile>")
    with pytest.raises(error, match=words):
        load(folder / "run.pvd")


@pytest.mark.parametrize(
    ("suffix", "form"), [(".msh", "gmsh22"), (".inp", "abaqus"), (".vtu", None)]
)
def test_a_single_mesh_is_one_instant(series, load, motion, suffix, form):
    folder = series(suffix, places=motion[:1], form=form)
    with pytest.raises(NotATrajectory, match="a single mesh: one instant, and no motion"):
        load(folder / f"body_0000{suffix}")
    with pytest.raises(NotATrajectory, match="no series of numbered mesh files"):
        load(folder)


def test_two_series_in_a_folder(series, load):
    folder = series(".vtu")
    for k in range(3):
        (folder / f"other_{k}.vtu").write_bytes((folder / f"body_000{k}.vtu").read_bytes())
    with pytest.raises(ConfigError, match=r"2 series: body_0000\.vtu, other_0\.vtu"):
        load(folder)
    assert load(folder / "other_1.vtu").run.n_frames == 3


def test_two_files_of_one_number(series, load):
    folder = series(".vtu")
    (folder / "body_1.vtu").write_bytes((folder / "body_0001.vtu").read_bytes())
    with pytest.raises(ConfigError, match="have the same number"):
        load(folder)


# --- habits of the readers ---


@pytest.mark.parametrize("suffix", [".vtu", ".vtk", ".msh", ".inp", ".mesh", ".ply", ".off"])
def test_damaged_files_neither_exit_nor_print(tmp_path, load, capfd, suffix, reader):
    for k in range(2):
        (tmp_path / f"a{k}{suffix}").write_bytes(b"\x00\x01 no mesh at all\n" * 5)
    before = sorted(item.name for item in tmp_path.iterdir())
    with pytest.raises((UnreadableFile, NotATrajectory, SchemaError)) as caught:
        load(tmp_path / f"a0{suffix}", reader=reader)
    assert "SystemExit" not in str(caught.value)
    assert capfd.readouterr() == ("", "")
    assert sorted(i.name for i in tmp_path.iterdir() if i.name != "imported") == before


def test_polygonal_data_in_an_old_file_is_named_by_the_reader(tmp_path, load, capfd, reader):
    """meshio and meshlane print the reason and end the interpreter here."""
    for k in range(2):
        (tmp_path / f"a{k}.vtk").write_text(
            "# vtk DataFile Version 4.2\nx\nASCII\nDATASET POLYDATA\nPOINTS 1 double\n0 0 0\n"
        )
    with pytest.raises(UnreadableFile, match=rf"{reader} cannot read it: .*not POLYDATA"):
        load(tmp_path / "a0.vtk", reader=reader)
    assert capfd.readouterr() == ("", "")


def test_what_a_reader_says_becomes_a_note(series, load, monkeypatch, package, capfd):
    folder = series(".vtu")
    read = package.read

    def talkative(path, **options):
        print("I have seen better meshes", file=sys.stderr)
        return read(path, **options)

    monkeypatch.setattr(package, "read", talkative)
    found = load(folder)
    assert "said about body_0000.vtu: I have seen better meshes" in found.notes
    assert capfd.readouterr() == ("", "")


def test_without_any_reader(series, load, monkeypatch):
    folder = series(".vtu")
    monkeypatch.setattr(mesh_files, "find_spec", lambda name: None)
    with pytest.raises(MissingDependency, match="meshlane and meshio are not installed") as caught:
        load(folder)
    assert caught.value.fix == "pip install meshlane"
    with pytest.raises(MissingDependency, match="meshio is not installed"):
        load(folder, reader="meshio")


def test_the_one_that_is_looked_after_goes_first(monkeypatch):
    assert mesh_files.load_reader().__name__ == READERS[0]
    here = mesh_files.find_spec
    monkeypatch.setattr(mesh_files, "find_spec", lambda n: None if n == "meshlane" else here(n))
    if "meshio" in READERS:
        assert mesh_files.load_reader().__name__ == "meshio"


# --- time inside the files ---


def written_by_vtk(folder, motion, times):
    pyvista = pytest.importorskip("pyvista", reason="pyvista is not installed")
    folder.mkdir()
    for k, (places, time) in enumerate(zip(motion, times, strict=True)):
        cells = np.array([2, 0, 3, 2, 1, 2, 3, 0, 1, 2, 3, 0, 2, 3])
        grid = pyvista.UnstructuredGrid(cells, np.array([3, 3, 5, 5], "u1"), places)
        grid.field_data["TimeValue"] = [time]
        grid.save(folder / f"body_{k}.vtu")
    return folder


def test_the_time_that_vtk_writes_into_its_files(tmp_path, load, motion, reader):
    folder = written_by_vtk(tmp_path / "a", motion, 0.1 * np.arange(5))
    found = load(folder, reader=reader)
    np.testing.assert_array_equal(found.run.time, 0.1 * np.arange(5))
    np.testing.assert_array_equal(found.run.positions(), motion)
    assert "times are those in the files (TimeValue)" in found.notes
    folder = written_by_vtk(tmp_path / "b", motion, [0.0, 0.1, 0.2, 0.1, 0.4])
    with pytest.raises(UnreadableFile, match=r"frame 3 is at 0\.1 after 0\.2"):
        load(folder)
    folder = written_by_vtk(tmp_path / "c", motion, np.zeros(5))
    found = load(folder, dt=0.2)
    np.testing.assert_array_equal(found.run.time, 0.2 * np.arange(5))
    assert "do not increase and were left aside" in found.notes
