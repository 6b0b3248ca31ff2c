"""Expressions with numbers as data equal expressions that contain the numbers."""

from dataclasses import dataclass

import numpy as np
import pytest
from chains import STRIP, random_state
from numpy.testing import assert_allclose
from support import NumericEquations

import beamdae as bd
from beamdae.parts.attachments import Attachment
from beamdae.parts.laws import Law
from beamdae.symbolic.force_kernel import ForceKernel
from beamdae.symbolic.formula import (
    Formula,
    FormulaExpression,
    build_formula_kernel,
    constant_formula,
)

TIME = np.array([0.7, 0.7])


def machine():
    """Return a mechanism with all parts whose expressions are made of formulas."""
    mech = bd.Mechanism(gravity=(0.3, -9.81))
    arc = bd.Arc(radius=0.9, length=0.5, start=(1.0, 0.1), angle=0.2)
    beam = mech.add(bd.Beam("beam", arc, STRIP, elements=2, frame="tangent"))
    body = mech.add(bd.RigidBody("body", 2.0, 0.1, center=(1.0, 0.3)))
    free = mech.add(bd.PointMass("free", 0.4, at=(2.0, 0.5)))
    mech.add(bd.PointMass("mass", 0.3, on=beam.at(0.2)))
    hinge = mech.add(bd.Revolute("hinge", mech.ground.at(1.0, 0.1), beam.start))
    weld = mech.add(bd.Weld("weld", beam.end, body.at(*beam.end.point)))
    line = body.at(1.5, 0.4)
    guide = mech.add(bd.PointOnLine("line", line, free.point, direction=(0.5, 0.1)))
    disk = mech.add(bd.RigidBody("disk", 2.0, 0.1, center=(0.2, 0.5)))
    mech.add(bd.RollingOnLine("rolling", mech.ground.at(0.0, 0.0), disk.at(0.2, 0.5), 0.5))
    other = mech.add(bd.RigidBody("other", 2.0, 0.1, center=(1.0, 0.7)))
    mech.add(bd.RollingOnCircle("rolling on it", body.at(1.0, 0.3), other.at(1.0, 0.7), (0.3, 0.1)))
    mech.add(bd.Skate("skate", body.at(1.2, 0.1), direction=(0.3, 0.4)))
    mech.add(bd.Friction("bearing", hinge, 0.3, 0.2, static=0.4, stribeck=0.3, radius=0.1))
    friction = mech.add(bd.Friction("slide", guide, 0.3, 0.2))
    mech.observe("friction", friction.reaction)
    angle_law = bd.piecewise((0.5, 0.0), (1.0, bd.sine(0.2, 1.5, 0.4)), 0.1)
    mech.add(bd.Driver("driver", mech.ground.at(0.0, 0.0), beam.start, law=angle_law))
    mech.add(bd.Prismatic("slider", beam.start, line, direction=(0.2, 0.9)))
    mech.add(bd.Distance("link", free.point, beam.at(0.3), length=bd.sine(0.9, 0.5, 0.4)))
    mech.add(bd.Gear("gear", beam.start, line, 0.3, carrier=mech.ground.at(0.0, 0.0)))
    mech.add(bd.RackAndPinion("rack", line, beam.end, 0.2, direction=(0.3, 0.1)))
    travel = bd.TranslationalDriver("travel", line, beam.end, angle_law, direction=(0.3, 0.1))
    mech.add(travel)
    mech.add(bd.Moment("moment", on=body.at(1.0, 0.3), law=bd.run_up(2.0, 0.5)))
    loads = (bd.sine(3.0, 2.0), 1.5)
    mech.add(bd.Force("dead", on=beam.at(0.3), law=loads))
    mech.add(bd.Force("follower", on=beam.end, law=loads, axes="body"))
    mech.observe("end", beam.end)
    mech.observe("free", free.point)
    mech.observe("relative", bd.relative_displacement(of=beam.end, on=body.at(0.0, 0.0)))
    for axes in ("inertial", "frame", "local"):
        mech.observe(axes, beam.deformation(0.2, axes=axes))
    mech.observe("frame of the beam", beam.floating_frame)
    mech.observe("gauge", beam.strain(0.3, 0.0))
    mech.observe("forces", beam.section_forces(0.1))
    mech.observe("weld", weld.reaction)
    mech.observe("weld on it", weld.reaction_on("a", axes="body"))
    mech.observe("travel", travel.drive)
    return mech


def values(numeric):
    """Return forces, reactions, constraint levels and observed values at some state."""
    q, v, a, lam = random_state(numeric.equations)
    levels = [level(q=q, v=v, a=a) for level in numeric.levels]
    names = [observable.name for observable in numeric.equations.observables]
    observed = [numeric.observed(name, q=q, v=v, lam=lam) for name in names]
    return [numeric.force(q=q, v=v, a=a), numeric.reaction(q=q, lam=lam), *levels, *observed]


@pytest.mark.slow(reason="a quarter of a second")
def test_formulas_have_the_values_of_functions(monkeypatch):
    by_kind = NumericEquations(machine(), TIME)
    monkeypatch.setattr(Attachment, "checked_kinematics", property(Attachment._evaluate.__get__))
    monkeypatch.setattr(Law, "formula", property(lambda law: law))
    by_recipe = NumericEquations(machine(), TIME)
    terms = [(*x.equations.forces, *x.equations.joints) for x in (by_kind, by_recipe)]
    kernels = [{id(term.kernel) for term in one} for one in terms]
    # The kernels of the element and of the rigid body are shared in both cases.
    assert len(kernels[0] & kernels[1]) == 2
    # A few operations have a different order.
    for got, expected in zip(values(by_kind), values(by_recipe), strict=True):
        assert_allclose(got, expected, rtol=1e-12, atol=1e-12 * np.max(np.abs(expected)))


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
