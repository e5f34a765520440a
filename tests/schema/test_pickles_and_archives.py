"""Pickles and .npz archives of unknown origin."""

from __future__ import annotations

import collections
import io
import os
import pickle
import struct
import zipfile
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from openprc.errors import OpenPRCError, UnreadableFile, UnsafeFile, UntrustedPickle
from openprc.schema import safety


@pytest.fixture
def put(tmp_path):
    def write(content: bytes, name="data.pkl"):
        path = tmp_path / name
        path.write_bytes(content)
        return path

    return write


def frames():
    """What callbacks of simulators collect: plain containers of arrays and scalars."""
    data = collections.defaultdict(list)
    for i in range(3):
        data["time"].append(np.float64(i) / 10)
        data["position"].append(np.arange(6.0).reshape(3, 2) + i)
        data["step"].append(i)
    return {
        "data": data, "order": collections.OrderedDict(a=1, b=[2.5, None, True]),
        "f4": np.arange(4, dtype="f4"), "big": np.arange(3, dtype=">i2"),
        "flags": np.array([True, False]), "words": np.array(["a", "été"]), "bytes": b"\x00\xff",
        "fortran": np.asfortranarray(np.arange(6.0).reshape(2, 3)), "empty": np.zeros((0, 3)),
        "scalars": (np.int32(3), np.bool_(True), np.complex128(1 + 2j), np.float32(0.5)),
        "zero_d": np.array(2.5), "sliced": np.arange(10.0)[::2], "set": {1, 2}, "c": 1 + 2j,
        "record": np.array([(1, 2.5)], dtype=[("i", "i4"), ("x", "f8")]),
        "date": np.array(["2024-01-02"], "M8[D]"), "deque": collections.deque([1, 2], maxlen=5),
        "frozen": frozenset("ab"), "text": "naïve", "long": 2**100,
    }  # fmt: skip


def same(a, b):
    if isinstance(b, np.ndarray):
        np.testing.assert_array_equal(a, b)
        assert a.dtype.newbyteorder("=") == b.dtype.newbyteorder("=")  # some protocols swap
        assert a.shape == b.shape
    elif isinstance(b, dict):
        assert type(a) is type(b)
        assert list(a) == list(b)
        for key in b:
            same(a[key], b[key])
    elif isinstance(b, list | tuple):
        assert len(a) == len(b)
        for x, y in zip(a, b, strict=True):
            same(x, y)
    else:
        assert a == b
        assert type(a) is type(b)


@pytest.mark.parametrize("protocol", range(6))
def test_containers_of_arrays_come_back(put, protocol):
    known = frames()
    found = safety.load_pickle(put(pickle.dumps(known, protocol)), trust=True)
    same(found, known)
    assert found["data"].default_factory is list
    found["f4"][0] = 7.0  # arrays are ordinary, writable ones


def numpy_1(content: bytes) -> bytes:
    """The same pickle as numpy 1.x writes it: protocol 2 names modules in plain text."""
    return content.replace(b"numpy._core.", b"numpy.core.")


def test_names_of_numpy_1_are_understood(put):
    known = {"x": np.arange(3.0), "s": np.float64(2.5)}
    content = numpy_1(pickle.dumps(known, 2))
    assert b"numpy.core.multiarray" in content
    same(safety.load_pickle(put(content), trust=True), known)


@pytest.mark.parametrize("module", ["numpy.core.numeric", "numpy._core.numeric"])
def test_protocol_5_of_both_numpys(put, module):
    content = pickle.dumps(np.arange(4.0), 5)
    here = b"numpy._core.numeric"
    assert here in content
    name = module.encode()
    content = content.replace(bytes([len(here)]) + here, bytes([len(name)]) + name)
    start = content.index(b"\x95")
    size = struct.unpack("<Q", content[start + 1 : start + 9])[0] + len(name) - len(here)
    content = content[: start + 1] + struct.pack("<Q", size) + content[start + 9 :]
    np.testing.assert_array_equal(safety.load_pickle(put(content), trust=True), np.arange(4.0))


def test_untrusted_pickle_is_refused_unread(tmp_path):
    path = tmp_path / "not even there.pkl"
    with pytest.raises(UntrustedPickle, match=r"can run code[\s\S]*--trust"):
        safety.load_pickle(path, trust=False)


