"""Which experiments are rods, and what of rods they are; nothing is simulated."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from openprc_pyelastica.chains import sort_chains
from openprc_pyelastica.held_parts import held_parts
from openprc_pyelastica.node_drives import drives_of
from openprc_pyelastica.producer import Producer
from openprc_pyelastica.rod_material import checked_options, material_of
from openprc_pyelastica.rod_step_limit import step_limit
from openprc_pyelastica.runner_scope import shortest_limit

from openprc.errors import ConfigError
from openprc.schema.experiment import Actuator, Collision, Signal
from openprc.schema.geometry import Bars, Bends, Hinges


def supports(experiment):
    return list(Producer().supports(experiment))


def errors(experiment):
    return [finding for finding in supports(experiment) if finding.level == "error"]


def with_bars(geometry, **columns):
    names = ("indices", "stiffness", "rest_length", "damping", "prestress", "rigid", "law")
    same = {name: getattr(geometry.bars, name) for name in names}
    return replace(geometry, bars=Bars(**same | columns))


def with_bends(geometry, **columns):
    names = ("indices", "stiffness", "rest_angle", "damping")
    same = {name: getattr(geometry.bends, name) for name in names}
    return replace(geometry, bends=Bends(**same | columns))


def test_a_chain_is_supported(make_chain, make_experiment):
    assert supports(make_experiment(make_chain(10, fixed=(0, 1)))) == []


def test_other_integrators_are_replaced_in_words(make_chain, make_experiment):
    (hint,) = supports(make_experiment(make_chain(10), integrator="rk4"))
    assert (hint.level, hint.code) == ("hint", "PYE-INTEGRATOR")
    assert "position Verlet, which is used" in hint.expected


def refused(make_chain):
    """Yield experiments' changes that are refused: code, words, geometry, settings."""
    five = make_chain(5, fixed=(0,))
    lattice = with_bars(
        five,
        indices=[[0, 1], [1, 2], [2, 3], [1, 4], [4, 5]],
    )
    hinges = replace(
        five, hinges=Hinges(indices=[[0, 1, 2, 3]], stiffness=[1.0], rest_angle=[math.pi])
    )
    triangle = with_bars(five, indices=[[0, 1], [1, 2], [2, 0], [3, 4], [4, 5]])
    yield "HINGES", "1 dihedral hinges: a rod bends about any axis", hinges, {}
    yield "BRANCH", r"1 node\(s\) with three or more bars \(1\): a lattice", lattice, {}
    yield "LOOP", "a closed loop of bars through node 0: a ring rod", triangle, {}
    yield "NO-BARS", "no bars at all", replace(five, bars=Bars(), bends=Bends()), {}
    one = np.full(1, 0.2)
    single = with_bars(
        replace(five, bends=Bends()),
        indices=[[0, 1]], stiffness=one, rest_length=one, damping=None, prestress=None,
        rigid=None, law=None,
    )  # fmt: skip
    yield "LONE-NODE", r"4 node\(s\) without a bar, such as node 2", single, {}
    yield "SHORT", "a single bar between nodes 0 and 1", single, {}
    yield "STRAY-BEND", r"bend 0 on \[0, 2, 1\]", with_bends(
        five, indices=[[0, 2, 1], [1, 2, 3], [2, 3, 4], [3, 4, 5]]
    ), {}  # fmt: skip
    yield "CURVED", "1 bends that rest at an angle", with_bends(
        five, rest_angle=[math.pi, math.pi, 3.0, math.pi]
    ), {}  # fmt: skip
    yield "BEND-DAMPING", "4 bends with dashpots", with_bends(five, damping=np.full(4, 0.1)), {}
    yield "BAR-RIGID", "1 rigid bars", with_bars(five, rigid=[True, *[False] * 4]), {}
    yield (
        "BAR-LAW",
        "5 bars with another law than the linear",
        with_bars(five, law=["cubic"] * 5),
        {},
    )
    yield "BAR-DAMPING", "5 dashpots along bars", with_bars(five, damping=np.ones(5)), {}
    yield "BAR-STIFFNESS", "5 bars without stiffness", with_bars(five, stiffness=np.zeros(5)), {}
    yield "NO-MASS", "node 3 is free and has no mass", replace(
        five, masses=[0.1, 0.1, 0.1, 0.0, 0.1, 0.1]
    ), {}  # fmt: skip
    folded = five.positions.copy()
    folded[5] = folded[3]
    yield "FOLDED", "folded back on itself at node 4", replace(five, positions=folded), {}
    folded[5] = folded[4]
    yield "ZERO-LENGTH", "are at one place", replace(five, positions=folded), {}
    yield "CONTACT", "contact between nodes", replace(five, collidable=np.ones(6, bool)), {
        "collision": Collision(enabled=True, radius=0.01)
    }  # fmt: skip
    yield "PRECISION", "the precision float32", five, {"precision": "float32"}
    push = {
        "signals": {"F": Signal(name="F", values=np.ones(3), dt=0.1)},
        "actuators": (Actuator(node=0, signal="F", type="force", axes=(False, True, False)),),
    }
    yield "DEAD-FORCE", "a force on y of node 0, which is held there", five, push


