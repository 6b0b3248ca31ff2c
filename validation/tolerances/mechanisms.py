"""Small parametric mechanisms of the tolerance study, in addition to those in models/."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

import beamdae as bd

STEEL = bd.Material(E=2.1e11, nu=0.3, rho=7850.0)
ALLOY = bd.Material(E=68.952e9, nu=0.3, rho=2766.7)
GRAVITY = (0.0, -9.81)  # [m/s^2]
# Frame and strain of the paper, used for the stored references.
PAPER = {"frame": "tangent", "strain": "nonlinear"}


def add_bar(mech: bd.Mechanism, name: str, start, end, mass_per_length, spin=None) -> bd.RigidBody:
    """Add a uniform rigid bar that rotates about `start` at `spin` [rad/s]; None follows others."""
    along = np.subtract(end, start)
    length = float(np.hypot(*along))
    mass = mass_per_length * length
    center = tuple(np.add(start, 0.5 * along))
    velocity = None if spin is None else (-0.5 * spin * along[1], 0.5 * spin * along[0])
    return mech.add(bd.RigidBody(name, mass, mass * length**2 / 12.0, center, velocity, spin))


def triangle_apex(a, b, distance_a: float, distance_b: float) -> tuple[float, float]:
    """Return the point at the given distances from `a` and `b`, to the left of the line a-b."""
    base = np.subtract(b, a)
    distance = float(np.hypot(*base))
    along = (distance_a**2 - distance_b**2 + distance**2) / (2.0 * distance)
    across = np.sqrt(distance_a**2 - along**2)
    unit = base / distance
    x, y = np.add(a, along * unit + across * np.array([-unit[1], unit[0]]))
    return float(x), float(y)


def attract(
    mech: bd.Mechanism, name: str, point, strength: float, pole=(0.0, 0.0), softening=0.0
) -> None:
    """Attract a point to a pole by `strength` [N m^2] over the square of their distance."""

    def pull(at, t):
        away = np.array(pole) - at.position
        return strength * away / (away @ away + softening) ** 1.5

    def potential(at):
        away = np.array(pole) - at.position
        return -strength / np.sqrt(away @ away + softening)

    mech.add(bd.ForceLaw(name, (point,), pull, energy=potential))


@bd.model(t_end=1.5)
def four_bar(damping=0.0, height=0.004, speed=2.0 * np.pi, elements=6):
    """Crank-rocker with a flexible parabolic coupler; the crank speeds up within 0.5 s."""
    mech = bd.Mechanism(gravity=GRAVITY)
    shaft, bearing, pin = (0.0, 0.0), (0.5, 0.0), (0.2, 0.0)
    knee = triangle_apex(pin, bearing, 0.6, 0.4)
    angle = float(np.arctan2(knee[1] - pin[1], knee[0] - pin[0]))
    strip = bd.Section.rectangle(ALLOY, width=0.02, height=height, damping=damping)

    crank = add_bar(mech, "crank", shaft, pin, 1.0)
    rocker = add_bar(mech, "rocker", bearing, knee, 1.0)
    axis = bd.Parabola(span=0.6, rise=0.08, start=pin, angle=angle)
    coupler = mech.add(bd.Beam("coupler", axis, strip, elements=elements, **PAPER))
    ground = mech.ground.at(*shaft)
    mech.add(bd.Revolute("shaft", ground, crank.at(*shaft)))
    mech.add(bd.Driver("motor", ground, crank.at(*shaft), law=bd.run_up(speed, 0.5)))
    mech.add(bd.Revolute("crank pin", crank.at(*pin), coupler.start))
    mech.add(bd.Revolute("knee", coupler.end, rocker.at(*knee)))
    mech.add(bd.Revolute("bearing", mech.ground.at(*bearing), rocker.at(*bearing)))

    mech.observe("middle", coupler.at(0.5 * coupler.length))
    mech.observe("rocker", rocker.at(*bearing))
    return mech


@bd.model(t_end=1.0)
def double_strip_pendulum(
    upper_damping=0.0,
    lower_damping=0.0,
    upper_height=0.004,
    lower_height=0.004,
    width=0.03,
    elements=4,
):
    """Two curved strips of 0.4 m hinged to each other and to the ground, released at rest."""
    mech = bd.Mechanism(gravity=GRAVITY)
    heights, dampings = (upper_height, lower_height), (upper_damping, lower_damping)
    support, angle = mech.ground.at(0.0, 0.0), -0.4
    for name, height, damping in zip(("upper", "lower"), heights, dampings, strict=True):
        strip = bd.Section.rectangle(ALLOY, width=width, height=height, damping=damping)
        arc = bd.Arc(radius=0.6, length=0.4, start=support.point, angle=angle)
        beam = mech.add(bd.Beam(name, arc, strip, elements=elements, **PAPER))
        mech.add(bd.Revolute(f"{name} hinge", support, beam.start))
        mech.observe(f"{name} end", beam.end)
        support, angle = beam.end, -0.9
    return mech


@bd.model(t_end=1.0)
def strip_pendulum(height=0.001, damping=0.0, tip_mass=0.0, elements=4):
    """Curved strip of 0.3 m, pinned at its start, released at rest 0.6 rad below the horizontal."""
    mech = bd.Mechanism(gravity=GRAVITY)
    strip = bd.Section.rectangle(ALLOY, width=0.03, height=height, damping=damping)
    arc = bd.Arc(radius=0.4, length=0.3, start=(0.0, 0.0), angle=-0.6)
    beam = mech.add(bd.Beam("strip", arc, strip, elements=elements, **PAPER))
    if tip_mass:
        mech.add(bd.PointMass("tip mass", tip_mass, on=beam.end))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
    mech.observe("tip", beam.end)
    mech.observe("frame", beam.floating_frame)
    return mech


@bd.model(t_end=0.5)
def cantilever(
    force=0.1,
    start=0.0,
    width=0.02,
    height=0.01,
    damping=0.0,
    tip_mass=0.0,
    alloy=False,
    elements=4,
):
    """Clamped straight beam of 1 m with a transverse tip `force` [N] from the time `start` [s]."""
    mech = bd.Mechanism()
    material = ALLOY if alloy else STEEL
    section = bd.Section.rectangle(material, width=width, height=height, damping=damping)
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    beam = mech.add(bd.Beam("beam", line, section, elements=elements, **PAPER))
    root = mech.add(bd.Weld("root", mech.ground.at(0.0, 0.0), beam.start))
    law = bd.piecewise((start, 0.0), force) if start else force
    mech.add(bd.Force("load", on=beam.end, law=(0.0, law)))
    if tip_mass:
        mech.add(bd.PointMass("tip mass", tip_mass, on=beam.end))
    mech.observe("tip", beam.end)
    mech.observe("middle", beam.at(0.5))
    mech.observe("root", root.reaction)
    return mech


@bd.model(t_end=2.0)
def parallelogram(rocker=0.205, coupler=0.5, spin=0.6596528037474529, crank_angle=0.5 * np.pi):
    """Rigid crank-rocker with nearly equal sides under gravity, whose crank turns at `spin`.

    The crank of 0.2 m rotates fully because 0.2 + 0.5 < `rocker` + `coupler`. Twice per revolution
    all bars are nearly collinear, close to a change point.
    """
    mech = bd.Mechanism(gravity=GRAVITY)
    shaft, bearing = (0.0, 0.0), (0.5, 0.0)
    pin = (0.2 * float(np.cos(crank_angle)), 0.2 * float(np.sin(crank_angle)))
    knee = triangle_apex(pin, bearing, coupler, rocker)
    bars = (
        ("crank", shaft, pin, spin),
        ("coupler", pin, knee, None),
        ("rocker", bearing, knee, None),
    )
    crank, link, follower = (add_bar(mech, n, a, b, 1.0, omega) for n, a, b, omega in bars)
    mech.add(bd.Revolute("shaft", mech.ground.at(*shaft), crank.at(*shaft)))
    mech.add(bd.Revolute("pin", crank.at(*pin), link.at(*pin)))
    mech.add(bd.Revolute("knee", link.at(*knee), follower.at(*knee)))
    mech.add(bd.Revolute("bearing", mech.ground.at(*bearing), follower.at(*bearing)))
    mech.observe("crank", crank.at(*shaft))
    mech.observe("coupler", link.at(*pin))
    mech.observe("rocker", follower.at(*bearing))
    return mech


@bd.model(t_end=2.0)
def double_four_bar(speed=3.0):
    """Two upright parallelograms side by side; their tops start to the right at `speed` [m/s].

    Five bars of 1 m and 1 kg. Twice per revolution all of them are collinear: the constraints are
    dependent there and another branch of the motion begins. After M. Gonzalez, D. Dopico,
    U. Lugris, J. Cuadrado, A benchmarking system for MBS simulation software, Multibody Syst. Dyn.
    16 (2006) 179, doi:10.1007/s11044-006-9020-8 (IFToMM benchmark A02).
    """
    mech = bd.Mechanism(gravity=GRAVITY)
    uprights = []
    for k in range(3):
        foot, top = (float(k), 0.0), (float(k), 1.0)
        upright = add_bar(mech, f"upright {k}", foot, top, 1.0, -speed)
        mech.add(bd.Revolute(f"foot {k}", mech.ground.at(*foot), upright.at(*foot)))
        uprights.append(upright)
    for k in range(2):
        left, right = (float(k), 1.0), (k + 1.0, 1.0)
        mass = 1.0
        bar = mech.add(
            bd.RigidBody(f"bar {k}", mass, mass / 12.0, (k + 0.5, 1.0), velocity=(speed, 0.0))
        )
        mech.add(bd.Revolute(f"left of {k}", uprights[k].at(*left), bar.at(*left)))
        mech.add(bd.Revolute(f"right of {k}", bar.at(*right), uprights[k + 1].at(*right)))
    mech.observe("top", uprights[0].at(0.0, 1.0))
    mech.observe("bar", bar.at(1.0, 1.0))
    return mech


def double_four_bar_motion(t: np.ndarray) -> np.ndarray:
    """Return (x, y) of the left top and x of the middle one, integrated in one angle.

    All uprights have the same angle from the vertical, 3 theta'' = 3.5 g sin(theta).
    """
    motion = solve_ivp(
        lambda _, y: [y[1], 3.5 / 3.0 * -GRAVITY[1] * np.sin(y[0])],
        (0.0, t[-1]),
        [0.0, 3.0],
        method="DOP853",
        t_eval=t,
        rtol=1e-13,
        atol=1e-13,
    )
    x, y = np.sin(motion.y[0]), np.cos(motion.y[0])
    return np.stack([x, y, 1.0 + x], axis=-1)
