"""Steady rotation: everything turns about one point at a constant speed, ground and all."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import require_finite, require_point

Array = np.ndarray

_PLACES, _ANGLES = re.compile(r"([xy])(\d*)"), re.compile(r"(?:angle|theta|psi)\d*")


@dataclass(frozen=True)
class Rotation:
    """A steady rotation at `speed` [rad/s] about the point `center` [m]; see `rotation`."""

    speed: float
    center: tuple[float, float] = (0.0, 0.0)


def rotation(speed: float, center: tuple[float, float] = (0.0, 0.0)) -> Rotation:
    """State of `modes` and `linearize`: all of a mechanism turns about a point at one speed.

    The ground is a turntable: what joints tie to it turns with it, and drivers hold what they hold
    at t = 0 relative to it. Coordinates are those an observer sees who turns as well, so that
    frequencies are what a strain gauge on the mechanism measures. Forces must turn with it: weight,
    loads of fixed direction, and springs and dampers to the ground off the center are refused.

    Parameters
    ----------
    speed
        Angular speed [rad/s], counter-clockwise positive.
    center
        The point of the drawing it turns about [m].

    Examples
    --------
    >>> import beamdae as bd
    >>> bd.rotation(6.0)
    Rotation(speed=6.0, center=(0.0, 0.0))
    """
    return Rotation(
        require_finite("rotation", "speed", speed), require_point("rotation", "center", center)
    )


@dataclass(frozen=True)
class Turning:
    """How coordinates follow when everything turns: q = c + D (z - c) + angle * e.

    D turns the pairs (x, y), the angles grow by the angle, and what is measured within a body
    stays; z are the coordinates seen by an observer who turns as well.

    Attributes
    ----------
    n
        Number of coordinates.
    x, y
        Which coordinates are places, a pair each.
    angles
        Which are angles in the inertial frame.
    """

    n: int
    x: Array
    y: Array
    angles: Array

    @classmethod
    def of(cls, e: EquationsOfMotion) -> Turning:
        """By the names of coordinates: x and y, angle, theta or psi, perhaps numbered."""
        x, y, angles = [], [], []
        index = {name: k for k, name in enumerate(e.q_names)}
        for name, k in index.items():
            part, dot, own = name.rpartition(".")
            place = _PLACES.fullmatch(own)
            if place and place[1] == "x" and f"{part}{dot}y{place[2]}" in index:
                x.append(k)
                y.append(index[f"{part}{dot}y{place[2]}"])
            elif _ANGLES.fullmatch(own) and e.coordinates[k].unit == "rad":
                angles.append(k)
        return cls(e.n, *(np.array(found, int) for found in (x, y, angles)))

    @property
    def moves(self) -> bool:
        """Whether anything turns at all."""
        return bool(len(self.x) or len(self.angles))

    def operator(self, angle: float) -> sp.csr_array:
        """D, (n, n)."""
        kept = np.ones(self.n)
        kept[self.x] = kept[self.y] = np.cos(angle)
        return sp.csr_array(sp.diags_array(kept) + np.sin(angle) * self.generator)

    @property
    def generator(self) -> sp.csr_array:
        """S = dD/d(angle) at 0, which D is the exponential of on the places."""
        ones = np.ones(len(self.x))
        entries = np.concatenate([ones, -ones])
        at = (np.concatenate([self.y, self.x]), np.concatenate([self.x, self.y]))
        return sp.csr_array((entries, at), shape=(self.n, self.n))

    def center(self, place: tuple[float, float]) -> Array:
        """c, (n,): the place in all pairs."""
        found = np.zeros(self.n)
        found[self.x], found[self.y] = place
        return found

    @property
    def spin(self) -> Array:
        """e, (n,): one for each angle."""
        found = np.zeros(self.n)
        found[self.angles] = 1.0
        return found

    def travel(self, axis: int) -> Array:
        """Rate of all coordinates when everything travels along x (0) or y (1), (n,)."""
        found = np.zeros(self.n)
        found[(self.x, self.y)[axis]] = 1.0
        return found