def test_refusals(make_chain, make_experiment):
    seen = []
    for code, words, geometry, settings in refused(make_chain):
        found = errors(make_experiment(geometry, **settings))
        matching = [finding for finding in found if finding.code == f"PYE-{code}"]
        assert len(matching) == 1, (code, found)
        assert re.search(words, matching[0].found), matching[0].found
        assert matching[0].expected
        assert matching[0].fix
        seen.append(code)
    assert len(set(seen)) == len(seen) == 19


def test_collidable_nodes_do_not_matter_without_collision(make_chain, make_experiment):
    geometry = replace(make_chain(5), collidable=np.ones(6, bool))
    assert supports(make_experiment(geometry)) == []


def test_two_chains_in_any_order(make_chain, make_experiment):
    geometry = make_chain(6)
    # Nodes 4, 2, 0 and 1, 5, 3, 6; bars and bends written in either direction.
    bars = with_bars(
        replace(geometry, bends=Bends()),
        indices=[[2, 0], [4, 2], [5, 1], [3, 5], [6, 3]],
        stiffness=np.arange(1.0, 6.0), rest_length=np.full(5, 0.1), damping=None, prestress=None,
        rigid=None, law=None,
    )  # fmt: skip
    bends = Bends(indices=[[3, 5, 1], [6, 3, 5], [5, 3, 6]], stiffness=[1.0, 2.0, 3.0])
    first, second = sort_chains(replace(bars, bends=bends)).chains
    assert first.nodes.tolist() == [0, 2, 4]
    assert first.bars.tolist() == [0, 1]
    assert first.bend.tolist() == [0.0]
    assert second.nodes.tolist() == [1, 5, 3, 6]
    assert second.bars.tolist() == [2, 3, 4]
    assert second.bend.tolist() == [1.0, 5.0]  # two bends at one vertex add up


def test_the_rod_of_a_uniform_chain(make_chain, make_experiment):
    experiment = make_experiment(make_chain(10))
    (chain,) = sort_chains(experiment.geometry).chains
    material = material_of(chain, experiment, options=checked_options({}))
    area = math.pi * 0.02**2
    np.testing.assert_allclose(material.stretch, 1e6 * area, rtol=1e-12)
    np.testing.assert_allclose(material.bend, 1e6 * area * 0.02**2 / 4, rtol=1e-12)
    np.testing.assert_allclose(material.shear, 27 / 28 * 1e6 / 3 * area, rtol=1e-12)
    np.testing.assert_allclose(material.twist, 1e6 / 3 * area * 0.02**2 / 2, rtol=1e-12)
    assert material.radius == pytest.approx(0.02, rel=1e-12)
    # rho I l of every element, the outer ones included
    np.testing.assert_allclose(material.inertia, 1000 * area * 0.02**2 / 4 * 0.1, rtol=1e-12)
    # 3 EI / (a G A L^2) = 7/3 (R/L)^2 for nu = 1/2
    assert material.shear_share == pytest.approx(7 / 3 * 0.02**2, rel=1e-12)


