"""A path to a list of rods: the parts of the import put in order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from openprc.errors import ConfigError, MissingData, NotATrajectory, SchemaError, UnreadableFile
from openprc_pyelastica import chunks, clock, containers, rods
from openprc_pyelastica.containers import Entries
from openprc_pyelastica.grouping import Grouping, group, split_key, unstack


@dataclass
class Recording:
    """Everything that was read from a path.

    Parameters
    ----------
    entries : mapping of key to array
    sources : tuple of Path
        Files that were read besides the path itself.
    notes : list of str
    """

    entries: Entries
    sources: tuple[Path, ...] = ()
    notes: list[str] = field(default_factory=list)


def load(path: Path, *, options: Mapping[str, Any]) -> Recording:
    """Read a file, a numbered part together with the other parts, or a folder of parts.

    Raises
    ------
    UnreadableFile
        The path is missing, or a folder without numbered parts, or one with several runs.
    SchemaError, IncompleteFile
        See `openprc_pyelastica.chunks.join`.
    """
    if path.is_dir():
        return _load_folder(path, options)
    trust = bool(options["trust"])
    entries, ignored = containers.read(path, trust=trust)
    recording = Recording(entries, notes=_ignored(ignored, path))
    parts = chunks.of_file(path) if options["parts"] == "all" else None
    if parts is None or len(parts.paths) == 1:
        return _unstacked(recording)
    contents = [
        entries if other == path else containers.read(other, trust=trust)[0]
        for other in parts.paths
    ]
    parts, contents, remarks = chunks.without_empty(parts, contents)
    recording.notes += remarks
    if _separate(contents):
        recording.notes.append(
            f"other files named {parts.stem}_NN are runs of their own and were left alone"
        )
        return _unstacked(recording)
    joined, notes = chunks.join(contents, parts, gaps=options["gaps"])
    others = tuple(other for other in parts.paths if other != path)
    return _unstacked(Recording(joined, others, recording.notes + notes))


def _load_folder(folder: Path, options: Mapping[str, Any]) -> Recording:
    sets = chunks.in_folder(folder)
    if not sets:
        raise UnreadableFile(
            "the folder holds no parts named NAME_00.npz, NAME_01.npz, ...",
            expected="what ExportCallBack writes, or the name of one file",
            fix="name the file to import; ExportCallBack writes its last part only when "
            "simulator.close() is called",
            file=folder,
        )
    whole: Entries = {}
    notes: list[str] = []
    for parts in sets:
        contents = []
        for path in parts.paths:
            entries, ignored = containers.read(path, trust=bool(options["trust"]))
            contents.append(entries)
            notes += _ignored(ignored, path)
        parts, contents, empty = chunks.without_empty(parts, contents)
        notes += empty
        if len(contents) > 1 and _separate(contents):
            raise SchemaError(
                f"the files {parts.stem}_NN are not parts of one run: they start at the same "
                "time or hold different things",
                expected="parts that follow each other",
                fix="name one of the files instead of the folder",
                file=folder,
            )
        joined, remarks = chunks.join(contents, parts, gaps=options["gaps"])
        notes += remarks
        prefix = f"{parts.stem}/" if len(sets) > 1 else ""
        whole.update({prefix + key: array for key, array in joined.items()})
    return _unstacked(Recording(whole, notes=notes))


def _separate(contents: list[Entries]) -> bool:
    return any(chunks.are_separate_runs(contents[0], other) for other in contents[1:])


def _ignored(keys: list[str], path: Path) -> list[str]:
    return (
        [f"{path.name}: {', '.join(keys)} hold no numbers of one shape and were left out"]
        if keys
        else []
    )


def _unstacked(recording: Recording) -> Recording:
    parts = unstack({key: array.shape for key, array in recording.entries.items()})
    if parts:
        recording.notes.append("several rods were stacked in one array; they are taken apart")
    stacked = {key for key, _ in parts.values()}
    split = {new: recording.entries[key][:, index] for new, (key, index) in parts.items()}
    rest = {key: array for key, array in recording.entries.items() if key not in stacked}
    recording.entries = {**rest, **split}
    return recording


def find_rods(recording: Recording, *, options: Mapping[str, Any]) -> Grouping:
    """Sort the keys of a recording by rod and keep the rods that were asked for.

    Raises
    ------
    MissingData
        No node positions, or none under the key that was named.
    NotATrajectory
        What is called position is one number a sample, or a single instant.
    ConfigError
        A rod that is not in the file.
    """
    entries = recording.entries
    for option in ("position", "time"):
        if options[option] is not None and options[option] not in entries:
            raise _no_key(option, options[option], entries)
    shapes = {key: array.shape for key, array in entries.items()}
    found = group(shapes, position=options["position"], time=options["time"])
    if not found.rods:
        raise _no_positions(entries)
    _refuse_instant(found, entries)
    _tell_choice(recording, found)
    wanted = tuple(options["rods"] or ())
    names = {display_name(name, found): name for name in found.rods}
    unknown = [name for name in wanted if name not in names]
    if unknown:
        raise ConfigError(
            f"no rod is called {', '.join(unknown)}",
            expected=f"some of {', '.join(names)}",
            fix="leave rods out to import all of them",
            key="rods",
        )
    if not wanted:
        return found
    kept = {names[name]: found.rods[names[name]] for name in wanted}
    extras = {name: keys for name, keys in found.extras.items() if name in kept}
    left_out = tuple(name for name in found.rods if name and name not in kept)
    extras[""] = tuple(
        key for key in found.extras.get("", ()) if not key.startswith(left_out or ("\0",))
    )
    return Grouping(kept, found.shared, extras)


def _tell_choice(recording: Recording, found: Grouping) -> None:
    for name, slots in found.rods.items():
        for key in found.extras.get(name, ()):
            if split_key(key)[1] == "position" and recording.entries[key].ndim == 3:
                recording.notes.append(
                    f"{slots['position']} was taken for the positions, not {key}; "
                    "position=KEY overrides"
                )


def display_name(name: str, found: Grouping) -> str:
    """Return what a rod is called in labels; the one without prefix is ``rod0``."""
    if name:
        return name
    return "rod0" if "rod0" not in found.rods else "rod"


def build_rods(
    recording: Recording, found: Grouping, *, options: Mapping[str, Any]
) -> tuple[list[rods.Rod], list[clock.Clock]]:
    """Clean every rod and check that they share one clock.

    Raises
    ------
    SchemaError, ConfigError, MissingData
        See `openprc_pyelastica.clock` and `openprc_pyelastica.rods`.
    """
    built, clocks = [], []
    for name, own in found.rods.items():
        slots = {**{k: v for k, v in found.shared.items() if k in ("time", "step")}, **own}
        label = display_name(name, found)
        ticks = clock.read(
            slots, recording.entries, dt=options["dt"], notes=recording.notes, name=label
        )
        rod = rods.build(
            label,
            slots,
            found.extras.get(name, ()) if name else (),
            recording.entries,
            clock=ticks,
            axes=options["axes"],
        )
        recording.notes.extend(rod.notes)
        built.append(rod)
        clocks.append(ticks)
    rods.check_common_clock(built)
    return built, clocks


def _no_key(option: str, key: str, entries: Entries) -> MissingData:
    return MissingData(
        f"there is no key {key!r}",
        expected=f"one of {', '.join(sorted(entries))}",
        fix=f"correct the option {option}",
        key=option,
    )


def _no_positions(entries: Entries) -> NotATrajectory | MissingData:
    for key, array in entries.items():
        if split_key(key)[1] == "position" and array.ndim <= 1:
            return NotATrajectory(
                "one number a sample, not the coordinates of nodes",
                expected="positions of shape (T, 3, n): all of system.position_collection",
                fix="store system.position_collection.copy() in the callback and run again; a "
                "single coordinate cannot be turned into a trajectory",
                key=key,
            )
    listed = ", ".join(f"{key} {array.shape}" for key, array in sorted(entries.items()))
    return MissingData(
        f"no node positions among {listed or 'no arrays at all'}",
        expected="a key such as position with shape (T, 3, n)",
        fix="say position=KEY if they have another name",
        key="position",
    )


def _refuse_instant(found: Grouping, entries: Entries) -> None:
    for slots in found.rods.values():
        key = slots["position"]
        time = entries.get(slots.get("time") or found.shared.get("time") or "")
        shape = entries[key].shape
        if len(shape) == 2 and shape[0] == 3 and time is not None and np.size(time) == 1:
            raise NotATrajectory(
                f"positions of shape {shape} at a single time: one instant",
                expected="many samples, (T, 3, n)",
                fix="collect the positions in a callback, not after the run",
                key=key,
            )
