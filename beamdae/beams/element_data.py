"""The numbers of one element, and where they stand among its data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from beamdae.symbolic.statements import SX

SECTION = ("EA", "GA", "EI", "rhoA", "rhoI", "damping")
# Behind those of the points, where the section varies.
INERTIA, ELASTICITY = ("rhoA", "rhoI"), ("EA", "GA", "EI", "damping")


@dataclass(frozen=True)
class Layout:
    """How many numbers an element has, of what.

    Attributes
    ----------
    mass_points, stiffness_points
        How many there are of each.
    mass_point, stiffness_point
        What the formulation has of each, the weight first.
    varying
        Whether each point has section values of its own behind these.
    """

    mass_points: int
    stiffness_points: int
    mass_point: tuple[str, ...]
    stiffness_point: tuple[str, ...]
    varying: bool

    @property
    def per_mass_point(self) -> int:
        """Numbers of an inertia point."""
        return len(self.mass_point) + len(INERTIA) * self.varying

    @property
    def per_stiffness_point(self) -> int:
        """Numbers of a stiffness point."""
        return len(self.stiffness_point) + len(ELASTICITY) * self.varying

    @property
    def of_points(self) -> tuple[int, int]:
        """Numbers of all inertia points, and of all stiffness points."""
        mass = self.mass_points * self.per_mass_point
        return mass, self.stiffness_points * self.per_stiffness_point

    @property
    def size(self) -> int:
        """Numbers of an element, gravity included."""
        return sum(self.of_points) + (0 if self.varying else len(SECTION)) + 2

    def split(self, data: SX) -> Data:
        """The data of a kernel as what they are; `data` may hold more behind them."""
        mass, stiffness = self.of_points
        return Data(
            self.varying,
            ca.reshape(data[:mass], self.per_mass_point, self.mass_points),
            ca.reshape(
                data[mass : mass + stiffness], self.per_stiffness_point, self.stiffness_points
            ),
            data[mass + stiffness : self.size - 2],
            data[self.size - 2 : self.size],
        )


@dataclass(frozen=True, eq=False)
class Data:
    """The numbers of one element: a column a point, values of the section, gravity."""

    varying: bool
    mass: Any
    stiffness: Any
    section: Any
    gravity: Any

    def inertia(self, k: int) -> SX:
        """(rhoA, rhoI) at an inertia point."""
        return self.mass[-2:, k] if self.varying else self.section[3:5]

    def elasticity(self, k: int) -> SX:
        """(EA, GA, EI) at a stiffness point."""
        return self.stiffness[-4:-1, k] if self.varying else self.section[:3]

    def damping(self, k: int) -> SX:
        """Retardation time at a stiffness point."""
        return self.stiffness[-1, k] if self.varying else self.section[5]
