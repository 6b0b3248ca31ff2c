"""Runs over a period: the map of states, its deviation, and disturbances along a run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from beamdae.analysis.continuation.engine import CurveError
from beamdae.analysis.periodic.load_periods import FULL_TURN
from beamdae.analysis.periodic.monodromy import (
    EXACT_RANK,
    MAX_HALVINGS,
    VariationalEquations,
    assemble_monodromy,
    dominant_range,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.errors import BeamdaeError
from beamdae.integrators import Integrator, Radau
from beamdae.integrators.amplitudes import Amplitudes
from beamdae.integrators.redundant_constraints import remove_redundant
from beamdae.integrators.step_thinning import keep_all_steps
from beamdae.interrupts import Interrupted
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Trajectory
from beamdae.simulation import as_equations

Array = np.ndarray

# Relative tolerance of the runs that settle and of the first iterations. Vibrations that are not
# part of the periodic motion take most of the time of accurate runs, and more with every
# disturbance of the variational equations. At most this fraction of it is more accurate.
_COARSE_RTOL = 1e-4
_COARSENING_RATIO = 1e-1
# Settings of an integrator that Radau adopts in its place.
_LIMITS = ("max_step", "max_steps", "time_limit")
_OUTPUT_TIMES = 201  # in a period, including both ends
# Rank tolerance of Newton's matrix. Disturbances that shrink below it within a period need no
# linearization: Newton's method leaves them to the run (Lust, Roose, Spence & Champneys, SIAM J.
# Sci. Comput. 19 (1998) 1188). With 1e-2, kept matrices do not reduce the deviation of stiff beams.
_NEWTON_RANK_TOLERANCE = 1e-4
# Disturbances with smaller singular values, relative to the largest, are not expected in the next
# matrix.
_EXPECTED_RANK_TOLERANCE = 1e-6
# Number of steps of runs without stages in each step of the variational equations.
_STEPS_PER_NODE = 4.0
# Error of the stages of the variational equations, relative to the rank tolerance of a matrix.
_STAGE_TOLERANCE_RATIO = 1e-2


class IncompleteRunError(BeamdaeError, CurveError):
    """Raised if a run ends early; `solution` is the incomplete run."""

    def __init__(self, run: str, solution: Solution) -> None:
        reason = solution.status.sentence
        if "loosen rtol" in reason:
            reason += "; rtol is that of integrator=, such as bd.Radau(1e-6)"
        super().__init__(f"periodic: {run} was not finished: {reason}.")
        self.solution = solution


def build_periodic_equations(function: str, model: Any, start: Any = None) -> EquationsOfMotion:
    """Return the equations of a model, for shooting.

    Raises
    ------
    BeamdaeError
        If parts are inactive, or events stop a run, switch parts or cause impacts.
    """
    equations = as_equations(function, model, start)
    if equations.configurations is not None or any(x.do != "record" for x in equations.events):
        raise BeamdaeError(
            f"{function}: inactive parts, impacts and events that stop a run or switch parts "
            "are not supported; remove them, or model contacts by smooth forces such as Contact."
        )
    return equations


def as_radau(integrator: Integrator, max_rtol: float = np.inf) -> Radau | None:
    """Return `Radau` with the same rtol, at most `max_rtol`, and limits; None for fixed steps."""
    name, value = integrator.accuracy
    if name != "rtol":
        return None
    if isinstance(integrator, Radau):
        return integrator if value <= max_rtol else replace(integrator, rtol=max_rtol)
    limits: dict[str, Any] = {name: getattr(integrator, name, None) for name in _LIMITS}
    return Radau(min(value, max_rtol), **limits)


@dataclass(frozen=True)
class PeriodMap:
    """Map from a state to the state one period later.

    Attributes
    ----------
    equations
        Equations of motion without redundant constraints.
    integrator
        Integrator of the runs.
    begin, period
        Start and duration of the period [s].
    variational
        Equations linearized along runs.
    is_coarse
        Whether deformations of a beam are resolved relative to the largest one with the same unit.
    """

    equations: EquationsOfMotion
    integrator: Integrator
    begin: float
    period: float
    variational: VariationalEquations
    is_coarse: bool = False

    @classmethod
    def from_equations(
        cls, equations: EquationsOfMotion, integrator: Integrator, begin: float, period: float
    ) -> PeriodMap:
        """Create the map; redundant constraints are removed."""
        reduction = remove_redundant(equations, begin)
        independent = equations if reduction is None else reduction.equations
        return cls(independent, integrator, begin, period, VariationalEquations(independent))

    @property
    def radau(self) -> Radau | None:
        """`Radau` with the same rtol, or None for fixed steps.

        Other methods resolve undamped fast vibrations, which are not part of the motion, with up to
        a hundred times as many steps.
        """
        return as_radau(self.integrator)

    @property
    def stages(self) -> list[PeriodMap]:
        """The maps by which a motion is approached: coarse Radau, accurate Radau, and this one.

        Corrections of large deflections disturb axial deformations, whose vibrations would take
        thousands of steps of a run that resolves them relative to their small amplitudes.
        """
        radau = self.radau
        if radau is None:
            return [self]
        is_radau, rtol = radau is self.integrator, max(radau.rtol, _COARSE_RTOL)
        is_large = radau.rtol > _COARSENING_RATIO * _COARSE_RTOL
        coarse = replace(self, integrator=replace(radau, rtol=rtol), is_coarse=True)
        accurate = replace(self, integrator=radau)
        return [
            *[coarse] * (not (is_radau and is_large)),
            *[accurate] * (not (is_radau or is_large)),
            self,
        ]

    def run(self, q: Array, v: Array, scales: Array | None = None, periods: int = 1) -> Solution:
        """Integrate over `periods` periods from (q, v); `scales` are known amplitudes, or None.

        Raises
        ------
        IncompleteRunError
            If the run ends early.
        """
        if self.is_coarse and scales is not None:
            scales = equalize_deformations(self.equations, scales)
        equations = replace(self.equations, q0=q, v0=v, scales=scales)
        count = periods * (_OUTPUT_TIMES - 1) + 1
        times = self.begin + self.period * np.linspace(0.0, periods, count)
        with keep_all_steps():
            solution = self.integrator.integrate(equations, times)
        if solution.status.kind == "interrupted":
            raise Interrupted(solution.status.sentence)
        if not solution.status.success or solution.trajectory.end < times[-1]:
            run = "the run over a period" if periods == 1 else "the run to settle"
            raise IncompleteRunError(run, solution)
        return solution

    def settle(self, periods: int) -> tuple[Array, Array, Array | None]:
        """Return the consistent state (q, v) after `periods` periods from the initial conditions.

        Full revolutions of angles are removed. The third value is the amplitudes of the last run,
        (n,), or None. Coarse runs continue with those of the first period, relative to which they
        do not resolve fast vibrations after the start.

        Raises
        ------
        IncompleteRunError
            If a run ends early.
        """
        e = self.equations
        state = ConsistencySolver(e).start_state(self._begin_on_branch, e.q0, e.v0)
        q, v, amplitudes = state.q, state.v, None
        first = min(periods, 1) if self.is_coarse else periods
        for count in (first, periods - first):
            if count:
                run = PeriodRun(self, self.run(q, v, amplitudes, count))
                amplitudes, (q, v) = run.amplitudes, run.end_state()
        return q, v, amplitudes

    def make_consistent(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the consistent state nearest to (q, v) at the start of a period."""
        state = ConsistencySolver(self.equations).state(self._begin_on_branch, q, v)
        return state.q, state.v

    @property
    def _begin_on_branch(self) -> Array:
        """(t, branch) at the start of a period [s]."""
        later = [b for b in self.equations.breakpoints if b > self.begin]
        return np.array([self.begin, 0.5 * (self.begin + min([self.begin + 1.0, *later]))])


