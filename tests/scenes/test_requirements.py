"""What scenes use, and what producers say to scenes that they cannot model."""

import json
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from openprc.errors import ConfigError
from openprc.hooks import ProducerSpec, Registry, hookimpl
from openprc.hooks.faults import PluginWarning
from openprc.hooks.protocols import Describer, Modelled
from openprc.hooks.specs import ELEMENTS
from openprc.scenes.requirements import elements_of, physics_of, producer_verdicts
from openprc.schema import Finding
from openprc.schema.experiment import Actuator, Collision, Experiment, Signal
from openprc.schema.geometry import Bars, Bends, Geometry, Hinges

TRIANGLES = [[0, 0, 0], [1, 0, 0], [0.5, 1, 0.2], [0.5, -1, 0.3], [2, 0, 0]]


def bars(**columns):
    pairs = [(0, 1), (0, 2), (1, 2), (0, 3), (1, 3), (1, 4)]
    return Bars(indices=pairs, stiffness=np.full(6, 50.0), rest_length=np.ones(6), **columns)


def scene(elements=None, **settings):
    made = {"bars": bars(), "fixed": [True, False, False, False, False]} | (elements or {})
    body = Geometry(positions=TRIANGLES, masses=np.ones(5), **made)
    times = {"duration": 0.1, "dt": 1e-3, "save_interval": 0.01, "integrator": "verlet"}
    return Experiment(geometry=body, **times | settings)


def chain(n=6, **settings):
    """A straight chain with bends, clamped at two nodes and pushed at its end."""
    first = np.arange(n - 1)
    body = Geometry(
        positions=np.stack([0.1 * np.arange(n), np.zeros(n), np.zeros(n)], axis=1),
        masses=np.full(n, 0.1),
        fixed=np.arange(n) < 2,
        bars=Bars(
            indices=np.stack([first, first + 1], axis=1),
            stiffness=np.full(n - 1, 1e4),
            rest_length=np.full(n - 1, 0.1),
        ),
        bends=Bends(
            indices=np.stack([first[:-1], first[1:], first[1:] + 1], axis=1),
            stiffness=np.ones(n - 2),
        ),
    )
    push = Signal(name="u", values=[0.0, 1.0], dt=0.1)
    times = {"duration": 0.1, "dt": 1e-4, "save_interval": 0.01, "integrator": "verlet"}
    return Experiment(
        geometry=body,
        signals={"u": push},
        actuators=(Actuator(node=n - 1, signal="u", type="force", axes=(False, True, False)),),
        **times | settings,
    )


def used(experiment):
    return {item.name: item for item in physics_of(experiment)}


# --- physics -------------------------------------------------------------------------------------


def test_only_what_is_there_is_listed():
    assert list(used(scene())) == ["nodes", "dimensions", "bars"]
    assert used(scene())["nodes"].text == (
        "1 fixed, 0 with a prescribed motion; 12 free coordinates"
    )
    assert used(scene())["dimensions"].count == 3
    assert used(chain())["dimensions"].count == 2


def test_everything_that_a_scene_can_use_is_listed_with_its_count():
    laws = ["linear", "cubic", "cable", "strut", "ogden", "linear"]
    special = bars(
        law=laws,
        damping=[0.1, 0.2, 0, 0, 0, 0.3],
        stiffness_cubic=[0, 5, 0, 0, 0, 0],
        damping_cubic=[0, 7, 0, 0, 0, 0],
        prestress=[0.1, 0, 0, 0, 0, 0],
        rigid=[False] * 5 + [True],
    )
    hinges = Hinges(
        indices=[[0, 1, 2, 3]] * 3,
        stiffness=[1.0, 2.0, 3.0],
        rest_angle=np.full(3, np.pi),
        damping=[0.0, 0.5, 0.0],
        law=["linear", "enhanced-linear", "linear"],
        limit_low=[1.0, 2.0, 0.0],
        limit_high=[5.0, 4.0, 2 * np.pi],
        rigid=[False, False, True],
    )
    bends = Bends(indices=[[0, 1, 4]], stiffness=[2.0], rest_angle=[2.0], damping=[0.1])
    signals = {
        name: Signal(name=name, values=np.zeros(4), dt=0.1, interpolation=kind)
        for name, kind in (("a", "hold"), ("b", "cubic"), ("c", "linear"))
    }
    actuators = (
        Actuator(node=2, signal="a", type="force"),
        Actuator(node=2, signal="b", type="force"),
        Actuator(node=3, signal="b", type="position"),
        Actuator(node=4, signal="c", type="velocity", axes=(True, False, False)),
    )
    found = used(
        scene(
            {
                "bars": special,
                "hinges": hinges,
                "bends": bends,
                "velocities": np.tile([[0.0, 0.0, 3.0]], (5, 1)) * [[0], [1], [1], [0], [0]],
                "collidable": [False, True, True, True, True],
                "faces": [[0, 1, 2]],
            },
            gravity=(0, 0, -9.81),
            damping=0.5,
            bar_damping="printed",
            collision=Collision(
                enabled=True, radius=0.1, restitution=0.5, friction=0.2, faces=True
            ),
            signals=signals,
            actuators=actuators,
        )
    )
    counts = {name: item.count for name, item in found.items()}
    assert counts == {
        "nodes": 5, "dimensions": 3, "initial velocities": 2, "bars": 5, "rigid bars": 1,
        "prestress": 1, "bar damping": 2, "cubic bar damping": 1, "hinges": 2, "rigid hinges": 1,
        "hinge damping": 1, "hinge stops": 1, "hinge walls": 1, "bends": 1, "bend damping": 1,
        "gravity": 4, "drag": 4, "contact of nodes": 4, "contact with faces": 1,
        "force drives": 2, "position drives": 1, "velocity drives": 1,
    }  # fmt: skip
    assert found["bars"].text == "1 cable, 1 cubic, 1 linear, 1 ogden, 1 strut; 50 N/m"
    assert "whole relative velocity" in found["bar damping"].text
    assert found["force drives"].text == "on 1 nodes by 2 signals (hold, cubic)"
    assert "friction 0.2" in found["contact of nodes"].text
    assert "1 rest at an angle" in found["bends"].text


