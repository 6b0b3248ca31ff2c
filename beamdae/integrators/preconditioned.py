"""The linear algebra of IDA's Newton iteration, done outside IDA."""

from __future__ import annotations

import numpy as np

from beamdae.equations.formulations import FirstOrder
from beamdae.results.solution import Statistics
from beamdae.symbolic.compiled import Compiled
from beamdae.symbolic.factorizations import SingularMatrixError, factorization

Array = np.ndarray


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
        self.linear = factorization(form.pattern, linear_solver)
        self.time = np.zeros(2)
        self._ready = False
        self._pending = np.zeros(form.size)
        self.steps = 0
        self.times: list[float] = []
        self.setups: list[int] = []

    def restart(self, phase: float) -> None:
        """Begin a smooth interval, without factors."""
        self.time[1] = phase
        self._ready = False

    @property
    def last_residual(self) -> Array:
        """The residual evaluated last, as it is."""
        return self._residual.outputs[0]

    def residual(self, t: float, y: Array, yp: Array, out: Array) -> None:
        """Residual for IDA, multiplied by the inverse of the last Jacobian."""
        self.time[0] = t
        self.times.append(t)
        self._pending = out
        (raw,) = self._residual(self.time, y, yp)
        out[:] = self.linear.solve(raw) if self._ready else raw

    def jacobian(self, t: float, y: Array, yp: Array, res: Array, c: float, out: Array) -> None:
        """Factorize dR/dy + c dR/dy' and give IDA the identity."""
        self.time[0] = t
        self.setups.append(len(self.times))
        self._jacobian.inputs[-1][0] = c
        (nonzeros,) = self._jacobian(self.time, y, yp)
        try:
            self.linear.factorize(nonzeros)
        except SingularMatrixError:
            # IDA retries with a smaller step, and reports where it had to give up.
            self._pending[:] = np.nan
            return
        self._ready = True
        self._pending[:] = self.linear.solve(self._residual.outputs[0])
        np.fill_diagonal(out, 1.0)

    def statistics(self, setup_time: float, wall_time: float) -> Statistics:
        """What it cost."""
        times = np.array(self.times)
        change = np.flatnonzero(np.diff(times, prepend=-np.inf) != 0.0)
        attempts = len(change)
        renewed = len(self.setups) - len(np.unique(np.searchsorted(change, self.setups)))
        return Statistics(
            steps=self.steps,
            rejected_steps=max(attempts - self.steps, 0),
            residual_calls=self._residual.calls,
            jacobian_calls=self._jacobian.calls,
            factorizations=self.linear.factorizations,
            solves=self.linear.solves,
            newton_failures=renewed,
            setup_time=setup_time,
            wall_time=wall_time,
        )
