"""Regression tests of errors that random mechanisms revealed."""

import numpy as np
import pytest
from conformance import integrators
from mechanisms import free_ball, hinged_body
from numpy.testing import assert_allclose

import beamdae as bd


def particle_and_disk():
    mech, particle = free_ball(name="particle", velocity=(0.3, 0.0))
    disk = mech.add(bd.RigidBody("disk", 1.0, 0.1, (0.0, 0.0), angular_velocity=2.0))
    return mech, particle.point, disk.at(0.0, 0.0)


PARTS_THAT_NEED_AN_ANGLE = {
    "friction in a bearing": lambda p, d: bd.Friction(
        "rub", bd.Revolute("pin", p, d), 0.3, friction_speed=0.1, radius=0.1
    ),
    "a line": lambda p, d: bd.PointOnLine("rub", p, d),
    "a driven travel": lambda p, d: bd.TranslationalDriver("rub", p, d, lambda t: 0.1 * t),
    "a line that is touched": lambda p, d: bd.LineSurface(p),
    "a circle that rubs": lambda p, d: bd.Contact(
        "rub", d, bd.CircleSurface(p, 0.1), 10.0, friction=0.3
    ),
}


@pytest.mark.parametrize("make", PARTS_THAT_NEED_AN_ANGLE.values(), ids=PARTS_THAT_NEED_AN_ANGLE)
def test_regression_joints_reject_the_angle_of_a_particle(make):
    """Moments on a particle, which has no angle, violated the conservation of angular momentum."""
    _, particle, disk = particle_and_disk()
    with pytest.raises(bd.BeamdaeError, match=r"particle at \(0, 0\) is a particle without an ang"):
        make(particle, disk)


def test_frictionless_circle_contact_accepts_a_particle():
    mech, particle, disk = particle_and_disk()
    mech.add(bd.Contact("touch", disk, bd.CircleSurface(particle, 0.1, "inside"), 10.0))
    assert bd.simulate(mech, bd.Radau(1e-4), 0.1).status.success


@integrators(1e-5, 1e-3)
def test_regression_driver_moment_of_a_fully_driven_disk(integrator):
    """The angle is a parabola that Ida passes in long steps, the load a sine: 13 % error."""
    mech, disk = hinged_body(1.0, 0.4, name="disk")
    hub = (mech.ground.at(0.0, 0.0), disk.at(0.0, 0.0))
    motor = mech.add(bd.Driver("motor", *hub, law=lambda t: 0.6 * t + 0.8 * t**2))
    mech.add(bd.Moment("load", disk.at(0.0, 0.0), law=lambda t: -6.0 * np.sin(5.8 * t)))
    mech.observe("motor", motor.drive)
    solution = bd.simulate(mech, integrator, 1.0)
    exact = 0.4 * 1.6 + 6.0 * np.sin(5.8 * solution.t)
    # 100 rtol of the largest moment, the guaranteed accuracy.
    assert_allclose(solution.columns["motor.M [N m]"], exact, rtol=0.0, atol=6.6e-3)
    assert solution.quality.energy_imbalance < 1e-3


def test_regression_equilibrium_far_from_the_drawing():
    """Search steps were limited to 400 of a fifth of the size of the disk."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    disk = mech.add(bd.RigidBody.disk("disk", (0.0, -0.5), 0.001, mass=1.0))
    mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), disk.at(0.0, -0.5), 5.0))
    mech.add(bd.TorsionSpring("hold", mech.ground.at(0.0, 0.0), disk.at(0.0, -0.5), 0.1))
    equilibrium = bd.equilibrium(bd.equations_of_motion(mech))
    assert_allclose(equilibrium.q[-1, 1], -0.5 - 9.81 / 5.0, rtol=1e-9)


@pytest.mark.parametrize("meter", [0.1, 1.0, 1e3], ids=["10 m", "m", "mm"])
def test_regression_unloaded_mechanism_is_neither_stable_nor_unstable(meter):
    """The sign of the rounding error in the link's reaction decided on stability."""
    mech = bd.Mechanism()
    ends = (1.063 * meter, -0.183 * meter), (1.13 * meter, 0.944 * meter)
    bar = mech.add(bd.RigidBody.rod("bar", *ends, mass=1.24))
    hook = mech.ground.at(0.848 * meter, 0.574 * meter)
    mech.add(bd.Distance("link", hook, bar.at(*ends[0])))
    with pytest.warns(bd.BeamdaeWarning, match="this coordinate can move without stiffness"):
        equilibrium = bd.equilibrium(mech)
    assert equilibrium.unstable.tolist() == [0]
    assert not equilibrium.stable
