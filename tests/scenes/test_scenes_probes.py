"""What probes measure, and what they refuse."""

from types import SimpleNamespace

import numpy as np
import pytest

from openprc.errors import MissingData
from openprc.scenes.probes import (
    angular_frequency,
    at_time,
    deviation,
    instants,
    path_of,
    period_of_crossings,
    places,
)
from openprc.scenes.scene import Probe, Reference
from openprc.scenes.verification import verify_scene
from openprc.schema import Provenance, Trajectory, TrajectoryWriter


@pytest.fixture
def written(tmp_path):
    """Return a function that writes positions (T, N, D) and opens them."""
    opened = []

    def write(x, *, labels=None, unit="m"):
        path = tmp_path / f"{len(opened)}.h5"
        with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
            writer.declare_nodes(x.shape[1], x.shape[2], unit=unit, labels=labels)
            writer.append(0.1 * np.arange(len(x)), positions=x)
        opened.append(Trajectory(path))
        return opened[-1]

    yield write
    for trajectory in opened:
        trajectory.close()


def test_places_by_label_in_three_dimensions_and_metres(written):
    x = np.arange(12.0).reshape(2, 3, 2)
    run = written(x, labels=["a", "b", "c"], unit="mm")
    found = places(run, ["c", "a"])
    np.testing.assert_allclose(found[..., :2], 1e-3 * x[:, [2, 0]])
    assert not found[..., 2].any()
    np.testing.assert_allclose(path_of(run, "b")[:, :2], 1e-3 * x[:, 1])


def test_labels_that_are_not_there(written):
    run = written(np.zeros((2, 2, 3)), labels=["a", "b"])
    with pytest.raises(MissingData, match="no node is labelled 'z'"):
        places(run, ["a", "z"])
    with pytest.raises(MissingData, match="the nodes have no labels"):
        places(written(np.zeros((2, 2, 3))), ["a"])


def test_a_cubic_between_frames_is_exact(written):
    t = 0.1 * np.arange(8)
    run = written(np.stack([t**3, t**2 - t, t], axis=1)[:, np.newaxis], labels=["a"])
    for time in (0.0, 0.03, 0.1, 0.37, 0.7):
        found = at_time(run, path_of(run, "a"), time=time)
        np.testing.assert_allclose(found, [time**3, time**2 - time, time], atol=1e-14)
    with pytest.raises(MissingData, match=r"frames from 0 s to 0\.7 s"):
        at_time(run, path_of(run, "a"), time=0.8)


def test_deviation_up_to_a_time(written):
    t = 0.1 * np.arange(6)
    x = np.zeros((6, 1, 3))
    x[:, 0, 0] = t
    x[4:, 0, 1] = 0.5
    run = written(x, labels=["a"])

    def exact(times):
        return np.stack([times, 0 * times, 0 * times], axis=1)[:, np.newaxis]

    assert deviation(run, exact, ["a"], until=0.3) == pytest.approx(0.0, abs=1e-15)
    assert deviation(run, exact, ["a"], until=0.4) == pytest.approx(0.5)
    assert deviation(run, exact, ["a"]) == pytest.approx(0.5)


def test_load_steps_have_times_only_where_the_scene_says():
    path = SimpleNamespace(time=np.arange(4.0), time_kind="pseudo", path="steps.h5")
    np.testing.assert_allclose(instants(path, 0.2), [0.0, 0.2, 0.4, 0.6])
    with pytest.raises(MissingData, match="a path of equilibria, which has no time"):
        instants(path)
    run = SimpleNamespace(time=np.arange(4.0), time_kind="physical", path="run.h5")
    np.testing.assert_allclose(instants(run, 0.2), run.time)


def test_frequencies_of_samples():
    t = 0.05 * np.arange(81)
    swing = 0.3 * np.cos(3.1 * t + 0.4)
    assert angular_frequency(swing, 0.05) == pytest.approx(3.1, rel=1e-10)
    period = period_of_crossings(t, swing + 0.01 * np.cos(9.3 * t + 1.2))
    assert period == pytest.approx(2.0 * np.pi / 3.1, rel=1e-5)
    assert np.isnan(period_of_crossings(t[:20], swing[:20]))


@pytest.mark.parametrize(
    ("value", "measured", "deviation_", "ok"),
    [
        (2.0, 2.02, 0.01, True),
        (-2.0, -2.05, 0.025, False),
        (0.0, -0.015, 0.015, True),
        (0.0, 0.03, 0.03, False),
        (1.0, float("nan"), None, False),
        (1.0, float("inf"), None, False),
    ],
)
def test_what_holds(value, measured, deviation_, ok):
    probe = Probe(
        name="p", value=value, unit="1", tolerance=0.02, measure=lambda run: measured, source="s"
    )
    scene = SimpleNamespace(
        reference=Reference(kind="closed form", text="t", source="s", probes=(probe,))
    )
    (result,) = verify_scene(scene, None)
    assert result.ok is ok
    if deviation_ is not None:
        assert result.deviation == pytest.approx(deviation_)
    assert result.as_dict()["measured"] is measured
