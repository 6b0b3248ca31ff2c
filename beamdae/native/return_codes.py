"""Return codes of compiled loops; negative ones are failures. Integrators have further ones."""

DONE = 0  # the interval is complete
FULL = 1  # there is no room for more rows of results
NEW_PIVOTS = 2  # a matrix needs other pivots

NOT_CONVERGED = -1  # Newton's iteration did not converge
NOT_FINITE = -2  # the residual is not finite
SINGULAR = -3  # a matrix has no pivots
ERROR_TOO_LARGE = -4  # the error test failed
