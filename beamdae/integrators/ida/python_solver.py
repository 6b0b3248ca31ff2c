"""IDA by scikit-sundae's class, where its libraries or machine code cannot be had."""

from __future__ import annotations

import contextlib
import warnings
from importlib.metadata import version
from typing import Any

import numpy as np
import scipy.sparse as sp
from sksundae.ida import IDA

from beamdae.equations.formulations.first_order import FirstOrderForm
from beamdae.errors import BeamdaeError
from beamdae.integrators.compiled_run import FactorizedMatrix
from beamdae.integrators.ida.callbacks import (
    NO_ADVANCE,
    NewtonState,
    evaluate_preconditioned,
    factorize_jacobian,
    next_stop_time,
)
from beamdae.integrators.ida.suppress_stdout import suppress_stdout
from beamdae.linear.factorizations import DENSE_LIMIT
from beamdae.memory import require_memory
from beamdae.native.return_codes import DONE
from beamdae.results.outcome import Statistics

Array = np.ndarray

# What rounding leaves of an iterate, relative to its size.
_SHARED_TOLERANCE = 1e-9
# What scikit-sundae takes for its band solver, for each entry of the full matrix [bytes].
_BAND_BYTES_PER_ENTRY = 8.0


class SksundaeCallbacks:
    """What scikit-sundae's class calls: `ida_loop` has the mathematics."""

    def __init__(self, form: FirstOrderForm, linear_solver: str, iteration: dict[str, Any]) -> None:
        matrix = FactorizedMatrix.of(form.pattern)
        linear = matrix.linear(False, linear_solver)
        raw = np.zeros(form.size)
        self.newton = NewtonState(form.buffers(), linear, raw, matrix.nonzeros, **iteration)
        self._t = np.nan
        self._pending = np.zeros(form.size)
        # Whether IDA has been seen to read what is written into its vector, and until then what
        # the next iterate (time, y) has to be if it does.
        self._shared = False
        self._expected: tuple[float, Array] | None = None
        self.accepted = 0
        self._attempts = self._setups = self._attempts_with_setup = self._last_setup = 0

    def restart(self, branch: float) -> None:
        """Begin anew, without factors."""
        self.newton.branch, self.newton.ready = branch, 0
        self._t = np.nan
        self._expected = None

    def residual(self, t: float, y: Array, yp: Array, out: Array) -> None:
        """Residual for IDA, multiplied by the inverse of the last Jacobian."""
        # Every attempt at a step has a time of its own.
        if t != self._t:
            self._attempts += 1
        self._t = t
        if self._expected is not None:
            self._check_shared(t, y)
        self._pending = out
        evaluate_preconditioned(self.newton, t, y, yp, out)

    def jacobian(self, t: float, y: Array, yp: Array, res: Array, c: float, out: Array) -> None:
        """Factorize dR/dy + c dR/dy' and give IDA the identity."""
        self._setups += 1
        if self._last_setup != self._attempts:
            self._attempts_with_setup += 1
            self._last_setup = self._attempts
        if factorize_jacobian(self.newton, t, c, y, yp, self._pending) != DONE:
            # IDA retries with a smaller step, and reports where it had to give up.
            self._pending[:] = np.nan
            return
        if not self._shared and np.isfinite(self._pending).all():
            self._expected = t, y - self._pending
        # The diagonal of a full matrix, or all there is of a sparse one.
        if out.ndim == 2:
            np.fill_diagonal(out, 1.0)
        else:
            out[:] = 1.0

    def _check_shared(self, t: float, y: Array) -> None:
        """Refuse a scikit-sundae that hands out copies of IDA's vectors.

        The first iterate after a setup is y minus what was written into the vector IDA passed in:
        with a copy it is y minus the residual as it was, and runs would end far off in silence.
        """
        assert self._expected is not None
        time, expected = self._expected
        self._expected = None
        # Where the iteration converged at once, IDA has gone on to the next step.
        if t != time:
            return
        size = float(np.max(np.abs(self._pending))) + float(np.max(np.abs(expected)))
        if np.max(np.abs(y - expected)) > _SHARED_TOLERANCE * size:
            raise BeamdaeError(
                f"Ida: scikit-sundae {version('scikit-sundae')} hands out copies of IDA's vectors, "
                "it must be one that shares them: pip install 'scikit-sundae>=1.2,<1.3'."
            )
        self._shared = True

    @property
    def counts(self) -> Statistics:
        """What it cost."""
        newton = self.newton
        return Statistics(
            rejected_steps=max(self._attempts - self.accepted, 0),
            residual_calls=newton.residuals,
            jacobian_calls=newton.jacobians,
            factorizations=newton.linear.factorizations,
            solves=newton.linear.solves,
            newton_failures=self._setups - self._attempts_with_setup,
        )


