"""Which back end is chosen, and what is said about it."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from backend_scenes import scene_of_linear_laws

from openprc.demlat import BarHingeModel, Engine
from openprc.demlat.backends import choose_backend, devices, refusals
from openprc.demlat.backends.devices import Probe, n_nvidia_devices, probe_cuda, probe_jax
from openprc.errors import MissingDependency, UnsupportedScene
from openprc.schema.experiment import Collision

NO_CUDA = Probe(False, False, False, "no NVIDIA device was found")
CUDA = Probe(True, True, True, "1 NVIDIA device")
BARE_CUDA = Probe(True, False, False, "1 NVIDIA device, and nothing that compiles for it", "nvvm")
NO_JAX = Probe(False, False, False, "jax is not installed")
JAX_ON_CPU = Probe(True, True, False, "jax has neither GPU nor TPU here")
JAX_ON_GPU = Probe(True, True, True, "jax runs on gpu")


@pytest.fixture
def machine(monkeypatch):
    def make(cuda, jax):
        monkeypatch.setattr(devices, "probe_cuda", lambda: cuda)
        monkeypatch.setattr(devices, "probe_jax", lambda only_accelerated: jax)

    return make


@pytest.mark.parametrize(
    ("cuda", "jax", "chosen"),
    [
        (CUDA, JAX_ON_GPU, "cuda"),
        (NO_CUDA, JAX_ON_GPU, "jax"),
        (BARE_CUDA, JAX_ON_GPU, "jax"),
        (NO_CUDA, JAX_ON_CPU, "cpu"),
        (NO_CUDA, NO_JAX, "cpu"),
    ],
)
def test_auto_takes_the_first_that_is_usable(cuda, jax, chosen, machine):
    machine(cuda, jax)
    choice = choose_backend(scene_of_linear_laws())
    assert choice.name == chosen
    (reason,) = choice.reasons
    assert f"chose {chosen}" in reason
    assert cuda.found in reason
    if chosen != "cuda":
        assert jax.found in reason


def test_auto_passes_over_what_cannot_do_the_scene(machine):
    machine(CUDA, JAX_ON_GPU)
    choice = choose_backend(scene_of_linear_laws(integrator="verlet"))
    assert choice.name == "cpu"
    assert "cuda does not do the integrator 'verlet'; jax does not do" in choice.reasons[0]


@pytest.mark.parametrize(("wanted", "found"), [("cuda", NO_CUDA), ("jax", NO_JAX)])
def test_what_is_not_there_is_replaced_and_said(wanted, found, machine):
    machine(NO_CUDA, NO_JAX)
    model = BarHingeModel(scene_of_linear_laws(), backend=wanted)
    assert model.choice.name == "cpu"
    (remark,) = (r for r in model.remarks() if "backend" in r)
    assert remark.startswith(f"backend {wanted!r} was asked for, and {found.found}: the run used")


def test_the_engine_runs_a_cuda_script_without_a_device(folder, machine):
    machine(NO_CUDA, NO_JAX)
    result = Engine(BarHingeModel, backend="cuda").run(folder)
    assert any("no NVIDIA device was found" in note for note in result.notes)


def test_who_asks_for_the_cpu_is_told_nothing(machine):
    machine(CUDA, JAX_ON_GPU)
    assert choose_backend(scene_of_linear_laws(), "cpu").reasons == ()


@pytest.mark.parametrize("wanted", ["cuda", "jax"])
def test_what_was_asked_for_and_works_is_used(wanted, machine):
    machine(CUDA, JAX_ON_GPU)
    assert choose_backend(scene_of_linear_laws(), wanted).name == wanted


def test_a_device_without_a_compiler_is_an_error(machine):
    machine(BARE_CUDA, NO_JAX)
    with pytest.raises(MissingDependency, match="nothing that compiles for it") as caught:
        choose_backend(scene_of_linear_laws(), "cuda")
    assert "pip install 'openprc[cuda]'" in caught.value.fix


def with_bars(scene, **columns):
    geometry = scene.geometry
    return replace(scene, geometry=replace(geometry, bars=replace(geometry.bars, **columns)))


def with_hinges(scene, **columns):
    geometry = scene.geometry
    return replace(scene, geometry=replace(geometry, hinges=replace(geometry.hinges, **columns)))


def with_contact(scene):
    geometry = replace(scene.geometry, collidable=np.ones(scene.geometry.n_nodes, dtype=bool))
    return replace(scene, geometry=geometry, collision=Collision(enabled=True, radius=0.1))


SEVEN = [True, *[False] * 6]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda scene: replace(scene, integrator="verlet"), "the integrator 'verlet'"),
        (lambda scene: with_bars(scene, rigid=SEVEN), "1 rigid bars"),
        (lambda scene: with_hinges(scene, rigid=[True]), "1 rigid hinges"),
        (lambda scene: with_hinges(scene, limit_low=[1.0]), "1 linear hinges with hard stops"),
        (with_contact, "contact of 5 collidable nodes"),
        (lambda scene: replace(scene, precision="float32"), "the precision 'float32'"),
    ],
)
@pytest.mark.parametrize("backend", ["cuda", "jax"])
def test_what_a_back_end_does_not_do_is_refused_in_words(change, words, backend, machine):
    machine(CUDA, JAX_ON_GPU)
    scene = change(scene_of_linear_laws())
    (finding,) = refusals(scene, backend)
    assert finding.found == words
    with pytest.raises(
        UnsupportedScene, match=f"back end '{backend}' does not do {words}"
    ) as error:
        choose_backend(scene, backend)
    assert error.value.fix == "change that, or use backend='cpu'"


# --- what a machine has ---------------------------------------------------------------------------


def test_the_simulator_is_no_device(monkeypatch):
    monkeypatch.setenv("NUMBA_ENABLE_CUDASIM", "1")
    probe = probe_cuda()
    assert (probe.usable, probe.accelerated) == (True, False)
    assert "numba simulates CUDA" in probe.found


@pytest.mark.skipif(n_nvidia_devices() > 0, reason="this machine has an NVIDIA device")
def test_a_machine_without_a_device(monkeypatch):
    monkeypatch.delenv("NUMBA_ENABLE_CUDASIM", raising=False)
    assert probe_cuda() == NO_CUDA


class FakeDriver:
    def cuInit(self, flags):
        return 0

    def cuDeviceGetCount(self, count):
        count._obj.value = 2
        return 0


class FakeModule:
    __version__ = "0.7.2"

    def __init__(self, available):
        self.available = available

    def is_available(self):
        return self.available


@pytest.mark.parametrize("available", [True, False])
def test_devices_are_counted_by_the_driver(available, monkeypatch):
    monkeypatch.delenv("NUMBA_ENABLE_CUDASIM", raising=False)
    monkeypatch.setattr(devices.ctypes, "CDLL", lambda name: FakeDriver())
    monkeypatch.setattr(devices, "import_module", lambda name: FakeModule(available))
    probe = probe_cuda()
    assert probe.found.startswith("2 NVIDIA devices")
    assert (probe.present, probe.usable) == (True, available)


def test_an_old_jax_is_named(monkeypatch):
    monkeypatch.setattr(devices, "find_spec", lambda name: True)
    monkeypatch.setattr(devices, "import_module", lambda name: FakeModule(True))
    probe = probe_jax(only_accelerated=False)
    assert (probe.usable, probe.found, probe.missing) == (False, "jax 0.7.2", "jax 0.8 or newer")


def test_a_broken_jax_is_named(monkeypatch):
    def broken(name):
        raise ImportError("no jaxlib")

    monkeypatch.setattr(devices, "find_spec", lambda name: True)
    monkeypatch.setattr(devices, "import_module", broken)
    probe = probe_jax(only_accelerated=False)
    assert probe.found == "jax cannot be imported (no jaxlib)"


def test_building_and_choosing_imports_neither_back_end():
    code = (
        "import sys, openprc.demlat, openprc.demlat.backends\n"
        "from openprc.demlat import Engine, BarHingeModel\n"
        "Engine(BarHingeModel)\n"
        "assert not {'jax', 'numba', 'numba.cuda'} & set(sys.modules), sys.modules.keys()\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
