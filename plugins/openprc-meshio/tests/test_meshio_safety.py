"""Files are data: nothing outside the folder is read, nothing grows beyond reason."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
from openprc_meshio import mesh_files
from openprc_meshio.importer import MeshSeriesImporter
from openprc_meshio.safe_xml import inside, parse

from openprc.errors import UnreadableFile, UnsafeFile

POINTS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]])


@pytest.fixture
def pointing(xdmf, xml):
    """Write a series whose places are what a data item points at."""

    def write(text, form="HDF"):
        step = (
            '<Time Value="{k}"/><Topology TopologyType="Triangle">'
            + xml.item([[0, 1, 2]])
            + f'</Topology><Geometry><DataItem Format="{form}" Precision="8" Dimensions="3 3">'
            f"{text}</DataItem></Geometry>"
        )
        return xdmf(xml.temporal([step.format(k=k) for k in range(2)]))

    return write


@pytest.fixture
def secret(tmp_path):
    """A file that lies above the folder of the series."""
    outside = tmp_path.parent / f"{tmp_path.name}-secret.h5"
    with h5py.File(outside, "w") as file:
        file["p"] = POINTS
    yield outside
    outside.unlink()


@pytest.mark.parametrize(
    "name", ["../{}", "{absolute}", "sub/../../{}", "..\\{}", "C:{}", "file://{absolute}"]
)
@pytest.mark.parametrize("form", ["HDF", "Binary"])
def test_names_that_lead_out_of_the_folder(pointing, load, secret, name, form):
    text = name.format(secret.name, absolute=secret)
    path = pointing(f"{text}:/p" if form == "HDF" else text, form)
    with pytest.raises(UnsafeFile, match="outside its folder"):
        load(path)


def test_symbolic_links_that_lead_out(pointing, load, secret, tmp_path):
    (tmp_path / "inside.h5").symlink_to(secret)
    with pytest.raises(UnsafeFile, match=r"refers to 'inside\.h5', outside its folder"):
        load(pointing("inside.h5:/p"))


def test_a_heavy_file_that_is_not_there(pointing, load):
    with pytest.raises(UnreadableFile, match=r"refers to 'gone\.h5', which is not there") as caught:
        load(pointing("gone.h5:/p"))
    assert "the folder they were started in" in caught.value.fix


def test_a_heavy_file_in_a_folder_below(pointing, tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub/a.h5").write_bytes(b"x")
    assert inside("sub/a.h5", of=tmp_path / "run.xdmf") == (tmp_path / "sub/a.h5").resolve()


def test_hdf5_that_points_elsewhere(pointing, load, secret, tmp_path):
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["p"] = h5py.ExternalLink(str(secret), "/p")
    with pytest.raises(UnsafeFile, match="an external link into"):
        load(pointing("run.h5:/p"))


def test_hdf5_that_claims_more_than_it_holds(pointing, load, tmp_path):
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file.create_dataset("p", shape=(1 << 30, 3), chunks=(1 << 20, 3), dtype="f8")
    with pytest.raises(UnsafeFile, match=r"claims .* bytes and holds 0"):
        load(pointing("run.h5:/p"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("run.h5", r"an HDF item says 'run\.h5'"),
        ("run.h5:/nothing", "there are no numbers at '/nothing'"),
        ("run.h5:/text", "there are no numbers at '/text'"),
    ],
)
def test_heavy_items_that_name_no_numbers(pointing, load, tmp_path, text, words):
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["text"] = "words"
    with pytest.raises(UnreadableFile, match=words):
        load(pointing(text))


def test_binary_files_that_are_too_short(pointing, load, tmp_path):
    (tmp_path / "run.bin").write_bytes(bytes(71))
    with pytest.raises(UnreadableFile, match=r"run\.bin has 71 bytes"):
        load(pointing("run.bin", "Binary"))


# --- XML ---

LAUGHS = '<!DOCTYPE x [<!ENTITY a "ha"><!ENTITY b "&a;&a;">]><Xdmf>&b;</Xdmf>'
FILE = '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/hostname">]><Xdmf>&a;</Xdmf>'
PARAMETER = '<!DOCTYPE x [<!ENTITY % a SYSTEM "other.dtd"> %a;]><Xdmf/>'


@pytest.mark.parametrize("text", [LAUGHS, FILE, PARAMETER])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_entities_are_refused(tmp_path, load, text, encoding):
    path = tmp_path / "run.xdmf"
    path.write_bytes(f'<?xml version="1.0" encoding="{encoding}"?>{text}'.encode(encoding))
    with pytest.raises(UnsafeFile, match="declares or uses the XML entity"):
        load(path)


def test_entities_in_the_files_that_meshio_would_parse(tmp_path, load):
    for k in range(2):
        (tmp_path / f"a{k}.vtu").write_text(LAUGHS.replace("Xdmf", "VTKFile"))
    with pytest.raises(UnsafeFile, match="declares or uses the XML entity"):
        load(tmp_path / "a0.vtu")


def test_entities_that_a_document_type_might_declare(tmp_path, load):
    path = tmp_path / "run.xdmf"
    path.write_text('<!DOCTYPE Xdmf SYSTEM "Xdmf.dtd" []><Xdmf>&a;</Xdmf>')
    with pytest.raises(UnsafeFile, match="the XML entity 'a'"):
        load(path)


def test_nesting_beyond_reason(tmp_path, load):
    path = tmp_path / "run.xdmf"
    path.write_text("<Xdmf>" * 100 + "</Xdmf>" * 100)
    with pytest.raises(UnsafeFile, match="nested deeper than 64"):
        load(path)


def test_bytes_behind_the_head_of_a_vtk_file_are_not_parsed(tmp_path):
    path = tmp_path / "a.vtu"
    path.write_bytes(b'<VTKFile type="X"><AppendedData encoding="raw">_\x00\xff</AppendedData>')
    assert parse(path, stop_at="AppendedData").get("type") == "X"
    with pytest.raises(UnreadableFile, match="this is not XML"):
        parse(path)


def test_references_in_a_circle(xdmf, xml, load):
    circle = (
        '<DataItem Reference="XML">/Xdmf/Domain/DataItem[2]</DataItem>'
        '<DataItem Reference="XML">/Xdmf/Domain/DataItem[1]</DataItem>'
    )
    step = (
        f'<Time Value="0"/><Topology TopologyType="Triangle">{xml.item([[0, 1, 2]])}</Topology>'
        '<Geometry><DataItem Reference="XML">/Xdmf/Domain/DataItem[1]</DataItem></Geometry>'
    )
    with pytest.raises(UnreadableFile, match="references that lead to each other"):
        load(xdmf(circle + xml.temporal([step, step])))


# --- files that include others ---


@pytest.mark.parametrize(
    ("suffix", "line"),
    [(".inp", "*INCLUDE, INPUT=/etc/hostname"), (".inp", "  *Include,input=x"),
     (".bdf", "INCLUDE '/etc/hostname'")],
)  # fmt: skip
def test_mesh_files_that_include_others(tmp_path, load, suffix, line):
    for k in range(2):
        (tmp_path / f"a{k}{suffix}").write_text(f"*NODE\n1, 0., 0., 0.\n{line}\n")
    with pytest.raises(UnsafeFile, match="line 3 includes another file"):
        load(tmp_path / f"a0{suffix}")


def test_lists_that_name_files_elsewhere(tmp_path, load):
    path = tmp_path / "run.pvd"
    path.write_text(
        '<VTKFile><Collection><DataSet timestep="0" file="../a.vtu"/></Collection></VTKFile>'
    )
    with pytest.raises(UnsafeFile, match=r"refers to '\.\./a\.vtu', outside its folder"):
        load(path)


def test_formats_whose_readers_open_neighbours_are_not_offered():
    """DOLFIN XML, TetGen and OpenFOAM readers open files by names that they guess or find."""
    assert not {".xml", ".node", ".ele", ".foam"} & set(mesh_files.FORMATS)


# --- sniffing ---


@pytest.mark.parametrize(
    ("name", "content", "sureness"),
    [
        ("a.xdmf", b'<?xml version="1.0"?><Xdmf Version="3.0"><Domain/></Xdmf>', 1.0),
        ("renamed.txt", b'<?xml version="1.0"?><Xdmf Version="3.0"><Domain/></Xdmf>', 1.0),
        ("a.pvd", b'<VTKFile type="Collection" version="0.1">', 1.0),
        ("a.xdmf", b"prose", 0.3),
        ("a.vtu", b'<VTKFile type="UnstructuredGrid">', 0.7),
        ("a.vtu", b"prose", 0.3),
        ("a.vtk", b"# vtk DataFile Version 5.1", 0.7),
        ("a.msh", b"$MeshFormat\n4.1 0 8", 0.7),
        ("a.inp", b"*HEADING\n", 0.7),
        ("a.csv", b"t,x\n0,1\n", 0.0),
        ("a.h5", b"\x89HDF\r\n\x1a\n\0\0", 0.0),
        ("a.vtkhdf", b"\x89HDF\r\n\x1a\n\0\0", 0.3),
        ("a.vtu", b"", 0.3),
    ],
)
def test_sureness(tmp_path, name, content, sureness):
    path = tmp_path / name
    path.write_bytes(content)
    assert MeshSeriesImporter().sniff(path) == sureness


def test_sureness_of_folders(tmp_path):
    assert MeshSeriesImporter().sniff(tmp_path) == 0.0
    assert MeshSeriesImporter().sniff(tmp_path / "none.xdmf") == 0.0
    (tmp_path / "a.xdmf").write_text("<Xdmf/>")
    assert MeshSeriesImporter().sniff(tmp_path) == 0.7
    (tmp_path / "b.xdmf").write_text("<Xdmf/>")
    assert MeshSeriesImporter().sniff(tmp_path) == 0.3
