"""When Newton's method has found a solution, when it fails, and how far it moves.

`statics.c` contains the same law.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from beamdae.core.return_codes import CORRECTED, DIVERGED, DONE, NOT_CONVERGED, NOT_FINITE

_MAX_ITERATIONS = 12
# Corrections below this size, in natural sizes, are rounding errors of solutions.
_TOLERANCE = 1e-10
# If corrections stop decreasing, they are rounding errors up to this size.
ROUNDING = 1e-7
# Convergence is quadratic if the last but one correction is below the first number: the next one is
# then predicted, and need not be made if it is below the second one.
_QUADRATIC, NEGLIGIBLE = 1e-3, 1e-15
# Largest correction of one iteration, in natural sizes: farther, the linearization says nothing.
# It grows while the equations are linear: the next correction then has the predicted size.
_MAX_CORRECTION = 0.5
_CORRECTION_GROWTH, _MAX_PREDICTION_ERROR = 10.0, 0.3

FAILURES = {
    NOT_CONVERGED: f"Newton's method did not converge in {_MAX_ITERATIONS} iterations",
    NOT_FINITE: "the equations are not finite at the next point",
    DIVERGED: "Newton's method diverges",
}


@dataclass(slots=True)
class Corrections:
    """Corrections of Newton's method.

    Attributes
    ----------
    count
        Number of corrections.
    last, earlier
        Sizes of the last two, in natural sizes.
    share, bound
        Share of the last one by which the point moves, and bound of this motion.
    """

    count: int = 0
    last: float = math.inf
    earlier: float = math.inf
    share: float = 1.0
    bound: float = _MAX_CORRECTION

    def restart(self) -> None:
        """Forget all corrections."""
        self.count, self.last, self.earlier = 0, math.inf, math.inf
        self.share, self.bound = 1.0, _MAX_CORRECTION


def is_negligible(size: float, last: float) -> bool:
    """Return True if a point is a solution after a correction; the previous one is `last`."""
    if last <= _QUADRATIC and size**3 <= NEGLIGIBLE * last**2:
        return True
    return size <= _TOLERANCE or (size <= ROUNDING and size > 0.5 * last)


def judge(run: Corrections, size: float, is_solved: bool) -> int:
    """Add a correction, and set its share; return a code.

    The code is DONE if the point is a solution after it, CORRECTED if another one is needed, or
    that of a failure, see `FAILURES`.
    """
    run.count += 1
    share, last = run.share, run.last
    run.share = 1.0
    if not math.isfinite(size):
        return NOT_FINITE
    if is_solved:
        return DONE
    if run.count > 3 and size > 2.0 * max(last, run.earlier):
        return DIVERGED
    if share < 1.0:
        is_linear = abs(size - (1.0 - share) * last) <= _MAX_PREDICTION_ERROR * share * last
        run.bound = run.bound * _CORRECTION_GROWTH if is_linear else _MAX_CORRECTION
    if size > run.bound:
        run.share = run.bound / size
    run.last, run.earlier = size, last
    return CORRECTED if run.count < _MAX_ITERATIONS else NOT_CONVERGED
