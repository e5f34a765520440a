"""Containers: what MATLAB and Octave write, small and by hand, and what damages them."""

from __future__ import annotations

import struct
import zlib

import h5py
import numpy as np
import pytest
from openprc_merlin import containers, mat5, samples
from openprc_merlin.importer import Importer
from openprc_merlin.mat5 import FunctionHandle
from scipy.io import savemat, whosmat

from openprc.errors import UnreadableFile, UnsafeFile


def handle_bytes(tmp_path, raw_matrix, name, text):
    """Return a function handle variable (class 16): a struct inside a matrix element."""
    inner = tmp_path / "inner.mat"
    savemat(inner, {name: {"function_handle": {"function": text}}})
    return raw_matrix(16, name, inner.read_bytes()[128:])


def opaque_bytes(raw_matrix, raw_element, name):
    """Return a MATLAB object (class 17), such as a string or a graphics handle."""
    numbers = raw_matrix(13, "", raw_element(6, np.array([0xDD000000], "<u4").tobytes()))
    return raw_matrix(17, name, raw_element(1, b"MCOS") + raw_element(1, b"string") + numbers)


# --- level 5 -----------------------------------------------------------------------------


def test_small_integers_do_not_overflow(mat, load, space):
    n = 200
    nodes = np.zeros((n, 3))
    nodes[:, 0] = np.arange(n)
    bars = np.column_stack([np.arange(1, n), np.arange(2, n + 1)])
    u = np.zeros((3 * n, 4))
    u[2::3] = np.arange(1, 5)
    path = mat(
        {
            "U_his": u,
            "LF_his": np.arange(1, 5, dtype="u1")[:, None],
            "Supp": np.array([[200, 1, 1, 1]], dtype="u1"),
            "truss": {"Node": nodes, "Bars": bars.astype("u1"), "U0": np.zeros((3 * n, 1), "i1")},
            "angles": {"fold": np.zeros((0, 4)), "bend": np.zeros((0, 4))},
        }
    )
    tr = load(path).trajectory
    assert tr.indices("bars").max() == 199
    assert np.flatnonzero(tr.node("fixed")).tolist() == [199]
    np.testing.assert_array_equal(tr.input("load").value[:, 0], range(5))


def test_function_handles_and_objects_are_stepped_over(
    mat, load, space, tmp_path, raw_matrix, raw_element
):
    plain = load(mat(space)).trajectory
    path = mat(space, name="cluttered.mat")
    clutter = handle_bytes(tmp_path, raw_matrix, "BarMater", "sf%0@(Ex)Ogden(Ex,5e3)")
    clutter += opaque_bytes(raw_matrix, raw_element, "label")
    clutter += raw_matrix(9, "", raw_element(2, bytes(48)), shape=(1, 48))
    path.write_bytes(path.read_bytes() + clutter)
    with pytest.raises(TypeError):
        whosmat(path)  # SciPy's own listing stops at the object
    listed = containers.list_variables(path)
    assert "BarMater" in listed
    assert "label" not in listed
    assert Importer().sniff(path) == 1.0
    read = containers.read(path)
    assert read.variables["BarMater"] == FunctionHandle("sf%0@(Ex)Ogden(Ex,5e3)")
    result = load(path)
    assert "skipped: label (opaque)" in result.text
    assert "C0 = 5000 from the handle" in result.text
    np.testing.assert_array_equal(result.trajectory.positions(), plain.positions())


def test_big_endian_header_is_listed(tmp_path, raw_matrix):
    payload = b"".join(
        struct.pack(">II", kind, len(body)) + body + b"\0" * (-len(body) % 8)
        for kind, body in (
            (6, struct.pack(">II", 6, 0)),
            (5, struct.pack(">ii", 1, 2)),
            (1, b"Uhis"),
            (9, struct.pack(">dd", 1, 2)),
        )
    )
    path = tmp_path / "big.mat"
    path.write_bytes(
        b"MATLAB 5.0 MAT-file".ljust(124)
        + b"\x01\x00MI"
        + struct.pack(">II", 14, len(payload))
        + payload
    )
    assert containers.list_variables(path) == {"Uhis": (1, 2)}
    np.testing.assert_array_equal(containers.read(path).variables["Uhis"], [[1, 2]])


