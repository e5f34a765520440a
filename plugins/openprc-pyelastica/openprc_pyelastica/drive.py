"""What drove the rod: an array that the script stored beside the positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, MissingData
from openprc_pyelastica.clock import Clock
from openprc_pyelastica.extras import clean_name
from openprc_pyelastica.grouping import Grouping
from openprc_pyelastica.quantities import DRIVES
from openprc_pyelastica.recording import Recording


@dataclass(frozen=True)
class Drive:
    """A named drive, (T, C) on the clock of the file."""

    name: str
    value: NDArray[np.float64]


def pick(loaded: Recording, found: Grouping, wanted: str | None) -> tuple[str | None, Grouping]:
    """Choose the key that holds the drive and take it out of the remaining keys.

    Parameters
    ----------
    loaded : Recording
    found : Grouping
    wanted : str, optional
        What the caller named; ``"none"`` for no drive.

    Raises
    ------
    MissingData
        The named key is not there.
    ConfigError
        Several keys may be the drive.
    """
    if wanted == "none":
        return None, found
    if wanted:
        if wanted not in loaded.entries:
            raise MissingData(
                f"there is no key {wanted!r}",
                expected=f"one of {', '.join(sorted(loaded.entries))}",
                fix="correct the option input, or say input=none",
                key="input",
            )
        key = wanted
    else:
        loose = [key for keys in found.extras.values() for key in keys]
        hits = [key for key in loose if key.rsplit("/", 1)[-1].lower() in DRIVES]
        if len(hits) > 1:
            raise ConfigError(
                f"{', '.join(sorted(hits))} may each be the drive",
                expected="one drive",
                fix="say input=KEY, or input=none",
                key="input",
            )
        if not hits:
            return None, found
        key = hits[0]
        samples = {len(loaded.entries[slots["position"]]) for slots in found.rods.values()}
        array = loaded.entries[key]
        if array.ndim not in (1, 2) or len(array) not in samples:
            loaded.notes.append(
                f"{key} has shape {array.shape}, not one row a sample; not taken for the drive"
            )
            return None, found
        loaded.notes.append(f"{key} was taken for the drive; input=none or input=KEY overrides")
    extras = {
        name: tuple(other for other in keys if other != key) for name, keys in found.extras.items()
    }
    return key, Grouping(found.rods, found.shared, extras)


def read(key: str | None, loaded: Recording, clock: Clock) -> Drive | None:
    """Return the drive on the clock of the rods, None when `key` is None.

    Raises
    ------
    ConfigError
        The array is not one finite row for each sample.
    SchemaError
        It has another number of samples.
    """
    if key is None:
        return None
    array = loaded.entries[key].astype(np.float64)
    if array.ndim == 1:
        array = array[:, np.newaxis]
    if array.ndim != 2:
        raise ConfigError(
            f"{key} has shape {loaded.entries[key].shape}",
            expected="(T,) or (T, k): one row for each sample",
            fix="name another key, or say input=none and attach the input afterwards",
            key="input",
        )
    value = clock.frames(array, key=key)
    if not np.isfinite(value).all():
        raise ConfigError(
            f"{key} holds numbers that are not finite",
            expected="a finite drive",
            fix="say input=none and attach the input afterwards",
            key="input",
        )
    return Drive(clean_name(key), value)
