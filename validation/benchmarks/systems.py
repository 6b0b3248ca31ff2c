"""Models of systems with published or closed-form motions."""

import casadi as ca
import numpy as np
from scipy.special import ellipj, ellipk

import beamdae as bd

# [m/s^2]; a 1 m pendulum released from the horizontal has the period 4 sqrt(l/g) K(1/sqrt 2) = 2 s.
PERIOD_TWO_GRAVITY = 4.0 * float(ellipk(0.5)) ** 2


def create_symbols(n: int) -> tuple[ca.SX, ca.SX, ca.SX]:
    return ca.SX.sym("t"), ca.SX.sym("q", n), ca.SX.sym("v", n)


def lagrange_force(q: ca.SX, v: ca.SX, mass: ca.SX, applied: ca.SX) -> ca.SX:
    """Return f of M q'' = f for the kinetic energy v . M(q) v / 2 and the applied force."""
    kinetic = 0.5 * ca.dot(v, mass @ v)
    return applied + ca.gradient(kinetic, q) - ca.jtimes(mass @ v, q, v)


@bd.model(t_end=3.0)
def car_axis(epsilon=1e-2):
    """Car axis on two stiff springs over a bumpy road, index 3.

    F. Mazzia, C. Magherini, Test Set for Initial Value Problem Solvers, release 2.4 (2008),
    problem caraxis, https://archimede.dm.uniba.it/~testset/; numbers of cran/deTestSet.
    """
    t, q, v = create_symbols(4)
    left, right = q[:2], q[2:]
    mass = 0.5 * 10.0 * epsilon**2
    bump = 0.1 * ca.sin(10.0 * t)
    wheel = ca.vertcat(ca.sqrt(1.0 - bump**2), bump)
    weight = ca.vertcat(0.0, -mass)

    def spring_force(span: ca.SX) -> ca.SX:
        length = ca.norm_2(span)
        return (0.5 - length) / length * span

    def spring_energy(span: ca.SX) -> ca.SX:
        return 0.5 * (ca.norm_2(span) - 0.5) ** 2

    return bd.ConstrainedSystem(
        t=t,
        q=q,
        v=v,
        mass=[mass] * 4,
        force=ca.vertcat(spring_force(left) + weight, spring_force(right - wheel) + weight),
        constraints=ca.vertcat(ca.dot(left, wheel), ca.sumsqr(left - right) - 1.0),
        q0=[0.0, 0.5, 1.0, 0.5],
        v0=[-0.5, 0.0, -0.5, 0.0],
        names=("xl", "yl", "xr", "yr"),
        units=("m",) * 4,
        strain_energy=spring_energy(left) + spring_energy(right - wheel),
        gravity_energy=mass * (left[1] + right[1]),
    )


CAR_AXIS_END = {
    "xl [m]": 0.493455784275402809122e-1,
    "yl [m]": 0.496989460230171153861,
    "xr [m]": 0.104174252488542151681e1,
    "yr [m]": 0.373911027265361256927,
}


@bd.model(t_end=2.0)
def arevalo():
    """Accelerating particle on a circle, index 3: x = sin t^2, y = cos t^2.

    C. Arevalo, P. Loetstedt, Improving the accuracy of BDF methods for index 3
    differential-algebraic equations, BIT 35 (1995) 297, doi:10.1007/BF01732606.
    """
    t, q, v = create_symbols(2)
    return bd.ConstrainedSystem(
        t=t,
        q=q,
        v=v,
        mass=[1.0, 1.0],
        force=ca.vertcat(2.0 * q[1], -2.0 * q[0]),
        constraints=0.5 * (ca.sumsqr(q) - 1.0),
        q0=[0.0, 1.0],
        v0=[0.0, 0.0],
        names=("x", "y"),
        units=("m", "m"),
    )


def arevalo_motion(t: np.ndarray) -> np.ndarray:
    """Return (x, y) of `arevalo`."""
    return np.stack([np.sin(t**2), np.cos(t**2)], axis=-1)


