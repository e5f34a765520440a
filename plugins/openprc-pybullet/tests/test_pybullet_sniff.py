"""Which files the importer claims, and what it says about those that hold no trajectory."""

import pickle

import numpy as np
import pytest
from openprc_pybullet import OPENPRC_PLUGIN_API, openprc_producers
from openprc_pybullet.importer import Importer

from openprc.errors import NotATrajectory, UnreadableFile
from openprc.hooks.protocols import Importer as ImporterProtocol

sniff = Importer().sniff


@pytest.mark.parametrize(
    ("name", "score"),
    [
        ("kuka_ik_circle.log", 1.0),
        ("r2d2_drive_contacts.log", 1.0),
        ("minitaur_8motor.bin", 1.0),
        ("kuka_block_grasp_vr_2017.bin", 1.0),
        ("cubes_t100.bullet", 0.9),
        ("cubes_t100_saveWorld.py.txt", 0.9),
        ("cloth_drop.npz", 0.7),
        ("pendulum5_chain_truth.npz", 0.7),
        ("r2d2_drive_truth_every4.npz", 0.6),
        ("laikago_replay_user.pkl", 0.6),
        ("r2d2_base.csv", 0.75),
        ("cubes_t100_poses.csv", 0.55),
    ],
)
def test_own_files(data, name, score):
    assert sniff(data / name) == score


def test_files_of_others(data):
    others = [p for p in data.parent.rglob("*") if p.is_file() and p.parent != data]
    assert len(others) > 20
    claimed = {p.name: sniff(p) for p in others if sniff(p) >= 0.5}
    assert claimed == {}
    assert sniff(data) == 0.0
    assert sniff(data / "README.md") == 0.0
    assert sniff(data / "kuka_ik_circle_bodies.json") == 0.0
    assert sniff(data / "not_there.log") == 0.0


@pytest.mark.parametrize("suffix", [".log", ".bin", ".npz", ".pkl", ".csv", ".txt", ".bullet"])
@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\0",
        np.random.default_rng(0).bytes(5000),
        b"just some words, nothing more\nthan that\n",
        b"stepCount,timeStamp",
        b"stepCount,timeStamp,objectId\nIf",
        b"PK\x03\x04 not an archive",
        b"\x80\x04 not a pickle",
        b"time,temperature\n0,20\n1,21\n",
        b"t,x,y,z\n0,1,2,3\n",
        b"stepCount,timeStamp,objectId\nIfi\nno record follows",
        b"import pybullet as p\np.connect(p.GUI)\n",
        b'{"traceEvents": [{"name": "a browser"}]}',
    ],
    ids=range(13),
)
def test_decoys(tmp_path, suffix, content):
    path = tmp_path / f"decoy{suffix}"
    path.write_bytes(content)
    assert sniff(path) < 0.5


T = 20


@pytest.mark.parametrize(
    "arrays",
    [
        {"time": (T,), "step": (T,), "position": (T, 3, 12), "velocity": (T, 3, 12)},
        {"time": (T,), "step": (T,), "position": (T, 3, 3)},
        {"time": (T,), "position": (T, 5, 3), "directors": (T, 3, 3, 4)},
        {"a_time": (T,), "a_position": (T, 3, 5), "a_kappa": (T, 3, 4)},
        {"time": (T,), "value": (T, 4)},
        {"image": (T, 64, 3)},
    ],
)
def test_npz_decoys(tmp_path, arrays):
    np.savez(tmp_path / "a.npz", **{name: np.zeros(shape) for name, shape in arrays.items()})
    assert sniff(tmp_path / "a.npz") < 0.5


@pytest.mark.parametrize(
    "value",
    [
        {"time": [0.0], "step": [0], "position": [np.zeros((3, 9))]},
        [{"time": 0.0, "pos": np.zeros(3), "directors": np.eye(3)}],
        {"weights": np.zeros(4)},
        ["a", "b"],
        [1.0, 2.0],
    ],
)
def test_pickle_decoys(tmp_path, value):
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(value))
    assert sniff(tmp_path / "a.pkl") < 0.5


@pytest.mark.parametrize(
    ("names", "letters", "score"),
    [("a,b", "If", 0.9), ("t,volt", "fB", 0.9), ("stepCount,timeStamp,controllerId", "IfI", 0.9)],
)
def test_other_columns_in_the_container(tmp_path, names, letters, score):
    path = tmp_path / "LOG00001.TXT"
    path.write_bytes(f"{names}\n{letters}\n".encode() + b"\xaa\xbb" + bytes(12))
    assert sniff(path) == score


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("cubes_t100.bullet", "saveBullet: one snapshot"),
        ("cubes_t100_saveWorld.py.txt", "saveWorld: the poses of the bases at one instant"),
        ("cubes_t100_poses.csv", "the rows are bodies, not instants"),
    ],
)
def test_snapshots_are_refused_with_the_reason(pb_import, data, name, words):
    with pytest.raises(NotATrajectory, match=words) as error:
        pb_import(data / name)
    assert "every step" in error.value.fix or "startStateLogging" in error.value.fix


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"BT3CMDd-v326" + bytes(40), "client commands"),
        (b'{"traceEvents":[\n{"cat":"timing","pid":1,"tid":0}', "timing profile"),
        (b"BULLETf-v287" + bytes(40), "saveBullet"),
    ],
)
def test_other_recordings_are_refused_with_the_reason(pb_import, write_log, content, words):
    path = write_log(content)
    assert sniff(path) == 0.9
    with pytest.raises(NotATrajectory, match=words):
        pb_import(path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"\0\1\2\3" * 9, "none of the files that PyBullet or its users write"),
        (b"PK\x03\x04 broken", "not a readable .npz archive"),
        (b"stepCount,timeStamp", "does not begin with two lines"),
    ],
)
def test_foreign_files_are_refused(pb_import, write_log, content, words):
    with pytest.raises(UnreadableFile, match=words):
        pb_import(write_log(content))


def test_broken_pickle_is_refused(pb_import, write_log):
    with pytest.raises(UnreadableFile, match="not a complete pickle"):
        pb_import(write_log(b"\x80\x04\x95 cut"), trust=True)


def test_empty_and_missing_files(tmp_path):
    empty = tmp_path / "a.log"
    empty.touch()
    for path, words in ((empty, "0 bytes"), (tmp_path / "b.log", "does not exist")):
        with pytest.raises(UnreadableFile, match=words):
            Importer().import_run(path, None, options={})


def test_record():
    (spec,) = openprc_producers()
    assert OPENPRC_PLUGIN_API == "1.0"
    assert (spec.name, spec.capabilities, spec.trusts_pickle) == (
        "pybullet",
        ("import", "record", "run"),
        True,
    )
    assert isinstance(Importer(), ImporterProtocol)
