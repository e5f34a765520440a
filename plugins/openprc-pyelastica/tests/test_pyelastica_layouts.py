"""The many ways in which scripts save the same rod, all made here in closed form."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from openprc_pyelastica import axes, grouping
from openprc_pyelastica.importer import Importer


def rows(*names):
    return dict(zip(("time", "position", "velocity"), names, strict=True))


@pytest.mark.parametrize(
    "names",
    [
        rows("time", "position", "velocity"),
        rows("t", "positions", "velocities"),
        rows("times", "position_collection", "velocity_collection"),
        rows("Time", "X", "V"),
        rows("t", "pos", "vel"),
    ],
)
@pytest.mark.parametrize("layout", ["3n", "n3"])
def test_spellings_and_layouts(tmp_path, wave, run_import, check, names, layout):
    arrays = {names[key]: array for key, array in wave().items()}
    if layout == "n3":
        arrays = {k: a.transpose(0, 2, 1) if a.ndim == 3 else a for k, a in arrays.items()}
    np.savez(tmp_path / "a.npz", **arrays)
    check(run_import(tmp_path / "a.npz"))


def test_pickle_of_lists_and_of_arrays(dump, wave, run_import, check):
    check(run_import(dump(wave(), "lists.dat")))
    check(run_import(dump(wave(), "arrays.pkl", as_lists=False)))


def test_list_of_samples(dump, wave, run_import, check):
    arrays = wave()
    samples = [{key: array[i] for key, array in arrays.items()} for i in range(40)]
    check(run_import(dump(samples, as_lists=False)))


@pytest.mark.parametrize("protocol", range(6))
def test_pickle_protocols(tmp_path, wave, run_import, check, protocol):
    with (tmp_path / "a.dat").open("wb") as stream:
        pickle.dump(wave(), stream, protocol=protocol)
    check(run_import(tmp_path / "a.dat"))


@pytest.mark.parametrize(
    ("first", "second", "labels"),
    [
        ("left_{}", "right_{}", ("left", "right")),
        ("{}_rod1", "{}_rod2", ("rod1", "rod2")),
        ("{}1", "{}2", ("rod1", "rod2")),
        ("arm.{}", "head.{}", ("arm", "head")),
        ("rod_2_{}", "rod_10_{}", ("rod_2", "rod_10")),
    ],
)
def test_rods_by_prefix_or_suffix(tmp_path, wave, run_import, check, first, second, labels):
    arrays = {first.format(key): array for key, array in wave().items()}
    arrays |= {second.format(key): array for key, array in wave(4, offset=5.0).items()}
    np.savez(tmp_path / "a.npz", **arrays)
    run = run_import(tmp_path / "a.npz")
    assert [str(label) for label in run.node("label")][5:7] == [f"{labels[0]}:5", f"{labels[1]}:0"]
    check(run, nodes=slice(0, 6))
    check(run, nodes=slice(6, None), n_nodes=4, offset=5.0)


def test_rods_share_one_time(tmp_path, wave, run_import, check):
    arrays = wave()
    np.savez(
        tmp_path / "a.npz",
        time=arrays["time"],
        position_a=arrays["position"],
        position_b=wave(4, offset=5.0)["position"],
    )
    run = run_import(tmp_path / "a.npz")
    check(run, nodes=slice(0, 6), velocities=False)
    assert run.n_nodes == 10


@pytest.mark.parametrize("nested", [True, False])
def test_rods_as_dicts_or_in_a_list(dump, wave, run_import, check, nested):
    one, two = wave(), wave(4, offset=5.0)
    run = run_import(dump({"rod0": one, "rod1": two} if nested else [one, two], as_lists=False))
    check(run, nodes=slice(0, 6))
    check(run, nodes=slice(6, None), n_nodes=4, offset=5.0)
    assert run.node("label")[6] == "rod1:0"


def test_rods_stacked_in_one_array(tmp_path, wave, run_import, check, notes):
    one, two = wave(), wave(offset=5.0)
    arrays = {key: np.stack([one[key], two[key]], axis=1) for key in ("position", "velocity")}
    np.savez(tmp_path / "a.npz", time=one["time"], **arrays)
    assert Importer().sniff(tmp_path / "a.npz") >= 0.5
    run = run_import(tmp_path / "a.npz")
    check(run, nodes=slice(0, 6))
    check(run, nodes=slice(6, None), offset=5.0)
    assert "taken apart" in notes(run)


@pytest.mark.parametrize(
    "aux",
    [
        {"directors": (3, 3, 2)},
        {"sigma": (3, 2)},
        {"kappa": (3, 1)},
        {"tangents": (3, 2)},
    ],
)
@pytest.mark.parametrize("layout", ["3n", "n3"])
def test_three_nodes_are_told_apart_by_other_arrays(
    tmp_path, wave, run_import, check, notes, aux, layout
):
    arrays = wave(3)
    for key, shape in aux.items():
        arrays[key] = np.zeros((40, *shape))
    if layout == "n3":
        arrays = {k: np.moveaxis(a, -1, 1) if a.ndim > 2 else a for k, a in arrays.items()}
    np.savez(tmp_path / "a.npz", **arrays)
    run = run_import(tmp_path / "a.npz")
    check(run, n_nodes=3)
    assert f"axes {layout} concluded from {next(iter(aux))}" in notes(run)


@pytest.mark.parametrize("layout", ["3n", "n3"])
def test_three_nodes_are_told_apart_by_lengths(tmp_path, wave, run_import, check, notes, layout):
    arrays = wave(3)
    lengths = np.linalg.norm(np.diff(arrays["position"], axis=2), axis=1) * 1.001
    if layout == "n3":
        arrays = {k: a.swapaxes(1, 2) if a.ndim == 3 else a for k, a in arrays.items()}
    np.savez(tmp_path / "a.npz", **arrays, lengths=lengths)
    run = run_import(tmp_path / "a.npz")
    check(run, n_nodes=3)
    assert "concluded from lengths" in notes(run)


@pytest.mark.parametrize("layout", ["3n", "n3"])
def test_three_nodes_with_the_option(tmp_path, wave, run_import, check, layout):
    arrays = wave(3)
    if layout == "n3":
        arrays = {k: a.swapaxes(1, 2) if a.ndim == 3 else a for k, a in arrays.items()}
    np.savez(tmp_path / "a.npz", **arrays)
    check(run_import(tmp_path / "a.npz", axes=layout), n_nodes=3)


def test_a_rigid_body_is_one_node_without_bars(tmp_path, wave, run_import, check):
    np.savez(tmp_path / "a.npz", **wave(1), directors=np.zeros((40, 3, 3, 1)))
    run = run_import(tmp_path / "a.npz")
    check(run, n_nodes=1)
    assert run.element_kinds == ()


def test_a_tip_alone_is_one_node(tmp_path, wave, run_import, notes):
    arrays = wave()
    np.savez(tmp_path / "a.npz", time=arrays["time"], tip_position=arrays["position"][:, :, -1])
    run = run_import(tmp_path / "a.npz")
    assert run.node("label").tolist() == ["tip:0"]
    np.testing.assert_array_equal(run.positions()[:, 0], arrays["position"][:, :, -1])
    assert "single point" in notes(run)


def test_a_tip_beside_the_rod_is_a_channel(tmp_path, wave, run_import):
    arrays = wave()
    np.savez(tmp_path / "a.npz", **arrays, tip_position=arrays["position"][:, :, -1])
    run = run_import(tmp_path / "a.npz")
    assert run.n_nodes == 6
    assert run.channel_columns("tip_position") == ("x", "y", "z")


def test_a_ring_is_closed(tmp_path, run_import):
    angle = 2 * np.pi * np.arange(8) / 8
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle])
    np.savez(
        tmp_path / "a.npz",
        time=np.arange(5) * 0.1,
        position=np.tile(ring, (5, 1, 1)),
        dilatation=np.ones((5, 8)),
    )
    run = run_import(tmp_path / "a.npz")
    assert run.indices("bars")[-1].tolist() == [7, 0]
    np.testing.assert_allclose(run.element("bars", "length"), 2 * np.sin(np.pi / 8))


def test_rest_lengths_in_order_of_trust(tmp_path, wave, run_import, notes):
    arrays = wave()
    stretched = np.full((40, 5), 0.1) * np.linspace(1, 1.5, 40)[:, np.newaxis]
    np.savez(tmp_path / "a.npz", **arrays, lengths=stretched, dilatation=stretched / 0.08)
    run = run_import(tmp_path / "a.npz")
    np.testing.assert_allclose(run.element_static("bars", "rest_length"), 0.08)
    np.testing.assert_allclose(run.element("bars", "strain")[0], 0.1 / 0.08 - 1)
    np.savez(tmp_path / "b.npz", **arrays, rest_lengths=np.full(5, 0.09))
    run = run_import(tmp_path / "b.npz")
    np.testing.assert_allclose(run.element_static("bars", "rest_length"), 0.09)
    assert "the stored rest lengths" in notes(run)
    np.savez(tmp_path / "c.npz", **arrays, lengths=stretched, dilatation=np.ones((40, 5)))
    run = run_import(tmp_path / "c.npz")
    np.testing.assert_allclose(run.element_static("bars", "rest_length"), 0.1)
    assert "the first frame" in notes(run)


def test_constant_masses_become_node_masses(tmp_path, wave, run_import):
    mass = np.array([0.5, 1, 1, 1, 1, 0.5])
    np.savez(tmp_path / "a.npz", **wave(), mass=mass)
    np.testing.assert_array_equal(run_import(tmp_path / "a.npz").node("mass"), mass)
    np.savez(tmp_path / "b.npz", **wave(), mass=np.tile(mass, (40, 1)))
    np.testing.assert_array_equal(run_import(tmp_path / "b.npz").node("mass"), mass)


# --- units, extras, drive ----------------------------------------------------------------------


@pytest.mark.parametrize(("unit", "factor"), [("cm", 1e-2), ("mm", 1e-3)])
def test_other_length_units(tmp_path, wave, run_import, extension, unit, factor):
    arrays = wave()
    np.savez(
        tmp_path / "a.npz",
        **arrays,
        kappa=np.ones((40, 3, 4)),
        mass=np.ones(6),
        internal_forces=np.ones((40, 3, 6)),
    )
    run = run_import(tmp_path / "a.npz", unit=unit)
    expected = arrays["position"].transpose(0, 2, 1) * factor
    np.testing.assert_allclose(run.positions(), expected, rtol=1e-15)
    np.testing.assert_allclose(run.velocities()[0, -1, 2], 0.05 * factor)
    np.testing.assert_allclose(run.element_static("bars", "rest_length"), 0.1 * factor)
    values, symbol, _ = extension(run, "rod0.kappa")
    assert (values[0, 0, 0], symbol) == (pytest.approx(1 / factor), "1/m")
    assert extension(run, "rod0.mass")[1] == "arb"
    assert extension(run, "rod0.internal_forces")[1] == "arb"


def test_a_planar_run(tmp_path, wave, run_import, notes):
    arrays = wave()
    np.savez(tmp_path / "a.npz", **arrays)  # y is 2 everywhere
    whole = run_import(tmp_path / "a.npz")
    assert whole.dims == 3
    assert "nothing moves along y; plane=xz leaves that axis out" in notes(whole)
    flat = run_import(tmp_path / "a.npz", plane="xz")
    assert flat.dims == 2
    np.testing.assert_array_equal(flat.positions(), whole.positions()[:, :, [0, 2]])
    np.testing.assert_array_equal(flat.velocities(), whole.velocities()[:, :, [0, 2]])
    np.testing.assert_array_equal(flat.element("bars", "length"), whole.element("bars", "length"))


def test_what_is_not_numbers_is_left_out_and_told(dump, wave, run_import, check, notes):
    run = run_import(dump({**wave(), "title": "run 7", "none": None}, as_lists=False))
    check(run)
    assert "none, title hold no numbers" in notes(run)


def test_single_precision_is_told(tmp_path, wave, run_import, notes):
    arrays = wave()
    arrays["position"] = arrays["position"].astype("f4")
    np.savez(tmp_path / "a.npz", **arrays)
    assert "stored in float32" in notes(run_import(tmp_path / "a.npz"))


def test_an_array_on_another_clock_is_kept_and_marked(tmp_path, wave, run_import, extension):
    np.savez(tmp_path / "a.npz", **wave(), sigma=np.zeros((7, 3, 5)))
    _, _, comment = extension(run_import(tmp_path / "a.npz"), "rod0.sigma")
    assert "not on the clock" in comment


@pytest.mark.parametrize("width", [0, 2])
def test_the_drive_is_found_or_named(tmp_path, wave, run_import, notes, width):
    value = np.sin(np.arange(40 * max(width, 1))).reshape((40, width) if width else (40,))
    np.savez(tmp_path / "a.npz", **wave(), u=value, torque=value)
    run = run_import(tmp_path / "a.npz")
    assert run.inputs == ("u",)
    np.testing.assert_array_equal(run.input("u").value, value.reshape(40, -1))
    assert "u was taken for the drive" in notes(run)
    assert "u" not in run.channels
    run = run_import(tmp_path / "a.npz", input="torque", input_unit="N*m")
    assert run.inputs == ("torque",)
    assert run.input("torque").unit == "N*m"
    run = run_import(tmp_path / "a.npz", input="none")
    assert run.inputs == ()


def test_a_symbol_list_is_not_taken_for_the_drive(tmp_path, wave, run_import, notes):
    np.savez(tmp_path / "a.npz", **wave(), u=np.zeros(13))
    run = run_import(tmp_path / "a.npz")
    assert run.inputs == ()
    assert "u has shape (13,), not one row a sample" in notes(run)


# --- small parts, by themselves ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("key", "expected"),
    [
        ("position", ("", "position")),
        ("shearable_director_collection", ("shearable", "directors")),
        ("arm 1/velocity", ("arm_1", "velocity")),
        ("position-2", ("rod2", "position")),
        ("positions", ("", "position")),
        ("avg_velocity", ("avg", "velocity")),
        ("te", ("", None)),
        ("xylophone", ("", None)),
        ("timer", ("", None)),
    ],
)
def test_keys_split_into_rod_and_quantity(key, expected):
    assert grouping.split_key(key) == expected


@pytest.mark.parametrize(
    ("shape", "rank", "expected"),
    [
        ((9, 3, 5), 1, "3n"),
        ((9, 5, 3), 1, "n3"),
        ((3, 3, 3), 1, None),
        ((9, 5, 4), 1, None),
        ((9, 3, 3, 5), 2, "3n"),
        ((9, 5, 3, 3), 2, "n3"),
        ((9, 3, 3, 3), 2, None),
        ((9, 3), 1, None),
    ],
)
def test_layout_from_shape(shape, rank, expected):
    assert axes.from_shape(shape, rank=rank) == expected