class Gadget:
    def __init__(self, function, *arguments):
        self.call = function, arguments

    def __reduce__(self):
        return self.call


GADGETS = {
    "os.system": (Gadget(os.system, "touch {marker}"), r"posix\.system|nt\.system"),
    "builtins.eval": (Gadget(eval, "open('{marker}', 'w')"), r"builtins\.eval"),
    "builtins.exec": (Gadget(exec, "open('{marker}', 'w')"), r"builtins\.exec"),
    "builtins.open": (Gadget(open, "{marker}", "w"), r"io\.open|builtins\.open"),
    "getattr": (Gadget(getattr, np, "load"), r"builtins\.getattr"),
    "path": (Path("x"), r"pathlib\.(_local\.)?(PosixPath|WindowsPath)"),
    "memmap": (Gadget(np.memmap, "{marker}", "f8", "w+", 0, (3,)), r"numpy\.memmap"),
    "fromfile": (Gadget(np.fromfile, "/etc/hostname"), r"fromfile"),
    "bytearray": (Gadget(bytearray, 10), r"builtins\.bytearray"),
    "range": (range(5), r"builtins\.range"),
    "class": (io.BytesIO, r"_io\.BytesIO"),
}


@pytest.mark.parametrize("protocol", [0, 2, 4])
@pytest.mark.parametrize("name", GADGETS)
def test_gadgets_are_named_and_never_run(put, tmp_path, name, protocol):
    marker = tmp_path / "marker"
    gadget, words = GADGETS[name]
    if isinstance(gadget, Gadget):
        function, arguments = gadget.call
        filled = [
            a.replace("{marker}", str(marker)) if isinstance(a, str) else a for a in arguments
        ]
        gadget = Gadget(function, *filled) if np not in filled else None
    content = (
        pickle.dumps({"x": [1, gadget]}, protocol)
        if gadget is not None
        else b"c__builtin__\ngetattr\n(cnumpy\nndarray\nS'tofile'\ntR."
    )
    path = put(content)
    with pytest.raises(UnsafeFile, match=r"the pickle asks for ") as caught:
        safety.load_pickle(path, trust=True)
    assert caught.value.file == str(path)
    if gadget is not None and protocol == 4:
        assert caught.match(words)
    assert not marker.exists()
    preview = safety.preview_pickle(path)
    assert preview is None or preview.globals
    assert not marker.exists()


def test_names_with_dots_do_not_reach_attributes(put):
    # Protocol 4 resolves "a.b" by attributes: none of that here.
    content = b"\x80\x04\x8c\x08builtins\x8c\x0flist.__class__.x\x93."
    content = content.replace(b"\x0flist.__class__.x", bytes([16]) + b"list.__class__.x")
    with pytest.raises(UnsafeFile, match=r"builtins\.list\.__class__\.x"):
        safety.load_pickle(put(content), trust=True)


def test_objects_in_an_array_are_refused(put):
    path = put(pickle.dumps([np.array([{}, None], dtype=object)]))
    with pytest.raises(UnsafeFile, match=r"array of Python objects") as caught:
        safety.load_pickle(path, trust=True)
    assert caught.value.file == str(path)


