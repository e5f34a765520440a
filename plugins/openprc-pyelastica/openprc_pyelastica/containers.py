"""Files to a flat mapping of key to array: archives, and pickles of what callbacks filled.

Nested dicts become keys with slashes, lists of samples become stacked arrays. Nothing here
knows what the keys mean.
"""

from __future__ import annotations

import pickletools
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import NotATrajectory, SchemaError, UnreadableFile
from openprc.schema import safety
from openprc_pyelastica.grouping import coordinates, flat_time, split_key
from openprc_pyelastica.quantities import SNAPSHOT, canonical

Entries = dict[str, NDArray[np.generic]]

ZIP_MAGIC = b"PK\x03\x04"
#: An archive without members, as `ExportCallBack` leaves when no sample fell into a part.
EMPTY_ZIP_MAGIC = b"PK\x05\x06"
MAX_DEPTH = 8


def read(path: Path, *, trust: bool) -> tuple[Entries, list[str]]:
    """Read one file.

    Parameters
    ----------
    path : Path
        An archive of NumPy arrays, or a pickle.
    trust : bool
        Whether a pickle may be opened (with the restricted unpickler).

    Returns
    -------
    entries : dict of key to array
    ignored : list of str
        Keys that hold no numbers, or whose shape changes and that nothing here knows.

    Raises
    ------
    UnreadableFile, UnsafeFile, UntrustedPickle
        See `openprc.schema.safety`.
    NotATrajectory
        A pickled or saved rod: one instant, and code instead of data.
    SchemaError
        The samples of a key differ in shape.
    """
    safety.check_readable(path)
    with path.open("rb") as stream:
        magic = stream.read(4)
    if magic == EMPTY_ZIP_MAGIC:
        return {}, []
    if magic == ZIP_MAGIC:
        try:
            refuse_snapshot(path)
            arrays = safety.load_npz(path)
        except (zlib.error, TokenError) as error:
            raise UnreadableFile(
                f"the archive is damaged: {error}",
                expected="a complete file written by numpy.savez",
                fix="save or copy it again",
                file=path,
            ) from error
        return flatten(arrays, path)
    preview = safety.preview_pickle(path)
    if preview is None:
        raise UnreadableFile(
            "neither an archive of arrays (.npz) nor a complete pickle",
            expected="numpy.savez or pickle.dump of what a callback collected",
            fix="check that the script ran to its end; ExportCallBack needs simulator.close()",
            file=path,
        )
    refuse_objects(preview.globals, path)
    content = safety.load_pickle(path, trust=trust)
    refuse_appended(path)
    return flatten(content, path)


def refuse_objects(names: frozenset[str], path: Path) -> None:
    """Refuse a pickle of PyElastica objects, naming the class.

    Raises
    ------
    NotATrajectory
        When one of the dotted `names` lies in the simulator's package.
    """
    own = sorted(name for name in names if name.split(".")[0] == "elastica")
    if own:
        kind = next((name for name in own if name.rsplit(".", 1)[-1][:1].isupper()), own[0])
        raise NotATrajectory(
            f"this is a pickled {kind} object: the state of one instant, and reading it would "
            "run the simulator's code",
            expected="what a callback collected over time: time, position, velocity, ...",
            fix="pickle the callback's dict instead of the rod, or use ExportCallBack with "
            'method="npz"',
            file=path,
        )


def refuse_appended(path: Path) -> None:
    """Refuse a file into which several pickles were dumped one after the other.

    Loading such a file gives the first and silently forgets the others.

    Raises
    ------
    SchemaError
        When something follows the first pickle.
    """
    content = path.read_bytes()
    end = 0
    try:
        for _, _, position in pickletools.genops(content):
            end = (position or 0) + 1
    except ValueError as error:
        raise UnreadableFile(
            f"not a complete pickle: {error}",
            expected="a file written by pickle.dump",
            fix="save or copy it again",
            file=path,
        ) from error
    if len(content) > end:
        raise SchemaError(
            f"{len(content) - end} bytes follow the first pickle: several were dumped one after "
            "the other",
            expected="one pickle in a file",
            fix="collect the rods in one dict and dump that, or use one file for each",
            file=path,
        )


def refuse_snapshot(path: Path) -> None:
    """Refuse an archive with the attributes of one rod, as ``save_state`` writes it.

    Raises
    ------
    NotATrajectory
        When it is one.
    """
    headers = safety.npz_headers(path)
    shape = headers.get("position_collection", ((), None))[0]
    if headers.keys() >= SNAPSHOT and len(shape) == 2 and "time" not in headers:
        raise NotATrajectory(
            "this is the saved state of one rod (save_state): a single instant without time",
            expected="a record over time: time, position, velocity, ...",
            fix="record with a callback, for example ExportCallBack, and import what it writes",
            file=path,
        )


