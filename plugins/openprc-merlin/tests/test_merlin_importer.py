"""The importer: sample, sniffing, modes of loading, options, references."""

from __future__ import annotations

import numpy as np
import pytest
from openprc_merlin import extension, openprc_extensions, openprc_producers, samples
from openprc_merlin.importer import Importer
from scipy.io import savemat

from openprc.errors import ConfigError, MissingData, SchemaError, UnreadableFile
from openprc.schema import Trajectory, validate_file

PHI = samples.fold_angles()
EXPECTED = np.concatenate([[0.0], PHI])


# --- the sample ----------------------------------------------------------------------------


def test_sample_is_the_closed_form(tmp_path, load):
    sample = samples.write_sample(tmp_path)
    options = {key.replace("-", "_"): value for key, value in sample.options.items()}
    result = load(sample.path, **options)
    tr = result.trajectory
    np.testing.assert_allclose(tr.positions()[:, 3, 0], np.cos(EXPECTED), atol=1e-15)
    np.testing.assert_allclose(tr.positions()[:, 3, 2], np.sin(EXPECTED), atol=1e-15)
    np.testing.assert_allclose(tr.element("hinges", "angle")[:, 0], np.pi + EXPECTED, atol=1e-13)
    assert np.abs(tr.element("bars", "strain")).max() < 1e-15
    np.testing.assert_allclose(
        tr.input("load").value[:, 0], 0.4 * EXPECTED / np.cos(EXPECTED), atol=1e-14
    )
    assert tr.input("load").quantity == "load factor"
    assert tr.input("load").targets == ("4",)
    assert tr.position_unit == "mm"
    # 0.2 N/rad times 2 mm of crease.
    np.testing.assert_allclose(tr.element_static("hinges", "stiffness"), 0.4e-3)
    np.testing.assert_allclose(tr.element_static("bars", "area"), 0.1e-6)
    np.testing.assert_array_equal(tr.element_static("bars", "kind_code"), [1, 0, 0, 0, 0])
    np.testing.assert_array_equal(tr.node("fixed"), [1, 1, 1, 0])
    assert tr.node("id").tolist() == [1, 2, 3, 4]
    assert (tr.time_kind, tr.time_unit) == ("pseudo", "1")
    assert list(extension.check(tr)) == []


def test_result_breaks_no_rule_of_the_contract(mat, load, space):
    report = validate_file(load(mat(space), unit="mm").path)
    assert [finding for finding in report.findings if finding.level == "error"] == []


def test_records_are_light_and_complete():
    spec, fold = openprc_producers()
    assert "import" in spec.capabilities
    assert fold.capabilities == ("import",)
    assert {option.name for option in spec.options} >= {"unit", "dt", "reference", "verify"}
    assert openprc_extensions()[0].name == extension.NAME


def test_stored_results_are_kept_on_request(mat, load, space):
    space["STAT"] = {
        "bar": {"Ex": np.zeros((5, 60)), "Sx": np.zeros((5, 60))},
        "fold": {"Angle": np.pi + PHI[None]},
        "bend": {"Angle": np.zeros((0, 60))},
        "PE": 0.2 * PHI[None] ** 2,
    }
    result = load(mat(space), stored=True)
    import h5py

    with h5py.File(result.path) as file:
        group = file["extensions/openprc-merlin"]
        np.testing.assert_allclose(group["stored_angle"][:, 0], np.pi + PHI)
        np.testing.assert_allclose(group["stored_energy"], 0.2 * PHI**2)
        assert group["stored_strain"].shape == (60, 5)
        assert group["solver"][()] == 2
        np.testing.assert_array_equal(group["increments"], range(61))
        np.testing.assert_array_equal(group["reference_load"][3], [0, 0, 1])
        assert group["held"][()].tolist() == [[1, 1, 1]] * 3 + [[0, 0, 0]]


