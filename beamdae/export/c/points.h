/* Steps of kernels that are sums over points: constant sparse products around the points' kernels.
   Distances and indices count numbers. */

#ifndef BEAMDAE_POINTS_H
#define BEAMDAE_POINTS_H

#include "linear.h"

typedef struct {
    Index tiles, tile, entries, length, row_stride, stride;
    int adds;
} Mix;

/* target[i] (+)= sum over e of weight[i, e] source[column[e]] for rows i of `length` numbers. Each
   `tile` rows have the same columns. */
void mix(double *target, const double *source, const Index *columns, const double *weights, Mix x);

/* The same, with the weights numbers[indices[i, e]]. */
void mix_numbers(double *target, const double *source, const Index *columns, const Index *indices,
                 Mix x, const double *numbers);

/* target[k] = sum over e of weight[k, e] source[e]; each run has places of target and sources. */
void spread(double *target, const double *source, const Index *places, const double *weights,
            Index runs, Index entries, Index count);

void load(double *target, const Index *rows, Index count, const double *local);

/* Store numbers to rows of the outputs; the indices of the numbers follow the rows. */
void store(const double *source, const Index *rows, Index count, double *out);

void set(double *target, Index count, double value);

#endif
