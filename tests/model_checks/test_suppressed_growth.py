"""Warnings about vibrations that grow in the model, but that the steps damp."""

import re

import numpy as np
import pytest
import scipy.linalg as la

import beamdae as bd
from beamdae.integrators.alpha.family import family_parameters
from beamdae.model_checks import suppressed_growth

_STEEL = bd.Material.of("steel")
_LENGTH, _HEIGHT = 0.3, 0.1


def _start_slowly(size, duration):
    return lambda t: size * (t / duration) ** 3 * (10 - 15 * t / duration + 6 * (t / duration) ** 2)


def _wiper(damping=0.0, static=0.45, elements=4):
    """Return an arm that is pressed onto the ground and whose tip slides slowly."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    strip = bd.Section.rectangle(_STEEL, width=0.01, height=0.0015, damping=damping)
    hub = mech.add(bd.RigidBody.disk("hub", (0.0, _HEIGHT), 0.02, mass=0.1))
    line = bd.Line((0.0, _HEIGHT), (np.sqrt(_LENGTH**2 - _HEIGHT**2), 0.0))
    arm = mech.add(bd.Beam("arm", line, strip, elements=elements, formulation="exact"))
    bearing = mech.ground.at(0.0, _HEIGHT), hub.at(0.0, _HEIGHT)
    mech.add(bd.Revolute("bearing", *bearing))
    mech.add(bd.Weld("clamp", hub.at(0.0, _HEIGHT), arm.start))
    mech.add(bd.Driver("motor", *bearing, _start_slowly(np.radians(-5.0), 0.3)))
    surface = bd.LineSurface(mech.ground.at(0.0, 0.0))
    law = {"restitution": 0.3, "impact_speed": 0.1, "friction": 0.3}
    stribeck = {} if static is None else {"static": static, "stribeck": 5e-3}
    lip = mech.add(bd.Contact("lip", arm.end, surface, 1e6, **law, **stribeck))
    mech.observe("root", arm.section_forces(0.0))
    mech.observe("sliding", lip.sliding)
    return mech


def _column(ratio):
    """Return a column under a follower load, relative to the limit of flutter (Beck 1952)."""
    width, height = 0.02, 0.001
    mech = bd.Mechanism()
    section = bd.Section.rectangle(_STEEL, width=width, height=height)
    line = bd.Line((0.0, 0.0), (0.0, _LENGTH))
    column = mech.add(bd.Beam("column", line, section, elements=4, formulation="exact"))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), column.start))
    thrust = -ratio * 20.05 * _STEEL.E * width * height**3 / 12.0 / _LENGTH**2
    law = bd.piecewise((0.2, _start_slowly(thrust, 0.2)), thrust)
    mech.add(bd.Force("thrust", column.end, (0.0, law), axes="body"))
    mech.observe("tip", column.end)
    return mech


def _servo(kd):
    """Return an arm whose motor follows the angle of its tip."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(_STEEL, width=0.02, height=0.004)
    hub = mech.add(bd.RigidBody.disk("hub", (0.0, 0.0), 0.03, mass=0.3))
    line = bd.Line((0.0, 0.0), (_LENGTH, 0.0))
    arm = mech.add(bd.Beam("arm", line, section, elements=4, formulation="exact"))
    mech.add(bd.Revolute("bearing", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0)))
    mech.add(bd.Weld("clamp", hub.at(0.0, 0.0), arm.start))
    angle = mech.sensor("measured", arm.end, "angle")
    target = mech.input("target", _start_slowly(0.3, 1.0))
    command = bd.pid(mech, "loop", target - angle, 10.0 * kd, kd=kd, filter_time=1e-3)
    mech.add(bd.Moment("motor", hub.at(0.0, 0.0), command))
    mech.observe("tip", arm.end)
    return mech


def _run(mech, t_end, integrator=None):
    solution = bd.simulate(mech, integrator or bd.Auto(), t_end=t_end)
    return solution, [x for x in solution.warnings if "lack this vibration" in x]


def _half_range(solution, column):
    return solution.step_extremes[column].half_range


@pytest.mark.slow(reason="seconds")
def test_regression_suppressed_squeal_of_falling_friction_has_a_warning():
    solution, (warning,) = _run(_wiper(), 0.2)
    assert warning.startswith("lip: ")
    # A quarter wave of the bar speed of steel along the arm
    frequency = float(re.search(r"at ([\d.e+]+) Hz", warning)[1])
    assert np.isclose(frequency, np.sqrt(_STEEL.E / _STEEL.rho) / (4 * _LENGTH), rtol=0.05)
    assert _half_range(solution, "root.N [N]") < 0.3