def equalize_deformations(equations: EquationsOfMotion, scales: Array) -> Array:
    """Return scales (..., n) with the largest of the deformations of a part with the same unit."""
    is_angle, scales = equations.is_angle, scales.copy()
    for part in equations.parts:
        rows = np.arange(part.deformations.start, part.deformations.stop)
        for group in (rows[is_angle[rows]], rows[~is_angle[rows]]):
            scales[..., group] = np.max(scales[..., group], axis=-1, initial=0.0, keepdims=True)
    return scales


@dataclass(frozen=True, eq=False)
class PeriodRun:
    """Run over one period from a consistent state.

    Attributes
    ----------
    period_map
        Map from the start to the end of the period.
    solution
        Run over the period.
    persistent
        Disturbances (2 n, r) that are expected to persist over the period, known from a similar
        run, or None.
    """

    period_map: PeriodMap
    solution: Solution
    persistent: Array | None = None

    @classmethod
    def from_state(
        cls,
        period_map: PeriodMap,
        q: Array,
        v: Array,
        persistent: Array | None = None,
        amplitudes: Array | None = None,
    ) -> PeriodRun:
        """Run one period from a consistent state (q, v), with known `amplitudes` (n,) or None.

        Raises
        ------
        IncompleteRunError
            If the run ends early.
        """
        return cls(period_map, period_map.run(q, v, amplitudes), persistent)

    @cached_property
    def scales(self) -> Array:
        """Natural sizes (2 n,) of (q, v).

        The size of a coordinate is its amplitude, but at most the size of the mechanism or 1 rad.
        The size of a velocity is that of its coordinate times 2 pi / period or, with fast
        vibrations, times the rate of the motion.
        """
        amplitudes = Amplitudes.from_trajectory(self.solution.equations, self.solution.trajectory)
        scales = np.minimum(amplitudes.scales, self.period_map.equations.position_scales)
        rate = max(FULL_TURN / self.period_map.period, amplitudes.rate)
        return np.concatenate([scales, rate * scales])

    @property
    def amplitudes(self) -> Array:
        """Scales of q, (n,)."""
        return self.scales[: len(self.scales) // 2]

    @property
    def state(self) -> Array:
        """(q, v) at the start of the period, (2 n,)."""
        first = self.solution.trajectory.intervals[0].state
        return np.concatenate([first.q[0], first.v[0]])

    def end_state(self) -> tuple[Array, Array]:
        """Return the consistent state (q, v) at the end of the run, without full revolutions."""
        last = self.solution.trajectory.intervals[-1].state
        turns = FULL_TURN * np.round((last.q[-1] - self.state[: last.q.shape[1]]) / FULL_TURN)
        q = last.q[-1] - np.where(self.period_map.equations.is_angle, turns, 0.0)
        return self.period_map.make_consistent(q, last.v[-1])

    @cached_property
    def difference(self) -> Array:
        """State at the end of the period minus the state at its start, (2 n,).

        Full revolutions of angles are removed. The end of runs with fixed steps is made consistent:
        their velocities violate the constraints by errors of the steps, the start does not.
        """
        last = self.solution.trajectory.intervals[-1].state
        difference = np.concatenate([last.q[-1], last.v[-1]]) - self.state
        q = difference[: last.q.shape[1]]
        turns = FULL_TURN * np.round(q / FULL_TURN)
        q -= np.where(self.period_map.equations.is_angle, turns, 0.0)
        if self.period_map.integrator.accuracy.name == "step":
            end = self.period_map.make_consistent(*np.split(self.state + difference, 2))
            return np.concatenate(end) - self.state
        return difference

    @cached_property
    def relative_deviation(self) -> float:
        """Largest absolute component of `difference` relative to `scales`."""
        return float(np.max(np.abs(self.difference / self.scales)))

    @cached_property
    def _disturbance_basis(self) -> tuple[Array, Array]:
        return self.period_map.variational.admissible_disturbances(
            self.solution.trajectory, self.scales
        )

    @property
    def basis(self) -> Array:
        """Basis of the admissible disturbances at the start, (2 n, k), orthonormal in energy.

        See `VariationalEquations.admissible_disturbances`.
        """
        return self._disturbance_basis[0]

    @property
    def projection(self) -> Array:
        """Matrix (k, 2 n) that expresses disturbances of (q, v) in terms of `basis`."""
        return self._disturbance_basis[1]

    @cached_property
    def deviation(self) -> Array:
        """Difference of the states at the end and at the start in terms of `basis`, (k,)."""
        return np.asarray(self.projection @ self.difference)

    def propagate(
        self,
        disturbances: Array,
        steps_per_node: float,
        tolerance: float = EXACT_RANK,
        max_halvings: int = MAX_HALVINGS,
    ) -> Array:
        """Propagate disturbances (k, j) over the period; both are in terms of `basis`.

        Raises
        ------
        LinearizationError
            As `VariationalEquations.propagate`.
        """
        columns = self.basis @ disturbances
        return self.projection @ self.period_map.variational.propagate(
            self._linearized_trajectory,
            columns,
            self.scales,
            steps_per_node,
            tolerance,
            max_halvings,
        )

    @cached_property
    def _linearized_trajectory(self) -> Trajectory:
        """The run or, with other adaptive methods, a run by Radau from the same state."""
        radau = self.period_map.radau
        if radau is None or radau is self.period_map.integrator:
            return self.solution.trajectory
        coarse = replace(self.period_map, integrator=radau, is_coarse=True)
        q, v = np.split(self.state, 2)
        return coarse.run(q, v, self.amplitudes).trajectory

    def monodromy(
        self,
        *directions: Array,
        steps_per_node: float,
        tolerance: float = EXACT_RANK,
        persistent: Array | None = None,
    ) -> Array:
        """Return the monodromy matrix (k, k), in terms of `basis`.

        It maps disturbances at the start of the period to those at its end, and is exact on its
        range and `directions`, (k,) each; see `assemble_monodromy`. `persistent` are disturbances
        that are expected to persist; they default to those of the run.
        """
        size = len(self.deviation)
        persistent = self.persistent if persistent is None else persistent
        stage_tolerance = max(EXACT_RANK, _STAGE_TOLERANCE_RATIO * tolerance)
        return assemble_monodromy(
            lambda columns: self.propagate(columns, steps_per_node, stage_tolerance),
            size,
            np.column_stack([np.zeros((size, 0)), *directions]),
            tolerance,
            None if persistent is None else self.projection @ persistent,
        )

    def resolved_monodromy(
        self, *directions: Array, tolerance: float = _NEWTON_RANK_TOLERANCE
    ) -> Array:
        """Return the monodromy matrix for Newton's method, on steps of the run.

        It is exact on the deviation and `directions`. For runs of `Radau`, this is the derivative
        of the discrete solution. Other adaptive steps are replaced by those of `Radau`.

        Raises
        ------
        LinearizationError
            As `VariationalEquations.propagate`.
        """
        return self.monodromy(
            self.deviation, *directions, steps_per_node=self.steps_per_node, tolerance=tolerance
        )

    def persistent_disturbances(self, monodromy: Array) -> Array:
        """Return the disturbances (2 n, r) that persist according to a monodromy matrix."""
        return self.basis @ dominant_range(monodromy, _EXPECTED_RANK_TOLERANCE)

    @property
    def steps_per_node(self) -> float:
        """Number of steps of the run in each step of the variational equations.

        1 for adaptive steps; more for fixed steps, whose methods are of lower order.
        """
        has_stages = self._linearized_trajectory.intervals[0].nodes_per_step > 1
        return 1.0 if has_stages else _STEPS_PER_NODE

    @property
    def rates(self) -> tuple[Array, Array]:
        """Time derivatives of the state at the start and at the end of the period, (k,) each.

        They are multiplied by the period and expressed in terms of `basis`.
        """
        intervals = self.solution.trajectory.intervals
        first, last = intervals[0].state, intervals[-1].state
        rates = [np.concatenate([x.v[k], x.a[k]]) for x, k in ((first, 0), (last, -1))]
        start, end = (self.period_map.period * (self.projection @ x) for x in rates)
        return start, end