def test_extension_check_finds_faults(mat, load, space, tmp_path):
    import h5py

    result = load(mat(space))
    result.trajectory.close()
    path = result.path
    with h5py.File(path, "r+") as file:
        file["extensions/openprc-merlin/increments"][5] = 0
    with Trajectory(path) as tr:
        assert [finding.code for finding in extension.check(tr)] == ["MERLIN-02"]
    with h5py.File(path, "r+") as file:
        del file["extensions/openprc-merlin/increments"]
    with Trajectory(path) as tr:
        # A clock that counts increments says it as well.
        assert list(extension.check(tr)) == []
    timed = load(mat(space), dt=0.5)
    timed.trajectory.close()
    with h5py.File(timed.path, "r+") as file:
        del file["extensions/openprc-merlin/increments"]
    with Trajectory(timed.path) as tr:
        assert [finding.code for finding in extension.check(tr)] == ["MERLIN-01"]


# --- sniffing ------------------------------------------------------------------------------


def test_sniff_knows_its_own(mat, space, tmp_path):
    sniff = Importer().sniff
    assert sniff(mat(space)) == 1.0
    assert sniff(mat({"U_his2": space["Uhis"], "LF_his2": np.zeros((1, 60))}, "u.mat")) == 0.7
    assert sniff(mat({k: space[k] for k in ("truss", "angles")}, "t.mat")) == 0.6


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.mat", b""),
        ("a.mat", bytes(range(256)) * 20),
        ("a.mat", b"some text\n" * 30),
        ("a.h5", b"\x89HDF\r\n\x1a\n" + bytes(600)),
        ("a.obj", b"v 0 0 0\n"),
        ("a.obj", bytes(4000)),
        ("a.npz", b"PK\x03\x04" + bytes(100)),
        ("a.bin", b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + bytes(3)),
    ],
)
def test_sniff_leaves_decoys_alone(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    assert Importer().sniff(path) == 0.0


@pytest.mark.parametrize(
    ("name", "shape", "score"),
    [
        ("OrigamiUhis", (5, 4, 3), 0.6),
        ("Uhis_bending", (12, 5), 0.6),
        ("OrigamiUhis", (5, 4, 2), 0.0),
        ("Uhistogram", (10, 1), 0.0),
        ("Origami", (5, 4, 3), 0.0),
    ],
)
def test_sniff_reads_longer_names_with_their_shape(mat, name, shape, score):
    assert Importer().sniff(mat({name: np.zeros(shape)})) == score


def test_a_workspace_that_was_cut_off_is_explained(mat, space, load):
    path = mat(space)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    assert Importer().sniff(path) == 0.5
    with pytest.raises(UnreadableFile, match="damaged or cut off"):
        load(path)


def test_sniff_leaves_other_contents_alone(mat, tmp_path):
    assert Importer().sniff(mat({"Node": np.zeros((3, 3)), "x": 1.0})) == 0.0
    assert Importer().sniff(mat({"truss": {"a": 1}}, "t.mat")) == 0.0
    assert Importer().sniff(tmp_path / "missing.mat") == 0.0
    assert Importer().sniff(tmp_path) == 0.0


def test_trajectories_are_not_claimed(mat, load, space):
    assert Importer().sniff(load(mat(space)).path) == 0.0


# --- displacement mode ----------------------------------------------------------------------


def test_displacement_mode(mat, load, space):
    space["AnalyInputOpt"]["LoadType"] = "Displacement"
    result = load(mat(space))
    tr = result.trajectory
    assert tr.inputs == ("displacement",)
    np.testing.assert_allclose(tr.input("displacement").value[:, 0], np.sin(EXPECTED), atol=1e-15)
    assert tr.input("displacement").columns == ("4 z",)
    assert tr.channel("reaction")[0, 0] == 0.0
    np.testing.assert_array_equal(tr.channel("reaction")[1:, 0], space["Fhis"][:, 0])
    assert "minus the applied force" in result.text


def test_reaction_of_a_stressed_initial_state_is_not_invented(mat, load, space):
    space["AnalyInputOpt"]["LoadType"] = "Displacement"
    space["angles"]["pf0"] = np.array([[3.0]])
    assert np.isnan(load(mat(space)).trajectory.channel("reaction")[0, 0])


def test_load_of_unknown_kind_and_none(mat, load, space):
    del space["AnalyInputOpt"]
    result = load(mat(space))
    assert result.trajectory.input("load").unit == "arb"
    assert "a load factor or a reaction is not told" in result.text
    none = load(mat(space), load="none")
    assert none.trajectory.inputs == ()
    assert "left out on request" in none.text


# --- angles ----------------------------------------------------------------------------------


def test_mirrored_angles_of_small_models_are_noted(mat, load, space):
    scale = 1e-3
    for key in ("Node", "Uhis"):
        space[key] = space[key] * scale
    space["truss"]["Node"] = space["Node"]
    space["truss"]["L"] = space["truss"]["L"] * scale
    space["STAT"] = {"fold": {"Angle": np.pi - PHI[None]}, "bend": {"Angle": np.zeros((0, 60))}}
    result = load(mat(space))
    assert "60 stored angles are 2 pi minus those of the positions" in result.text
    angle = result.trajectory.element("hinges", "angle")[:, 0]
    np.testing.assert_allclose(angle, np.pi + EXPECTED, atol=1e-12)


def test_wrong_stored_results_are_noted(mat, load, space):
    space["STAT"] = {
        "fold": {"Angle": np.pi + PHI[None] + 0.1},
        "bend": {"Angle": np.zeros((0, 60))},
        "bar": {"Ex": np.full((5, 60), 1e-3)},
    }
    text = load(mat(space)).text
    assert "60 stored angles differ" in text
    assert "stored bar strains differ from those of the positions by up to 0.001" in text


def test_angle_is_unwrapped_through_folded_shut(mat, load, space):
    a = np.linspace(0.1, 6.0, 60)
    space["Uhis"][9], space["Uhis"][11] = np.cos(a) - 1, np.sin(a)
    result = load(mat(space))
    np.testing.assert_allclose(
        result.trajectory.element("hinges", "angle")[1:, 0], np.pi + a, atol=1e-12
    )
    assert "cross the cut at 0 and 2 pi 1 times" in result.text


# --- options ----------------------------------------------------------------------------------


def test_dt_makes_time_physical(mat, load, space):
    result = load(mat(space), dt=0.1)
    tr = result.trajectory
    assert (tr.time_kind, tr.time_unit, tr.dt) == ("physical", "s", pytest.approx(0.1))
    np.testing.assert_array_equal(tr.time, 0.1 * np.arange(61))
    assert "its time was given by the user" in result.text


def test_time_from_a_variable(mat, load, space):
    space["t"] = np.arange(61.0)[:, None] ** 2
    tr = load(mat(space), time="t").trajectory
    np.testing.assert_array_equal(tr.time, np.arange(61.0) ** 2)
    assert not tr.uniform


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"dt": 0.0}, "dt = 0"),
        ({"dt": float("nan")}, "dt = nan"),
        ({"dt": 1.0, "time": "t"}, "both dt and time"),
        ({"time": "Fhis"}, "load history 'Fhis' cannot serve as time"),
        ({"time": "load"}, "cannot serve as time"),
        ({"time": "nothing"}, "has no values for 61 frames"),
        ({"time": "short"}, "has 60 values for 61 frames"),
        ({"time": "back"}, "does not increase everywhere"),
        ({"displacement": "nothing"}, "no numeric variable 'nothing'"),
        ({"load": "nothing"}, "no numeric variable 'nothing'"),
    ],
)
def test_wrong_options_are_refused(mat, load, space, tmp_path, options, words):
    space["short"], space["back"] = np.arange(60.0), -np.arange(61.0)
    with pytest.raises(ConfigError, match=words):
        load(mat(space), **options)
    assert not list(tmp_path.glob("out*"))


