"""Elastic ring on two rubber bushings, excited by an unbalanced motor on top."""

import numpy as np

import beamdae as bd


@bd.model(t_end=0.6)
def ring_mount(
    elements=3,
    radius=0.3,
    motor_mass=3.0,
    frequency=20.0,
    unbalance=2e-3,
    formulation="floating frame",
):
    """Run the motor up in 0.2 s to `frequency` [Hz], starting at rest under the weight.

    The steel ring of `radius` [m], 40 mm x 8 mm, consists of four beams welded end to start. The
    motor has `motor_mass` [kg], its rotor an `unbalance` [kg m]. The bushings support the ring
    45 degrees left and right of its lowest point.
    """
    steel = bd.Material.of("steel")
    flat = bd.Section.rectangle(steel, width=0.04, height=0.008, damping=2e-5)
    right = radius * np.array([np.sqrt(0.5), -np.sqrt(0.5)])
    circle = bd.Arc(radius, 2.0 * np.pi * radius, start=tuple(right), angle=np.pi / 4.0)

    mech = bd.Mechanism(gravity=(0.0, -9.81), start="equilibrium")
    ground = mech.ground
    ring = bd.welded_beams(
        mech, "ring", circle, flat, 4, closed=True, elements=elements, formulation=formulation
    )
    rubber = {"kx": 6e4, "ky": 3e4, "ktheta": 40.0, "cx": 60.0, "cy": 40.0, "ctheta": 0.05}
    feet = [
        mech.add(bd.Bushing(name, ground.at(*foot.point), foot, **rubber))
        for name, foot in (("right foot", ring[0].start), ("left foot", ring[3].start))
    ]
    top = ring[1].at(ring[1].length / 2.0)
    motor = mech.add(bd.RigidBody("motor", motor_mass, inertia=4e-3, center=top.point))
    rotor = mech.add(
        bd.RigidBody(
            "rotor", 0.4, inertia=2e-4, center=tuple(np.add(top.point, (unbalance / 0.4, 0.0)))
        )
    )
    mech.add(bd.Weld("bolts", top, motor.at(*top.point)))
    mech.add(bd.Revolute("bearing", motor.at(*top.point), rotor.at(*top.point)))
    speed = bd.run_up(2.0 * np.pi * frequency, 0.2)
    mech.add(bd.Driver("drive", motor.at(*top.point), rotor.at(*top.point), speed))

    mech.observe("motor", motor.at(*top.point))
    mech.observe("right foot", feet[0].force)
    mech.observe("left foot", feet[1].force)
    mech.observe("side", ring[0].section_forces(ring[0].length / 2.0))
    return mech
