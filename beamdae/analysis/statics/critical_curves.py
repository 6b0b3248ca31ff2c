"""Curves of limit and branch points in the load factor and one parameter of a model.

A critical point solves F(x, mu, p) = 0, g = 0, where F_x is singular if and only if g is zero. g
follows from F_x bordered by vectors b and c (Griewank & Reddien, SIAM J. Numer. Anal. 21
(1984) 176; Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria, SIAM (2000)):

    [F_x b; c^T 0] [v; g] = [0; 1],   [F_x b; c^T 0]^T [w; g] = [0; 1],   dg = -w^T dF_x v.

At a branch point, F_mu is in the range of F_x, so that F = 0 does not determine the motion in the
mode v. This motion is therefore kept constant, and an unknown multiple of b is added to F, which is
zero for symmetric structures (Werner & Spence, SIAM J. Numer. Anal. 21 (1984) 388). This system is
regular also where two branch points merge.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.linalg as la

from beamdae.analysis.statics.corrector import Corrector, CorrectorError, EquilibriumPoint
from beamdae.analysis.statics.critical_points import BRANCH
from beamdae.analysis.statics.load_scaling import LoadedEquations
from beamdae.analysis.statics.null_vectors import natural_scales
from beamdae.errors import BeamdaeError

Array = np.ndarray

_MAX_ITERATIONS = 12
# Newton corrections in units of the natural sizes, of the load factor at the start, and of the
# range of the parameter.
_CONVERGENCE_TOLERANCE = 1e-9
_STAGNATION_TOLERANCE = 1e-6
_STAGNATION_RATIO = 0.1
_DIVERGENCE_LIMIT = 0.5
# Differences of the tangent along a mode, in natural sizes, and of the equations over the
# parameter, relative to its range. They affect the convergence only, not the result.
_MODE_DIFFERENCE = 1e-4
_PARAMETER_DIFFERENCE = 1e-6
# Lower bound, in natural sizes, of the motion to which motions along a curve are relative.
_MIN_MOTION = 1e-3
# Weight of relative changes of the load factor, which are less curved than changes of shape.
_LOAD_WEIGHT = 0.2
# Models kept for parameters that are evaluated again.
_MAX_MODELS = 8


class Member(NamedTuple):
    """Static equations for one value of the parameter.

    Attributes
    ----------
    system
        The equations.
    reference
        Unknowns (n + m,) of the drawing, to which displacements are relative.
    """

    system: LoadedEquations
    reference: Array


@dataclass
class Family:
    """Static equations as a function of a parameter.

    Attributes
    ----------
    build
        Function of the parameter that returns the equations.
    """

    build: Callable[[float], LoadedEquations]
    _members: dict[float, Member] = field(default_factory=dict)

    def at(self, p: float) -> Member:
        """Return the equations for the value `p` of the parameter.

        Raises
        ------
        CorrectorError
            If the model cannot be built, or has another number of unknowns.
        """
        if p not in self._members:
            try:
                system = self.build(p)
            except BeamdaeError as error:
                raise CorrectorError(f"the model cannot be built ({error})") from None
            e = system.equations
            member = Member(system, np.append(e.q0, np.zeros(e.m)))
            others = iter(self._members.values())
            if any(len(other.reference) != len(member.reference) for other in others):
                raise CorrectorError("the parameter changes the number of coordinates or joints")
            if len(self._members) >= _MAX_MODELS:
                del self._members[next(iter(self._members))]
            self._members[p] = member
        return self._members[p]


class CurvePoint(NamedTuple):
    """Point of a curve: displacements from the drawing (n + m,), load factor and parameter."""

    u: Array
    mu: float
    p: float


class _Linearization(NamedTuple):
    """Residuals of the extended system and their derivatives, scaled.

    The unknowns are u, mu, p and, for branch points, the multiple of b in F.
    """

    residual: Array
    jacobian: Array
    left: Array
    right: Array
    by_parameter: tuple[Array, float]


@dataclass
class CriticalCurve:
    """Extended system of limit or branch points.

    Attributes
    ----------
    family
        Static equations as a function of the parameter.
    kind
        `LIMIT` or `BRANCH`.
    limits
        First and last value of the parameter.
    start
        Critical point from which the curve begins; it determines the scales.
    """

    family: Family
    kind: str
    limits: tuple[float, float]
    start: CurvePoint
    _equilibrium: tuple[CurvePoint, EquilibriumPoint] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        left, _, right = la.svd(self._matrices(self.start)[0])
        self._left, self._right = left[:, -1], right[-1]

    @cached_property
    def _corrector(self) -> Corrector:
        return Corrector(self.family.at(self.start.p).system)

    @cached_property
    def _scales(self) -> tuple[Array, float, float, float]:
        """Scales of the unknowns, the load factor, the parameter and the residual."""
        unknowns, energy = natural_scales(*self._state(self.start), self.start.mu)
        parameter = abs(self.limits[1] - self.limits[0])
        return unknowns, abs(self.start.mu) or 1.0, parameter, energy

    def _state(self, point: CurvePoint) -> tuple[LoadedEquations, Array]:
        member = self.family.at(point.p)
        return member.system, member.reference + point.u

    def equilibrium(self, point: CurvePoint) -> EquilibriumPoint:
        """Return the equilibrium at a point of the curve; the last one keeps its stability."""
        if self._equilibrium is None or self._equilibrium[0] is not point:
            system, x = self._state(point)
            self._equilibrium = (point, EquilibriumPoint(system, x, point.mu))
        return self._equilibrium[1]

    def _matrices(self, point: CurvePoint) -> tuple[Array, Array]:
        """Return the scaled F_x and F_mu."""
        system, x = self._state(point)
        unknowns, factor, _, energy = self._scales
        tangent = system.matrix(system.tangent(x, point.mu)).toarray()
        by_factor = system.residual(x, point.mu)[1]
        scaled = unknowns[:, None] * tangent * unknowns / energy
        return scaled, unknowns * by_factor * factor / energy

    def _residual(self, point: CurvePoint) -> Array:
        system, x = self._state(point)
        unknowns, _, _, energy = self._scales
        return unknowns * system.residual(x, point.mu)[0] / energy

    def _displace(self, point: CurvePoint, change: Array) -> CurvePoint:
        """Return the point displaced by a scaled change of (u, mu, p)."""
        unknowns, factor, parameter, _ = self._scales
        reference, size = self.family.at(point.p).reference, len(point.u)
        x = self._corrector.displace(reference + point.u, unknowns * change[:size])
        return CurvePoint(
            x - reference,
            point.mu + factor * float(change[size]),
            point.p + parameter * float(change[size + 1]),
        )

    def _linearize(
        self, point: CurvePoint, by_parameter: tuple[Array, float] | None = None
    ) -> _Linearization:
        """Return the linearization; `by_parameter` are known derivatives with respect to p."""
        size, is_branch = len(point.u), self.kind == BRANCH
        tangent, by_factor = self._matrices(point)
        bordered = np.zeros((size + 1, size + 1))
        bordered[:size, :size] = tangent
        bordered[:size, -1], bordered[-1, :size] = self._left, self._right
        unit = np.append(np.zeros(size), 1.0)
        try:
            solver = la.lu_factor(bordered)
            right = la.lu_solve(solver, unit)
            left = la.lu_solve(solver, unit, trans=1)[:size]
        except (la.LinAlgError, ValueError):
            raise CorrectorError("the bordered tangent is singular") from None
        mode, test = right[:size], right[-1]
        step = _MODE_DIFFERENCE / max(np.max(np.abs(mode)), np.finfo(float).tiny)
        motion, load = np.append(step * mode, [0.0, 0.0]), np.zeros(size + 2)
        ahead, behind = (self._matrices(self._shift(point, x))[0] for x in (motion, -motion))
        load[size] = 1.0
        # The tangent is linear in the load factor.
        loaded = self._matrices(self._shift(point, load))[0]
        by_parameter = by_parameter or self._parameter_derivative(point, left, mode)
        jacobian = np.zeros((size + 1 + is_branch, size + 2 + is_branch))
        jacobian[:size, :size], jacobian[:size, size] = tangent, by_factor
        jacobian[:size, size + 1] = by_parameter[0]
        jacobian[size, :size] = -left @ (ahead - behind) / (2.0 * step)
        jacobian[size, size] = -left @ (loaded - tangent) @ mode
        jacobian[size, size + 1] = by_parameter[1]
        residual = np.append(self._residual(point), test)
        if is_branch:
            jacobian[:size, -1], jacobian[-1, :size] = self._left, self._right
            residual = np.append(residual, 0.0)
        return _Linearization(residual, jacobian, left, mode, by_parameter)

    def _shift(self, point: CurvePoint, change: Array) -> CurvePoint:
        """Return the point shifted linearly, for differences."""
        unknowns, factor, _, _ = self._scales
        size = len(point.u)
        return CurvePoint(
            point.u + unknowns * change[:size],
            point.mu + factor * float(change[size]),
            point.p,
        )

    def _parameter_derivative(
        self, point: CurvePoint, left: Array, mode: Array
    ) -> tuple[Array, float]:
        """Return the derivatives of F and g with respect to the scaled parameter."""
        parameter = self._scales[2]
        # A step towards the inside, because the model may not exist beyond the limits.
        share = _PARAMETER_DIFFERENCE if point.p < np.mean(self.limits) else -_PARAMETER_DIFFERENCE
        near = point._replace(p=point.p + share * parameter)
        residual = (self._residual(near) - self._residual(point)) / share
        change = self._matrices(near)[0] - self._matrices(point)[0]
        return residual, float(-left @ change @ mode) / share

    def correct(self, point: CurvePoint, row: Array) -> CurvePoint:
        """Return the critical point near `point` in the plane through it with the normal `row`.

        `row`, (n + m + 2,), is scaled as the unknowns u, mu and p.

        Raises
        ------
        CorrectorError
            If Newton's method fails.
        """
        last_size, by_parameter, slowest = _DIVERGENCE_LIMIT, None, 0.0
        for _ in range(_MAX_ITERATIONS):
            # The derivative with respect to p requires another model, and changes little.
            linearization = self._linearize(point, by_parameter)
            by_parameter = linearization.by_parameter
            change = self._solve(linearization.jacobian, row, np.append(-linearization.residual, 0))
            n, unknowns = self._corrector.system.equations.n, len(point.u)
            size = float(np.max(np.abs(np.append(change[:n], change[unknowns : unknowns + 2]))))
            ratio = size / last_size
            if not (ratio <= 1.0 or size <= _STAGNATION_TOLERANCE):
                raise CorrectorError("Newton's method diverges")
            point = self._displace(point, change)
            stagnates = size <= _STAGNATION_TOLERANCE and ratio > _STAGNATION_RATIO
            # The next correction would be smaller by at least the largest ratio so far.
            slowest = max(slowest, ratio)
            if size * min(slowest, 1.0) <= _CONVERGENCE_TOLERANCE or stagnates:
                self._left = linearization.left / np.linalg.norm(linearization.left)
                self._right = linearization.right / np.linalg.norm(linearization.right)
                return point
            last_size = size
        raise CorrectorError("Newton's method did not converge")

    def tangent(self, point: CurvePoint, row: Array) -> Array:
        """Return the direction of the curve (n + m + 2,), scaled, with a positive part along `row`.

        The largest weighted entry is 1.

        Raises
        ------
        CorrectorError
            If the direction is not unique.
        """
        jacobian = self._linearize(point).jacobian
        unit = np.append(np.zeros(len(jacobian)), 1.0)
        direction = self._solve(jacobian, row, unit)[: len(row)]
        return direction / np.max(np.abs(self._weights(point) * direction))

    def _solve(self, jacobian: Array, row: Array, right: Array) -> Array:
        last = np.zeros(jacobian.shape[1])
        last[: len(row)] = row
        try:
            with warnings.catch_warnings():
                # Corrections and the direction of the curve are checked by the caller.
                warnings.simplefilter("ignore", la.LinAlgWarning)
                solution = la.solve(np.vstack([jacobian, last]), right)
        except (la.LinAlgError, ValueError):
            raise CorrectorError("the extended system is singular") from None
        if not np.all(np.isfinite(solution)):
            raise CorrectorError("the extended system is singular")
        return solution

    @cached_property
    def _motion(self) -> float:
        """Motion from the drawing to the start, in natural sizes, within bounds."""
        n = self._corrector.system.equations.n
        motion = float(np.max(np.abs(self.start.u[:n] / self._scales[0][:n]), initial=0.0))
        return min(max(motion, _MIN_MOTION), 1.0)

    def _weights(self, point: CurvePoint) -> Array:
        """Return the weights of the scaled unknowns u, mu and p in distances near a point.

        Motions are relative to the motion from the drawing to the start, changes of the load factor
        to its value at `point` or at the start. Multipliers have the weight 0.
        """
        n, size = self._corrector.system.equations.n, len(point.u)
        weights = np.zeros(size + 2)
        weights[:n] = 1.0 / self._motion
        weights[size] = _LOAD_WEIGHT / max(abs(point.mu) / self._scales[1], 1.0)
        weights[size + 1] = 1.0
        return weights

    def predict(self, point: CurvePoint, direction: Array, size: float) -> CurvePoint:
        """Return the point at the distance `size` along `direction`."""
        return self._displace(point, size * direction)

    def plane(self, point: CurvePoint, direction: Array) -> Array:
        """Return the normal of the plane through a point across `direction`."""
        row = self._weights(point) ** 2 * direction
        return row / np.linalg.norm(row)

    def cosine(self, point: CurvePoint, one: Array, other: Array) -> float:
        """Return the cosine of the angle between two directions near a point."""
        one, other = (self._weights(point) * direction for direction in (one, other))
        return float(one @ other / (np.linalg.norm(one) * np.linalg.norm(other)))

    @property
    def parameter_plane(self) -> Array:
        """Normal of the plane of constant parameter."""
        row = np.zeros(len(self.start.u) + 2)
        row[-1] = 1.0
        return row
