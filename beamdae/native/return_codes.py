"""Return codes of compiled loops; negative codes are failures.

Integrators define further codes.
"""

DONE = 0  # the interval is complete
FULL = 1  # there is no room for more rows of results
NEW_PIVOTS = 2  # a matrix needs other pivots

NOT_CONVERGED = -1  # Newton's iteration did not converge
NOT_FINITE = -2  # the residual is not finite
SINGULAR = -3  # no pivots suit a matrix
ERROR_TOO_LARGE = -4  # the error test failed
