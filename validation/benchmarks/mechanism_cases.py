"""Mechanisms of joints, springs, dampers, friction, contact, gears and beams with known motion."""

import numpy as np
from benchmarks.cases import PublishedCase
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipj

import beamdae as bd

GRAVITY = 9.81
STRIP = bd.Section.rectangle(bd.Material(E=2e11, nu=0.3, rho=7800.0), width=0.02, height=0.01)
# Relative to critical damping: under-, critically and overdamped.
DAMPING_RATIOS = (0.2, 1.0, 2.5)

Array = np.ndarray


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


def damped_motion(t: Array) -> dict[str, Array]:
    """Return the motion of m x'' + c x' + k x = 0 from rest, with distinct or double roots."""
    mass, stiffness, start = 2.5, 90.0, 0.3
    w = np.sqrt(stiffness / mass)
    q, v = (np.zeros((len(t), 2 * len(DAMPING_RATIOS))) for _ in range(2))
    for k, ratio in enumerate(DAMPING_RATIOS):
        root = np.sqrt(complex(ratio**2 - 1.0)) * w
        root_1, root_2 = -ratio * w + root, -ratio * w - root
        if ratio == 1.0:
            x, rate = (1.0 + w * t) * np.exp(-w * t), -(w**2) * t * np.exp(-w * t)
        else:
            modes = np.exp(np.outer([root_1, root_2], t)) / (root_2 - root_1)
            x = (root_2 * modes[0] - root_1 * modes[1]).real
            rate = (root_2 * root_1 * (modes[0] - modes[1])).real
        q[:, 2 * k], q[:, 2 * k + 1], v[:, 2 * k] = start * x, 0.1 * k, start * rate
    return {"q": q, "v": v}


def rubbing_motion(t: Array) -> dict[str, Array]:
    """Return half waves about equilibria that friction shifts by d = mu m g / k to and fro."""
    mass, stiffness, coefficient, start = 2.0, 800.0, 0.3, 0.2
    w, shift = np.sqrt(stiffness / mass), coefficient * mass * GRAVITY / stiffness
    half = np.floor(w * t / np.pi + 1e-9)
    amplitude = start - (2.0 * half + 1.0) * shift
    x = (-1.0) ** half * shift + amplitude * np.cos(w * t)
    rate = -w * amplitude * np.sin(w * t)
    zero = np.zeros_like(t)
    return {"q": np.stack([x, zero, zero], axis=-1), "v": np.stack([rate, zero, zero], axis=-1)}


def bouncing_motion(t: Array) -> dict[str, Array]:
    """Return free flight, and contacts m d'' = m g - k d^1.5 (1 + X d') by Runge-Kutta."""
    stiffness, restitution = 1e5, 0.7
    speed = np.sqrt(2.0 * GRAVITY)

    def restitution_equation(x: float) -> float:
        # Gonthier et al. 2004, in terms of X v.
        return x * (1.0 + restitution) - np.log((1.0 + x) / (1.0 - restitution * x))

    factor = float(brentq(restitution_equation, 0.1, 1.0 / restitution - 1e-9, xtol=1e-15)) / speed

    def depth_rate(_: float, y: Array) -> list[float]:
        push = stiffness * max(y[0], 0.0) ** 1.5 * max(1.0 + factor * y[1], 0.0)
        return [y[1], GRAVITY - push]

    def separation(_: float, y: Array) -> float:
        return y[0]

    separation.terminal, separation.direction = True, -1.0  # type: ignore[attr-defined]
    motion = np.zeros((len(t), 2))
    begin, height, rising = 0.0, 1.0, 0.0
    while begin < t[-1]:
        fall = (rising + np.sqrt(rising**2 + 2.0 * GRAVITY * height)) / GRAVITY
        flying = (t >= begin) & (t < begin + fall)
        since = t[flying] - begin
        motion[flying, 0] = height + rising * since - 0.5 * GRAVITY * since**2
        motion[flying, 1] = rising - GRAVITY * since
        begin, impact_speed = begin + fall, GRAVITY * fall - rising
        contact = solve_ivp(
            depth_rate, (0.0, 1.0), [1e-300, impact_speed], "DOP853", dense_output=True,
            events=separation, rtol=1e-12, atol=1e-14,
        )  # fmt: skip
        duration = contact.t_events[0][0]
        touching = (t >= begin) & (t < begin + duration)
        if touching.any():
            motion[touching] = -contact.sol(t[touching] - begin).T
        begin, height, rising = begin + duration, 0.0, -float(contact.y_events[0][0][1])
    zero = np.zeros_like(t)
    y, rate = motion.T
    return {"q": np.stack([zero, y], axis=-1), "v": np.stack([zero, rate], axis=-1)}


