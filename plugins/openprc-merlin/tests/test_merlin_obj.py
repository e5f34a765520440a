"""OBJ sequences of MERLIN2 and of others."""

from __future__ import annotations

import numpy as np
import pytest
from openprc_merlin import obj_sequence, samples
from openprc_merlin.importer import Importer

from openprc.errors import ConfigError, MissingData, SchemaError, UnreadableFile

FACES = [(1, 2, 3), (2, 4, 3)]


def write_frame(folder, number, angle, *, merlin=True, stem="frame_", faces=FACES, edges=True):
    nodes = samples.REST.copy()
    nodes[3] = [np.cos(angle), 0, np.sin(angle)]
    lines = [obj_sequence.HEADER] if merlin else ["# another program"]
    lines += ["v " + " ".join(f"{x:.10g}" for x in row) for row in nodes]
    lines += ["f " + " ".join(map(str, face)) for face in faces]
    if edges:
        lines += [f"#e {a} {b} {int(n == 0)}" for n, (a, b) in enumerate(samples.BARS.tolist())]
    path = folder / f"{stem}{number:04d}.obj"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / "frames"
    path.mkdir()
    return path


def test_sequence_is_ordered_by_number(folder, load):
    for number in (200, 5, 40):
        write_frame(folder, number, number / 200)
    result = load(folder, unit="mm")
    tr = result.trajectory
    np.testing.assert_array_equal(tr.time, [5, 40, 200])
    assert tr.time_kind == "pseudo"
    np.testing.assert_allclose(tr.positions()[:, 3, 2], np.sin(tr.time / 200), atol=1e-9)
    np.testing.assert_allclose(
        np.abs(tr.element("hinges", "angle")[:, 0] - np.pi), tr.time / 200, atol=1e-8
    )
    assert tr.element_series("bars") == ("length",)
    assert tr.element_static("bars", "kind_code").tolist() == [2, 0, 0, 0, 0]
    assert tr.element_static("hinges", "kind_code").tolist() == [2]
    assert Importer().sniff(folder) == 1.0
    np.testing.assert_allclose(load(folder, dt=0.5).trajectory.time, [2.5, 20, 100])


def test_numbers_without_padding(folder, load):
    for number in (2, 10, 1):
        write_frame(folder, number, number / 20).rename(folder / f"step{number}.obj")
    np.testing.assert_array_equal(load(folder / "step10.obj").trajectory.time, [1, 2, 10])


def test_other_programs_give_points_and_faces(folder, load):
    for number in range(3):
        write_frame(folder, number, 0.1, merlin=False, edges=False, faces=[("1/1", "2//2", -1, 3)])
    assert Importer().sniff(folder) == 0.7
    tr = load(folder).trajectory
    assert tr.element_kinds == ("faces",)
    assert tr.indices("faces").tolist() == [[0, 1, 3], [0, 3, 2]]


def test_rewound_triangles_are_one_mesh(folder, load):
    write_frame(folder, 0, 0.0)
    write_frame(folder, 1, 0.1, faces=[(3, 2, 1), (2, 4, 3)])
    result = load(folder)
    assert "winding of triangles differs" in result.text
    np.testing.assert_allclose(
        np.abs(np.diff(result.trajectory.element("hinges", "angle")[:, 0])), 0.1, atol=1e-8
    )


def test_triangles_are_turned_alike_from_the_first_on(folder, load):
    alike, against = [(1, 2, 3), (2, 4, 3)], [(1, 2, 3), (2, 3, 4)]
    write_frame(folder, 0, 0.3, faces=against)
    write_frame(folder, 1, 0.3, faces=alike)
    tr = load(folder).trajectory
    assert tr.indices("faces")[0].tolist() == [0, 1, 2]
    # The common edge is run in both directions, so the second triangle was turned.
    second = tr.indices("faces")[1].tolist()
    assert (second * 2)[second.index(2) : second.index(2) + 2] == [2, 1]
    assert tr.indices("hinges").tolist() == [[1, 2, 0, 3]]


def test_sense_of_hinges_does_not_follow_the_rewinding(folder, load):
    """Both orders of the second triangle give the same row, hence the same sense."""
    for number, faces in enumerate(([(1, 3, 2), (2, 3, 4)], [(1, 3, 2), (2, 4, 3)])):
        inner = folder / str(number)
        inner.mkdir()
        for frame in range(2):
            write_frame(inner, frame, 0.3, faces=faces)
        assert load(inner).trajectory.indices("hinges").tolist() == [[1, 2, 3, 0]]


def test_several_sequences_need_a_choice(folder, load):
    for stem in ("a_", "b_"):
        for number in range(2):
            write_frame(folder, number, 0.1, stem=stem)
    with pytest.raises(ConfigError, match=r"2 sequences: a_0000\.obj, b_0000\.obj"):
        load(folder)
    assert load(folder / "b_0001.obj").trajectory.n_frames == 2


def test_a_single_file_is_no_sequence(folder, load):
    path = write_frame(folder, 0, 0.1)
    assert Importer().sniff(path) == 0.0
    assert Importer().sniff(folder) == 0.0
    with pytest.raises(MissingData, match="numbered OBJ files"):
        load(path)


def test_two_files_of_one_number(folder, load):
    write_frame(folder, 1, 0.1)
    write_frame(folder, 1, 0.2).rename(folder / "frame_1.obj")
    write_frame(folder, 1, 0.1)
    with pytest.raises(ConfigError, match="same number"):
        load(folder)


def test_different_meshes_are_refused(folder, load):
    write_frame(folder, 0, 0.1)
    write_frame(folder, 1, 0.1, faces=FACES[:1])
    with pytest.raises(SchemaError, match=r"4 vertices and 1 faces, unlike frame_0000\.obj"):
        load(folder)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"v 0 0\n", "line 1 has 2 coordinates"),
        (b"v 0 0 x\n", "line 1 is 'v 0 0 x'"),
        (b"v 0 0 0\nf 1 2 3\n", "faces or edges that name others"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 2\n", "line 4: a face needs three different corners"),
        (b"# nothing\n", "0 vertices"),
        (b"v \xff\xfe 0 0\n", "not text"),
    ],
)
def test_unreadable_frames_are_named(folder, load, content, words):
    write_frame(folder, 0, 0.1)
    (folder / "frame_0001.obj").write_bytes(content)
    with pytest.raises(UnreadableFile, match=words):
        load(folder)


def test_reference_of_another_mesh(folder, load, tmp_path):
    for number in range(2):
        write_frame(folder, number, 0.1)
    np.savez(tmp_path / "r.npz", nodes=np.zeros((5, 3)))
    with pytest.raises(SchemaError, match="the reference has 5 nodes, the sequence 4"):
        load(folder, reference=str(tmp_path / "r.npz"))


def test_sheets_with_two_sides_fold_once(folder, load):
    """Some programs list every triangle a second time, turned round, for its back."""
    twice = [*FACES, *(face[::-1] for face in FACES)]
    for number in range(2):
        write_frame(folder, number, 0.3, faces=twice)
    tr = load(folder).trajectory
    np.testing.assert_allclose(np.abs(tr.element("hinges", "angle") - np.pi), 0.3, atol=1e-9)
