"""Nodes find each other by label, order or place, and what cannot be told is said."""

import numpy as np
import pytest
from compared_files import REST, compared, motion, rotation, write

from openprc.compare.alignment.node_assignment import assign, neighbour_distance
from openprc.errors import ConfigError, MissingData

T = 0.02 * np.arange(100)
LABELS = ["a", "b", "c", "d", "e", "f"]
MIXED = [3, 0, 5, 1, 4, 2]


@pytest.fixture
def x():
    return motion(T)[0]


@pytest.fixture
def labelled(tmp_path, x):
    return write(tmp_path / "labelled.h5", T, x, labels=LABELS)


@pytest.fixture
def plain(tmp_path, x):
    return write(tmp_path / "plain.h5", T, x)


def test_labels_undo_any_order(tmp_path, x, labelled):
    other = write(tmp_path / "o.h5", T, x[:, MIXED], labels=[LABELS[k] for k in MIXED])
    pair = compared(labelled, other)
    assert (pair.matched_by, pair.rms, pair.node_labels) == ("label", 0.0, tuple(LABELS))
    assert compared(labelled, other, match="index").rms > 0.1


def test_places_undo_any_order_where_there_are_no_labels(tmp_path, x, plain):
    pair = compared(plain, write(tmp_path / "o.h5", T, x[:, MIXED] + 1e-3))
    assert pair.matched_by == "assignment"
    np.testing.assert_allclose(pair.rms, 3**0.5 * 1e-3, rtol=1e-9)
    np.testing.assert_array_equal(pair.match.other, np.argsort(MIXED))


def test_equal_places_in_order_need_no_assignment(tmp_path, x, plain):
    assert compared(plain, write(tmp_path / "o.h5", T, x + 1e-3)).matched_by == "index"


def test_labels_in_one_file_only_are_no_labels(tmp_path, x, labelled, plain):
    assert compared(labelled, plain).matched_by == "index"
    with pytest.raises(MissingData, match=r'(?s)plain.h5.*no labels.*match="assignment"'):
        compared(labelled, plain, match="label")


def test_a_subset_of_markers_is_compared_and_the_rest_named(tmp_path, x, labelled):
    some = [4, 1, 2]
    other = write(tmp_path / "o.h5", T, x[:, some] + 1e-3)
    pair = compared(labelled, other)
    assert (pair.matched_by, pair.node_labels) == ("assignment", ("b", "c", "e"))
    assert pair.unmatched == ("a", "d", "f")
    named = write(tmp_path / "n.h5", T, x[:, some], labels=["e", "b", "extra"])
    pair = compared(labelled, named)
    assert pair.node_labels == ("b", "e")
    assert pair.match.unmatched_other == ("extra",)


def test_strange_labels_are_told_and_places_used(tmp_path, x, labelled):
    other = write(tmp_path / "o.h5", T, x[:, MIXED], labels=list("uvwxyz"))
    pair = compared(labelled, other)
    assert (pair.matched_by, pair.rms) == ("assignment", 0.0)
    assert any("no label is in both files" in note for note in pair.notes)
    with pytest.raises(ConfigError, match=r"(?s)none of its labels \(u, v, w, x, y and 1 more\)"):
        compared(labelled, other, match="label")


def test_labels_that_count_differently_are_doubted(tmp_path, x):
    first = write(tmp_path / "a.h5", T, x, labels=list("123456"))
    second = write(tmp_path / "b.h5", T, x, labels=list("234561"))
    pair = compared(first, second)
    assert any("the labels may count differently" in note for note in pair.notes)
    assert compared(first, second, match="assignment").rms == 0.0


def test_pairs_can_be_named(tmp_path, x, labelled):
    other = write(tmp_path / "o.h5", T, x[:, MIXED])
    pair = compared(labelled, other, pairs={"c": "5", "a": "1"})
    assert (pair.matched_by, pair.node_labels, pair.rms) == ("pairs", ("c", "a"), 0.0)
    with pytest.raises(ConfigError, match="there is no node 'q'"):
        compared(labelled, other, pairs={"q": "1"})
    with pytest.raises(ConfigError, match="paired twice"):
        compared(labelled, other, pairs={"a": "1", "b": "1"})
    with pytest.raises(ConfigError, match="there are no pairs"):
        compared(labelled, other, pairs={})


def test_an_order_needs_equal_numbers(tmp_path, x, plain):
    other = write(tmp_path / "o.h5", T, x[:, :4])
    with pytest.raises(ConfigError, match=r"(?s)has 4 nodes, and plain.h5 has 6"):
        compared(plain, other, match="index")


def test_bodies_elsewhere_have_no_pairs(tmp_path, x, plain):
    other = write(tmp_path / "o.h5", T, x + 100.0)
    with pytest.raises(ConfigError, match=r"(?s)no node of it is within.*rigid_motion"):
        compared(plain, other)


