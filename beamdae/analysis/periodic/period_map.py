"""Runs over a period: the map of states, its deviation, and disturbances along a run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from beamdae.analysis.continuation.engine import CurveError
from beamdae.analysis.periodic.load_periods import FULL_TURN
from beamdae.analysis.periodic.monodromy import (
    VariationalEquations,
    assemble_monodromy,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.smooth_intervals import time_on_branch
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.errors import BeamdaeError
from beamdae.integrators import Integrator, Radau
from beamdae.integrators.reaction_balance import remove_redundant
from beamdae.integrators.run_plan import Amplitudes
from beamdae.integrators.step_thinning import keep_all_steps
from beamdae.interrupts import Interrupted
from beamdae.results.solution import Solution
from beamdae.simulation import as_equations

Array = np.ndarray

# Relative tolerance of the runs that settle and of the first iterations. Vibrations that are not
# part of the periodic motion take most of the time of accurate runs, and more with every
# disturbance of the variational equations. Runs with more than this fraction of it are not refined.
_COARSE_RTOL, _COARSENING_RATIO = 1e-4, 1e-1
# Settings of an integrator that Radau adopts in its place.
_LIMITS = ("max_step", "max_steps", "time_limit")
_OUTPUT_TIMES = 201  # in a period, including both ends
# Rank tolerance of Newton's matrix. Disturbances that shrink below it within a period need no
# linearization: Newton's method leaves them to the run (Lust, Roose, Spence & Champneys, SIAM J.
# Sci. Comput. 19 (1998) 1188). With 1e-2, kept matrices do not reduce the deviation of stiff beams.
NEWTON_RANK_TOLERANCE = 1e-4


class IncompleteRunError(BeamdaeError, CurveError):
    """Raised if a run ends early; `solution` is the incomplete run."""

    def __init__(self, run: str, solution: Solution) -> None:
        super().__init__(f"periodic: {run} was not finished: {solution.status.sentence}.")
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


def adopt_radau(integrator: Integrator, max_rtol: float = np.inf) -> Integrator:
    """Return `Radau` with the same limits and rtol, at most `max_rtol`, for adaptive steps.

    Other methods resolve undamped fast vibrations, which are not part of the motion, with up to a
    hundred times as many steps.
    """
    name, value = integrator.accuracy
    if name != "rtol":
        return integrator
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
        `Radau`, or an integrator with fixed steps.
    begin, period
        Start and duration of the period [s].
    variational
        Equations linearized along runs.
    """

    equations: EquationsOfMotion
    integrator: Integrator
    begin: float
    period: float
    variational: VariationalEquations

    @classmethod
    def from_equations(
        cls, equations: EquationsOfMotion, integrator: Integrator, begin: float, period: float
    ) -> PeriodMap:
        """Create the map; redundant constraints are removed."""
        reduction = remove_redundant(equations, begin)
        independent = equations if reduction is None else reduction.equations
        return cls(independent, integrator, begin, period, VariationalEquations(independent))

    @property
    def coarse(self) -> PeriodMap | None:
        """The map by coarse runs, by which a motion is approached; None if runs are coarse."""
        radau = self.integrator
        if not isinstance(radau, Radau) or radau.rtol > _COARSENING_RATIO * _COARSE_RTOL:
            return None
        return replace(self, integrator=replace(radau, rtol=_COARSE_RTOL))

    def run(self, q: Array, v: Array, scales: Array | None = None, periods: int = 1) -> Solution:
        """Integrate over `periods` periods from (q, v); `scales` are known amplitudes, or None.

        Raises
        ------
        IncompleteRunError
            If the run ends early.
        """
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

        Full revolutions of angles are removed. The third value is the amplitudes of the run, (n,),
        or None.

        Raises
        ------
        IncompleteRunError
            If the run ends early.
        """
        e = self.equations
        state = ConsistencySolver(e).start_state(self._begin_on_branch, e.q0, e.v0)
        if not periods:
            return state.q, state.v, None
        run = PeriodRun(self, self.run(state.q, state.v, periods=periods))
        return *run.end_state(), run.amplitudes

    def make_consistent(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the consistent state nearest to (q, v) at the start of a period."""
        state = ConsistencySolver(self.equations).state(self._begin_on_branch, q, v)
        return state.q, state.v

    @property
    def _begin_on_branch(self) -> Array:
        """(t, branch) at the start of a period [s]."""
        return time_on_branch(self.equations.breakpoints, self.begin)


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
    """

    period_map: PeriodMap
    solution: Solution

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

    def end_state(self) -> tuple[Array, Array]:
        """Return the consistent state (q, v) at the end of the run, without full revolutions."""
        return self.period_map.make_consistent(*np.split(self.state + self.difference, 2))

    @cached_property
    def relative_deviation(self) -> float:
        """Largest absolute component of `difference` relative to `scales`."""
        return float(np.max(np.abs(self.difference / self.scales)))

    @cached_property
    def _disturbances(self) -> tuple[Array, Array, Array]:
        return self.period_map.variational.admissible_disturbances(
            self.solution.trajectory, self.scales
        )

    @property
    def energy_coordinates(self) -> tuple[Array, Array]:
        """Matrices (2 n, 2 n) to coordinates whose square is the energy, and back to (q, v)."""
        return self._disturbances[1:]

    @cached_property
    def basis(self) -> Array:
        """Basis of the admissible disturbances at the start, (2 n, k), orthonormal in energy.

        See `VariationalEquations.admissible_disturbances`.
        """
        directions, _, back = self._disturbances
        return np.asarray(back @ directions)

    @cached_property
    def projection(self) -> Array:
        """Matrix (k, 2 n) that expresses disturbances of (q, v) in terms of `basis`."""
        directions, to, _ = self._disturbances
        return np.asarray(directions.T @ to)

    def propagate(self, disturbances: Array, refinement: int = 0) -> Array:
        """Propagate disturbances (k, j) over the period; both are in terms of `basis`.

        Raises
        ------
        LinearizationError
            As `VariationalEquations.propagate`.
        """
        return self.projection @ self.period_map.variational.propagate(
            self.solution.trajectory, self.basis @ disturbances, refinement
        )

    def monodromy(
        self,
        *directions: Array,
        tolerance: float = NEWTON_RANK_TOLERANCE,
        refinement: int = 0,
    ) -> Array:
        """Return the monodromy matrix (k, k), in terms of `basis`.

        It maps disturbances at the start of the period to those at its end, and is exact on its
        range, the deviation and `directions`, (k,) each; see `assemble_monodromy`. With the
        steps of a run of `Radau`, this is the derivative of the discrete solution; `refinement` is
        the number of times the steps are halved.

        Raises
        ------
        LinearizationError
            As `VariationalEquations.propagate`.
        """
        columns = np.column_stack([self.projection @ self.difference, *directions])
        return assemble_monodromy(lambda x: self.propagate(x, refinement), columns, tolerance)

    @property
    def rate(self) -> Array:
        """Rate of the state at the start, times the period, in terms of `basis`, (k,)."""
        first = self.solution.trajectory.intervals[0].state
        rate = np.concatenate([first.v[0], first.a[0]])
        return np.asarray(self.period_map.period * (self.projection @ rate))
