"""Mechanisms drawn from seeds, with everything that may be too coarse as a parameter.

Every function takes the number of `elements` per beam and the `formulation` of its beams; those
with friction also take the `friction_speed` [m/s].
"""

import numpy as np

import beamdae as bd

GRAVITY = (0.0, -9.81)
RUBBER = bd.Material(E=5e6, nu=0.48, rho=1100.0)
PLASTIC = bd.Material(E=2.5e9, nu=0.38, rho=1200.0)
STEEL = bd.Material(E=2.06e11, nu=0.3, rho=7850.0)
FLOATING, EXACT = "floating frame", "exact"


def _observe_beam(mech: bd.Mechanism, beam: bd.Beam) -> None:
    """Observe the end of a beam, its deformation, a stress, and the forces at its root."""
    mech.observe("tip", beam.end)
    mech.observe("bend", beam.deformation(0.5 * beam.length))
    mech.observe("stress", beam.stress(0.3 * beam.length, "top"))
    mech.observe("root", beam.section_forces(0.0))


@bd.model(t_end=1.0)
def swing(seed=0, elements=8, formulation=EXACT, soft=False):
    """Curved strip of plastic or, if `soft`, rubber, hinged at one end, that falls from rest."""
    rng = np.random.default_rng([1, seed])
    length, turn = rng.uniform(0.3, 0.9), rng.uniform(-1.2, 1.2)
    height = length * (rng.uniform(0.02, 0.04) if soft else rng.uniform(0.004, 0.01))
    damping = 10.0 ** rng.uniform(-3.0, -2.2) if soft else 10.0 ** rng.uniform(-4.0, -3.0)
    section = bd.Section.rectangle(RUBBER if soft else PLASTIC, 0.03, height, damping=damping)
    mech = bd.Mechanism(gravity=GRAVITY)
    arc = bd.Arc(length / turn, length, (0.0, 0.0), rng.uniform(-0.9, 0.3))
    beam = mech.add(bd.Beam("strip", arc, section, elements, formulation=formulation))
    mech.add(bd.PointMass("bob", rng.uniform(0.2, 1.5) * section.rhoA * length, on=beam.end))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
    _observe_beam(mech, beam)
    return mech


@bd.model(t_end=0.4)
def struck(seed=0, elements=8, formulation=EXACT):
    """Clamped strip of steel that a short pulse strikes between its ends."""
    rng = np.random.default_rng([2, seed])
    length, height = rng.uniform(0.3, 0.8), rng.uniform(0.002, 0.006)
    section = bd.Section.rectangle(STEEL, 0.02, height, damping=10.0 ** rng.uniform(-4.3, -3.3))
    first = 3.516 * np.sqrt(section.EI / section.rhoA) / length**2  # rad/s
    width = rng.uniform(0.1, 0.4) * 2.0 * np.pi / first
    size = rng.uniform(0.05, 0.15) * 3.0 * section.EI / length**2
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (length, 0.0))
    beam = mech.add(bd.Beam("strip", line, section, elements, formulation=formulation))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    pulse = bd.piecewise((width, lambda t: -size * np.sin(np.pi * t / width) ** 2), 0.0)
    mech.add(bd.Force("strike", beam.at(rng.uniform(0.3, 0.9) * length), (0.0, pulse)))
    _observe_beam(mech, beam)
    return mech


@bd.model(t_end=1.0)
def crossed(seed=0, elements=8, formulation=EXACT):
    """Girder on two supports that a bead crosses, driven by a spring."""
    rng = np.random.default_rng([3, seed])
    length, height = rng.uniform(1.0, 2.0), rng.uniform(0.006, 0.012)
    section = bd.Section.rectangle(STEEL, 0.03, height, damping=10.0 ** rng.uniform(-4.0, -3.0))
    mech = bd.Mechanism(gravity=GRAVITY)
    line = bd.Line((0.0, 0.0), (length, 0.0))
    girder = mech.add(bd.Beam("girder", line, section, elements, formulation=formulation))
    mech.add(bd.Revolute("left", mech.ground.at(0.0, 0.0), girder.start))
    mech.add(bd.PointOnLine("right", mech.ground.at(0.0, 0.0), girder.end))
    mass, at = rng.uniform(0.2, 0.6) * section.rhoA * length, (0.05 * length, 0.0)
    bead = mech.add(
        bd.PointMass("bead", mass, at=at, velocity=(rng.uniform(0.5, 0.8) * length, 0.0))
    )
    slide = mech.add(bd.SlidingOnBeam("slide", bead.point, girder))
    mech.observe("bead", bead.point)
    mech.observe("slide", slide.reaction)
    mech.observe("middle", girder.at(0.5 * length))
    mech.observe("stress", girder.stress(0.4 * length, "top"))
    return mech