def test_a_limit_leaves_strays_out(tmp_path, x, plain):
    y = x[:, MIXED].copy()
    y[:, 2] += 0.2
    other = write(tmp_path / "o.h5", T, y)
    pair = compared(plain, other, match_limit=0.1)
    assert pair.n_nodes == 5
    assert pair.unmatched == (str(MIXED[2]),)
    assert pair.match.unmatched_other == ("2",)


def test_two_candidates_are_told(tmp_path, x, plain):
    y = np.concatenate([x[:, MIXED], x[:, [0]] + [0.0, 0.01, 0]], axis=1)
    pair = compared(plain, write(tmp_path / "o.h5", T, y))
    assert (pair.n_nodes, pair.rms) == (6, 0.0)
    assert any("1 nodes have a second candidate" in n and n.endswith(": 0") for n in pair.notes)


def test_rest_places_match_bodies_that_start_elsewhere(tmp_path, x):
    first = write(tmp_path / "a.h5", T, x, rest=REST)
    second = write(tmp_path / "b.h5", T, 3.0 * x[:, MIXED], rest=REST[MIXED])
    np.testing.assert_array_equal(compared(first, second).match.other, np.argsort(MIXED))


def test_a_turned_body_is_matched_together_with_its_motion(tmp_path, x, plain):
    y = (x[:, MIXED] - [4.0, 1.0, 0.0]) @ rotation()
    other = write(tmp_path / "o.h5", T, y)
    for kind in ("first", "all"):
        pair = compared(plain, other, rigid_motion=kind)
        assert pair.matched_by == "assignment"
        np.testing.assert_array_equal(pair.match.other, np.argsort(MIXED))
        assert pair.rms < 1e-14


@pytest.mark.parametrize("dims", [2, 3])
def test_a_part_in_another_frame_is_placed_by_its_distances(tmp_path, dims):
    rest = np.random.default_rng(4).uniform(size=(40, 3)) * [3.0, 2.0, 1.0]
    x = (rest + 1e-3 * np.sin(T)[:, None, None])[..., :dims]
    markers = [31, 4, 17, 22, 9, 36, 2]
    turn = rotation()[:dims, :dims] if dims == 3 else np.array([[0.6, -0.8], [0.8, 0.6]])
    whole = write(tmp_path / "whole.h5", T, x)
    part = write(tmp_path / "part.h5", T, (x[:, markers] - 5.0) @ turn)
    pair = compared(whole, part, rigid_motion="all")
    assert pair.n_nodes == 7
    np.testing.assert_array_equal(pair.match.reference, sorted(markers))
    assert pair.rms < 1e-13
    assert compared(part, whole, rigid_motion="first").rms < 1e-13


def test_few_counterparts_are_doubted(tmp_path):
    rng = np.random.default_rng(4)
    x = np.broadcast_to(rng.uniform(size=(60, 3)), (5, 60, 3))
    other = np.broadcast_to(rng.uniform(size=(50, 3)), (5, 50, 3))
    pair = compared(write(tmp_path / "a.h5", T[:5], x), write(tmp_path / "b.h5", T[:5], other))
    assert any("may be laid onto each other wrongly" in note for note in pair.notes)


def test_a_symmetric_body_cannot_be_told_apart(tmp_path):
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    x = np.broadcast_to(square, (10, 4, 2))
    first = write(tmp_path / "a.h5", T[:10], x)
    turn = np.array([[np.cos(1.0), -np.sin(1.0)], [np.sin(1.0), np.cos(1.0)]])
    second = write(tmp_path / "b.h5", T[:10], x @ turn + 5.0)
    pair = compared(first, second, rigid_motion="first", match="assignment")
    assert pair.rms < 1e-14
    assert any("equally well" in note for note in pair.notes)


@pytest.mark.parametrize("n", [300, 2500])
def test_many_nodes_are_assigned_whichever_way(n):
    rng = np.random.default_rng(3)
    x = rng.uniform(size=(n, 3))
    order = rng.permutation(n)[: n - 20]
    y = x[order] + rng.uniform(-1e-5, 1e-5, size=(n - 20, 3))
    found = assign(x, y, limit=neighbour_distance(x) / 4, fit=False, scale=False, reflect=False)
    assert len(found.reference) == n - 20
    np.testing.assert_array_equal(order[found.other], found.reference)
    assert found.distance.max() < 2e-5


def test_the_best_assignment_has_the_smallest_sum_of_squares():
    # Nearest first would take the pair in the middle and leave two that are far apart.
    x, y = np.array([[0.0, 0], [1.0, 0]]), np.array([[0.9, 0], [2.0, 0]])
    found = assign(x, y, limit=np.inf, fit=False, scale=False, reflect=False)
    np.testing.assert_array_equal(found.other[np.argsort(found.reference)], [0, 1])
