"""Builders of joints by kind: (world, name, place a, place b, parameters) -> part."""

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
