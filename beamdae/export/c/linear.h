/* Sparse linear equations with real or complex numbers, eliminated in a fixed order. */

#ifndef BEAMDAE_LINEAR_H
#define BEAMDAE_LINEAR_H

#include <stdint.h>

typedef uint32_t Index;

/* Matrix in compressed columns, and its elimination in a fixed order with diagonal pivots. */
typedef struct {
    Index size, nnz, n_upper, n_lower;
    const Index *matrix_starts, *matrix_rows;
    const Index *order, *starts, *positions, *sources;
    const Index *upper_starts, *upper_rows, *lower_starts, *lower_rows;
} Pattern;

/* Arrays contain numbers, or pairs of the real and the imaginary part if `is_complex` is 1. */
typedef struct {
    const Pattern *pattern;
    double *nonzeros, *upper, *lower, *inverse, *x;
    double *solution, *right, *residual, *terms;
    /* Factors with row exchanges, row by row; allocated when first needed. */
    double *dense;
    Index *pivots;
    int is_complex, refinements, is_dense;
    /* Number of matrices that required row exchanges, which are slower than the fixed order. */
    unsigned long pivot_searches;
} Factors;

/* Factorize the matrix with the given non-zeros; return 0 if it is singular. */
int factorize(Factors *f);
/* Replace the right-hand side by the solution. */
void solve(Factors *f, double *right);

#endif
