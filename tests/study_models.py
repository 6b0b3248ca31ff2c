"""Models of studies that several tests share."""

from pathlib import Path

import mechanisms

import beamdae as bd


@bd.model(t_end=0.4)
def singular_torque(limit=0.2):
    """Its moment becomes complex at t = limit."""
    mech = bd.Mechanism()
    bob = mech.add(bd.RigidBody("bob", 2.0, inertia=0.1))
    mech.add(bd.Moment("torque", on=bob.at(0.0, 0.0), law=lambda t: (limit - t) ** 1.5))
    mech.observe("bob", bob.at(0.0, 0.0))
    return mech


@bd.model(t_end=0.1)
def swing(mass=2.0, note=None, marker=""):
    """Return a body on a hinge; `note` has no effect, and building it creates the file `marker`."""
    if marker:
        Path(marker).touch()
    return mechanisms.swing(mass)