def test_named_histories_settle_a_tie(mat, load, space):
    space["U_his"], space["LF_his"] = 2 * space["Uhis"], 2 * space["Fhis"]
    tr = load(mat(space), displacement="Uhis", load="LF_his").trajectory
    assert tr.positions()[-1, 3, 2] == pytest.approx(np.sin(1.1))
    assert tr.input("load").value[-1, 0] == pytest.approx(2 * samples.load_factors(PHI)[-1])


# --- reference -------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["mat", "whole", "npz", "csv", "obj"])
def test_reference_supplies_the_rest_shape(mat, load, space, tmp_path, kind):
    path = mat({"U_his2": space["Uhis"], "LF_his2": space["Fhis"].T}, name="only.mat")
    reference = tmp_path / f"nodes.{'mat' if kind == 'whole' else kind}"
    nodes = samples.REST
    if kind == "mat":
        savemat(reference, {"nodes": nodes})
    elif kind == "whole":
        savemat(reference, space)
    elif kind == "npz":
        np.savez(reference, nodes=nodes)
    elif kind == "csv":
        np.savetxt(reference, nodes, delimiter=",", header="x,y,z", comments="")
    else:
        lines = [f"v {x} {y} {z}" for x, y, z in nodes] + ["f 1 2 3", "f 2 4 3"]
        reference.write_text("\n".join(lines))
    result = load(path, reference=str(reference))
    tr = result.trajectory
    np.testing.assert_allclose(tr.positions()[:, 3, 2], np.sin(EXPECTED), atol=1e-15)
    kinds = {"whole": ("bars", "faces", "hinges"), "obj": ("faces",)}.get(kind, ())
    assert tr.element_kinds == kinds
    assert reference.name in [source["name"] for source in tr.provenance["inputs"]]