@bd.model(t_end=1.5)
def linkage(seed=0, elements=8, formulation=EXACT):
    """Four-bar whose crank runs up; coupler and rocker are strips of steel."""
    rng = np.random.default_rng([4, seed])
    crank, coupler, rocker = rng.uniform([0.08, 0.5, 0.4], [0.12, 0.6, 0.5])
    height, speed, duration = rng.uniform([0.0015, 8.0, 0.3], [0.003, 14.0, 0.6])
    damping = 10.0 ** rng.uniform(-4.0, -3.3)
    section = bd.Section.rectangle(STEEL, 0.02, height, damping=damping)
    pin, foot = np.array([0.0, crank]), np.array([0.55, 0.0])
    span = np.hypot(*(foot - pin))
    inclination = np.arctan2(*(foot - pin)[::-1])
    inclination += np.arccos((coupler**2 + span**2 - rocker**2) / (2.0 * coupler * span))
    knee = pin + coupler * np.array([np.cos(inclination), np.sin(inclination)])
    pin, foot, knee = (tuple(x.tolist()) for x in (pin, foot, knee))
    mech = bd.Mechanism(gravity=GRAVITY)
    ground = mech.ground
    wheel = mech.add(bd.RigidBody.rod("crank", (0.0, 0.0), pin, mass=0.5))
    mesh = {"elements": elements, "formulation": formulation}
    rod = mech.add(bd.Beam("coupler", bd.Line(pin, knee), section, **mesh))
    lever = mech.add(bd.Beam("rocker", bd.Line(foot, knee), section, **mesh))
    mech.add(bd.Revolute("shaft", ground.at(0.0, 0.0), wheel.at(0.0, 0.0)))
    mech.add(bd.Revolute("pin", wheel.at(*pin), rod.start))
    joint = mech.add(bd.Revolute("knee", rod.end, lever.end))
    mech.add(bd.Revolute("foot", ground.at(*foot), lever.start))
    law = bd.run_up(speed, duration)
    motor = mech.add(bd.Driver("motor", ground.at(0.0, 0.0), wheel.at(0.0, 0.0), law))
    mech.observe("knee", rod.end)
    mech.observe("bend", rod.deflection(0.5 * rod.length))
    mech.observe("force", joint.reaction)
    mech.observe("motor", motor.drive)
    mech.observe("stress", lever.stress(0.6 * lever.length, "top"))
    return mech


@bd.model(t_end=1.0)
def rotor(seed=0, elements=8, formulation=EXACT, soft=False):
    """Arm of plastic or, if `soft`, rubber, on a shaft that runs up and stays at its speed."""
    rng = np.random.default_rng([5, seed])
    length = rng.uniform(0.3, 0.6)
    height = length * (rng.uniform(0.03, 0.05) if soft else rng.uniform(0.008, 0.015))
    section = bd.Section.rectangle(
        RUBBER if soft else PLASTIC, 0.03, height, damping=10.0 ** rng.uniform(-3.5, -2.5)
    )
    first = 3.516 * np.sqrt(section.EI / section.rhoA) / length**2  # rad/s
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (length, 0.0))
    arm = mech.add(bd.Beam("arm", line, section, elements, formulation=formulation))
    hub = mech.add(bd.RigidBody.disk("hub", (0.0, 0.0), radius=0.05, mass=1.0))
    mech.add(bd.Revolute("bearing", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0)))
    mech.add(bd.Weld("root", hub.at(0.0, 0.0), arm.start))
    law = bd.run_up(rng.uniform(0.8, 1.5) * first, rng.uniform(0.2, 0.5))
    motor = mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0), law))
    _observe_beam(mech, arm)
    mech.observe("motor", motor.drive)
    return mech


