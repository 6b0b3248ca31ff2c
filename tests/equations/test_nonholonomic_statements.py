"""User-defined parts with nonholonomic constraints and forces that depend on reactions."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from conformance import IDA_FORMS, integrators, tuned
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.parts.part import Part
from beamdae.symbolic.statements import (
    SX,
    ConstraintStatement,
    ForceKernel,
    ForceStatement,
    Local,
    NonholonomicKernel,
    Variable,
)

MASS, INERTIA, RADIUS, GRAVITY = 1.3, 0.4, 0.3, 9.81


class Row(Part):
    """One nonholonomic constraint on a body: row(local) = 0."""

    def __init__(self, body, row):
        self.name, self.body, self.row = "row", body, row

    def constraints(self):
        point = self.body.at(*self.body.center)
        local = Local(3, 0, 1)
        multipliers = (Variable("row", "N"),)
        kernel = NonholonomicKernel(local, SX(self.row(local)))
        return [ConstraintStatement(self.name, kernel, (point.piece,), multipliers)]


class Pushed(Part):
    """Force on a body that depends on `count` multipliers of a joint."""

    def __init__(self, body, joint, count):
        self.name, self.body, self.joint, self.count = "pushed", body, joint, count

    def forces(self, gravity):
        local = Local(3, 0, self.count)
        force = ca.vertcat(-0.1 * ca.sum1(local.lam), 0, 0)
        kernel = ForceKernel(local, force, powers=ca.vertcat(-ca.dot(force, local.v), 0))
        piece = self.body.at(*self.body.center).piece
        return [ForceStatement(self.name, kernel, (piece,), np.zeros((0, 1)), self.joint)]


def body_with(row, **start):
    mech = bd.Mechanism(gravity=(GRAVITY, 0.0))
    body = mech.add(bd.RigidBody("body", MASS, INERTIA, **start))
    mech.add(Row(body, row))
    return mech, body


every_form = pytest.mark.parametrize(
    "integrator",
    [pytest.param(x, id=name) for name, x in tuned(1e-8, 1e-3, also=IDA_FORMS).items()],
)


@every_form
def test_rolling_by_a_nonholonomic_constraint(integrator):
    """x' = r w downhill: x'' = g / (1 + I/(m r^2)), and the rotation follows without drift."""
    mech, _ = body_with(lambda local: local.v[0] - RADIUS * local.v[2])
    solution = bd.simulate(mech, integrator, 1.0, 0.25)
    assert solution.status.success, solution.status.sentence
    travel = 0.5 * GRAVITY / (1.0 + INERTIA / (MASS * RADIUS**2)) * solution.t**2
    # All methods integrate a parabola up to rtol.
    assert_allclose(solution.q[:, 0], travel, rtol=0.0, atol=1e-6)
    assert_allclose(RADIUS * solution.q[:, 2], travel, rtol=0.0, atol=1e-6)
    assert solution.quality.energy_imbalance < 1e-6


# Forms of Ida whose convergence test omits velocities and multipliers are left out: where positions
# are linear, as here, one iteration passes the test with inaccurate multipliers, which the energy
# balance reveals.
@integrators(1e-8, 1e-3)
def test_a_prescribed_velocity_does_work(integrator):
    """x' = c sin(w t): the multiplier is g m - m x'', its work the kinetic energy and the lift."""
    speed, rate = 0.5, 3.0
    mech, _ = body_with(lambda local: local.v[0] - speed * ca.sin(rate * local.time[0]))
    solution = bd.simulate(mech, integrator, 2.0, 0.25)
    assert solution.status.success, solution.status.sentence
    x = speed / rate * (1.0 - np.cos(rate * solution.t))
    pull = MASS * (GRAVITY - speed * rate * np.cos(rate * solution.t))
    # Generalized-alpha is of second order in a step of 1e-3 s.
    assert_allclose(solution.q[:, 0], x, rtol=0.0, atol=2e-6)
    assert_allclose(solution.lam[:, 0], pull, rtol=0.0, atol=2e-3)
    work = 0.5 * MASS * (speed * np.sin(rate * solution.t)) ** 2 - MASS * GRAVITY * x
    assert_allclose(solution.energies["energy.work_of_drivers [J]"], work, rtol=0.0, atol=1e-4)


def test_a_constraint_not_linear_in_velocities_is_rejected():
    mech, _ = body_with(lambda local: local.v[0] ** 2 - 1.0)
    message = "row: the nonholonomic constraint must be linear in the velocities"
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.equations_of_motion(mech)


@pytest.mark.parametrize(
    ("joint", "count", "message"),
    [
        (None, 1, "pushed: the force has n_multipliers=1 but joint=None"),
        ("row", 0, "pushed: the force has n_multipliers=0 but joint='row'"),
        ("row", 2, "pushed: n_multipliers of the force must be 1, the number of"),
        ("rows", 1, "pushed: n_multipliers of the force must be 0, the number of"),
    ],
)
def test_missing_multipliers_are_rejected(joint, count, message):
    mech, body = body_with(lambda local: local.v[1])
    mech.add(Pushed(body, joint, count))
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.equations_of_motion(mech)


def test_a_force_depends_on_the_reaction_of_another_part():
    """The constraint carries the weight of the body; a force of a tenth of it pulls the body."""
    mech = bd.Mechanism(gravity=(0.0, -GRAVITY))
    body = mech.add(bd.RigidBody("body", MASS, INERTIA))
    mech.add(Row(body, lambda local: local.v[1]))
    mech.add(Pushed(body, "row", 1))
    solution = bd.simulate(mech, bd.Radau(), 1.0, 0.5)
    # The multiplier is minus the supporting force.
    assert_allclose(solution.lam, -MASS * GRAVITY, rtol=1e-12)
    assert_allclose(solution.q[:, 0], -0.05 * GRAVITY * solution.t**2, rtol=0.0, atol=1e-9)
