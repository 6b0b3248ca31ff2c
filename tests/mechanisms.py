"""Mechanisms that many tests share.

Each builder observes what a user of it would plot. Arguments are the numbers that tests vary; what
else a test needs it adds to the mechanism, whose parts `mech.part(name)` returns.
"""

from itertools import pairwise

import casadi as ca
import numpy as np

import beamdae as bd

G = 9.81
EARTH = (0.0, -G)  # gravity


def symbols(n=1):
    """Time, coordinates and velocities of a constrained system."""
    return ca.SX.sym("t"), ca.SX.sym("q", n), ca.SX.sym("v", n)


STEEL = bd.Material(E=2.1e11, nu=0.3, rho=7850.0)
ALLOY = bd.Material(E=70e9, nu=0.3, rho=2700.0)


def rectangle(height=0.002, width=0.02, damping=0.0, material=STEEL):
    """A section of steel, by default."""
    return bd.Section.rectangle(material, width=width, height=height, damping=damping)


STRIP, DAMPED_STRIP = rectangle(0.002, 0.03), rectangle(0.002, 0.03, damping=1e-3)


def clamped_beam(section, elements=None, curve=1.0, **settings):
    """A mechanism and its beam, clamped at its start.

    A number in place of a curve is the length of a straight beam along x, and a point its end.
    """
    return _beam_on("clamp", bd.Weld, section, elements, curve, **settings)


def hinged_beam(section, elements=None, curve=1.0, **settings):
    """A mechanism and its beam on a hinge at its start."""
    return _beam_on("hinge", bd.Revolute, section, elements, curve, **settings)


def _beam_on(
    name_of_joint,
    joint,
    section,
    elements,
    curve,
    name="beam",
    gravity=0.0,
    start="as drawn",
    **settings,
):
    mech = bd.Mechanism(gravity=(0.0, -gravity), start=start)
    if isinstance(curve, (int, float)):
        curve = (curve, 0.0)
    if isinstance(curve, tuple):
        curve = bd.Line((0.0, 0.0), curve)
    beam = mech.add(bd.Beam(name, curve, section, elements, **settings))
    mech.add(joint(name_of_joint, mech.ground.at(*beam.start.point), beam.start))
    return mech, beam


def hinged(body, gravity=0.0, **settings):
    """A mechanism and its body, on a hinge at the origin."""
    mech = bd.Mechanism(gravity=(0.0, -gravity), **settings)
    mech.add(body)
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), body.at(0.0, 0.0)))
    return mech, body


def hinged_body(
    mass=1.0, inertia=0.1, center=(0.0, 0.0), name="body", gravity=0.0, start="as drawn", **velocity
):
    """A mechanism and its rigid body, on a hinge at the origin."""
    body = bd.RigidBody(name, mass, inertia, center, **velocity)
    return hinged(body, gravity, start=start)


def driven(body, law, gravity=0.0, **settings):
    """A mechanism and its body, which the driver "motor" turns about a hinge at the origin."""
    mech, body = hinged(body, gravity, **settings)
    mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), body.at(0.0, 0.0), law))
    return mech, body


def free_ball(
    at=(0.0, 0.0), mass=1.0, name="ball", gravity=0.0, start="as drawn", spring=(), **velocity
):
    """A mechanism and its point mass, whose motion is observed.

    The stiffness and damping of a spring to the origin are optional.
    """
    mech, ball = _point_mass(at, mass, name, gravity, start, spring, velocity)
    mech.observe(name, ball.point)
    return mech, ball


def mass_on_rail(
    mass=1.0, x=0.0, name="mass", gravity=0.0, start="as drawn", spring=(), **velocity
):
    """A mechanism and its point mass on a rail along the x-axis, see `free_ball`."""
    mech, body = _point_mass((x, 0.0), mass, name, gravity, start, spring, velocity)
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), body.point, (1.0, 0.0)))
    return mech, body


def _point_mass(at, mass, name, gravity, start, spring, velocity):
    mech = bd.Mechanism(gravity=(0.0, -gravity), start=start)
    body = mech.add(bd.PointMass(name, mass, at=at, **velocity))
    if spring:
        mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), body.point, *spring))
    return mech, body


