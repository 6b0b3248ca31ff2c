"""Builders of joints and forces by kind: (world, name, place a, place b, parameters) -> part."""

import numpy as np

import beamdae as bd


def distance(w, name, a, b, n):
    return bd.Distance(name, w.at(a), w.at(b))


def driven_distance(w, name, a, b, n):
    (xa, ya), (xb, yb) = w.point(a), w.point(b)
    length, wave = ((xb - xa) ** 2 + (yb - ya) ** 2) ** 0.5, n["wave"]
    law = w.frame.law(wave.times(length / wave.value), "m")
    return bd.Distance(name, w.at(a), w.at(b), law)


def _driver_law(w, n, unit, sense):
    """Return a time law that is zero at the start."""
    wave = n["wave"]
    size = sense * w.frame.number(wave.value, unit)
    rate = wave.rate / w.frame.time

    def law(t):
        return size * (rate * t + wave.share * (rate * t) ** 2)

    return law


def driver(w, name, a, b, n):
    return bd.Driver(name, w.at(a), w.at(b), _driver_law(w, n, "", w.frame.sense))


def travel(w, name, a, b, n):
    law = _driver_law(w, n, "m", 1.0)
    direction = w.frame.way(*n["direction"], unit="")
    return bd.TranslationalDriver(name, w.at(a), w.at(b), law, direction)


def joint_with_direction(kind):
    """Return the builder of a joint with a direction."""

    def build(w, name, a, b, n):
        return kind(name, w.at(a), w.at(b), w.frame.way(*n["direction"], unit=""))

    return build


def joint_of_two_points(kind):
    return lambda w, name, a, b, n: kind(name, w.at(a), w.at(b))


def gear(w, name, a, b, n):
    carrier = n.get("carrier")
    return bd.Gear(name, w.at(a), w.at(b), n["ratio"], None if carrier is None else w.at(carrier))


def rack(w, name, a, b, n):
    radius = w.frame.turn(n["radius"], "m")
    return bd.RackAndPinion(name, w.at(a), w.at(b), radius, w.frame.way(*n["direction"], unit=""))


def rolling_on_line(w, name, a, b, n):
    radius, direction = w.frame.number(n["radius"], "m"), w.frame.way(*n["direction"], unit="")
    return bd.RollingOnLine(name, w.at(a), w.at(b), radius, direction)


def rolling_on_circle(w, name, a, b, n):
    radii = tuple(w.frame.number(r, "m") for r in n["radii"])
    return bd.RollingOnCircle(name, w.at(a), w.at(b), radii)


def sliding(w, name, a, b, n):
    """Build a joint of the point `b` that slides along the beam of `a`."""
    return bd.SlidingOnBeam(name, w.at(b), w.parts[w.bodies[a.body].name])


def skate(w, name, a, b, n):
    return bd.Skate(name, w.at(a), w.frame.way(*n["direction"], unit=""))


JOINTS = {
    "revolute": joint_of_two_points(bd.Revolute),
    "weld": joint_of_two_points(bd.Weld),
    "prismatic": joint_with_direction(bd.Prismatic),
    "point on line": joint_with_direction(bd.PointOnLine),
    "distance": distance,
    "driven distance": driven_distance,
    "driver": driver,
    "travel": travel,
    "gear": gear,
    "rack": rack,
    "rolling on line": rolling_on_line,
    "rolling on circle": rolling_on_circle,
    "sliding": sliding,
    "skate": skate,
}


# Builders of forces by kind: (world, name, place a, place b, parameters) -> part.


def spring(w, name, a, b, n):
    """Build a spring with a damper in parallel."""
    f = w.frame
    ends, damping = (name, w.at(a), w.at(b)), f.number(n["damping"], "N s/m")
    stiffness, free = f.number(n["stiffness"], "N/m"), f.number(n["free"], "m")
    preload = f.number(n["preload"], "N")
    return bd.Spring(*ends, stiffness, damping, free, preload)


def damper(w, name, a, b, n):
    return bd.Spring(name, w.at(a), w.at(b), damping=w.frame.number(n["damping"], "N s/m"))


def spring_by_law(w, name, a, b, n):
    """Build a progressive spring with a damper and its energy."""
    f = w.frame
    size, force = f.number(n["free"], "m"), f.number(abs(n["preload"]), "N")
    rate = n["damping"]
    speed = f.number(1.0, "m/s")
    return bd.Spring(
        name,
        w.at(a),
        w.at(b),
        law=lambda x, v: force * (np.sinh(x / size) + rate * np.tanh(v / speed)),
        energy=lambda x: force * size * np.cosh(x / size),
    )


def torsion_spring(w, name, a, b, n):
    """Build a torsion spring, or a torsion damper if it has no stiffness."""
    f = w.frame
    if not n["stiffness"]:
        return bd.TorsionSpring(name, w.at(a), w.at(b), damping=f.number(n["damping"], "N m s"))
    return bd.TorsionSpring(
        name,
        w.at(a),
        w.at(b),
        stiffness=f.number(n["stiffness"], "N m"),
        damping=f.number(n["damping"], "N m s"),
        free_angle=f.turn(n["free"]),
        preload=f.turn(n["preload"], "N m"),
    )


