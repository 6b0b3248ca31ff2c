"""What says how far a step along an equilibrium path goes: load, displacement or arc length."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, Observable
from beamdae.errors import BeamdaeError, short_repr, suggest
from beamdae.results.columns import Header

Array = np.ndarray


class Control(Protocol):
    """A quantity of (x, mu), x = (q, lam), that is given in each step."""

    def value(self, x: Array, mu: float) -> float:
        """What is given."""

    def row(self, x: Array, mu: float) -> tuple[Array, float]:
        """Its derivatives by x and by mu."""


@dataclass(frozen=True)
class LoadControl:
    """The load factor itself."""

    def value(self, x: Array, mu: float) -> float:
        """The factor."""
        return mu

    def row(self, x: Array, mu: float) -> tuple[Array, float]:
        """Its derivatives."""
        return np.zeros_like(x), 1.0


@dataclass(frozen=True)
class ColumnControl:
    """An observed column, a function of positions.

    Attributes
    ----------
    equations
        Those that observe it.
    observable, column
        Which column of which.
    time
        (t, branch).
    """

    equations: EquationsOfMotion
    observable: Observable
    column: int
    time: Array

    @classmethod
    def of(cls, equations: EquationsOfMotion, name: str, time: Array) -> ColumnControl:
        """The column of that name, with or without its unit.

        Raises
        ------
        BeamdaeError
            If there is none, or it does not follow from positions.
        """
        known: dict[str, tuple[Observable, int]] = {}
        for observable in equations.observables:
            for k, header in enumerate(observable.headers):
                told = Header.of(header)
                if observable.rows.stop > observable.rows.start or told.suffix.endswith("_dot"):
                    continue
                known[header] = known[header.rpartition(" [")[0]] = (observable, k)
        if name not in known:
            places = ", ".join(x for x in known if not x.endswith("]")) or "none is observed"
            raise BeamdaeError(
                f"equilibrium: there is no observed position {short_repr(name)}{suggest(name, known)}, "
                f"of {places}."
            )
        return cls(equations, *known[name], time)

    @property
    def header(self) -> str:
        """Of the column."""
        return self.observable.headers[self.column]

    @cached_property
    def _gradient(self):  # type: ignore[no-untyped-def]
        return self.observable.function.derivative(1)

    def _inputs(self, x: Array) -> tuple[Array, ...]:
        o = self.observable
        local = np.asarray(o.operator @ x[: self.equations.n])[None]
        held = np.zeros((1, o.rows.stop - o.rows.start))
        return self.time[None], local, np.zeros_like(local), self.equations.p[o.data], held

    def value(self, x: Array, mu: float) -> float:
        """The column."""
        return float(self.observable.function(*self._inputs(x))[0, self.column])

    def row(self, x: Array, mu: float) -> tuple[Array, float]:
        """Its derivatives."""
        found = np.zeros_like(x)
        rows = self._gradient(*self._inputs(x)).reshape(-1, len(self.observable.columns))
        found[: self.equations.n] = self.observable.operator.T @ rows[:, self.column]
        return found, 0.0


@dataclass(frozen=True)
class ArcControl:
    """The way along a direction from a point of the path: pseudo arc length (Keller 1977).

    Attributes
    ----------
    x, mu
        The point.
    along, along_mu
        The direction with the weights of the norm, such that the way along the direction itself is
        one.
    """

    x: Array
    mu: float
    along: Array
    along_mu: float

    def value(self, x: Array, mu: float) -> float:
        """How far along."""
        return float(self.along @ (x - self.x) + self.along_mu * (mu - self.mu))

    def row(self, x: Array, mu: float) -> tuple[Array, float]:
        """Its derivatives."""
        return self.along, self.along_mu


@dataclass(frozen=True)
class PathDirection:
    """A direction of a path, or a way along it, of x = (q, lam) and of the factor."""

    x: Array
    mu: float

    def times(self, factor: float) -> PathDirection:
        """So many times as far."""
        return PathDirection(factor * self.x, factor * self.mu)

    def besides(self, other: PathDirection) -> PathDirection:
        """It and another, one after the other."""
        return PathDirection(self.x + other.x, self.mu + other.mu)


@dataclass(frozen=True)
class StepNorm:
    """Sizes of steps: of positions their natural ones, of the factor its own.

    Attributes
    ----------
    scale
        Natural sizes of the coordinates.
    factor
        The change of the factor that counts as much as a motion as large as the mechanism.
    """

    scale: Array
    factor: float

    def largest(self, x: Array, mu: float = 0.0) -> float:
        """The largest share of a change in its size."""
        moved = float(np.max(np.abs(x[: len(self.scale)] / self.scale), initial=0.0))
        return max(moved, abs(mu) / self.factor)

    def row(self, way: PathDirection) -> tuple[Array, float]:
        """What gives, times another way, the product of both."""
        along = np.zeros_like(way.x)
        along[: len(self.scale)] = way.x[: len(self.scale)] / self.scale**2
        return along, way.mu / self.factor**2

    def product(self, one: PathDirection, other: PathDirection) -> float:
        """The product of two ways: zero at right angles, of one with itself its length squared."""
        along, along_mu = self.row(one)
        return float(along @ other.x + along_mu * other.mu)

    def cosine(self, one: PathDirection, other: PathDirection) -> float:
        """Of the angle between two ways."""
        sizes = self.product(one, one) * self.product(other, other)
        return self.product(one, other) / float(np.sqrt(sizes))

    def across(self, way: PathDirection, other: PathDirection) -> PathDirection:
        """The part of a way that is at right angles to another."""
        share = self.product(other, way) / self.product(other, other)
        return way.besides(other.times(-share))

    def arc(self, x: Array, mu: float, way: PathDirection) -> ArcControl:
        """Control of the way along a direction."""
        one = self.product(way, way)
        along, along_mu = self.row(way)
        return ArcControl(x, mu, along / one, along_mu / one)
