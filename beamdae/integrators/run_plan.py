"""Plan of a run: smooth intervals, consistent start, amplitudes and longest step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import pairwise

import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.natural_frequencies import Mode, estimate_fastest_modes
from beamdae.equations.short_pulses import plan_ends
from beamdae.equations.smooth_intervals import branch_time, time_on_branch
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.integrators.amplitudes import Amplitudes
from beamdae.integrators.compiled_run import FactorizedMatrix
from beamdae.integrators.limits import require_feasible_step
from beamdae.parts.laws import MIN_STEPS_PER_TIME_SCALE

Array = np.ndarray

# Least number of steps in a run; with `MIN_STEPS_PER_TIME_SCALE` it sets the default longest step.
_MIN_STEPS_PER_RUN = 20.0


@dataclass(frozen=True)
class RunPlan:
    """Smooth intervals of a run, its consistent start, and the amplitudes of its motion.

    Attributes
    ----------
    starter
        Solver for consistent states of `equations`.
    intervals
        (start, end) of the smooth intervals between breakpoints and short pulses [s].
    state
        Consistent state at the start, or after the last event with actions.
    fastest_modes
        Cached function that returns the fastest natural mode of each elastic body in this state.
    amplitudes
        Amplitudes of the parts measured by a pilot run, or None.
    partial_rate
        Rate of the motion [1/s] that a pilot run measured over many periods, if it was too short to
        measure amplitudes; otherwise 0.
    is_adaptive
        True if an error tolerance determines the steps.
    matrices
        Last matrix by name of the method, so that a run can reuse the pivots of its pilot run.
    """

    starter: ConsistencySolver
    intervals: tuple[tuple[float, float], ...]
    state: State
    fastest_modes: Callable[[], tuple[Mode, ...]]
    amplitudes: Amplitudes | None = None
    partial_rate: float = 0.0
    is_adaptive: bool = True
    matrices: dict[str, FactorizedMatrix] = field(default_factory=dict, compare=False)

    def matrix(self, method: str, pattern: sp.csc_array) -> FactorizedMatrix:
        """Return a new matrix for a method; the pivots of its last matrix are tried first."""
        matrix = FactorizedMatrix.from_pattern(pattern, pivot_source=self.matrices.get(method))
        self.matrices[method] = matrix
        return matrix

    @property
    def equations(self) -> EquationsOfMotion:
        """Equations to integrate."""
        return self.starter.equations

    @property
    def time(self) -> Array:
        """(t, branch) at the start of the run [s]."""
        return np.array([self.intervals[0][0], branch_time(*self.intervals[0])])

    @property
    def scales(self) -> Array:
        """Scale of each coordinate [m or rad], (n,).

        The scale is the amplitude measured by a pilot run or given by the model, if available;
        otherwise, it is the characteristic length, or 1 for an angle.
        """
        if self.amplitudes is not None:
            return self.amplitudes.scales
        scales = self.equations.scales
        return self.equations.position_scales if scales is None else scales

    @property
    def duration(self) -> float:
        """Duration of the run [s]."""
        return self.intervals[-1][1] - self.intervals[0][0]

    def longest_step(self, part: str, max_step: float | None) -> float:
        """Return the longest step [s]: `max_step`, or by default a step that resolves the laws.

        The default is a twentieth of the run, or a quarter of the time scale of the laws if this is
        shorter. `part` names the integrator in error messages.

        Raises
        ------
        BeamdaeError
            If the run would take more than 1e8 steps of this length.
        """
        if max_step is not None:
            require_feasible_step(part, "max_step", max_step, self.duration)
            return max_step
        scale, longest = self.equations.time_scale, self.duration / _MIN_STEPS_PER_RUN
        if scale is None:
            return longest
        resolving = scale / MIN_STEPS_PER_TIME_SCALE
        setting = "the longest step (a quarter of the time scale of the laws)"
        require_feasible_step(part, setting, resolving, self.duration)
        return min(longest, resolving)


def plan_run(equations: EquationsOfMotion, times: Array, is_adaptive: bool = True) -> RunPlan:
    """Return the plan of a run from the first to the last of `times` [s].

    Raises
    ------
    BeamdaeError
        If the mass matrix is not symmetric or not positive semidefinite, the model has no
        consistent start, or a law becomes infinite.
    """
    start, end = float(times[0]), float(times[-1])
    intervals = tuple(pairwise((start, *plan_ends(equations, start, end, is_adaptive))))
    starter = ConsistencySolver(equations)
    starter.require_inertia()
    first = time_on_branch(equations.breakpoints, start, end)
    state = starter.start_state(first, equations.q0, equations.v0)
    # Cached because the pilot run and the main run need the same modes.
    modes = cache(partial(estimate_fastest_modes, starter, first, state))
    return RunPlan(starter, intervals, state, modes, is_adaptive=is_adaptive)
