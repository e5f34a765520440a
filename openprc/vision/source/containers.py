"""Which container a file is, judged by its first bytes, and why one would not open."""

from __future__ import annotations

from pathlib import Path

from openprc.errors import VideoError
from openprc.schema import safety

#: (offset, bytes, name) of what stands at the beginning of a container.
_SIGNATURES: tuple[tuple[int, bytes, str], ...] = (
    (0, b"\x1aE\xdf\xa3", "Matroska/WebM"),
    (0, b"\x00\x00\x01\xba", "MPEG"),
    (0, b"\x00\x00\x01\xb3", "MPEG"),
    (0, b"GIF8", "GIF"),
    (0, b"FLV\x01", "FLV"),
    (0, b"OggS", "Ogg"),
    (0, b"YUV4MPEG2", "Y4M"),
    (0, b"\x30\x26\xb2\x75\x8e\x66\xcf\x11", "ASF/WMV"),
    (4, b"ftyp", "MP4/MOV"),
    (4, b"moov", "MP4/MOV"),
    (4, b"mdat", "MP4/MOV"),
    (4, b"wide", "MP4/MOV"),
)
#: Containers that store no number of frames: what OpenCV declares is duration times rate.
ESTIMATED_COUNT = ("Matroska/WebM", "MPEG", "MPEG-TS", "FLV", "Ogg", "ASF/WMV")
#: Containers in which a seek lands beside the frame that was asked for.
UNSAFE_SEEK = ("MPEG", "MPEG-TS", "FLV", "Ogg", "ASF/WMV", "GIF")


def container(path: Path) -> str | None:
    """Name the video container from the first bytes of the file, or return None."""
    with path.open("rb") as stream:
        head = stream.read(377)
    if head[:4] == b"RIFF" and head[8:12] == b"AVI ":
        return "AVI"
    for offset, signature, name in _SIGNATURES:
        if head[offset : offset + len(signature)] == signature:
            return name
    # Transport stream: packets of 188 bytes, each beginning with 0x47.
    if len(head) == 377 and all(head[at] == 0x47 for at in (0, 188, 376)):
        return "MPEG-TS"
    return None


def check_video(path: Path) -> str:
    """Return the container's name.

    Raises
    ------
    UnreadableFile
        Missing, a directory, or empty.
    VideoError
        Not one of the containers.
    """
    path = safety.check_readable(path)
    name = container(path)
    if name is None:
        # A decoder that is let loose on anything would follow playlists to other files.
        with path.open("rb") as stream:
            head = stream.read(16)
        raise VideoError(
            f"this is not a video: it begins with {head!r}",
            expected="an AVI, MP4, MOV, Matroska, WebM, MPEG, ASF, FLV, Ogg, GIF or Y4M file",
            fix="check the file, or convert it to one of these containers",
            file=path,
        )
    return name


def why_not_opened(path: Path, name: str) -> VideoError:
    """Return the error for a container that the decoder refuses."""
    found = f"the {name} container cannot be opened"
    fix = "copy it again, or convert it with the program that can play it"
    if name == "MP4/MOV":
        found, fix = cut_index(path) or (f"{found}: its index names no frame", fix)
    elif name == "AVI":
        found += ": its header is damaged or the codec is unknown"
    return VideoError(
        found, expected="a video that was closed by what recorded it", fix=fix, file=path
    )


def cut_index(path: Path) -> tuple[str, str] | None:
    """Return what is wrong with the index of an MP4 file and what to do; None if it is whole."""
    boxes = mp4_boxes(path)
    if b"moov" not in boxes:
        return (
            "the index of this MP4/MOV file (the box 'moov') is missing, as after an interrupted "
            "recording",
            "copy it again; if the original is no better, a repair needs an intact file of the "
            "same camera",
        )
    if boxes[b"moov"] > path.stat().st_size:
        return (
            "the index of this MP4/MOV file (the box 'moov') is cut off",
            "copy it again: the end of the file is missing",
        )
    return None


def mp4_boxes(path: Path) -> dict[bytes, int]:
    """Return the outermost boxes of an MP4 file and where each ends [bytes]."""
    boxes: dict[bytes, int] = {}
    size = path.stat().st_size
    at = 0
    with path.open("rb") as stream:
        while at + 8 <= size and len(boxes) < 1000:
            stream.seek(at)
            head = stream.read(16)
            length = int.from_bytes(head[:4], "big")
            if length == 1:
                length = int.from_bytes(head[8:16], "big")
            elif length == 0:
                length = size - at
            if length < 8:
                break
            at += length
            boxes[head[4:8]] = at
    return boxes


def fourcc(code: int) -> str:
    """Return the four letters of a codec or pixel format code."""
    letters = "".join(chr(code >> shift & 0xFF) for shift in (0, 8, 16, 24))
    kept = "".join(letter for letter in letters if letter.isprintable()).strip()
    return kept or "unknown"
