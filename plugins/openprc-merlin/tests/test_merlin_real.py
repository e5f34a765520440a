"""Recorded runs: counts, stored results, containers, and closed forms on files."""

from __future__ import annotations

import numpy as np
import pytest
from openprc_merlin import containers, material, stored, verify, workspace
from openprc_merlin.importer import Importer

from openprc.errors import MissingData
from openprc.schema import validate_file

# name, nodes, input nodes, bars, folds, bends, increments, largest strain, mode
FILES = [
    ("merlin1_miura_folding.mat", 121, 121, 320, 180, 100, 60, 1.5e-4, "force"),
    ("merlin1_miura_bending.mat", 121, 121, 320, 180, 100, 98, 0.073, "force"),
    ("merlin1_miura_bistable.mat", 121, 121, 320, 180, 100, 160, 0.012, "force"),
    ("merlin1_kresling_folding.mat", 48, 48, 128, 112, 0, 180, 0.012, "force"),
    ("merlin2_gmiura_n5b8_disp.mat", 145, 81, 400, 112, 256, 203, 0.0009, "displacement"),
    ("merlin2_polygon_n5b8_force.mat", 7, 6, 12, 0, 6, 29, 1e-4, "force"),
    ("merlin2_simplefold_n4b5_disp.mat", 4, 4, 5, 1, 0, 60, 0.0006, "displacement"),
    ("merlin2_kresling_n4b5_disp.mat", 12, 12, 24, 12, 0, 100, 0.030, "displacement"),
    ("merlin2_waterbomb_n5b8_disp.mat", 9, 9, 16, 8, 0, 111, 0.0021, "displacement"),
    ("merlin2_kresling_n4b5_disp_octave.h5", 12, 12, 24, 12, 0, 100, 0.030, "displacement"),
    (
        "merlin2_kresling_n4b5_disp_v73layout_synthetic.mat",
        *(12, 12, 24, 12, 0, 100, 0.030, "displacement"),
    ),
    (
        "merlin1_miura_folding_min_v7layout_synthetic.mat",
        *(121, 121, 320, 180, 100, 60, 1.5e-4, "force"),
    ),
]
NAMES = [row[0] for row in FILES]
WITH_RESULTS = [name for name in NAMES if "min_v7" not in name]
KRESLING = [name for name in NAMES if name.startswith("merlin2_kresling")]


def build(path):
    return workspace.build(containers.read(path).variables, file=path)


@pytest.mark.parametrize(
    ("name", "nodes", "given", "bars", "folds", "bends", "increments", "strain", "mode"),
    FILES,
    ids=NAMES,
)
def test_counts_and_contents(
    data, load, name, nodes, given, bars, folds, bends, increments, strain, mode
):
    path = data / name
    assert Importer().sniff(path) == 1.0
    before = path.read_bytes()
    result = load(path)
    assert path.read_bytes() == before
    tr = result.trajectory
    assert (tr.n_frames, tr.n_nodes, tr.dims) == (increments + 1, nodes, 3)
    assert (tr.time_kind, tr.time_unit, tr.position_unit) == ("pseudo", "1", "arb")
    np.testing.assert_array_equal(tr.time, np.arange(increments + 1))
    np.testing.assert_array_equal(tr.positions(slice(0, 1))[0], tr.node("rest"))
    assert tr.indices("bars").shape == (bars, 2)
    codes = tr.element_static("hinges", "kind_code")
    assert [int((codes == code).sum()) for code in (1, 2)] == [folds, bends]
    np.testing.assert_array_equal(  # hinge b lies on bar b
        np.sort(tr.indices("hinges")[:, :2]), np.sort(tr.indices("bars")[: folds + bends])
    )
    found = np.abs(tr.element("bars", "strain")).max()
    assert found <= strain * 1.09
    assert found >= strain * (0.85 if strain > 1.5e-4 else 0)
    assert tr.inputs == (("load",) if mode == "force" else ("displacement",))
    assert tr.channels == (() if mode == "force" else ("reaction",))
    assert given == nodes or f"last {nodes - given} nodes are panel centres" in result.text
    assert "differ" not in result.text
    report = validate_file(result.path)
    assert [finding for finding in report.findings if finding.level != "hint"] == []


