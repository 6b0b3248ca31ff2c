"""Accelerations and multipliers after a jump of the inputs that sampled controllers hold.

Positions and velocities are continuous; only the rates of first-order states, the accelerations and
the multipliers change.
"""

from __future__ import annotations

import numpy as np

from beamdae.core.return_codes import DONE
from beamdae.core.tables import Workspace
from beamdae.equations.equations_of_motion import State
from beamdae.equations.formulations.first_order import FirstOrderForm
from beamdae.equations.starts.state_evaluator import plan_state_sums
from beamdae.integrators.compiled_run import FactorizedMatrix, StepLoop

Array = np.ndarray

# Friction in joints depends on the reactions, so that the equations are not linear.
_MAX_FRICTION_ITERATIONS = 50


class InputJump:
    """Consistent states after jumps of held inputs, for methods on a first-order form."""

    def __init__(self, form: FirstOrderForm) -> None:
        equations, sums = form.equations, plan_state_sums(form.equations.structure)
        matrix = FactorizedMatrix.from_pattern(sums.saddle_pattern)
        has_friction = any(term.rows is not None for term in equations.forces)
        n, m = equations.n, equations.m

        work = Workspace(
            "InputJumpWorkspace",
            form=form.buffers(),
            saddle=sums.saddle.sum(True, equations.p),
            linear=matrix.make_solver(),
            nonzeros=matrix.nonzeros,
            y=np.zeros(form.size),
            yp=np.zeros(form.size),
            residual=np.zeros(form.size),
            motion=np.zeros(3 * n + m),
            change=np.zeros(n + m),
            weights=np.ones(n + m),
            states=np.asarray(equations.states, np.intp),
            has_impulses=int(form.formulation.impulses),
            max_iterations=_MAX_FRICTION_ITERATIONS if has_friction else 1,
        )
        self._form = form
        self._loop = StepLoop("solve_jump", work, (work.linear, matrix))

    @property
    def workspace(self) -> Workspace:
        """Work arrays of a jump."""
        return self._loop.work

    def apply(self, t: float, branch: float, q: Array, y: Array, yp: Array) -> State | None:
        """Return the state after a jump, given (y, y') before it; None if there is none.

        Parameters
        ----------
        t, branch
            Time of the jump, and a time inside the interval [s].
        q
            Coordinates, which differ from those in `y` only in held inputs.
        y, yp
            State and its derivative before the jump.
        """
        run = self._loop.work
        run.t, run.branch = t, branch
        run.y[:], run.yp[:] = y, yp
        run.y[: len(q)] = q
        if self._loop() != DONE:
            return None
        return State(*(x.copy() for x in self._form.unpack(run.y, run.yp)))
