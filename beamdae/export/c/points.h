/* Steps of kernels that are sums over points: constant sparse products around the points' kernels.
   Distances and indices count numbers. */

#ifndef BEAMDAE_POINTS_H
#define BEAMDAE_POINTS_H

#include "model.h"

typedef struct {
    uint32_t tiles, tile, entries, length, row_stride, stride;
    int adds;
} Mix;

/* target[i] (+)= sum over e of weight[i, e] source[column[e]] for rows i of `length` numbers. Each
   `tile` rows have the same columns. */
void mix(Register *target, const Register *source, const uint32_t *columns, const double *weights,
         Mix x);

/* The same, with the weights numbers[indices[i, e]]. */
void mix_numbers(Register *target, const Register *source, const uint32_t *columns,
                 const uint32_t *indices, Mix x, const Register *numbers);

/* target[k] = sum over e of weight[k, e] source[e]; each run has places of target and sources. */
void spread(Register *target, const Register *source, const uint32_t *places,
            const double *weights, uint32_t runs, uint32_t entries, uint32_t count);

void load_rows(Register *target, const uint32_t *rows, uint32_t count, const double *local,
               int64_t lanes);

/* Store numbers to rows of the outputs; the indices of the numbers follow the rows. */
void store_rows(const Register *source, const uint32_t *rows, uint32_t count, double *out,
                int64_t lanes);

void set_rows(Register *target, uint32_t count, double value);

#endif