def test_physics_in_the_words_of_records():
    assert elements_of(chain()) == ("nodes", "bars", "bends", "force-actuators")
    assert set(elements_of(chain(damping=0.1, gravity=(0, -1, 0)))) <= set(ELEMENTS)


def test_massless_nodes_are_told():
    light = scene({"fixed": [True] * 2 + [False] * 3})
    geometry = replace(light.geometry, masses=[1.0, 0.0, 1.0, 0.0, 1.0])
    found = used(replace(light, geometry=geometry))
    assert (found["massless nodes"].count, found["massless nodes"].text) == (
        2, "1 of them not fixed",
    )  # fmt: skip


# --- producers that are installed ----------------------------------------------------------------


@pytest.fixture(scope="module")
def verdicts():
    registry = Registry()

    def ask(experiment):
        return {item.producer: item for item in producer_verdicts(experiment, registry=registry)}

    return ask


def need(found, name):
    if name not in found or found[name].state == "unavailable":
        pytest.skip(f"{name} is not installed here")
    return found[name]


def test_who_runs_a_chain_and_what_it_adds(verdicts):
    found = verdicts(chain(damping=0.1))
    assert found["demlat"].state == "runs"
    assert (found["demlat"].leaves_out, found["demlat"].adds) == ((), ())
    rod = need(found, "pyelastica")
    assert rod.state == "runs"
    assert [text.split(" ")[0].rstrip(":") for text in rod.adds] == ["shear", "rotary", "a", "a"]
    assert any("second fixed node" in text for text in rod.adds)
    # Timoshenko's share of shear, 3 EI / (alpha G A L^2) with EA = 1e3 N and EI = 0.1 N m2.
    share = 3 * 0.1 / (27 / 28 / 3 * 1e3 * 0.5**2)
    assert f"{share:.2g} of its bending" in rod.adds[0]


def test_statics_leave_out_time_and_what_depends_on_it(verdicts):
    static = need(verdicts(chain(damping=0.1)), "merlin")
    assert static.state == "runs"
    assert static.leaves_out[0].startswith("inertia")
    assert "drag" in static.leaves_out
    assert "drag" not in need(verdicts(chain()), "merlin").leaves_out


@pytest.mark.parametrize(
    ("what", "experiment", "producer", "words"),
    [
        ("rigid bars", lambda: scene({"bars": bars(rigid=np.ones(6, bool))}), "pybullet", "rigid"),
        ("rigid bars", lambda: scene({"bars": bars(rigid=np.ones(6, bool))}), "merlin", "rigid"),
        ("branches", scene, "pyelastica", "three or more bars"),
        ("nothing that drives it", scene, "merlin", "nothing drives the body"),
        ("a rigid bar and verlet", lambda: scene({"bars": bars(rigid=np.ones(6, bool))}),
         "demlat", "rigid bars with the integrator 'verlet'"),
        ("too long a step", lambda: scene(dt=0.5, save_interval=0.5, duration=0.5), "demlat",
         "dt = 0.5 s"),
    ],
)  # fmt: skip
def test_what_producers_refuse(verdicts, what, experiment, producer, words):
    found = need(verdicts(experiment()), producer)
    assert found.state == "refuses", what
    assert words in found.text
    assert all(finding.fix for finding in found.findings if finding.level == "error")


