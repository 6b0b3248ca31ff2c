"""Block on a belt, which sticks and slips."""

import beamdae as bd


def block_on_belt(stiffness, stribeck):
    """Return a block of 1 kg on a belt with 0.1 m/s, held by a spring [N/m]."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    belt = mech.add(bd.RigidBody("belt", 5.0, 0.1))
    ends = mech.ground.at(0.0, 0.0), belt.at(0.0, 0.0)
    mech.add(bd.Prismatic("rollers", *ends))
    mech.add(bd.TranslationalDriver("motor", *ends, lambda t: 0.1 * t, (1.0, 0.0)))
    block = mech.add(bd.PointMass("block", 1.0, at=(0.0, -9.81e-6)))
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, -9.81e-6), block.point, stiffness))
    law = {"friction": 0.3, "static": 0.5, "stribeck": stribeck}
    law |= {"exponent": 1.0, "restitution": 0.2, "impact_speed": 0.1}
    surface = bd.LineSurface(belt.at(0.0, 0.0))
    pad = mech.add(bd.Contact("pad", block.point, surface, 1e6, **law))
    mech.observe("block", block.point)
    mech.observe("pad", pad.force)
    return mech