def test_cells_structs_text_and_empties(mat):
    cells = np.empty((2, 1), dtype=object)
    cells[0, 0], cells[1, 0] = np.array([[1, 2, 3]], "u1"), np.zeros((1, 0))
    path = mat({"Panel": cells, "s": {"t": "N4B5", "z": 1 + 2j}, "many": [{"a": 1}, {"a": 2}]})
    read = containers.read(path).variables
    np.testing.assert_array_equal(read["Panel"][0], [[1, 2, 3]])
    assert read["Panel"][0].dtype == np.float64
    assert read["Panel"][1].size == 0
    assert read["s"]["t"] == "N4B5"
    assert read["s"]["z"] == 1 + 2j


def test_octave_header_without_variables_is_explained(tmp_path):
    path = tmp_path / "empty.mat"
    path.write_bytes(b"MATLAB 5.0 MAT-file, written by Octave".ljust(124) + b"\x00\x01IM")
    assert Importer().sniff(path) >= 0.5
    with pytest.raises(UnreadableFile, match=r"header and no variables \(128 bytes\)") as error:
        containers.read(path)
    assert "function handle" in str(error.value)
    assert "-hdf5" in str(error.value)


@pytest.mark.parametrize("compressed", [True, False])
def test_truncation_is_named(mat, space, tmp_path, compressed):
    whole = mat(space, do_compression=compressed).read_bytes()
    for size in (130, 200, len(whole) // 2, len(whole) - 1):
        path = tmp_path / "cut.mat"
        path.write_bytes(whole[:size])
        assert Importer().sniff(path) == 0.5  # claimed so that the user hears where it ends
        with pytest.raises(UnreadableFile, match="damaged or cut off"):
            containers.read(path)


@pytest.mark.parametrize("compressed", [True, False])
def test_flipped_bytes_give_a_named_error_or_a_readable_file(mat, tmp_path, compressed):
    space = samples.workspace(2)
    whole = bytearray(mat(space, do_compression=compressed).read_bytes())
    rng = np.random.default_rng(7)
    path, named = tmp_path / "flipped.mat", 0
    for position in rng.integers(124, len(whole), 200):
        damaged = bytearray(whole)
        damaged[position] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        Importer().sniff(path)
        try:
            containers.read(path)
        except (UnreadableFile, UnsafeFile):
            named += 1
    assert named > 50


def test_claims_beyond_compression_are_refused(tmp_path):
    body = zlib.compress(struct.pack("<II", 14, 1 << 31) + bytes(64))
    path = tmp_path / "bomb.mat"
    path.write_bytes(
        b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + struct.pack("<II", 15, len(body)) + body
    )
    with pytest.raises(UnsafeFile, match="claims 2,147,483,648 bytes"):
        containers.read(path)


def nested(raw_matrix, raw_element, member):
    """Return a struct with one field that holds `member`."""
    names = raw_element(5, struct.pack("<i", 8)) + raw_element(1, b"Node".ljust(8, b"\0"))
    return raw_matrix(2, "truss", names + member)


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda m, e: nested(m, e, m(6, "", e(0, bytes(16)))), "values have the unknown type 0"),
        (lambda m, e: nested(m, e, m(6, "", e(44, bytes(16)))), "values have the unknown type 44"),
        (lambda m, e: nested(m, e, m(6, "", b"")), "values are missing"),
        (lambda m, e: nested(m, e, m(6, "", e(9, bytes(16)), shape=(3, 3))), "cannot reshape"),
        (lambda m, e: nested(m, e, m(6, "", struct.pack("<II", 9, 99))), "an element of 99 bytes"),
        (lambda m, e: nested(m, e, e(9, bytes(8))), "member have the unknown type 9"),
        (lambda m, e: nested(m, e, m(40, "", b"")), "array class 40"),
        (lambda m, e: nested(m, e, m(6, "", e(9, b""), shape=(-1, 2))), r"dimensions \(-1, 2\)"),
        (lambda m, e: m(1, "Panel", b"", shape=(1 << 14, 1 << 14)), "268435456 members"),
    ],
)
def test_elements_that_would_end_the_process_are_named(
    tmp_path, raw_matrix, raw_element, build, words
):
    """SciPy 1.17 looks unknown types up outside its table; the interpreter does not survive."""
    path = tmp_path / "odd.mat"
    path.write_bytes(
        b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + build(raw_matrix, raw_element)
    )
    with pytest.raises(UnreadableFile, match=words):
        containers.read(path)