BOMBS = {
    "bytes": b"\x80\x04\x8e" + struct.pack("<Q", 1 << 50) + b"abc.",
    "frame": b"\x80\x04\x95" + struct.pack("<Q", 1 << 50) + b"N.",
    "text of nested lists": (
        b"\x80\x02c__builtin__\nstr\nX\x01\x00\x00\x00a"
        + b"".join(b"q" + bytes([i]) + b"h" + bytes([i]) + b"\x86" for i in range(60))
        + b"\x85R."
    ),
    "array that claims more": (
        b"\x80\x02cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\x00\x85U\x01b\x87R"
        b"(K\x01\x8a\x06\x00\x00\x00\x00\x00\x01\x85cnumpy\ndtype\nU\x02f8K\x00K\x01\x87R"
        b"(K\x03U\x01<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb\x89U\x08abcdefghtb."
    ),
    "reconstruct with a huge shape": (
        b"\x80\x02cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\n"
        b"\x8a\x06\x00\x00\x00\x00\x00\x01\x85U\x01b\x87]q\x01\x86."
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BOMBS)
def test_bombs_do_not_go_off(put, name):
    path = put(BOMBS[name])
    try:
        value = safety.load_pickle(path, trust=True)
    except (UnsafeFile, UnreadableFile):
        return
    assert len(repr(value)) < 1000


def test_hostile_scalar_is_refused(put):
    content = b"cnumpy.core.multiarray\nscalar\n(cnumpy\ndtype\n(S'O8'\nI0\nI1\ntRS'abcdefgh'\ntR."
    with pytest.raises(UnsafeFile, match="Python objects"):
        safety.load_pickle(put(content), trust=True)
    content = b"cnumpy.core.multiarray\nscalar\n(cnumpy\ndtype\n(S'f8'\nI0\nI1\ntRS'abc'\ntR."
    with pytest.raises(UnreadableFile, match="not a complete pickle"):
        safety.load_pickle(put(content), trust=True)


@pytest.mark.parametrize("share", [0.01, 0.3, 0.9, 0.999])
def test_truncated_pickle(put, share):
    whole = pickle.dumps(frames(), 4)
    with pytest.raises(UnreadableFile, match="not a complete pickle"):
        safety.load_pickle(put(whole[: int(share * len(whole))]), trust=True)


@pytest.mark.parametrize("content", [b"", b"time,x\n0,1\n", bytes(50)])
def test_what_is_no_pickle(put, content):
    path = put(content)
    assert safety.preview_pickle(path) is None
    with pytest.raises(UnreadableFile, match="not a complete pickle"):
        safety.load_pickle(path, trust=True)


# --- previews ---------------------------------------------------------------------------------


@pytest.mark.parametrize("protocol", range(6))
def test_preview_finds_names_and_strings(put, protocol):
    preview = safety.preview_pickle(put(pickle.dumps(frames(), protocol)))
    assert preview is not None
    assert {"position", "time", "step"} <= preview.strings
    assert "numpy.dtype" in preview.globals
    assert "collections.defaultdict" in preview.globals


@pytest.mark.parametrize("protocol", range(6))
def test_preview_runs_nothing(put, tmp_path, protocol):
    marker = tmp_path / "marker"
    path = put(pickle.dumps(Gadget(os.system, f"touch {marker}"), protocol))
    preview = safety.preview_pickle(path)
    assert preview is not None
    assert any(name.endswith("system") for name in preview.globals)
    assert not marker.exists()


def test_preview_reads_the_beginning_of_a_long_pickle(put):
    path = put(pickle.dumps({"position": [np.arange(300_000.0) for _ in range(2)]}))
    preview = safety.preview_pickle(path)
    assert preview is not None
    assert "position" in preview.strings


@settings(max_examples=150, deadline=None, derandomize=True)
@given(data=st.data())
def test_damaged_pickle_gives_errors_of_ours_only(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "damaged.pkl"
    raw = bytearray(pickle.dumps(
        {"a": [1.5, "x"], "b": (None, {"c": b"12"}), "e": [[], {}, {1, 2}]},
        data.draw(st.integers(0, 5)),
    ))  # fmt: skip
    for place, value in data.draw(
        st.lists(st.tuples(st.integers(0, len(raw) - 1), st.integers(32, 255)), max_size=4)
    ):
        if value not in b"rj":  # a huge index of the memo is a known weakness of CPython
            raw[place] = value
    path.write_bytes(raw[: data.draw(st.integers(1, len(raw)))])
    safety.preview_pickle(path)
    with suppress(OpenPRCError):
        safety.load_pickle(path, trust=True)


# --- archives ---------------------------------------------------------------------------------


def npy(header: dict, data: bytes, version=(1, 0)) -> bytes:
    stream = io.BytesIO()
    if version == (1, 0):
        np.lib.format.write_array_header_1_0(stream, header)
    else:
        np.lib.format.write_array_header_2_0(stream, header)
    return stream.getvalue() + data


@pytest.fixture
def archive(tmp_path):
    def make(members: dict[str, bytes], compression=zipfile.ZIP_DEFLATED):
        path = tmp_path / "data.npz"
        with zipfile.ZipFile(path, "w", compression) as target:
            for name, content in members.items():
                target.writestr(name, content)
        return path

    return make


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_archives_come_back(tmp_path, save):
    known = {
        "time": np.arange(5.0), "x": np.ones((5, 2, 3), "f4"), "names": np.array(["a", "é"]),
        "flags": np.array([True]), "empty": np.zeros((0, 3)), "scalar": np.array(3),
        "fortran": np.asfortranarray(np.arange(6).reshape(2, 3)),
    }  # fmt: skip
    save(tmp_path / "data.npz", **known)
    found = safety.load_npz(tmp_path / "data.npz")
    assert set(found) == set(known)
    for name, array in known.items():
        np.testing.assert_array_equal(found[name], array)
        assert found[name].dtype == array.dtype
    headers = safety.npz_headers(tmp_path / "data.npz")
    assert headers["x"] == ((5, 2, 3), np.dtype("f4"))


def test_objects_in_an_archive_are_refused(tmp_path):
    np.savez(tmp_path / "data.npz", fine=np.arange(3), ragged=np.array([[1], None], dtype=object))
    with pytest.raises(UnsafeFile, match="Python objects") as caught:
        safety.load_npz(tmp_path / "data.npz")
    assert caught.value.key == "ragged"
    assert set(safety.npz_headers(tmp_path / "data.npz")) == {"fine", "ragged"}


@pytest.mark.parametrize("version", [(1, 0), (2, 0)])
def test_header_that_lies_is_refused(archive, version):
    header = {"descr": "<f8", "fortran_order": False, "shape": (10**12,)}
    path = archive({"x.npy": npy(header, bytes(80), version)})
    with pytest.raises(UnsafeFile, match=r"claims 8,000,000,000,000 bytes and holds"):
        safety.load_npz(path)


def test_archive_that_unpacks_to_too_much(archive, monkeypatch):
    from openprc.schema import archives

    monkeypatch.setattr(archives, "MAX_BYTES", 1000)
    path = archive({"x.npy": npy({"descr": "<f8", "fortran_order": False, "shape": (200,)},
                                 bytes(1600))})  # fmt: skip
    with pytest.raises(UnsafeFile, match="unpacks to more than"):
        safety.load_npz(path)


@pytest.mark.parametrize(
    ("members", "words"),
    [
        ({"x.npy": b"not numpy"}, "not a NumPy array"),
        ({"x.npy": b"\x93NUMPY\x01\x00\x10\x00{'descr': 1}    "}, "not a NumPy array"),
        ({"x.npy": npy({"descr": "<f8", "fortran_order": False, "shape": (-1,)}, bytes(8))},
         "archive is damaged|not a NumPy array"),
    ],
)  # fmt: skip
def test_members_that_are_no_arrays(archive, members, words):
    with pytest.raises(UnreadableFile, match=words):
        safety.load_npz(archive(members))


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 and no more", b"a,b\n1,2\n"])
def test_what_is_no_archive(put, content):
    with pytest.raises(UnreadableFile, match=r"not a readable \.npz"):
        safety.load_npz(put(content, "data.npz"))


def test_missing_archive(tmp_path):
    with pytest.raises(UnreadableFile, match=r"not a readable \.npz"):
        safety.load_npz(tmp_path / "gone.npz")


def test_truncated_archive(tmp_path, put):
    np.savez(tmp_path / "data.npz", x=np.arange(100.0))
    whole = (tmp_path / "data.npz").read_bytes()
    for length in range(1, len(whole), 37):
        with pytest.raises(UnreadableFile):
            safety.load_npz(put(whole[:length], "cut.npz"))


@pytest.mark.filterwarnings("ignore")
@settings(max_examples=200, deadline=None, derandomize=True)
@given(data=st.data())
def test_damaged_archive_gives_errors_of_ours_only(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "damaged.npz"
    stream = io.BytesIO()
    save = data.draw(st.sampled_from([np.savez, np.savez_compressed]))
    save(stream, x=np.arange(20.0), name=np.array(["a"]))
    raw = bytearray(stream.getvalue())
    for place, value in data.draw(
        st.lists(st.tuples(st.integers(0, len(raw) - 1), st.integers(0, 255)), max_size=6)
    ):
        raw[place] = value
    path.write_bytes(raw)
    with suppress(OpenPRCError):
        safety.load_npz(path)
