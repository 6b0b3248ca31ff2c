"""Return codes of compiled loops; loops of an integrator have further ones."""

# The interval is complete.
DONE = 0
# There is no room for more rows of results.
FULL = 1
# A matrix needs other pivots.
NEW_PIVOTS = 2
# A matrix has no pivots: it is singular.
SINGULAR = -3
