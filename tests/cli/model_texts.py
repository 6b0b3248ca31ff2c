"""Texts of model files for the tests of commands."""

SHAKER = """
import beamdae as bd


@bd.model(t_end=1.0)
def shaker(damping=0.02):
    mech = bd.Mechanism()
    mass = mech.add(bd.PointMass("mass", 2.0, at=(1.0, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), mass.point, (1.0, 0.0)))
    ends = mech.ground.at(0.0, 0.0), mass.point
    mech.add(bd.Spring("spring", *ends, 200.0, damping, free_length=1.0))
    mech.add(bd.Force("push", mass.point, (0.0, 0.0)))
    mech.observe("mass", mass.point)
    return mech
"""
VAN_DER_POL = """
import beamdae as bd


@bd.model(t_end=30.0)
def oscillator(force=0.0, growth=1.0):
    mech = bd.Mechanism()
    mass = mech.add(bd.PointMass("mass", 1.0, at=(0.0, 0.0), velocity=(0.5, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), mass.point, (1.0, 0.0)))
    law = lambda x, rate: x + growth * (x**2 - 1.0) * rate
    mech.add(bd.Spring("spring", mech.ground.at(-10.0, 0.0), mass.point, law=law))
    if force:
        mech.add(bd.Force("load", mass.point, (bd.sine(force, 0.25), 0.0)))
    mech.observe("mass", mass.point)
    return mech
"""
OSCILLATOR = """
import numpy as np

import beamdae as bd


@bd.model(t_end=1.0)
def oscillator(frequency=0.2, damping=0.4, force=0.1, angular=False):
    "Oscillator with a `force` [N]."
    mech = bd.Mechanism()
    bob = mech.add(bd.PointMass("bob", 1.0, at=(1.0, 0.0)))
    mech.add(bd.PointOnLine("line", mech.ground.at(0.0, 0.0), bob.point))
    mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), bob.point, 4.0, damping))
    hertz = frequency / (2.0 * np.pi) if angular else frequency
    mech.add(bd.Force("push", bob.point, (bd.sine(force, hertz), 0.0)))
    mech.observe("bob", bob.point)
    return mech
"""
CROSS = """
import beamdae as bd


@bd.model(t_end=1.0)
def cross(stiffness=50.0, weight=0.0, locked=False):
    mech = bd.Mechanism(gravity=(0.0, -weight))
    disk = mech.add(bd.RigidBody("disk", 1.0, 0.3))
    hub = disk.at(0.0, 0.0)
    mech.add(bd.Revolute("axle", mech.ground.at(0.0, 0.0), hub))
    mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), hub, law=0.0))
    if not locked:
        bob = mech.add(bd.RigidBody("bob", 2.0, 0.1))
        mech.add(bd.Bushing("arms", hub, bob.at(0.0, 0.0), stiffness, 80.0, 1e4))
    return mech
"""
SPRUNG = '''
import beamdae as bd


@bd.model(t_end=0.4)
def oscillator(stiffness=40.0, mass=1.0, stretch=0.0):
    """A mass on a spring along a rail, with a force."""
    mech = bd.Mechanism()
    push = mech.input("push", default=0.0, unit="N")
    body = mech.add(bd.PointMass("mass", mass, at=(1.0, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), body.point))
    ground, length = mech.ground.at(0.0, 0.0), 1.0 - stretch
    mech.add(bd.Spring("spring", ground, body.point, stiffness, free_length=length))
    mech.add(bd.Force("actuator", body.point, (push, 0.0)))
    mech.observe("mass", body.point)
    return mech
'''
COLUMN = """
import beamdae as bd

@bd.model(t_end=0.002)
def column(force=1.0):
    mech = bd.Mechanism()
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.002)
    beam = mech.add(bd.Beam("strut", bd.Line((0.0, 0.0), (0.0, 1.0)), section, elements=1))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("press", beam.end, (0.0, -force)))
    mech.observe("tip", beam.end)
    return mech
"""
SWING = """
import beamdae as bd

STEEL = bd.Material(E=2.1e11, nu=0.3, rho=7850.0)

@bd.model(t_end=0.1)
def swing(speed=1.0, turns=1, section=bd.Section.rectangle(STEEL, width=0.02, height=0.001)):
    mech = bd.Mechanism()
    bob = mech.add(bd.RigidBody("bob", 1.0, inertia=0.1, angular_velocity=speed))
    mech.observe("bob", bob.at(1.0, 0.0))
    if speed > 5.0:
        raise ValueError("too fast")
    return mech
"""
TRUSS = """
import beamdae as bd


@bd.model(t_end=1.0)
def truss(rise=0.2, load=1.0):
    mech = bd.Mechanism()
    crown = mech.add(bd.PointMass("crown", 1.0, at=(0.0, rise)))
    for name, x in (("left", -1.0), ("right", 1.0)):
        mech.add(bd.Spring(name, mech.ground.at(x, 0.0), crown.point, 1000.0))
    mech.add(bd.Force("press", crown.point, (0.0, -load)))
    mech.observe("crown", crown.point)
    return mech
"""
STRUT = """
import beamdae as bd


@bd.model(t_end=1.0)
def column(height=0.002):
    mech = bd.Mechanism()
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=height)
    beam = mech.add(bd.Beam("strut", bd.Line((0.0, 0.0), (0.0, 1.0)), section))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("press", beam.end, (0.0, -section.EI)))
    return mech
"""
