"""Loops of the core over the steps of a run, and over jumps of inputs.

Positions and velocities are continuous; only the rates of first-order states, the accelerations and
the multipliers change.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, Generic, TypeVar

import numpy as np
import scipy.sparse as sp

from beamdae.core.library import load_core
from beamdae.core.linear_solver import LinearSolver
from beamdae.core.return_codes import DONE, NEW_PIVOTS
from beamdae.core.tables import Loop, Workspace
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.starts.state_evaluator import plan_motion, plan_state_sums
from beamdae.equations.structure import Structure
from beamdae.errors import BeamdaeError
from beamdae.linear.elimination import EliminationPlan
from beamdae.linear.factorizations import SingularMatrixError
from beamdae.linear.pivots import propose_plans
from beamdae.symbolic.sums.kernel_sums import SumPlan

Array = np.ndarray
W = TypeVar("W")


@dataclass
class FactorizedMatrix:
    """Matrix that a loop fills and factorizes.

    Attributes
    ----------
    pattern
        Sparsity pattern (CSC).
    nonzeros
        Values on the pattern, written by the loop.
    pivot_source
        Matrix with the same pattern whose pivots are tried first, because a search for pivots takes
        longer than many factorizations; None if there is none.
    """

    pattern: sp.csc_array
    nonzeros: Array
    pivot_source: FactorizedMatrix | None = None
    _plan: EliminationPlan | None = field(default=None, init=False)
    _plans: Iterator[EliminationPlan] = field(default_factory=lambda: iter(()), init=False)
    _planned_nonzeros: Array = field(default_factory=lambda: np.full(1, np.nan), init=False)

    @classmethod
    def from_pattern(
        cls,
        pattern: sp.csc_array,
        dtype: type = float,
        pivot_source: FactorizedMatrix | None = None,
    ) -> FactorizedMatrix:
        """Return a zero matrix with this pattern."""
        return cls(pattern, np.zeros(pattern.nnz, dtype), pivot_source)

    def make_solver(self) -> LinearSolver:
        """Return the solver for a loop."""
        return LinearSolver.empty(self.nonzeros.dtype.type)

    def renew_pivots(self, linear: LinearSolver) -> None:
        """Set the next proposed pivots in `linear`; mark `linear` as singular if there are none."""
        linear.needs_pivots = 0
        try:
            # Pivots of a nearly singular matrix may pass the test of the factors and still give
            # inaccurate solutions; the same proposals for the same matrix would never end.
            is_repeated = np.array_equal(self.nonzeros, self._planned_nonzeros)
            if not (linear.is_untried or is_repeated):
                candidates = propose_plans(self.pattern, self.nonzeros)
                self._plans = chain(self._source_plans(), candidates)
                self._planned_nonzeros = self.nonzeros.copy()
            plan = next(self._plans, None)
        except SingularMatrixError:
            plan = None
        if plan is None:
            linear.singular, linear.is_untried = 1, 0
            self._planned_nonzeros = np.full(1, np.nan)
        else:
            self._plan = plan
            linear.set_plan(plan)

    def _source_plans(self) -> Iterator[EliminationPlan]:
        # Pivots that have just failed are not tried again.
        plan = self.pivot_source._plan if self.pivot_source else None
        if plan is not None and plan is not self._plan:
            yield plan


def require_core(
    part: str = "core: this method or analysis",
    alternative: str = ", or use GeneralizedAlpha with fixed steps",
) -> None:
    """Raise a BeamdaeError if there is no core."""
    if load_core() is None:
        raise BeamdaeError(
            f"{part} requires the compiled core; install a C compiler, for example by "
            f'`pip install "beamdae[fmu]"`{alternative}.'
        )


class StepLoop(Generic[W]):
    """Loop of the core that factorizes matrices.

    Attributes
    ----------
    work
        Workspace of the loop, with the fields of its structure in `core.h`. Between calls, numbers
        may be assigned, but arrays must be changed in place.
    """

    def __init__(self, function: str, work: W, *matrices: tuple[Any, FactorizedMatrix]) -> None:
        """Bind the loop.

        Parameters
        ----------
        function
            Name of the loop in `core.h`. It returns a code of `core.return_codes`.
        work
            The workspace.
        matrices
            Linear solvers in the workspace, each with the matrix it factorizes.

        Raises
        ------
        BeamdaeError
            If there is no core.
        """
        require_core()
        self.work, self._matrices = work, matrices
        self._loop = Loop(function, work)

    def __call__(self) -> int:
        """Run the loop, renewing pivots whenever it requests new ones; return its code."""
        while (code := self._loop()) == NEW_PIVOTS:
            renewed = [(linear, matrix) for linear, matrix in self._matrices if linear.needs_pivots]
            for linear, matrix in renewed:
                matrix.renew_pivots(linear)
            # The arrays of the new pivots differ in size and address.
            self._loop.bind(*(linear for linear, _ in renewed))
        return code


def make_motion_buffers(
    equations: EquationsOfMotion, plan_levels: Callable[[Structure], SumPlan] = plan_motion
) -> tuple[Workspace, FactorizedMatrix]:
    """Return the work arrays for accelerations and jerks, and the matrix that they factorize.

    `plan_levels` returns the plan of (F, g, g_dot, g_ddot).
    """
    sums, n, m = plan_state_sums(equations.structure), equations.n, equations.m
    matrix = FactorizedMatrix.from_pattern(sums.saddle_pattern)
    buffers = Workspace(
        "MotionBuffers",
        n=n,
        m=m,
        has_friction=int(equations.has_friction),
        q=np.zeros(n),
        v=np.zeros(n),
        lam=np.zeros(m),
        states=np.asarray(equations.states, np.intp),
        motion=plan_levels(equations.structure).sum(True, equations.p),
        saddle=sums.saddle.sum(True, equations.p),
        linear=matrix.make_solver(),
        inputs=np.zeros(3 * n + m),
        levels=np.zeros(n + 3 * m),
        nonzeros=matrix.nonzeros,
        solution=np.zeros(n + m),
    )
    return buffers, matrix


class InputJump:
    """Consistent states after jumps of held inputs."""

    def __init__(self, equations: EquationsOfMotion) -> None:
        work, matrix = make_motion_buffers(equations)
        self._loop = StepLoop("solve_jump", work, (work.linear, matrix))

    def apply(self, t: float, branch: float, q: Array, state: State) -> State | None:
        """Return the state after a jump, given the state before it; None if there is none.

        Parameters
        ----------
        t, branch
            Time of the jump, and a time inside the interval [s].
        q
            Coordinates, which differ from those in `state` only in held inputs.
        state
            State before the jump.
        """
        run = self._loop.work
        run.t, run.branch = t, branch
        run.q[:], run.v[:], run.lam[:] = q, state.v, state.lam
        if self._loop() != DONE:
            return None
        a, lam = np.split(run.solution.copy(), [len(q)])
        a[run.states] = state.a[run.states]
        return State(run.q.copy(), run.v.copy(), a, lam)
