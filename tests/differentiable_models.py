"""Models whose derivatives are tested forward and backward."""

from mechanisms import EARTH, hinged_beam, rectangle

import beamdae as bd


@bd.model(t_end=0.6)
def swing(torque=3.0, width=0.4, mass=2.0, until=0.2):
    """Pendulum driven by a torque with two breakpoints."""
    mech = bd.Mechanism(gravity=EARTH)
    rod = mech.add(bd.RigidBody.rod("rod", (0.0, 0.0), (width, 0.0), mass=mass))
    pin = mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), rod.at(0.0, 0.0)))
    law = bd.piecewise((until, torque), (0.4, -torque), 0.0)
    mech.add(bd.Moment("drive", on=rod.at(0.0, 0.0), law=law))
    mech.observe("tip", rod.at(width, 0.0))
    mech.observe("pin", pin.reaction)
    return mech


@bd.model(t_end=0.1)
def turning(speed=2.0, length=0.5):
    """Beam on a motor with constant speed, which sets the whole beam in rigid motion."""
    steel = rectangle(0.01, damping=1e-3)
    mech, beam = hinged_beam(steel, 1, length)
    root = mech.ground.at(0.0, 0.0)
    mech.add(bd.Driver("motor", root, beam.start, lambda t: speed * t))
    mech.observe("tip", beam.end)
    return mech


@bd.model(t_end=0.5)
def skater(offset=0.1, spin=1.0, push=3.0):
    """Body on a skate, a nonholonomic constraint."""
    mech = bd.Mechanism()
    center, velocity = (offset, 0.0), (1.0, spin * offset)
    sled = bd.RigidBody("sled", 2.0, 0.3, center, velocity=velocity, angular_velocity=spin)
    mech.add(sled)
    mech.add(bd.Skate("blade", sled.at(0.0, 0.0)))
    mech.add(bd.Force("push", sled.at(offset, 0.05), (push, 0.0)))
    mech.observe("sled", sled.at(0.0, 0.0))
    return mech
