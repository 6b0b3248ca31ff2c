"""Degenerate sizes and laws are rejected; failed runs name the parts that may cause this."""

import math
import time

import numpy as np
import pytest
from conformance import integrators
from mechanisms import driven, free_ball, mass_on_rail, rectangle, symbols

import beamdae as bd

ALLOY = bd.Material(E=68.95e9, nu=0.3, rho=2760.0)
STRIP = rectangle(0.0025, 0.03, material=ALLOY)
LINE = bd.Line((0.0, 0.0), (0.8, 0.0))


@pytest.mark.parametrize("elements", [10**7, 10**9, 10**15])
def test_regression_more_elements_than_fit_into_memory_are_rejected_at_once(elements):
    """Previously, ten million elements exhausted the memory of the machine after 25 s."""
    begin = time.process_time()
    with pytest.raises(
        bd.BeamdaeError,
        match=rf"^beam: a run with elements={elements} needs about .* GB of memory, but .*; "
        r"use at most elements=\d+\.$",
    ):
        bd.Beam("beam", LINE, STRIP, elements=elements)
    assert time.process_time() - begin < 1.0


@pytest.mark.parametrize("section", [STRIP, bd.Section.circle(ALLOY, 0.001)], ids=["strip", "wire"])
def test_regression_a_circle_of_one_chord_is_rejected(section):
    """Its two nodes coincide: the chord has length zero."""
    ring = bd.Arc(radius=0.3, length=2.0 * np.pi * 0.3)
    with pytest.raises(
        bd.BeamdaeError,
        match=r"^ring: elements=1 with 2 nodes each are too few for the curve, where a polygon of "
        r"\S+ m through the nodes replaces an arc of 1\.88 m; use more elements",
    ):
        bd.Beam("ring", ring, section, elements=1, nodes=2)


@pytest.mark.parametrize(("nodes", "elements"), [(2, 2), (2, 3), (3, 1), (4, 1)])
def test_a_circle_of_a_few_nodes_is_accepted(nodes, elements):
    ring = bd.Arc(radius=0.3, length=2.0 * np.pi * 0.3)
    assert bd.Beam("ring", ring, STRIP, elements=elements, nodes=nodes).mesh.nodes == nodes


@pytest.mark.parametrize(
    ("second_moment", "area"), [(1e-70, 7.5e-5), (4e-11, 1e-70), (1e30, 1e-4), (1e-60, 1.0)]
)
def test_regression_a_degenerate_section_is_rejected(second_moment, area):
    """Previously, all columns of the run were nan."""
    section = bd.Section(ALLOY, area, second_moment)
    with pytest.raises(bd.BeamdaeError, match=r"^beam: second_moment .* and area .* radius of gyr"):
        bd.Beam("beam", LINE, section)


@pytest.mark.parametrize("angle", [1e50, -1e50, 1e20])
def test_regression_an_angle_lost_in_rounding_is_rejected(angle):
    with pytest.raises(
        bd.BeamdaeError, match=r"^Arc: angle must not exceed 1e\+06 rad in absolute value"
    ):
        bd.Arc(radius=1.0, length=1.0, angle=angle)


@pytest.mark.parametrize("mass", [[-1.0, 1.0], [1.0, -1e-3], [[1.0, 0.0], [0.0, -1.0]]])
def test_a_negative_mass_is_rejected(mass):
    t, q, v = symbols(2)
    system = bd.ConstrainedSystem(
        t=t, q=q, v=v, mass=mass, force=[0.0, 1.0], q0=[0.0, 0.0], v0=[0.0, 0.0]
    )
    with pytest.raises(bd.BeamdaeError, match="mass matrix has a negative eigenvalue"):
        bd.simulate(system, bd.GeneralizedAlpha(), 1.0)


# Time laws with poles and invalid breakpoints are rejected.


@pytest.mark.parametrize("breakpoint_time", [math.nan, math.inf])
def test_regression_breakpoints_that_are_not_finite_are_rejected(breakpoint_time):
    def build():
        law = bd.results.Law((lambda t: 1.0, lambda t: 2.0), (breakpoint_time,))
        mech, ball = free_ball()
        mech.add(bd.Force("push", ball.point, (law, 0.0)))
        return bd.equations_of_motion(mech)

    with pytest.raises(bd.BeamdaeError, match="breakpoints"):
        build()


def run(law, t_end=1.0):
    mech, ball = free_ball()
    mech.add(bd.Force("push", ball.point, (law, 0.0)))
    return bd.simulate(mech, bd.GeneralizedAlpha(0.1 * t_end), t_end)


@pytest.mark.parametrize("pole", [0.5, 1.0, 1.0 / 3.0, 0.8142])
@pytest.mark.parametrize("power", [1, 2, 3])
def test_poles_of_all_orders_are_detected_at_samples_and_between(pole, power):
    with pytest.raises(bd.BeamdaeError, match=rf"the law becomes infinite near t = {pole:.4g}"):
        run(lambda t: 1.0 / (t - pole) ** power)


