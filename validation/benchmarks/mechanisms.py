"""Mechanisms of joints, springs, dampers, friction, contact, gears and beams with known motion."""

from __future__ import annotations

import numpy as np

import beamdae as bd

GRAVITY = 9.81
STRIP = bd.Section.rectangle(bd.Material(E=2e11, nu=0.3, rho=7800.0), width=0.02, height=0.01)
# Relative to critical damping: under-, critically and overdamped.
DAMPING_RATIOS = (0.2, 1.0, 2.5)


@bd.model(t_end=2.0)
def damped_masses(mass=2.5, stiffness=90.0, start=0.3):
    """Three masses, each on the line through its spring and damper, released at rest."""
    mech = bd.Mechanism()
    for k, ratio in enumerate(DAMPING_RATIOS):
        block = mech.add(bd.PointMass(f"mass {k}", mass, at=(start, 0.1 * k)))
        mount, damping = mech.ground.at(-1.0, 0.1 * k), 2.0 * ratio * np.sqrt(mass * stiffness)
        mech.add(bd.Spring(f"strut {k}", mount, block.point, stiffness, damping, free_length=1.0))
    return mech


@bd.model(t_end=0.94)
def rubbing_mass(mass=2.0, stiffness=800.0, coefficient=0.3, start=0.2, regularization=1e-3):
    """A sprung mass with friction on its guide: amplitudes fall by 4 mu m g / k in each cycle."""
    mech = bd.Mechanism(gravity=(0.0, -GRAVITY))
    block = mech.add(bd.RigidBody("block", mass, 0.5, (start, 0.0)))
    center = block.at(start, 0.0)
    guide = mech.add(bd.PointOnLine("guide", mech.ground.at(0.0, 0.0), center))
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), center, stiffness, free_length=1.0))
    mech.add(bd.Friction("friction", guide, coefficient, regularization))
    return mech


@bd.model(t_end=2.0)
def bouncing_ball(height=1.0, stiffness=1e5, restitution=0.7):
    """A soft ball of 1 kg dropped on the floor; contacts last 25 ms."""
    mech = bd.Mechanism(gravity=(0.0, -GRAVITY))
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, height)))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    speed = float(np.sqrt(2.0 * GRAVITY * height))
    mech.add(
        bd.Contact(
            "floor", ball.point, floor, stiffness, restitution=restitution, impact_speed=speed
        )
    )
    return mech


# Planetary gear: a sun, one planet on an arm, and a fixed ring.
SUN = 0.2  # pitch radius [m]
PLANET = 0.1  # pitch radius [m]
ARM = SUN + PLANET  # length [m]
RING = SUN + 2.0 * PLANET  # pitch radius [m]
PLANET_MASS = 0.7  # [kg]
# [kg m^2]
GEAR_INERTIAS = {"arm": 0.05, "sun": 0.02, "planet": 0.003}
# Angular velocities relative to that of the arm.
GEAR_RATIOS = {"arm": 1.0, "sun": 1.0 + RING / SUN, "planet": 1.0 - RING / PLANET}


@bd.model(t_end=4.0)
def planetary_gear(stiffness=1.3, speed=1.5):
    """A planetary gear whose arm, on a torsion spring, starts at `speed` [rad/s]."""
    mech = bd.Mechanism()
    spins = {name: speed * ratio for name, ratio in GEAR_RATIOS.items()}
    wheels = {"arm": (1.0, (0.0, 0.0), (0.0, 0.0)), "sun": (1.0, (0.0, 0.0), (0.0, 0.0))}
    wheels["planet"] = (PLANET_MASS, (ARM, 0.0), (0.0, speed * ARM))
    arm, sun, planet = (
        mech.add(bd.RigidBody(name, mass, GEAR_INERTIAS[name], place, velocity, spins[name]))
        for name, (mass, place, velocity) in wheels.items()
    )
    hub, pin, center = mech.ground.at(0.0, 0.0), (ARM, 0.0), (0.0, 0.0)
    mech.add(bd.Revolute("arm bearing", hub, arm.at(*center)))
    mech.add(bd.Revolute("sun bearing", hub, sun.at(*center)))
    mech.add(bd.Revolute("planet bearing", arm.at(*pin), planet.at(*pin)))
    arm_point, planet_point = arm.at(*center), planet.at(*pin)
    mech.add(bd.Gear("sun mesh", sun.at(*center), planet_point, -SUN / PLANET, carrier=arm_point))
    mech.add(bd.Gear("ring mesh", hub, planet_point, RING / PLANET, carrier=arm_point))
    mech.add(bd.TorsionSpring("spring", hub, arm_point, stiffness))
    return mech


@bd.model(t_end=0.9)
def slider_on_rod(rate=2.0, distance=0.3, offset=0.0):
    """A slider on a rod that a motor turns at a constant rate; it starts at rest on the rod."""
    mech = bd.Mechanism()
    rod = mech.add(bd.RigidBody("rod", 1.0, 1.0, angular_velocity=rate))
    velocity = (-rate * offset, rate * distance)
    slider = mech.add(bd.RigidBody("slider", 0.4, 0.01, (distance, offset), velocity, rate))
    center = (mech.ground.at(0.0, 0.0), rod.at(0.0, 0.0))
    mech.add(bd.Revolute("pivot", *center))
    motor = mech.add(bd.Driver("motor", *center, law=lambda t: rate * t))
    guide = mech.add(bd.Prismatic("guide", center[1], slider.at(distance, offset)))
    mech.observe("guide", guide.reaction)
    mech.observe("motor", motor.drive)
    return mech


@bd.model(t_end=4.0)
def disk_in_ring(ring=1.25, radius=0.25, mass=1.3, inertia=0.4, angle=0.8):
    """A disk that rolls in a ring without slip (nonholonomic); starts at rest at `angle` [rad]."""
    mech = bd.Mechanism(gravity=(0.0, -GRAVITY))
    center = (ring - radius) * np.array([np.sin(angle), -np.cos(angle)])
    disk = mech.add(bd.RigidBody("disk", mass, inertia, tuple(center.tolist())))
    mech.add(bd.RollingOnCircle("r", mech.ground.at(0, 0), disk.at(*center), (ring, radius)))
    return mech


@bd.model(t_end=4.0 / 3.0)
def moving_load(length=4.0, load=5.0, speed=3.0, elements=8):
    """A force that moves over a simply supported beam."""
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (length, 0.0)), STRIP, elements=elements))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.PointOnLine("roller", mech.ground.at(length, 0.0), beam.end, (1.0, 0.0)))
    backward = speed < 0.0
    mech.add(bd.MovingForce("load", beam, (0.0, -load), speed, length if backward else 0.0))
    mech.observe("middle", beam.at(0.5 * length))
    return mech


@bd.model(t_end=4.0)
def follower_cantilever(ratio=1.5, length=1.0, rise=3.0, damping=20.0):
    """Cantilever under a follower force `ratio` EI / L^2 at its tip, applied over `rise` [s]."""
    load = ratio * STRIP.EI / length**2
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (length, 0.0))
    beams = bd.welded_beams(mech, "beam", line, STRIP, bodies=4, elements=2)
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beams[0].start))
    ramp = bd.piecewise((rise, lambda t: load * (0.5 - 0.5 * np.cos(np.pi * t / rise))), load)
    mech.add(bd.Force("follower", beams[-1].end, (0.0, ramp), axes="body"))
    for beam in beams:
        mech.add(bd.RayleighDamping(f"{beam.name} air", beam, mass=damping))
    mech.observe("tip", beams[-1].end)
    return mech