@bd.model(t_end=4.0)
def particle_pendulum(gravity=PERIOD_TWO_GRAVITY, angle=0.5 * np.pi, speed=0.0):
    """Particle on a rod of 1 m; initial angle [rad] from straight down and speed [m/s].

    With gravity 9.81 and angle -pi/2: IFToMM multibody benchmark A01, M. Gonzalez, D. Dopico,
    U. Lugris, J. Cuadrado, Multibody Syst. Dyn. 16 (2006) 179, doi:10.1007/s11044-006-9020-8.
    """
    t, q, v = create_symbols(2)
    g = ca.SX.sym("g")
    return bd.ConstrainedSystem(
        t=t,
        q=q,
        v=v,
        mass=[1.0, 1.0],
        force=ca.vertcat(0.0, -g),
        constraints=0.5 * (ca.sumsqr(q) - 1.0),
        q0=[np.sin(angle), -np.cos(angle)],
        v0=[speed * np.cos(angle), speed * np.sin(angle)],
        names=("x", "y"),
        units=("m", "m"),
        parameters={g: gravity},
        gravity_energy=g * q[1],
    )


def released_pendulum_motion(t: np.ndarray, gravity: float = PERIOD_TWO_GRAVITY, side: float = 1.0):
    """Return (x, y) of `particle_pendulum`: sin(angle / 2) = cd(sqrt(g) t) / sqrt 2."""
    _, cn, dn, _ = ellipj(np.sqrt(gravity) * t, 0.5)
    half = np.sqrt(0.5) * cn / dn
    return np.stack([2.0 * side * half * np.sqrt(1.0 - half**2), 2.0 * half**2 - 1.0], axis=-1)


def iftomm_motion(t: np.ndarray) -> np.ndarray:
    """Return (x, y) of `particle_pendulum` with the parameters of IFToMM A01."""
    return released_pendulum_motion(t, 9.81, -1.0)


# Twelve digits of Exudyn's Examples/pendulumIftommBenchmark.py.
IFTOMM_END = {"x [m]": -0.275087462577, "y [m]": -0.961419205099}


@bd.model(t_end=10.0)
def spring_slider_crank():
    """Rigid slider-crank with a spring and damper between crank and rod.

    E. Haug, Intermediate Dynamics, 1992, example 6.1.8; SUNDIALS examples/ida/serial
    idaSlCrank_dns.c, whose output has five digits (t = 10: 1.2757, 1.0236, -0.49881).
    """
    t, u, v = create_symbols(3)
    q, x, p = u[0], u[1], u[2]
    a = 0.5
    crank = 0.5 * a * ca.vertcat(ca.cos(q), ca.sin(q))
    rod = ca.vertcat(x - 0.5 * ca.cos(p), -0.5 * ca.sin(p))
    length = ca.norm_2(rod - crank)
    length_rate = ca.jtimes(length, u, v)
    tension = (length - 1.0) + length_rate
    push = ca.jacobian(x + ca.cos(p), u).T
    return bd.ConstrainedSystem(
        t=t,
        q=u,
        v=v,
        mass=[1.0, 1.0, 2.0],
        force=push - tension * ca.jacobian(length, u).T,
        constraints=ca.vertcat(x - ca.cos(p) - a * ca.cos(q), -ca.sin(p) - a * ca.sin(q)),
        q0=[np.pi / 2.0, np.cos(np.arcsin(-a)), np.arcsin(-a)],
        v0=[0.0, 0.0, 0.0],
        names=("crank", "slider", "rod"),
        units=("rad", "m", "rad"),
        strain_energy=0.5 * (length - 1.0) ** 2,
        dissipated_power=length_rate**2,
    )


SPRING_SLIDER_CRANK_END = {"crank [rad]": 1.2757, "slider [m]": 1.0236, "rod [rad]": -0.49881}


@bd.model(t_end=4.0)
def free_particle(offset=0.5):
    """Force-free particle in polar coordinates (r, phi), mass diag(1, r^2): a straight line."""
    t, q, v = create_symbols(2)
    mass = ca.diag(ca.vertcat(1.0, q[0] ** 2))
    r = np.hypot(2.0, offset)
    return bd.ConstrainedSystem(
        t=t,
        q=q,
        v=v,
        mass=mass,
        force=lagrange_force(q, v, mass, ca.SX.zeros(2)),
        q0=[r, np.arctan2(-2.0, offset)],
        v0=[-2.0 / r, offset / r**2],
        names=("r", "phi"),
        units=("m", "rad"),
    )


def free_particle_motion(t: np.ndarray, offset: float = 0.5) -> np.ndarray:
    """Return (r, phi) of `free_particle`, at speed 1 from 2 m before the nearest point."""
    return np.stack([np.hypot(t - 2.0, offset), np.arctan2(t - 2.0, offset)], axis=-1)


