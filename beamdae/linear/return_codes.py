"""How compiled loops come back; those of one method have further ones."""

# The interval is over; there is no room for more rows; a matrix needs other pivots.
DONE, FULL, NEW_PIVOTS = 0, 1, 2
# The matrix has none.
SINGULAR = -3
