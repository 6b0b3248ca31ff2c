"""Accelerations and multipliers after a jump of the inputs that sampled controllers hold.

Positions and velocities are continuous; only the rates of first-order states, the accelerations and
the multipliers change.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from beamdae.core.return_codes import DONE
from beamdae.core.tables import Workspace
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.starts.state_evaluator import plan_motion, plan_state_sums
from beamdae.equations.structure import Structure
from beamdae.integrators.compiled_run import FactorizedMatrix, StepLoop
from beamdae.symbolic.sums.kernel_sums import SumPlan

Array = np.ndarray


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
        has_friction=int(any(term.rows is not None for term in equations.forces)),
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
