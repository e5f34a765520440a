"""Constitutive laws, and where their constants are found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from openprc_merlin import material, samples, verify, workspace
from openprc_merlin.mat5 import FunctionHandle

FILE = Path("run.mat")


def infer(**changes):
    variables = {**samples.workspace(), **changes}
    return material.infer(workspace.build(variables, file=FILE))


def number(value):
    return np.array([[float(value)]])


def test_ogden_modulus_is_fitted():
    strain = np.linspace(-0.1, 0.1, 50).reshape(5, 10)
    stretch = np.sqrt(1 + 2 * strain)
    stress = 1234.0 / 4 * (stretch**3 - 1 / stretch)
    assert material.fit_modulus(strain, stress) == pytest.approx(1234.0, rel=1e-12)
    assert material.fit_modulus(strain, 1234.0 * strain) is None
    assert material.fit_modulus(np.zeros((5, 10)), stress) is None


@pytest.mark.parametrize(
    ("changes", "value", "source"),
    [
        ({"C0": number(5e3)}, 5e3, "the variable C0"),
        ({"E0": number(1e6), "C0": number(1e6)}, 1e6, "the variable C0 and E0"),
        ({"E0": number(1e6), "C0": number(1e5)}, None, ""),
        ({"BarMater": FunctionHandle("@(Ex)Ogden(Ex,E0)"), "E0": number(7)}, 7.0, "the handle"),
        ({"BarMater": FunctionHandle("@(Ex) Ogden (Ex, 5e3)")}, 5e3, "the handle"),
        ({"BarMater": FunctionHandle("@(Ex)Mine(Ex)")}, None, ""),
    ],
)
def test_modulus_is_found(changes, value, source):
    found = infer(**changes)
    assert found.c0 == value
    assert found.c0_source.startswith(source)


def test_limits_and_bend_law():
    handle = FunctionHandle("@(he, h0, Kf, L0) EnhancedLinear (he, h0, Kf, L0, 30, 330)")
    assert infer(RotSpring=handle).limits == (30.0, 330.0)
    assert infer(RotSpring=handle).bend_law == "linear"
    assert infer(limlft=number(0.1), limrht=number(359.9)).limits == (0.1, 359.9)
    named = FunctionHandle("sf%0@(he,h0,kpi,L0)EnhancedLinear(he,h0,kpi,L0,limlft,limrht)")
    assert infer(RotSpring=named).limits is None
    assert infer(RotSpring=named, limlft=number(1), limrht=number(2)).limits == (1.0, 2.0)
    automatic = {**samples.workspace()["AnalyInputOpt"], "MaterCalib": "auto"}
    assert infer(AnalyInputOpt=automatic).limits == (45.0, 315.0)
    assert infer(AnalyInputOpt=automatic).bend_law == "four-thirds"
    bend = {**samples.workspace()["angles"], "CMbend": FunctionHandle("@(h)SuperLinearBend(h)")}
    assert infer(angles=bend).bend_law == "four-thirds"
    assert infer().bend_law is None


@pytest.mark.parametrize("limits", [(45.0, 315.0), (0.1, 359.9)])
def test_enhanced_linear_is_smooth_at_its_limits_and_stiffens(limits):
    low, high = np.deg2rad(limits)
    rest = np.array([3.0])
    step = 1e-7
    for limit in (low, high):
        around = np.array([[limit - step], [limit], [limit + step]])
        moment = verify.enhanced_linear(around, rest, limits)[:, 0]
        np.testing.assert_allclose(np.diff(moment) / step, 1.0, rtol=1e-3)
    inside = np.linspace(low, high, 9)[:, None]
    np.testing.assert_allclose(verify.enhanced_linear(inside, rest, limits), inside - rest)
    shut = verify.enhanced_linear(np.array([[low / 100], [2 * np.pi - low / 100]]), rest, limits)
    assert shut[0, 0] < 10 * (low - rest[0]) * (1 if low > 0.1 else 0.1)
    assert shut[1, 0] > 0


def test_no_limit_is_the_linear_law():
    angle = np.array([[0.01], [6.2]])
    found = verify.enhanced_linear(angle, np.array([3.0]), (0.0, 360.0))
    np.testing.assert_allclose(found, angle - 3.0)


def test_four_thirds_is_odd_and_flat_at_rest():
    rest = np.array([np.pi])
    d = np.array([[-0.3], [0.0], [0.3]])
    np.testing.assert_allclose(
        verify.four_thirds(np.pi + d, rest)[:, 0], [-(0.3 ** (4 / 3)), 0, 0.3 ** (4 / 3)]
    )


def test_internal_force_is_the_gradient_of_the_energy():
    variables = samples.workspace(3)
    rng = np.random.default_rng(3)
    base = variables["Uhis"][:, 1] + 0.02 * rng.normal(size=12)
    step = 1e-6
    columns = [base]
    for dof in range(12):
        for sign in (1, -1):
            moved = base.copy()
            moved[dof] += sign * step
            columns.append(moved)
    variables["Uhis"] = np.array(columns).T
    del variables["Fhis"]
    space = workspace.build(variables, file=FILE)
    law = material.Material(700.0, "test", (45.0, 315.0), "test", "linear")
    force, _ = verify.internal_forces(space, law, (45.0, 315.0), slice(0, 1))
    from openprc_merlin import geometry

    x = space.nodes + space.displacements
    stretch = geometry.bar_lengths(x, space.bars) / space.bar_length
    bar = 700.0 / 4 * ((stretch**5 - 1) / 5 - (stretch - 1)) * space.bar_area * space.bar_length
    angle = geometry.dihedral_angles(x, space.hinges.indices)
    fold = 0.5 * 0.2 * 2.0 * (angle - np.pi) ** 2
    energy = bar.sum(axis=1) + fold.sum(axis=1)
    gradient = (energy[1::2] - energy[2::2]) / (2 * step)
    np.testing.assert_allclose(force[0], gradient, atol=2e-7)
