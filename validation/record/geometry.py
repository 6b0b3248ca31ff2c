"""Laws, axes and attachments of a problem, as defined in problem.schema.json."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq


def law_value(law: Any, t: float) -> float:
    """Return the value of a time law of `problem.schema.json`."""
    if isinstance(law, int | float):
        return float(law)
    kind = law["type"]
    if kind == "sine":
        phase = 2.0 * math.pi * law["frequency"] * t + law.get("phase", 0.0)
        return law["amplitude"] * math.sin(phase)
    if kind == "run_up":
        speed, end = law["speed"], law["duration"]
        if t >= end:
            return speed * (t - 0.5 * end)
        ratio = end / (2.0 * math.pi)
        return speed / end * (0.5 * t**2 + ratio**2 * (math.cos(t / ratio) - 1.0))
    if kind == "versine_pulse":
        inside = 0.0 < t < law["duration"]
        return law["amplitude"] * math.sin(math.pi * t / law["duration"]) ** 2 * inside
    if kind == "cosine_ramp":
        phase = math.pi * min(max(t / law["duration"], 0.0), 1.0)
        return 0.5 * law["amplitude"] * (1.0 - math.cos(phase))
    if kind == "piecewise_linear":
        return float(np.interp(t, law["times"], law["values"]))
    raise ValueError(f"law: type {kind!r} is unknown")


def law_rate(law: Any, t: float) -> float:
    """Return the time derivative of a driver's law."""
    if isinstance(law, int | float):
        return 0.0
    if law["type"] == "run_up":
        speed, end = law["speed"], law["duration"]
        if t >= end:
            return speed
        return speed / end * (t - end / (2.0 * math.pi) * math.sin(2.0 * math.pi * t / end))
    if law["type"] == "sine":
        rate = 2.0 * math.pi * law["frequency"]
        return law["amplitude"] * rate * math.cos(rate * t + law.get("phase", 0.0))
    if law["type"] == "cosine_ramp":
        inside = 0.0 < t < law["duration"]
        rate = math.pi / law["duration"]
        return 0.5 * law["amplitude"] * rate * math.sin(rate * t) * inside
    raise ValueError(f"driver: law {law['type']!r} has no rate here")


def contact_force(contact: dict[str, Any], point: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Return the normal and the friction force on the contact point (Hunt and Crossley 1975)."""
    normal = np.array(contact["normal"])
    tangent = np.array([normal[1], -normal[0]])
    depth = -(point - contact["a"]["point"]) @ normal
    if depth <= 0.0:
        return np.zeros(2)
    hysteresis = max(0.0, 1.0 - contact.get("hysteresis", 0.0) * float(rate @ normal))
    force = contact["stiffness"] * depth ** contact.get("exponent", 1.5) * hysteresis
    friction = contact.get("friction", 0.0)
    if friction:
        friction *= math.tanh(rate @ tangent / contact["friction_speed"])
    return np.asarray(force * (normal - friction * tangent))


def attachments(problem: dict[str, Any]) -> list[dict[str, Any]]:
    """Return all attachments of a problem."""
    on = [x["on"] for key in ("outputs", "loads", "point_masses") for x in problem.get(key, [])]
    pairs = ("joints", "springs", "contacts")
    on += [x[end] for key in pairs for x in problem.get(key, []) for end in "ab"]
    return on + ([problem["control"]["on"]] if "control" in problem else [])


@dataclass
class Curve:
    """Axis of a beam: length, and point and tangent angle as functions of arc length."""

    length: float
    point: Callable[[float], np.ndarray]
    angle: Callable[[float], float]


def make_curve(data: dict[str, Any]) -> Curve:
    """Return the axis described by `data`."""
    kind = data["type"]
    if kind == "line":
        start, end = np.array(data["start"]), np.array(data["end"])
        length = float(np.hypot(*(end - start)))
        angle = math.atan2(*(end - start)[::-1])
        return Curve(length, lambda s: start + s / length * (end - start), lambda s: angle)
    start, angle = np.array(data["start"]), data.get("angle", 0.0)
    if kind == "arc":
        radius, sign = abs(data["radius"]), math.copysign(1.0, data["radius"])

        def arc_point(s: float) -> np.ndarray:
            turn = s / radius
            along, left = radius * math.sin(turn), sign * radius * (1.0 - math.cos(turn))
            return start + rotation(angle) @ [along, left]

        return Curve(data["length"], arc_point, lambda s: angle + sign * s / radius)
    # Parabola y = 4 rise / span^2 X (span - X) over the chord; arc length by quadrature.
    span, rise = data["span"], data["rise"]

    def slope(x: float) -> float:
        return 4.0 * rise / span**2 * (span - 2.0 * x)

    def arc_length(x: float) -> float:
        return quad(lambda u: math.hypot(1.0, slope(u)), 0.0, x, epsabs=1e-14, epsrel=1e-13)[0]

    length = arc_length(span)

    def chord_coordinate(s: float) -> float:
        return brentq(lambda x: arc_length(x) - s, -1e-9 * span, span * (1.0 + 1e-9), xtol=1e-14)

    def parabola_point(s: float) -> np.ndarray:
        x = chord_coordinate(s)
        return start + rotation(angle) @ [x, 4.0 * rise / span**2 * x * (span - x)]

    return Curve(length, parabola_point, lambda s: angle + math.atan(slope(chord_coordinate(s))))


def rotation(angle: float) -> np.ndarray:
    """Return the matrix of a counter-clockwise rotation."""
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