class SksundaeIda:
    """IDA by scikit-sundae's class, a step at a time; see `ida_compiled.CompiledIda`.

    It has no way to leave out of the error test what Newton's iteration is tested in: "untested"
    unknowns are tested in both.
    """

    name = "scikit-sundae"

    def __init__(
        self,
        form: FirstOrderForm,
        linear_solver: str,
        options: dict[str, Any],
        iteration: dict[str, Any],
    ) -> None:
        self._form = form
        self._options = {name: x for name, x in options.items() if name != "untested"}
        self._called = SksundaeCallbacks(form, linear_solver, iteration)
        self.code = DONE
        # It tells nothing of its steps.
        self.step_report: dict[str, Any] = {}

    def start(
        self, span: tuple[float, float], branch: float, y: Array, yp: Array, first: float
    ) -> None:
        """Begin anew, for steps from the start to the end of a span, the first one of a length."""
        self._called.restart(branch)
        self._t, self._end = span
        self._stop = self._end
        self._solver = _make_ida(self._called, self._form.size, first_step=first, **self._options)
        self._solver.init_step(self._t, y, yp)
        self.code = DONE

    def advance(self, most: int) -> Array:
        """One row, or none."""
        with suppress_stdout:
            # SUNDIALS prints its errors; the status says them.
            result = self._solver.step(self._end, "onestep", self._stop)
        self._y, self._yp = result.y, result.yp
        self.code = DONE if result.t > self._t else NO_ADVANCE
        if not result.success:
            self.code = int(result.status)
        if self.code != DONE:
            return np.zeros((0, 0))
        self._stop = next_stop_time(self._t, result.t, self._end)
        self._t = result.t
        self._called.accepted += 1
        return np.concatenate([[result.t], *self._form.unpack(result.y, result.yp)])[None]

    @property
    def last(self) -> tuple[Array, Array, Array]:
        """(y, y', R) where it stopped."""
        return self._y, self._yp, self._called.newton.raw

    @property
    def counts(self) -> Statistics:
        """What it cost."""
        return self._called.counts


def _make_ida(called: SksundaeCallbacks, size: int, **options: Any) -> IDA:
    """IDA with a solver for the identity, which is all that is left for it to solve.

    For its band solver scikit-sundae keeps a full matrix: beyond small systems that takes more time
    and memory than all the rest, and SuperLU, where it is built in, takes over.
    """
    options["jacfn"] = called.jacobian
    if size > DENSE_LIMIT:
        with warnings.catch_warnings(), contextlib.suppress(ValueError):
            # It says that the pattern goes with the Jacobian given.
            warnings.filterwarnings("ignore", message="Custom sparse Jacobian")
            pattern = sp.eye_array(size, format="csc")
            return IDA(called.residual, linsolver="sparse", sparsity=pattern, **options)
    what = f"scikit-sundae without SuperLU_MT, for {size} unknowns,"
    remedy = "install one that has it, take fewer elements, or another integrator"
    require_memory("Ida", what, _BAND_BYTES_PER_ENTRY * size**2, remedy)
    return IDA(called.residual, linsolver="band", lband=0, uband=0, **options)
