"""Sliders, links, gears, racks and drivers: closed forms and balanced reactions."""

import numpy as np
import pytest
from benchmarks.mechanism_cases import slider_on_rod
from mechanisms import EARTH
from numpy.testing import assert_allclose

import beamdae as bd


def run(mech, t_end=0.5):
    """Return a run, and the final velocities by their names."""
    solution = bd.simulate(mech, bd.Radau(1e-9), t_end=t_end)
    return solution, dict(zip(solution.equations.q_names, solution.v[-1], strict=True))


def test_a_slider_keeps_its_offset_and_its_angle():
    """x'' = omega^2 x along the axis; across it F = 2 m omega x' - m omega^2 d."""
    omega, distance, offset, mass = 2.0, 0.3, 0.2, 0.4
    solution, _ = run(slider_on_rod(rate=omega, distance=distance, offset=offset))
    x, rate = distance * np.cosh(omega * solution.t), omega * distance * np.sinh(omega * solution.t)
    place = solution.q[:, 3:5]
    assert_allclose(np.hypot(*place.T), np.hypot(x, offset), rtol=1e-7)
    force = 2.0 * mass * omega * rate - mass * omega**2 * offset
    assert_allclose(solution["guide.F"], force, atol=1e-6)


@pytest.mark.parametrize("side", [1.0, -1.0], ids=["left", "right"])
def test_rack_and_pinion(side):
    """A moment M on a pinion drives a rack of mass m: a = (M / r) / (m + J / r^2)."""
    radius, inertia, mass, moment = 0.25, 0.04, 1.7, 0.9
    mech = bd.Mechanism()
    pinion = mech.add(bd.RigidBody("pinion", 1.0, inertia, (0.0, side * radius)))
    rack = mech.add(bd.RigidBody("rack", mass, 0.1, (0.4, -0.1)))
    center = (0.0, side * radius)
    mech.add(bd.Revolute("bearing", mech.ground.at(*center), pinion.at(*center)))
    mech.add(bd.Prismatic("guide", mech.ground.at(0.0, 0.0), rack.at(0.4, 0.0)))
    teeth = bd.RackAndPinion("teeth", pinion.at(*center), rack.at(0.0, 0.0), side * radius)
    mech.add(teeth)
    mech.add(bd.Moment("motor", pinion.at(*center), moment))
    mech.observe("teeth", teeth.reaction)
    mech.observe("on pinion", teeth.reaction_on("a"))
    solution, velocities = run(mech)
    acceleration = side * moment / radius / (mass + inertia / radius**2)
    assert_allclose(velocities["rack.x"], 0.5 * acceleration, rtol=1e-8)
    force = mass * acceleration
    assert_allclose(solution["teeth.F"], force, rtol=1e-7)
    assert_allclose(solution["on pinion.M"], -side * radius * force, rtol=1e-7)


def test_a_parallelogram_of_links_keeps_its_coupler_level():
    """The coupler of a parallelogram moves along circles without rotation."""
    mech = bd.Mechanism(gravity=EARTH)
    coupler = mech.add(bd.RigidBody("coupler", 2.0, 0.3, (1.0, -0.5)))
    for name, x in (("left", 0.0), ("right", 1.0)):
        end = coupler.at(x + 0.3, -0.4)
        mech.add(bd.Distance(name, mech.ground.at(x, 0.0), end, length=0.5))
    mech.observe("coupler", coupler.at(1.0, -0.5))
    solution = bd.simulate(mech, bd.Ida(rtol=1e-6), t_end=1.0)
    observed = solution.observed
    # Positions drift by 1e-8 m.
    assert_allclose(observed["coupler.angle [rad]"], 0.0, atol=1e-6)
    x, y = (observed[f"coupler.{c} [m]"] for c in ("x", "y"))
    assert_allclose(np.hypot(x - 0.7, y + 0.1), 0.5, atol=1e-6)
    assert np.ptp(x) > 0.5


def test_force_and_power_of_a_prescribed_travel():
    """F = m a and P = F v of a prescribed travel along an inclined line."""
    mass, angle = 1.4, 0.6
    along = (np.cos(angle), np.sin(angle))
    mech = bd.Mechanism()
    cart = mech.add(bd.RigidBody("cart", mass, 0.2, (0.5, 0.1)))
    places = (mech.ground.at(0.2, 0.1), cart.at(0.5, 0.1))
    mech.add(bd.Prismatic("rail", *places, direction=along))
    motor = mech.add(bd.TranslationalDriver("motor", *places, bd.sine(0.4, 0.5), along))
    mech.observe("motor", motor.drive)
    solution, _ = run(mech)
    phase = np.pi * solution.t
    force = -mass * 0.4 * np.pi**2 * np.sin(phase)
    assert_allclose(solution["motor.F"], force, atol=1e-6)
    assert_allclose(solution["motor.power"], force * 0.4 * np.pi * np.cos(phase), atol=1e-6)
    assert_allclose(solution.q[:, 0] - 0.5, 0.4 * np.sin(phase) * along[0], atol=1e-8)