def gear_motion(t: Array) -> dict[str, Array]:
    """Return the oscillation of the inertia reduced to the arm, sum of J_i (ratio_i)^2."""
    stiffness, speed = 1.3, 1.5
    inertia = PLANET_MASS * ARM**2 + sum(j * GEAR_RATIOS[x] ** 2 for x, j in GEAR_INERTIAS.items())
    w = np.sqrt(stiffness / inertia)
    angle, rate, zero = speed / w * np.sin(w * t), speed * np.cos(w * t), np.zeros_like(t)
    position, velocity = ARM * np.exp(1j * angle), 1j * ARM * rate * np.exp(1j * angle)
    rotations = {x: (angle * ratio, rate * ratio) for x, ratio in GEAR_RATIOS.items()}
    central_q = [(zero, zero, rotations[x][0]) for x in ("arm", "sun")]
    central_v = [(zero, zero, rotations[x][1]) for x in ("arm", "sun")]
    q = [*central_q, (position.real, position.imag, rotations["planet"][0])]
    v = [*central_v, (velocity.real, velocity.imag, rotations["planet"][1])]
    return {name: np.stack(sum(rows, ()), axis=-1) for name, rows in (("q", q), ("v", v))}


def slider_motion(t: Array) -> dict[str, Array]:
    """Return r = r0 cosh(w t), the force 2 m w r' of the guide and the torque of the motor."""
    rate, distance, mass = 2.0, 0.3, 0.4
    r, radial_rate = distance * np.cosh(rate * t), distance * rate * np.sinh(rate * t)
    angle, zero = rate * t, np.zeros_like(t)
    position = r * np.exp(1j * angle)
    velocity = (radial_rate + 1j * rate * r) * np.exp(1j * angle)
    spin = np.full_like(t, rate)
    push = 2.0 * mass * rate * radial_rate
    return {
        "q": np.stack([zero, zero, angle, position.real, position.imag, angle], axis=-1),
        "v": np.stack([zero, zero, spin, velocity.real, velocity.imag, spin], axis=-1),
        "guide.F [N]": push,
        "motor.M [N m]": push * r,
    }


def ring_motion(t: Array) -> dict[str, Array]:
    """Return a pendulum of length R - r = 1 m with gravity divided by 1 + I / (m r^2)."""
    radius, mass, inertia, start = 0.25, 1.3, 0.4, 0.8
    k = np.sin(0.5 * start)
    w = np.sqrt(GRAVITY / (1.0 + inertia / (mass * radius**2)))
    sn, cn, dn, _ = ellipj(w * t, k**2)
    angle = 2.0 * np.arcsin(k * cn / dn)
    rate = -2.0 * k * w * (1.0 - k**2) * sn / dn**2 / np.cos(0.5 * angle)
    c, s = np.cos(angle), np.sin(angle)
    return {
        "q": np.stack([s, -c, (start - angle) / radius], axis=-1),
        "v": np.stack([c * rate, s * rate, -rate / radius], axis=-1),
    }


