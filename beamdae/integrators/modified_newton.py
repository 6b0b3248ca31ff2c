"""Modified Newton iteration on the equations of one implicit step."""

from __future__ import annotations

import math

import numpy as np

from beamdae.equations.step_equations import StepEquations
from beamdae.integrators.drive import StepError
from beamdae.results.solution import Statistics
from beamdae.symbolic.compiled import Compiled
from beamdae.symbolic.factorizations import SingularMatrixError, factorization

Array = np.ndarray

_MAX_ITERATIONS = 12
# What rounding leaves of an increment relative to the scale of its coordinate, and relative to the
# size of the mechanism where that is much larger.
_ROUNDING, _ROUNDING_OF_SIZE = 1e-14, 1e-15
# The factors are kept while every iteration gains this much.
_KEEP_RATE = 0.05
# Slower than this, and new factors are found within the iteration.
_SLOW_RATE = 0.2


class NewtonError(StepError):
    """The iteration did not converge, even with a new factorization.

    `reason` is the message without the advice.
    """

    def __init__(self, reason: str, advice: str) -> None:
        super().__init__(f"{reason}; {advice}")
        self.reason = reason


class ModifiedNewton:
    """Modified Newton iteration that keeps its factors as long as they serve."""

    def __init__(
        self, form: StepEquations, tolerance: float, linear_solver: str, scales: Array
    ) -> None:
        p = form.equations.p
        self._residual = Compiled(form.residual, p)
        self._jacobian = Compiled(form.jacobian, p)
        self._position = Compiled(form.position, p)
        self._linear = factorization(form.pattern, linear_solver)
        self.weights = 1.0 / scales
        self.coordinates = form.equations.n
        self._tolerance = tolerance
        size = float(np.max(form.equations.position_scales * self.weights))
        self._least = max(_ROUNDING, _ROUNDING_OF_SIZE * size)
        self.bound = self._least
        self._rate = np.inf
        self.size = form.size
        self.failures = 0

    def position(self, x: Array, time: Array, q_p: Array, q_n: Array) -> Array:
        """Positions of the solution x of a step from q_n."""
        return self._position(x, time, q_p, q_n)[0].copy()

    def restart(self) -> None:
        """Forget the factors."""
        self._rate = np.inf

    def aim(self, c_q: float, acceleration: Array) -> None:
        """Set the bound on the error of increments, c_q times that of accelerations."""
        largest = float(np.abs(acceleration * self.weights).max())
        self.bound = max(self._tolerance * c_q * largest, self._least)

    def solve(self, x: Array, *arguments: Array, second_guess: Array) -> None:
        """Improve x in place until the step equations hold.

        From x with the factors there are, with new ones, and from the increments `second_guess`.

        Raises
        ------
        NewtonError
            If all of that fails.
        """
        start = x.copy()
        if self._rate <= _KEEP_RATE:
            if self._iterate(x, arguments, renew=False):
                return
            self.failures += 1
        for guess in (start[: self.coordinates], second_guess):
            x[:] = start
            x[: self.coordinates] = guess
            try:
                self._factorize(x, arguments)
                if self._iterate(x, arguments, renew=True):
                    return
                reason = "Newton's iteration did not converge"
            except SingularMatrixError as problem:
                reason = str(problem)
            self.failures += 1
        raise NewtonError(reason, "take a smaller step")

    def _factorize(self, x: Array, arguments: tuple[Array, ...]) -> None:
        self._linear.factorize(self._jacobian(x, *arguments)[0])
        self._rate = 0.0

    def _iterate(self, x: Array, arguments: tuple[Array, ...], renew: bool) -> bool:
        previous = np.inf
        raw = self._residual(x, *arguments)[0]
        for k in range(_MAX_ITERATIONS):
            if k > 0:
                self._residual(x)
            change = self._linear.solve(raw)
            x -= change
            scaled = change[: self.coordinates] * self.weights
            size = math.sqrt(scaled @ scaled)
            if k == 0 and not math.isfinite(size):
                raise NewtonError("the residual is not finite", "check laws and start values")
            if not size <= 2.0 * previous:
                return False
            if k > 0:
                self._rate = max(size / previous, 1e-4) if previous > 0.0 else 0.0
            rate = self._rate if k > 0 else max(self._rate, 1e-2)
            if rate < 1.0 and size * rate <= self.bound * (1.0 - rate):
                return True
            if renew and rate > _SLOW_RATE:
                self._factorize(x, arguments)
            previous = size
        return False

    @property
    def counts(self) -> Statistics:
        """What it cost."""
        return Statistics(
            residual_calls=self._residual.calls,
            jacobian_calls=self._jacobian.calls,
            factorizations=self._linear.factorizations,
            solves=self._linear.solves,
            newton_failures=self.failures,
        )