@bd.model(t_end=1.0)
def shaken(seed=0, elements=8, formulation=EXACT):
    """Shallow arch or strip on a table that moves at up to 1.3 times its second frequency."""
    rng = np.random.default_rng([6, seed])
    length, height = rng.uniform(0.3, 0.6), rng.uniform(0.001, 0.003)
    section = bd.Section.rectangle(STEEL, 0.02, height, damping=10.0 ** rng.uniform(-4.3, -3.6))
    second = 22.03 * np.sqrt(section.EI / section.rhoA) / length**2  # rad/s
    frequency = rng.uniform(0.5, 1.3) * second / (2.0 * np.pi)
    mech = bd.Mechanism(gravity=GRAVITY)
    table = mech.add(bd.RigidBody.plate("table", (0.0, 0.0), 0.2, 0.1, mass=5.0))
    curve = bd.Line((0.0, 0.0), (length, 0.0))
    if rng.random() < 0.5:
        curve = bd.Parabola(span=length, rise=0.1 * length, start=(0.0, 0.0))
    beam = mech.add(bd.Beam("strip", curve, section, elements, formulation=formulation))
    base = mech.ground.at(0.0, 0.0)
    mech.add(bd.Prismatic("guide", base, table.at(0.0, 0.0), (0.0, 1.0)))
    mech.add(bd.Weld("clamp", table.at(0.0, 0.0), beam.start))
    size = rng.uniform(0.1, 0.3) * height

    def lift(t):
        # Without a jump of the speed at the start.
        rise = 1.0 - np.exp(-((5.0 * t) ** 2))
        return size * rise * np.sin(2.0 * np.pi * frequency * t)

    mech.add(bd.TranslationalDriver("shaker", base, table.at(0.0, 0.0), lift, (0.0, 1.0)))
    _observe_beam(mech, beam)
    return mech


@bd.model(t_end=0.5)
def dropped(seed=0, elements=8, formulation=EXACT):
    """Strip of steel that falls, inclined, on two elastic stops."""
    rng = np.random.default_rng([7, seed])
    length, height = rng.uniform(0.4, 0.8), rng.uniform(0.004, 0.010)
    section = bd.Section.rectangle(STEEL, 0.02, height, damping=10.0 ** rng.uniform(-4.0, -3.3))
    mech = bd.Mechanism(gravity=GRAVITY)
    tilt, clearance = rng.uniform(-0.2, 0.2), rng.uniform(0.05, 0.15)
    half = 0.5 * length * np.array([np.cos(tilt), np.sin(tilt)])
    ends = [tuple((sign * half + (0.0, clearance + abs(half[1]))).tolist()) for sign in (-1, 1)]
    beam = mech.add(bd.Beam("strip", bd.Line(*ends), section, elements, formulation=formulation))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0), direction=(1.0, 0.0))
    stiffness = 10.0 ** rng.uniform(5.5, 7.0)
    for name, end in (("left", beam.start), ("right", beam.end)):
        stop = {"restitution": 0.6, "impact_speed": 1.5}
        contact = mech.add(bd.Contact(name, end, floor, stiffness, **stop))
        mech.observe(f"{name} stop", contact.force)
        mech.observe(name, end)
    mech.observe("bend", beam.deflection(0.5 * length))
    mech.observe("stress", beam.stress(0.5 * length, "top"))
    return mech


@bd.model(t_end=2.0)
def rubbing(seed=0, elements=4, formulation=EXACT, friction_speed=1e-3):
    """Block at the end of a column of steel; it rubs on a rail that moves to and fro."""
    rng = np.random.default_rng([8, seed])
    length, height = rng.uniform(0.3, 0.5), rng.uniform(0.002, 0.004)
    section = bd.Section.rectangle(STEEL, 0.02, height, damping=1e-3)
    mech = bd.Mechanism(gravity=GRAVITY)
    rail = mech.add(bd.RigidBody.plate("rail", (0.0, 0.0), 0.5, 0.05, mass=5.0))
    guide = mech.add(bd.Prismatic("guide", mech.ground.at(0.0, 0.0), rail.at(0.0, 0.0)))
    frequency, stroke = rng.uniform(0.5, 2.0), rng.uniform(0.01, 0.04)

    def shift(t):
        return stroke * (1.0 - np.cos(2.0 * np.pi * frequency * t))

    base = mech.ground.at(0.0, 0.0)
    mech.add(bd.TranslationalDriver("shaker", base, rail.at(0.0, 0.0), shift))
    block = mech.add(
        bd.RigidBody.plate("block", (0.0, 0.05), 0.06, 0.05, mass=rng.uniform(0.5, 2.0))
    )
    slide = mech.add(bd.Prismatic("slide", rail.at(0.0, 0.025), block.at(0.0, 0.05)))
    line = bd.Line((0.0, length + 0.05), (0.0, 0.05))
    column = mech.add(bd.Beam("column", line, section, elements, formulation=formulation))
    mech.add(bd.Revolute("top", mech.ground.at(0.0, length + 0.05), column.start))
    mech.add(bd.PointOnLine("pin", block.at(0.0, 0.05), column.end, direction=(0.0, 1.0)))
    spring = rng.uniform(100.0, 400.0)
    mech.add(bd.Bushing("spring", mech.ground.at(0.0, 0.05), block.at(0.0, 0.05), kx=spring))
    coefficient = rng.uniform(0.2, 0.5)
    friction = bd.Friction("friction", slide, coefficient, friction_speed, radius=0.03)
    friction = mech.add(friction)
    mech.observe("block", block.at(0.0, 0.05))
    mech.observe("friction", friction.reaction)
    mech.observe("guide", guide.reaction)
    return mech


