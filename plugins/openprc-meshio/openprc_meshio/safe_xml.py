"""XML of unknown origin: parsed without entities, and file names that stay in their folder."""

from __future__ import annotations

from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import NoReturn
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from openprc.errors import UnreadableFile, UnsafeFile
from openprc.schema import safety

#: Elements deeper than this belong to no mesh file.
_MAX_DEPTH = 64


def parse(path: Path, *, stop_at: str | None = None) -> Element:
    """Parse an XML file; names lose their prefix, ``xi:include`` is ``include``.

    A document type may be named, as FEniCS does (``<!DOCTYPE Xdmf SYSTEM "Xdmf.dtd" []>``):
    it is never fetched. Entities may be neither declared nor used.

    Parameters
    ----------
    path : Path
    stop_at : str, optional
        Nothing is read after the start of an element of this name: what follows may be bytes.

    Raises
    ------
    UnreadableFile
        When it is not well-formed.
    UnsafeFile
        When it declares or uses an entity, or is nested beyond reason.
    """
    safety.check_readable(path)
    reader = _Reader(path, stop_at)
    with path.open("rb") as stream:
        return reader.read(stream)


class _Reader:
    def __init__(self, path: Path, stop_at: str | None) -> None:
        self._path = path
        self._stop_at = stop_at
        self._stopped = False
        self._open: list[str] = []
        self._tree = TreeBuilder()
        parser = self._parser = expat.ParserCreate()
        parser.buffer_text = True
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._text
        parser.EntityDeclHandler = self._refuse
        parser.UnparsedEntityDeclHandler = self._refuse
        parser.ExternalEntityRefHandler = self._refuse
        parser.SkippedEntityHandler = self._refuse

    def read(self, stream: object) -> Element:
        try:
            while not self._stopped and (block := stream.read(1 << 20)):  # type: ignore[attr-defined]
                self._parser.Parse(block, False)
            if not self._stopped:
                self._parser.Parse(b"", True)
        except expat.ExpatError as error:
            if not self._stopped:
                raise UnreadableFile(
                    f"this is not XML: {error}",
                    expected="a well-formed XML file",
                    fix="export or copy it again; a run that was killed leaves it cut off",
                    file=self._path,
                ) from None
        while self._open:
            self._tree.end(self._open.pop())
        return self._tree.close()

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        if self._stopped:
            return
        short = name.rpartition(":")[2]
        if len(self._open) >= _MAX_DEPTH:
            raise UnsafeFile(
                f"elements are nested deeper than {_MAX_DEPTH}",
                expected="a mesh file",
                fix="do not open it",
                file=self._path,
            )
        self._open.append(short)
        self._tree.start(short, {k.rpartition(":")[2]: v for k, v in attributes.items()})
        self._stopped = short == self._stop_at

    def _end(self, name: str) -> None:
        if not self._stopped:
            self._tree.end(self._open.pop())

    def _text(self, text: str) -> None:
        if not self._stopped:
            self._tree.data(text)

    def _refuse(self, name: str, *_: object) -> NoReturn:
        raise UnsafeFile(
            f"it declares or uses the XML entity {name!r}",
            expected="plain XML: entities can read other files or grow to any size",
            fix="ask its author for a file without entities",
            file=self._path,
        )


def inside(name: str, *, of: Path) -> Path:
    """Return the file that `name`, found in the file `of`, means.

    Raises
    ------
    UnsafeFile
        When it leads out of the folder of `of`, also by a symbolic link.
    UnreadableFile
        When it is not there.
    """
    text = name.strip()
    posix, windows = PurePosixPath(text), PureWindowsPath(text)
    leads_out = (
        posix.is_absolute() or windows.drive or windows.root
        or ".." in posix.parts or ".." in windows.parts or "\0" in text or "://" in text
    )  # fmt: skip
    folder = of.parent.resolve()
    target = folder if leads_out or not text else (folder / text).resolve()
    if leads_out or not target.is_relative_to(folder):
        raise UnsafeFile(
            f"it refers to {text!r}, outside its folder",
            expected="files beside it or in folders below",
            fix="put what belongs together into one folder, and correct the name in the file",
            file=of,
        )
    if not target.is_file():
        raise UnreadableFile(
            f"it refers to {text!r}, which is not there",
            expected="every file that it names beside it",
            fix="copy that file as well; some programs write it into the folder they were "
            "started in",
            file=of,
        )
    return target
