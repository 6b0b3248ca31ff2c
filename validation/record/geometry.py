"""Laws, axes and attachments of a problem, as defined in problem.schema.json."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq

QUANTITIES = ("x", "y", "angle")
_COMPLEX_STEP = 1e-30  # s

Piece = tuple[float, Callable[[Any], Any]]  # end, and a smooth function of time


def law_pieces(law: Any, functions: Any = np) -> list[Piece]:
    """Return the smooth pieces of a time law of `problem.schema.json`; the last has no end.

    `functions` has the sine and the cosine of numbers or symbols of time.
    """
    if isinstance(law, int | float):
        return [(math.inf, lambda t: float(law))]
    kind, sin, cos = law["type"], functions.sin, functions.cos
    if kind == "sine":
        rate, phase = 2.0 * math.pi * law["frequency"], law.get("phase", 0.0)
        return [(math.inf, lambda t: law["amplitude"] * sin(rate * t + phase))]
    if kind == "piecewise_linear":
        times, values = law["times"], law["values"]
        lines = [
            (t1, lambda t, a=a, slope=(b - a) / (t1 - t0), t0=t0: a + slope * (t - t0))
            for (t0, a), (t1, b) in pairwise(zip(times, values, strict=True))
        ]
        return [(times[0], lambda t: values[0]), *lines, (math.inf, lambda t: values[-1])]
    end = law["duration"]
    if kind == "run_up":
        speed, ratio = law["speed"], end / (2.0 * math.pi)
        return [
            (end, lambda t: speed / end * (0.5 * t**2 + ratio**2 * (cos(t / ratio) - 1.0))),
            (math.inf, lambda t: speed * (t - 0.5 * end)),
        ]
    size, rate = law["amplitude"], math.pi / end
    if kind == "versine_pulse":
        return [(end, lambda t: size * sin(rate * t) ** 2), (math.inf, lambda t: 0.0)]
    if kind == "cosine_ramp":
        return [(end, lambda t: 0.5 * size * (1.0 - cos(rate * t))), (math.inf, lambda t: size)]
    raise ValueError(f"law: type {kind!r} is unknown")


def law_value(law: Any, t: float) -> float:
    """Return the value of a time law."""
    return float(_find_piece(law, t)(t))


def law_rate(law: Any, t: float) -> float:
    """Return the time derivative of a time law, by a complex step."""
    return float(_find_piece(law, t)(complex(t, _COMPLEX_STEP)).imag / _COMPLEX_STEP)


def _find_piece(law: Any, t: float) -> Callable[[Any], Any]:
    return next(piece for end, piece in law_pieces(law) if t < end)


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


def attached_fractions(problem: dict[str, Any], name: str) -> list[float]:
    """Return the places of a beam, as fractions of its length, to which something is attached."""
    return [float(x["fraction"]) for x in attachments(problem) if x["body"] == name]


def output_columns(problem: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any], str]]:
    """Yield the header of each column of the outputs, the output and the quantity."""
    for output in problem["outputs"]:
        for quantity in output["quantities"]:
            unit = "rad" if quantity == "angle" else "m"
            yield f"{output['name']}.{quantity} [{unit}]", output, quantity


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