def test_deep_nesting_is_named(tmp_path, raw_matrix, raw_element):
    member = raw_matrix(6, "", raw_element(9, bytes(8)))
    for _ in range(40):
        member = raw_matrix(1, "", member)
    path = tmp_path / "deep.mat"
    path.write_bytes(
        b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + raw_matrix(1, "Panel", member)
    )
    with pytest.raises(UnreadableFile, match="nest deeper than 32"):
        containers.read(path)


def test_shape_beyond_the_data_is_refused(tmp_path, raw_matrix):
    path = tmp_path / "lie.mat"
    path.write_bytes(
        b"MATLAB 5.0 MAT-file".ljust(124)
        + b"\x00\x01IM"
        + raw_matrix(6, "Uhis", bytes(16), shape=(30000, 30000))
    )
    with pytest.raises(UnreadableFile, match=r"shape \(30000, 30000\)"):
        containers.read(path)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.mat", b"# Created by Octave 7.3.0\n# name: truss\n", "Octave's text format"),
        ("a.mat", b"Octave-1-L\0\0", "Octave's binary format"),
        ("a.mat", b"\x1f\x8b\x08\0rest", "gzip"),
        ("a.pkl", b"\x80\x04\x95", "pickle"),
        ("a.mat", struct.pack("<5i", 0, 2, 3, 0, 5) + b"Uhis\0" + bytes(48), "level 4"),
        ("a.mat", b"nothing of the kind", "no saved workspace"),
    ],
)
def test_other_containers_are_named(tmp_path, name, content, words):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(UnreadableFile, match=words):
        containers.read(path)


def test_octave_text_is_recognised_by_its_names(tmp_path):
    ours, other = tmp_path / "a.mat", tmp_path / "b.mat"
    ours.write_bytes(b"# Created by Octave 7.3.0\n# name: U_his\n# type: matrix\n")
    other.write_bytes(b"# Created by Octave 7.3.0\n# name: x\n# type: matrix\n")
    assert Importer().sniff(ours) == 0.5
    assert Importer().sniff(other) == 0.0


# --- HDF5 ----------------------------------------------------------------------------------


def test_v73_is_the_same_run(tmp_path, mat, load, space, write_v73):
    path = tmp_path / "v73.mat"
    write_v73(path, space)
    assert Importer().sniff(path) == 1.0
    result, plain = load(path), load(mat(space))
    one, two = result.trajectory, plain.trajectory
    np.testing.assert_array_equal(one.positions(), two.positions())
    np.testing.assert_array_equal(one.indices("hinges"), two.indices("hinges"))
    np.testing.assert_array_equal(one.indices("faces"), two.indices("faces"))
    assert "C0 = 10000 from the handle" in result.text
    assert one.element_static("hinges", "kind_code").tolist() == [1]  # bend was an empty [0, 4]