@bd.model(t_end=4.0)
def cycloid_slide(radius=0.5, gravity=9.81, start=-0.95):
    """Particle that slides without friction down the brachistochrone, a cycloid.

    Its arc length s from the lowest point is a third coordinate, without inertia; it starts at the
    fraction `start` of its largest value. C. Huygens, Horologium oscillatorium (1673): s is a
    harmonic oscillation at any amplitude.
    """
    t, q, v = create_symbols(3)
    r, g = ca.SX.sym("r"), ca.SX.sym("g")
    x, y, s = ca.vertsplit(q)

    def along(slope, r):
        return 2.0 * r * (ca.asin(slope) + slope * ca.sqrt(1.0 - slope**2))

    slope = s / (4.0 * r)
    return bd.ConstrainedSystem(
        t=t,
        q=q,
        v=v,
        mass=[1.0, 1.0, 0.0],
        force=ca.vertcat(0.0, -g, 0.0),
        constraints={
            "push.x [N]": x - along(slope, r),
            "push.y [N]": y - 2.0 * r * slope**2,
        },
        q0=[float(along(start, radius)), 2.0 * radius * start**2, 4.0 * radius * start],
        v0=[0.0, 0.0, 0.0],
        names=("x", "y", "s"),
        units=("m", "m", "m"),
        parameters={r: radius, g: gravity},
        gravity_energy=g * y,
    )


@bd.model(t_end=2.0)
def rotating_rod(radius=0.1, rate=2.0):
    """Particle on a rod that rotates at a constant rate, released at rest relative to the rod.

    Closed form: r = r0 cosh(w t).
    """
    t, q, v = create_symbols(2)
    w = ca.SX.sym("w")
    return bd.ConstrainedSystem(
        t=t,
        q=q,
        v=v,
        mass=[1.0, 1.0],
        force=[0.0, 0.0],
        constraints={"rod [N]": -q[0] * ca.sin(w * t) + q[1] * ca.cos(w * t)},
        q0=[radius, 0.0],
        v0=[0.0, radius * rate],
        names=("x", "y"),
        units=("m", "m"),
        parameters={w: rate},
        time_scale=2.0 * np.pi / rate,
        observe={"r [m]": ca.norm_2(q)},
    )


@bd.model(t_end=4.0)
def knife_edge(pull=5.0, spin=2.0):
    """Knife edge (skate) on an inclined plane, released with a spin: index 2, nonholonomic.

    A. M. Bloch, Nonholonomic Mechanics and Control (2003), section 1.6; JonasBreuling/scipy_dae,
    examples/daes/knife_edge.py. `pull` is gravity along the plane [m/s^2]. The path is a cycloid
    across the slope.
    """
    t, q, v = create_symbols(3)
    g, phi = ca.SX.sym("g"), q[2]
    return bd.ConstrainedSystem(
        t=t,
        q=q,
        v=v,
        mass=[1.0, 1.0, 1.0],
        force=ca.vertcat(g, 0.0, 0.0),
        velocity_constraints={"edge [N]": v[0] * ca.sin(phi) - v[1] * ca.cos(phi)},
        q0=[0.0, 0.0, 0.0],
        v0=[0.0, 0.0, spin],
        names=("x", "y", "angle"),
        units=("m", "m", "rad"),
        parameters={g: pull},
        gravity_energy=-g * q[0],
    )


@bd.model(t_end=3.0)
def parallelogram(crank=0.5, coupler=1.0, rate=2.0, angle=0.3):
    """Parallelogram linkage of rigid bars without gravity, through its change points.

    Closed form: both cranks keep their initial rate, the coupler does not rotate.
    """
    mech = bd.Mechanism(gravity=(0.0, 0.0))
    span = np.array([coupler, 0.0])
    pin = crank * np.array([np.cos(angle), np.sin(angle)])
    velocity = rate * np.array([-pin[1], pin[0]])
    bridge = mech.add(bd.RigidBody("coupler", 1.0, 0.1, tuple(pin + 0.5 * span), tuple(velocity)))
    for name, pivot in (("left", 0.0 * span), ("right", span)):
        center, center_velocity = tuple(pivot + 0.5 * pin), tuple(0.5 * velocity)
        bar = mech.add(bd.RigidBody(name, 1.0, 0.1, center, center_velocity, rate))
        mech.add(bd.Revolute(f"{name} pivot", mech.ground.at(*pivot), bar.at(*pivot)))
        mech.add(bd.Revolute(f"{name} pin", bar.at(*(pivot + pin)), bridge.at(*(pivot + pin))))
    return mech
