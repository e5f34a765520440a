"""Reading pickles of NumPy data without running what they name.

A pickle is a program. `load_pickle` demands that the caller trusts the origin and even then
resolves only the few names that plain containers of arrays need; `preview_pickle` looks at the
instructions without executing any.
"""

from __future__ import annotations

import codecs
import collections
import pickle
import pickletools
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import UnreadableFile, UnsafeFile, UntrustedPickle

#: How much of a file a preview reads.
PREVIEW_BYTES = 1 << 20


class _ArrayType:
    """Stands for ``numpy.ndarray``: a name to pass around, useless to call."""


def _reconstruct(_subtype: Any, _shape: Any, _dtype: Any) -> NDArray[Any]:
    # numpy calls this with an empty shape and fills the array by BUILD; whatever a hostile
    # file asks for here, it gets an empty array.
    return np.ndarray.__new__(np.ndarray, (0,), "b")


def _from_buffer(buffer: Any, dtype: Any, shape: Any, order: Any, *_rest: Any) -> NDArray[Any]:
    return np.frombuffer(buffer, dtype=dtype).reshape(shape, order=order).copy()


def _scalar(dtype: Any, data: Any = None) -> Any:
    if not isinstance(dtype, np.dtype) or dtype.hasobject or not isinstance(data, bytes | str):
        raise pickle.UnpicklingError("a numpy scalar that is not plain data")
    raw = data.encode("latin1") if isinstance(data, str) else data
    return np.frombuffer(raw, dtype=dtype, count=1)[0]


def _dtype(*arguments: Any) -> np.dtype[Any]:
    found: np.dtype[Any] = np.dtype(*arguments)
    if found.hasobject:
        # numpy fills such arrays from a list without checking it: crafted, that is a crash.
        raise UnsafeFile(
            "the pickle holds an array of Python objects",
            expected="arrays of numbers or text",
            fix="save lists of arrays, or plain arrays",
        )
    # A copy, because a pickle may change the type that it gets and others share it.
    return np.dtype(found, copy=True)


def _text(value: Any = "") -> str:
    # str() of lists nested in each other doubles with every level.
    if not isinstance(value, str):
        raise pickle.UnpicklingError("text made of something else")
    return value


def _bytes(*arguments: Any) -> bytes:
    # Old protocols write empty bytes as a call; bytes(n) would be n bytes of memory.
    if arguments:
        raise pickle.UnpicklingError("bytes made of something")
    return b""


def _encode(text: str, encoding: str = "utf-8") -> bytes:
    return codecs.encode(text, encoding if encoding in ("latin1", "latin-1") else "utf-8")


def _allowed() -> dict[str, Any]:
    names: dict[str, Any] = {
        "collections.defaultdict": collections.defaultdict,
        "collections.OrderedDict": collections.OrderedDict,
        "collections.deque": collections.deque,
        "numpy.ndarray": _ArrayType,
        "numpy.dtype": _dtype,
        "_codecs.encode": _encode,
    }
    for module in ("builtins", "__builtin__"):
        for kind in (list, dict, tuple, set, frozenset, int, float, bool, complex):
            names[f"{module}.{kind.__name__}"] = kind
        names[f"{module}.str"] = _text
        names[f"{module}.bytes"] = _bytes
    for core in ("numpy.core", "numpy._core"):
        names[f"{core}.multiarray._reconstruct"] = _reconstruct
        names[f"{core}.multiarray.scalar"] = _scalar
        names[f"{core}.numeric._frombuffer"] = _from_buffer
    return names


_ALLOWED = _allowed()


class _Unpickler(pickle.Unpickler):
    def __init__(self, stream: Any, path: Path) -> None:
        super().__init__(stream)
        self._path = path

    def find_class(self, module: str, name: str) -> Callable[..., Any]:
        try:
            found: Callable[..., Any] = _ALLOWED[f"{module}.{name}"]
        except KeyError:
            raise UnsafeFile(
                f"the pickle asks for {module}.{name}",
                expected="lists, dicts, tuples, numbers and NumPy arrays only",
                fix="save arrays instead (numpy.savez, or a dict of arrays)",
                file=self._path,
            ) from None
        return found


def load_pickle(path: str | Path, *, trust: bool) -> Any:
    """Load a pickle of containers and NumPy arrays.

    Raises
    ------
    UntrustedPickle
        Unless `trust` is true.
    UnsafeFile
        When it names anything outside the allow-list.
    UnreadableFile
        When it is not a complete pickle.
    """
    path = Path(path)
    if not trust:
        raise UntrustedPickle(
            "this is a pickle, a format that can run code when it is read",
            expected="a data format, or your word that you know where the file comes from",
            fix="if it is your own or you trust its author, say --trust (trust=True)",
            file=path,
        )
    try:
        with path.open("rb") as stream:
            value = _Unpickler(stream, path).load()
    except UnsafeFile as error:
        raise type(error)(
            error.found, expected=error.expected, fix=error.fix, file=path, key=error.key
        ) from None
    except MemoryError as error:
        raise UnsafeFile(
            "the pickle asks for more memory than there is",
            expected="data that fit in memory",
            fix="do not open it",
            file=path,
        ) from error
    except Exception as error:
        raise UnreadableFile(
            f"not a complete pickle of plain data: {type(error).__name__}: {error}",
            expected="a file written by pickle.dump",
            fix="save or copy it again",
            file=path,
        ) from error
    return value


@dataclass(frozen=True, slots=True)
class PicklePreview:
    """What a pickle mentions: dotted names it would import, and the strings in it."""

    globals: frozenset[str]
    strings: frozenset[str]


def preview_pickle(path: str | Path) -> PicklePreview | None:
    """List what the first megabyte of a pickle mentions, executing nothing.

    Returns None when the file does not read as a pickle. A pickle longer than the preview
    is judged by its beginning.
    """
    path = Path(path)
    with path.open("rb") as stream:
        head = stream.read(PREVIEW_BYTES)
    if head[:1] not in (b"\x80", b"(", b"]", b"}", b"c"):
        return None
    # Bad escapes in a damaged file are warned about by pickletools; nobody needs to hear it.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        preview, steps, whole = _mentions(head)
    if not steps or (not whole and (steps < 3 or len(head) < PREVIEW_BYTES)):
        # The preview cuts long files anywhere; what was read up to there still counts.
        return None
    return preview


def _mentions(head: bytes) -> tuple[PicklePreview, int, bool]:
    """Return what is mentioned, how many instructions were read, and whether all of them."""
    names: set[str] = set()
    strings: set[str] = set()
    recent: list[str] = []
    memo: dict[int, str] = {}
    top = ""
    steps = 0
    whole = True
    try:
        for opcode, argument, _ in pickletools.genops(head):
            steps += 1
            if opcode.name == "MEMOIZE":
                memo[len(memo)] = top
                continue
            if opcode.name in ("BINPUT", "LONG_BINPUT", "PUT"):
                memo[int(argument or 0)] = top
                continue
            top = ""
            if opcode.name in ("GLOBAL", "INST"):
                names.add(str(argument).replace(" ", "."))
            elif opcode.name == "STACK_GLOBAL" and len(recent) >= 2:
                names.add(f"{recent[-2]}.{recent[-1]}")
            elif opcode.name in ("BINGET", "LONG_BINGET", "GET"):
                top = memo.get(int(argument or 0), "")
                if top:
                    recent.append(top)
            elif isinstance(argument, str):
                top = argument
                strings.add(argument)
                recent.append(argument)
    except (ValueError, UnicodeDecodeError, IndexError):
        whole = False
    return PicklePreview(frozenset(names), frozenset(strings)), steps, whole