@pytest.mark.parametrize("name", WITH_RESULTS)
def test_strains_and_angles_are_those_that_merlin_stored(data, load, name):
    tr = load(data / name).trajectory
    space = build(data / name)
    strain = tr.element("bars", "strain")[1:]
    np.testing.assert_allclose(((1 + strain) ** 2 - 1) / 2, stored.strains(space), atol=1e-10)
    angle, kept = tr.element("hinges", "angle")[1:], stored.angles(space)
    apart = np.angle(np.exp(1j * (angle - kept)))
    assert np.abs(apart).max() < 1e-7
    rest = tr.element("hinges", "angle")[0] - tr.element_static("hinges", "rest_angle")
    assert np.abs(rest).max() < 1e-7


@pytest.mark.parametrize("name", NAMES)
def test_every_increment_is_in_balance(data, name):
    space = build(data / name)
    balance = verify.check(space, material.infer(space))
    assert not isinstance(balance, str)
    limit = 7e-5 if "miura_folding" in name else 2e-8
    assert balance.residual < limit
    assert balance.scale > 1e3 * limit


def test_damaged_run_is_out_of_balance(data, load):
    space = build(data / "merlin2_simplefold_n4b5_disp.mat")
    space.displacements[30, 3, 2] += 1e-4
    balance = verify.check(space, material.infer(space))
    assert (balance.increment, balance.residual > 1e-3) == (31, True)


def test_three_containers_of_one_run_give_one_trajectory(data, load):
    runs = [load(data / name, c0=5000.0).trajectory for name in KRESLING]
    first = runs[0]
    for other in runs[1:]:
        np.testing.assert_array_equal(first.positions(), other.positions())
        np.testing.assert_array_equal(first.indices("hinges"), other.indices("hinges"))
        np.testing.assert_array_equal(first.indices("faces"), other.indices("faces"))
        np.testing.assert_array_equal(
            first.element("hinges", "angle"), other.element("hinges", "angle")
        )
        np.testing.assert_array_equal(
            first.element_static("hinges", "stiffness"), other.element_static("hinges", "stiffness")
        )
        np.testing.assert_array_equal(first.channel("reaction"), other.channel("reaction"))
        np.testing.assert_array_equal(
            first.input("displacement").value, other.input("displacement").value
        )


def test_packed_integers_give_the_same_run_as_doubles(data, load):
    full = load(data / "merlin1_miura_folding.mat").trajectory
    packed = load(data / "merlin1_miura_folding_min_v7layout_synthetic.mat")
    other = packed.trajectory
    np.testing.assert_array_equal(full.positions(), other.positions())
    for kind in ("bars", "hinges", "faces"):
        np.testing.assert_array_equal(full.indices(kind), other.indices(kind))
    np.testing.assert_array_equal(full.node("fixed"), other.node("fixed"))
    np.testing.assert_array_equal(full.input("load").value, other.input("load").value)
    np.testing.assert_allclose(
        full.element_static("bars", "stiffness"), other.element_static("bars", "stiffness")
    )


