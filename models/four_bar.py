"""Four-bar linkage (crank-rocker) with a curved flexible coupler and a return spring."""

import numpy as np

import beamdae as bd


@bd.model(t_end=2.0)
def four_bar(
    elements=6,
    speed=2.0 * np.pi,
    rise=0.12,
    height=0.004,
    stiffness=150.0,
    damping=1e-4,
    formulation="floating frame",
):
    """Run the crank up from rest to `speed` [rad/s] in 0.5 s.

    The crank is 0.25 m long, the rocker 0.6 m, and their bearings are 0.9 m apart. The coupler is a
    steel strip of 20 mm x `height` [m], 0.8 m from pin to pin and curved with a `rise` [m]. A
    spring of `stiffness` [N/m] pulls the middle of the rocker back. `damping` [s] is the
    Kelvin-Voigt retardation time of the strip.
    """
    steel = bd.Material.of("steel")
    strip = bd.Section.rectangle(steel, width=0.02, height=height, damping=damping)
    bar = bd.Section.rectangle(steel, width=0.02, height=0.01)
    shaft, crank_end, foot = (0.0, 0.0), (0.0, 0.25), (0.9, 0.0)
    # Intersection of circles of 0.8 m about the crank's end and of 0.6 m about the foot.
    span, turn = np.hypot(0.9, 0.25), np.arctan2(-0.25, 0.9)
    turn += np.arccos((0.8**2 + span**2 - 0.6**2) / (2.0 * 0.8 * span))
    rocker_end = (0.8 * np.cos(turn), 0.25 + 0.8 * np.sin(turn))

    mech = bd.Mechanism(gravity=(0.0, -9.81), start="equilibrium")
    ground = mech.ground
    crank = mech.add(bd.RigidBody.rod("crank", shaft, crank_end, density=steel.rho, area=bar.area))
    rocker = mech.add(bd.RigidBody.rod("rocker", foot, rocker_end, density=7850.0, area=bar.area))
    bow = bd.Parabola(span=0.8, rise=rise, start=crank_end, angle=turn)
    coupler = mech.add(bd.Beam("coupler", bow, strip, elements, formulation=formulation))

    mech.add(bd.Revolute("crank bearing", ground.at(*shaft), crank.at(*shaft)))
    mech.add(bd.Revolute("crank pin", crank.at(*crank_end), coupler.start))
    pin = mech.add(bd.Revolute("rocker pin", coupler.end, rocker.at(*rocker_end)))
    mech.add(bd.Revolute("rocker bearing", ground.at(*foot), rocker.at(*foot)))
    law = bd.run_up(speed, 0.5)
    motor = mech.add(bd.Driver("motor", ground.at(*shaft), crank.at(*shaft), law))
    middle = rocker.at(*np.add(foot, rocker_end) / 2.0)
    spring = mech.add(bd.Spring("spring", ground.at(1.4, 0.3), middle, stiffness, free_length=0.3))

    mech.observe("rocker", rocker.at(*rocker_end))
    mech.observe("coupler", coupler.deformation(coupler.length / 2.0))
    mech.observe("rocker pin", pin.reaction)
    mech.observe("motor", motor.drive)
    mech.observe("spring", spring.force)
    return mech
