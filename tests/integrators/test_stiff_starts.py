"""Starts of generalized-alpha in which stiff parts turn: forces from the first step on.

Without the centripetal accelerations, which stretch stiff parts, fixed steps began with axial
vibrations of the size of the centrifugal force.
"""

import numpy as np
import pytest
from mechanisms import STEEL, free_ball, rectangle

import beamdae as bd

SPEED, STEP = 10.0, 1e-3
STIFFNESS, STRETCH = 1e8, 1e-6


def turning_beam(law=None):
    """Return a beam of exact formulation on a pin, turned by a driver if there is a law."""
    section = rectangle(0.02, damping=1e-4)
    mech = bd.Mechanism()
    axis = bd.Line((0.0, 0.0), (1.0, 0.0))
    beam = mech.add(bd.Beam("beam", axis, section, elements=2, formulation="exact"))
    root = mech.ground.at(0.0, 0.0)
    mech.add(bd.Revolute("pin", root, beam.start))
    if law is not None:
        mech.add(bd.Driver("motor", root, beam.start, law))
    mech.observe("middle", beam.section_forces(s=0.5))
    return mech


def centrifugal_force(section_area=4e-4):
    return STEEL.rho * section_area * SPEED**2 * (1.0 - 0.5**2) / 2.0


@bd.model(t_end=0.02)
def slinger(speed=SPEED, length=1.0, gap=0.1, filling=2.0):
    """Ball on a stiff spring that turns towards a stiff wall, and a filter of its height."""
    mech, ball = free_ball((length, 0.0), velocity=(0.0, speed))
    pivot = mech.ground.at(0.0, 0.0)
    mech.add(bd.Spring("arm", pivot, ball.point, STIFFNESS, free_length=length - STRETCH))
    wall = bd.LineSurface(mech.ground.at(0.0, gap), direction=(-1.0, 0.0))
    mech.add(bd.Contact("wall", ball.point, wall, 1e5))
    height = mech.sensor("height", ball.point, "y")
    mech.state("level", lambda level, t: filling * (height - level), start=0.1)
    return mech


@pytest.mark.parametrize("rho_inf", [0.0, 0.8, 1.0])
def test_regression_steady_rotation_has_no_axial_vibrations(rho_inf):
    # 84 % (rho_inf = 0.8) of the force at this step.
    method = bd.GeneralizedAlpha(STEP, rho_inf)
    run = bd.simulate(turning_beam(), method, 0.1, output_step=STEP, start=bd.rotation(SPEED))
    np.testing.assert_allclose(run["middle.N"], centrifugal_force(), rtol=1e-3)


def test_regression_rotation_after_a_breakpoint_has_no_axial_vibrations():
    # 91 % of the force from the end of the run-up on.
    law = bd.run_up(SPEED, 0.2)
    run = bd.simulate(turning_beam(law), bd.GeneralizedAlpha(STEP), 0.3, output_step=STEP)
    late = run.t > 0.2  # the beam still bends, which changes the force by 1.5 %
    np.testing.assert_allclose(run["middle.N"][late], centrifugal_force(), rtol=0.02)


@pytest.mark.parametrize("step", [1e-3, 1e-4])
def test_regression_stiff_spring_turns_without_vibrations(step):
    # 187 N and 109 N at these steps, instead of 100 N.
    run = bd.simulate(slinger(gap=9.0), bd.GeneralizedAlpha(step), output_step=step)
    force = STIFFNESS * (np.hypot(run["ball.x"], run["ball.y"]) - 1.0 + STRETCH)
    np.testing.assert_allclose(force, SPEED**2, rtol=1e-3)


@pytest.mark.slow(reason="half a second and more")
def test_derivatives_agree_with_runs():
    names, method = (
        ["speed", "length", "filling"],
        bd.GeneralizedAlpha(STEP, newton_tolerance=1e-12),
    )
    forward = bd.sensitivities(slinger, names, method, output_step=STEP, estimate_error=False)
    columns = ("ball.x", "level")
    for name in names:
        value = slinger.parameters[name]
        delta = 1e-4 * value
        above, below = (
            bd.simulate(slinger(**{name: value + d}), method, output_step=STEP)
            for d in (delta, -delta)
        )
        for column in columns:
            expected = (above[column] - below[column]) / (2.0 * delta)
            actual = forward.sensitivity(column, name)
            np.testing.assert_allclose(
                actual, expected, rtol=0.0, atol=1e-5 * np.abs(expected).max()
            )
    for column in columns:
        objective = bd.quantities.EndValue(column)
        adjoint = bd.gradient(slinger, objective, names, method, estimate_error=False)
        for name in names:
            expected = forward.sensitivity(column, name).iloc[-1]
            assert adjoint.derivatives[name] == pytest.approx(expected, rel=1e-9)
