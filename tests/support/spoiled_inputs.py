"""Ways to put a mistake into the input files of an experiment; each returns what does it."""

import json

import h5py


def put(key, values):
    """Replace a dataset of geometry.h5, or some of its entries."""

    def spoil(folder):
        with h5py.File(folder / "input/geometry.h5", "a") as file:
            name, _, entry = key.partition("@")
            if entry:
                file[name][int(entry)] = values
                return
            attributes = dict(file[name].attrs)
            del file[name]
            file[name] = values
            file[name].attrs.update(attributes)

    return spoil


def drop(*keys, file="geometry.h5"):
    def spoil(folder):
        with h5py.File(folder / "input" / file, "a") as opened:
            for key in keys:
                del opened[key]

    return spoil


def signal(values):
    def spoil(folder):
        with h5py.File(folder / "input/signals.h5", "a") as file:
            name = "signals/push" if "signals" in file else "push"
            attributes = dict(file[name].attrs)
            del file[name]
            file[name] = values
            file[name].attrs.update(attributes)

    return spoil


def config(path, value="(remove it)"):
    """Set or remove an entry of config.json, given as ``section/key``."""

    def spoil(folder):
        file = folder / "input/config.json"
        data = json.loads(file.read_text())
        *sections, key = path.split("/")
        inner = data
        for section in sections:
            inner = inner[int(section) if section.isdigit() else section]
        if value == "(remove it)":
            del inner[key]
        else:
            inner[key] = value
        file.write_text(json.dumps(data))

    return spoil


def remove(name):
    return lambda folder: (folder / "input" / name).unlink()
