"""How sure the importer is about a file, by its content and without reading all of it."""

from __future__ import annotations

from pathlib import Path

from openprc.errors import OpenPRCError
from openprc.schema import safety
from openprc_pybullet import refusals, state_log, user_csv
from openprc_pybullet.user_run import FACE_KEYS, POSITION_KEYS, TIME_KEYS, TIME_KEYS_MS

#: Keys of PyElastica's diagnostics: such files belong to its importer.
_ELASTICA = (
    "directors", "director_collection", "sigma", "kappa", "dilatation", "position_collection",
    "com", "curvature", "rest_lengths",
)  # fmt: skip
_TIMES = (*TIME_KEYS, *TIME_KEYS_MS)


def sniff(path: Path) -> float:
    """Return 0 to 1 as `openprc.hooks.protocols.Importer.sniff` says; never raises."""
    try:
        if not path.is_file() or path.stat().st_size == 0:
            return 0.0
        head = refusals.read_head(path)
        if refusals.recognise(head) is not None:
            return 0.9
        if head.startswith(b"PK\x03\x04"):
            return _sniff_npz(path)
        header = state_log.peek_header(path)
        if header is not None:
            return _sniff_log(path, header)
        return max(_sniff_csv(path), _sniff_pickle(path))
    except (OSError, ValueError, OpenPRCError):
        # A file that cannot be read, or not as what it looked like, is not ours to claim.
        return 0.0


def _sniff_log(path: Path, header: state_log.LogHeader) -> float:
    if not state_log.begins_with_record(path, header):
        return 0.3
    return 0.9 if header.family in ("unknown", "vr") else 1.0


def _sniff_npz(path: Path) -> float:
    headers = safety.npz_headers(path)
    lower = {name.lower(): shape for name, (shape, _) in headers.items()}
    length = next((lower[key][0] for key in _TIMES if key in lower and len(lower[key]) == 1), None)
    if length is None or length < 2 or any(_is_elastica(name) for name in lower):
        return 0.0
    framed = {
        name: shape
        for name, shape in lower.items()
        if len(shape) == 3 and shape[0] == length and shape[2] == 3
    }
    flat = {
        name: shape
        for name, shape in lower.items()
        if name in POSITION_KEYS and len(shape) == 2 and shape[0] == length and shape[1] % 3 == 0
    }
    if any(shape[1] == 3 for shape in framed.values()) and "step" in lower:
        return 0.4  # three nodes: (T, N, 3) and PyElastica's (T, 3, N) look the same
    if framed.get("position", (0, 0))[1] == 3:
        return 0.55  # as good a guess as PyElastica's, so that the user is asked
    known = any(name in POSITION_KEYS for name in framed) or any(key in lower for key in FACE_KEYS)
    if framed:
        return 0.7 if known else 0.6
    return 0.6 if flat else 0.0


def _is_elastica(name: str) -> bool:
    return any(name == key or name.endswith("_" + key) for key in _ELASTICA)


def _sniff_csv(path: Path) -> float:
    header = user_csv.peek_header(path)
    if header is None:
        return 0.0
    placed, turned = header.groups("p"), header.groups("q")
    if not (placed and turned):
        # A table with a time column belongs to the importer of general tables.
        return 0.3 if placed and header.time else 0.0
    # Without time it is refused or needs dt; claiming it gives the user the reason.
    return 0.75 if header.time else 0.55


def _sniff_pickle(path: Path) -> float:
    preview = safety.preview_pickle(path)
    if preview is None:
        return 0.0
    strings = {text.lower() for text in preview.strings}
    if any(_is_elastica(text) for text in strings) or "collections.defaultdict" in preview.globals:
        return 0.2
    if any(not name.startswith(_PLAIN) for name in preview.globals):
        return 0.0
    timed = bool(strings & set(_TIMES))
    placed = bool(strings & set(POSITION_KEYS))
    if timed and placed:
        return 0.4 if "step" in strings else 0.6
    return 0.3 if any("ndarray" in name or "scalar" in name for name in preview.globals) else 0.1


_PLAIN = ("numpy", "builtins.", "__builtin__.", "_codecs.", "collections.OrderedDict")
