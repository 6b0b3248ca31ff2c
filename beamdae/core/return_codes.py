"""Return codes of the functions of the core, as in `core.h`; negative codes are failures."""

DONE = 0  # the interval is complete
FULL = 1  # there is no room for more rows of results
NEW_PIVOTS = 2  # a matrix needs other pivots
CORRECTED = 3  # statics: another correction is needed
FIRST_STEP = 10  # generalized-alpha requests the starting values of an interval
NO_ADVANCE = 11  # a step of IDA does not advance time

NOT_CONVERGED = -1  # Newton's iteration did not converge
NOT_FINITE = -2  # the residual is not finite
SINGULAR = -3  # no pivots suit a matrix
ERROR_TOO_LARGE = -4  # the error test failed
TOO_SMALL = -5  # the step became too small
STEP_NOT_CHANGED = -6  # generalized-alpha: singular equations of the jerk
DIVERGED = -7  # statics: Newton's method diverges
