"""Text of a study file with slow runs, for tests that interrupt it."""

_TEXT = """
import time

import beamdae as bd


@bd.model(t_end=0.1)
def slow(mass=1.0):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, inertia=0.1, center=(1.0, 0.0)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("end", bob.at(2.0, 0.0))
    time.sleep({seconds})
    return mech


@bd.study(references=(bd.Ida(rtol=1e-6), bd.GeneralizedAlpha(step=1e-3)))
def masses():
    return [bd.Case(slow, {{"mass": 1.0 + m}}, bd.Ida(rtol=1e-4)) for m in range({cases})]
"""


def slow_study(cases, seconds):
    """Return the text of a study of `cases` cases whose models take `seconds` [s] to build."""
    return _TEXT.format(cases=cases, seconds=seconds)