def falling_ball(height=2.0, gravity=G, **ball):
    """A ball of 1 kg above the origin."""
    return free_ball((0.0, height), gravity=gravity, **ball)[0]


@bd.model(t_end=0.6)
def dropped_ball(stiffness=1e10):
    """A ball of 1 kg that falls by 1 m onto a stop."""
    mech = bd.Mechanism(gravity=EARTH)
    body = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 1.0)))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    mech.observe("stop", mech.add(bd.Contact("stop", body.point, floor, stiffness)).force)
    return mech


def peak_of_dropped_ball(stiffness):
    """Return the force at which the energy of a Hertzian contact is that of the fall."""
    return stiffness * (1.25 * 2.0 * 9.81 / stiffness) ** 0.6


def bouncing_ball(restitution=0.8, height=0.3):
    """A ball that impacts on the ground at y = 0."""
    mech = falling_ball(height)
    gap = bd.LineSurface(mech.ground.at(0.0, 0.0)).gap(mech.part("ball").point)
    mech.observe("gap", gap)
    mech.when("gap", 0.0, "down", bd.impact(gap, restitution), "bounce")
    return mech


def oscillator(stiffness=30.0, damping=0.5, mass=1.0, speed=0.2, load=0.0):
    """A mass at x = 1 m on a rail, with a spring and damper to the origin."""
    mech, body = mass_on_rail(mass, 1.0, velocity=(speed, 0.0), spring=(stiffness, damping))
    mech.add(bd.Force("load", body.point, (load, 0.0)))
    mech.observe("mass", body.point)
    return mech


def rope_swing(length=0.5, mass=2.0):
    """A mass on a rope, released at the height of its hook."""
    mech, bob = free_ball((length, 0.0), mass, "bob", G)
    mech.add(bd.Distance("rope", mech.ground.at(0.0, 0.0), bob.point))
    return mech


def swing(mass=2.0, torque=0.0):
    """A rigid body on a hinge, 1 m beside its center and 2 m beside its end, released at rest."""
    mech, bob = hinged_body(mass, 0.1, (1.0, 0.0), "bob", G)
    mech.add(bd.Moment("torque", on=bob.at(1.0, 0.0), law=torque))
    mech.observe("end", bob.at(2.0, 0.0))
    mech.observe("hinge", mech.part("hinge").reaction)
    return mech


def double_pendulum(angle=np.pi / 2.0, **lower):
    """Two rods of 1 kg in a line, released at an angle from the vertical."""
    mech = bd.Mechanism(gravity=EARTH)
    joint, last = np.zeros(2), mech.ground.at(0.0, 0.0)
    for name, settings in (("upper", {}), ("lower", lower)):
        end = joint + 0.5 * np.array([np.sin(angle), -np.cos(angle)])
        rod = mech.add(bd.RigidBody.rod(name, tuple(joint), tuple(end), mass=1.0, **settings))
        hinge = mech.add(bd.Revolute(f"{name} hinge", last, rod.at(*joint)))
        mech.observe(f"{name} hinge", hinge.reaction)
        last, joint = rod.at(*end), end
        mech.observe(name, last)
    return mech


def truss(rise=0.2, stiffness=1000.0, load=1.0, span=1.0, damping=0.0):
    """The von Mises truss: two springs from the sides to a crown, which a force presses."""
    mech = bd.Mechanism()
    crown = mech.add(bd.PointMass("crown", 1.0, at=(0.0, rise)))
    for name, x in (("left", -span), ("right", span)):
        foot = mech.ground.at(x, 0.0)
        mech.add(bd.Spring(name, foot, crown.point, stiffness, damping))
    mech.add(bd.Force("press", crown.point, (0.0, -load)))
    mech.observe("crown", crown.point)
    return mech


def cantilever(elements=4, curve=1.0, section=STRIP, load=(0.0, 0.0), **settings):
    """A clamped beam, by default a straight strip of 1 m, with a force at its end."""
    mech, beam = clamped_beam(section, elements, curve, **settings)
    mech.add(bd.Force("load", beam.end, load))
    mech.observe("tip", beam.end)
    mech.observe("clamp", mech.part("clamp").reaction)
    return mech