def test_options_of_the_material(make_chain, make_experiment):
    experiment = make_experiment(make_chain(10, bend=None))
    (chain,) = sort_chains(experiment.geometry).chains
    plain = material_of(chain, experiment, options=checked_options({}))
    assert plain.radius == pytest.approx(0.01)  # a tenth of an element
    assert math.isinf(plain.shear_share)
    told = checked_options({"radius": 0.005, "poisson": 0.25, "shear_scale": 3.0})
    other = material_of(chain, experiment, options=told)
    assert other.radius == 0.005
    np.testing.assert_allclose(other.shear / plain.shear, 3.0 * 1.5 / 1.25, rtol=1e-12)


@pytest.mark.parametrize(
    ("option", "value", "match"),
    [
        ("poisson", 0.6, "option poisson is 0.6"),
        ("shear_scale", 0.0, "option shear_scale is 0.0"),
        ("radius", -1.0, "option radius is -1.0"),
        ("substeps", "0", "option substeps is '0'"),
        ("substeps", "many", "option substeps is 'many'"),
    ],
)
def test_options_that_make_no_sense(option, value, match):
    with pytest.raises(ConfigError, match=match):
        checked_options({option: value})


def test_prestress_changes_the_rest_length(make_chain, make_experiment):
    experiment = make_experiment(with_bars(make_chain(5), prestress=np.full(5, -0.1)))
    (chain,) = sort_chains(experiment.geometry).chains
    material = material_of(chain, experiment, options=checked_options({}))
    np.testing.assert_allclose(material.rest_lengths, 0.18, rtol=1e-12)
    np.testing.assert_allclose(
        material.stretch / material.rest_lengths, experiment.geometry.bars.stiffness, rtol=1e-12
    )


@pytest.mark.parametrize(
    ("fixed", "clamp", "nodes", "elements", "carried"),
    [
        ((), "element", [], [], []),
        ((0,), "element", [0], [], []),
        ((0, 1), "element", [0], [0], [1]),
        ((0, 1), "nodes", [0, 1], [0], []),
        ((0, 1, 2), "element", [0, 1], [0, 1], [2]),
        ((4, 5), "element", [5], [4], [4]),
        ((0, 1, 4, 5), "element", [0, 5], [0, 4], [1, 4]),
        ((0, 5), "element", [0, 5], [], []),
        ((2, 3), "element", [2, 3], [2], []),
        ((0, 1, 2, 3, 4, 5), "element", [0, 1, 2, 3, 4, 5], [0, 1, 2, 3, 4], []),
    ],
)
def test_what_is_held(make_chain, make_experiment, fixed, clamp, nodes, elements, carried):
    experiment = make_experiment(make_chain(5, fixed=fixed))
    (chain,) = sort_chains(experiment.geometry).chains
    held = held_parts(chain, experiment, clamp=clamp)
    assert np.flatnonzero(held.nodes).tolist() == nodes
    assert np.flatnonzero(held.elements).tolist() == elements
    assert np.flatnonzero(held.carried).tolist() == carried


def limit_of(experiment, **options):
    return shortest_limit(experiment, options=checked_options(options))


def test_the_step_limits_of_a_long_uniform_rod(make_chain, make_experiment):
    """l/c of stretch; with shear 2/omega, omega^2 <= 4 c_s^2 (1/l^2 + 1/R^2) + 4 c^2 / l^2."""
    n, radius = 200, 0.02
    limit = limit_of(make_experiment(make_chain(n, radius=radius, length=20.0)))
    c, c_s, element = math.sqrt(1e3), math.sqrt(27 / 28 * 1e3 / 3), 0.1
    assert limit.stretching == pytest.approx(element / c, rel=1e-4)
    above = 1.0 / math.sqrt(c_s**2 * (1 / element**2 + 1 / radius**2) + (c / element) ** 2)
    assert above < limit.bending < radius / c_s
    # The shortest wave, w and q alternating in sign: the larger root of a 2 x 2 problem.
    a = 4 * c_s**2 / element**2
    b = 4 * c_s**2 / radius**2 + 4 * c**2 / element**2
    off = 4 * c_s**2 / (element * radius)
    omega2 = (a + b) / 2 + math.sqrt(((a - b) / 2) ** 2 + off**2)
    assert limit.bending == pytest.approx(2 / math.sqrt(omega2), rel=1e-3)
    assert limit.step == limit.bending
    assert "shear and rotation" in limit.setter


