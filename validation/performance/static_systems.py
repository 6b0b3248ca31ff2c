"""Structures for timing equilibria, as plain numbers that Exudyn's interpreter can also read."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, radians, sin

E = 2.1e11  # Pa
RHO = 7850.0  # kg/m^3
POISSON = 0.3
SHEAR_FACTOR = 5.0 / 6.0
WIDTH = 0.02  # m
GRAVITY = 9.81  # m/s^2
LENGTH = 1.0  # m
HALF_ANGLE = radians(107.5)  # of the deep arch
ARCH_RADIUS = 0.5  # m


@dataclass(frozen=True)
class Segment:
    """Beam of constant curvature [1/m] from a start point and a tangent angle [rad]."""

    start: tuple[float, float]
    angle: float
    length: float
    curvature: float = 0.0

    def point(self, s: float) -> tuple[float, float]:
        """Return the point at the arc length s."""
        (x, y), angle, k = self.start, self.angle, self.curvature
        if k == 0.0:
            return x + s * cos(angle), y + s * sin(angle)
        turned = angle + k * s
        return x + (sin(turned) - sin(angle)) / k, y - (cos(turned) - cos(angle)) / k


@dataclass(frozen=True)
class Structure:
    """Welded segments, clamped at the start of the first one, with one load.

    Attributes
    ----------
    segments
        Beams, each of which begins at the end of the previous one.
    height
        Height of the section [m].
    force
        Force (x, y) at `loaded` of the last beam [EI / m^2].
    moment
        Moment there [EI / m].
    loaded
        Position of the load along the last beam, relative to its length: 0.5 or 1.
    gravity
        Acceleration of gravity [m/s^2], in place of other loads.
    is_hinged
        True if the end of the last beam is hinged.
    """

    segments: tuple[Segment, ...]
    height: float = 0.005
    force: tuple[float, float] = (0.0, 0.0)
    moment: float = 0.0
    loaded: float = 1.0
    gravity: float = 0.0
    is_hinged: bool = False

    @property
    def bending_stiffness(self) -> float:
        """EI [N m^2]."""
        return E * WIDTH * self.height**3 / 12.0


_LINE = (Segment((0.0, 0.0), 0.0, LENGTH),)
_ARCH = Segment(
    (-ARCH_RADIUS * sin(HALF_ANGLE), ARCH_RADIUS * cos(HALF_ANGLE)),
    HALF_ANGLE,
    2.0 * HALF_ANGLE * ARCH_RADIUS,
    -1.0 / ARCH_RADIUS,
)
_FRAME = (
    Segment((0.0, 0.0), 0.5 * pi, LENGTH),
    Segment((0.0, LENGTH), 0.0, LENGTH),
)
# The limit load of the arch is 8.97 EI / R^2 (DaDeppo & Schmidt, J. Appl. Mech. 42 (1975) 894).
STRUCTURES = {
    "tip force": Structure(_LINE, force=(0.0, -3.0)),
    "roll-up": Structure(_LINE, moment=2.0 * pi),
    "own weight": Structure(_LINE, height=0.001, gravity=GRAVITY),
    "deep arch": Structure(
        (_ARCH,), force=(0.0, -7.0 / ARCH_RADIUS**2), loaded=0.5, is_hinged=True
    ),
    "frame": Structure(_FRAME, force=(0.0, -1.5)),
}