def beam_pendulum(elements=2, curve=1.0, section=DAMPED_STRIP, gravity=G, **settings):
    """A beam on a hinge, by default a straight strip of 1 m, released at rest."""
    mech, beam = hinged_beam(section, elements, curve, gravity=gravity, **settings)
    mech.observe("tip", beam.end)
    mech.observe("hinge", mech.part("hinge").reaction)
    return mech


def driven_blade(speed=10.0, elements=2, section=None, **settings):
    """A blade of 0.5 m on a hub, which a driver turns at constant speed."""
    disk = bd.RigidBody.disk("hub", (0.0, 0.0), 0.1, mass=5.0)
    mech, disk = driven(disk, lambda t: speed * t)
    line = bd.Line((0.1, 0.0), (0.6, 0.0))
    section = section or rectangle(0.005, 0.03, damping=1e-4)
    blade = mech.add(bd.Beam("blade", line, section, elements, **settings))
    clamp = mech.add(bd.Weld("clamp", disk.at(0.1, 0.0), blade.start))
    mech.observe("tip", blade.end)
    mech.observe("clamp", clamp.reaction)
    return mech


def welded_frame(points, sections, elements, feet=(bd.Weld, bd.Weld), **options):
    """A mechanism and its straight beams from point to point, with joints to the ground.

    One section is that of all beams. A foot that is None leaves an end free.
    """
    mech = bd.Mechanism()
    ends = list(pairwise(points))
    sections = [sections] * len(ends) if isinstance(sections, bd.Section) else sections
    beams = [
        mech.add(bd.Beam(f"beam {k}", bd.Line(*pair), section, elements, **options))
        for k, (pair, section) in enumerate(zip(ends, sections, strict=True))
    ]
    for k, (one, other) in enumerate(pairwise(beams)):
        mech.add(bd.Weld(f"corner {k}", one.end, other.start))
    for k, (foot, end) in enumerate(zip(feet, (beams[0].start, beams[-1].end), strict=True)):
        if foot:
            mech.add(foot(f"foot {k}", mech.ground.at(*end.point), end))
    return mech, beams


def portal_points(width=1.0, height=1.0):
    """Feet and corners of a portal frame."""
    return [(0.0, 0.0), (0.0, height), (width, height), (width, 0.0)]


def hinged_arch(curve, section, elements=8, load=None, at=0.5, **options):
    """An arch on two hinges, pressed by a force of EI / m^2, by default, at a share of its length.

    Its crown is observed.
    """
    mech = bd.Mechanism()
    arch = mech.add(bd.Beam("arch", curve, section, elements, **options))
    for name, end in (("left", arch.start), ("right", arch.end)):
        mech.add(bd.Revolute(name, mech.ground.at(*end.point), end))
    press = section.EI if load is None else load
    mech.add(bd.Force("press", arch.at(at * arch.length), (0.0, -press)))
    mech.observe("crown", arch.at(0.5 * arch.length))
    return mech


def lee_frame(elements, axes="inertial", **options):
    """The frame of Lee, Manuel & Rossow, J. Eng. Mech. Div. 94 (1968) 521.

    The force acts at a fifth of the beam.
    """
    section = rectangle(2.0, 3.0, material=bd.Material(E=7.2e6, nu=0.3, rho=1.0))
    points = [(0.0, 0.0), (0.0, 120.0), (120.0, 120.0)]
    mech, (_, beam) = welded_frame(points, section, elements, (bd.Revolute,) * 2, **options)
    mech.add(bd.Force("press", beam.at(24.0), (0.0, -1000.0), axes=axes))
    mech.observe("ld", beam.at(24.0))
    return mech


def ziegler(stiffness=1.0, length=1.0, mass=1.0, damping=0.0):
    """Ziegler's double pendulum with the masses 2 m and m under a follower force of 1 N."""
    mech = bd.Mechanism()
    foot = mech.ground.at(0.0, 0.0)
    # Point masses: the moments of inertia are negligible.
    lower = mech.add(bd.RigidBody("lower", 2.0 * mass, 1e-9, (0.0, length)))
    upper = mech.add(bd.RigidBody("upper", mass, 1e-9, (0.0, 2.0 * length)))
    knee = lower.at(0.0, length), upper.at(0.0, length)
    for name, pair in (("foot", (foot, lower.at(0.0, 0.0))), ("knee", knee)):
        mech.add(bd.Revolute(name, *pair))
        mech.add(bd.TorsionSpring(f"{name} spring", *pair, stiffness, damping=damping))
    mech.add(bd.Force("follower", upper.at(0.0, 2.0 * length), (0.0, -1.0), axes="body"))
    return mech