def test_static_crease_in_closed_form(data, load):
    """Wing lifted by z: phi = asin(z / r), angle pi + phi, force k phi / (r cos phi)."""
    tr = load(data / "merlin2_simplefold_n4b5_disp.mat", unit="m", force_unit="N").trajectory
    z = tr.positions()[:, 3, 2]
    r = np.hypot(tr.positions()[:, 3, 0], z)
    phi = np.arcsin(z / r)
    np.testing.assert_allclose(tr.element("hinges", "angle")[:, 0], np.pi + phi, atol=1e-12)
    np.testing.assert_allclose(tr.element_static("hinges", "stiffness", unit="N*m/rad"), 0.4)
    force = 0.4 * phi / (r * np.cos(phi))
    np.testing.assert_allclose(-tr.channel("reaction", unit="N")[:, 0], force, atol=1e-8)
    np.testing.assert_allclose(tr.input("displacement").value[:, 0], z)
    assert phi[-1] == pytest.approx(1.1171, abs=1e-4)
    assert tr.channel("reaction")[-1, 0] == pytest.approx(-1.01823, abs=1e-5)


def test_miura_kinematics_in_closed_form(data, load):
    """Length and height of the folding Miura at the measured width; DOI 10.1098/rspa.2017.0348."""
    tr = load(data / "merlin1_miura_folding.mat").trajectory
    extent = np.ptp(tr.positions(), axis=1)
    a = b = 2.0
    theta = np.pi / 3
    s = extent[:, 0] / 10
    # s = b cos(g) tan(theta) / sqrt(1 + cos(g)^2 tan(theta)^2), solved for cos(g) tan(theta).
    t = s / np.sqrt(b**2 - s**2)
    gamma = np.arccos(t / np.tan(theta))
    height = a * np.sin(theta) * np.sin(gamma)
    length = a * np.sqrt(1 - (np.sin(gamma) * np.sin(theta)) ** 2)
    step = b / np.sqrt(1 + t**2)  # offset of every second row
    np.testing.assert_allclose(extent[:, 1], 10 * length + step, rtol=3e-4)
    np.testing.assert_allclose(extent[:, 2], height, rtol=6e-4)  # panels bend a little
    angle = tr.element("hinges", "angle")
    folds = tr.element_static("hinges", "kind_code") == 1
    magnitude = np.abs(np.pi - angle[:, folds])
    major = 2 * gamma[:, None]
    minor = 2 * np.arctan(np.cos(theta) * np.tan(gamma))[:, None]
    nearest = np.minimum(np.abs(magnitude - major), np.abs(magnitude - minor))
    assert nearest.max() < 2e-2
    assert (np.abs(magnitude[0] - major[0]) < 1e-9).sum() == 90


def test_miura_force_in_closed_form(data, load):
    tr = load(data / "merlin1_miura_folding.mat").trajectory
    factor = tr.input("load").value[:, 0]
    assert factor[0] == 0.0
    assert 11 * factor[11] == pytest.approx(9.274211, rel=1e-4)
    assert 11 * factor[41] == pytest.approx(7.426291, rel=1e-4)


def test_snap_paths_keep_their_order(data, load):
    tr = load(data / "merlin1_miura_bistable.mat").trajectory
    z, factor = tr.positions()[:, 60, 2], tr.input("load").value[:, 0]
    for increment, where, force in ((44, -0.9402, 2.31178), (91, -1.2742, -1.75007)):
        assert z[increment] - z[0] == pytest.approx(where, abs=1e-4)
        assert factor[increment] == pytest.approx(force, abs=1e-5)
    assert tr.input("load").targets == ("61",)


def test_kresling_second_stable_state(data, load):
    """Zero-strain height h2^2 = h1^2 - 4 R^2 cos(psi) cos(pi/n), whatever the stiffness."""
    space = build(data / "merlin2_kresling_n4b5_disp.mat")
    tr = load(space.file, stored=True).trajectory
    h2 = np.sqrt(1.75**2 - 4 * np.cos(np.deg2rad(50)) * np.cos(np.pi / 6))
    assert h2 == pytest.approx(0.91423104, abs=1e-8)
    length, rest = tr.element("bars", "length"), tr.element_static("bars", "rest_length")
    stretch = np.square((length - rest) / rest).sum(axis=1)
    second = 20 + int(np.argmin(stretch[20:]))
    height = tr.positions()[second, 6:, 2].mean()
    assert height == pytest.approx(h2, abs=0.02)
    assert -tr.channel("reaction").sum(axis=1).min() == pytest.approx(14.49, abs=0.01)
    assert tr.channel("reaction").sum(axis=1).max() == pytest.approx(24.46, abs=0.01)


