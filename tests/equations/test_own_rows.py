"""Nonholonomic rows, and forces that follow reactions, of a part of the user's own."""

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
    Named,
    NonholonomicKernel,
)

MASS, INERTIA, RADIUS, GRAVITY = 1.3, 0.4, 0.3, 9.81


class Row(Part):
    """One constraint on the velocities of a body: row(local) = 0."""

    def __init__(self, body, row):
        self.name, self.body, self.row = "row", body, row

    def constraints(self):
        point = self.body.at(*self.body.center)
        local = Local(3, 0, 1)
        held = (Named("held", "N"),)
        kernel = NonholonomicKernel(local, SX(self.row(local)))
        return [ConstraintStatement(self.name, kernel, (point.piece,), held)]


class Pushed(Part):
    """A force on a body that follows so many multipliers of a joint."""

    def __init__(self, body, joint, count):
        self.name, self.body, self.joint, self.count = "pushed", body, joint, count

    def forces(self, gravity):
        local = Local(3, 0, self.count)
        force = ca.vertcat(-0.1 * ca.sum1(local.lam), 0, 0)
        kernel = ForceKernel(local, force, powers=ca.vertcat(-ca.dot(force, local.v), 0))
        piece = self.body.at(*self.body.center).piece
        return [ForceStatement(self.name, kernel, (piece,), np.zeros((0, 1)), self.joint)]


def body_with(row, **started):
    mech = bd.Mechanism(gravity=(GRAVITY, 0.0))
    body = mech.add(bd.RigidBody("body", MASS, INERTIA, **started))
    mech.add(Row(body, row))
    return mech, body


every_form = pytest.mark.parametrize(
    "integrator",
    [pytest.param(x, id=name) for name, x in tuned(1e-8, 1e-3, also=IDA_FORMS).items()],
)


@every_form
def test_rolling_by_a_row_of_velocities(integrator):
    """x' = r w downhill: x'' = g / (1 + I/(m r^2)), and no turn is lost on the way."""
    mech, _ = body_with(lambda local: local.v[0] - RADIUS * local.v[2])
    found = bd.simulate(mech, integrator, 1.0, 0.25)
    assert found.status.success, found.status.sentence
    travel = 0.5 * GRAVITY / (1.0 + INERTIA / (MASS * RADIUS**2)) * found.t**2
    # A parabola, which steps of all orders follow but for rtol.
    assert_allclose(found.q[:, 0], travel, rtol=0.0, atol=1e-6)
    assert_allclose(RADIUS * found.q[:, 2], travel, rtol=0.0, atol=1e-6)
    assert found.quality.energy_imbalance < 1e-6


# In Ida's forms whose velocities and multipliers are not in its test of Newton's iteration these
# may be far off where, as here, the tested positions are linear and need one iteration alone; the
# energy balance tells.
@integrators(1e-8, 1e-3)
def test_what_drives_a_velocity_does_work(integrator):
    """x' = c sin(w t): the multiplier is g m - m x'', its work the kinetic energy and the lift."""
    speed, rate = 0.5, 3.0
    mech, _ = body_with(lambda local: local.v[0] - speed * ca.sin(rate * local.time[0]))
    found = bd.simulate(mech, integrator, 2.0, 0.25)
    assert found.status.success, found.status.sentence
    x = speed / rate * (1.0 - np.cos(rate * found.t))
    pull = MASS * (GRAVITY - speed * rate * np.cos(rate * found.t))
    # Generalized-alpha is of second order in a step of 1e-3 s.
    assert_allclose(found.q[:, 0], x, rtol=0.0, atol=2e-6)
    assert_allclose(found.lam[:, 0], pull, rtol=0.0, atol=2e-3)
    work = 0.5 * MASS * (speed * np.sin(rate * found.t)) ** 2 - MASS * GRAVITY * x
    assert_allclose(found.ledger["energy.work_of_drivers [J]"], work, rtol=0.0, atol=1e-4)


def test_a_row_that_is_not_linear_in_velocities_is_refused():
    mech, _ = body_with(lambda local: local.v[0] ** 2 - 1.0)
    message = "row: its nonholonomic constraint must be linear in the velocities"
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.equations_of_motion(mech)


@pytest.mark.parametrize(
    ("joint", "count", "message"),
    [
        (None, 1, "pushed: a force that depends on 1 multipliers must name the joint"),
        ("row", 0, "pushed: a force that depends on 0 multipliers must name .* got 'row'"),
        ("row", 2, "pushed: it depends on 2 multipliers of 'row', which has 1"),
        ("rows", 1, "pushed: it depends on 1 multipliers of 'rows', which has 0"),
    ],
)
def test_multipliers_that_are_not_there_are_refused(joint, count, message):
    mech, body = body_with(lambda local: local.v[1])
    mech.add(Pushed(body, joint, count))
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.equations_of_motion(mech)


def test_a_force_follows_the_reaction_of_another_part():
    """The row holds the weight of an inclined body, a tenth of which pulls it along."""
    mech = bd.Mechanism(gravity=(0.0, -GRAVITY))
    body = mech.add(bd.RigidBody("body", MASS, INERTIA))
    mech.add(Row(body, lambda local: local.v[1]))
    mech.add(Pushed(body, "row", 1))
    found = bd.simulate(mech, bd.Radau(), 1.0, 0.5)
    # The multiplier is minus the force that holds it up.
    assert_allclose(found.lam, -MASS * GRAVITY, rtol=1e-12)
    assert_allclose(found.q[:, 0], -0.05 * GRAVITY * found.t**2, rtol=0.0, atol=1e-9)