def test_elements_that_turn_slowly_leave_the_limit_to_waves(make_chain, make_experiment):
    limit = limit_of(make_experiment(make_chain(100)), radius=0.5)
    # l/c is the limit of an endless rod; a free end moves a little slower.
    assert limit.stretching == pytest.approx(0.01 / math.sqrt(1e3), rel=1e-3)
    assert limit.step == limit.stretching
    assert "stretching waves" in limit.setter


@pytest.mark.parametrize(("fixed", "held", "turned"), [((), [], []), ((0, 1), [0], [0])])
def test_the_limit_of_an_uneven_chain(make_chain, make_experiment, rod_modes, fixed, held, turned):
    rng = np.random.default_rng(2)
    plain = make_chain(7, fixed=fixed, masses=rng.uniform(0.1, 0.3, 8))
    stretched = with_bars(
        plain, stiffness=rng.uniform(1e3, 3e3, 7), rest_length=rng.uniform(0.1, 0.2, 7)
    )
    uneven = with_bends(stretched, stiffness=rng.uniform(0.5, 1.5, 6))
    experiment = make_experiment(uneven)
    limit = limit_of(experiment)
    (chain,) = sort_chains(uneven).chains
    material = material_of(chain, experiment, options=checked_options({}))
    frequencies, _ = rod_modes(
        shear=material.shear,
        bend=material.bend,
        mass=material.mass,
        inertia=material.inertia,
        length=material.rest_lengths,
        held=held,
        turned=turned,
    )
    assert limit.bending == pytest.approx(2.0 / (2.0 * np.pi * frequencies[-1]), rel=1e-10)


def test_what_is_held_does_not_count(make_chain, make_experiment):
    experiment = make_experiment(make_chain(3))
    (chain,) = sort_chains(experiment.geometry).chains
    material = material_of(chain, experiment, options=checked_options({}))
    all_held = {"held_nodes": np.ones(4, bool), "held_elements": np.ones(3, bool)}
    assert math.isinf(step_limit(material, **all_held).step)


def test_a_step_that_is_too_long_is_told_beforehand(make_chain, make_experiment):
    five = make_chain(5, fixed=(0, 1))
    assert supports(make_experiment(five, dt=1e-3, save_interval=0.01)) == []
    (finding,) = supports(make_experiment(five, dt=2e-3, save_interval=0.01))
    assert (finding.code, finding.level) == ("PYE-UNSTABLE-STEP", "warning")
    assert "at most 0.001096 s" in finding.expected
    assert "substeps=auto" in finding.fix
    relaxed = make_experiment(five, dt=2e-3, save_interval=0.01, step_check="warn")
    assert supports(relaxed) == []


def test_drives_and_their_rates(make_chain, make_experiment):
    ramp = Signal(name="ramp", values=np.array([0.0, 1.0, 4.0]), dt=0.5)
    steps = Signal(name="steps", values=np.array([[1.0, 2, 3], [4, 5, 6]]), dt=1.0,
                   interpolation="hold")  # fmt: skip
    experiment = make_experiment(
        make_chain(5),
        signals={"ramp": ramp, "steps": steps},
        actuators=(
            Actuator(node=1, signal="ramp", type="position", axes=(False, True, False)),
            Actuator(node=2, signal="ramp", type="velocity", axes=(True, False, False)),
            Actuator(node=3, signal="steps", type="force"),
        ),
    )
    motions = drives_of(experiment, forces=False)
    assert motions.at.tolist() == [[1, 1], [2, 0]]
    times = np.array([0.25, 0.75, 2.0])
    # Position as it says; velocity integrated from where node 2 was, 0.4 m.
    np.testing.assert_allclose(
        motions.values(times), [[0.5, 0.4625], [2.5, 1.0875], [4.0, 5.9]], rtol=1e-12
    )
    np.testing.assert_allclose(motions.rates(times), [[2, 0.5], [6, 2.5], [0, 4]], rtol=1e-12)
    forces = drives_of(experiment, forces=True)
    assert forces.at.tolist() == [[3, 0], [3, 1], [3, 2]]
    np.testing.assert_array_equal(forces.values(np.array([0.5, 1.0])), [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(forces.rates(np.array([0.5])), [[0, 0, 0]])