def test_a_pole_outside_its_piece_is_accepted():
    pieces = (lambda t: 1.0 / (t - 0.6), lambda t: 1.0 / (t - 0.3))
    assert run(bd.piecewise((0.5, pieces[0]), pieces[1])).status.success
    with pytest.raises(bd.BeamdaeError, match=r"near t = 0\.6 s"):
        run(bd.piecewise((0.7, pieces[0]), pieces[1]))


def angle(t):
    """Return a quotient of the published spin-up, whose tiny values are rounding errors."""
    omega = 2.0 * np.pi / 15.0
    return 0.4 * (0.5 * t**2 + (np.cos(omega * t) - 1.0) / omega**2) / (1.0 + t)


@pytest.mark.parametrize(
    ("law", "t_end"),
    [
        (lambda t: 1.0 / ((t - 0.3) ** 2 + 1e-4), 1.0),
        (lambda t: np.exp(-(((t - 0.3) / 1e-3) ** 2)), 1.0),
        (lambda t: np.sqrt(1.0 - t), 1.0),
        (lambda t: t**0.5, 1.0),
        (lambda t: np.exp(50.0 * t), 1.0),
        (angle, 1e-6),
        (angle, 1e-2),
    ],
)
def test_peaks_roots_and_growth_are_accepted(law, t_end):
    assert run(law, t_end).status.success


# Failed runs name the parts that are likely to cause the failure.


@integrators(1e-5, 1e-3)
def test_a_locking_mechanism_names_its_joints(integrator):
    """The crank is longer than the rod: after 0.26 s, the rod cannot follow the motor."""
    mech, crank = driven(bd.RigidBody("crank", 1.0, 0.1, center=(0.5, 0.0)), lambda t: 3.0 * t)
    rod = mech.add(bd.RigidBody("rod", 1.0, 0.1, center=(1.35, 0.0)))
    mech.add(bd.Revolute("pin", crank.at(1.0, 0.0), rod.at(1.0, 0.0)))
    mech.add(bd.PointOnLine("guide", mech.ground.at(1.7, 0.0), rod.at(1.7, 0.0)))
    with pytest.warns(bd.BeamdaeWarning):
        status = bd.simulate(mech, integrator, 1.0).status
    assert status.kind == "failed"
    assert "stopped at t = 0.258" in status.sentence
    assert "near a singular position of hinge, motor, pin, guide;" in status.sentence
    assert "rod.angle has the largest acceleration" in status.sentence


@integrators(1e-5, 1e-3)
def test_a_load_that_becomes_nan_names_the_coordinate(integrator):
    mech = bd.Mechanism()
    disk = mech.add(bd.RigidBody("disk", 1.0, 1.0))
    mech.add(bd.RigidBody("other", 1.0, 1.0))
    mech.add(bd.Moment("twist", disk.at(0.0, 0.0), law=lambda t: np.sqrt(0.5 - t)))
    with pytest.warns(bd.BeamdaeWarning):
        status = bd.simulate(mech, integrator, 1.0).status
    assert "the force on disk.angle is not finite after this time" in status.sentence
    assert "other" not in status.sentence


@pytest.mark.parametrize("step", [0.01, 0.03, 0.1])
def test_regression_friction_that_reverses_within_a_fixed_step_is_named(step):
    mech, mass = mass_on_rail(x=1.0, spring=(100.0, 0.0, 0.8))
    mech.add(bd.Force("load", mass.point, (bd.sine(1.0, frequency=0.1), 0.0)))

    def rub(at, t):
        speed = at.velocity[0]
        return -5.0 * speed / np.sqrt(speed**2 + 1e-8), 0.0

    mech.add(bd.ForceLaw("rubber", mass.point, rub))
    with pytest.warns(bd.BeamdaeWarning):
        status = bd.simulate(mech, bd.GeneralizedAlpha(step), t_end=2.0).status
    assert f"the force of rubber changes abruptly within {step} s;" in status.sentence


@pytest.mark.parametrize("power", [1, 2])
@pytest.mark.parametrize("gap", [1e-2, 0.5])
def test_regression_forces_that_become_infinite_are_named(power, gap):
    """An electrostatic force whose gap closed led to "check the model near this time"."""
    mech, mass = mass_on_rail()

    def attract(at, t):
        return gap / (1.0 - at.position[0] / gap) ** power, 0.0

    mech.add(bd.ForceLaw("electrode", mass.point, attract))
    with pytest.warns(bd.BeamdaeWarning):
        status = bd.simulate(mech, bd.Radau(), 5.0).status
    assert status.kind == "failed"
    assert "the force of electrode changes abruptly within" in status.sentence


def test_fixed_steps_that_stop_at_sticking_name_the_friction():
    mech, foot = free_ball(mass=2.0, name="foot", gravity=9.81, velocity=(1.0, 0.0))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    damping = {"restitution": 0.5, "impact_speed": 0.1}
    friction = {"friction": 0.5, "friction_speed": 1e-4}
    mech.add(bd.Contact("sole", foot.point, floor, 1e5, **damping, **friction))
    with pytest.warns(bd.BeamdaeWarning):
        status = bd.simulate(mech, bd.GeneralizedAlpha(step=1e-3), 0.5).status
    assert "the force of sole changes abruptly within 0.001 s;" in status.sentence
