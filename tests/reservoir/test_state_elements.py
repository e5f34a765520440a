import numpy as np
import pytest

from openprc.errors import MissingData, NonUniformTime, TaskError
from openprc.reservoir.features.bar_features import BarExtensions, BarStrains
from openprc.reservoir.features.element_features import ElementSeries, HingeAngles
from openprc.reservoir.features.node_features import NodeVelocities
from openprc.reservoir.io.state_loader import StateLoader
from openprc.schema import Provenance, TrajectoryWriter

FOLD = 2 * np.pi * np.linspace(0.1, 0.9, 30)


@pytest.fixture
def make_panels(tmp_path):
    """Return a function that writes two square panels folding about the x axis, and its path.

    The panels are flat when the fold angle is pi; units are mm, the bar across is 20 mm long
    when flat, and its rest length is stored in m.
    """

    def make(*, stored=(), velocities=False, rest=0.02, planar=False):
        x = np.zeros((len(FOLD), 4, 3))
        x[:, 1, 0] = 10.0
        x[:, 2] = [5.0, 10.0, 0.0]
        x[:, 3, 0] = 5.0
        x[:, 3, 1] = 10.0 * np.cos(FOLD)
        x[:, 3, 2] = 10.0 * np.sin(FOLD)
        across = np.linalg.norm(x[:, 3] - x[:, 2], axis=1)[:, None]
        dims = 2 if planar else 3
        values = {"strain": np.full_like(across, 7.0), "force": 3.0 * across}
        series = {"strain": "1", "force": "N"}
        path = tmp_path / "panels.h5"
        with TrajectoryWriter(path, provenance=Provenance("test"), overwrite=True) as writer:
            writer.declare_nodes(4, dims, unit="mm", velocities=velocities)
            writer.declare_elements(
                "bars",
                np.array([[2, 3]]),
                series={name: series[name] for name in stored if name in series},
                static={"rest_length": (np.array([rest]), "m")},
            )
            writer.declare_elements(
                "hinges",
                np.array([[0, 1, 2, 3]]),
                series={"angle": "deg"} if "angle" in stored else {},
            )
            elements = {("bars", name): values[name] for name in stored if name in series}
            if "angle" in stored:
                elements["hinges", "angle"] = np.degrees(FOLD)[:, None]
            writer.append(
                np.arange(len(FOLD)) * 0.01,
                positions=x[:, :, :dims],
                velocities=np.ones((len(FOLD), 4, dims)) if velocities else None,
                elements=elements,
            )
        return path

    return make


def test_hinge_angle_of_panels_about_a_crease(make_panels):
    """The angle from panel to panel; measured on one side, so beyond flat it goes on growing."""
    with StateLoader(make_panels()) as loader:
        assert loader.n_hinges == 1
        angles = loader.hinge_angles()[:, 0]
        np.testing.assert_allclose(np.minimum(angles, 2 * np.pi - angles),
                                   np.minimum(FOLD, 2 * np.pi - FOLD), atol=1e-12)  # fmt: skip
        assert np.all(np.diff(angles) > 0) or np.all(np.diff(angles) < 0)
        assert HingeAngles([0]).names(loader) == ["hinge0"]
        np.testing.assert_array_equal(HingeAngles([0]).transform(loader)[:, 0], angles)


def test_stored_angles_are_used_as_they_are(make_panels):
    with StateLoader(make_panels(stored=["angle"])) as loader:
        np.testing.assert_allclose(loader.hinge_angles()[:, 0], np.degrees(FOLD))


def test_planar_positions_have_no_hinge_angle(make_panels):
    with (
        StateLoader(make_panels(planar=True)) as loader,
        pytest.raises(MissingData, match="no hinge angle is stored and positions have 2"),
    ):
        loader.hinge_angles()


