"""Similarities: a drawing moved, turned, mirrored, and its numbers in other units."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import beamdae as bd

# Angles that are those of the drawing, not since then.
ABSOLUTE_ANGLES = ("theta", "psi")
# Powers of length, mass and time.
UNIT_EXPONENTS = {
    "": (0, 0, 0),
    "m": (1, 0, 0),
    "kg": (0, 1, 0),
    "s": (0, 0, 1),
    "m/s": (1, 0, -1),
    "rad/s": (0, 0, -1),
    "m/s^2": (1, 0, -2),
    "kg m^2": (2, 1, 0),
    "kg/m^3": (-3, 1, 0),
    "N": (1, 1, -2),
    "N/m": (0, 1, -2),
    "N/m^1.5": (-0.5, 1, -2),
    "N s/m": (0, 1, -1),
    "N m": (2, 1, -2),
    "N m s": (2, 1, -1),
    "Pa": (-1, 1, -2),
    "kg/m^2": (-2, 1, 0),
}


@dataclass(frozen=True)
class Wave:
    """The law value (1 + share sin(rate t)); constant where there is no share."""

    value: float
    share: float = 0.0
    rate: float = 1.0

    def times(self, factor: float) -> Wave:
        return Wave(factor * self.value, self.share, self.rate)


@dataclass(frozen=True)
class Similarity:
    """Where a drawing lies, and how many new units of length, mass and time each old one is."""

    angle: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)
    mirrored: bool = False
    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0

    @property
    def sense(self) -> float:
        """Of turns: -1 in a mirror."""
        return -1.0 if self.mirrored else 1.0

    def number(self, value: float, unit: str) -> float:
        m, kg, s = UNIT_EXPONENTS[unit]
        return value * self.length**m * self.mass**kg * self.time**s

    def turn(self, value: float, unit: str = "") -> float:
        """An angle, its rate, or a moment."""
        return self.sense * self.number(value, unit)

    def way(self, x: float, y: float, unit: str = "m") -> tuple[float, float]:
        """A vector."""
        x, y = self.number(x, unit), self.sense * self.number(y, unit)
        c, s = float(np.cos(self.angle)), float(np.sin(self.angle))
        return c * x - s * y, s * x + c * y

    def point(self, x: float, y: float) -> tuple[float, float]:
        dx, dy = self.way(x, y)
        return dx + self.shift[0], dy + self.shift[1]

    def heading(self, angle: float) -> float:
        """The angle of a direction."""
        return self.sense * angle + self.angle

    def law(self, wave: Wave, unit: str, sense: float = 1.0) -> float | Callable:
        """A law of time."""
        value, rate = sense * self.number(wave.value, unit), wave.rate / self.time
        if not wave.share:
            return value
        return lambda t: value * (1.0 + wave.share * np.sin(rate * t))

    def laws(self, wave: Wave, direction: tuple[float, float], unit: str) -> tuple:
        """Both components of a vector whose size is a law."""
        x, y = self.way(*direction, unit="")
        return self.law(wave, unit, x), self.law(wave, unit, y)


def transform_values(
    frame: Similarity, equations, values: np.ndarray, kind: str
) -> dict[str, float]:
    """Coordinates "q", their rates "v", "a", or generalized forces "Q" in the frame, by name."""
    found = {}
    time = {"q": 0, "v": -1, "a": -2, "Q": -2}[kind]
    weight = frame.time**time * (frame.mass * frame.length**2 if kind == "Q" else 1.0)
    length = 1.0 / frame.length if kind == "Q" else frame.length
    c, s = np.cos(frame.angle), np.sin(frame.angle)
    for k, coordinate in enumerate(equations.coordinates):
        own = base_name(coordinate.name)
        value = weight * values[k] * (1.0 if coordinate.unit == "rad" else length)
        if own == "x":
            y = frame.sense * weight * length * values[k + 1]
            other = equations.coordinates[k + 1].name
            moved = np.array([c * value - s * y, s * value + c * y])
            if kind == "q":
                moved += frame.shift
            found[coordinate.name], found[other] = moved.tolist()
        elif own != "y":
            mirrored = coordinate.unit == "rad" or own == "v"
            value *= frame.sense if mirrored else 1.0
            turned = own in ABSOLUTE_ANGLES and kind == "q"
            found[coordinate.name] = value + (frame.angle if turned else 0.0)
    return found


def base_name(name: str) -> str:
    """The name of a coordinate without that of its part and the number of its node."""
    return name.rpartition(".")[2].rstrip("0123456789")


def create_section(frame: Similarity, modulus: float, width: float, height: float, damping: float):
    material = bd.Material(
        E=frame.number(modulus, "Pa"), nu=0.3, rho=frame.number(2000.0, "kg/m^3")
    )
    return bd.Section.rectangle(
        material,
        width=frame.number(width, "m"),
        height=frame.number(height, "m"),
        damping=frame.number(damping, "s"),
    )
