"""Accelerations and multipliers after a jump of the inputs that sampled controllers hold.

Positions and velocities are continuous; only the rates of first-order states, the accelerations and
the multipliers change.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.core.return_codes import DONE
from beamdae.equations.equations_of_motion import State
from beamdae.equations.formulations.first_order import FirstOrderBuffers, FirstOrderForm
from beamdae.equations.starts.state_evaluator import plan_state_sums
from beamdae.integrators.compiled_run import FactorizedMatrix, StepLoop
from beamdae.symbolic.sums.kernel_sums import Sum

Array = np.ndarray

# Friction in joints depends on the reactions, so that the equations are not linear.
_MAX_FRICTION_ITERATIONS = 50


@dataclass(slots=True)
class InputJumpWorkspace:
    """Work arrays of an input jump.

    Attributes
    ----------
    form
        Residual of the first-order form.
    saddle, linear, nonzeros
        Evaluation of [[M, G^T + dF/dlam], [G, 0]], its linear solver, and its non-zeros.
    y, yp
        State y and its derivative y'.
    residual, motion, change, weights
        Residual, inputs (q, v, a, lam) of `saddle`, changes of (a, lam), and ones.
    states
        Indices of the first-order states.
    has_impulses
        1 if y' contains the multipliers, 0 if y does.
    max_iterations
        1 if the equations are linear in a and lam.
    t, branch
        Time of the jump, and a time inside the interval [s].
    """

    form: FirstOrderBuffers
    saddle: Sum
    linear: Any
    nonzeros: Array
    y: Array
    yp: Array
    residual: Array
    motion: Array
    change: Array
    weights: Array
    states: Array
    has_impulses: int
    max_iterations: int
    t: float = 0.0
    branch: float = 0.0


class InputJump:
    """Consistent states after jumps of held inputs, for methods on a first-order form."""

    def __init__(self, form: FirstOrderForm) -> None:
        equations, sums = form.equations, plan_state_sums(form.equations.structure)
        matrix = FactorizedMatrix.from_pattern(sums.saddle_pattern)
        has_friction = any(term.rows is not None for term in equations.forces)
        n, m = equations.n, equations.m

        def make_workspace(native: bool) -> InputJumpWorkspace:
            return InputJumpWorkspace(
                form=form.buffers(native),
                saddle=sums.saddle.sum(native, equations.p),
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

        def matrices(run: InputJumpWorkspace) -> list[tuple[Any, FactorizedMatrix]]:
            return [(run.linear, matrix)]

        is_native = form.is_native and sums.saddle.is_native
        self._form = form
        self._loop = StepLoop("solve_jump", make_workspace, matrices, is_native)

    @property
    def workspace(self) -> InputJumpWorkspace:
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
