"""Importers with one mistake each."""

from __future__ import annotations

import io
import os
import pickle
import tempfile
import time
import warnings
import zipfile
from pathlib import Path

import h5py
import numpy as np
from wire_code import N_FRAMES, SIGNATURE, WireImporter, write_sample

from openprc.errors import OpenPRCError

# --- samples and packages ----------------------------------------------------------------------


def sample_elsewhere(folder):
    """Write into a folder of its own."""
    return write_sample(Path(tempfile.mkdtemp(dir=Path(folder).parent)))


class NoImport:
    """Has no import_run()."""

    def sniff(self, path):
        return WireImporter().sniff(path)


class NeedsPackage(WireImporter):
    """Imports the package `tabnanny`, which the case says is heavy and the record does not."""

    def read(self, path):
        import tabnanny  # noqa: F401

        return super().read(path)


# --- sniff -------------------------------------------------------------------------------------


class Shy(WireImporter):
    def sniff(self, path):
        return min(super().sniff(path), 0.3)


class ByName(WireImporter):
    def sniff(self, path):
        return 0.7 if Path(path).suffix == ".wire" else 0.0


class AnyVideo(WireImporter):
    """Takes videos for wires."""

    def sniff(self, path):
        mine = super().sniff(path)
        if mine == 0.0 and Path(path).is_file() and Path(path).stat().st_size > 8:
            return 0.8 if Path(path).read_bytes()[8:12] == b"AVI " else 0.0
        return mine


class Clumsy(WireImporter):
    """Raises on what does not exist."""

    def sniff(self, path):
        Path(path).stat()
        return super().sniff(path)


class Caching(WireImporter):
    """Leaves a cache beside the file."""

    def sniff(self, path):
        if Path(path).is_file():
            Path(path).with_suffix(".cache").write_bytes(b"seen")
        return super().sniff(path)


class Slow(WireImporter):
    def sniff(self, path):
        score = super().sniff(path)
        if score == 1.0 and Path(path).stat().st_size > 1 << 20:
            began = time.process_time()
            while time.process_time() - began < 1.05:
                pass
        return score


# --- what comes of it --------------------------------------------------------------------------


class Refusing(WireImporter):
    """Raises an error of its own instead of importing."""

    def import_run(self, path, writer, *, options):
        raise KeyError("positions")


class Zeros(WireImporter):
    """Puts zeros where nothing was measured."""

    def places(self, x):
        return np.nan_to_num(x)


class Unsourced(WireImporter):
    """Reads a second file and does not say so."""

    def add_source(self, writer, path):
        pass


class Touching(WireImporter):
    """Opens its source for writing and reading."""

    def read(self, path):
        if path.is_file():
            with path.open("r+b") as stream:
                first = stream.read(1)
                stream.seek(0)
                stream.write(first)
        return super().read(path)


class Littering(WireImporter):
    """Leaves a log in the current folder."""

    def read(self, path):
        with Path("wire-import.log").open("a") as stream:
            stream.write("imported\n")
        return super().read(path)


class Loud(WireImporter):
    def read(self, path):
        warnings.warn("this table is old", stacklevel=2)
        return super().read(path)


# --- values ------------------------------------------------------------------------------------


class AxisSwap(WireImporter):
    """Reads (n, 3) as (3, n)."""

    def places(self, x):
        if x.shape[1] != x.shape[2]:
            return x
        x = x.swapaxes(1, 2).copy()
        x[np.isnan(x).any(axis=2)] = np.nan
        return x


class Millimetres(WireImporter):
    def unit(self):
        return "mm"


class Late(WireImporter):
    """Is one frame off in time."""

    def time(self, values):
        return values + 0.02


class ShiftedDrive(WireImporter):
    """Is one frame off in the input."""

    def input(self, values):
        return np.concatenate([values[:1], values[:-1]])


class Degrees(WireImporter):
    """Takes degrees for radians."""

    def readings(self, values):
        return np.degrees(values)


class Random(WireImporter):
    """Adds a note of chance to the data."""

    def readings(self, values):
        return values + 1e-15 * np.random.default_rng().standard_normal(values.shape)


class Seeded(WireImporter):
    """Depends on the order of a set of texts."""

    def readings(self, values):
        order = list({"left", "right", "upper", "lower", "inner", "outer"})
        return values + 1e-16 * (hash(tuple(order)) % 1000)


# --- damage ------------------------------------------------------------------------------------


class Trusting(WireImporter):
    """Lets errors of parsing out as they are."""

    def read(self, path):
        if path.is_file():
            lines = path.read_bytes().split(b"\n")
            if lines[0] == SIGNATURE.encode() and 5 < len(lines) < N_FRAMES + 3:
                raise IndexError(len(lines))
        return super().read(path)


class Fragile(WireImporter):
    """Trips over bytes that are no text."""

    def read(self, path):
        if not path.is_dir() and path.exists():
            content = path.read_bytes()
            if content.startswith(SIGNATURE.encode()[:4]) and content.endswith(b"\n"):
                content.decode("ascii")
        return super().read(path)


class Empty(WireImporter):
    """Divides by the size of the file beside it."""

    def symbols(self, path, writer):
        beside = path.with_suffix(".symbols")
        if beside.is_file():
            _ = 1.0 / beside.stat().st_size
        return super().symbols(path, writer)


class Leaving(WireImporter):
    """Publishes the file itself, whatever happens afterwards."""

    def import_run(self, path, writer, *, options):
        try:
            super().import_run(path, writer, options=options)
        except OpenPRCError:
            writer.path.write_bytes(b"unfinished")
            raise


class Unpickling(WireImporter):
    """Tries whether the file is a pickle."""

    def read(self, path):
        try:
            with path.open("rb") as stream:
                pickle.load(stream)
        except Exception:
            pass
        return super().read(path)


class Following(WireImporter):
    """Takes HDF5 for a wire, and follows where it leads."""

    def import_run(self, path, writer, *, options):
        if Path(path).is_file() and h5py.is_hdf5(path):
            with h5py.File(path) as file:
                writer.declare_nodes(2, 3, unit="m")
                writer.append(file["time"][()], positions=file["positions"][()])
            return
        super().import_run(path, writer, options=options)


class Unpacking(WireImporter):
    """Unpacks archives the careless way."""

    def read(self, path):
        if path.is_file() and zipfile.is_zipfile(path):
            with zipfile.ZipFile(io.BytesIO(path.read_bytes())) as archive:
                for name in archive.namelist():
                    (path.parent / name).write_bytes(archive.read(name))
        return super().read(path)


class Listing(WireImporter):
    """Takes a folder for a file without looking."""

    def read(self, path):
        if path.is_dir():
            return os.fspath(path).index("no such text"), None
        return super().read(path)


class Opening(WireImporter):
    """Opens the file beside it without looking."""

    def symbols(self, path, writer):
        beside = path.with_suffix(".symbols")
        if os.path.lexists(beside):
            beside.open("rb").close()
        return super().symbols(path, writer)


class Forgetful(WireImporter):
    """Brings an input that has nothing to do with the body."""

    def symbols(self, path, writer):
        held = super().symbols(path, writer)
        if held:
            rng = np.random.default_rng(5)
            held = {"hold": held["hold"], "u": rng.uniform(-1, 1, (len(held["u"]), 1))}
        return held
