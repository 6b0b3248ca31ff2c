"""Systems of particles and rigid bodies that were not used to choose default settings."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq
from tolerances.mechanisms import GRAVITY, attract

import beamdae as bd

ECCENTRICITY = 0.9
KEPLER_PERIOD = 2.0 * np.pi  # [s], semi-major axis 1 m, gravitational parameter 1 m^3/s^2


@bd.model(t_end=3.0 * KEPLER_PERIOD)
def kepler(eccentricity=ECCENTRICITY):
    """Particle of 1 kg on an ellipse of semi-major axis 1 m about the origin."""
    mech = bd.Mechanism()
    far = 1.0 + eccentricity
    speed = np.sqrt((1.0 - eccentricity) / far)
    planet = mech.add(bd.PointMass("planet", 1.0, at=(-far, 0.0), velocity=(0.0, -speed)))
    attract(mech, "sun", planet.point, 1.0)
    mech.observe("planet", planet.point)
    return mech


def kepler_motion(t: np.ndarray) -> np.ndarray:
    """Return x and y of the particle, which starts farthest from the origin."""
    mean = np.pi + t
    anomaly = np.array(
        [brentq(lambda u, m=m: u - ECCENTRICITY * np.sin(u) - m, m - 1.0, m + 1.0) for m in mean]
    )
    ratio = np.sqrt(1.0 - ECCENTRICITY**2)
    return np.stack([np.cos(anomaly) - ECCENTRICITY, ratio * np.sin(anomaly)], axis=-1)


@bd.model(t_end=10.0)
def spring_pendulum(stiffness=40.0):
    """Mass of 1 kg on a spring of 1 m, released from the horizontal."""
    mech = bd.Mechanism(gravity=GRAVITY)
    ball = mech.add(bd.PointMass("ball", 1.0, at=(1.0, 0.0)))
    spring = mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), ball.point, stiffness))
    mech.observe("ball", ball.point)
    mech.observe("spring", spring.force)
    return mech


@bd.model(t_end=5.0)
def kapitza(frequency=30.0, amplitude=0.03, damping=0.002):
    """Inverted pendulum of 0.3 m that the vibration of its pivot keeps upright."""
    mech = bd.Mechanism(gravity=GRAVITY)
    slider = mech.add(bd.PointMass("slider", 0.1, at=(0.0, 0.0)))
    top = (0.3 * np.sin(0.3), 0.3 * np.cos(0.3))
    rod = mech.add(bd.RigidBody.rod("rod", (0.0, 0.0), top, mass=0.2))
    ground = mech.ground.at(0.0, 0.0)
    mech.add(bd.PointOnLine("guide", ground, slider.point, direction=(0.0, 1.0)))
    law = bd.sine(amplitude, frequency)
    drive = bd.TranslationalDriver("shaker", ground, slider.point, law, direction=(0.0, 1.0))
    mech.add(drive)
    mech.add(bd.Revolute("pivot", slider.point, rod.at(0.0, 0.0)))
    mech.add(bd.TorsionSpring("bearing", ground, rod.at(0.0, 0.0), damping=damping))
    mech.observe("rod", rod.at(*top))
    mech.observe("shaker", drive.drive)
    return mech


@bd.model(t_end=4.0)
def stick_slip(speed=0.1, coefficient=0.3, static=0.5):
    """Block of 1 kg on a spring, dragged by a belt; Stribeck friction makes it stick and slip."""
    mech = bd.Mechanism(gravity=GRAVITY)
    belt = mech.add(bd.RigidBody.plate("belt", (0.0, -0.05), width=2.0, height=0.1, mass=5.0))
    block = mech.add(bd.RigidBody.plate("block", (0.0, 0.05), width=0.1, height=0.1, mass=1.0))
    ground, foot = mech.ground, (0.0, 0.0)
    mech.add(bd.Prismatic("rollers", ground.at(*foot), belt.at(*foot)))
    mech.add(
        bd.TranslationalDriver(
            "motor", ground.at(*foot), belt.at(*foot), lambda t: speed * t, direction=(1.0, 0.0)
        )
    )
    contact = mech.add(bd.Prismatic("contact", belt.at(*foot), block.at(*foot)))
    law = {"friction_speed": 1e-3, "static": static, "stribeck": 0.05, "radius": 0.05}
    rubbing = mech.add(bd.Friction("rubbing", contact, coefficient, **law))
    mech.add(bd.Spring("spring", ground.at(-1.0, 0.05), block.at(0.0, 0.05), stiffness=50.0))
    mech.observe("block", block.at(0.0, 0.05))
    mech.observe("rubbing", rubbing.reaction)
    return mech


@bd.model(t_end=3.0)
def magnet_ball(gap=0.05):
    """Ball of 0.1 kg that swings past a magnet; the potential of the magnet is negative."""
    mech = bd.Mechanism(gravity=GRAVITY)
    ball = mech.add(bd.PointMass("ball", 0.1, at=(0.3, -0.4)))
    rod = mech.add(bd.Distance("thread", mech.ground.at(0.0, 0.0), ball.point))
    attract(mech, "magnet", ball.point, 5e-3, (0.1, -0.5 - gap), 1e-4)
    mech.observe("ball", ball.point)
    mech.observe("thread", rod.reaction)
    return mech


@bd.model(t_end=3.0)
def bouncing_ball(restitution=0.9):
    """Ball of 0.1 kg that falls 0.5 m and bounces five times while it drifts to the right."""
    mech = bd.Mechanism(gravity=GRAVITY)
    ball = mech.add(bd.PointMass("ball", 0.1, at=(0.0, 0.5), velocity=(0.3, 0.0)))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    law = {"stiffness": 1e5, "restitution": restitution, "impact_speed": 3.0}
    contact = mech.add(bd.Contact("floor", ball.point, floor, friction=0.2, **law))
    mech.observe("ball", ball.point)
    mech.observe("floor", contact.force)
    return mech


# Start of the figure eight: A. Chenciner, R. Montgomery, Annals of Mathematics 152 (2000) 881.
_EIGHT_POSITION = np.array([0.97000436, -0.24308753])
_EIGHT_VELOCITY = np.array([-0.93240737, -0.86473146])


@bd.model(t_end=12.0)
def figure_eight():
    """Three equal masses that chase each other on a figure eight, two periods of 6.3 s."""
    mech = bd.Mechanism()
    starts = (
        (_EIGHT_POSITION, -0.5 * _EIGHT_VELOCITY),
        (-_EIGHT_POSITION, -0.5 * _EIGHT_VELOCITY),
        (np.zeros(2), _EIGHT_VELOCITY),
    )
    stars = [
        mech.add(bd.PointMass(f"star {k}", 1.0, at=tuple(x.tolist()), velocity=tuple(v.tolist())))
        for k, (x, v) in enumerate(starts)
    ]

    def pull(a, b, t):
        away = b.position - a.position
        force = away / (away @ away) ** 1.5
        return [force, -force]

    def potential(a, b):
        away = b.position - a.position
        return -1.0 / np.sqrt(away @ away)

    for j, k in ((0, 1), (1, 2), (2, 0)):
        pair = (stars[j].point, stars[k].point)
        mech.add(bd.ForceLaw(f"gravity {j} {k}", pair, pull, energy=potential))
    for star in stars[:2]:
        mech.observe(star.name, star.point)
    return mech


@bd.model(t_end=2.0)
def geared_rotors(stiffness=200.0, damping=0.02):
    """Motor and rotor with a gear and an elastic shaft, run up and loaded by a brake."""
    mech = bd.Mechanism()
    ground, left, right = mech.ground, (0.0, 0.0), (0.3, 0.0)
    motor = mech.add(bd.RigidBody.disk("motor", left, radius=0.05, mass=1.0))
    pinion = mech.add(bd.RigidBody.disk("pinion", left, radius=0.1, mass=0.8))
    rotor = mech.add(bd.RigidBody.disk("rotor", right, radius=0.2, mass=5.0))
    for body, center in ((motor, left), (pinion, left), (rotor, right)):
        mech.add(bd.Revolute(f"{body.name} bearing", ground.at(*center), body.at(*center)))
    mech.add(bd.TorsionSpring("shaft", motor.at(*left), pinion.at(*left), stiffness, damping))
    gear = mech.add(bd.Gear("gear", pinion.at(*left), rotor.at(*right), ratio=-0.5))
    mech.add(bd.Moment("torque", motor.at(*left), bd.piecewise((0.5, 4.0), 1.0)))

    def brake(rotor, t):
        return 0.0, 0.0, -2.0 * np.tanh(rotor.rate / 0.5)

    mech.add(bd.ForceLaw("brake", (rotor.at(*right),), brake, dissipative=True))
    for body, center in ((motor, left), (pinion, left), (rotor, right)):
        mech.observe(body.name, body.at(*center))
    mech.observe("twist", bd.relative_displacement(pinion.at(*left), motor.at(*left)))
    mech.observe("gear", gear.reaction)
    return mech


@bd.model(t_end=10.0)
def driven_pendulum(torque=0.6, frequency=0.55, damping=0.05):
    """Damped rod of 1 m and 1 kg, shaken by a moment of 0.55 Hz."""
    mech = bd.Mechanism(gravity=GRAVITY)
    rod = mech.add(bd.RigidBody.rod("rod", (0.0, 0.0), (0.0, -1.0), mass=1.0))
    ground = mech.ground.at(0.0, 0.0)
    joint = mech.add(bd.Revolute("hinge", ground, rod.at(0.0, 0.0)))
    mech.add(bd.TorsionSpring("bearing", ground, rod.at(0.0, 0.0), damping=damping))
    mech.add(bd.Moment("shaker", rod.at(0.0, 0.0), bd.sine(torque, frequency)))
    mech.observe("tip", rod.at(0.0, -1.0))
    mech.observe("hinge", joint.reaction)
    return mech
