"""Directional derivatives of sums against central differences of the sums themselves."""

import numpy as np
import pytest
from mechanisms import hinged_beam, rectangle

import beamdae as bd
from beamdae.equations.formulations.step_equations import formulate_step
from beamdae.symbolic.sums.kernel_sums import evaluate_sum, set_time
from beamdae.symbolic.sums.sum_derivatives import directional_plan


def two_beams(formulation):
    """Return equations with a beam of several elements, a body, joints and a contact."""
    steel = rectangle(0.01, damping=1e-4)
    mech, beam = hinged_beam(steel, 3, gravity=9.81, formulation=formulation)
    disk = mech.add(bd.RigidBody.disk("disk", (1.0, 0.0), radius=0.1, mass=2.0))
    pin = mech.add(bd.Revolute("pin", beam.end, disk.at(1.0, 0.0)))
    mech.add(bd.Friction("rubbing", pin, 0.1, friction_speed=0.01, radius=0.05))
    floor = bd.LineSurface(mech.ground.at(0.0, -0.2), direction=(1.0, 0.0))
    mech.add(bd.Contact("floor", disk.at(1.0, -0.1), floor, stiffness=1e5))
    return bd.equations_of_motion(mech)


def evaluate(plan, p, x, size):
    total, result = plan.sum(False, p), np.zeros(size)
    set_time(total, 0.1, 0.1)
    evaluate_sum(total, x, result)
    return result


@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
def test_derivative_along_inputs_and_numbers(formulation):
    e = two_beams(formulation)
    plan, size, n_x = formulate_step(e, False).sums[0], e.n + e.m, 4 * e.n + 2 * e.m
    random = np.random.default_rng(1)
    x = np.concatenate([e.q0, np.zeros(n_x - e.n)]) + random.normal(size=n_x) * 1e-2
    dx, dp = random.normal(size=n_x) * 1e-2, random.normal(size=e.p.size) * 1e-2 * e.p
    derivative = evaluate(directional_plan(plan, n_x), e.p, np.concatenate([x, dx, dp]), size)
    h = 1e-3
    differences = [
        (
            evaluate(plan, e.p + k * h * dp, x + k * h * dx, size)
            - evaluate(plan, e.p - k * h * dp, x - k * h * dx, size)
        )
        / (2.0 * k * h)
        for k in (1, 2)
    ]
    expected = (4.0 * differences[0] - differences[1]) / 3.0
    # The error of extrapolated differences is of order h^4; forces of stiff beams are near 1e8.
    np.testing.assert_allclose(derivative, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


def test_open_contact_has_no_derivative_by_its_exponent():
    # The derivative of x^n by n is x^n log x, which is NaN in floating-point numbers at x = 0.
    e = two_beams("floating frame")
    plan, n_x = formulate_step(e, False).sums[0], 4 * e.n + 2 * e.m
    x = np.concatenate([e.q0, np.zeros(n_x - e.n)])
    inputs = np.concatenate([x, np.zeros(n_x), np.ones(e.p.size)])
    assert np.isfinite(evaluate(directional_plan(plan, n_x), e.p, inputs, e.n + e.m)).all()