def test_reference_beside_a_rest_shape_is_refused(mat, load, space, tmp_path):
    np.savez(tmp_path / "nodes.npz", nodes=samples.REST)
    with pytest.raises(ConfigError, match="rest coordinates of its own"):
        load(mat(space), reference=str(tmp_path / "nodes.npz"))


@pytest.mark.parametrize(
    ("name", "write", "error", "words"),
    [
        (
            "r.npz",
            lambda p: np.savez(p, a=np.zeros((4, 3)), b=np.ones((4, 3))),
            MissingData,
            "2 arr",
        ),
        (
            "r.npz",
            lambda p: np.savez(p, a=np.zeros((4, 2))),
            MissingData,
            "0 arrays of shape N x 3",
        ),
        ("r.csv", lambda p: p.write_text("x,y,z\n1,2\n"), UnreadableFile, "line 2 is '1,2'"),
        ("r.csv", lambda p: p.write_text("x,y,z\n"), MissingData, "no row of three numbers"),
        ("r.csv", lambda p: p.write_bytes(b"\xff\xfe\x00"), UnreadableFile, "not text"),
        ("r.csv", lambda p: p.write_text("1 2 3\n4 5 6\n"), SchemaError, "has 2 nodes"),
    ],
)
def test_unfit_references_are_named(mat, load, space, tmp_path, name, write, error, words):
    path = mat({"Uhis": space["Uhis"]}, name="only.mat")
    write(tmp_path / name)
    with pytest.raises(error, match=words):
        load(path, reference=str(tmp_path / name))


def test_sim_fast_array_with_its_initial_state(mat, load, space):
    u = np.zeros((61, 4, 3))
    u[1:] = space["Uhis"].T.reshape(60, 4, 3)
    del space["Fhis"]
    plain = load(mat({**space, "Uhis": u[1:]}, name="quasi.mat"))
    result = load(mat({**space, "Uhis": u}, name="dynamic.mat"))
    assert result.trajectory.n_frames == plain.trajectory.n_frames == 61
    np.testing.assert_array_equal(result.trajectory.positions(), plain.trajectory.positions())


# --- verify ----------------------------------------------------------------------------------


def test_verify_says_what_is_missing(mat, load, space):
    assert "does not tell C0 (give it with the option c0)" in load(mat(space), verify=True).text


def test_verify_finds_the_force_that_rigid_bars_would_carry(mat, load, space):
    """The sample's bars are rigid: out of balance is only the radial part of the load."""
    text = load(mat(space), verify=True, c0=1e4).text
    radial = samples.load_factors(PHI)[-1] * np.sin(1.1)
    # Radial force on node 4 in components: the largest is along x or z.
    largest = radial * max(np.cos(1.1), np.sin(1.1))
    assert f"largest residual {largest:.2g} at increment 60" in text
