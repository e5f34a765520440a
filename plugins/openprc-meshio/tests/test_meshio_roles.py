"""What moves, what is measured, in which unit and when."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import ConfigError, MissingData, NotATrajectory, UnitError, UnreadableFile

POINTS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])


@pytest.fixture
def write(xdmf, xml, motion):
    """Write a series: points that move or stay, and fields made from the places."""

    def write(
        *, still=False, fields=None, cells=TRIANGLES, kind="Triangle", timed=True, flat=False
    ):
        steps = []
        for k, places in enumerate(motion):
            points = POINTS if still else places
            points = points[:, :2] if flat else points
            step = xml.mesh(points, cells, kind) + (f'<Time Value="{k}"/>' if timed else "")
            for name, make in (fields or {}).items():
                step += xml.attribute(name, make(places, k))
            steps.append(step)
        return xdmf(xml.temporal(steps))

    return write


def moved(places, k):
    return places - POINTS


# --- displacement ---


@pytest.mark.parametrize("name", ["u", "U", "Displacement", "disp"])
def test_a_displacement_is_recognised_by_its_name(write, load, motion, name):
    found = load(write(still=True, fields={name: moved}))
    np.testing.assert_array_equal(found.run.positions(), POINTS + (motion - POINTS))
    np.testing.assert_array_equal(found.run.node("rest"), POINTS)
    assert f"the field {name!r} was taken as the displacement, by its name" in found.notes


def test_a_displacement_is_named(write, load, motion):
    path = write(still=True, fields={"warp": moved})
    np.testing.assert_array_equal(load(path, displacement="warp").run.positions()[1:],
                                  (POINTS + (motion - POINTS))[1:])  # fmt: skip
    with pytest.raises(NotATrajectory, match=r"no point moves in 5 frames; fields .*: 'warp'"):
        load(path)
    with pytest.raises(MissingData, match="frame 0 has no point field 'wrap'"):
        load(path, displacement="wrap")


def test_points_that_move_and_a_displacement_are_ambiguous(write, load, motion):
    path = write(fields={"u": moved})
    for options in ({}, {"displacement": "u"}):
        with pytest.raises(ConfigError, match="points of frame 1 have moved, and there is a disp"):
            load(path, **options)
    np.testing.assert_array_equal(load(path, displacement="none").run.positions(), motion)


def test_two_displacements_are_ambiguous(write, load):
    path = write(still=True, fields={"u": moved, "disp": moved})
    with pytest.raises(ConfigError, match="'u' and 'disp' may both be the displacement"):
        load(path)
    assert load(path, displacement="u").run.n_frames == 5


def test_a_scalar_called_u_is_no_displacement(write, load, motion):
    path = write(fields={"u": lambda places, k: places[:, 2]})
    np.testing.assert_array_equal(load(path).run.positions(), motion)
    with pytest.raises(ConfigError, match="the field 'u' has 1 numbers a point"):
        load(path, displacement="u")


def test_a_planar_mesh_with_a_planar_displacement(write, load, motion):
    found = load(write(still=True, flat=True, fields={"u": lambda p, k: (p - POINTS)[:, :2]}))
    assert found.run.dims == 2
    np.testing.assert_array_equal(found.run.positions(), (POINTS + (motion - POINTS))[..., :2])


def test_dims(write, load, motion):
    with pytest.raises(ConfigError, match="dims is 2, and the places of frame 1 leave the plane"):
        load(write(), dims=2)
    with pytest.raises(ConfigError, match="dims is 3, and the points have two coordinates"):
        load(write(flat=True), dims=3)
    with pytest.raises(ConfigError, match="dims is 4"):
        load(write(), dims=4)


# --- velocity, channels ---


def test_velocities(write, load, motion):
    path = write(fields={"speed": lambda p, k: 2 * p})
    found = load(path, velocity="speed")
    np.testing.assert_array_equal(found.run.velocities(), 2 * motion)
    assert found.run.unit("/time_series/nodes/velocities") == "mm/s"
    found = load(path, velocity="speed", velocity_unit="m/s")
    assert found.run.unit("/time_series/nodes/velocities") == "m/s"
    assert not load(path).run.has("/time_series/nodes/velocities")
    with pytest.raises(ConfigError, match="which unit velocities have beside time in 'ms'"):
        load(path, velocity="speed", time_unit="ms")
    with pytest.raises(UnitError, match="no unit of velocity belongs to '1'"):
        load(path, velocity="speed", unit="1")


def test_fields_as_channels(write, load, motion):
    path = write(fields={"heat": lambda p, k: p[:, 2], "flow": lambda p, k: p[:, :2], "p=q": moved})
    found = load(path, channels=["heat=K", "flow"])
    np.testing.assert_array_equal(found.run.channel("heat"), motion[..., 2])
    np.testing.assert_array_equal(found.run.channel("flow"), motion[..., :2].reshape(5, 8))
    assert found.run.channel_columns("flow")[:3] == ("n0.0", "n0.1", "n1.0")
    assert found.run.unit("/time_series/channels/heat") == "K"
    assert found.run.unit("/time_series/channels/flow") == "arb"
    assert load(path).run.channels == ()
    assert load(path, channels=["p=q=mm"]).run.channels == ("p_q",)
    with pytest.raises(MissingData, match="there is no field 'cold'"):
        load(path, channels=["cold"])
    with pytest.raises(UnitError, match="unknown unit 'Kelvin'"):
        load(path, channels=["heat=Kelvin"])


def test_fields_on_a_body_at_rest(write, load, motion):
    found = load(write(still=True, fields={"heat": lambda p, k: p[:, 2]}), channels=["heat=K"])
    np.testing.assert_array_equal(found.run.channel("heat"), motion[..., 2])
    assert (found.run.positions() == POINTS[:, :2]).all()


def test_a_field_that_ends_early(write, load, motion):
    path = write(fields={"heat": lambda p, k: p[:, 2]})
    text = path.read_text()
    start = text.rindex("<Attribute")
    path.write_text(text[:start] + text[text.rindex("</Attribute>") + len("</Attribute>") :])
    with pytest.raises(MissingData, match="frame 4 has no point field 'heat'"):
        load(path, channels=["heat"])


def test_a_field_too_wide_for_a_channel(tmp_path, xdmf, xml, load):
    points = np.random.default_rng(0).random((2000, 3))
    steps = [
        f'<Time Value="{k}"/>{xml.mesh(points + k)}{xml.attribute("flow", points)}'
        for k in range(2)
    ]
    with pytest.raises(ConfigError, match="'flow' has 6000 numbers a frame"):
        load(xdmf(xml.temporal(steps)), channels=["flow"])


# --- cells ---


def test_solids_become_bars_only_when_asked(write, load):
    path = write(cells=[[0, 1, 2, 3]], kind="Tetrahedron")
    found = load(path)
    assert found.run.element_kinds == ()
    assert "left out: 1 tetra; edges=true makes bars" in found.notes
    found = load(path, edges=True)
    pairs = {tuple(pair) for pair in found.run.indices("bars").tolist()}
    assert pairs == {(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)}
    assert "6 edges of cells were made bars, as asked" in found.notes


def test_edges_are_each_there_once(write, load):
    assert len(load(write(), edges=True).run.indices("bars")) == 5


def test_quadrilaterals_are_split_and_it_is_said(write, load):
    found = load(write(cells=[[0, 1, 2, 3]], kind="Quadrilateral"))
    assert found.run.indices("faces").tolist() == [[0, 1, 2], [0, 2, 3]]
    assert "1 quad were split into triangles from their first corner" in found.notes
    assert len(load(write(cells=[[0, 1, 2, 3]], kind="Quadrilateral"), edges=True)
               .run.indices("bars")) == 4  # fmt: skip


def test_nodes_between_corners_stay_nodes(write, load):
    found = load(write(cells=[[0, 2, 1]], kind="Edge_3"))
    assert found.run.indices("bars").tolist() == [[0, 2]]
    assert "1 line3: the corners count" in found.notes


def test_cells_that_have_collapsed_are_left_out(write, load):
    found = load(write(cells=[[0, 1, 2], [0, 2, 2]]))
    assert found.run.indices("faces").tolist() == [[0, 1, 2]]
    assert "1 faces with the same node twice were left out" in found.notes


# --- units, gaps ---


def test_the_unit_is_asked_for(write, load):
    with pytest.raises(ConfigError, match="nothing says which unit the coordinates have"):
        load(write(), unit=None)
    assert load(write(), unit="um").run.position_unit == "um"
    with pytest.raises(UnitError, match="unknown unit 'inch'"):
        load(write(), unit="inch")


def test_places_that_are_nan(write, load, motion):
    path = write()
    text = path.read_text().replace(repr(float(motion[3, 2, 2])), "nan")
    path.write_text(text)
    with pytest.raises(UnreadableFile, match="node 2 of frame 3 is nowhere"):
        load(path)
    found = load(path, missing=True)
    np.testing.assert_array_equal(np.argwhere(found.run.observed() == 0), [[3, 2]])
    assert np.isnan(found.run.positions()[3, 2]).all()


# --- time ---


def test_time_from_the_file_from_dt_or_none(write, load):
    assert "taken as seconds" in load(write()).notes
    assert load(write(), time_unit="ms").run.time_unit == "ms"
    found = load(write(), time_unit="1")
    assert (found.run.time_kind, found.run.time_unit) == ("pseudo", "1")
    found = load(write(timed=False))
    assert (found.run.time_kind, found.run.time.tolist()) == ("pseudo", [0, 1, 2, 3, 4])
    found = load(write(timed=False), dt=0.02)
    np.testing.assert_array_equal(found.run.time, 0.02 * np.arange(5))
    assert "dt = 0.02 was given" in found.notes


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"dt": 0.0}, ConfigError, "dt is 0.0"),
        ({"dt": 0.8}, UnreadableFile, r"frame 1 is at 1.0, and at 0.8 with dt = 0.8"),
    ],
)
def test_times_that_contradict(write, load, options, error, words):
    with pytest.raises(error, match=words):
        load(write(), **options)


def test_dt_evens_out_printed_times(write, load, motion):
    path = write()
    path.write_text(path.read_text().replace('Value="3"', 'Value="3.01"'))
    assert load(path).run.time[3] == 3.01
    found = load(path, dt=1.0)
    np.testing.assert_array_equal(found.run.time, np.arange(5))
    assert "times were replaced by even ones of dt = 1.0" in found.notes


def test_a_unit_of_time_without_times(write, load):
    with pytest.raises(ConfigError, match="do not say when their frames are"):
        load(write(timed=False), time_unit="ms")


def test_times_that_go_back(write, load):
    path = write()
    path.write_text(path.read_text().replace('Value="3"', 'Value="1.5"'))
    with pytest.raises(UnreadableFile, match=r"frame 3 is at 1\.5 after 2"):
        load(path)
