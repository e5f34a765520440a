"""PyElastica recordings to a trajectory."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.errors import Diverged, OpenPRCError
from openprc_pyelastica import divergence, drive, extras, plane, publish, recording, sniffing
from openprc_pyelastica.rods import Rod
from openprc_pyelastica.scaling import to_metres

if TYPE_CHECKING:
    from openprc.schema import TrajectoryWriter


class Importer:
    """Reads what callbacks of a PyElastica script saved (capability ``"import"``)."""

    def sniff(self, path: Path) -> float:
        """Return the confidence that `path` is such a recording."""
        return sniffing.score(Path(path))

    def import_run(
        self, path: Path, writer: TrajectoryWriter, *, options: Mapping[str, Any]
    ) -> None:
        """Write the recording at `path` into `writer`.

        Raises
        ------
        Diverged
            The simulation blew up and ``diverged`` is ``"error"``.
        OpenPRCError
            Whatever else keeps the file from being a trajectory, with what to do.
        """
        path = Path(path)
        try:
            _import(path, writer, options)
        except OpenPRCError as error:
            if error.file is not None:
                raise
            raise type(error)(
                error.found, expected=error.expected, fix=error.fix, file=path, key=error.key
            ) from error


def _import(path: Path, writer: TrajectoryWriter, options: Mapping[str, Any]) -> None:
    loaded = recording.load(path, options=options)
    for source in loaded.sources:
        writer.add_source(source, role="part")
    found = recording.find_rods(loaded, options=options)
    key, found = drive.pick(loaded, found, options["input"])
    rods, clocks = recording.build_rods(loaded, found, options=options)
    shared = extras.shared_series(loaded, found, clocks[0])
    driven = drive.read(key, loaded, clocks[0])
    rods = [to_metres(rod, unit=options["unit"]) for rod in rods]
    frames = _sound_frames(rods, options["diverged"], loaded.notes)
    flat = plane.flat_axes(rods)
    if options["plane"] is not None:
        rods = plane.project(rods, plane=options["plane"])
    elif len(flat) == 1:
        other = plane.AXES.replace(flat, "")
        loaded.notes.append(f"nothing moves along {flat}; plane={other} leaves that axis out")
    publish.write(writer, rods, shared, driven, frames=frames, options=options, notes=loaded.notes)
    for note in loaded.notes:
        writer.note(note)


def _sound_frames(rods: list[Rod], policy: str, notes: list[str]) -> int:
    total = len(rods[0].time)
    hits = [
        (hit.frame, rod, hit.reason)
        for rod in rods
        if (
            hit := divergence.find(
                rod.time, rod.positions, velocities=rod.velocities, lengths=rod.lengths
            )
        )
    ]
    if not hits:
        return total
    frame, rod, reason = min(hits, key=lambda hit: hit[0])
    at = f"rod {rod.name} diverged at frame {frame}, t = {rod.time[frame]:.6g} s: {reason}"
    finite = all(
        np.isfinite(one.positions).all()
        and (one.velocities is None or np.isfinite(one.velocities).all())
        for one in rods
    )
    if policy == "keep" and finite:
        notes.append(f"{at}; kept because diverged=keep")
        return total
    if policy == "trim" and frame > 0:
        notes.append(
            f"{at}; this and the {total - frame - 1} later frames were left out, and the last "
            "ones before it deserve suspicion"
        )
        return frame
    ways = ["run again with a shorter time step"]
    if frame > 0:
        ways.append(f"diverged=trim imports the {frame} frame(s) before it")
    if finite:
        ways.append("diverged=keep imports everything as it is")
    raise Diverged(
        at,
        expected="finite positions, elements no longer than "
        f"{divergence.MAX_STRETCH:g} times their first length",
        fix="; ".join(ways),
        key="diverged",
    )
