"""IDA in SUNDIALS' shared libraries, with all that it calls in machine code."""

from __future__ import annotations

import ctypes
from collections import Counter
from collections.abc import Generator
from typing import Any

import numpy as np

from beamdae.equations.formulations.first_order import FirstOrderForm
from beamdae.integrators.compiled_run import FactorizedMatrix
from beamdae.integrators.ida.callbacks import (
    IdaWorkspace,
    NewtonState,
    SundialsFunctions,
    jacobian_callback,
    residual_callback,
    take_ida_steps,
)
from beamdae.native.linear_solver import LinearSolver
from beamdae.native.loops import CompiledLoop
from beamdae.native.return_codes import DONE, FULL
from beamdae.results.outcome import Statistics
from beamdae.sundials.library import load_library
from beamdae.sundials.solver import IdaSolver

Array = np.ndarray

_BUFFER_STEPS = 64
_MAX_ORDER = 5
# How many of the unknowns that limit the step are told.
_LISTED_UNKNOWNS = 3
# What IDA calls, and its arguments.
_RESIDUAL, _JACOBIAN = (residual_callback, "dppp@"), (jacobian_callback, "ddpppp@ppp")
_RENEW_CALLBACK = ctypes.CFUNCTYPE(ctypes.c_int)
# What IDA counts of failures, and begins to count anew whenever it starts.
_FAILURES = ("error_test_failures", "failed_solves", "newton_failures")


class CompiledIda:
    """IDA, many steps at a time.

    Attributes
    ----------
    code
        How the last steps ended; negative codes are IDA's. There are more after DONE and FULL.
    """

    name = "shared libraries"

    def __init__(
        self,
        form: FirstOrderForm,
        matrix: FactorizedMatrix,
        options: dict[str, Any],
        iteration: dict[str, Any],
    ) -> None:
        """Compile, and make IDA with these options; `matrix` and `iteration` are of `NewtonState`.

        Raises
        ------
        MachineError, UnavailableError
            Where there is no machine code, or no library.
        """
        functions = load_library().addresses
        self._form = form
        self._newton = newton = NewtonState(
            form.buffers(True),
            matrix.linear(True, "sparse"),
            np.zeros(form.size),
            matrix.nonzeros,
            **iteration,
        )
        weights = 1.0 / options["atol"]
        if options["untested"] is not None:
            weights[options["untested"]] = 0.0
        n, m, none = form.equations.n, form.equations.m, np.zeros(0)
        t, order = np.zeros(1), np.zeros(1, np.int32)
        self._run = run = IdaWorkspace(
            newton,
            SundialsFunctions(*(getattr(functions, name) for name in SundialsFunctions.__slots__)),
            int(form.formulation.impulses),
            np.zeros((_BUFFER_STEPS, 1 + 3 * n + m)),
            np.zeros(_MAX_ORDER + 1, np.int64),
            np.zeros(form.size, np.int64),
            weights,
            t,
            none,
            none,
            order,
            none,
            t.ctypes.data,
        )
        self._loop = loop = CompiledLoop(
            take_ida_steps, run, residual=_RESIDUAL, jacobian=_JACOBIAN
        )
        addresses = loop.addresses["residual"], loop.addresses["jacobian"]
        self._solver = solver = IdaSolver(*addresses, user_data=loop.table.ctypes.data, **options)
        run.y, run.yp, run.errors = solver.y, solver.yp, solver.errors
        run.memory, run.y_at, run.yp_at, run.errors_at = solver.pointers
        run.order_at = order.ctypes.data
        self._problems: list[BaseException] = []
        renewing = _pivot_renewal(loop, newton.linear, matrix, self._problems)
        next(renewing)
        self._renew = _RENEW_CALLBACK(renewing.__next__)
        newton.renew_pivots = ctypes.cast(self._renew, ctypes.c_void_p).value or 0
        loop.bind()
        self._failures: Counter[str] = Counter()
        self.code = DONE

    def start(
        self, span: tuple[float, float], branch: float, y: Array, yp: Array, first: float
    ) -> None:
        """Begin anew, for steps from the start to the end of a span, the first one of a length."""
        self._failures = self._failed
        self._newton.branch, self._newton.ready = branch, 0
        self._run.t[0], self._run.end = span
        self._solver.start(span[0], y, yp, first)
        self._solver.stop_at(span[1])
        self.code = DONE

    def advance(self, most: int) -> Array:
        """Rows of up to `most` more steps."""
        run = self._run
        run.most, run.filled = min(most, _BUFFER_STEPS), 0
        # What went before a failure is not lost.
        if self.code in (DONE, FULL):
            self.code = self._loop()
            if self._problems:
                raise self._problems.pop()
        return run.rows[: run.filled]

    @property
    def last(self) -> tuple[Array, Array, Array]:
        """(y, y', R) where it stopped."""
        return self._run.y, self._run.yp, self._newton.raw

    @property
    def _failed(self) -> Counter[str]:
        now = self._solver.statistics
        return self._failures + Counter({name: getattr(now, name) for name in _FAILURES})

    @property
    def counts(self) -> Statistics:
        """What it cost."""
        newton, failed = self._newton, self._failed
        return Statistics(
            rejected_steps=failed["error_test_failures"] + failed["failed_solves"],
            residual_calls=newton.residuals,
            jacobian_calls=newton.jacobians,
            factorizations=newton.linear.factorizations,
            solves=newton.linear.solves,
            newton_failures=failed["newton_failures"],
        )

    @property
    def step_report(self) -> dict[str, Any]:
        """What IDA tells of its steps."""
        orders, limiting = self._run.orders, self._run.limiting
        names, total = self._form.names, max(int(limiting.sum()), 1)
        most = [k for k in np.argsort(-limiting, kind="stable")[:_LISTED_UNKNOWNS] if limiting[k]]
        return {
            "error_test_failures": self._failed["error_test_failures"],
            "orders": {str(k): int(count) for k, count in enumerate(orders) if count},
            "limited_by": {names[k]: round(float(limiting[k]) / total, 3) for k in most},
        }


def _pivot_renewal(
    loop: CompiledLoop,
    linear: LinearSolver,
    matrix: FactorizedMatrix,
    problems: list[BaseException],
) -> Generator[int, None, None]:
    """Find other pivots whenever it is asked to: 1, or 0 after a problem.

    IDA's Jacobian asks, from inside the loop, and nothing can be raised there. A generator waits
    inside its `try`: an interrupt is raised as soon as Python is entered, which is before the first
    line of a function.
    """
    done = 1
    while True:
        try:
            yield done
            # The loop is under way: what it knows is in the table.
            loop.unload()
            matrix.renew_pivots(linear)
            loop.bind()
            done = 1
        except GeneratorExit:
            return
        except BaseException as problem:
            problems.append(problem)
            done = 0
