"""The command line in this process, plugins in memory, and small files."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from command_line import called
from experiments import write_spring

from openprc.hooks import ProducerSpec, default_registry, discovery, hookimpl
from openprc.schema import Provenance, TrajectoryWriter

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def _clean(monkeypatch, tmp_path):
    """No installed plugin, no setting of the user, an empty folder to be in."""
    for name in ("OPENPRC_PLUGINS", "OPENPRC_PLUGIN_DEBUG", "OPENPRC_DEBUG"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(discovery, "installed_entry_points", list)
    # main() replaces it for good, as a program may.
    monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)
    monkeypatch.chdir(tmp_path)
    default_registry.cache_clear()
    yield
    default_registry.cache_clear()


@pytest.fixture
def openprc(capsys):
    """Return a function that calls the command line with words."""

    def call(*words):
        return called(capsys, *words)

    return call


@pytest.fixture
def install(monkeypatch):
    """Return a function that puts plugins in place of the installed ones.

    Each is a name and what it registers, or what its import raises.
    """
    made = []

    def put(**plugins):
        entries = []
        for name, records in plugins.items():
            entry = SimpleNamespace(
                name=name,
                value=f"openprc_{name}",
                dist=SimpleNamespace(name=f"openprc-{name}", version="0.1"),
            )
            if isinstance(records, BaseException):

                def load(error=records):
                    raise error
            else:
                module = ModuleType(f"openprc_{name}")
                module.OPENPRC_PLUGIN_API = "1.0"
                for hook, items in records.items():
                    setattr(module, hook, hookimpl(lambda items=items: items))

                def load(module=module):
                    return module

            entry.load = load
            entries.append(entry)
        monkeypatch.setattr(discovery, "installed_entry_points", lambda: entries)
        default_registry.cache_clear()

    def code(attribute, value):
        name = f"openprc_test_cli_code_{len(made)}"
        module = ModuleType(name)
        setattr(module, attribute, value)
        monkeypatch.setitem(sys.modules, name, module)
        made.append(name)
        return f"{name}:{attribute}"

    def importer(name, behind, **fields):
        fields = {"summary": "A fake", "capabilities": ("import",), **fields}
        return ProducerSpec(name=name, load=code("Importer", behind), **fields)

    put.importer = importer
    put.code = code
    return put


@pytest.fixture
def csv_plugin(install, monkeypatch):
    """The example plugin, whether or not it is installed."""
    monkeypatch.syspath_prepend(ROOT / "plugins" / "openprc-example")
    import openprc_example

    install(
        example={
            "openprc_producers": openprc_example.openprc_producers(),
            "openprc_features": openprc_example.openprc_features(),
        }
    )


@pytest.fixture
def make_file(tmp_path):
    """Return a function that writes a trajectory of a body that rings after random kicks."""

    def make(name="run.h5", *, n_frames=40, inputs=False, dt=0.1, stop_after=None, dims=3):
        rng = np.random.default_rng(3)
        path = tmp_path / name
        time = dt * np.arange(n_frames)
        u = rng.uniform(-1.0, 1.0, n_frames)
        state = np.zeros((n_frames, 4))
        for i in range(1, n_frames):
            state[i] = 0.6 * np.roll(state[i - 1], 1) + np.array([1.0, 0.2, 0.1, 0.3]) * u[i - 1]
        positions = np.zeros((n_frames, 4, dims))
        positions[..., 0] = np.arange(4.0)
        positions[..., 1] = 0.1 * np.tanh(state)
        if dims == 3:
            positions[..., 2] = 0.01 * state**2
        with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
            writer.declare_nodes(4, dims, unit="m", labels=["a", "b", "c", "d"], ids=[1, 2, 3, 4])
            writer.declare_elements("bars", [[0, 1], [1, 2], [2, 3]])
            writer.declare_channel("gauge", ["left [mm]", "right [mm]"], unit="mm")
            if inputs:
                writer.declare_input(
                    "drive", ["u"], quantity="force", unit="N", sequence=u[:, None], hold=dt
                )
            for i in range(n_frames):
                if i == stop_after:
                    writer.commit()
                    raise RuntimeError("stopped")
                writer.append(
                    time[i],
                    positions=positions[i],
                    channels={"gauge": state[i, :2]},
                    inputs={"drive": u[i : i + 1]} if inputs else None,
                )
        return path

    return make


@pytest.fixture
def partial_file(make_file, tmp_path):
    """A run that stopped after 7 of 40 frames."""
    with pytest.raises(RuntimeError, match="stopped"):
        make_file("cut.h5", stop_after=7)
    return tmp_path / "cut.h5.partial"


@pytest.fixture
def experiment_folder(tmp_path):
    """A folder with two nodes on a spring, one of them driven: 11 frames."""
    return write_spring(tmp_path / "spring")


def listing(folder):
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*"))


@pytest.fixture
def refused(openprc, tmp_path):
    """Return a function that checks a call: its code, words, JSON, and that nothing is left."""

    def check(*words, code=2, told=(), kind=None):
        before = listing(tmp_path)
        outcome = openprc(*words)
        assert outcome.code == code, outcome.text
        for part in [told] if isinstance(told, str) else told:
            assert part in outcome.text, outcome.text
        as_json = openprc(*words, "--json")
        assert as_json.code == code
        if kind is not None:
            assert as_json.data["error"] == kind
            assert as_json.data["found"]
            assert as_json.err == ""
        assert listing(tmp_path) == before
        return as_json.data

    return check
