"""Interface to IDA through scikit-sundae: fallback without the core or shared libraries.

Used where the core cannot be compiled, and where the functions of SUNDIALS cannot be loaded
(`beamdae.sundials`): in builds with static libraries, with MPI, with 64-bit indices or with another
major version. Its results agree with those of the C interface within the tolerance, but it runs in
plain Python, which is 15 to 30 times slower than the core.
"""

from __future__ import annotations

import contextlib
import io
import threading
import warnings
from typing import Any

import numpy as np
from sksundae.ida import IDA

from beamdae.core.return_codes import DONE, NO_ADVANCE
from beamdae.equations.formulations.first_order import FirstOrderForm
from beamdae.integrators.ida.kinematic_scaling import scale_jacobian, scale_residual
from beamdae.linear.factorizations import DENSE_LIMIT
from beamdae.memory import require_memory
from beamdae.results.outcome import Statistics

Array = np.ndarray

_BYTES_PER_NUMBER = 8.0
# Relative difference below which two steps are equal.
_STEP_ROUNDING = 1e-6
# The standard output belongs to all threads.
_output_lock = threading.Lock()


class SksundaeIda:
    """IDA through scikit-sundae, one step per call; cf. `compiled_solver.CompiledIda`.

    The option "untested" is ignored: multipliers that have tolerances for Newton's iteration are
    also in the error test.

    Attributes
    ----------
    name
        Value of "ida" in `Solution.integrator`.
    code
        Return code of the last step: DONE, NO_ADVANCE or a negative code of IDA.
    step_report
        Empty, because scikit-sundae does not report orders or errors of steps.
    """

    name = "scikit-sundae"

    def __init__(
        self,
        form: FirstOrderForm,
        options: dict[str, Any],
        iteration: dict[str, Any],
    ) -> None:
        self._form = form
        self._options = {name: x for name, x in options.items() if name != "untested"}
        self._kinematic = iteration["kinematic"]
        self._fraction: float = iteration["correction_fraction"]
        self._is_sparse = form.size > DENSE_LIMIT
        self._columns = np.repeat(np.arange(form.size), np.diff(form.pattern.indptr))
        self._residual = np.zeros(form.size)
        self._attempts = self._residuals = self._jacobians = self._steps = 0
        self._attempted = np.nan
        self.code = DONE
        self.step_report: dict[str, Any] = {}

    def start(
        self, span: tuple[float, float], branch: float, y: Array, yp: Array, first_step: float
    ) -> None:
        """Restart IDA for `span` = (start, end) [s]; the first step is at most `first_step` [s]."""
        self._branch = branch
        self._t, self._end = span
        self._stop = self._end
        self._solver = self._make_solver({"first_step": first_step, **self._options})
        self._solver.init_step(self._t, y, yp)
        self._y, self._yp = y, yp
        self.code = DONE

    def _make_solver(self, options: dict[str, Any]) -> IDA:
        """Return a solver with SuperLU_MT, or with a full matrix if that is not built in."""
        options["jacfn"] = self._evaluate_jacobian
        if self._is_sparse:
            with warnings.catch_warnings(), contextlib.suppress(ValueError):
                warnings.filterwarnings("ignore", message="Custom sparse Jacobian")
                return IDA(
                    self._evaluate, linsolver="sparse", sparsity=self._form.pattern, **options
                )
        what = f"the dense solver of scikit-sundae for {self._form.size} unknowns"
        remedy = "use a build with SuperLU_MT, fewer elements or another integrator"
        require_memory("Ida", what, _BYTES_PER_NUMBER * self._form.size**2, remedy)
        return IDA(self._evaluate, linsolver="dense", **options)

    def _evaluate(self, t: float, y: Array, yp: Array, out: Array) -> None:
        """Write the residual for IDA to `out`."""
        # Every attempt at a step ends at a different time.
        self._attempts += t != self._attempted
        self._attempted, self._residuals = t, self._residuals + 1
        self._residual = self._form.residual(np.array([t, self._branch]), y, yp)
        scale_residual(self._kinematic, y, yp, self._residual)
        out[:] = self._fraction * self._residual

    def _evaluate_jacobian(
        self, t: float, y: Array, yp: Array, res: Array, c: float, out: Array
    ) -> None:
        """Write dR/dy + c dR/dy' to `out`, a full matrix or the non-zeros of a sparse one."""
        self._jacobians += 1
        nonzeros = self._form.jacobian(np.array([t, self._branch]), y, yp, c)
        scale_jacobian(self._kinematic, c, nonzeros)
        if out.ndim == 1:
            out[:] = nonzeros
        else:
            out[self._form.pattern.indices, self._columns] = nonzeros

    def extend(self, end: float) -> None:
        """Continue to `end` [s] with the order, the step and the factors of the last steps."""
        self._end = self._stop = end

    def advance(self, most: int) -> Array:
        """Take one step; return its row (t, q, v, a, lam), none after a failure."""
        # SUNDIALS prints errors that are also in the status.
        with _output_lock, contextlib.redirect_stdout(io.StringIO()):
            result = self._solver.step(self._end, "onestep", self._stop)
        self._y, self._yp = result.y, result.yp
        self.code = DONE if result.t > self._t else NO_ADVANCE
        if not result.success:
            self.code = int(result.status)
        if self.code != DONE:
            return np.zeros((0, 0))
        self._stop = _next_stop_time(self._t, result.t, self._end)
        self._t = result.t
        self._steps += 1
        return np.concatenate([[result.t], *self._form.unpack(result.y, result.yp)])[None]

    @property
    def last_point(self) -> tuple[Array, Array, Array]:
        """Last y and y' returned by IDA, and the last residual."""
        return self._y, self._yp, self._residual

    @property
    def counts(self) -> Statistics:
        """Numbers of function calls, rejected steps, factorizations and failures so far."""
        return Statistics(
            rejected_steps=max(self._attempts - self._steps, 0),
            residual_calls=self._residuals,
            jacobian_calls=self._jacobians,
            factorizations=self._jacobians,
            solves=self._residuals,
            newton_failures=0,
        )


def _next_stop_time(before: float, t: float, end: float) -> float:
    """Return the latest end [s] of the next step, after one from `before` to `t`; see ida.c."""
    step, remaining = t - before, end - t
    if (1.0 + _STEP_ROUNDING) * step < remaining < 2.0 * step:
        return t + 0.5 * remaining
    return end
