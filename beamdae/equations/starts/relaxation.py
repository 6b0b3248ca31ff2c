"""Static equilibrium, possibly far from the start, by implicit steps along a gradient flow."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil
from typing import NamedTuple, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.rigid_motions import DisplacementMeasure
from beamdae.errors import BeamdaeError, list_first

Array = np.ndarray

_MAX_NAMES = 3  # of parts with friction in a message

# Step sizes, in units of `position_scales`.
_MAX_STEP = 0.2  # small enough to close the joints by Newton's method
_MAX_TRAVEL_SIZES = 1e4  # limit of the travel to which steps are relative
_CONVERGED_STEP = 1e-10

# Steps by which joints that are open in the first positions are closed, relative to their scales:
# short, so that no contact is passed; if there are more than a number, longer ones.
_CLOSING_STEP = 0.01
_CLOSING_STEPS = 100
_MAX_CLOSING_STEP = 0.1

# Iterations of Newton's method in a step.
_MAX_ITERATIONS = 10
_ITERATION_TOLERANCE = 1e-3  # last change, relative to the step
_SHARE_REDUCTION = 0.25
# Of a change; penetrations of stiff contacts are small relative to their motion.
_SMALLEST_SHARE = 1e-8

# Squared pseudo-time of the flow.
_FIRST_STEP = 0.01  # displacement by the initial accelerations in the first step
_LAST_SQUARE_RATIO = 1e11  # upper bound, relative to the first
_SMALLEST_SQUARE_RATIO = 1e-26  # relative to the first; below this, the search fails
_SQUARE_GROWTH = 4.0
_MAX_STEPS = 400

# Sensitivity to rounding: the change of a step when positions are perturbed by rounding.
_PERTURBATION = 1e-14  # relative to the coordinate and the size of its part
_RELIABLE_ROUNDING = 1e-9
_MAX_ROUNDING_RATIO = 10.0  # steps above this multiple of `_RELIABLE_ROUNDING` are unreliable
_CONVERGED_ROUNDING_RATIO = 100.0  # steps below this multiple of their rounding have converged


class StaticSystem(Protocol):
    """Static equations in (q, lam), such as `StaticEquations`."""

    @property
    def equations(self) -> EquationsOfMotion:
        """Equations of motion, which provide the inertia."""

    @property
    def time(self) -> Array:
        """Time as (t, branch)."""

    def residual(self, q: Array, lam: Array) -> Array:
        """Return the residual, (n + m,)."""

    def matrix(self, q: Array, lam: Array) -> sp.csc_array:
        """Return the Jacobian of the residual with respect to (q, lam), sparse (n + m, n + m)."""


class FlowStep(NamedTuple):
    """Step of the gradient flow.

    Attributes
    ----------
    q, lam
        Positions and multipliers at the end of the step.
    size
        Largest displacement in the step, relative to the scale of the coordinate plus its travel
        since the start; for angles, relative to the scale alone.
    rounding
        Change of the step due to rounding, in the same relative measure; large in directions
        without stiffness.
    """

    q: Array
    lam: Array
    size: float
    rounding: float

    @property
    def is_steady(self) -> bool:
        """True if the step vanishes up to rounding."""
        return (
            self.size <= max(_CONVERGED_STEP, _CONVERGED_ROUNDING_RATIO * self.rounding)
            and self.rounding <= _MAX_ROUNDING_RATIO * _RELIABLE_ROUNDING
        )


@dataclass(frozen=True)
class GradientFlow:
    """Steps of the implicit Euler method along the gradient flow of a mechanism.

    Newton's method solves each of them. Forces may change abruptly within a step, such as those of
    contacts: each change is shortened until the next one is not larger (natural monotonicity test:
    Deuflhard, Newton Methods for Nonlinear Problems, 2004, section 3.3).

    Attributes
    ----------
    static, solver
        Static equations, and the solver for consistent states of their `equations`.
    begin
        Positions (n,) at which the flow begins.
    gaps
        Gaps (n + m,) by which the joints stay open, with zeros for the forces.
    """

    static: StaticSystem
    solver: ConsistencySolver
    begin: Array
    gaps: Array | float = 0.0

    @cached_property
    def _measure(self) -> DisplacementMeasure:
        return DisplacementMeasure.of(self.static.equations)

    @cached_property
    def _perturbation(self) -> Array:
        signs = np.random.default_rng(0).choice([-1.0, 1.0], len(self.begin))
        # Parts may be far smaller than the mechanism.
        sizes = np.maximum(np.abs(self.begin), self.static.equations.part_scales)
        # States of fast filters are far smaller than their scale.
        return self.static.equations.without_states(_PERTURBATION * sizes * signs)

    def _initial_acceleration(self) -> tuple[Array, Array]:
        """Return the acceleration (n,) and the multipliers (m,) at rest in `begin`.

        Both follow from the forces of `static`, which may be a fraction of those in
        `static.equations`.
        """
        q, rates = self.begin, np.zeros(self.static.equations.m)
        force = self.static.residual(q, rates)[: len(q)]
        return self.solver.solve_saddle(self.static.time, q, None, -force, rates)

    def _residual(self, x: Array) -> Array:
        n = len(self.begin)
        return self.static.residual(x[:n], x[n:]) - self.gaps

    def _try_step(self, q: Array, lam: Array, square: float) -> FlowStep | None:
        """Return a step of pseudo-time T with T^2 = `square`.

        Returns None if a matrix is singular, `size` exceeds `_MAX_STEP`, or the iterations do not
        converge.
        """
        static, measure, n, m = self.static, self._measure, len(q), len(lam)
        mass = self.solver.mass_matrix(static.time, q)
        # No inertia in the rows and columns of the multipliers.
        ends = np.append(mass.indptr, np.full(m, mass.indptr[-1]))
        entries = (mass.data * (1.0 / square), mass.indices, ends)
        weight = sp.csc_array(entries, shape=(n + m, n + m))
        way = np.minimum(measure.distances(q - self.begin), _MAX_TRAVEL_SIZES * measure.scale)
        sizes = measure.scale + np.where(static.equations.is_angle, 0.0, way)

        def size(change: Array) -> float:
            return float(np.max(measure.distances(change[:n]) / sizes))

        def unbalance(total: Array) -> Array:
            return self._residual(origin + total) + weight @ total

        origin, total = np.concatenate([q, lam]), np.zeros(n + m)
        for _ in range(_MAX_ITERATIONS):
            last = origin + total
            forces = self._residual(last)
            try:
                solve = splu(sp.csc_array(static.matrix(last[:n], last[n:]) + weight)).solve
            except RuntimeError:
                return None
            change = -solve(forces + weight @ total)
            change_size, share = size(change), 1.0
            while not size(solve(unbalance(total + share * change))) <= change_size:
                share *= _SHARE_REDUCTION
                if share < _SMALLEST_SHARE:
                    return None
            total = total + share * change
            step_size = size(total)
            if not step_size <= _MAX_STEP:
                return None
            if change_size <= max(_ITERATION_TOLERANCE * step_size, _CONVERGED_STEP):
                moved = last + np.append(self._perturbation, np.zeros(m))
                rounding = size(solve(self._residual(moved) - forces))
                end = origin + total
                return FlowStep(end[:n], end[n:], step_size, rounding)
        return None

    def follow(self, near: Array | None = None) -> tuple[Array, Array, bool]:
        """Return the positions and multipliers at the end, and True if they are steady.

        With the multipliers `near` of an equilibrium close by, the first step is the longest.
        """
        q, (a, lam) = self.begin, self._initial_acceleration()
        acceleration = self._measure.farthest(a)
        if acceleration == 0.0 and near is None:
            return q, lam, True
        square = first = _FIRST_STEP / (acceleration or 1.0)
        last = _LAST_SQUARE_RATIO * first
        if near is not None:
            square, lam = last, near
        is_last_tried = False
        for _ in range(_MAX_STEPS):
            step = self._try_step(q, lam, square)
            if step is None:
                square /= _SQUARE_GROWTH
                if square < _SMALLEST_SQUARE_RATIO * first:
                    break
                continue
            if step.is_steady and square < last and not is_last_tried:
                # At an equilibrium, the steps up to the last one would only repeat rounding errors.
                is_last_tried = True
                final = self._try_step(step.q, step.lam, last)
                if final is not None and final.is_steady:
                    step, square = final, last
            q, lam = step.q, step.lam
            is_last = square >= last or step.rounding > _RELIABLE_ROUNDING
            if step.is_steady and is_last:
                return q, lam, True
            if step.rounding <= _RELIABLE_ROUNDING:
                square = min(square * _SQUARE_GROWTH, last)
            elif step.rounding > _MAX_ROUNDING_RATIO * _RELIABLE_ROUNDING:
                square /= _SQUARE_GROWTH
        return q, lam, False


def relax_to_equilibrium(
    static: StaticSystem, q: Array, passed: list[Array] | None = None
) -> tuple[Array, Array]:
    """Return positions (n,) and multipliers (m,) of an equilibrium reached from `q`.

    Implicit steps follow the gradient flow. Newton's method for a step has the matrix

        [[M / T^2 + K, G^T], [G, 0]],

    where K is the stiffness of F + G^T lam. Short pseudo-times T keep steps small and lead to
    stable equilibria; long pseudo-times converge quadratically. The step size does not depend on
    the orientation of the mechanism. Joints that are open at `q`, because drivers begin beside the
    drawing, are closed in short steps through equilibria, so that no contact is passed. Equilibria
    at which joints are still open are appended to `passed`.

    Raises
    ------
    BeamdaeError
        If there is no consistent state at rest near `q` (see `ConsistencySolver.state`), or no
        equilibrium is found. In the second case, the message names the coordinate that moved
        farthest.
    """
    e, solver = static.equations, ConsistencySolver(static.equations)
    begin = np.array(q)
    gaps = static.residual(q, np.zeros(e.m))
    gaps[: e.n] = 0.0
    size = float(np.max(np.abs(gaps[e.n :]) / e.constraint_scales, initial=0.0))
    count = max(min(ceil(size / _CLOSING_STEP), _CLOSING_STEPS), ceil(size / _MAX_CLOSING_STEP))
    lam: Array | None = None
    for share in np.linspace(1.0, 0.0, count + 1)[:-1]:
        q, lam, is_steady = GradientFlow(static, solver, q, share * gaps).follow(lam)
        if not is_steady:
            q = begin
            break
        if passed is not None:
            passed.append(q)
    begin = solver.state(static.time, q, np.zeros(e.n)).q
    q, lam, is_steady = GradientFlow(static, solver, begin).follow()
    if is_steady:
        return q, lam
    displacement = np.abs(q - begin)
    worst = int(np.argmax(displacement / e.position_scales))
    sliding = list_first([*e.frictions], _MAX_NAMES)
    reason = f", because the friction of {sliding} is zero at rest" if sliding else ""
    raise BeamdaeError(
        f"{e.q_names[worst]}: no equilibrium was found under the loads at t = "
        f"{static.time[0]:g} s, and this coordinate moved farthest (by {displacement[worst]:.3g} "
        f"{e.coordinates[worst].unit}); if it moves without limit, add a joint or a spring{reason}."
    )


def find_nearby_equilibrium(static: StaticSystem, q: Array) -> tuple[Array, Array] | None:
    """Return positions (n,) and multipliers (m,) of the equilibrium near `q`, or None.

    The first step is Newton's; if it is too long, shorter ones follow the gradient flow.
    """
    flow = GradientFlow(static, ConsistencySolver(static.equations), q)
    q, lam, is_steady = flow.follow(np.zeros(static.equations.m))
    return (q, lam) if is_steady else None
