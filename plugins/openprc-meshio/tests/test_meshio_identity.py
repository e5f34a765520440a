"""A node is the same node in every frame, or the series is refused."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import MissingData, SchemaError

POINTS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])


@pytest.fixture
def steps(xml, motion):
    """Return the steps of a mesh whose points and cells are listed in another order each time."""

    def make(*, shuffle=True, ids=True, seed=3):
        rng = np.random.default_rng(seed)
        made = []
        for k, places in enumerate(motion):
            order = rng.permutation(4) if shuffle and k else np.arange(4)
            rank = np.argsort(order)
            rows = rng.permutation(2) if shuffle and k else np.arange(2)
            step = f'<Time Value="{k}"/>' + xml.mesh(places[order], rank[TRIANGLES][rows])
            if ids:
                step += xml.attribute("number", 10 * order + 5)
            step += xml.attribute("area", (np.array([1.0, 2.0]) + 10 * k)[rows], "Cell")
            made.append(step + xml.attribute("heat", (np.arange(4.0) + 10 * k)[order]))
        return made

    return make


@pytest.mark.parametrize("seed", range(4))
def test_ids_put_points_and_cells_in_order(xdmf, xml, load, steps, motion, seed):
    path = xdmf(xml.temporal(steps(seed=seed)))
    found = load(path, ids="number", channels=["heat=K", "area=m2"])
    np.testing.assert_array_equal(found.run.positions(), motion)
    np.testing.assert_array_equal(found.run.node("id"), [5, 15, 25, 35])
    np.testing.assert_array_equal(found.run.channel("heat")[3], 30 + np.arange(4))
    np.testing.assert_array_equal(found.run.element("faces", "area")[3], [31, 32])


def test_without_ids_another_order_is_refused(xdmf, xml, load, steps):
    path = xdmf(xml.temporal(steps()))
    with pytest.raises(SchemaError, match="not of the same mesh: its cells join other") as caught:
        load(path)
    assert "ids=number" in caught.value.fix


def test_frames_in_one_order_need_no_ids(xdmf, xml, load, steps, motion):
    found = load(xdmf(xml.temporal(steps(shuffle=False, ids=False))))
    np.testing.assert_array_equal(found.run.positions(), motion)


def test_remeshed_series_are_refused(xdmf, xml, load, motion):
    finer = np.vstack([motion[3], [[0.5, 0.5, 0.0]]])
    steps = [f'{xml.mesh(p)}<Time Value="{k}"/>' for k, p in enumerate(motion)]
    cells = [[0, 1, 4], [1, 2, 4], [2, 3, 4]]
    steps[3] = f'{xml.mesh(finer, cells)}<Time Value="3"/>'
    with pytest.raises(SchemaError, match="frame 3 is not of the same mesh") as caught:
        load(xdmf(xml.temporal(steps)))
    assert "what was remeshed has no trajectories" in caught.value.expected
    steps[3] = f'{xml.mesh(finer)}<Time Value="3"/>'
    with pytest.raises(SchemaError, match="it has 5 points, the first has 4"):
        load(xdmf(xml.temporal(steps)))
    steps[3] = f'{xml.mesh(motion[3], [[0, 1, 3], [1, 2, 3]])}<Time Value="3"/>'
    with pytest.raises(SchemaError, match="its cells join other points"):
        load(xdmf(xml.temporal(steps)))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda step: step.replace(">5 15 25 35<", ">5 15 25 45<"), "its 'number' are other"),
        (lambda step: step.replace(">5 15 25 35<", ">5 15 25 25<"), "not a different whole number"),
        (lambda step: step.replace(">0 1 2 0 2 3<", ">0 1 3 1 2 3<"), "its cells join other nodes"),
        (lambda step: step.replace('"2 3">0 1 2 0 2 3<', '"1 3">0 1 2<'), "other cells of shape"),
    ],
)
def test_frames_whose_ids_do_not_fit(xdmf, xml, load, steps, change, words):
    made = steps(shuffle=False)
    changed = change(made[2])
    assert changed != made[2]
    made[2] = changed
    with pytest.raises(SchemaError, match=words):
        load(xdmf(xml.temporal(made)), ids="number")


def test_ids_that_are_not_there(xdmf, xml, load, steps):
    path = xdmf(xml.temporal(steps()))
    with pytest.raises(MissingData, match="no point field 'numbers'") as caught:
        load(path, ids="numbers")
    assert "number" in caught.value.expected
    broken = [
        step.replace('NumberType="Int" Precision="8" Dimensions="4">5', 'Dimensions="4">5.5')
        for step in steps(shuffle=False)
    ]
    with pytest.raises(SchemaError, match="not a different whole number"):
        load(xdmf(xml.temporal(broken)), ids="number")
