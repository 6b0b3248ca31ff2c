"""The stages of 3-stage Radau IIA: their simplified Newton iteration and their error estimate.

A step h from (t, y) seeks Y_i with R(t + c_i h, Y_i, Y'_i) = 0, Y_i = y + h sum_j a_ij Y'_j, and
ends at Y_3. The inverse of A has a real eigenvalue gamma and a pair alpha +- i beta: in W, with
Y - y = T W and h Y' = A^-1 T W, Newton's equations fall apart into real ones, with the matrix
R_y + (gamma/h) R_y', and complex ones, with alpha + i beta in place of gamma.
Hairer & Wanner, Solving ODEs II, 1996, section IV.8.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from beamdae.equations.formulations import FirstOrder
from beamdae.results.solution import Statistics
from beamdae.symbolic.compiled import Compiled
from beamdae.symbolic.factorizations import SingularMatrixError, factorization

Array = np.ndarray

# Nodes, and the weights that integrate polynomials of degree 2 through them exactly.
C = np.array([4.0 - np.sqrt(6.0), 4.0 + np.sqrt(6.0), 10.0]) / 10.0
_EXPONENTS = np.array([1.0, 2.0, 3.0])
_POWERS = C[:, None] ** _EXPONENTS
A = (_POWERS / _EXPONENTS) @ np.linalg.inv(_POWERS / C[:, None])


def _decoupled() -> tuple[float, complex, Array]:
    """gamma, alpha + i beta and T; the columns of T end in 1, 1 and 0."""
    values, vectors = np.linalg.eig(np.linalg.inv(A))
    real, pair = np.argmin(np.abs(values.imag)), np.argmax(values.imag)
    x, z = (vectors[:, k] / vectors[-1, k] for k in (real, pair))
    basis = np.stack([x.real, z.real, -z.imag], axis=1)
    return float(values[real].real), complex(values[pair]), basis


GAMMA, PAIR, T = _decoupled()
_T_INVERSE = np.linalg.inv(T)
_RATES = np.linalg.solve(A, T)
# h sum_i (b^_i - b_i) Y'_i of the method of order 3 that gives y'_n the weight 1 / gamma.
_EMBEDDED = np.linalg.solve((_POWERS / C[:, None]).T, [-1.0 / GAMMA, 0.0, 0.0]) @ _RATES

MAX_ITERATIONS = 10
# Of the first change; the next one tells.
_UNKNOWN_RATE = 0.99
# The second change may be as large as the first: a linear step stretches a beam that rotates, and
# the next one takes that back.
_MOST_GROWTH = 2.0


class Collocation:
    """The stages of one step after the other.

    Attributes
    ----------
    iterations, rate
        Iterations of the last step, and by how much the last one of them shrank the change.
    failures
        Iterations that did not converge.
    reason
        Why the last one of these did not, one phrase.
    """

    def __init__(self, form: FirstOrder, linear_solver: str) -> None:
        p = form.equations.p
        # Arguments (time, y, y', p), of which the stages share the last.
        self._residual = Compiled(form.residual.map("stages", "serial", 3, [3], []), p)
        self._times, self._y, self._yp = (x.reshape(3, -1) for x in self._residual.inputs[:3])
        self._raw = self._residual.outputs[0].reshape(3, -1)
        self._jacobian = Compiled(form.jacobian, p, np.zeros(1))
        # R_y and R_y' at the factors.
        self._stiffness, self._inertia = (sp.csc_matrix(form.pattern, copy=True) for _ in range(2))
        self._real = factorization(form.pattern, linear_solver)
        self._complex = factorization(form.pattern, linear_solver, complex)
        self._n = form.equations.n
        self._w = np.zeros((3, form.size))
        self._pair = np.zeros(form.size, complex)
        self.failures = 0
        self.reason = ""
        self.restart(0.0)

    def restart(self, branch: float) -> None:
        """Begin a smooth interval, without factors and without a step before."""
        self._times[:, 1] = branch
        self._before: tuple[float, Array] | None = None
        self._factorized = 0.0
        self.iterations, self.rate = 0, 1.0

    def serves(self, h: float, rate: float) -> bool:
        """Whether there are factors for this step that shrank the last change to `rate` or less."""
        return h == self._factorized and self.rate <= rate

    def solve(self, t: float, y: Array, yp: Array, h: float, weights: Array, renew: bool) -> bool:
        """Seek the stages of a step, with new factors or with those there are.

        `weights` are one over what the iteration may leave of the leading unknowns; the others do
        not count.
        """
        self._times[:, 0] = t + h * C
        self._predict(yp, h)
        self._stages(y, h)
        try:
            if renew:
                self._factorize(h)
            found = self._iterate(y, h, weights)
        except SingularMatrixError as problem:
            self.reason = f"{problem}; check masses and joints"
            found = False
        if not found:
            self.failures += 1
            self._factorized = 0.0
        return found

    def inside(self, y: Array, h: float) -> list[tuple[Array, Array]]:
        """(Y, Y') of the stages before the last one; the next step overwrites them."""
        self._stages(y, h)
        return list(zip(self._y[:-1], self._yp[:-1], strict=True))

    def end(self, y: Array, h: float) -> tuple[Array, Array]:
        """Take the step: (y, y') at its end."""
        self._before = h, self._w.copy()
        return y + T[2] @ self._w, (_RATES[2] / h) @ self._w

    def error(self, yp: Array, h: float) -> Array:
        """Error of an embedded method of order 3, without what is stiff in it.

        y^ = y_n + h (y'_n / gamma + sum_i b^_i Y'_i), and of e = y^ - y_{n+1} the filter
        (R_y + (gamma/h) R_y') x = (gamma/h) R_y' e passes what is slow and damps what is fast. For
        R = M y' - f(y) this is the estimate of RADAU5. In constraints, without y', it would leave
        nothing: there the right-hand side is R_y e, the error of what the joints prescribe, which
        is all there is of a motion that drivers force. Multipliers enter R by their derivatives,
        in the same columns of both matrices: their errors stay in their own components.
        """
        error = (h / GAMMA) * yp + _EMBEDDED @ self._w
        right = self._inertia @ ((GAMMA / h) * error)
        constraints = slice(2 * self._n, None)
        right[constraints] = (self._stiffness @ error)[constraints]
        return self._real.solve(right)

    def _predict(self, yp: Array, h: float) -> None:
        """Extrapolate the collocation polynomial of the step before, or y'."""
        if self._before is None:
            np.multiply((_T_INVERSE @ (h * C))[:, None], yp, out=self._w)
        else:
            step, w = self._before
            ahead = (1.0 + C * (h / step))[:, None] ** _EXPONENTS - 1.0
            np.matmul(_T_INVERSE @ ahead @ np.linalg.solve(_POWERS, T), w, out=self._w)

    def _stages(self, y: Array, h: float) -> None:
        np.matmul(T, self._w, out=self._y)
        self._y += y
        np.matmul(_RATES / h, self._w, out=self._yp)

    def _factorize(self, h: float) -> None:
        """Factorize at the second stage: no other is as near to all three."""
        self._factorized = h
        self._jacobian.inputs[-1][0] = 0.0
        stiffness, inertia = self._stiffness.data, self._inertia.data
        stiffness[:] = self._jacobian(self._times[1], self._y[1], self._yp[1])[0]
        self._jacobian.inputs[-1][0] = GAMMA / h
        (whole,) = self._jacobian()
        np.multiply(whole - stiffness, h / GAMMA, out=inertia)
        self._real.factorize(whole)
        self._complex.factorize(stiffness + (PAIR / h) * inertia)

    def _iterate(self, y: Array, h: float, weights: Array) -> bool:
        bounded = len(weights)
        previous, rate = np.inf, _UNKNOWN_RATE
        for k in range(MAX_ITERATIONS):
            self.iterations = k + 1
            if k > 0:
                self._stages(y, h)
            self._residual()
            right = _T_INVERSE @ self._raw
            self._pair.real, self._pair.imag = right[1], right[2]
            real, pair = self._real.solve(right[0]), self._complex.solve(self._pair)
            self._w[0] -= real
            self._w[1] -= pair.real
            self._w[2] -= pair.imag
            size = float(
                max(
                    np.abs(real[:bounded] * weights).max(),
                    np.abs(pair[:bounded] * weights).max(),
                )
            )
            if not np.isfinite(size):
                self.reason = "the residual is not finite; check laws and start values"
                return False
            if k > 0:
                rate = size / previous if previous > 0.0 else 0.0
                if rate > (_MOST_GROWTH if k == 1 else 1.0):
                    break
            if rate < 1.0 and size * rate <= 1.0 - rate:
                self.rate = rate if k > 0 else 0.0
                return True
            previous = size
        self.reason = (
            "Newton's iteration did not converge at the smallest step; check the model near this "
            "time"
        )
        return False

    @property
    def counts(self) -> Statistics:
        """What it cost; residuals are counted by stage, factorizations as real and complex ones."""
        return Statistics(
            residual_calls=3 * self._residual.calls,
            jacobian_calls=self._jacobian.calls,
            factorizations=self._real.factorizations + self._complex.factorizations,
            solves=self._real.solves + self._complex.solves,
            newton_failures=self.failures,
        )