def test_strain_is_extension_over_rest_length_whatever_their_units(make_panels):
    with StateLoader(make_panels()) as loader:
        across = 20.0 * np.sin(FOLD / 2)
        np.testing.assert_allclose(loader.bar_strains()[:, 0], across / 20.0 - 1.0, atol=1e-12)
        np.testing.assert_allclose(loader.bar_extensions()[:, 0], across - 20.0, atol=1e-12)
        first = loader.bar_strains(origin="first")[:, 0]
        np.testing.assert_allclose(first, across / across[0] - 1.0, atol=1e-12)
        assert BarStrains().names(loader) == ["bar0.strain"]
        assert BarExtensions().names(loader) == ["bar0.extension"]


def test_a_stored_strain_is_preferred_unless_an_origin_is_named(make_panels):
    with StateLoader(make_panels(stored=["strain"])) as loader:
        assert (loader.bar_strains() == 7.0).all()
        assert loader.bar_strains(origin="rest").max() < 1e-12
        with pytest.raises(TaskError, match="origin is 'last'"):
            loader.bar_strains(origin="last")


def test_no_strain_of_a_bar_without_length(make_panels):
    with (
        StateLoader(make_panels(rest=0.0)) as loader,
        pytest.raises(TaskError, match="bar 0 has the rest length 0"),
    ):
        loader.bar_strains()


def test_recorded_series_of_elements(make_panels):
    with StateLoader(make_panels(stored=["force"])) as loader:
        feature = ElementSeries("bars", "force")
        across = 20.0 * np.sin(FOLD / 2)
        np.testing.assert_allclose(feature.transform(loader)[:, 0], 3.0 * across, rtol=1e-12)
        assert feature.names(loader) == ["bar0.force"]
        with pytest.raises(MissingData, match="torque of the hinges was not recorded"):
            ElementSeries("hinges", "torque").transform(loader)
        with pytest.raises(MissingData, match=r"the file has no springs\n.*bars, hinges"):
            ElementSeries("springs", "force").names(loader)
        with pytest.raises(TaskError, match="bar_ids is \\[3\\]"):
            ElementSeries("bars", "force", element_ids=[3]).transform(loader)


def test_stored_velocities(make_panels):
    with StateLoader(make_panels(velocities=True)) as loader:
        assert (loader.velocities([1]) == 1.0).all()
        feature = NodeVelocities([1], [0, 2])
        assert feature.names(loader) == ["node1.vx", "node1.vz"]
        assert (feature.transform(loader) == 1.0).all()
        assert not NodeVelocities(reference_node=0).transform(loader).any()


def test_velocities_are_derived_only_when_asked_for(make_body):
    with StateLoader(make_body()) as loader:
        with pytest.raises(MissingData, match=r"stores no velocities\n.*\n.*derive=True"):
            loader.velocities()
        velocities = NodeVelocities([1], [1], derive=True).transform(loader)[:, 0]
    # Central differences of 0.1 sin(w t) are 0.1 sin(w dt) / dt cos(w t).
    phase = 2 * np.pi * np.arange(40) / 20
    expected = 0.1 * np.sin(2 * np.pi / 20) / 0.01 * np.cos(phase)
    np.testing.assert_allclose(velocities[1:-1], expected[1:-1], atol=1e-12)


def test_velocities_are_not_derived_without_a_clock(make_body):
    uneven = make_body(time=[0.0, 0.1, 0.3, 0.4], name="uneven.h5")
    with StateLoader(uneven) as loader, pytest.raises(NonUniformTime):
        loader.velocities(derive=True)
    steps = make_body(time=np.arange(9.0), time_unit="1", time_kind="pseudo", name="steps.h5")
    with StateLoader(steps) as loader, pytest.raises(TaskError, match="velocity depends on"):
        loader.velocities(derive=True)
    two = make_body(time=[0.0, 0.1], name="two.h5")
    with StateLoader(two) as loader, pytest.raises(TaskError, match="the file has 2 frames"):
        loader.velocities(derive=True)
