"""Interface to IDA through scikit-sundae: fallback without machine code or shared libraries.

Used with BEAMDAE_NATIVE=off, without numba or llvmlite, and where the functions of SUNDIALS cannot
be loaded (`sundials.library`): in builds with static libraries, with MPI, with 64-bit indices or
with another major version. Its results agree with those of the C interface within the tolerance,
but it runs in plain Python, which is 15 to 30 times slower than machine code. Unlike ctypes
callbacks, its callbacks can be interrupted at any time.
"""

from __future__ import annotations

import contextlib
import sys
import threading
import warnings
from types import TracebackType
from typing import Any, TextIO

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
from beamdae.linear.factorizations import DENSE_LIMIT
from beamdae.memory import require_memory
from beamdae.native.return_codes import DONE
from beamdae.package_versions import installed_version
from beamdae.results.outcome import Statistics

Array = np.ndarray

# Relative rounding error of an iterate.
_ITERATE_ROUNDING = 1e-9
# Memory of scikit-sundae's band solver per entry of the full matrix [bytes].
_BAND_BYTES_PER_ENTRY = 8.0


class SksundaeCallbacks:
    """Residual and Jacobian callbacks for scikit-sundae; see `callbacks`.

    Attributes
    ----------
    newton
        Equations and linear algebra of the Newton iteration.
    accepted_steps
        Number of accepted steps.
    """

    def __init__(self, form: FirstOrderForm, linear_solver: str, iteration: dict[str, Any]) -> None:
        matrix = FactorizedMatrix.from_pattern(form.pattern)
        linear = matrix.make_solver(False, linear_solver)
        raw_residual = np.zeros(form.size)
        self.newton = NewtonState(
            form.buffers(), linear, raw_residual, matrix.nonzeros, **iteration
        )
        self.accepted_steps = 0
        self._t = np.nan
        self._residual_vector = np.zeros(form.size)
        # True once it is verified that IDA reads values written into its vectors. Until then,
        # `_expected_iterate` is the time and value that the next iterate must have.
        self._vectors_are_shared = False
        self._expected_iterate: tuple[float, Array] | None = None
        self._attempts = self._setups = self._attempts_with_setup = self._last_setup = 0

    def restart(self, branch: float) -> None:
        """Discard the factors, and use the laws of the interval around `branch` [s]."""
        self.newton.branch, self.newton.has_factors = branch, 0
        self._t = np.nan
        self._expected_iterate = None

    def residual(self, t: float, y: Array, yp: Array, out: Array) -> None:
        """Write the residual for IDA to `out`; see `evaluate_preconditioned`."""
        # Every attempt at a step ends at a different time.
        if t != self._t:
            self._attempts += 1
        self._t = t
        if self._expected_iterate is not None:
            self._check_shared_vectors(t, y)
        self._residual_vector = out
        if evaluate_preconditioned(self.newton, t, y, yp, out) != DONE:
            # IDA computes new factors or retries with a smaller step.
            out[:] = np.nan

    def jacobian(self, t: float, y: Array, yp: Array, res: Array, c: float, out: Array) -> None:
        """Factorize dR/dy + c dR/dy', and write the identity into `out` if this succeeds."""
        self._setups += 1
        if self._last_setup != self._attempts:
            self._attempts_with_setup += 1
            self._last_setup = self._attempts
        if factorize_jacobian(self.newton, t, c, y, yp, self._residual_vector) != DONE:
            # IDA retries with a smaller step, and reports a failure if this does not help.
            self._residual_vector[:] = np.nan
            return
        if not self._vectors_are_shared and np.isfinite(self._residual_vector).all():
            self._expected_iterate = t, y - self._residual_vector
        # `out` is a full matrix, or the diagonal of a sparse matrix.
        if out.ndim == 2:
            np.fill_diagonal(out, 1.0)
        else:
            out[:] = 1.0

    def _check_shared_vectors(self, t: float, y: Array) -> None:
        """Reject versions of scikit-sundae that pass copies of IDA's vectors.

        The first iterate after a setup must be y minus the values written into the vector that IDA
        passed. With a copy, it would be y minus the earlier residual, and runs would be wrong
        without a warning.
        """
        assert self._expected_iterate is not None
        time, expected = self._expected_iterate
        self._expected_iterate = None
        # The iteration has converged without another iterate; this is the next step.
        if t != time:
            return
        size = float(np.max(np.abs(self._residual_vector))) + float(np.max(np.abs(expected)))
        if np.max(np.abs(y - expected)) > _ITERATE_ROUNDING * size:
            raise BeamdaeError(
                f"Ida: scikit-sundae {installed_version('scikit-sundae')} copies the vectors of "
                "IDA instead of sharing them; run pip install "
                "'scikit-sundae>=1.2,<1.3'."
            )
        self._vectors_are_shared = True

    @property
    def counts(self) -> Statistics:
        """Numbers of function calls, rejected steps, factorizations and failures so far."""
        newton = self.newton
        return Statistics(
            rejected_steps=max(self._attempts - self.accepted_steps, 0),
            residual_calls=newton.residuals,
            jacobian_calls=newton.jacobians,
            factorizations=newton.linear.factorizations,
            solves=newton.linear.solves,
            newton_failures=self._setups - self._attempts_with_setup,
        )


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
        linear_solver: str,
        options: dict[str, Any],
        iteration: dict[str, Any],
    ) -> None:
        self._form = form
        self._options = {name: x for name, x in options.items() if name != "untested"}
        self._callbacks = SksundaeCallbacks(form, linear_solver, iteration)
        self.code = DONE
        self.step_report: dict[str, Any] = {}

    def start(
        self, span: tuple[float, float], branch: float, y: Array, yp: Array, first_step: float
    ) -> None:
        """Restart IDA for `span` = (start, end) [s]; the first step is at most `first_step` [s]."""
        self._callbacks.restart(branch)
        self._t, self._end = span
        self._stop = self._end
        self._solver = _make_ida(
            self._callbacks, self._form.size, first_step=first_step, **self._options
        )
        self._solver.init_step(self._t, y, yp)
        self.code = DONE

    def extend(self, end: float) -> None:
        """Continue to `end` [s] with the order, the step and the factors of the last steps."""
        self._end = self._stop = end

    def advance(self, most: int) -> Array:
        """Take one step; return its row (t, q, v, a, lam), none after a failure."""
        # SUNDIALS prints errors that are also in the status.
        with suppress_stdout:
            result = self._solver.step(self._end, "onestep", self._stop)
        self._y, self._yp = result.y, result.yp
        self.code = DONE if result.t > self._t else NO_ADVANCE
        if not result.success:
            self.code = int(result.status)
        if self.code != DONE:
            return np.zeros((0, 0))
        self._stop = next_stop_time(self._t, result.t, self._end)
        self._t = result.t
        self._callbacks.accepted_steps += 1
        self._callbacks.newton.age += 1
        return np.concatenate([[result.t], *self._form.unpack(result.y, result.yp)])[None]

    @property
    def last_point(self) -> tuple[Array, Array, Array]:
        """Last y and y' returned by IDA, and the last residual before premultiplication."""
        return self._y, self._yp, self._callbacks.newton.raw_residual

    @property
    def counts(self) -> Statistics:
        """Numbers of function calls, rejected steps, factorizations and failures so far."""
        return self._callbacks.counts


