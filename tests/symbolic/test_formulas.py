"""Expressions with numbers as data equal expressions that contain the numbers."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support import NumericEquations

import beamdae as bd
from beamdae.parts.laws import Law
from beamdae.symbolic.force_kernel import ForceKernel
from beamdae.symbolic.formula import (
    Formula,
    FormulaExpression,
    build_formula_kernel,
    constant_formula,
)

TIME = np.array([0.7, 0.7])


def scale(q, numbers):
    return q * numbers[0]


@dataclass(frozen=True)
class ScaledPower:
    power: int

    def __call__(self, q, numbers):
        return q**self.power * numbers[0]


def build_force(local, *functions):
    return ForceKernel(local, sum(function(local.q) for function in functions))


def test_equal_kinds_share_a_kernel():
    def build(*functions):
        return build_formula_kernel(build_force, functions, 1)

    one, data = build(Formula(scale, (2.0,)), Formula(ScaledPower(2), (3.0,)))
    again, other = build(Formula(scale, (4.0,)), Formula(ScaledPower(2), (5.0,)))
    assert one is again
    assert one.reused
    assert_allclose((data, other), ([[2.0], [3.0]], [[4.0], [5.0]]), rtol=0)
    assert build(Formula(scale, (2.0,)), Formula(ScaledPower(3), (3.0,)))[0] is not one
    assert build(Formula(scale, (2.0,)))[0] is not one


def test_functions_that_are_not_formulas_are_not_shared():
    kernel, data = build_formula_kernel(build_force, (lambda q: 7.0 * q, Formula(scale, (2.0,))), 1)
    assert not kernel.reused
    assert_allclose(data, [[2.0]], rtol=0)
    force = kernel.force_kernel.function(TIME, [3.0, 0.0, 0.0, *data.ravel()])
    assert float(force) == pytest.approx(27.0, rel=1e-15)


def test_expression_of_formulas_and_functions_is_not_shareable():
    kind, _ = FormulaExpression.of(build_force, (constant_formula(1.0),))
    mixed, _ = FormulaExpression.of(build_force, (constant_formula(1.0), abs))
    assert kind.is_shareable
    assert not mixed.is_shareable


class HalvedLaw(Law):
    """Law with half the value of its pieces."""

    def __call__(self, time):
        return 0.5 * super().__call__(time)


def test_law_of_a_user_class_is_evaluated_by_itself():
    whole = bd.sine(3.0, 2.0, 0.4)
    forces = []
    for law in (whole, HalvedLaw(whole.pieces)):
        mech = bd.Mechanism()
        body = mech.add(bd.RigidBody("body", 2.0, 0.1))
        mech.add(bd.Moment("moment", on=body.at(0.0, 0.0), law=law))
        forces.append(NumericEquations(mech, TIME).force())
    assert_allclose(forces[0], [0.0, 0.0, -3.0 * np.sin(4.0 * np.pi * 0.7 + 0.4)], rtol=1e-14)
    assert_allclose(forces[1], 0.5 * forces[0], rtol=1e-15)