def test_an_unknown_integrator_is_refused_and_breaks_nobody(verdicts):
    found = verdicts(scene(integrator="magic"))
    assert found["demlat"].state == "refuses"
    assert {item.state for item in found.values()} <= {"refuses", "runs", "unavailable"}


def test_the_scheme_that_damps_is_said_to_add_damping(verdicts):
    # The limit of this body is about 0.1 s; rk4 damps its fastest mode at more than 0.35 of it.
    found = verdicts(scene(integrator="rk4", dt=0.1, save_interval=0.1))
    assert found["demlat"].state == "runs"
    assert found["demlat"].adds[0].startswith("damping by rk4 itself")


# --- producers of strangers ----------------------------------------------------------------------


class Plain:
    """Runs everything, and says nothing."""

    def supports(self, experiment):
        return []

    def run(self, experiment, writer, *, seed, progress):
        raise AssertionError("nobody asked for a run")


class Warned(Plain):
    def supports(self, experiment):
        return [Finding("W-1", "warning", "physics.damping", "the air", "no air", "leave it out")]


class Raising(Plain):
    def supports(self, experiment):
        raise ZeroDivisionError("one over nothing")


class Wordy(Plain):
    def supports(self, experiment):
        return ["no hinges, please"]


class Careless(Plain):
    def models(self, experiment):
        return {"adds": "friction"}


class Contradicted(Plain):
    def supports(self, experiment):
        raise ConfigError("two lengths", expected="one", fix="choose", key="elements/bars")


@dataclass
class Entry:
    name: str
    content: object
    value: str = "nowhere"

    @property
    def dist(self):
        return SimpleNamespace(name=f"openprc-{self.name}", version="1")

    def load(self):
        if isinstance(self.content, BaseException):
            raise self.content
        return self.content


def registry_of(behind, monkeypatch, **fields):
    import sys
    from types import ModuleType

    code = ModuleType("openprc_test_requirements")
    code.Runner = behind
    monkeypatch.setitem(sys.modules, code.__name__, code)
    spec = ProducerSpec(
        name="strange", summary="A fake", load=f"{code.__name__}:Runner", capabilities=("run",),
        **fields,
    )  # fmt: skip
    module = ModuleType("openprc_strange")
    module.OPENPRC_PLUGIN_API = "1.0"
    module.openprc_producers = hookimpl(lambda: [spec])
    return Registry([Entry("strange", module)])


def strange(behind, monkeypatch, **fields):
    registry = registry_of(behind, monkeypatch, **fields)
    found = {item.producer: item for item in producer_verdicts(scene(), registry=registry)}
    assert found["demlat"].state == "runs"  # one that fails takes nobody with it
    return found["strange"]


def test_a_runner_that_says_nothing_runs_and_leaves_nothing_out(monkeypatch):
    assert not isinstance(Plain(), Describer)
    found = strange(Plain, monkeypatch)
    assert (found.state, found.leaves_out, found.adds, found.text) == ("runs", (), (), "")


def test_warnings_say_what_is_left_out(monkeypatch):
    found = strange(Warned, monkeypatch)
    assert (found.state, found.leaves_out, found.text) == ("runs", ("the air",), "the air")


@pytest.mark.parametrize(
    ("behind", "words"),
    [
        (Raising, "ZeroDivisionError: one over nothing"),
        (Wordy, "returned a str, not a Finding"),
        (Careless, "returned a dict, not a Modelled"),
    ],
)
def test_broken_runners_are_named(monkeypatch, behind, words):
    found = strange(behind, monkeypatch)
    assert found.state == "broken"
    assert words in found.text


def test_a_scene_that_contradicts_itself_is_refused(monkeypatch):
    found = strange(Contradicted, monkeypatch)
    assert (found.state, found.text) == ("refuses", "two lengths")
    assert (found.findings[0].path, found.findings[0].fix) == ("elements/bars", "choose")


def test_what_is_not_installed_comes_with_its_command(monkeypatch):
    found = strange(
        Plain, monkeypatch, needs={"run": ("no_such_simulator",)}, install="pip install it"
    )
    assert found.state == "unavailable"
    assert found.text == "no_such_simulator is not installed: pip install it"


def test_plugins_that_cannot_be_loaded_are_listed_last():
    with pytest.warns(PluginWarning, match="left out"):
        registry = Registry([Entry("wreck", ImportError("no module named sea"))])
    last = producer_verdicts(scene(), registry=registry)[-1]
    assert (last.producer, last.state) == ("wreck", "broken")
    assert "no module named sea" in last.text


def test_verdicts_are_plain_data(monkeypatch):
    found = strange(Warned, monkeypatch)
    data = json.loads(json.dumps(found.as_dict()))
    assert list(data) == ["producer", "state", "leaves_out", "adds", "text", "findings"]
    assert data["findings"][0]["code"] == "W-1"
    assert Modelled() == Modelled(leaves_out=(), adds=())
