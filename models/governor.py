"""Centrifugal governor: flyweights rub on a drum and limit the speed of a geared rotor."""

import beamdae as bd


@bd.model(t_end=1.0)
def governor(torque=0.6, ratio=6.0, coefficient=0.25, preload=0.02, stiffness=0.05):
    """Drive the rotor by a mainspring barrel and a gear of `ratio` [-].

    The mainspring has a torque of `torque` [N m] at the start. Two flyweights of 40 g are pivoted
    on the rotor and restrained by torsion springs of `preload` [N m] and `stiffness` [N m/rad]. At
    speed they swing out, and their shoes rub with the friction `coefficient` [-] in a fixed drum of
    45 mm radius.
    """
    mech = bd.Mechanism()
    ground, axis, away = mech.ground, (0.0, 0.0), (-0.3, 0.0)
    barrel = mech.add(bd.RigidBody.disk("barrel", away, radius=0.06, mass=0.8))
    rotor = mech.add(bd.RigidBody.disk("rotor", axis, radius=0.03, mass=0.15))
    mech.add(bd.Revolute("barrel bearing", ground.at(*away), barrel.at(*away)))
    bearing = mech.add(bd.Revolute("rotor bearing", ground.at(*axis), rotor.at(*axis)))
    mech.add(
        bd.TorsionSpring("mainspring", ground.at(*away), barrel.at(*away), 0.005, preload=-torque)
    )
    gear = mech.add(bd.Gear("gear", barrel.at(*away), rotor.at(*axis), ratio=-ratio))
    mech.add(bd.Friction("rubbing", bearing, 0.1, friction_speed=0.005, radius=0.004))
    drum = bd.CircleSurface(ground.at(*axis), radius=0.045, side="inside")
    for name, side in (("right", 1.0), ("left", -1.0)):
        pivot, shoe = (side * 0.028, 0.0), (side * 0.024, side * 0.036)
        weight = mech.add(bd.RigidBody.rod(f"{name} weight", pivot, shoe, mass=0.04))
        mech.add(bd.Revolute(f"{name} pivot", rotor.at(*pivot), weight.at(*pivot)))
        spring = {"stiffness": stiffness, "damping": 1e-4, "preload": -preload}
        mech.add(bd.TorsionSpring(f"{name} spring", rotor.at(*pivot), weight.at(*pivot), **spring))
        lining = {"stiffness": 5e5, "restitution": 0.2, "impact_speed": 0.2}
        touch = bd.Contact(
            f"{name} shoe",
            weight.at(*shoe),
            drum,
            friction=coefficient,
            friction_speed=0.05,
            **lining,
        )
        mech.add(touch)
        swing = bd.relative_displacement(of=weight.at(*shoe), on=rotor.at(*axis))
        mech.observe(f"{name} weight", swing)
        mech.observe(f"{name} shoe", touch.force)

    mech.observe("rotor", rotor.at(*axis))
    mech.observe("gear", gear.reaction)
    return mech
