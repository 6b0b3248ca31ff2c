"""Dense output is as accurate as the steps, for every method."""

import numpy as np
import pytest
from benchmarks.cases import pendulum, pendulum_motion
from conformance import integrators
from mechanisms import driven, rectangle
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.equations import measures
from beamdae.integrators.radau import stepper as radau_stepper

ANGLE, SPEED, GRAVITY = 0.4 * np.pi, 0.5, 9.81
SWING = pendulum(GRAVITY, ANGLE, SPEED).equations
NAMES = ("q", "v", "lam")


def errors(state, t):
    exact = pendulum_motion(GRAVITY, ANGLE, SPEED, t)
    return np.array([np.max(np.abs(getattr(state, x) - exact[x])) for x in NAMES])


def between(interval):
    """Return times at tenths of all steps."""
    inside = np.linspace(0.1, 0.9, 9) * np.diff(interval.t)[:, None]
    return (interval.t[:-1, None] + inside).ravel()


@integrators(rtol=1e-5, step=2e-3)
def test_dense_output_is_as_accurate_as_the_steps(integrator):
    solution = bd.simulate(SWING, integrator, 2.0)
    (interval,) = solution.trajectory.intervals
    t = between(interval)
    ratio = errors(interval.at(t), t) / errors(interval.state, interval.t)
    bounds = np.array([1.5, 1.5, 1.5])
    if integrator.method == "Radau":
        # Velocities of Radau are of order 5 at the steps and of order 4 between them.
        bounds[1] = 10.0
    if integrator.method == "Ida":
        # Accelerations are derivatives of the interpolation polynomial, of one order less (1.76
        # with the tolerance of two periods).
        bounds[2] = 2.0
    assert (ratio < bounds).all(), ratio


def test_radau_dense_output_orders_are_five_four_and_three(monkeypatch):
    # As in test_integrator_orders: the longest steps allowed, and no Newton error.
    monkeypatch.setattr(radau_stepper, "_MAX_ITERATION_FRACTION", 1e-12)
    errors_by_step = []
    for count in (80, 160):
        solution = bd.simulate(SWING, bd.Radau(0.02, max_step=2.0 / count), 2.0)
        (interval,) = solution.trajectory.intervals
        t = between(interval)
        errors_by_step.append(errors(interval.at(t), t))
    assert_allclose(np.log2(np.divide(*errors_by_step)), [5.0, 4.0, 3.0], rtol=0.0, atol=0.2)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("rtol", [1e-3, 1e-5])
def test_axial_force_of_a_slow_rod_between_the_steps(rtol):
    # Corrections of positions by the joints must not stretch the rod.
    radius, length, speed, force = 0.06, 0.28, 1.2, 100.0
    section = rectangle(0.03, damping=2e-5)
    mech, crank = driven(
        bd.RigidBody("crank", mass=1.0, inertia=0.01, center=(0.0, 0.0)), lambda t: speed * t
    )
    line = bd.Line((radius, 0.0), (radius + length, 0.0))
    rod = mech.add(bd.Beam("rod", line, section, elements=8))
    ram = mech.add(bd.PointMass("ram", 0.1, at=(radius + length, 0.0)))
    mech.add(bd.Revolute("crank pin", crank.at(radius, 0.0), rod.start))
    mech.add(bd.Revolute("wrist pin", rod.end, ram.point))
    mech.add(bd.PointOnLine("guide", mech.ground.at(0.0, 0.0), ram.point, direction=(1.0, 0.0)))
    mech.add(bd.Force("load", ram.point, (-force, 0.0)))
    mech.observe("end", rod.section_forces(0.99 * length))
    solution = bd.simulate(mech, bd.Radau(rtol), t_end=5.0)
    end = solution["end.N"][1.0:]
    angle = np.arcsin(radius / length * np.sin(speed * end.index))
    # The inertia of the rod and of the ram is less than 0.2 % of the load.
    assert_allclose(end, -force / np.cos(angle), rtol=5e-3)


def four_bar():
    """Four-bar with a damped coupler, run up in 0.02 s."""
    alloy = bd.Material(E=70e9, nu=0.3, rho=2700.0)
    strip = rectangle(0.004, damping=1e-3, material=alloy)
    mech, crank = driven(
        bd.RigidBody("crank", 0.3, inertia=0.003, center=(0.0, 0.1)), bd.run_up(1.0, 0.02)
    )
    coupler = mech.add(bd.Beam("coupler", bd.Line((0.0, 0.2), (0.5, 0.4)), strip, elements=2))
    rocker = mech.add(bd.RigidBody("rocker", 0.5, inertia=0.01, center=(0.5, 0.2)))
    mech.add(bd.Revolute("B", crank.at(0.0, 0.2), coupler.start))
    mech.add(bd.Revolute("C", coupler.end, rocker.at(0.5, 0.4)))
    mech.add(bd.Revolute("D", mech.ground.at(0.5, 0.0), rocker.at(0.5, 0.0)))
    mech.observe("section", coupler.section_forces(0.2))
    return bd.equations_of_motion(mech)


FOUR_BAR = four_bar()


@integrators(rtol=1e-4, step=1e-3, slow=("alpha adaptive",))
def test_regression_damped_section_forces_do_not_spike_between_steps(integrator):
    """Forces of 100 N at the steps were thousands of N between them, around the run-up."""
    solution = bd.simulate(FOUR_BAR, integrator, 0.04)
    assert solution.status.success, solution.status.sentence
    observed = measures.ObservedRows(FOUR_BAR)
    for interval in solution.trajectory.intervals:
        t = between(interval)
        inside, at_steps = (
            np.abs(observed(np.stack([x, 0.0 * x + interval.branch], -1), *y))
            for x, y in ((t, interval.at(t)), (interval.t, interval.state))
        )
        # A polynomial of degree 4 exceeds the values of its last steps by 2.2 at most if these
        # are equally long; the factor was in the hundreds.
        assert (inside.max(axis=0) < 2.3 * at_steps.max(axis=0)).all()
