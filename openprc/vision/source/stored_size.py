"""The size of a picture as it is stored, where every picture says it.

When the size changes in the middle of a file, OpenCV scales all later frames to the first size
and says nothing. Motion JPEG and MPEG-1/2 carry the size with the pictures. Markers: ITU-T
T.81, B.2.2 (JPEG); ISO/IEC 13818-2, 6.2.2.1 (MPEG).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from openprc.vision.opencv import load_cv2

#: Codes of codecs whose pictures carry their size.
CODECS = ("MJPG", "MPG1", "MPG2", "MPEG", "MP2V")
#: Start-of-frame markers of JPEG: 0xC0..0xCF but tables and arithmetic conditioning.
_START_OF_FRAME = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
#: So many pictures in a row of one other size are no damage.
LASTING = 3
_SEQUENCE = b"\x00\x00\x01\xb3"


def stored_size(packet: bytes) -> tuple[int, int] | None:
    """Return (width, height) [px] that a compressed picture names; None where it does not."""
    if packet[:2] == b"\xff\xd8":
        return _jpeg_size(packet)
    at = packet.find(_SEQUENCE, 0, 256)
    if at >= 0 and len(packet) >= at + 7:
        both = int.from_bytes(packet[at + 4 : at + 7], "big")
        return both >> 12, both & 0xFFF
    return None


def _jpeg_size(packet: bytes) -> tuple[int, int] | None:
    at = 2
    while at + 9 <= len(packet) and packet[at] == 0xFF:
        if packet[at + 1] in _START_OF_FRAME:
            height = int.from_bytes(packet[at + 5 : at + 7], "big")
            return int.from_bytes(packet[at + 7 : at + 9], "big"), height
        at += 2 + int.from_bytes(packet[at + 2 : at + 4], "big")
    return None


class SizeWatch:
    """Reads the packets of a file beside the decoder, without decoding them.

    Attributes
    ----------
    odd : int
        How many pictures so far named another size than the first.
    """

    def __init__(self, path: Path) -> None:
        cv2 = load_cv2()
        self._capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1])
        self._first: tuple[int, int] | None = None
        self._run: list[tuple[int, int]] = []
        self.odd = 0

    def changed(self) -> tuple[tuple[int, int], tuple[int, int]] | None:
        """Go to the next packet; return the sizes before and now where the size has changed.

        A single picture of another size is a damaged header; a change lasts.
        """
        delivered, packet = self._capture.read()
        size = stored_size(np.asarray(packet).tobytes()) if delivered else None
        if size is None or 0 in size:
            return None
        if self._first is None:
            self._first = size
        if size == self._first:
            self._run.clear()
            return None
        self.odd += 1
        self._run.append(size)
        lasting = len(self._run) >= LASTING and len(set(self._run[-LASTING:])) == 1
        return (self._first, size) if lasting else None

    def release(self) -> None:
        """Close the file."""
        self._capture.release()
