"""Similarity transformations: displaced, rotated and mirrored drawings, and other units."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

import beamdae as bd

# Coordinates that are absolute angles, not rotations since the drawing.
ABSOLUTE_ANGLES = ("theta", "psi")
# Exponents of length, mass and time.
UNIT_EXPONENTS = {
    "": (0, 0, 0),
    "m": (1, 0, 0),
    "kg": (0, 1, 0),
    "s": (0, 0, 1),
    "m s": (1, 0, 1),
    "m/s": (1, 0, -1),
    "rad/s": (0, 0, -1),
    "m/s^2": (1, 0, -2),
    "kg m^2": (2, 1, 0),
    "kg/m^3": (-3, 1, 0),
    "N": (1, 1, -2),
    "N/m": (0, 1, -2),
    "N/m^1.5": (-0.5, 1, -2),
    "N/m^2.5": (-1.5, 1, -2),
    "N s/m": (0, 1, -1),
    "N m": (2, 1, -2),
    "N m s": (2, 1, -1),
    "Pa": (-1, 1, -2),
    "kg/m^2": (-2, 1, 0),
    "m/N": (0, -1, 2),
}


@dataclass(frozen=True)
class Wave:
    """Law value (1 + share sin(rate t)) of time t."""

    value: float
    share: float = 0.0
    rate: float = 1.0

    def times(self, factor: float) -> Wave:
        return Wave(factor * self.value, self.share, self.rate)


@dataclass(frozen=True)
class Similarity:
    """Rotation, translation and reflection of a drawing, and factors of its units."""

    angle: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)
    mirrored: bool = False
    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0

    @property
    def sense(self) -> float:
        """Sign of rotations: -1 if mirrored."""
        return -1.0 if self.mirrored else 1.0

    def number(self, value: float, unit: str) -> float:
        m, kg, s = UNIT_EXPONENTS[unit]
        return value * self.length**m * self.mass**kg * self.time**s

    def turn(self, value: float, unit: str = "") -> float:
        """Transform an angle, its rate, or a moment."""
        return self.sense * self.number(value, unit)

    def way(self, x: float, y: float, unit: str = "m") -> tuple[float, float]:
        """Transform a vector."""
        x, y = self.number(x, unit), self.sense * self.number(y, unit)
        c, s = float(np.cos(self.angle)), float(np.sin(self.angle))
        return c * x - s * y, s * x + c * y

    def point(self, x: float, y: float) -> tuple[float, float]:
        dx, dy = self.way(x, y)
        return dx + self.shift[0], dy + self.shift[1]

    def heading(self, angle: float) -> float:
        """Transform the angle of a direction."""
        return self.sense * angle + self.angle

    def law(self, wave: Wave, unit: str, sense: float = 1.0) -> float | Callable:
        """Transform a time law."""
        value, rate = sense * self.number(wave.value, unit), wave.rate / self.time
        if not wave.share:
            return value
        return lambda t: value * (1.0 + wave.share * np.sin(rate * t))

    def laws(self, wave: Wave, direction: tuple[float, float], unit: str) -> tuple:
        """Transform a vector of fixed direction whose magnitude is a time law."""
        x, y = self.way(*direction, unit="")
        return self.law(wave, unit, x), self.law(wave, unit, y)


def transform_values(
    frame: Similarity, equations, values: np.ndarray, kind: str
) -> dict[str, float]:
    """Transform coordinates "q", rates "v", "a" or generalized forces "Q"; return them by name."""
    transformed = {}
    time = {"q": 0, "v": -1, "a": -2, "Q": -2}[kind]
    weight = frame.time**time * (frame.mass * frame.length**2 if kind == "Q" else 1.0)
    length = 1.0 / frame.length if kind == "Q" else frame.length
    c, s = np.cos(frame.angle), np.sin(frame.angle)
    for k, coordinate in enumerate(equations.coordinates):
        kind_of_coordinate = base_name(coordinate.name)
        value = weight * values[k] * (1.0 if coordinate.unit == "rad" else length)
        if kind_of_coordinate == "x":
            y = frame.sense * weight * length * values[k + 1]
            other = equations.coordinates[k + 1].name
            vector = np.array([c * value - s * y, s * value + c * y])
            if kind == "q":
                vector += frame.shift
            transformed[coordinate.name], transformed[other] = vector.tolist()
        elif coordinate.unit == "J^0.5 s^0.5":
            value = weight * values[k] * frame.length * np.sqrt(frame.mass / frame.time)
            is_even = kind_of_coordinate.endswith("axial")
            transformed[coordinate.name] = value * (1.0 if is_even else frame.sense)
        elif kind_of_coordinate != "y":
            changes_sign = coordinate.unit == "rad" or kind_of_coordinate == "v"
            value *= frame.sense if changes_sign else 1.0
            is_absolute = kind_of_coordinate in ABSOLUTE_ANGLES and kind == "q"
            transformed[coordinate.name] = value + (frame.angle if is_absolute else 0.0)
    return transformed


def base_name(name: str) -> str:
    """Return the name of a coordinate without its part and node number."""
    return name.rpartition(".")[2].rstrip("0123456789")


def create_section(frame: Similarity, beam, length: float):
    """Return the section of a beam of this transformed length."""
    material = bd.Material(
        E=frame.number(beam.modulus, "Pa"), nu=0.3, rho=frame.number(2000.0, "kg/m^3")
    )
    width, height = frame.number(0.03, "m"), frame.number(beam.height, "m")
    damping = {"damping": frame.number(beam.damping, "s")}
    rectangle = partial(bd.Section.rectangle, material, width, **damping)
    if beam.profile == "circle":
        return bd.Section.circle(material, height, **damping)
    if beam.profile == "pipe":
        return bd.Section.pipe(material, 1.5 * height, 0.2 * height, **damping)
    if beam.profile == "i profile":
        return bd.Section.i_profile(material, width, height, height / 8, height / 10, **damping)
    if beam.profile == "numbers":
        return bd.Section(material, width * height, width * height**3 / 12.0, **damping)
    if beam.profile == "taper":
        heights = (height, 0.7 * height)
        return bd.taper(bd.Section.rectangle, material, width=width, height=heights, **damping)
    if beam.profile == "law":
        return lambda s: rectangle(height * (1.0 - 0.3 * s / length))
    return rectangle(height)


PROFILES = ("rectangle", "circle", "pipe", "i profile", "numbers", "taper", "law")
