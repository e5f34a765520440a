"""Pickles of what PyBullet's own calls return, and of steps without names."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from openprc_pybullet.importer import Importer

from openprc.errors import MissingData, SchemaError

DT = 1 / 240
TURN = (0.0, 0.0, 0.0, 1.0)


@pytest.fixture
def save_pickle(tmp_path):
    def save(value):
        path = tmp_path / "user.pkl"
        path.write_bytes(pickle.dumps(value))
        return path

    return save


def triples(rows):
    return tuple(tuple(row) for row in rows.tolist())


def motion(n_nodes, n_frames=6):
    return np.random.default_rng(3).standard_normal((n_frames, n_nodes, 3))


def times(n_frames=6):
    return [k * DT for k in range(n_frames)]


def mesh(x):
    return (len(x), triples(x))


def poses(x):
    return [(row, TURN) for row in triples(x)]


@pytest.mark.parametrize("n_nodes", [1, 2, 5])
@pytest.mark.parametrize("call", [mesh, poses], ids=["getMeshData", "getBasePosition"])
@pytest.mark.parametrize("timed", [True, False])
def test_what_the_calls_return(pb_import, save_pickle, n_nodes, call, timed):
    x = motion(n_nodes)
    steps = [(t, call(row)) if timed else call(row) for t, row in zip(times(), x, strict=True)]
    run = pb_import(save_pickle(steps), trust=True, **({} if timed else {"dt": DT}))
    np.testing.assert_array_equal(run.positions(), x)
    np.testing.assert_allclose(run.time, times(), rtol=0, atol=1e-15)


def test_one_pose_and_a_mesh_in_dicts(pb_import, save_pickle):
    x, y = motion(1), motion(4)
    steps = [{"t": t, "cube": poses(a)[0], "cloth": mesh(b)}
             for t, a, b in zip(times(), x, y, strict=True)]  # fmt: skip
    path = save_pickle(steps)
    np.testing.assert_array_equal(pb_import(path, trust=True, position_key="cube").positions(), x)
    run = pb_import(path, trust=True, position_key="cloth")
    np.testing.assert_array_equal(run.positions(), y)
    np.testing.assert_array_equal(run.channel("cube.orientation"), [TURN] * 6)


def test_counted_steps_are_no_seconds(pb_import, save_pickle):
    x = motion(4)
    path = save_pickle([(k, row) for k, row in enumerate(x)])
    with pytest.raises(MissingData, match="nothing tells the time; there are step, positions"):
        pb_import(path, trust=True)
    run = pb_import(path, trust=True, dt=DT)
    np.testing.assert_allclose(run.time, times(), rtol=0, atol=1e-15)
    path = save_pickle([(k, t, row) for k, (t, row) in enumerate(zip(times(), x, strict=True))])
    np.testing.assert_allclose(pb_import(path, trust=True).time, times(), rtol=0, atol=1e-15)


@pytest.mark.parametrize("make", [triples, list, np.array], ids=["tuples", "lists", "arrays"])
def test_bare_triples_are_nodes(pb_import, save_pickle, make):
    x = motion(5)
    steps = [make(row) if make is not list else list(triples(row)) for row in x]
    np.testing.assert_array_equal(pb_import(save_pickle(steps), trust=True, dt=DT).positions(), x)


def test_two_bare_triples_are_asked_about(pb_import, save_pickle):
    with pytest.raises(SchemaError, match="2 triples without names: 2 nodes, or the position"):
        pb_import(save_pickle([triples(row) for row in motion(2)]), trust=True, dt=DT)


def test_three_nodes_of_either_program_are_asked_about(tmp_path):
    np.savez(tmp_path / "a.npz", time=times(), position=motion(3))
    assert Importer().sniff(tmp_path / "a.npz") == 0.55


def test_bodies_by_their_unique_id(pb_import, tmp_path):
    x = motion(3)
    rows = [f"{t!r},{body},{a!r},{b!r},{c!r},0,0,0,1" for t, row in zip(times(), x, strict=True)
            for body, (a, b, c) in enumerate(row.tolist())]  # fmt: skip
    head = "t,objectUniqueId,posX,posY,posZ,oriX,oriY,oriZ,oriW"
    (tmp_path / "user.csv").write_text("\n".join([head, *rows]))
    run = pb_import(tmp_path / "user.csv")
    np.testing.assert_array_equal(run.positions(), x)
