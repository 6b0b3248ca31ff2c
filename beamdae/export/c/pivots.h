/* Pivots of matrices that cannot be eliminated in the fixed order of the model. */

#ifndef BEAMDAE_PIVOTS_H
#define BEAMDAE_PIVOTS_H

#include "core.h"

/* Solver with pivots for the full matrix, and the solver without them. */
typedef struct {
    void *solver, *memory;
    LinearSolver before;
} Exchange;

/* Let a solver that requests new pivots eliminate the full matrix with row exchanges; mark it as
   singular if it just did. `solver` is a `LinearSolver`, or a `ComplexSolver` if `is_complex`. */
void exchange_rows(Exchange *exchange, void *solver, const void *nonzeros, int is_complex);
/* Return to the fixed order; return 1 if rows were exchanged. */
int release_pivots(Exchange *exchange);

#endif
