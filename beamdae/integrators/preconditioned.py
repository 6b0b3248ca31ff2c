"""The linear algebra of IDA's Newton iteration, done outside IDA."""

from __future__ import annotations

from importlib.metadata import version

import numpy as np

from beamdae.equations.formulations import FirstOrder
from beamdae.errors import BeamdaeError
from beamdae.results.solution import Statistics
from beamdae.symbolic.compiled import Compiled
from beamdae.symbolic.factorizations import SingularMatrixError, factorization

Array = np.ndarray

# What rounding leaves of an iterate, relative to its size.
_SHARED = 1e-9


class PreconditionedResidual:
    """The linear algebra of IDA's Newton iteration, done here.

    IDA is given the residual multiplied by the inverse of the Jacobian of its last setup, and the
    identity as Jacobian: its own (diagonal) solver then does nothing but its scaling by
    2 / (1 + c / c_setup). That leaves factorization and solution to LAPACK or SuperLU by size,
    without the cost of a Krylov iteration around them. When IDA asks for a new Jacobian it has
    just evaluated the residual at the same point: that one is multiplied again, with the new
    factors, in the vector IDA passed in for it.
    """

    def __init__(self, form: FirstOrder, linear_solver: str) -> None:
        p = form.equations.p
        self._residual = Compiled(form.residual, p)
        self._jacobian = Compiled(form.jacobian, p, np.zeros(1))
        self._linear = factorization(form.pattern, linear_solver)
        self._time = np.zeros(2)
        self._ready = False
        self._pending = np.zeros(form.size)
        # Whether IDA has been seen to read what is written into its vector, and until then what
        # the next iterate (time, y) has to be if it does.
        self._shared = False
        self._expected: tuple[float, Array] | None = None
        self.accepted = 0
        self._attempts = self._setups = self._attempts_with_setup = self._last_setup = 0

    def restart(self, branch: float) -> None:
        """Begin a smooth interval, without factors."""
        self._time[:] = np.nan, branch
        self._ready = False
        self._expected = None

    def is_finite(self, t: float, y: Array, yp: Array) -> bool:
        """Whether the residual evaluated last is finite, and the one at time `t`."""
        last = bool(np.isfinite(self._residual.outputs[0]).all())
        self._time[0] = t
        return last and bool(np.isfinite(self._residual(self._time, y, yp)[0]).all())

    def residual(self, t: float, y: Array, yp: Array, out: Array) -> None:
        """Residual for IDA, multiplied by the inverse of the last Jacobian."""
        # Every attempt at a step has a time of its own.
        if t != self._time[0]:
            self._attempts += 1
        self._time[0] = t
        if self._expected is not None:
            self._check_shared(t, y)
        self._pending = out
        (raw,) = self._residual(self._time, y, yp)
        out[:] = self._linear.solve(raw) if self._ready else raw

    def jacobian(self, t: float, y: Array, yp: Array, res: Array, c: float, out: Array) -> None:
        """Factorize dR/dy + c dR/dy' and give IDA the identity."""
        self._time[0] = t
        self._setups += 1
        if self._last_setup != self._attempts:
            self._attempts_with_setup += 1
            self._last_setup = self._attempts
        self._jacobian.inputs[-1][0] = c
        (nonzeros,) = self._jacobian(self._time, y, yp)
        try:
            self._linear.factorize(nonzeros)
        except SingularMatrixError:
            # IDA retries with a smaller step, and reports where it had to give up.
            self._pending[:] = np.nan
            return
        self._ready = True
        self._pending[:] = self._linear.solve(self._residual.outputs[0])
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
        if np.max(np.abs(y - expected)) > _SHARED * size:
            raise BeamdaeError(
                f"Ida: scikit-sundae {version('scikit-sundae')} hands out copies of IDA's vectors, "
                "it must be one that shares them: pip install 'scikit-sundae>=1.2,<1.3'."
            )
        self._shared = True

    @property
    def counts(self) -> Statistics:
        """What it cost."""
        return Statistics(
            rejected_steps=max(self._attempts - self.accepted, 0),
            residual_calls=self._residual.calls,
            jacobian_calls=self._jacobian.calls,
            factorizations=self._linear.factorizations,
            solves=self._linear.solves,
            newton_failures=self._setups - self._attempts_with_setup,
        )
