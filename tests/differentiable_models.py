"""Models whose derivatives are tested, and differences with which they are compared."""

import numpy as np
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


# Differences of analyses with respect to parameters, which derivatives are compared with.

WEIGHTS = {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}


def differentiate(function, model, name, values, relative=1e-3):
    """Return the fourth-order difference of a function of the mechanism by a parameter."""
    value = values.get(name, model.parameters[name])
    delta = relative * value
    return sum(
        weight / delta * np.asarray(function(model(**{**values, name: value + k * delta})))
        for k, weight in WEIGHTS.items()
    )


def assert_close(actual, expected, value, size, tolerance):
    """Compare derivatives; errors are relative to them, or to the size over the parameter."""
    scale = np.maximum(np.abs(size) / abs(value), np.abs(expected))
    error = np.abs(np.asarray(actual) - expected)
    assert np.all(error <= tolerance * scale), error / scale