def test_gmiura_end_point(data, load):
    tr = load(data / "merlin2_gmiura_n5b8_disp.mat").trajectory
    assert tr.input("displacement").value[-1, 0] == pytest.approx(-30.108, abs=1e-3)
    assert tr.channel("reaction")[-1, 0] == pytest.approx(0.40952, abs=1e-5)
    assert tr.channel_columns("reaction") == ("59 y",)
    with pytest.raises(MissingData):
        tr.element_static("hinges", "stiffness")
    exponents = tr.element_static("hinges", "moment_exponent")
    assert sorted(set(exponents.round(6))) == [1.0, 1.333333]


def test_obj_frames_are_the_displaced_nodes(data, load):
    sequence = load(data / "gmiura_obj")
    tr, full = sequence.trajectory, load(data / "merlin2_gmiura_n5b8_disp.mat").trajectory
    assert Importer().sniff(data / "gmiura_obj") == 1.0
    assert Importer().sniff(data / "gmiura_obj" / "frame_0100.obj") == 1.0
    frames = tr.time.astype(int)
    assert frames.tolist() == [0, 20, 40, 60, 80, 100, 120, 140, 160, 180, 200, 203]
    # Ten significant digits were printed.
    np.testing.assert_allclose(tr.positions(), full.positions()[frames], rtol=5e-10, atol=5e-9)
    assert tr.indices("faces").shape == (256, 3)
    codes = tr.element_static("hinges", "kind_code")
    assert [(codes == code).sum() for code in (1, 2)] == [112, 256]
    bars = tr.element_static("bars", "kind_code")
    assert [(bars == code).sum() for code in (0, 1, 2)] == [32, 112, 256]
    assert "no rest shape" in sequence.text
    assert "winding of triangles differs" in sequence.text
    # Angles agree up to their sense, which rows of `angles` choose freely.
    mine = {
        tuple(sorted(row[:2])): angle
        for row, angle in zip(
            tr.indices("hinges").tolist(), tr.element("hinges", "angle").T, strict=True
        )
    }
    for row, angle in zip(
        full.indices("hinges").tolist(), full.element("hinges", "angle")[frames].T, strict=True
    ):
        other = mine[tuple(sorted(row[:2]))]
        np.testing.assert_allclose(np.abs(other - np.pi), np.abs(angle - np.pi), atol=1e-7)


def test_obj_with_reference_has_strains(data, load):
    frame = data / "gmiura_obj" / "frame_0100.obj"
    result = load(frame, reference=str(data / "gmiura_obj" / "frame_0000.obj"))
    assert np.abs(result.trajectory.element("bars", "strain")).max() < 1e-3
    names = [source["name"] for source in result.trajectory.provenance["inputs"]]
    assert {"frame_0000.obj", "frame_0203.obj"} <= set(names)


def test_sim_fast_needs_its_reference(data, load, tmp_path):
    path = data / "sibling_simfast_OrigamiUhis.mat"
    assert Importer().sniff(path) == 0.7
    with pytest.raises(MissingData, match=r"no rest coordinates beside Uhis \(300x13x3\)") as error:
        load(path)
    assert "reference=FILE" in str(error.value)
    nodes = np.random.default_rng(1).normal(size=(13, 3))
    np.savetxt(tmp_path / "nodes.csv", nodes, delimiter=",", header="x,y,z", comments="")
    tr = load(path, reference=str(tmp_path / "nodes.csv")).trajectory
    u = containers.read(path).variables["Uhis"]
    np.testing.assert_allclose(tr.positions()[1:], nodes + u)
    np.testing.assert_allclose(tr.positions()[0], nodes)
    assert tr.element_kinds == ()