def rotor_on_a_bearing():
    """In the rotating frame, the whirl frequency splits into 10 - speed and 10 + speed [rad/s]."""
    mech = bd.Mechanism()
    rotor = mech.add(bd.RigidBody("rotor", 2.0, 0.1, center=(0.0, 0.0)))
    ends = mech.ground.at(0.0, 0.0), rotor.at(0.0, 0.0)
    mech.add(bd.Bushing("bearing", *ends, kx=200.0, ky=200.0, ktheta=0.0))
    return mech


def crank_and_ram(section, elements, mass=0.5, formulation="floating frame", **turning):
    """A crank, an elastic rod and a ram of 2 kg in a guide: the mechanism, the crank, the rod."""
    mech, crank = hinged(bd.RigidBody.rod("crank", (0.0, 0.0), (0.02, 0.02), mass=mass, **turning))
    ram = mech.add(bd.PointMass("ram", 2.0, at=(0.3, 0.0)))
    line = bd.Line((0.02, 0.02), (0.3, 0.0))
    rod = mech.add(bd.Beam("rod", line, section, elements, formulation=formulation))
    mech.add(bd.Revolute("pin", crank.at(0.02, 0.02), rod.start))
    mech.add(bd.Revolute("ram pin", rod.end, ram.point))
    mech.add(bd.PointOnLine("guide", mech.ground.at(0.3, 0.0), ram.point, direction=(1.0, 0.0)))
    mech.observe("ram", ram.point)
    return mech, crank, rod


def driven_slide(force=1e4, speed=0.01, law=None, scale=1.0, filter_time=None):
    """A driven slide of 60 kg; the force changes at reversals within `speed` of the slide [m/s]."""
    mech = bd.Mechanism()
    slide = mech.add(bd.PointMass("slide", 60.0, at=(0.0, 0.0)))
    base = mech.ground.at(0.0, 0.0)
    mech.add(bd.PointOnLine("guide", base, slide.point, direction=(0.0, 1.0)))
    law = law or (lambda t: 0.06 * (ca.cos(4.0 * np.pi * t) - 1.0))
    drive = mech.add(bd.TranslationalDriver("drive", base, slide.point, law, direction=(0.0, 1.0)))

    def push(point, t):
        return 0.0, scale * force * (1.0 - np.tanh(point.velocity[1] / speed))

    mech.add(bd.ForceLaw("push", slide.point, push))
    mech.observe("drive", drive.reaction)
    if filter_time:
        y = mech.sensor("y", slide.point, "y")
        mech.state("filter", lambda x, t: (y - x) / filter_time, unit="m")
    return mech


def reaction_of_driven_slide(t, force=1e4, speed=0.01):
    """Return the reaction of the driver of `driven_slide` [N]."""
    rate = 4.0 * np.pi
    velocity = -0.06 * rate * np.sin(rate * t)
    inertia = -60.0 * 0.06 * rate**2 * np.cos(rate * t)
    return inertia - force * (1.0 - np.tanh(velocity / speed))


def balance_wheel(thickness=3e-5, **settings):
    """A balance wheel of a watch, on a spiral spring of five turns."""
    turns, inner, outer = 5, 0.5e-3, 3e-3
    angle = np.linspace(0.0, 2 * np.pi * turns, 1001)
    radius = inner + (outer - inner) * angle / angle[-1]
    spiral = bd.Curve(points=np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]))
    mech = bd.Mechanism(**settings)
    spring = mech.add(bd.Beam("spring", spiral, rectangle(thickness, 1.5e-4)))
    wheel = mech.add(bd.RigidBody("wheel", mass=1e-4, inertia=2e-9))
    mech.add(bd.Revolute("pivot", mech.ground.at(0.0, 0.0), wheel.at(0.0, 0.0)))
    mech.add(bd.Weld("collet", wheel.at(inner, 0.0), spring.start))
    mech.add(bd.Weld("stud", mech.ground.at(outer, 0.0), spring.end))
    mech.observe("wheel", wheel.at(0.0, 0.0))
    return mech