def flatten(content: Any, path: Path) -> tuple[Entries, list[str]]:
    """Turn nested dicts and lists of samples into a mapping of key to array.

    Raises
    ------
    UnreadableFile
        When `content` is not a dict, nor a list of dicts.
    SchemaError
        The samples of a key differ in shape.
    """
    entries: Entries = {}
    ignored: list[str] = []
    if not isinstance(content, Mapping) and not _is_records(content):
        raise UnreadableFile(
            f"it holds a {type(content).__name__}",
            expected="a dict of lists or arrays (time, position, ...), or a list of such dicts",
            fix="pickle the dict that the callback filled",
            file=path,
        )
    _walk(content, "", entries, ignored, path, 0)
    for key, array in entries.items():
        if flat_time(array.shape) and split_key(key)[1] == "time":
            entries[key] = array.reshape(-1)
    for key, parts in coordinates({name: array.shape for name, array in entries.items()}).items():
        if key not in entries:
            entries[key] = np.stack([entries.pop(part) for part in parts], axis=1)
    return entries, sorted(ignored)


def _walk(
    value: Any, key: str, entries: Entries, ignored: list[str], path: Path, depth: int
) -> None:
    if depth > MAX_DEPTH:
        raise UnreadableFile(
            f"dicts are nested deeper than {MAX_DEPTH}",
            expected="one dict, or one for each rod",
            fix="save a flatter structure",
            file=path,
            key=key,
        )
    if isinstance(value, Mapping):
        for name, item in value.items():
            _walk(item, f"{key}/{name}" if key else str(name), entries, ignored, path, depth + 1)
    elif _is_records(value):
        if all(_is_sample(item) for item in value):
            _walk(_collate(value, path, key), key, entries, ignored, path, depth + 1)
        else:
            for index, item in enumerate(value):
                name = f"rod{index}"
                inner = f"{key}/{name}" if key else name
                _walk(item, inner, entries, ignored, path, depth + 1)
    else:
        array = _stack(value, path, key)
        if array is None:
            ignored.append(key)
        else:
            entries[key] = array


def _is_records(value: Any) -> bool:
    return (
        isinstance(value, list | tuple)
        and len(value) > 0
        and all(isinstance(item, Mapping) for item in value)
    )


def _is_sample(item: Mapping[Any, Any]) -> bool:
    return any(canonical(str(name)) == "time" and np.ndim(item[name]) == 0 for name in item)


def _collate(samples: Sequence[Mapping[Any, Any]], path: Path, key: str) -> dict[str, list[Any]]:
    names = list(samples[0])
    for index, sample in enumerate(samples):
        if list(sample) != names:
            raise SchemaError(
                f"sample {index} has the keys {sorted(map(str, sample))}, "
                f"sample 0 {sorted(map(str, names))}",
                expected="the same keys in every sample",
                fix="store every quantity at every sample",
                file=path,
                key=key or None,
            )
    return {str(name): [sample[name] for sample in samples] for name in names}


def _stack(value: Any, path: Path, key: str) -> NDArray[np.generic] | None:
    if isinstance(value, np.ndarray) and value.dtype.hasobject:
        value = value.tolist()
    if isinstance(value, list | tuple):
        shapes = [np.shape(item) if isinstance(item, np.ndarray) else None for item in value]
        odd = next((i for i, shape in enumerate(shapes) if shape != shapes[0]), None)
        if odd is not None and None not in (shapes[0], shapes[odd]):
            if split_key(key)[1] is None:
                return None  # contacts and the like come and go; the run is good without them
            raise SchemaError(
                f"sample {odd} has shape {shapes[odd]}, sample 0 has {shapes[0]}",
                expected="the same shape in every sample",
                fix="a rod that grows or splits has no fixed set of nodes; import the part "
                "before the change",
                file=path,
                key=key,
            )
    try:
        array = np.asarray(value)
    except ValueError as error:
        if split_key(key)[1] is None:
            return None
        raise SchemaError(
            f"the samples cannot be stacked: {error}",
            expected="numbers or arrays of one shape",
            fix="store copies of the rod's arrays at every sample",
            file=path,
            key=key,
        ) from error
    if array.dtype.kind not in "biuf":
        return None
    return array