def test_v73_complex_numbers_and_null_references(tmp_path, write_v73):
    path = tmp_path / "v73.mat"
    write_v73(path, {"Uhis": np.array([[1 + 0.5j, 2.0]]), "Panel": np.empty((1, 0), object)})
    with h5py.File(path, "r+") as file:
        cells = file.create_dataset("broken", (1, 2), dtype=h5py.ref_dtype)
        cells.attrs["MATLAB_class"] = np.bytes_(b"cell")
    read = containers.read(path).variables
    np.testing.assert_array_equal(read["Uhis"], [[1 + 0.5j, 2.0]])
    assert read["broken"] == [None, None]


def test_circular_references_end(tmp_path):
    path = tmp_path / "loop.mat"
    with h5py.File(path, "w") as file:
        cells = file.create_dataset("Panel", (1, 2), dtype=h5py.ref_dtype)
        cells.attrs["MATLAB_class"] = np.bytes_(b"cell")
        cells[0, 0] = cells[0, 1] = cells.ref
    with pytest.raises(UnsafeFile, match="references nest deeper"):
        containers.read(path)


def put_octave(group, name, kind, value, **attributes):
    child = group.create_group(name)
    child.attrs["OCTAVE_NEW_FORMAT"] = np.uint8(1)
    child.attrs.update(attributes)
    child["type"] = np.bytes_(kind)
    if value is None:
        return child.create_group("value")
    child["value"] = value
    return child["value"]


def test_octave_types(tmp_path):
    path = tmp_path / "octave.h5"
    record = np.array((2.0, 9.0, 2.0), [("base", "f8"), ("limit", "f8"), ("increment", "f8")])
    with h5py.File(path, "w") as file:
        put_octave(file, "Uhis", b"matrix", np.arange(6.0).reshape(2, 3))
        put_octave(file, "none", b"matrix", np.array([0, 4]), OCTAVE_EMPTY_MATRIX=np.uint8(1))
        put_octave(file, "indp", b"range", record)
        put_octave(file, "flag", b"bool", np.float64(1))
        put_octave(file, "name", b"sq_string", np.array([[78], [53]], "i1"))
        put_octave(file, "eye", b"diagonal matrix", np.ones(3))
        cells = put_octave(file, "Panel", b"cell", None)
        for index in range(12):
            put_octave(cells, f"_{index:02d}", b"scalar", np.float64(index))
        handle = put_octave(file, "CM", b"function handle", None)
        handle["fcn"] = np.bytes_(b"@(Ex) Ogden (Ex, 5e3)")
    read = containers.read(path).variables
    np.testing.assert_array_equal(read["Uhis"], np.arange(6.0).reshape(2, 3).T)
    assert read["none"].shape == (0, 4)
    np.testing.assert_array_equal(read["indp"], [[2, 4, 6, 8]])
    assert read["flag"] == 1.0
    assert read["name"] == "N5"
    assert read["eye"] is None
    assert [cell.item() for cell in read["Panel"]] == list(range(12))
    assert read["CM"] == FunctionHandle("@(Ex) Ogden (Ex, 5e3)")


def test_other_hdf5_is_named(tmp_path):
    path = tmp_path / "other.h5"
    with h5py.File(path, "w") as file:
        file["Uhis"] = np.zeros((3, 4))
    assert Importer().sniff(path) == 0.0
    with pytest.raises(UnreadableFile, match="no saved workspace; it holds"):
        containers.read(path)


def test_links_out_of_the_file_are_refused(tmp_path, write_v73):
    path = tmp_path / "link.mat"
    write_v73(path, samples.workspace())
    with h5py.File(path, "r+") as file:
        file["U"] = h5py.ExternalLink("elsewhere.h5", "/x")
    with pytest.raises(UnsafeFile, match="external link"):
        containers.read(path)


def test_directory_agrees_with_what_was_saved(mat, space):
    path = mat(space)
    listed = {entry.name: entry.shape for entry in mat5.directory(path)}
    assert listed["Uhis"] == (12, 60)
    assert set(listed) == set(space)