def bushing(w, name, a, b, n):
    f, k, c = w.frame, n["stiffness"], n["damping"]
    return bd.Bushing(
        name,
        w.at(a),
        w.at(b),
        kx=f.number(k, "N/m"),
        ky=f.number(2.0 * k, "N/m"),
        ktheta=f.number(0.3 * k, "N m"),
        cx=f.number(c, "N s/m"),
        cy=f.number(0.5 * c, "N s/m"),
        ctheta=f.number(0.2 * c, "N m s"),
        angle=f.heading(n["angle"]),
    )


def _contact(w, name, point, surface, n):
    f = w.frame
    return bd.Contact(
        name,
        w.at(point),
        surface,
        stiffness=f.number(n["stiffness"], "N/m^1.5"),
        restitution=n["restitution"],
        impact_speed=f.number(1.0, "m/s"),
        friction=n["friction"],
        friction_speed=f.number(0.1, "m/s"),
    )


def contact_line(w, name, a, b, n):
    x, y = n["direction"]
    direction = w.frame.way(w.frame.sense * x, w.frame.sense * y, unit="")
    return _contact(w, name, b, bd.LineSurface(w.at(a), direction), n)


def wrapping(w, name, a, b, n):
    f = w.frame
    x, y = n["direction"]
    surface = bd.LineSurface(w.at(a), f.way(f.sense * x, f.sense * y, unit=""))
    stiffness = f.number(n["stiffness"], "N/m^2.5")
    friction = {"friction": n["friction"], "friction_speed": f.number(0.1, "m/s")}
    return bd.BeamContact(name, w.parts[w.bodies[b.body].name], surface, stiffness, **friction)


def contact_circle(w, name, a, b, n):
    surface = bd.CircleSurface(w.at(a), w.frame.number(n["radius"], "m"), n["side"])
    return _contact(w, name, b, surface, n)


def force(w, name, a, b, n):
    return bd.Force(name, w.at(b), w.frame.laws(n["wave"], n["direction"], "N"), n["axes"])


def moment(w, name, a, b, n):
    return bd.Moment(name, w.at(b), w.frame.law(n["wave"], "N m", w.frame.sense))


def force_law(w, name, a, b, n):
    """Build an attraction of two points with finite range and damping."""
    f = w.frame
    force, reach = f.number(n["preload"], "N"), f.number(1.0, "m")
    damping = f.number(n["damping"], "N s/m")

    def law(p, q, t):
        offset = (q.position - p.position) / reach
        square = 1.0 + offset @ offset
        rate = offset @ (q.velocity - p.velocity)
        pull = (force / square + damping * rate / square) * offset
        return [pull, -pull]

    def energy(p, q):
        offset = (q.position - p.position) / reach
        return 0.5 * force * reach * np.log(1.0 + offset @ offset)

    return bd.ForceLaw(name, (w.at(a), w.at(b)), law, energy, dissipative=True)


def line_load(w, name, a, b, n):
    f, beam = w.frame, w.parts[w.bodies[b.body].name]
    if n["axes"] == "section":
        along, left = n["direction"]
        law = (f.law(n["wave"], "N/m", along), f.law(n["wave"], "N/m", f.sense * left))
        return bd.DistributedForce(name, beam, law, axes="section")
    return bd.DistributedForce(name, beam, f.laws(n["wave"], n["direction"], "N/m"))


def moving_force(w, name, a, b, n):
    f, beam = w.frame, w.parts[w.bodies[b.body].name]
    x, y = (n["wave"].value * d for d in n["direction"])
    speed, start = f.number(n["speed"], "m/s"), f.number(n["start"], "m")
    return bd.MovingForce(name, beam, f.way(x, y, "N"), speed, start)


def rayleigh(w, name, a, b, n):
    f, beam = w.frame, w.parts[w.bodies[b.body].name]
    return bd.RayleighDamping(name, beam, mass=n["mass"] / f.time, stiffness=f.number(1e-4, "s"))


def drag(w, name, a, b, n):
    beam = w.parts[w.bodies[b.body].name]
    return bd.AirDrag(name, beam, w.frame.number(n["damping"], "kg/m^2"))


def solid(w, name, a, b, n):
    beam = w.parts[w.bodies[b.body].name]
    return bd.StandardLinearSolid(name, beam, n["ratio"], w.frame.number(0.02, "s"))


def load_mass(w, name, a, b, n):
    return bd.PointMass(name, w.frame.number(n["mass"], "kg"), on=w.at(b))


def friction(w, name, a, b, n):
    """Build the friction in the joint named `of`."""
    f, joint = w.frame, w.parts[n["of"]]
    more = {"radius": f.number(0.05, "m")} if n["radius"] else {}
    if n["static"]:
        more |= {"static": 1.5 * n["friction"], "stribeck": f.number(0.3, "m/s")}
    return bd.Friction(
        name,
        joint,
        n["friction"],
        friction_speed=f.number(0.1, "m/s"),
        smoothing=f.number(1e-3, "N"),
        **more,
    )


FORCES = {
    "spring": spring,
    "damper": damper,
    "law of a spring": spring_by_law,
    "torsion spring": torsion_spring,
    "bushing": bushing,
    "contact with a line": contact_line,
    "contact with a circle": contact_circle,
    "wrapping": wrapping,
    "force": force,
    "moment": moment,
    "law of two points": force_law,
    "load by length": line_load,
    "moving force": moving_force,
    "Rayleigh": rayleigh,
    "drag": drag,
    "relaxation": solid,
    "mass": load_mass,
    "friction": friction,
}
