"""Static equilibrium, possibly far from the start, by implicit steps along a gradient flow."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil
from typing import NamedTuple, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations.compliant_equations import introduce_resultants
from beamdae.equations.formulations.tangents import Convert
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.rigid_motions import DisplacementMeasure
from beamdae.errors import BeamdaeError, list_first

Array = np.ndarray

# Step sizes, in units of `position_scales`.
_MAX_STEP = 0.2  # small enough to close the joints by Newton's method
_MAX_TRAVEL_SIZES = 1e4  # limit of the travel to which steps are relative
_MAX_GAP_RATIO = 0.5  # correction that closes the joints, relative to the step
_NEGLIGIBLE_GAP = 1e-9
_CONVERGED_STEP = 1e-10

# Steps by which joints that are open in the first positions are closed, relative to their scales:
# short, so that no contact is passed; if there are more than a number, longer ones.
_CLOSING_STEP = 0.01
_CLOSING_STEPS = 100
_MAX_CLOSING_STEP = 0.1

# Iterations of Newton's method in a step of a cautious flow.
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

    def convert(self, change: Convert) -> StaticSystem:
        """Return these static equations of converted equations of motion."""

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
    """Trial step of the gradient flow.

    Attributes
    ----------
    x
        Positions, and multipliers of joints and resultants at the end of the step.
    size
        Largest displacement in the step, relative to the scale of the coordinate plus its travel
        since the start; for angles, relative to the scale alone.
    gap
        Size of the correction that closes the joints after the step, in the same relative measure.
    rounding
        Change of the step due to rounding, in the same relative measure; large in directions
        without stiffness.
    """

    x: Array
    size: float
    gap: float
    rounding: float

    @property
    def is_near(self) -> bool:
        """True if the step is small enough to stay on the same branch of the joints."""
        return self.size <= _MAX_STEP and self.gap <= max(
            _MAX_GAP_RATIO * self.size, _NEGLIGIBLE_GAP
        )

    @property
    def is_steady(self) -> bool:
        """True if the step vanishes up to rounding."""
        return (
            self.size <= max(_CONVERGED_STEP, _CONVERGED_ROUNDING_RATIO * self.rounding)
            and self.rounding <= _MAX_ROUNDING_RATIO * _RELIABLE_ROUNDING
        )


@dataclass(frozen=True)
class GradientFlow:
    """Implicit steps along the gradient flow of a mechanism.

    A step is one iteration of Newton's method for the implicit Euler method. A cautious flow, for
    forces that change abruptly within steps, such as those of contacts, iterates to convergence. It
    shortens each change until the next one is not larger (natural monotonicity test: Deuflhard,
    Newton Methods for Nonlinear Problems, 2004, section 3.3).

    Attributes
    ----------
    static, mixed
        Static equations, and the same with stiff forces as multipliers, see `introduce_resultants`:
        as unknowns, they let stiff parts move like rigid ones.
    solver, measure
        Solver for consistent states, and measure of displacements.
    begin
        Positions (n,) at which the flow begins.
    gaps
        Gaps by which the joints are kept open, (m,).
    is_cautious
        See above.
    """

    static: StaticSystem
    mixed: StaticSystem
    solver: ConsistencySolver
    measure: DisplacementMeasure
    begin: Array
    gaps: Array
    is_cautious: bool = False

    @classmethod
    def of(cls, static: StaticSystem, begin: Array) -> GradientFlow:
        """Return the flow with closed joints."""
        e, mixed = static.equations, static.convert(lambda x: introduce_resultants(x).equations)
        solver, measure = ConsistencySolver(e), DisplacementMeasure.of(e)
        return cls(static, mixed, solver, measure, begin, np.zeros(e.m))

    @cached_property
    def _perturbation(self) -> Array:
        signs = np.random.default_rng(0).choice([-1.0, 1.0], len(self.begin))
        # Parts may be far smaller than the mechanism.
        sizes = np.maximum(np.abs(self.begin), self.static.equations.part_scales)
        # States of fast filters are far smaller than their scale.
        return self.static.equations.without_states(_PERTURBATION * sizes * signs)

    def _residual(self, x: Array) -> Array:
        n, last = len(self.begin), len(self.begin) + self.static.equations.m
        total = self.mixed.residual(x[:n], x[n:])
        total[n:last] -= self.gaps
        total[last:] -= x[last:]
        return total

    def _matrix(self, x: Array) -> sp.csc_array:
        n, last = len(self.begin), len(self.begin) + self.static.equations.m
        compliance = sp.diags_array(np.repeat([0.0, 1.0], [last, len(x) - last]))
        return sp.csc_array(self.mixed.matrix(x[:n], x[n:]) - compliance)

    def try_step(self, origin: Array, square: float) -> FlowStep | None:
        """Return a trial step of pseudo-time T with T^2 = `square`.

        Returns None if the matrix is singular, `size` exceeds `_MAX_STEP`, or the iterations of a
        cautious flow do not converge.
        """
        n = len(self.begin)
        weight = self.solver.mass_matrix(self.static.time, origin[:n]) * (1.0 / square)
        # No inertia in the rows and columns of the multipliers.
        weight.resize(len(origin), len(origin))
        way = np.minimum(
            self.measure.distances(origin[:n] - self.begin),
            _MAX_TRAVEL_SIZES * self.measure.scale,
        )
        sizes = self.measure.scale + np.where(self.static.equations.is_angle, 0.0, way)

        def size(change: Array) -> float:
            return float(np.max(self.measure.distances(change[:n]) / sizes))

        def unbalance(total: Array) -> Array:
            return self._residual(origin + total) + weight @ total

        x, total, is_converged = origin, np.zeros(len(origin)), not self.is_cautious
        for _ in range(_MAX_ITERATIONS if self.is_cautious else 1):
            last, forces = x, self._residual(x)
            try:
                solve = splu(sp.csc_array(self._matrix(x) + weight)).solve
            except RuntimeError:
                return None
            change = -solve(forces + weight @ total)
            change_size, share = size(change), 1.0
            if self.is_cautious:
                while not size(solve(unbalance(total + share * change))) <= change_size:
                    share *= _SHARE_REDUCTION
                    if share < _SMALLEST_SHARE:
                        return None
            total = total + share * change
            x, step_size = origin + total, size(total)
            if not step_size <= _MAX_STEP:
                return None
            if change_size <= max(_ITERATION_TOLERANCE * step_size, _CONVERGED_STEP):
                is_converged = True
                break
        if not is_converged:
            return None
        perturbed = last.copy()
        perturbed[:n] += self._perturbation
        rounding = size(solve(self._residual(perturbed) - forces))
        gaps = self._residual(x)
        gaps[:n] = 0.0
        correction = -solve(gaps)
        return FlowStep(x + correction, step_size, size(correction), rounding)


def relax_to_equilibrium(
    static: StaticSystem, q: Array, passed: list[Array] | None = None
) -> tuple[Array, Array]:
    """Return positions (n,) and multipliers (m,) of an equilibrium reached from `q`.

    Implicit steps follow the gradient flow. Each step solves a linear system with the matrix

        [[M / T^2 + K, G^T], [G, -C]],

    where K is the stiffness of F + G^T lam and C, of stiff forces, a compliance, and a second
    system with this matrix to close the joints. Short pseudo-times T keep steps small and lead to
    stable equilibria; long pseudo-times converge quadratically, like Newton's method. The step size
    does not depend on the orientation of the mechanism. Joints that are open at `q`, because
    drivers begin beside the drawing, are closed in short steps through equilibria. If steps do not
    end, for example because they jump into stiff contacts and out of them, a cautious flow is
    tried, see `GradientFlow`. Equilibria at which joints are still open are appended to `passed`.

    Raises
    ------
    BeamdaeError
        If there is no consistent state at rest near `q` (see `ConsistencySolver.state`), or no
        equilibrium is found. In the second case, the message names the coordinate that moved
        farthest.
    """
    e, begin = static.equations, np.array(q)
    flow = GradientFlow.of(static, begin)
    gaps = static.residual(q, np.zeros(e.m))[e.n :]
    size = float(np.max(np.abs(gaps) / e.constraint_scales, initial=0.0))
    count = max(min(ceil(size / _CLOSING_STEP), _CLOSING_STEPS), ceil(size / _MAX_CLOSING_STEP))
    lam: Array | None = None
    for share in np.linspace(1.0, 0.0, count + 1)[:-1]:
        q, lam, is_steady = _relax(replace(flow, begin=q, gaps=share * gaps), lam)
        if not is_steady:
            q = begin
            break
        if passed is not None:
            passed.append(q)
    begin = flow.solver.state(static.time, q, np.zeros(e.n)).q
    q, lam, is_steady = _relax(replace(flow, begin=begin), None)
    if is_steady:
        return q, lam
    displacement = np.abs(q - begin)
    worst = int(np.argmax(displacement / e.position_scales))
    sliding = list_first([*e.frictions])
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
    q, lam, is_steady = _relax(GradientFlow.of(static, q), np.zeros(static.equations.m))
    return (q, lam) if is_steady else None


def _relax(flow: GradientFlow, lam: Array | None) -> tuple[Array, Array, bool]:
    """Return the positions (n,) and multipliers (m,) at the end, and True if they are steady."""
    for is_cautious in (False, True):
        x, is_steady = _follow(replace(flow, is_cautious=is_cautious), lam)
        if is_steady:
            break
    e = flow.static.equations
    return x[: e.n], x[e.n : e.n + e.m], is_steady


def _follow(flow: GradientFlow, near: Array | None) -> tuple[Array, bool]:
    """Return the positions and multipliers at the end, and True if they are steady.

    With the multipliers `near` of an equilibrium close by, its first step is the longest.
    """
    static, q = flow.static, flow.begin
    n, m = static.equations.n, static.equations.m
    # The forces may be a fraction of those in `static.equations`.
    force = static.residual(q, np.zeros(m))[:n]
    a, joints = flow.solver.solve_saddle(static.time, q, None, -force, 0.0)
    x = np.zeros(n + flow.mixed.equations.m)
    x[:n], x[n : n + m] = q, joints if near is None else near
    x[n + m :] = flow._residual(x)[n + m :]
    acceleration = flow.measure.farthest(a)
    if acceleration == 0.0 and near is None:
        return x, True
    square = first = _FIRST_STEP / (acceleration or 1.0)
    last = _LAST_SQUARE_RATIO * first
    if near is not None:
        square = last
    is_last_tried = False
    for _ in range(_MAX_STEPS):
        step = flow.try_step(x, square)
        if step is None or not step.is_near:
            square /= _SQUARE_GROWTH
            if square < _SMALLEST_SQUARE_RATIO * first:
                break
            continue
        if step.is_steady and square < last and not is_last_tried:
            # At an equilibrium, the steps up to the last one would only repeat rounding errors.
            is_last_tried = True
            final = flow.try_step(step.x, last)
            if final is not None and final.is_near and final.is_steady:
                step, square = final, last
        x = step.x
        if step.is_steady and (square >= last or step.rounding > _RELIABLE_ROUNDING):
            return x, True
        if step.rounding <= _RELIABLE_ROUNDING:
            square = min(square * _SQUARE_GROWTH, last)
        elif step.rounding > _MAX_ROUNDING_RATIO * _RELIABLE_ROUNDING:
            square /= _SQUARE_GROWTH
    return x, False
