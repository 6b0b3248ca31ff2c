"""Interface to IDA through its C library, with callbacks and step loop in the core."""

from __future__ import annotations

import ctypes
from collections.abc import Generator
from types import SimpleNamespace
from typing import Any

import numpy as np

from beamdae.core.library import function_address
from beamdae.core.linear_solver import LinearSolver
from beamdae.core.return_codes import DONE, FULL
from beamdae.core.tables import Loop, Workspace
from beamdae.equations.formulations.first_order import FirstOrderForm
from beamdae.integrators.compiled_run import FactorizedMatrix
from beamdae.integrators.integrator import allocate_rows
from beamdae.results.outcome import Statistics
from beamdae.sundials import IdaSolver, load_library

Array = np.ndarray

_MAX_ORDER = 5
# Maximum number of unknowns listed in "limited_by" of the step report.
_LISTED_UNKNOWNS = 3
_RENEW_CALLBACK = ctypes.CFUNCTYPE(ctypes.c_int)
# Counters that IDA resets at every start.
_FAILURE_COUNTS = ("error_test_failures", "failed_solves", "newton_failures")


class CompiledIda:
    """IDA with callbacks of the core and several steps per call.

    Attributes
    ----------
    name
        Value of "ida" in `Solution.integrator`.
    code
        Return code of the last call: DONE, FULL, NO_ADVANCE or a negative code of IDA. After
        NO_ADVANCE and negative codes, no steps are possible before the next `start`.
    """

    name = "shared libraries"

    def __init__(
        self,
        form: FirstOrderForm,
        matrix: FactorizedMatrix,
        options: dict[str, Any],
        iteration: dict[str, Any],
    ) -> None:
        """Bind the callbacks and create the IDA solver.

        Parameters
        ----------
        form, matrix
            Equations, and the matrix to factorize.
        options
            Keyword arguments of `IdaSolver`.
        iteration
            Fields of `NewtonState` in `core.h`: the scaling of the kinematic rows and the applied
            fraction of each Newton correction.

        Raises
        ------
        UnavailableError
            If the shared library is not available.
        """
        functions = load_library().addresses
        self._form = form
        self._newton = newton = Workspace(
            "NewtonState",
            form=form.buffers(),
            linear=matrix.make_solver(),
            raw_residual=np.zeros(form.size),
            nonzeros=matrix.nonzeros,
            **iteration,
        )
        weights = 1.0 / options["atol"]
        if options["untested"] is not None:
            weights[options["untested"]] = 0.0
        n, m, empty = form.equations.n, form.equations.m, np.zeros(0)
        t, order = np.zeros(1), np.zeros(1, np.int32)
        self._run = run = Workspace(
            "IdaWorkspace",
            newton=newton,
            sundials=SimpleNamespace(**functions),
            has_impulses=int(form.formulation.impulses),
            rows=allocate_rows(1 + 3 * n + m),
            orders=np.zeros(_MAX_ORDER + 1, np.intp),
            limiting_counts=np.zeros(form.size, np.intp),
            weights=weights,
            t=t,
            y=empty,
            yp=empty,
            order=order,
            errors=empty,
            t_address=t.ctypes.data,
            order_address=order.ctypes.data,
        )
        self._loop = loop = Loop("take_ida_steps", run)
        addresses = function_address("residual_callback"), function_address("jacobian_callback")
        self._solver = solver = IdaSolver(*addresses, user_data=loop.table.ctypes.data, **options)
        run.y, run.yp, run.errors = solver.y, solver.yp, solver.errors
        run.memory, run.y_vector, run.yp_vector, run.errors_vector = solver.pointers
        self._problems: list[BaseException] = []
        renewal = _pivot_renewal(loop, newton.linear, matrix, self._problems)
        next(renewal)
        self._renew = _RENEW_CALLBACK(renewal.__next__)
        newton.renew_address = ctypes.cast(self._renew, ctypes.c_void_p).value or 0
        loop.bind()
        self._earlier_failures = dict.fromkeys(_FAILURE_COUNTS, 0)
        self.code = DONE

    def start(
        self, span: tuple[float, float], branch: float, y: Array, yp: Array, first_step: float
    ) -> None:
        """Restart IDA for `span` = (start, end) [s]; the first step is at most `first_step` [s]."""
        self._earlier_failures = self._count_failures()
        self._newton.branch, self._newton.has_factors = branch, 0
        self._run.t[0], self._run.end = span
        self._solver.start(span[0], y, yp, first_step)
        self._solver.stop_at(span[1])
        self.code = DONE

    def extend(self, end: float) -> None:
        """Continue to `end` [s] with the order, the step and the factors of the last steps."""
        self._run.end = end
        self._solver.stop_at(end)

    def advance(self, most: int) -> Array:
        """Take up to `most` steps; return their rows (t, q, v, a, lam), none after a failure.

        An exception during the renewal of pivots, such as KeyboardInterrupt, is raised here.
        """
        run = self._run
        run.most, run.filled = min(most, len(run.rows)), 0
        # Steps before a failure are returned first; the next call returns no rows.
        if self.code in (DONE, FULL):
            self.code = self._loop()
            if self._problems:
                raise self._problems.pop()
        return run.rows[: run.filled]

    @property
    def last_point(self) -> tuple[Array, Array, Array]:
        """Last y and y' returned by IDA, and the last residual before premultiplication."""
        return self._run.y, self._run.yp, self._newton.raw_residual

    def _count_failures(self) -> dict[str, int]:
        recent = zip(_FAILURE_COUNTS, self._solver.failures, strict=True)
        return {name: self._earlier_failures[name] + count for name, count in recent}

    @property
    def counts(self) -> Statistics:
        """Numbers of function calls, rejected steps, factorizations and Newton failures so far."""
        newton, failures = self._newton, self._count_failures()
        return Statistics(
            rejected_steps=failures["error_test_failures"] + failures["failed_solves"],
            residual_calls=newton.residuals,
            jacobian_calls=newton.jacobians,
            factorizations=newton.linear.factorizations,
            solves=newton.linear.solves,
            newton_failures=failures["newton_failures"],
        )

    @property
    def step_report(self) -> dict[str, Any]:
        """Error test failures, steps per order, and at most three unknowns that limit steps."""
        orders, limiting = self._run.orders, self._run.limiting_counts
        names, total = self._form.names, max(int(limiting.sum()), 1)
        descending = np.argsort(-limiting, kind="stable")
        listed_unknowns = [k for k in descending[:_LISTED_UNKNOWNS] if limiting[k]]
        return {
            "error_test_failures": self._count_failures()["error_test_failures"],
            "orders": {str(k): int(count) for k, count in enumerate(orders) if count},
            "limited_by": {names[k]: round(float(limiting[k]) / total, 3) for k in listed_unknowns},
        }


def _pivot_renewal(
    loop: Loop,
    linear: LinearSolver,
    matrix: FactorizedMatrix,
    problems: list[BaseException],
) -> Generator[int, None, None]:
    """Set new pivots on each request; yield 1, or 0 after storing an exception in `problems`.

    The request comes from the Jacobian callback inside the compiled loop, where no exception may be
    raised. A generator is used because it waits inside its `try` block: Python raises a pending
    interrupt on entry, which for a function would be before its first line.
    """
    success = 1
    while True:
        try:
            yield success
            # The loop is running, so its current values are in the table.
            loop.unload()
            matrix.renew_pivots(linear)
            loop.bind(linear)
            success = 1
        except GeneratorExit:
            return
        except BaseException as problem:
            problems.append(problem)
            success = 0