def moving_load_motion(t: Array) -> dict[str, Array]:
    """Return Krylov's series of a constant force at constant speed on a beam rigid in shear."""
    length, load, speed = 4.0, 5.0, 3.0
    deflection = np.zeros_like(t)
    for n in range(1, 60, 2):
        natural = (n * np.pi / length) ** 2 * np.sqrt(STRIP.EI / STRIP.rhoA)
        forcing = n * np.pi * speed / length
        wave = np.sin(forcing * t) - forcing / natural * np.sin(natural * t)
        wave = wave / (natural**2 - forcing**2)
        deflection -= 2.0 * load / (STRIP.rhoA * length) * np.sin(0.5 * n * np.pi) * wave
    return {"middle.y [m]": deflection}


def follower_equilibrium(t: Array) -> dict[str, Array]:
    """Return the tip from E I psi'' = P cos(psi), psi the rotation back from the tip, no shear."""
    ratio, length = 1.5, 1.0
    from_tip = solve_ivp(
        lambda s, y: [y[1], ratio * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])],
        (0.0, length),
        np.zeros(4),
        rtol=1e-10,
        atol=1e-12,
    )
    psi, _, along, across = from_tip.y[:, -1]
    # In the axes of the clamp, whose section is rotated by psi from that of the tip.
    x = along * np.cos(psi) + across * np.sin(psi)
    y = along * np.sin(psi) - across * np.cos(psi)
    columns = ("tip.x [m]", "tip.y [m]", "tip.angle [rad]")
    return {name: np.full_like(t, value) for name, value in zip(columns, (x, y, psi), strict=True)}


_HALF_PERIOD = np.pi * np.sqrt(2.0 / 800.0)  # [s] of the rubbing mass

_CONTACT_DURATION = 0.025  # [s] of the bouncing ball


MECHANISM_CASES = (
    PublishedCase(
        "spring and damper",
        "closed form: under-, critically and overdamped",
        damped_masses,
        tuple(0.1 * k for k in range(1, 21)),
        # The faster root of the overdamped mass.
        29.0,
        damped_motion,
    ),
    PublishedCase(
        "Coulomb friction",
        "closed form: half waves, whose amplitudes fall by 2 mu m g / k each",
        rubbing_mass,
        tuple(0.5 * _HALF_PERIOD * k for k in range(1, 12)),
        20.0,
        rubbing_motion,
        # Friction is regularized below 1e-3 m/s.
        model_error=2e-5,
    ),
    PublishedCase(
        "bouncing ball",
        "free flight in closed form; contacts of Hunt and Crossley, J. Appl. Mech. 42 (1975), by "
        "Runge-Kutta, with the restitution of Gonthier et al., Multibody Syst. Dyn. 11 (2004)",
        bouncing_ball,
        tuple(0.125 * k for k in range(1, 17)),
        # A contact lasts half a period.
        np.pi / _CONTACT_DURATION,
        bouncing_motion,
    ),
    PublishedCase(
        "planetary gear",
        "closed form: it oscillates with the inertia of its wheels reduced to the arm",
        planetary_gear,
        tuple(0.25 * k for k in range(1, 17)),
        6.0,
        gear_motion,
    ),
    PublishedCase(
        "slider on a driven rod",
        "closed form: r = r0 cosh(w t), pushed by 2 m w r', the reaction against the motor",
        slider_on_rod,
        tuple(0.15 * k for k in range(1, 7)),
        2.0 * np.sqrt(2.0),
        slider_motion,
    ),
    PublishedCase(
        "disk in a ring",
        "closed form: rolling without slip it is a pendulum with gravity over 1 + I / (m r^2)",
        disk_in_ring,
        tuple(0.25 * k for k in range(1, 17)),
        4.0,
        ring_motion,
    ),
    PublishedCase(
        "moving load",
        "closed form: A. N. Krylov's series of a force that moves over a simply supported beam",
        moving_load,
        tuple(np.linspace(0.0, 4.0 / 3.0, 21)[1:].tolist()),
        1.0,
        moving_load_motion,
        # The series neglects shear, rotary inertia and the shortening of the beam.
        model_error=4e-4,
    ),
    PublishedCase(
        "follower load",
        "the elastica under a force that rotates with its tip, by Runge-Kutta from the tip",
        follower_cantilever,
        (4.0,),
        1.0,
        follower_equilibrium,
        model_error=1e-4,
    ),
)
