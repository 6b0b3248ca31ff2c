"""Quarter vehicle on a leaf spring with damper, bump stop and tire, driving over a bump."""

import numpy as np

import beamdae as bd


@bd.model(t_end=2.0)
def leaf_spring_vehicle(
    elements=3,
    sprung_mass=400.0,
    leaves=4,
    bump=0.08,
    duration=0.15,
    damping=2000.0,
    formulation="floating frame",
):
    """Drive over a `bump` [m] that lasts `duration` [s], starting at rest under the weight.

    The leaf spring is drawn unloaded: `leaves` leaves of 60 mm x 7 mm that slide on each other,
    1.2 m from eye to eye with a camber of 0.16 m. The axle of 35 kg hits the bump stop when it is
    0.13 m closer to the chassis than in the drawing. `sprung_mass` [kg] is the mass of the chassis,
    `damping` [N s/m] the coefficient of the damper.
    """
    steel = bd.Material.of("steel")
    area, second_moment = leaves * 0.06 * 0.007, leaves * 0.06 * 0.007**3 / 12.0
    leaf = bd.Section(steel, area, second_moment, damping=1e-4, height=0.007)
    camber = bd.Parabola(span=1.2, rise=-0.16, start=(-0.6, 0.0))

    def road(t):
        return 0.5 * bump * (1.0 - np.cos(2.0 * np.pi * (t - 0.2) / duration))

    mech = bd.Mechanism(gravity=(0.0, -9.81), start="equilibrium")
    ground, down, hub = mech.ground, (0.0, -1.0), (0.0, -0.16)
    chassis = mech.add(bd.RigidBody.plate("chassis", (0.0, 0.2), 1.6, 0.2, mass=sprung_mass))
    axle = mech.add(bd.RigidBody.disk("axle", hub, radius=0.06, mass=35.0))
    patch = mech.add(bd.PointMass("contact patch", 1.0, at=(0.0, -0.46)))
    front, rear = bd.welded_beams(
        mech, "leaf", camber, leaf, bodies=2, elements=elements, formulation=formulation
    )

    mech.add(bd.Prismatic("straight ahead", ground.at(0.0, 0.2), chassis.at(0.0, 0.2), down))
    mech.add(bd.Revolute("front eye", chassis.at(-0.6, 0.0), front.start))
    mech.add(bd.Distance("shackle", chassis.at(0.62, 0.1), rear.end))
    mech.add(bd.Weld("clamp", axle.at(*hub), front.end))
    mech.add(bd.Spring("damper", chassis.at(0.1, 0.15), axle.at(*hub), damping=damping))
    mech.add(bd.Spring("tire", patch.point, axle.at(*hub), 180e3, damping=150.0))
    mech.add(bd.PointOnLine("on the road", ground.at(0.0, -0.46), patch.point, down))
    profile = bd.piecewise((0.2, 0.0), (0.2 + duration, road), 0.0)
    mech.add(
        bd.TranslationalDriver("road", ground.at(0.0, -0.46), patch.point, profile, (0.0, 1.0))
    )
    rubber = bd.LineSurface(chassis.at(0.0, hub[1] + 0.13), direction=(-1.0, 0.0))
    stop = mech.add(
        bd.Contact("bump stop", axle.at(*hub), rubber, 4e6, restitution=0.4, impact_speed=1.0)
    )

    mech.observe("chassis", chassis.at(0.0, 0.2))
    mech.observe("axle", axle.at(*hub))
    mech.observe("bump stop", stop.force)
    mech.observe("stress", front.stress(0.9 * front.length, "top"))
    return mech
