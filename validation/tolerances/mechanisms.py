"""Small parametric mechanisms of the tolerance study, in addition to those in models/."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

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


# Systems of particles and rigid bodies that were not used to choose default settings.

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