def _make_ida(callbacks: SksundaeCallbacks, size: int, **options: Any) -> IDA:
    """Return a scikit-sundae solver with the cheapest linear solver for the identity.

    scikit-sundae allocates a full matrix for its band solver, which dominates time and memory of
    larger systems. For these, SuperLU_MT is used if it is built in.
    """
    options["jacfn"] = callbacks.jacobian
    if size > DENSE_LIMIT:
        with warnings.catch_warnings(), contextlib.suppress(ValueError):
            # The warning asks for a pattern that fits the Jacobian; the identity fits its pattern.
            warnings.filterwarnings("ignore", message="Custom sparse Jacobian")
            pattern = sp.eye_array(size, format="csc")
            return IDA(callbacks.residual, linsolver="sparse", sparsity=pattern, **options)
    what = f"the band solver of scikit-sundae for {size} unknowns"
    remedy = "use a build with SuperLU_MT, fewer elements or another integrator"
    require_memory("Ida", what, _BAND_BYTES_PER_ENTRY * size**2, remedy)
    return IDA(callbacks.residual, linsolver="band", lband=0, uband=0, **options)


class _ThreadFilter:
    """Stream that drops the output of silenced threads and forwards all other output."""

    def __init__(self, stream: TextIO, silenced: dict[int, int]) -> None:
        self._stream, self._silenced = stream, silenced

    def write(self, text: str) -> int:
        if threading.get_ident() in self._silenced:
            return len(text)
        return self._stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


class _SuppressStdout(contextlib.AbstractContextManager[None]):
    """Context manager that suppresses the standard output of the entering thread.

    `contextlib.redirect_stdout` would replace sys.stdout for all threads, and two overlapping uses
    would leave it replaced.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._silenced: dict[int, int] = {}
        self._original: TextIO | None = None

    def __enter__(self) -> None:
        thread = threading.get_ident()
        with self._lock:
            if not self._silenced:
                self._original = sys.stdout
                sys.stdout = _ThreadFilter(sys.stdout, self._silenced)
            self._silenced[thread] = self._silenced.get(thread, 0) + 1

    def __exit__(
        self,
        kind: type[BaseException] | None,
        problem: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        thread = threading.get_ident()
        with self._lock:
            self._silenced[thread] -= 1
            if not self._silenced[thread]:
                del self._silenced[thread]
            if not self._silenced and self._original is not None:
                if isinstance(sys.stdout, _ThreadFilter):
                    sys.stdout = self._original
                self._original = None


suppress_stdout = _SuppressStdout()
