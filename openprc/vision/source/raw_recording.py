"""Photron recordings: raw frames (.mraw) and a header beside them (.cih or .cihx)."""

from __future__ import annotations

import re
from collections.abc import Generator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import VideoError
from openprc.schema import safety
from openprc.vision.source.time_axis import count_fault

SUFFIXES = (".mraw", ".cih", ".cihx")
_MIB = 1 << 20
#: The names in an XML header (.cihx) of what a text header (.cih) calls ...
_XML_NAMES = {
    "Image Width": "width",
    "Image Height": "height",
    "Color Bit": "bit",
    "Total Frame": "totalFrame",
    "Record Rate(fps)": "recordRate",
    "Save Step": "skipFrame",
    "EffectiveBit Depth": "depth",
    "EffectiveBit Side": "side",
    "File Format": "fileFormat",
    "Camera Type": "deviceName",
}


class RawRecording:
    """Frames of 8, 10, 12 or 16 bit grey, one after the other without a header in between.

    10 and 12 bit are packed without gaps, the most significant bit first. The rate is the
    record rate divided by the step at which frames were kept (``Save Step``).

    Raises
    ------
    UnreadableFile
        One of the two files is missing or empty.
    VideoError
        The header lacks something, or describes what is not read here.
    """

    kind = "raw"
    container = "Photron MRAW"
    orientation = 0

    def __init__(self, path: Path) -> None:
        self.path, header = _pair(path)
        self._header_path = header
        fields = read_header(header)
        self.notes: list[str] = []
        self.faults: list[str] = []
        self._width = int(_number(fields, "Image Width", header))
        self._height = int(_number(fields, "Image Height", header))
        self._bits = int(_number(fields, "Color Bit", header))
        if self._bits not in (8, 10, 12, 16) or "color" in fields.get("Color Type", "").lower():
            raise VideoError(
                f"{fields.get('Color Type', 'unknown')} frames of {self._bits} bit",
                expected="monochrome frames of 8, 10, 12 or 16 bit",
                fix="export the recording as TIFF or AVI with the camera's program",
                file=header,
                key="Color Bit",
            )
        rate = _number(fields, "Record Rate(fps)", header)
        step = max(1.0, float(fields.get("Save Step", 1) or 1))
        self.declared_fps = rate / step
        if step > 1:
            self.notes.append(
                f"recorded at {rate:g} Hz, of which every {step:g}th frame was kept: "
                f"{self.declared_fps:g} Hz"
            )
        self._bytes = -(-self._width * self._height * self._bits // 8)
        self.codec = f"grey {self._bits} bit"
        self.value_range = _value_range(self._bits, fields)
        held = self.path.stat().st_size // self._bytes
        declared = int(_number(fields, "Total Frame", header))
        self.frame_count = declared
        if held > declared:
            self.notes.append(f"the file has room for {held} frames; the header says {declared}")
        self._held = min(held, declared)

    def files(self) -> list[Path]:
        """Return the files that hold the recording."""
        return [self._header_path, self.path]

    def images(self, *, start: int = 0) -> Generator[tuple[NDArray[Any], float]]:
        """Yield image and stamp [s] from frame `start` on."""
        with self.path.open("rb") as stream:
            stream.seek(start * self._bytes)
            for k in range(start, self._held):
                data = np.fromfile(stream, dtype=np.uint8, count=self._bytes)
                yield self._unpacked(data), k / self.declared_fps

    def ended(self, decoded: int) -> list[str]:
        """Return what turned out to be wrong when `decoded` frames had been read."""
        return count_fault(self.frame_count, decoded)

    def _unpacked(self, data: NDArray[np.uint8]) -> NDArray[Any]:
        shape = self._height, self._width
        if self._bits == 8:
            return data.reshape(shape)
        if self._bits == 16:
            return data.view("<u2").astype(np.uint16).reshape(shape)
        return unpack_bits(data, self._bits, shape[0] * shape[1]).reshape(shape)


def unpack_bits(data: NDArray[np.uint8], bits: int, count: int) -> NDArray[np.uint16]:
    """Return `count` values of `bits` each, packed with the most significant bit first."""
    # A value of at most 16 bits that begins anywhere in a byte lies within three bytes.
    begin = np.arange(count, dtype=np.int64) * bits
    padded = np.concatenate([data, np.zeros(2, dtype=np.uint8)]).astype(np.uint32)
    at = begin >> 3
    window = padded[at] << 16 | padded[at + 1] << 8 | padded[at + 2]
    shift = (24 - bits - (begin & 7)).astype(np.uint32)
    return (window >> shift & np.uint32(2**bits - 1)).astype(np.uint16)


def read_header(path: Path) -> dict[str, str]:
    """Return the fields of a .cih text header or of the XML in a .cihx file."""
    path = safety.check_readable(path)
    with path.open("rb") as stream:
        text = stream.read(_MIB).decode("utf-8", errors="replace")
    if path.suffix.lower() == ".cihx":
        fields = {}
        for name, tag in _XML_NAMES.items():
            found = re.search(rf"<{tag}>\s*([^<]*?)\s*</{tag}>", text)
            if found:
                fields[name] = found[1]
        kind = re.search(r"<colorInfo>.*?<type>\s*([^<]*?)\s*</type>", text, re.DOTALL)
        if kind:
            fields["Color Type"] = kind[1]
        return fields
    pairs = (line.split(" :", 1) for line in text.splitlines() if " :" in line)
    fields = {}
    for name, value in pairs:
        # The first of its name: what the viewer appends below repeats some.
        fields.setdefault(name.strip(), value.strip())
    return fields


def _pair(path: Path) -> tuple[Path, Path]:
    """Return the frames' file and the header's, given either."""
    path = safety.check_readable(path)
    wanted = (".mraw",) if path.suffix.lower() != ".mraw" else (".cih", ".cihx")
    beside = sorted(path.parent.glob(glob_escape(path.stem) + ".*"))
    for suffix in wanted:
        for other in beside:
            if other.suffix.lower() == suffix:
                pair = (other, path) if wanted == (".mraw",) else (path, other)
                return safety.check_readable(pair[0]), safety.check_readable(pair[1])
    raise VideoError(
        f"there is no {' or '.join(wanted)} file of the same name beside it",
        expected="the frames (.mraw) and the header (.cih) in one folder",
        fix="copy both files of the recording",
        file=path,
    )


def glob_escape(text: str) -> str:
    """Return a pattern that matches `text` only."""
    return re.sub(r"([*?[])", r"[\1]", text)


def _number(fields: dict[str, str], name: str, path: Path) -> float:
    try:
        value = float(fields[name])
    except (KeyError, ValueError):
        value = np.nan
    if not (np.isfinite(value) and 0 < value < 1e9):
        raise VideoError(
            f"the header says {fields.get(name, 'nothing')!r}",
            expected="a positive number",
            fix="copy the header again, or correct this line",
            file=path,
            key=name,
        )
    return value


def _value_range(bits: int, fields: dict[str, str]) -> tuple[float, float] | None:
    """Return the range of values that the sensor fills; None for 8 bit."""
    if bits == 8:
        return None
    if bits == 16 and fields.get("EffectiveBit Side", "").lower().startswith("low"):
        depth = fields.get("EffectiveBit Depth", "")
        bits = int(depth) if depth.isdigit() and 8 <= int(depth) <= 16 else bits
    return 0.0, 2.0**bits - 1.0
