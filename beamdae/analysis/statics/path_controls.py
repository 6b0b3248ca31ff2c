"""Step controls along an equilibrium path: load, displacement or arc length."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, Observable
from beamdae.errors import BeamdaeError, short_repr, suggest
from beamdae.results.columns import Header, remove_unit

Array = np.ndarray


class Control(Protocol):
    """Function of x = (q, lam) and the load factor mu whose value is prescribed in each step.

    Attributes
    ----------
    is_linear
        True if `linearize` does not depend on its arguments.
    """

    @property
    def is_linear(self) -> bool:
        """See above."""

    def value(self, x: Array, mu: float) -> float:
        """Return the value of the control at (x, mu)."""

    def gradient(self, x: Array, mu: float) -> tuple[Array, float]:
        """Return the derivatives with respect to x, (n + m,), and mu."""

    def linearize(self, x: Array, mu: float) -> LinearControl:
        """Return the linear control with the same value and gradient at (x, mu)."""


@dataclass(frozen=True)
class LoadControl:
    """Load control: prescribes the load factor."""

    is_linear: ClassVar[bool] = True

    def value(self, x: Array, mu: float) -> float:
        """Return the load factor mu."""
        return mu

    def gradient(self, x: Array, mu: float) -> tuple[Array, float]:
        """Return the derivatives with respect to x and mu: (0, 1)."""
        return np.zeros_like(x), 1.0

    def linearize(self, x: Array, mu: float) -> LinearControl:
        """Return the load factor as a linear control."""
        return LinearControl(x, 0.0, np.zeros_like(x), 1.0)


@dataclass(frozen=True)
class DisplacementControl:
    """Displacement control: prescribes an observed column that is a function of positions.

    Attributes
    ----------
    equations
        Equations with the observable.
    observable, column
        Observable, and index of its column.
    time
        (t, branch).
    """

    equations: EquationsOfMotion
    observable: Observable
    column: int
    time: Array

    @classmethod
    def from_name(cls, equations: EquationsOfMotion, name: str, time: Array) -> DisplacementControl:
        """Return the control for the column `name`, which may include the unit.

        Raises
        ------
        BeamdaeError
            If there is no such column, or it depends on velocities or reactions.
        """
        positions: dict[str, tuple[Observable, int]] = {}
        for observable in equations.observables:
            for k, header in enumerate(observable.headers):
                has_reactions = observable.rows.stop > observable.rows.start
                if (
                    has_reactions
                    or observable.has_accelerations
                    or Header.of(header).suffix.endswith("_dot")
                ):
                    continue
                positions[header] = positions[remove_unit(header)] = (observable, k)
        if name not in positions:
            names = ", ".join(x for x in positions if not x.endswith("]")) or "none"
            raise BeamdaeError(
                "equilibrium: to must name an observed position, got "
                f"{short_repr(name)}{suggest(name, positions)}; observe this position, or name an "
                f"observed one (observed: {names})."
            )
        switching = equations.configurations
        inactive = frozenset() if switching is None else switching.initially_inactive
        return cls(equations.without_loads_of(inactive), *positions[name], time)

    @cached_property
    def is_linear(self) -> bool:
        """True if the column is linear in the coordinates, as coordinates of nodes are."""
        return self.observable.function.is_linear_in(1, self.column)

    @cached_property
    def _position_derivative(self):  # type: ignore[no-untyped-def]
        return self.observable.function.derivative(1)

    def _arguments(self, x: Array) -> tuple[Array, ...]:
        o = self.observable
        local = np.asarray(o.operator @ x[: self.equations.n])[None]
        reactions = np.zeros((1, o.rows.stop - o.rows.start))
        return self.time[None], local, np.zeros_like(local), self.equations.p[o.data], reactions

    def value(self, x: Array, mu: float) -> float:
        """Return the value of the column at (x, mu), in the unit of the column."""
        return float(self.observable.function(*self._arguments(x))[0, self.column])

    def gradient(self, x: Array, mu: float) -> tuple[Array, float]:
        """Return the derivatives of the column with respect to x and mu; the latter is zero."""
        by_x = np.zeros_like(x)
        rows = self._position_derivative(*self._arguments(x))
        by_local = rows.reshape(-1, len(self.observable.columns))[:, self.column]
        by_x[: self.equations.n] = self.observable.operator.T @ by_local
        return by_x, 0.0

    def linearize(self, x: Array, mu: float) -> LinearControl:
        """Return the tangent of the column at (x, mu)."""
        return LinearControl(x, mu, *self.gradient(x, mu), self.value(x, mu))


@dataclass(frozen=True)
class LinearControl:
    """Linear control, such as the pseudo-arc length: distance along a direction (Keller 1977).

    Attributes
    ----------
    x, mu
        Point from which distances are measured.
    along, along_mu
        Weights of x and mu. Those of the arc length are scaled so that a step equal to the
        direction has length one.
    at_origin
        Value at the point.
    """

    x: Array
    mu: float
    along: Array
    along_mu: float
    at_origin: float = 0.0
    is_linear: ClassVar[bool] = True

    def value(self, x: Array, mu: float) -> float:
        """Return the value at (x, mu)."""
        change = self.along @ (x - self.x) + self.along_mu * (mu - self.mu)
        return self.at_origin + float(change)

    def gradient(self, x: Array, mu: float) -> tuple[Array, float]:
        """Return the weights of x and mu."""
        return self.along, self.along_mu

    def linearize(self, x: Array, mu: float) -> LinearControl:
        """Return this control."""
        return self


@dataclass(frozen=True)
class PathDirection:
    """Direction or increment along a path, in x = (q, lam), (n + m,), and the load factor mu."""

    x: Array
    mu: float

    def scale(self, factor: float) -> PathDirection:
        """Return the direction times `factor`."""
        return PathDirection(factor * self.x, factor * self.mu)

    def add(self, other: PathDirection) -> PathDirection:
        """Return the sum of two directions."""
        return PathDirection(self.x + other.x, self.mu + other.mu)


@dataclass(frozen=True)
class StepNorm:
    """Dimensionless norms and inner products of path increments; multipliers are ignored.

    Attributes
    ----------
    scale
        Natural sizes of the coordinates, (n,).
    factor
        Change of the load factor that is equivalent to a motion by the size of the mechanism;
        infinite to ignore the load factor.
    """

    scale: Array
    factor: float

    def max_norm(self, x: Array, mu: float = 0.0) -> float:
        """Return the largest absolute entry of q / `scale` and mu / `factor`, for x = (q, lam)."""
        by_position = float(np.max(np.abs(x[: len(self.scale)] / self.scale), initial=0.0))
        return max(by_position, abs(mu) / self.factor)

    def dual(self, direction: PathDirection) -> tuple[Array, float]:
        """Return the weights of x, (n + m,), and mu in the inner product with `direction`."""
        along = np.zeros_like(direction.x)
        along[: len(self.scale)] = direction.x[: len(self.scale)] / self.scale**2
        return along, direction.mu / self.factor**2

    def inner_product(self, one: PathDirection, other: PathDirection) -> float:
        """Return the inner product of two directions."""
        along, along_mu = self.dual(one)
        return float(along @ other.x + along_mu * other.mu)

    def cosine(self, one: PathDirection, other: PathDirection) -> float:
        """Return the cosine of the angle between two directions."""
        sizes = self.inner_product(one, one) * self.inner_product(other, other)
        return self.inner_product(one, other) / float(np.sqrt(sizes))

    def displacements_turn(self, one: PathDirection, other: PathDirection, cosine: float) -> bool:
        """Return True if the angle between the displacements of two directions is too large.

        `cosine` is that of the largest angle.
        """
        n = len(self.scale)
        first, second = one.x[:n] / self.scale, other.x[:n] / self.scale
        sizes = np.linalg.norm(first) * np.linalg.norm(second)
        return bool(first @ second < cosine * sizes)

    def orthogonal_part(self, direction: PathDirection, other: PathDirection) -> PathDirection:
        """Return the part of `direction` that is orthogonal to `other`."""
        share = self.inner_product(other, direction) / self.inner_product(other, other)
        return direction.add(other.scale(-share))

    def arc_length_control(self, x: Array, mu: float, direction: PathDirection) -> LinearControl:
        """Return the control that measures the distance from (x, mu) along `direction`."""
        squared_length = self.inner_product(direction, direction)
        along, along_mu = self.dual(direction)
        return LinearControl(x, mu, along / squared_length, along_mu / squared_length)