@bd.model(t_end=4.0)
def rods(seed=0):
    """Two hinged rods that swing, with a spring between the last one and the ground."""
    rng = np.random.default_rng([9, seed])
    lengths, angle = rng.uniform(0.3, 0.6, 2), rng.uniform(-1.0, 0.5)
    knee = lengths[0] * np.array([np.cos(angle), np.sin(angle)])
    end = knee + lengths[1] * np.array([np.cos(angle + 0.5), np.sin(angle + 0.5)])
    knee, end = (tuple(x.tolist()) for x in (knee, end))
    mech = bd.Mechanism(gravity=GRAVITY)
    upper = mech.add(bd.RigidBody.rod("upper", (0.0, 0.0), knee, mass=rng.uniform(0.5, 1.0)))
    lower = mech.add(bd.RigidBody.rod("lower", knee, end, mass=rng.uniform(0.3, 1.0)))
    top = mech.add(bd.Revolute("top", mech.ground.at(0.0, 0.0), upper.at(0.0, 0.0)))
    mech.add(bd.Revolute("knee", upper.at(*knee), lower.at(*knee)))
    mech.add(
        bd.TorsionSpring("oil", upper.at(*knee), lower.at(*knee), damping=rng.uniform(0.01, 0.05))
    )
    stiffness = 10.0 ** rng.uniform(1.0, 3.0)
    spring = bd.Spring("spring", mech.ground.at(0.2, -1.2), lower.at(*end), stiffness)
    spring = mech.add(spring)
    mech.observe("end", lower.at(*end))
    mech.observe("top", top.reaction)
    mech.observe("spring", spring.force)
    return mech


@bd.model(t_end=3.0)
def bouncing(seed=0):
    """Ball that rolls off a table's edge and bounces, with friction, on a floor and a wall."""
    rng = np.random.default_rng([10, seed])
    mech = bd.Mechanism(gravity=GRAVITY)
    at, velocity = (0.0, rng.uniform(0.3, 0.8)), (rng.uniform(0.2, 0.8), 0.0)
    ball = mech.add(bd.PointMass("ball", 0.1, at=at, velocity=velocity))
    law = {"restitution": rng.uniform(0.6, 0.9), "impact_speed": 3.0}
    for name, point, direction in (
        ("floor", (0.0, 0.0), (1.0, 0.0)),
        ("wall", (1.5, 0.0), (0.0, 1.0)),
    ):
        surface = bd.LineSurface(mech.ground.at(*point), direction=direction)
        mech.add(bd.Contact(name, ball.point, surface, 10.0 ** rng.uniform(4.0, 5.5), **law))
    mech.observe("ball", ball.point)
    return mech


@bd.model(t_end=2.0)
def servo(seed=0, elements=4, formulation=EXACT):
    """Arm of steel that a controller turns to a set angle and holds there."""
    rng = np.random.default_rng([11, seed])
    length, height = rng.uniform(0.3, 0.6), rng.uniform(0.003, 0.006)
    section = bd.Section.rectangle(STEEL, 0.02, height, damping=3e-4)
    mech = bd.Mechanism()
    hub = mech.add(bd.RigidBody.disk("hub", (0.0, 0.0), radius=0.05, mass=1.0))
    line = bd.Line((0.0, 0.0), (length, 0.0))
    arm = mech.add(bd.Beam("arm", line, section, elements, formulation=formulation))
    mech.add(bd.Revolute("bearing", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0)))
    mech.add(bd.Weld("root", hub.at(0.0, 0.0), arm.start))
    angle = mech.sensor("angle", hub.at(0.0, 0.0), "angle")
    rate = mech.sensor("rate", hub.at(0.0, 0.0), "angle_dot")
    inertia = section.rhoA * length**3 / 3.0 + 0.5 * 0.05**2
    wanted = rng.uniform(8.0, 20.0)  # rad/s
    moment = inertia * (wanted**2 * (rng.uniform(0.5, 1.5) - angle) - 1.2 * wanted * rate)
    motor = mech.add(bd.Moment("motor", hub.at(0.0, 0.0), moment))
    mech.observe("tip", arm.end)
    mech.observe("bend", arm.deflection(length))
    mech.observe("motor", motor.moment)
    mech.observe("root", arm.section_forces(0.0))
    return mech