@pytest.mark.slow(reason="a minute")
def test_recommended_step_resolves_the_squeal():
    _, (warning,) = _run(_wiper(), 0.2)
    step = float(re.search(r"max_step=([\d.e-]+)", warning)[1])
    resolved, warnings = _run(_wiper(), 0.2, bd.Radau(max_step=step))
    finer, _ = _run(_wiper(), 0.2, bd.Radau(max_step=0.5 * step))
    assert not warnings
    forces = [_half_range(x, "root.N [N]") for x in (resolved, finer)]
    assert min(forces) > 1.5
    assert np.isclose(*forces, rtol=0.1)


@pytest.mark.slow(reason="a second")
@pytest.mark.parametrize("changes", [{"damping": 1e-4}, {"static": None}])
def test_damped_vibrations_and_constant_friction_have_no_warning(changes):
    _, warnings = _run(_wiper(**changes), 0.2)
    assert not warnings


@pytest.mark.slow(reason="a second")
@pytest.mark.parametrize(("ratio", "t_end", "count"), [(0.9, 0.4, 0), (1.2, 1.0, 1)])
def test_flutter_that_grows_from_rest_has_a_warning_above_its_limit(ratio, t_end, count):
    _, warnings = _run(_column(ratio), t_end)
    assert len(warnings) == count
    assert all(x.startswith("thrust: ") for x in warnings)


@pytest.mark.slow(reason="seconds")
def test_growth_rate_of_flutter_is_that_of_a_run_with_short_steps():
    _, (warning,) = _run(_column(1.2), 1.0)
    frequency, rate = (
        float(x) for x in re.search(r"at (\S+) Hz grow as exp\((\S+) t", warning).groups()
    )
    mech = _column(1.2)
    # A push of 1 uN for 0.1 s
    push = bd.piecewise((0.1, 1e-6), 0.0)
    mech.add(bd.Force("push", mech.parts["column"].end, (push, 0.0)))
    short = bd.simulate(mech, bd.Radau(1e-8, max_step=5e-4), t_end=0.35, output_step=1e-4)
    periods = 2.0 / frequency
    early = (short.t > 0.23) & (short.t < 0.25)
    later = np.interp(short.t[early] + periods, short.t, short["tip.x [m]"])
    growth = la.norm(later) / la.norm(short["tip.x [m]"][early])
    assert np.isclose(np.log(growth) / periods, rate, rtol=0.05)


def test_unstable_loop_that_fixed_steps_damp_has_a_warning():
    _, warnings = _run(_servo(0.05), 1.0, bd.GeneralizedAlpha(0.01, rho_inf=0.5))
    assert len(warnings) == 1
    assert warnings[0].startswith("motor: ")
    assert "Radau(max_step=" in warnings[0]


@pytest.mark.parametrize("z", [0.1 + 2.0j, -0.3 + 0.5j, 0.01 + 30.0j])
def test_factors_of_steps_are_those_of_the_methods(z):
    at = np.array([z])
    (bdf,) = suppressed_growth._amplify_by_bdf(at, 2)
    roots = np.roots([1.5 - z, -2.0, 0.5])
    assert np.isclose(bdf, max(np.max(np.abs(roots)), 1.0 / abs(1.0 - z)))
    parameters = family_parameters("newmark", 1.0)
    (trapezoidal,) = suppressed_growth._amplify_by_alpha(at, parameters)
    assert np.isclose(trapezoidal, abs((1.0 + 0.5 * z) / (1.0 - 0.5 * z)))


def test_regression_rigid_bodies_that_slide_to_rest_have_no_vibrations():
    """LAPACK rejected the empty basis of their modes."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    block = mech.add(bd.RigidBody("block", 1.0, inertia=0.1, velocity=(2.0, 0.0)))
    ends = mech.ground.at(0.0, 0.0), block.at(0.0, 0.0)
    guide = mech.add(bd.Prismatic("guide", *ends))
    law = {"friction_speed": 1e-3, "static": 0.5, "stribeck": 0.05, "radius": 0.1}
    mech.add(bd.Friction("friction", guide, coefficient=0.3, **law))
    run = bd.simulate(mech, t_end=1.0)
    assert not any("vibration" in x for x in run.warnings)
